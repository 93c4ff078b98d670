"""Steps under held commands with their derivatives, many at once."""

from __future__ import annotations

from math import floor
from typing import NamedTuple

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_guidance.motion import Motion

__all__ = ["HeldSteps", "command_times", "fly_held_steps"]

_TOLERANCE = 1e-11
"""Error of half a step, natural units, by step doubling: as small as the miss to which flights are
closed. A larger one would let the end of a flight depend on the number of substeps."""
_MOST = 256
"""Substeps of half a step at most: a step that needs more passes close to a singularity (the centre
of a point mass), and the search for its number would take longer than the flight."""


class HeldSteps(NamedTuple):
    """Ends of N steps, and their derivatives by start and command.

    Parameters
    ----------
    end : ndarray, shape (n, N)
        States at the ends, SI.
    by_state : ndarray, shape (2d, 2d, N)
        Derivatives of positions and velocities at the end by those at the start.
    by_command : ndarray, shape (2d, d, N)
        Derivatives by the held acceleration.
    """

    end: Array
    by_state: Array
    by_command: Array


def command_times(duration_s: float, hold_s: float) -> Array:
    """Return the times (K,) at which a held command changes, and the end.

    The last hold is between half and one and a half times as long as the others, so that none is
    too short to have an effect. There are two holds at least.
    """
    if duration_s < 1.5 * hold_s:
        return np.linspace(0.0, duration_s, 3)
    steps = floor(duration_s / hold_s + 0.5)
    return np.append(np.arange(steps) * hold_s, duration_s)


def fly_held_steps(motion: Motion, x: Array, u: Array, h: Array, t: Array) -> HeldSteps:
    r"""Fly N steps under held accelerations.

    The states are those of the step map. The derivatives follow the variational equations
    :math:`\dot\Phi = A \Phi + B` with the exact A at both ends and in the middle, integrated by the
    classical Runge-Kutta formula. Their error is of fifth order in the length of the step.

    Parameters
    ----------
    motion : Motion
        Motion of the plant.
    x : ndarray, shape (n, N)
        States at the starts, SI.
    u : ndarray, shape (d, N)
        Accelerations.
    h : ndarray, shape (N,)
        Lengths of the steps.
    t : ndarray, shape (N,)
        Times at the starts.

    Returns
    -------
    HeldSteps
        Ends and derivatives.

    Raises
    ------
    PropagationError
        If a step meets a singularity.
    """
    d, fly = motion.axes, motion.step_map
    x, u = np.ascontiguousarray(x), np.ascontiguousarray(u)
    substeps = fly.choose_steps(x, 0.5 * h, _TOLERANCE, u, t, most=_MOST)
    # two halves with as many substeps each: the middle is needed for the Runge-Kutta formula
    middle = fly.propagate(x, 0.5 * h, substeps, u, t)
    end = fly.propagate(middle, 0.5 * h, substeps, u, t + 0.5 * h)
    slopes = [
        _slopes(motion, state, time)
        for state, time in ((x, t), (middle, t + 0.5 * h), (end, t + h))
    ]
    # [Φ | derivatives by the command], at first [1 | 0]; B adds the unit matrix to the velocities'
    # rows
    table = np.zeros((2 * d, 3 * d, len(h)))
    table[:, : 2 * d] = np.eye(2 * d)[:, :, None]
    push = np.zeros_like(table)
    push[d:, 2 * d :] = np.eye(d)[:, :, None]

    def rate(a: Array, m: Array) -> Array:
        return np.asarray(np.einsum("ijN,jkN->ikN", a, m) + push)

    k1 = rate(slopes[0], table)
    k2 = rate(slopes[1], table + 0.5 * h * k1)
    k3 = rate(slopes[1], table + 0.5 * h * k2)
    k4 = rate(slopes[2], table + h * k3)
    table = table + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return HeldSteps(end, table[:, : 2 * d], table[:, 2 * d :])


def _slopes(motion: Motion, x: Array, t: Array) -> Array:
    """Return A (2d, 2d, N) of positions and velocities."""
    d = motion.axes
    _, by_r, by_v = motion.field(x, t)
    a = np.zeros((2 * d, 2 * d, x.shape[1]))
    a[:d, d:] = np.eye(d)[:, :, None]
    a[d:, :d], a[d:, d:] = by_r, by_v
    return a
