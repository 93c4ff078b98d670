"""Flights without correction: how long they stay within limits."""

from __future__ import annotations

import numpy as np

from hillsphere.dynamics import Taylor
from hillsphere.interfaces import Array
from hillsphere_orbits.fidelity.rung import Rung
from hillsphere_orbits.flow import Flow, flow_of

__all__ = ["survival"]

_PIECES = 2  # per arc: between their ends a flight may pass a limit and come back


def survival(rung: Rung, x0: Array, limits_m: Array) -> tuple[Array, tuple[str, ...]]:
    """Fly from states at time zero until a limit or the surface is met.

    Parameters
    ----------
    rung : Rung
        The plant, and the times of the arcs; limits are tried at the ends of half-arcs.
    x0 : ndarray, shape (n, N)
        States, SI.
    limits_m : ndarray, shape (3, N)
        Largest distances along x, y, z in the frame hill:BODY.

    Returns
    -------
    time_s : ndarray, shape (N,)
        When the flight was lost, or the last time.
    fate : tuple of str
        ``"limit"``, ``"impact"``, or empty.
    """
    flow = flow_of(rung.plant)
    unit, time_unit = flow.system.unit[:, None], flow.system.time_unit_s
    flight = _Series(flow) if flow.system.external is None else _Steps(flow)
    parts = np.arange(_PIECES) / _PIECES
    t = rung.t_s / time_unit
    grid = np.append((t[:-1, None] + np.diff(t)[:, None] * parts).ravel(), t[-1])
    time = np.full(x0.shape[1], rung.t_s[-1])
    fate = [""] * x0.shape[1]
    lanes, x = np.arange(x0.shape[1]), x0 / unit
    for start, length in zip(grid[:-1], np.diff(grid), strict=True):
        if not lanes.size:
            break
        x, met = flight(x, float(length))
        inside = np.all(np.abs(rung.hill(x * unit)[:3]) <= limits_m[:, lanes], axis=0)
        for i, lane in enumerate(lanes):
            if np.isfinite(met[i]):
                fate[lane], time[lane] = "impact", (start + met[i]) * time_unit
            elif not inside[i]:
                fate[lane], time[lane] = "limit", (start + length) * time_unit
        stays = np.isnan(met) & inside
        lanes, x = lanes[stays], np.ascontiguousarray(x[:, stays])
    return time, tuple(fate)


class _Series:
    """Flights by Taylor series, independent of the step map that found their nodes."""

    def __init__(self, flow: Flow) -> None:
        events = ["impact"] if "impact" in flow.system.events else []
        self._taylor = Taylor(flow.system, events=events)

    def __call__(self, x: Array, length: float) -> tuple[Array, Array]:
        """Return states (n, N) at the end and times of impact (N,), NaN without one."""
        end = self._taylor.fly(x, length, strict=False)
        met = np.array([name is not None for name in end.ended_by], dtype=bool)
        return end.x, np.where(met, end.time, np.nan)


class _Steps:
    """Flights by steps of the error's choice, for gravity from arrays without Taylor series."""

    def __init__(self, flow: Flow) -> None:
        self._map = flow.adaptive
        impact = flow.system.events.get("impact")
        self._impact = None if impact is None else flow.system.function(impact)

    def __call__(self, x: Array, length: float) -> tuple[Array, Array]:
        """Return states (n, N) at the end and times of impact (N,), the end's or NaN."""
        end = self._map.propagate(x, length, 1, strict=False)
        if self._impact is None:
            return end, np.full(x.shape[1], np.nan)
        return end, np.where(self._impact(end)[0] < 0.0, length, np.nan)
