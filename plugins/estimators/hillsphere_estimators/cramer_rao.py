"""The posterior Cramér–Rao bound of the mean square error of any filter.

The information J of the states follows from one time to the next, for motion x' = f(x) + w,
w ~ N(0, Q), and measurements with the derivatives H and noise of unit variance, by (eq. 21 of [1]_,
with the matrix inversion lemma)

.. math::

    J' = E[H^T H] + (Φ J^{-1} Φ^T + Q)^{-1}.

The expectation is over the true trajectories. Here Φ and, unless it is pooled, HᵀH are those along
each trajectory: the bound then holds for flights near that trajectory. This form needs no inverse
of Q and is computed by roots of J⁻¹.

The bound is over filters that estimate all states. States that the model has as considered ones are
nuisance parameters of it: a filter that estimates them may reach it, one that only considers them
cannot. For that one the covariance of Schmidt's filter [2]_ along the trajectories is given beside.

References
----------
.. [1] Tichavský, Muravchik, Nehorai (1998), Posterior Cramér–Rao bounds for discrete-time nonlinear
   filtering, IEEE Trans. Signal Processing 46(5).
.. [2] Schmidt (1966), Application of state-space methods to navigation problems, Advances in
   Control Systems 3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.casewise import mark_failed, replace_failed
from hillsphere_estimators.gauss_newton import linearise_measurements
from hillsphere_estimators.innovations import WhitenedInnovation, usable
from hillsphere_estimators.linearisation import noise_between, transition
from hillsphere_estimators.roots import lower_root, upper_triangle
from hillsphere_estimators.sigma_points import update_mask
from hillsphere_estimators.unscented import linear_update

__all__ = ["Bounds", "cramer_rao", "rms"]


@dataclass(frozen=True)
class Bounds(Sequence[Belief]):
    """Bounds at K times, a sequence of beliefs.

    Parameters
    ----------
    beliefs : tuple of Belief
        At each time the true states with the bound as covariance, after the measurements; NaN from
        where the model gives no numbers along a trajectory.
    nuisance : ndarray of bool, shape (n,)
        States that the model only considers. The bound of the others is that of a filter that
        estimates these too.
    considered : tuple of Belief
        At each time the true states with the covariance of Schmidt's filter, which does not
        estimate the nuisance states; the bounds themselves if there are none.
    """

    beliefs: tuple[Belief, ...]
    nuisance: NDArray[np.bool_]
    considered: tuple[Belief, ...]

    @overload
    def __getitem__(self, k: int) -> Belief: ...

    @overload
    def __getitem__(self, k: slice) -> tuple[Belief, ...]: ...

    def __getitem__(self, k: int | slice) -> Belief | tuple[Belief, ...]:
        """Return the bound at a time, or those at some."""
        return self.beliefs[k]

    def __len__(self) -> int:
        """Return the number of times."""
        return len(self.beliefs)


def cramer_rao(
    model: EstimationModel,
    truth: Sequence[Array],
    prior: Array,
    measurements: Sequence[MeasurementSet],
    controls: Sequence[Array] | None = None,
    *,
    pooled: bool = False,
    motion: Sequence[tuple[Array, Array]] | None = None,
) -> Bounds:
    """Return the bounds along true trajectories.

    Parameters
    ----------
    model : EstimationModel
        Motion, its noise, and measurements. Measurements that are not smooth, such as the centroid
        of the points that a camera sees, must be replaced by smooth ones.
    truth : sequence of ndarray, shape (n, N)
        True states of N trajectories at K times, SI.
    prior : ndarray, shape (N, n, n)
        Covariance of the first states before any measurement; zeros for states known exactly.
    measurements : sequence of MeasurementSet
        At the K times. Only which rows are present, and their standard deviations, are used.
    controls : sequence of ndarray, shape (p, N), optional
        K − 1: between the times.
    pooled : bool
        Whether HᵀH is averaged over the trajectories. For trajectories that lie apart the result is
        still a bound, but a lower one: some of them have better measurements than others.
    motion : sequence of (ndarray, ndarray), optional
        K − 1: transition matrices (N, n, n) and roots (N, n, r) of the process noise between the
        times, if they are known already; by default they are those of the model.

    Returns
    -------
    Bounds
        The bounds, which states are nuisance parameters of them, and the covariances of the filter
        that considers those.

    Raises
    ------
    InputError
        If there are not as many sets of measurements as times, the prior is no covariance, the
        times go backward over process noise, or the model gives no numbers in any trajectory.
    """
    if len(truth) != len(measurements):
        raise InputError(
            f"there must be one set of measurements for each of the {len(truth)} times, got "
            f"{len(measurements)}"
        )
    now = Belief.of(truth[0], prior, measurements[0].t_s)
    free = update_mask(model, len(now.x))
    held = now
    bounds: list[Belief] = []
    considered: list[Belief] = []
    failed = np.zeros(len(now.t_s), dtype=bool)
    for k, (x, measured) in enumerate(zip(truth, measurements, strict=True)):
        if k:
            if motion is None:
                control = np.zeros((0, x.shape[1])) if controls is None else controls[k - 1]
                _, phi = transition(model, now, measured.t_s, control)
                noise = noise_between(model, now, measured.t_s, control)
            else:
                phi, noise = motion[k - 1]
            now, held = (
                # Φ J⁻¹ Φᵀ + Q by its rows
                Belief(
                    x,
                    lower_root(np.swapaxes(np.concatenate([phi @ one.root, noise], axis=2), 1, 2)),
                    measured.t_s,
                )
                for one in (now, held)
            )
        slopes = _slopes(model, now, measured, pooled)
        now = Belief(x, _add_information(now, slopes), measured.t_s)
        # trajectories without numbers go on with the bound of another one, and are marked
        now, lost, _ = replace_failed(now)
        failed = failed | lost
        if failed.all():
            raise InputError(
                f"at {measured.t_s[0]:.12g} s the model gives no finite motion, or no finite "
                "measurement of rows that are present, along any trajectory"
            )
        bounds.append(mark_failed(now, failed))
        if free is not None:
            held = linear_update(held, _unit_innovation(held, slopes), 1.0, free)
            held, _, _ = replace_failed(held)
            considered.append(mark_failed(held, failed))
    nuisance = np.zeros(len(now.x), dtype=bool) if free is None else free == 0.0
    return Bounds(tuple(bounds), nuisance, tuple(considered or bounds))


def rms(bounds: Belief, states: slice | Sequence[int]) -> float:
    """Return the root mean square error, over trajectories, that the bound allows for some states.

    Parameters
    ----------
    bounds : Belief
        At one time.
    states : slice or sequence of int
        States of one unit, for instance the three of a position.

    Returns
    -------
    float
        √(mean over trajectories of the sum of variances), SI.
    """
    return float(np.sqrt(np.mean(np.sum(bounds.sigma[states] ** 2, axis=0))))


def _slopes(model: EstimationModel, now: Belief, measured: MeasurementSet, pooled: bool) -> Array:
    """Return Hᵀ (N, n, m), the derivatives of measurements over their noise, or a pooled root."""
    layout, used = usable(measured)
    slopes = linearise_measurements(model, now, layout, measured, used).linear
    if pooled:
        cases, n, m = slopes.shape
        every: Array = slopes.transpose(0, 2, 1).reshape(1, cases * m, n)
        # a root of the mean of HᵀH over the cases
        slopes = np.repeat(lower_root(every) * float(cases) ** -0.5, cases, axis=0)
    return slopes


def _unit_innovation(belief: Belief, slopes: Array) -> WhitenedInnovation:
    """Return the innovation of measurements that are as predicted, with derivatives Hᵀ."""
    cases, _, m = slopes.shape
    return WhitenedInnovation(
        np.zeros((cases, m)),
        np.swapaxes(belief.root, 1, 2) @ slopes,
        np.zeros((cases, 0, m)),
        np.ones((m, cases), dtype=bool),
    )


def _add_information(now: Belief, slopes: Array) -> Array:
    """Return the root of (P⁻¹ + HᵀH)⁻¹ = S (1 + SᵀHᵀHS)⁻¹ Sᵀ, without an inverse of S."""
    # Uᵀ U = 1 + (HS)ᵀ HS
    inner = upper_triangle(_under_unit(np.swapaxes(slopes, 1, 2) @ now.root))
    # S U⁻¹, and its lower triangular form
    return lower_root(
        np.asarray(np.linalg.solve(np.swapaxes(inner, 1, 2), np.swapaxes(now.root, 1, 2)))
    )


def _under_unit(rows: Array) -> Array:
    """Return the unit matrix above the rows (N, k, n)."""
    cases, _, n = rows.shape
    return np.concatenate([np.broadcast_to(np.eye(n), (cases, n, n)), rows], axis=1)
