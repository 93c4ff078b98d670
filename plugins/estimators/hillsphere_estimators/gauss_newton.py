"""Gauss-Newton iteration of a measurement update, with step halving.

The maximum a posteriori states of a prior x̄ with covariance S Sᵀ and measurements of normal noise
minimise the sum of squares

    J(x) = |S⁻¹ (x − x̄)|² + |ν(x)|²,

where ν is the innovation (measured minus predicted) in units of the noise. Each iteration
linearises the measurements about the last states and solves the linear update; a step that does not
reduce J is halved until it does [1]_.

References
----------
.. [1] Bell, Cathey (1993), The iterated Kalman filter update as a Gauss–Newton method, IEEE Trans.
   Automatic Control 38(2).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel, Integers
from hillsphere_estimators.convergence import freeze_converged, step_in_sigmas
from hillsphere_estimators.differences import Layout
from hillsphere_estimators.innovations import WhitenedInnovation, whiten
from hillsphere_estimators.linearisation import sensitivity
from hillsphere_estimators.roots import solve_root

__all__ = [
    "MOST_HALVINGS",
    "NEVER_HALVED_SIGMAS",
    "Solver",
    "halve_rising_steps",
    "iterate_update",
    "linearise_measurements",
]

Solver: TypeAlias = Callable[[Belief, Array, WhitenedInnovation], Belief]
"""Linear update: prior, states (n, N) of the linearisation, and the innovation there, whose rows
`linear` are the transposed derivatives by the states → belief after the measurements."""

MOST_HALVINGS = 30
"""Halvings of one step at most. A step of 2⁻³⁰, about 1e-9, of the Gauss-Newton step changes the
sum of squares by little more than its rounding; further halvings only cost model evaluations."""
NEVER_HALVED_SIGMAS = 0.1
"""Length of a step, in standard deviations, below which it is not halved. The change of the sum of
squares goes with the square of the step and drowns in rounding: with a smaller limit a converged
step might be halved to nothing, with a much larger one a diverging step would pass unchecked."""


def linearise_measurements(
    model: EstimationModel,
    at: Belief,
    layout: Layout,
    measurements: MeasurementSet,
    used: NDArray[np.bool_],
) -> WhitenedInnovation:
    """Linearise the predicted measurements about the means of a belief.

    Parameters
    ----------
    model : EstimationModel
        Measurement model.
    at : Belief
        Means about which is linearised; its standard deviations set the steps of finite
        differences.
    layout : Layout
        Kinds of the m rows.
    measurements : MeasurementSet
        Values and standard deviations of the noise.
    used : ndarray of bool, shape (m, N)
        Rows that are used.

    Returns
    -------
    WhitenedInnovation
        Residuals at the means; its linear rows (N, n, m) are the derivatives by the states, over
        the noise. There are no rows of curvature.
    """
    z, slopes = sensitivity(model, at, layout)
    none = np.zeros((len(slopes), 0, layout.rows))
    return whiten(layout, measurements, used, z, 0.0, np.swapaxes(slopes, 1, 2), none)


def iterate_update(
    model: EstimationModel,
    prior: Belief,
    layout: Layout,
    measurements: MeasurementSet,
    used: NDArray[np.bool_],
    solve: Solver,
    iterations: int,
    tolerance: float,
) -> Belief:
    """Repeat a linear update about its own result until it converges.

    Parameters
    ----------
    model : EstimationModel
        Measurement model.
    prior : Belief
        Before the measurements.
    layout : Layout
        Kinds of the m rows.
    measurements : MeasurementSet
        Values and standard deviations of the noise.
    used : ndarray of bool, shape (m, N)
        Rows that are used.
    solve : Solver
        The linear update.
    iterations : int
        Iterations at most; 1 is the update of the extended Kalman filter.
    tolerance : float
        A case has converged when its mean moves by less, in standard deviations.

    Returns
    -------
    Belief
        After the measurements. A case that has not converged keeps its last iterate.
    """
    # `now` is the last iterate, at first the prior
    now = prior
    moving = np.ones(len(prior.t_s), dtype=bool)
    for _ in range(iterations):
        expected = linearise_measurements(model, now, layout, measurements, used)
        there = solve(prior, now.x, expected)
        far = step_in_sigmas(there, now)
        # only steps of iterated updates can diverge: a single one is the extended filter's
        long = moving & (far > NEVER_HALVED_SIGMAS)
        if iterations > 1 and long.any():
            before = _squares(prior, now.x, expected.residual)

            def rises(x: Array, own: Integers, limit: Array = before) -> NDArray[np.bool_]:
                z = layout.fitting(model.observe(x, prior.t_s[own], own))
                none = np.zeros((own.size, 0, layout.rows))
                some = measurements.of_cases(own)
                off = whiten(layout, some, used[:, own], z, 0.0, none, none).residual
                # a sum that is not a number counts as a rise
                return ~(_squares(prior.of_cases(own), x, off) <= limit[own])

            there = halve_rising_steps(now, there, long, rises)
        now = freeze_converged(moving, there, now)
        # a step of the full length that is this short ends the case
        moving &= far > tolerance
        if not moving.any():
            break
    return now


def halve_rising_steps(
    now: Belief,
    there: Belief,
    moving: NDArray[np.bool_],
    rises: Callable[[Array, Integers], NDArray[np.bool_]],
) -> Belief:
    """Halve the steps of cases that would raise their sum of squares.

    Parameters
    ----------
    now, there : Belief
        Before and after the step.
    moving : ndarray of bool, shape (N,)
        Cases whose steps may be halved.
    rises : callable
        States (n, K) of some cases and their indices (K,) → ndarray of bool (K,): where the sum of
        squares exceeds that of `now`.

    Returns
    -------
    Belief
        `there` with shortened steps of the means; its covariance is unchanged.
    """
    x, bad, share = there.x.copy(), np.flatnonzero(moving), 1.0
    step = there.x - now.x
    for _ in range(MOST_HALVINGS):
        bad = bad[rises(x.take(bad, axis=1), bad)]
        if not bad.size:
            break
        share *= 0.5
        # steps of full length keep the bits of `there`
        x[:, bad] = now.x[:, bad] + share * step[:, bad]
    return Belief(x, there.root, there.t_s)


def _squares(prior: Belief, x: Array, residual: Array) -> Array:
    """Return the sum of squares J (N,) at states x (n, N) with the residuals ν (N, m) there."""
    off = solve_root(prior.root, (x - prior.x).T[:, :, None])[:, :, 0]
    return np.asarray(np.sum(off**2, axis=1) + np.sum(residual**2, axis=1))
