"""Secondary bifurcations and windows of stability along families in space.

Both are read off the return map's index between samples: where M = N², c = ±2 both are λ = 1, and
c = 0 is λ = −1, which the index of M touches without passing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from hillsphere.dynamics import bracketed_roots
from hillsphere.interfaces import Array
from hillsphere_orbits.spatial_qso_families.samples import Families, Samples

__all__ = ["Event", "bifurcations", "windows"]

_WIDTH = 1e-7  # of a root's place
_ROOT_STEPS = 8
"""Most steps of the secant method for a root's place; from the spline's root it needs two or
three."""
_SOUGHT = 1e-9  # residual of the orbits of bifurcations
_TURN = 0.05  # distance of a fold from where the integral turns: both are found by splines


@dataclass(frozen=True)
class Event:
    """A secondary bifurcation.

    Parameters
    ----------
    family : int
        Number of the family.
    u : float
        Position on its branch.
    kind : str
        ``"fold"`` (λ = 1 and the integral turns), ``"branching"`` (λ = 1 and it does not: another
        family, of less symmetry, begins), ``"doubling"`` (λ = −1) or ``"krein"`` (two pairs meet).
    changes : bool
        Whether stability may change there. λ = −1 of an orbit with two mirrors is passed without.
    """

    family: int
    u: float
    kind: str
    changes: bool


def bifurcations(
    families: Families, samples: Samples, integral: Array
) -> tuple[list[Event], Samples]:
    """Locate the secondary bifurcations between samples.

    Parameters
    ----------
    families : Families
        The families.
    samples : Samples
        From `sample_families`.
    integral : ndarray, shape (K,)
        Integral of motion of the samples: a family turns back in it at a fold.

    Returns
    -------
    events : list of Event
        Ordered by family and position.
    at : Samples
        The orbits there, in the same order.
    """
    crossings = sorted(
        (crossing for f in np.unique(samples.family) for crossing in _crossings(samples, int(f))),
        key=lambda crossing: (crossing.family, crossing.u),
    )
    family = np.array([crossing.family for crossing in crossings], dtype=np.intp)
    if not crossings:
        none = samples.members.of(family)
        return [], families.samples(family, np.empty(0), none)
    u, low, high, slope = np.array([(c.u, c.low, c.high, c.slope) for c in crossings]).T
    at = families.at(samples, family, u, _SOUGHT)
    before, todo = u.copy(), np.arange(u.size)
    off = last = np.array([_beyond(at, k, c) for k, c in enumerate(crossings)])
    for _ in range(_ROOT_STEPS):
        # the spline's slope first, the secant's as soon as there is one
        moved = (u[todo] != before[todo]) & (off[todo] != last[todo])
        own = todo[moved]
        slope[own] = (off[own] - last[own]) / (u[own] - before[own])
        # secant step of each root; members are corrected anew at every place
        step = np.where(np.isfinite(off[todo]), off[todo] / slope[todo], 0.0)
        todo, step = todo[np.abs(step) > _WIDTH], step[np.abs(step) > _WIDTH]
        if not todo.size:
            break
        before, last = u.copy(), off.copy()
        u[todo] = np.clip(u[todo] - step, low[todo], high[todo])
        better = families.at(samples, family[todo], u[todo], _SOUGHT)
        off = off.copy()
        off[todo] = [_beyond(better, i, crossings[k]) for i, k in enumerate(todo)]
        at = families.samples(family, u, at.members.with_lanes(todo, better.members))
    turns = {int(f): _turns(samples, integral, int(f)) for f in np.unique(family)}
    events = []
    for crossing, place, power in zip(crossings, u, at.maps.power, strict=True):
        kind = _kind(crossing.name, crossing.edge, int(power))
        if kind == "tangent":
            near = np.abs(turns[crossing.family] - place) < _TURN
            kind = "fold" if np.any(near) else "branching"
        changes = not (power == 2 and kind == "doubling")
        events.append(Event(crossing.family, float(place), kind, changes))
    return events, at


@dataclass(frozen=True)
class _Crossing:
    """A crossing of a value by the spline of a smooth function between two samples."""

    family: int
    name: str
    edge: float
    low: float
    high: float
    u: float
    slope: float


def _crossings(samples: Samples, f: int) -> list[_Crossing]:
    own = np.flatnonzero(samples.family == f)
    rows: list[_Crossing] = []
    for name, values, edges in samples.rows(own):
        known = np.flatnonzero(np.isfinite(values))
        if known.size < 2:
            continue
        u, seen = samples.u[own][known], np.arcsinh(values[known])
        curve = CubicSpline(u, seen) if known.size > 3 else None
        for edge in edges:
            beyond = seen - np.arcsinh(edge)
            for i in np.flatnonzero((beyond[1:] > 0.0) != (beyond[:-1] > 0.0)):
                if known[i + 1] != known[i] + 1:
                    continue  # between them the function was not known
                low, high = u[i], u[i + 1]
                slope = (beyond[i + 1] - beyond[i]) / (high - low)
                place = low - beyond[i] / slope
                if curve is not None:
                    place = _root(curve, float(np.arcsinh(edge)), low, high)
                    steep = float(curve(place, 1))
                    slope = steep if steep * slope > 0.0 else slope
                rows.append(_Crossing(f, name, edge, low, high, float(place), float(slope)))
    return rows


def _root(curve: CubicSpline, value: float, low: float, high: float) -> float:
    a, b = np.array([low]), np.array([high])

    def beyond(u: Array) -> Array:
        return np.asarray(curve(u) - value)

    return float(bracketed_roots(beyond, a, b, beyond(a), beyond(b), np.array([1e-12]))[0])


def _beyond(at: Samples, k: int, crossing: _Crossing) -> float:
    """Return how far orbit k is beyond the edge, in the measure of the spline."""
    values = {name: row for name, row, _ in at.rows(np.array([k]))}
    if crossing.name not in values:
        return float("nan")
    return float(np.arcsinh(values[crossing.name][0]) - np.arcsinh(crossing.edge))


def _turns(samples: Samples, integral: Array, f: int) -> Array:
    """Return the positions at which the integral turns along a family."""
    own = samples.family == f
    if np.count_nonzero(own) < 4:
        return np.empty(0)
    roots = CubicSpline(samples.u[own], integral[own]).derivative().roots(extrapolate=False)
    return np.asarray(roots[np.isfinite(roots)])


def _kind(name: str, edge: float, power: int) -> str:
    if name == "krein":
        return "krein"
    value = round(edge) if name == "index" else int(name)
    if power == 2:
        return {2: "tangent", -2: "branching", 0: "doubling"}[value]
    return "tangent" if value == 2 else "doubling"


def windows(samples: Samples, events: Sequence[Event]) -> list[tuple[int, int, int]]:
    """Return (family, begin, end) of every window of stability, in the order of the families.

    Parameters
    ----------
    samples : Samples
        From `sample_families`, K of them.
    events : list of Event
        From `bifurcations`.

    Returns
    -------
    list of (int, int, int)
        The edges are numbers of samples (the ends of a family), or K plus that of an event.
    """
    rows: list[tuple[int, int, int]] = []
    for f in np.unique(samples.family):
        own = np.flatnonzero(samples.family == f)
        u, stable = samples.u[own], samples.maps.stable[own]
        cuts = [k for k, e in enumerate(events) if e.family == f and e.changes]
        cuts.sort(key=lambda k: events[k].u)
        places = [u[0], *(events[k].u for k in cuts), u[-1]]
        edges = [int(own[0]), *(samples.u.size + k for k in cuts), int(own[-1])]
        before = False
        for k, (begin, end) in enumerate(pairwise(places)):
            inside = (u > begin + _WIDTH) & (u < end - _WIDTH)
            # without an orbit in between, what was so before the edge is not so behind it
            within = bool(np.mean(stable[inside]) > 0.5) if np.any(inside) else not before
            if within and before:
                # an index that touches its edge divides no window
                rows[-1] = (int(f), rows[-1][1], edges[k + 1])
            elif within:
                rows.append((int(f), edges[k], edges[k + 1]))
            before = within
    return rows
