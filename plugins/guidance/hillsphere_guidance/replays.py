"""Independent replays of a planned flight, by propagators that are not used in planning."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from hillsphere.errors import PropagationError
from hillsphere.interfaces import Array, GuidedFlight
from hillsphere_guidance.motion import Motion

__all__ = ["replay_continuous", "replay_held"]

_RELATIVE = 1e-12
"""Relative tolerance of DOP853, near the least that it takes (100 roundings, 2e-14): the error of
the replay stays below the error of the plan that it measures."""
_ABSOLUTE = 1e-13
"""Absolute tolerance in units of the plant's scales, for states near zero."""
_REFINED = 4
"""Steps of the replay to one of the grid: the step map of sixth order or more then errs by less
than 1/1000 of a single step's error."""


def replay_continuous(motion: Motion, flight: GuidedFlight, start: Array, time_s: float) -> Array:
    """Fly the planned command open loop.

    Parameters
    ----------
    motion : Motion
        Motion of the plant.
    flight : GuidedFlight
        The plan.
    start : ndarray, shape (n,)
        State at the start.
    time_s : float
        Time at the start.

    Returns
    -------
    ndarray, shape (n,)
        State at the end, by SciPy's adaptive DOP853, piece by piece of the command.

    Raises
    ------
    PropagationError
        If the integration fails.
    """
    unit = motion.unit
    state = np.array(start, dtype=float)
    for begin, end in pairwise(flight.breaks_s):
        # at the end of a piece the command is already that of the next: evaluate just before it
        last = np.nextafter(end, begin)

        def rate(t: float, x: Array, last: float = float(last)) -> Array:
            u = flight.command(np.array([min(t, last)]))
            return motion.rate(x[:, None], u, np.array([time_s + t]))[:, 0]

        solution = solve_ivp(
            rate, (begin, end), state, method="DOP853", rtol=_RELATIVE, atol=_ABSOLUTE * unit
        )
        if solution.status != 0 or not np.isfinite(solution.y[:, -1]).all():
            raise PropagationError(f"the replay of a planned flight stops at {solution.t[-1]:g} s")
        state = solution.y[:, -1]
    return state


def replay_held(motion: Motion, t: Array, u: Array, start: Array, time_s: float) -> Array:
    """Fly a held command open loop.

    Parameters
    ----------
    motion : Motion
        Motion of the plant.
    t : ndarray, shape (K,)
        Times since the start.
    u : ndarray, shape (d, K - 1)
        Accelerations, held from each time to the next.
    start : ndarray, shape (n,)
        State at the start.
    time_s : float
        Time at the start.

    Returns
    -------
    ndarray, shape (n, K)
        States at these times: by Taylor series or, if the field is no expression, by the step map
        with four steps for each of the grid.
    """
    x = np.empty((len(start), len(t)))
    x[:, 0] = start
    if motion.system.external is None:
        for k, (begin, end) in enumerate(pairwise(t)):
            x[:, k + 1] = motion.series.propagate(x[:, k], end - begin, u[:, k], time_s + begin)
        return x
    fly = motion.step_map
    for k, (begin, end) in enumerate(pairwise(t)):
        x[:, k + 1] = fly.propagate(x[:, k], end - begin, _REFINED, u[:, k], time_s + begin)
    return x
