r"""Intervals in which satellites are above horizon masks, for all stations and satellites at once.

The sine of the elevation minus that of the mask, s(t), is first computed on a coarse grid of each
track, from one propagation that all stations share. A step of length h of the grid is left out if
s ≤ 0 throughout it. With the line of sight ρ e, the speed v and acceleration g over the rotating
Earth,

.. math::

    |\ddot e| \le \frac{g}{ρ} + \frac{2}{\sqrt 3} \frac{v^2}{ρ^2}, \quad
    s \le \max(s_k, s_{k+1}) + \frac{h^2}{8} \max |\ddot e|, \quad
    ρ \ge \tfrac12 (ρ_k + ρ_{k+1} - v h),

the first since ë is the part of g across e over ρ, minus v⊥²/ρ² e, minus 2 ρ̇ v⊥/ρ², of which
v⊥ √(v⊥² + 4 ρ̇²) ≤ 2 v²/√3 for v⊥² + ρ̇² = v²; the second the error of linear interpolation; the
third the triangle inequality from both ends. So no pass is lost, however short, of a satellite that
moves under gravity. The steps that remain form arcs, of which `search` finds the positive parts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.geodetic import Station
from hillsphere.interfaces import Array, Integers
from hillsphere.model.earth.rotation import ROTATION_RATES_RAD_S
from hillsphere_tracking.passes.masks import HorizonMask
from hillsphere_tracking.passes.search import (
    Curve,
    LaneFunction,
    merge_lanes,
    positive_spans_of_lanes,
    sample_lanes,
    zeros_of_lanes,
)
from hillsphere_tracking.passes.track_set import TrackSet
from hillsphere_tracking.topocentric import rates

__all__ = ["Sights", "Visible", "find_visible"]

_GM = 3.986004418e14
"""Gravitational parameter of the Earth (m³/s², WGS 84), for the bound of the acceleration."""
_MARGIN = 1.2
"""Factor of the bound: J2 adds 1 % to the acceleration at most, the rest covers drag, and the
speeds between the nodes, which exceed those at the nodes by 1/16 on steps of 1/8 rad."""
_SAME_S = 1e-6
"""Times (s) nearer than this are one time: ten times the accuracy of the roots. Larger, and a short
interval between a mask's edges is lost; smaller, and rounding makes empty intervals."""


class Sights:
    """Lines of sight of many lanes: a lane is a station and a satellite.

    Parameters
    ----------
    tracks : TrackSet
        The satellites.
    stations : sequence of Station
        The stations.
    """

    def __init__(self, tracks: TrackSet, stations: Sequence[Station]) -> None:
        self.tracks, self.stations = tracks, tuple(stations)
        self.places = np.array([station.ecef_m for station in stations]).T
        self.axes = np.array([station.axes for station in stations]).transpose(1, 2, 0)

    def sines(self, station: Integers, x: Array) -> tuple[Array, Array]:
        """Return sines of elevations (N,) and derivatives of states (6, N) over stations (N,)."""
        return self.components(self.axes[2][:, station], station, x)

    def components(self, unit: Array, station: Integers, x: Array) -> tuple[Array, Array]:
        """Return the components (N,) of directions along vectors (3, N), and their derivatives."""
        away = x[:3] - self.places[:, station]
        distance2 = away[0] * away[0] + away[1] * away[1] + away[2] * away[2]
        near = 1.0 / np.sqrt(distance2)
        speed = x[3:]
        # derivative of u·v/|v|: (u·v̇ − (u·v)(v·v̇)/|v|²)/|v|
        along = unit[0] * away[0] + unit[1] * away[1] + unit[2] * away[2]
        moved = unit[0] * speed[0] + unit[1] * speed[1] + unit[2] * speed[2]
        radial = away[0] * speed[0] + away[1] * speed[1] + away[2] * speed[2]
        return along * near, (moved - along * radial / distance2) * near


