"""Innovations, measured minus predicted, in units of the noise, and their gate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array, Integers
from hillsphere_estimators.differences import Layout, layout_of
from hillsphere_estimators.roots import unit

__all__ = [
    "SAME_TIME",
    "WhitenedInnovation",
    "apply_gate",
    "gate_threshold",
    "refer_to_prior",
    "require_independent",
    "usable",
    "usable_at",
    "whiten",
]

SAME_TIME = 1e-9
"""Difference of two times, absolute (s) and relative, that is rounding: a belief and measurements
that differ by more belong to different times."""


@dataclass(frozen=True)
class WhitenedInnovation:
    """Innovation of N cases, all in units of the standard deviations of the noise.

    Rows that are not used hold zeros.

    Parameters
    ----------
    residual : ndarray, shape (N, m)
        Measured minus predicted.
    linear : ndarray, shape (N, k, m)
        Rows whose squares are the covariance of the predicted measurements by the uncertainty of
        the states, to first order.
    bent : ndarray, shape (N, l, m)
        Rows of the covariance that curvature adds; uncorrelated with the former.
    used : ndarray of bool, shape (m, N)
        Rows that are used.
    root : ndarray, shape (N, m, m), optional
        Lower root L of the correlation of the noise. The rows above are then those of noise with
        the unit matrix as its covariance, L⁻¹ times those over the standard deviations. None for
        independent noise: L = 1.
    """

    residual: Array
    linear: Array
    bent: Array
    used: NDArray[np.bool_]
    root: Array | None = None

    def of_cases(self, cases: Integers) -> WhitenedInnovation:
        """Return the innovations of some cases, by their indices."""
        root = None if self.root is None else self.root[cases]
        return WhitenedInnovation(
            self.residual[cases], self.linear[cases], self.bent[cases], self.used[:, cases], root
        )

    def covariance(self) -> Array:
        """Return the covariance of the residual (N, m, m), with that of the noise, 1."""
        total = np.swapaxes(self.linear, 1, 2) @ self.linear
        if self.bent.shape[1]:
            total += np.swapaxes(self.bent, 1, 2) @ self.bent
        cases, m, _ = total.shape
        total.reshape(cases, m * m)[:, :: m + 1] += 1.0
        return np.asarray(total)

    def in_sigmas(self) -> WhitenedInnovation:
        """Return residual and rows over the standard deviations, the noise still correlated.

        Its `covariance` leaves the correlation out: take that of this innovation, L S Lᵀ.
        """
        if self.root is None:
            return self
        mixed = np.swapaxes(self.root, 1, 2)
        return replace(
            self,
            residual=(self.root @ self.residual[:, :, None])[:, :, 0],
            linear=self.linear @ mixed,
            bent=self.bent @ mixed,
            root=None,
        )

    def innovation(self, sigma: Array, nis: Array | None = None) -> Innovation:
        """Return the innovation in SI units.

        Parameters
        ----------
        sigma : ndarray, shape (m, N)
            Standard deviations of the noise.
        nis : ndarray, shape (N,), optional
            Normalised innovation squared, if the update has computed it already.

        Returns
        -------
        Innovation
            Residual, covariance, used rows and NIS.
        """
        covariance = self.covariance()
        if nis is None:
            solved = np.linalg.solve(covariance, self.residual[:, :, None])[:, :, 0]
            nis = np.sum(solved * self.residual, axis=1)
        residual = self.in_sigmas().residual
        if self.root is not None:
            covariance = self.root @ covariance @ np.swapaxes(self.root, 1, 2)
        size = np.where((sigma > 0.0) & (sigma < np.inf), sigma, 1.0).T
        covariance *= size[:, :, None]
        covariance *= size[:, None]
        return Innovation((residual * size).T, covariance, self.used, nis)

    def without(self, used: NDArray[np.bool_]) -> WhitenedInnovation:
        """Return the innovation with the rows `used` (m, N) only; the others become zero."""
        keep = used.T.astype(float)
        sized = self.in_sigmas()
        made = WhitenedInnovation(
            sized.residual * keep, sized.linear * keep[:, None], sized.bent * keep[:, None], used
        )
        if self.root is None:
            return made
        return _decorrelate(made, self.root @ np.swapaxes(self.root, 1, 2))


def _decorrelate(sized: WhitenedInnovation, correlation: Array) -> WhitenedInnovation:
    """Return an innovation over the standard deviations with its noise made independent.

    Rows that are not used leave the correlation (N, m, m) with their columns: the errors of the
    others have the marginal distribution.
    """
    used = sized.used.T
    both = used[:, :, None] & used[:, None]
    own = np.where(both, correlation, unit(used.shape[1]))
    try:
        root = np.linalg.cholesky(own)
    except np.linalg.LinAlgError:
        least = np.linalg.eigvalsh(own)[:, 0]
        raise InputError(
            f"the covariance of the measurements of case {int(np.argmin(least))} is not positive "
            "definite across the predicted directions"
        ) from None
    inverse = np.linalg.inv(root)
    mixed = np.swapaxes(inverse, 1, 2)
    return WhitenedInnovation(
        (inverse @ sized.residual[:, :, None])[:, :, 0],
        sized.linear @ mixed,
        sized.bent @ mixed,
        sized.used,
        root,
    )


def usable(measurements: MeasurementSet) -> tuple[Layout, NDArray[np.bool_]]:
    """Return the layout of the measured rows, and which hold a measurement (m, N).

    The third row of a direction never does: a difference of directions has two coordinates.
    """
    layout = layout_of(measurements.blocks)
    return layout, measurements.present & layout.real[:, None]


def usable_at(belief: Belief, measurements: MeasurementSet) -> tuple[Layout, NDArray[np.bool_]]:
    """Return layout and usable rows of measurements that are to update a belief.

    Raises
    ------
    InputError
        If the measurements have another number of cases or another time than the belief.
    """
    at, then = belief.t_s, measurements.t_s
    if at.shape != then.shape:
        raise InputError(f"the belief has {len(at)} cases, the measurements have {len(then)}")
    late = np.abs(then - at) > SAME_TIME * (1.0 + np.abs(at))
    if late.any():
        case = int(np.argmax(late))
        raise InputError(
            f"case {case} was measured at {then[case]:.12g} s, but the belief is of "
            f"{at[case]:.12g} s; predict it to the measurements' time first"
        )
    return usable(measurements)


def whiten(
    layout: Layout,
    measurements: MeasurementSet,
    used: NDArray[np.bool_],
    middle: Array,
    shift: Array | float,
    linear: Array,
    bent: Array,
) -> WhitenedInnovation:
    """Return the innovation in units of the noise.

    Parameters
    ----------
    layout : Layout
        Kinds of the m rows.
    measurements : MeasurementSet
        Values and standard deviations of the noise.
    used : ndarray of bool, shape (m, N)
        Rows that are used.
    middle : ndarray, shape (m, N)
        Predicted measurements of the mean, SI.
    shift : ndarray, shape (m, N), or float
        Mean of the predicted measurements minus `middle`.
    linear, bent : ndarray, shape (N, k, m) and (N, l, m)
        Rows of their covariance, SI; see `WhitenedInnovation`.
    """
    if measurements.correlation is not None:
        sized = whiten(
            layout, replace(measurements, correlation=None), used, middle, shift, linear, bent
        )
        # values that cannot be predicted have no direction; their case is no number by its residual
        at = np.where(np.isfinite(middle), middle, 0.0)
        return _decorrelate(sized, layout.noise(measurements.correlation, at))
    # without missing rows the masks below change nothing and cost as much as the rest
    if used.all():
        residual = layout.difference(measurements.values, middle) - shift
        scale = 1.0 / measurements.sigma
        row = scale.T[:, None]
        return WhitenedInnovation((residual * scale).T, linear * row, bent * row, used)
    # missing values are NaN: the predicted ones in their place keep all that follows finite
    values = np.where(measurements.present, measurements.values, middle)
    residual = layout.difference(values, middle) - shift
    scale = 1.0 / np.where(used, measurements.sigma, 1.0)
    row, keep = scale.T[:, None], used.T[:, None]
    return WhitenedInnovation(
        np.where(used, residual * scale, 0.0).T,
        np.where(keep, linear * row, 0.0),
        np.where(keep, bent * row, 0.0),
        used,
    )


def apply_gate(layout: Layout, expected: WhitenedInnovation, sigmas: float) -> WhitenedInnovation:
    """Reject blocks of measurements whose innovation is improbably large.

    The squared innovation of a block over its covariance is compared with a χ² limit. The test is
    skipped, and the block taken, where the variance by curvature exceeds that of the noise: there
    the prediction is no measure of the measurement. A filter that begins with a wide belief, or
    resumes after a long outage, would otherwise reject all that could correct it.

    Parameters
    ----------
    layout : Layout
        Rows of each block; a block is taken or rejected as a whole.
    expected : WhitenedInnovation
        The innovation.
    sigmas : float
        Limit, as the deviation of a single normal number of the same probability.

    Returns
    -------
    WhitenedInnovation
        With the blocks that are taken.
    """
    covariance, sized = expected.covariance(), expected.in_sigmas()
    if expected.root is not None:
        covariance = expected.root @ covariance @ np.swapaxes(expected.root, 1, 2)
    # variance of each row by curvature, in units of the noise's
    bend = np.sum(sized.bent**2, axis=1)
    used = expected.used.copy()
    for rows in layout.blocks:
        own = sized.residual[:, rows]
        solved = np.linalg.solve(covariance[:, rows, rows], own[:, :, None])[:, :, 0]
        distance = np.sum(own * solved, axis=1)
        straight = (bend[:, rows] <= 1.0).all(axis=1)
        limit = gate_threshold(sigmas, rows.stop - rows.start)[used[rows].sum(axis=0)]
        # rows of zeros add nothing to the distance: the limit is that of the rows that are there
        used[rows] &= (distance <= limit) | ~straight
    return expected if np.array_equal(used, expected.used) else expected.without(used)


def refer_to_prior(prior: Belief, x: Array, expected: WhitenedInnovation) -> WhitenedInnovation:
    """Return a linearisation at x as the innovation of a prior.

    Parameters
    ----------
    prior : Belief
        With the mean x̄ and the root S.
    x : ndarray, shape (n, N)
        States of the linearisation.
    expected : WhitenedInnovation
        Residual ν(x), and as linear rows Hᵀ, the transposed derivatives by the states.

    Returns
    -------
    WhitenedInnovation
        Residual ν(x) + H (x − x̄), that of the linear model at x̄; linear rows Sᵀ Hᵀ.
    """
    off = (x - prior.x).T[:, None]
    return WhitenedInnovation(
        expected.residual + (off @ expected.linear)[:, 0],
        np.swapaxes(prior.root, 1, 2) @ expected.linear,
        expected.bent,
        expected.used,
        expected.root,
    )


def require_independent(sets: Sequence[MeasurementSet], what: str) -> None:
    """Raise `InputError` if the errors of a set are correlated, which `what` does not take."""
    if any(one.correlation is not None for one in sets):
        raise InputError(
            f"{what} takes independent errors of measurements, given by standard deviations, but a "
            "set states full covariances; take a filter or batch_least_squares"
        )


@lru_cache(maxsize=256)
def gate_threshold(sigmas: float, most: int) -> Array:
    """Return the χ² limits of the gate for blocks of 0 to `most` rows.

    Each has the probability of a normal number beyond ±`sigmas`; a block without rows has no limit.
    """
    tail = 2.0 * norm.sf(sigmas)
    return np.array([np.inf, *(float(chi2.isf(tail, k)) for k in range(1, most + 1))])
