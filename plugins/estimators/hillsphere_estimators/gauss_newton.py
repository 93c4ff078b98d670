"""Linearise, solve, repeat: the most probable states by Gauss's and Newton's method, damped.

What is made least is |S⁻¹(x − x̄)|² + |ν(x)|², S the root of the prior covariance and ν what was
measured minus what x would show, in units of the noise. A long step that does not lessen it is
halved.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.convergence import freeze_converged, regular_root, step_in_sigmas
from hillsphere_estimators.differences import Layout
from hillsphere_estimators.innovations import WhitenedInnovation, whiten
from hillsphere_estimators.linearisation import predict_measurement, sensitivity

__all__ = [
    "MOST_HALVINGS",
    "NEVER_HALVED_SIGMAS",
    "Solver",
    "halve_rising_steps",
    "iterate_update",
    "linearise_measurements",
]

Solver: TypeAlias = Callable[[Belief, Array, WhitenedInnovation], Belief]
"""Prior, the states (n, N) about which is linearised, and the measurements beside what these
would show, with the rows of `linear` the transposed derivatives; to the belief that solves it."""

MOST_HALVINGS = 30
"""Halvings of one step at most. A step of 2⁻³⁰, about 1e-9, of the Gauss-Newton step changes the
sum of squares by little more than its rounding; further halvings only cost model evaluations."""
NEVER_HALVED_SIGMAS = 0.1
"""Steps shorter than this, in standard deviations, are never halved: what they make of the sum of
squares may drown in its rounding."""


def linearise_measurements(
    model: EstimationModel,
    at: Belief,
    layout: Layout,
    measurements: MeasurementSet,
    used: NDArray[np.bool_],
) -> WhitenedInnovation:
    """Compare measurements with what means would show; linear rows are derivatives by states."""
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
    *,
    damped: bool = True,
) -> Belief:
    """Return the belief at which repeated linear updates of the prior rest.

    Parameters
    ----------
    model : EstimationModel
        What sensors show.
    prior : Belief
        Before the measurements.
    layout : Layout
        Kinds of the rows.
    measurements : MeasurementSet
        What was measured.
    used : ndarray of bool, shape (m, N)
        Which rows are used.
    solve : Solver
        The linear update.
    iterations : int
        At most so many.
    tolerance : float
        A case rests when its mean moves by less, in standard deviations.
    damped : bool
        Whether steps are halved.

    Returns
    -------
    Belief
        After the measurements. A case that does not rest keeps the best that was found.
    """
    now = prior
    moving = np.ones(len(prior.t_s), dtype=bool)
    for _ in range(iterations):
        expected = linearise_measurements(model, now, layout, measurements, used)
        there = solve(prior, now.x, expected)
        far = step_in_sigmas(there, now)
        long = moving & (far > NEVER_HALVED_SIGMAS)
        if damped and iterations > 1 and long.any():
            before = _squares(prior, now.x, expected.residual)

            def rises(x: Array, limit: Array = before) -> NDArray[np.bool_]:
                z = predict_measurement(model, Belief(x, prior.root, prior.t_s), layout)
                none = np.zeros((len(prior.t_s), 0, layout.rows))
                off = whiten(layout, measurements, used, z, 0.0, none, none).residual
                return ~(_squares(prior, x, off) <= limit)

            there = halve_rising_steps(now, there, long, rises)
        now = freeze_converged(moving, there, now)
        moving &= far > tolerance
        if not moving.any():
            break
    return now


def halve_rising_steps(
    now: Belief,
    there: Belief,
    moving: NDArray[np.bool_],
    rises: Callable[[Array], NDArray[np.bool_]],
) -> Belief:
    """Halve the steps of cases that would raise a sum of squares.

    Parameters
    ----------
    now, there : Belief
        From where to where the means step.
    moving : ndarray of bool, shape (N,)
        Whose steps may be halved.
    rises : callable
        States (n, N) → where (N,) the sum is greater than now.

    Returns
    -------
    Belief
        `there`, its means moved towards those of now.
    """
    share = np.ones(len(now.t_s))
    x = there.x
    for _ in range(MOST_HALVINGS):
        bad = moving & rises(x)
        if not bad.any():
            break
        share = np.where(bad, 0.5 * share, share)
        x = np.where(share < 1.0, now.x + share * (there.x - now.x), there.x)
    return Belief(x, there.root, there.t_s)


def _squares(prior: Belief, x: Array, residual: Array) -> Array:
    off = np.linalg.solve(regular_root(prior), (x - prior.x).T[:, :, None])[:, :, 0]
    return np.asarray(np.sum(off**2, axis=1) + np.sum(residual**2, axis=1))