@dataclass(frozen=True)
class Visible:
    """The intervals in which satellites are above masks, in the order of station, track and time.

    Parameters
    ----------
    station, track : ndarray of int, shape (M,)
        Station and satellite of each interval.
    spans_s : ndarray, shape (2, M)
        Beginnings and ends.
    highest_s : ndarray, shape (M,)
        Time of the highest elevation in each interval.
    top_s, top_sine : ndarray, shape (stations, tracks)
        Time of the highest elevation of the whole search, and its sine.
    """

    station: Integers
    track: Integers
    spans_s: Array
    highest_s: Array
    top_s: Array
    top_sine: Array


def find_visible(
    stations: Sequence[Station], tracks: TrackSet, masks: Sequence[HorizonMask]
) -> Visible:
    """Find the intervals in which satellites are above the masks of stations.

    Parameters
    ----------
    stations : sequence of Station
        S stations.
    tracks : TrackSet
        T satellites.
    masks : sequence of HorizonMask
        S masks, in geometric elevations.

    Returns
    -------
    Visible
        The intervals, accurate to 1e-7 s.
    """
    sights = Sights(tracks, stations)
    lowest = np.sin([mask.lowest_rad for mask in masks])
    station, track, start = _arcs(sights, lowest)

    def heights(t_s: Array, lane: Integers) -> tuple[Array, Array]:
        at = station[lane]
        sine, slope = sights.sines(at, tracks.states(track[lane], t_s))
        return sine - lowest[at], slope

    curve = sample_lanes(heights, start)
    lane, spans = positive_spans_of_lanes(heights, curve)
    varied = np.array([not mask.constant for mask in masks])[station[lane]]
    if varied.any():
        lane, spans = _above_masks(sights, masks, station, track, lane, spans, varied)
    shape = (len(stations), len(tracks.tracks))
    pair = np.ravel_multi_index((station, track), shape)
    top = _first_largest(pair[curve.lane], curve.value)
    return Visible(
        station[lane], track[lane], spans, _highest(heights, curve, lane, spans),
        curve.t_s[top].reshape(shape), (curve.value[top].reshape(shape) + lowest[:, None]),
    )  # fmt: skip


