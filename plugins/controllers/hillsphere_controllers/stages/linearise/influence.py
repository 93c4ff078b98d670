"""Influence of each dispersed parameter on the motion along a trajectory."""

from __future__ import annotations

import numpy as np

from hillsphere.dynamics import StepMap
from hillsphere.engine.course import Course, Rows
from hillsphere.interfaces import Array
from hillsphere_controllers.stages.linearise.derivatives import Slopes
from hillsphere_controllers.stages.linearise.parameters import Dispersed

__all__ = ["end_deviations", "fit_weights", "jacobian_shares", "largest_accelerations"]

_ROUNDING = 1e-13
"""An entry counts as changed by a parameter if it changes by more than this share of the entry or
of the largest change."""


def jacobian_shares(a: Array, changes: Array) -> Array:
    """Return the norms (q, N) of changes of matrices, relative to the part that changes.

    Parameters
    ----------
    a : ndarray, shape (s, s, N)
        The matrices.
    changes : ndarray, shape (q, s, s, N)
        By each parameter.
    """
    most = np.abs(changes).max(axis=(0, 3), initial=0.0)
    changed = most > _ROUNDING * np.maximum(np.abs(a).max(axis=2), most.max(initial=0.0))
    rows, columns = changed.any(axis=1), changed.any(axis=0)
    size = np.linalg.norm(a[np.ix_(rows, columns)], axis=(0, 1))
    return np.asarray(np.linalg.norm(changes, axis=(1, 2)) / size)


def fit_weights(changes: Array) -> Array:
    """Return shares (q,) in the sum of squares of changes (q, s, s, N)."""
    squares = (changes**2).sum(axis=(1, 2, 3))
    return np.asarray(squares / squares.sum())


def largest_accelerations(
    slopes: Slopes, course: Course, times: Array, dispersed: Dispersed
) -> Array:
    """Return the largest changes (q,) of the acceleration at times (K,) by one σ of each, m/s²."""
    x = np.ascontiguousarray(course.at(times))
    p = np.repeat(dispersed.nominal[:, None], times.size, axis=1)
    u = np.zeros((slopes.controls, times.size))
    changes = slopes.at(x, u, p, times).acceleration * dispersed.sigma[:, None]
    return np.asarray(np.linalg.norm(changes, axis=0).max(axis=1))


def end_deviations(
    slopes: Slopes, rows: Rows, course: Course, times: Array, u: Array, dispersed: Dispersed
) -> Array:
    """Return the displacement (q,) of the end of a flight by one σ of each parameter, m.

    Parameters
    ----------
    slopes : Slopes
        Whose equations are flown, without regard to contact.
    rows : Rows
        Of its states.
    course : Course
        Where the flight begins.
    times : ndarray, shape (K,)
        From the first to the last of these it lasts.
    u : ndarray, shape (m, K)
        Command from each of them to the next.
    dispersed : Dispersed
        The parameters.
    """
    count = len(dispersed.names)
    # the last lane is the nominal flight
    p = np.repeat(dispersed.nominal[:, None], count + 1, axis=1)
    p[:, :count] += np.diag(dispersed.sigma)
    x = np.repeat(course.start[:, None], count + 1, axis=1)
    step = StepMap(slopes.equations, "rk6")
    for k, length in enumerate(np.diff(times)):
        held = np.repeat(u[:, k : k + 1], count + 1, axis=1)
        begin = slopes.start_s + float(times[k])
        x = step.propagate(x, float(length), 1, np.concatenate([p, held]), begin, strict=False)
    away = rows.distance(x[:, :count] - x[:, count:])
    return np.where(np.isfinite(away), away, np.nan)
