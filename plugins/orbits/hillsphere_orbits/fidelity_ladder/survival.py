"""Flights without correction: how long they stay within limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import Taylor
from hillsphere.interfaces import Array
from hillsphere_orbits.fidelity_ladder.rung import Rung
from hillsphere_orbits.flow import Flow, flow_of

__all__ = ["survival"]

_PIECES = 2  # per arc: a loss is dated to the end of its part
_STEP = 1.0 / 16.0
"""Longest step over which surface and limits are looked for, natural units. The surface is then
mostly proved without halving; a cubic errs by ω⁴/384 of it, 3e-6 of an orbit with a period of 2."""


def survival(rung: Rung, x0: Array, limits_m: Array) -> tuple[Array, tuple[str, ...]]:
    """Fly from states at time zero until a limit or the surface is met.

    Parameters
    ----------
    rung : Rung
        The plant, and the times of the arcs. Limits are tried on cubics through samples of each
        half-arc and their velocities, which err by a few 1e-6 of the orbit's size at most; what
        passes one is lost at the end of that half-arc.
    x0 : ndarray, shape (n, N)
        States, SI.
    limits_m : ndarray, shape (3, N)
        Largest distances along x, y, z in the frame hill:BODY.

    Returns
    -------
    time_s : ndarray, shape (N,)
        When the flight was lost, or the last time.
    fate : tuple of str
        ``"limit"``, ``"impact"``, ``"unresolved"`` where it cannot be proved whether the surface is
        met, or empty.
    """
    flow = flow_of(rung.plant)
    unit, time_unit = flow.system.unit[:, None], flow.system.time_unit_s
    flight = _Series(flow) if flow.system.external is None else _Steps(flow)
    parts = np.arange(_PIECES) / _PIECES
    t = rung.t_s / time_unit
    # parts of arcs: losses are dated to their ends
    grid = np.append((t[:-1, None] + np.diff(t)[:, None] * parts).ravel(), t[-1])
    time = np.full(x0.shape[1], rung.t_s[-1])
    fate = [""] * x0.shape[1]
    lanes, x = np.arange(x0.shape[1]), x0 / unit
    for start, length in zip(grid[:-1], np.diff(grid), strict=True):
        if not lanes.size:
            break
        begin = x
        x, met, resolved = flight(x, float(length))
        inside = np.all(np.abs(rung.hill(x * unit)[:3]) <= limits_m[:, lanes], axis=0)
        some = np.flatnonzero(inside & np.isnan(met) & np.isfinite(x).all(axis=0))
        if some.size:
            way = flight.samples(np.ascontiguousarray(begin[:, some]), float(length))
            farthest = _farthest(
                rung.hill(way * unit[:, None]), length * time_unit / (way.shape[1] - 1)
            )
            inside[some] = np.all(farthest <= limits_m[:, lanes[some]], axis=0)
        for i, lane in enumerate(lanes):
            if np.isfinite(met[i]):
                fate[lane], time[lane] = "impact", (start + met[i]) * time_unit
            elif not resolved[i]:
                fate[lane], time[lane] = "unresolved", start * time_unit
            elif not inside[i]:
                fate[lane], time[lane] = "limit", (start + length) * time_unit
        # lost lanes leave the batch, so that later parts cost less
        stays = np.isnan(met) & resolved & inside
        lanes, x = lanes[stays], np.ascontiguousarray(x[:, stays])
    return time, tuple(fate)


def _steps(length: float) -> int:
    """Return how many steps a flight is looked at in."""
    return int(np.ceil(length / _STEP))


def _farthest(x: Array, h: float) -> Array:
    """Return the largest |x|, |y|, |z| (3, N) along samples (6, K + 1, N) at steps of h.

    On each step they follow the cubic with the values and slopes of its ends.
    """
    a, b, s, t = x[:3, :-1], x[:3, 1:], h * x[3:6, :-1], h * x[3:6, 1:]
    # d/du of a + s u + (3(b − a) − 2s − t) u² + (2(a − b) + s + t) u³
    p, q = 3.0 * (2.0 * (a - b) + s + t), 3.0 * (b - a) - 2.0 * s - t
    largest = np.max(np.abs(x[:3]), axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(q * q - p * s)
        # p u² + 2 q u + s = 0, either root in the form that does not cancel
        stable = -(q + np.copysign(root, q))
        turns = stable / p, s / stable
    for u in turns:
        # value of the cubic at its extrema
        at = a + u * (s + u * (q + u * p / 3.0))
        inside = (u > 0.0) & (u < 1.0)
        largest = np.maximum(largest, np.max(np.where(inside, np.abs(at), 0.0), axis=1))
    return np.asarray(largest)


class _Series:
    """Flights by Taylor series, independent of the step map that found their nodes."""

    def __init__(self, flow: Flow) -> None:
        events = ["impact"] if "impact" in flow.system.events else []
        self._taylor, self._sampled = Taylor(flow.system, events=events), flow.taylor

    def __call__(self, x: Array, length: float) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return states (n, N) at the end, times of impact, NaN without one, and True (N,)."""
        end = self._taylor.fly(x, length, strict=False)
        met = np.array([name is not None for name in end.ended_by], dtype=bool)
        return end.x, np.where(met, end.time, np.nan), np.ones(x.shape[1], dtype=bool)

    def samples(self, x: Array, length: float) -> Array:
        """Return states (n, K + 1, N) at equal times along a flight without impact."""
        return self._sampled.sample(x, np.linspace(0.0, length, _steps(length) + 1))


class _Steps:
    """Flights by steps of the error's choice, for gravity from arrays without Taylor series."""

    def __init__(self, flow: Flow) -> None:
        self._map = flow.adaptive
        self._impact = "impact" in flow.system.events

    def __call__(self, x: Array, length: float) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Return states (n, N) at the end, times of impact, NaN without one, and whether proved."""
        if not self._impact:
            none = np.full(x.shape[1], np.nan)
            end = self._map.propagate(x, length, 1, strict=False)
            return end, none, np.ones(x.shape[1], dtype=bool)
        end = self._map.locate("impact", x, length, _steps(length), strict=False)
        # A flight into a singularity has met the surface, or it meets none.
        return end.x, end.time, end.resolved

    def samples(self, x: Array, length: float) -> Array:
        """Return states (n, K + 1, N) at equal times along a flight without impact."""
        return self._map.trajectory(x, length, _steps(length))