def _arcs(sights: Sights, lowest: Array) -> tuple[Integers, Integers, Curve]:
    """Return stations and tracks (L,) of the arcs that may be above a sine (S,), and samples.

    The arc in which a satellite is highest over a station is always among them.
    """
    found: list[tuple[Integers, Integers, Integers, Array]] = []
    for k, track in enumerate(sights.tracks.tracks):
        # Every other time suffices: the search evaluates the midpoints of its steps.
        t = np.append(track.times_s[:-1:2], track.end_s)
        x = sights.tracks.states(np.full(t.size, k), t)
        up, place = sights.axes[2], sights.places
        # |r − R|² = r² − 2 r·R + R²: one matrix product for all stations
        distance = np.sqrt(
            np.sum(x[:3] ** 2, axis=0) - 2.0 * (place.T @ x[:3]) + np.sum(place**2, axis=0)[:, None]
        )
        sine = (up.T @ x[:3] - np.sum(up * place, axis=0)[:, None]) / distance - lowest[:, None]
        h = np.diff(t)
        speed = float(np.sqrt(np.max(np.sum(x[3:] ** 2, axis=0))))
        radius = np.sqrt(np.sum(x[:3] ** 2, axis=0))
        near = max(float(radius.min()) - 0.5 * speed * float(h.max()), 1.0)
        spin = ROTATION_RATES_RAD_S["teme"]
        pull = _GM / near**2 + 2.0 * spin * speed + spin**2 * float(radius.max())
        least = 0.5 * (distance[:, 1:] + distance[:, :-1] - _MARGIN * speed * h)
        with np.errstate(divide="ignore", invalid="ignore"):
            bend = pull / least + 2.0 / np.sqrt(3.0) * (speed / least) ** 2
        reach = np.where(least > 0.0, _MARGIN * h**2 / 8.0 * bend, np.inf)
        most = np.maximum(sine[:, 1:], sine[:, :-1]) + reach
        station, step = np.nonzero(most > np.minimum(sine.max(axis=1), 0.0)[:, None])
        begins = (np.diff(station, prepend=-1) != 0) | (np.diff(step, prepend=-2) != 1)
        arc = np.cumsum(begins) - 1
        # the nodes of an arc: the first of each step, and the last of the arc
        nodes = np.arange(step.size) + arc
        count = int(arc[-1]) + 1
        at, own = np.empty(step.size + count, dtype=np.int64), np.empty(step.size + count, np.int64)
        at[nodes], own[nodes] = step, arc
        ends = np.flatnonzero(np.append(begins[1:], True))
        at[nodes[ends] + 1], own[nodes[ends] + 1] = step[ends] + 1, arc[ends]
        over = station[begins]
        value, slope = sights.sines(over[own], x[:, at])
        value = value - lowest[over[own]]
        found.append((over, np.full(count, k), own, np.array([t[at], value, slope])))
    shift = np.cumsum([0, *(one[0].size for one in found[:-1])])
    station = np.concatenate([one[0] for one in found])
    track_of = np.concatenate([one[1] for one in found])
    lane = np.concatenate([one[2] + off for one, off in zip(found, shift, strict=True)])
    samples = np.concatenate([one[3] for one in found], axis=1)
    # arcs in the order of station, track and time
    order = np.lexsort((np.arange(station.size), track_of, station))
    rank = np.argsort(order)
    sorted_lanes = np.argsort(rank[lane], kind="stable")
    return (
        station[order],
        track_of[order],
        Curve(rank[lane][sorted_lanes], *samples[:, sorted_lanes]),
    )


def _above_masks(
    sights: Sights,
    masks: Sequence[HorizonMask],
    station: Integers,
    track: Integers,
    lane: Integers,
    spans: Array,
    varied: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> tuple[Integers, Array]:
    """Return the intervals above masks, within intervals (2, M) above their lowest elevations.

    Arguments are those of `find_visible`; `varied` (M,) says whose mask depends on the azimuth.
    """
    parts = [(lane[~varied], spans[:, ~varied])]
    for at in np.unique(station[lane[varied]]).tolist():
        own = np.flatnonzero(varied & (station[lane] == at))
        inside, found = _above_mask(sights, masks[at], at, track[lane[own]], spans[:, own])
        parts.append((lane[own[inside]], found))
    lanes = np.concatenate([one for one, _ in parts])
    total = np.concatenate([one for _, one in parts], axis=1)
    order = np.lexsort((total[0], lanes))
    return lanes[order], total[:, order]


def _above_mask(
    sights: Sights, mask: HorizonMask, station: int, track: Integers, spans: Array
) -> tuple[Integers, Array]:
    """Return the intervals above a mask within intervals (2, M) of satellites (M,).

    Returns
    -------
    within : ndarray of int, shape (K,)
        Given interval in which each one lies.
    spans : ndarray, shape (2, K)
        Beginnings and ends, s.
    """
    tracks = sights.tracks
    lanes, cuts = [np.repeat(np.arange(track.size), 2)], [spans.T.ravel()]
    begins, widths = spans[0], spans[1] - spans[0]
    # 20 s or a hundredth of the interval apart, whichever is longer, and at least four steps
    counts = np.clip(np.ceil(widths / 20.0), 4, 100).astype(np.int64)
    grid_lane, grid = _divide(begins, widths, counts)
    x = tracks.states(track[grid_lane], grid)
    at = np.full(grid.size, station)
    for azimuth in mask.azimuth_rad:
        # Earth-fixed normal of the vertical plane of the azimuth
        level = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])
        normal = sights.stations[station].axes.T @ level

        def across(t_s: Array, lane: Integers, normal: Array = normal) -> tuple[Array, Array]:
            unit = np.broadcast_to(normal[:, None], (3, t_s.size))
            return sights.components(
                unit, np.full(t_s.size, station), tracks.states(track[lane], t_s)
            )

        unit = np.broadcast_to(normal[:, None], (3, grid.size))
        start = Curve(grid_lane, grid, *sights.components(unit, at, x))
        crossed, when = zeros_of_lanes(across, sample_lanes(across, start))
        lanes.append(crossed)
        cuts.append(when)
    # between two crossings of a mask's azimuth the satellite is over one segment
    lane, edges = np.concatenate(lanes), np.concatenate(cuts)
    order = np.lexsort((edges, lane))
    lane, edges = lane[order], edges[order]
    apart = np.concatenate([[True], (np.diff(lane) != 0) | (np.diff(edges) > _SAME_S)])
    lane, edges = lane[apart], edges[apart]
    (piece,) = np.nonzero(lane[1:] == lane[:-1])
    low, high, within = edges[piece], edges[piece + 1], lane[piece]

    def look(t_s: Array, piece: Integers) -> tuple[Array, ...]:
        found = rates(sights.stations[station], tracks.states(track[within[piece]], t_s))
        return found[0], found[1], found[3], found[4]

    line = mask.segment(look(0.5 * (low + high), np.arange(low.size))[0])

    def over(t_s: Array, piece: Integers) -> tuple[Array, Array]:
        azimuth, elevation, d_azimuth, d_elevation = look(t_s, piece)
        height, slope = mask.on(line[piece], azimuth)
        return elevation - height, d_elevation - slope * d_azimuth

    pieces, times = _divide(low, high - low, np.full(low.size, 4))
    curve = sample_lanes(over, Curve(pieces, times, *over(times, pieces)))
    own, found = positive_spans_of_lanes(over, curve)
    return merge_lanes(within[own], found)


