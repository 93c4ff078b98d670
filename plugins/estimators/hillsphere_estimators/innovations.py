"""What measurements say beside what was expected: in units of their noise, within a gate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, Innovation, MeasurementSet
from hillsphere.interfaces import Array
from hillsphere_estimators.differences import Layout, layout_of

__all__ = [
    "WhitenedInnovation",
    "apply_gate",
    "gate_threshold",
    "refer_to_prior",
    "usable",
    "usable_at",
    "whiten",
]

_SAME_TIME = 1e-9
"""Of two times, s and as a part of them, that count as the same."""


@dataclass(frozen=True)
class WhitenedInnovation:
    """Measurements beside what was expected, all in units of the noise's standard deviations.

    Rows that are not used hold zeros.

    Parameters
    ----------
    residual : ndarray, shape (N, m)
        Measured minus expected.
    linear : ndarray, shape (N, k, m)
        Rows of what the states' uncertainty makes of the measurements.
    bent : ndarray, shape (N, l, m)
        Rows of what comes of curvature; independent of the former.
    used : ndarray of bool, shape (m, N)
        Which rows are used.
    """

    residual: Array
    linear: Array
    bent: Array
    used: NDArray[np.bool_]

    def covariance(self) -> Array:
        """Return the covariance of the residual (N, m, m), noise with it."""
        total = np.swapaxes(self.linear, 1, 2) @ self.linear
        if self.bent.shape[1]:
            total += np.swapaxes(self.bent, 1, 2) @ self.bent
        cases, m, _ = total.shape
        total.reshape(cases, m * m)[:, :: m + 1] += 1.0
        return np.asarray(total)

    def innovation(self, sigma: Array, nis: Array | None = None) -> Innovation:
        """Return it in SI.

        Parameters
        ----------
        sigma : ndarray, shape (m, N)
            Standard deviations of the noise.
        nis : ndarray, shape (N,), optional
            Normalised innovation squared, where the update has found it; else it is found here.

        Returns
        -------
        Innovation
            Of the measurements.
        """
        covariance = self.covariance()
        if nis is None:
            solved = np.linalg.solve(covariance, self.residual[:, :, None])[:, :, 0]
            nis = np.sum(solved * self.residual, axis=1)
        unit = np.where((sigma > 0.0) & (sigma < np.inf), sigma, 1.0).T
        covariance *= unit[:, :, None]
        covariance *= unit[:, None]
        return Innovation((self.residual * unit).T, covariance, self.used, nis)

    def without(self, used: NDArray[np.bool_]) -> WhitenedInnovation:
        """Return it with fewer rows used."""
        keep = used.T.astype(float)
        return WhitenedInnovation(
            self.residual * keep, self.linear * keep[:, None], self.bent * keep[:, None], used
        )


def usable(measurements: MeasurementSet) -> tuple[Layout, NDArray[np.bool_]]:
    """Return the layout of the rows, and which of them hold something (m, N)."""
    layout = layout_of(measurements.blocks)
    return layout, measurements.present & layout.real[:, None]


def usable_at(belief: Belief, measurements: MeasurementSet) -> tuple[Layout, NDArray[np.bool_]]:
    """Return the same for an update of a belief.

    Raises
    ------
    InputError
        If the measurements are of another number of cases, or of another time.
    """
    at, then = belief.t_s, measurements.t_s
    if at.shape != then.shape:
        raise InputError(f"the belief has {len(at)} cases, the measurements have {len(then)}")
    late = np.abs(then - at) > _SAME_TIME * (1.0 + np.abs(at))
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
    """Compare measurements with what was expected.

    Parameters
    ----------
    layout : Layout
        Kinds of the rows.
    measurements : MeasurementSet
        What was measured.
    used : ndarray of bool, shape (m, N)
        Which rows are used.
    middle : ndarray, shape (m, N)
        What the mean would show.
    shift : ndarray, shape (m, N), or float
        By how much more is expected.
    linear, bent : ndarray, shape (N, k, m) and (N, l, m)
        Rows of its uncertainty, SI.

    Returns
    -------
    Expected
        In units of the noise.
    """
    if used.all():
        residual = layout.difference(measurements.values, middle) - shift
        scale = 1.0 / measurements.sigma
        row = scale.T[:, None]
        return WhitenedInnovation((residual * scale).T, linear * row, bent * row, used)
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
    """Leave out blocks that lie too far from what was expected.

    Where the curvature of the expectation exceeds the noise the expectation is no measure, and the
    block is taken: so a filter that begins with a wide belief, or comes back after a long silence,
    is not locked out.

    Parameters
    ----------
    layout : Layout
        Which rows belong together.
    expected : Expected
        Measurements and expectation.
    sigmas : float
        A block is left out if it lies as improbably far off as a normal number beyond this.

    Returns
    -------
    Expected
        With the blocks that stay.
    """
    covariance = expected.covariance()
    bend = np.sum(expected.bent**2, axis=1)
    used = expected.used.copy()
    for rows in layout.blocks:
        own = expected.residual[:, rows]
        solved = np.linalg.solve(covariance[:, rows, rows], own[:, :, None])[:, :, 0]
        distance = np.sum(own * solved, axis=1)
        straight = (bend[:, rows] <= 1.0).all(axis=1)
        limit = gate_threshold(sigmas, rows.stop - rows.start)[used[rows].sum(axis=0)]
        used[rows] &= (distance <= limit) | ~straight
    return expected if np.array_equal(used, expected.used) else expected.without(used)


def refer_to_prior(prior: Belief, x: Array, expected: WhitenedInnovation) -> WhitenedInnovation:
    """Return what slopes at x (n, N) say of the prior: its linear rows go with those of Sᵀ."""
    off = (x - prior.x).T[:, None]
    return WhitenedInnovation(
        expected.residual + (off @ expected.linear)[:, 0],
        np.swapaxes(prior.root, 1, 2) @ expected.linear,
        expected.bent,
        expected.used,
    )


@lru_cache(maxsize=256)
def gate_threshold(sigmas: float, most: int) -> Array:
    """Return χ² limits for 0 … most rows with the two-sided normal probability beyond `sigmas`."""
    tail = 2.0 * norm.sf(sigmas)
    return np.array([np.inf, *(float(chi2.isf(tail, k)) for k in range(1, most + 1))])
