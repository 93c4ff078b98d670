"""Held commands whose flight meets a given path."""

from __future__ import annotations

import numpy as np

from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array, Integers
from hillsphere_guidance.motion import Motion

__all__ = ["solve_held_command"]

_TOLERANCE = 1e-11
"""Error of a step, natural units, by step doubling, at which substeps are chosen: ten times `_MET`.
Newton's iterations solve the flight of these substeps to `_MET`; the error of the substeps is what
the replay by Taylor series shows."""
_ROUNDS = 30
"""Newton iterations at most. With the derivatives of free space they converge linearly, by the
square of the step over the time scale of the field; steps that need more are too long."""
_MET = 1e-12
"""Largest miss, in units of the plant's scales: a few thousand roundings, which the substeps
leave."""


def solve_held_command(motion: Motion, t: Array, x: Array, mean: Array, time_s: float) -> Array:
    r"""Find accelerations, held from each time to the next, whose flight meets a path.

    A held acceleration changes position and velocity together, so that one step cannot meet both
    but two can. Every second state is met exactly (the last three steps of an odd number are solved
    together), by Newton's method with the derivatives of free space,

    .. math:: \delta r = \sum_j h_j (T - s_j - \tfrac12 h_j)\,\delta a_j, \quad
              \delta v = \sum_j h_j\,\delta a_j,

    s_j the start of step j and T the length of the group. Each group starts from the path's own
    state, so that all are solved at once; of three accelerations the smallest change is taken.

    Parameters
    ----------
    motion : Motion
        Motion of the plant.
    t : ndarray, shape (K,)
        Rising times since the start, two steps at least.
    x : ndarray, shape (n, K)
        The path, a solution of the plant's equations under some command.
    mean : ndarray, shape (d, K - 1)
        Mean of that command over each step: the start of the search.
    time_s : float
        Time at the start.

    Returns
    -------
    ndarray, shape (d, K - 1)
        m/s².

    Raises
    ------
    ConvergenceError
        If the steps are too long for the field.
    """
    steps = len(t) - 1
    first = np.arange(0, steps - steps % 2 * 3, 2)
    u = np.array(mean)
    if first.size:
        _solve(motion, t, x, u, first, 2, time_s)
    if steps % 2:
        _solve(motion, t, x, u, np.array([steps - 3]), 3, time_s)
    return u


def _solve(
    motion: Motion, t: Array, x: Array, u: Array, first: Integers, count: int, time_s: float
) -> None:
    """Set the accelerations of groups of `count` steps that begin at the steps `first`."""
    rows = [*motion.positions, *motion.velocities]
    unit = motion.unit[rows][:, None]
    fly = motion.step_map
    h = np.array([t[first + j + 1] - t[first + j] for j in range(count)])
    after = (t[first + count] - np.array([t[first + j + 1] for j in range(count)])) + 0.5 * h
    # rows: position, velocity; columns: the steps of a group
    slopes = np.stack([h * after, h])
    # the pseudo-inverse gives the smallest change of three steps, the exact one of two
    inverse = np.linalg.pinv(np.moveaxis(slopes, -1, 0))
    begun = np.ascontiguousarray(x[:, first])
    substeps = fly.choose_steps(
        begun, h.max(axis=0), _TOLERANCE, np.ascontiguousarray(u[:, first]), time_s + t[first]
    )
    goal = x[:, first + count]
    for _ in range(_ROUNDS):
        end = begun
        for j in range(count):
            p = np.ascontiguousarray(u[:, first + j])
            end = fly.propagate(end, h[j], substeps, p, time_s + t[first + j])
        miss = (goal - end)[rows]
        if (np.abs(miss) <= _MET * unit).all():
            return
        change = np.einsum("Njk,kdN->jdN", inverse, miss.reshape(2, motion.axes, -1))
        for j in range(count):
            u[:, first + j] += change[j]
    worst = float(np.max(np.abs(miss) / unit))
    raise ConvergenceError(
        f"no command held over {float(h.max()):g} s follows the path (miss {worst:.1e} of the "
        "plant's scales); take shorter steps"
    )