def _divide(begins: Array, widths: Array, counts: Integers) -> tuple[Integers, Array]:
    """Return the ends of `counts` (M,) equal steps of intervals, with the interval of each."""
    lane = np.repeat(np.arange(begins.size), counts + 1)
    firsts = np.cumsum(counts + 1) - (counts + 1)
    share = (np.arange(lane.size) - firsts[lane]) / counts[lane]
    return lane, begins[lane] + share * widths[lane]


def _first_largest(group: Integers, value: Array) -> Integers:
    """Return the index of the first largest value of each group; groups (K,) do not decrease."""
    first = np.flatnonzero(np.diff(group, prepend=-1))
    most = np.maximum.reduceat(value, first)
    (at,) = np.nonzero(value == np.repeat(most, np.diff(first, append=group.size)))
    return np.asarray(at[np.diff(group[at], prepend=-1) != 0])


def _highest(heights: LaneFunction, curve: Curve, lane: Integers, spans: Array) -> Array:
    """Return the time of the highest elevation in each interval: at an extremum or at an end."""
    if not lane.size:
        return np.zeros(0)
    # lanes one after the other on one axis
    far = 2.0 * (float(curve.t_s.max()) - float(curve.t_s.min()) + 1.0)
    line = curve.lane * far + curve.t_s
    low, high = np.searchsorted(line, lane * far + spans[0]), np.searchsorted(
        line, lane * far + spans[1], side="right"
    )  # fmt: skip
    counts = high - low
    inside = np.repeat(low - (np.cumsum(counts) - counts), counts) + np.arange(counts.sum())
    ends = np.array([heights(times, lane)[0] for times in spans])
    number = np.arange(lane.size)
    group = np.concatenate([number, number, np.repeat(number, counts)])
    order = np.argsort(group, kind="stable")
    times = np.concatenate([*spans, curve.t_s[inside]])[order]
    value = np.concatenate([*ends, curve.value[inside]])[order]
    best = times[_first_largest(group[order], value)]
    return np.asarray(np.clip(best, *spans))
