"""Step responses of linear systems, exact at their samples."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.holding import zero_order_hold_matrices

__all__ = ["step_responses"]

_SAMPLES = 400
"""Samples of a response in continuous time: a curve of a printed figure shows no corners."""
_MOST_SAMPLES = 100_000
"""Samples of a response at most: a mode slower than these is not waited for."""
_SETTLED = 0.01
"""A response has settled when it stays within 1 % of its size, a usual limit of the settling
time."""
_ROOM = 1.4
"""Length of the time axis relative to the settling time, so that the settled part is seen."""


def step_responses(
    systems: Sequence[LtiSystem], duration_s: float | None = None
) -> tuple[Array, list[Array]]:
    """Return the responses of stable systems to steps of their inputs.

    Parameters
    ----------
    systems : sequence of LtiSystem
        All in continuous time, or of one sampling period.
    duration_s : float or None
        How long; None: until all have settled within one in a hundred of their largest value.

    Returns
    -------
    times_s : ndarray, shape (K,)
        From zero on.
    responses : list of ndarray, shape (K, p, m)
        Of all outputs to a unit step of each input.
    """
    dt_s = next((s.dt_s for s in systems if s.dt_s is not None), None)
    duration = duration_s
    if duration is None:
        duration = max((_settling(system) for system in systems), default=1.0)
    step = dt_s if dt_s is not None else duration / _SAMPLES
    count = max(round(duration / step), 2) + 1
    return step * np.arange(count, dtype=float), [
        _response(system, step, count) for system in systems
    ]


def _settling(system: LtiSystem) -> float:
    """Return the settling time of a step response."""
    poles = system.poles
    if system.dt_s is not None:
        poles = np.asarray(np.log(poles[np.abs(poles) > 1e-12]) / system.dt_s)
    rates = -poles.real
    rates = rates[rates > 0.0]
    if not rates.size:
        return 10.0 * (system.dt_s or 1.0)
    # exp(−7) = 0.1 %: well below the settling limit of 1 %
    longest = 7.0 / float(rates.min())
    if system.dt_s is not None:  # a very slow mode is not waited for: each sample is one
        longest = min(longest, _MOST_SAMPLES * system.dt_s)
    # the slowest modes may hardly be seen: times from the fastest to the slowest are tried
    trial = 7.0 / float(np.median(rates))
    while trial < longest:
        step = system.dt_s or trial / _SAMPLES
        count = min(max(round(trial / step), 2) + 1, _MOST_SAMPLES)
        response = _response(system, step, count)
        final = _final(system)
        size = max(float(np.abs(response).max()), 1e-300)
        away = np.abs(response - final).max(axis=(1, 2)) > _SETTLED * size
        if not away[len(away) // 2 :].any():
            last = int(np.flatnonzero(away)[-1]) if away.any() else len(away) // 2
            return max(_ROOM * step * last, 20 * step)
        trial *= 3.0
    return longest


def _final(system: LtiSystem) -> Array:
    n = system.order
    away = (np.eye(n) if system.dt_s is not None else np.zeros((n, n))) - system.a
    return np.asarray(system.d + system.c @ np.linalg.solve(away, system.b))


def _response(system: LtiSystem, step: float, count: int) -> Array:
    a, b = system.a, system.b
    if system.dt_s is None:
        a, b = zero_order_hold_matrices(a, b, step)
    x = np.zeros((system.order, system.shape[1]))
    made = np.empty((count, *system.shape))
    for k in range(count):
        made[k] = system.c @ x + system.d
        x = a @ x + b
    return made
