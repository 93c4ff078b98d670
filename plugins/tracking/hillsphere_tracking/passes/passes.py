"""Passes of satellites over stations: rise, culmination and set, none missed.

A pass is an interval in which the satellite stands above the station's mask. The sine of its
elevation and that sine's derivative are smooth functions of time, whose positive intervals over the
lowest point of the mask are found by `pass_search`; a mask that depends on azimuth is then followed
line by line within each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.base.geodetic import WGS84, Ellipsoid, Station
from hillsphere.interfaces import Array
from hillsphere_tracking.ground_track import EarthTrack
from hillsphere_tracking.passes.masks import BlindSector, HorizonMask
from hillsphere_tracking.passes.search import (
    Function,
    intersect_spans,
    merge_spans,
    positive_spans,
    sample_curve,
    zeros,
)
from hillsphere_tracking.sun import shadow_margin, sun_earth_fixed
from hillsphere_tracking.topocentric import apparent_elevation, geometric_elevation, rates

__all__ = [
    "Air", "Passes", "blind_spans", "eclipses", "find_passes", "peak_azimuth_rates",
    "sun_in_beam",
]  # fmt: skip

_TURN = 2.0 * np.pi
_SUN_UP_RAD = np.radians(-0.833)
"""Geometric elevation of the Sun's centre at which its upper limb appears at the horizon."""
_SOLAR_DAY_RATE = _TURN / 86400.0
_SAME_S = 1e-6
"""Times (s) nearer than this are one time: ten times the accuracy of the roots. Larger, and a short
interval between a mask's edges is lost; smaller, and rounding makes empty intervals."""


@dataclass(frozen=True)
class Air:
    """The air at a station, which bends what comes through it.

    Parameters
    ----------
    pressure_hpa, temperature_c : float
        At the station.
    """

    pressure_hpa: float = 1010.0
    temperature_c: float = 10.0


@dataclass(frozen=True)
class Passes:
    """The P passes of one satellite over one station.

    Parameters
    ----------
    rise_s, culmination_s, set_s : ndarray, shape (P,)
        Times after the start of the search; the culmination is the highest point between the other
        two.
    begun, unfinished : ndarray of bool, shape (P,)
        Whether the pass was going on at the start of the search, and at its end.
    highest_s, highest_rad : float
        When over the whole search the satellite stood highest, and how high (geometric), whether
        it rose or not.
    searched_s : float
        For how long it was looked for.
    """

    rise_s: Array
    culmination_s: Array
    set_s: Array
    begun: np.ndarray[tuple[int], np.dtype[np.bool_]]
    unfinished: np.ndarray[tuple[int], np.dtype[np.bool_]]
    highest_s: float
    highest_rad: float
    searched_s: float

    @property
    def visibility(self) -> str:
        """``"always"``, ``"never"`` or ``"passes"``."""
        if self.rise_s.size == 0:
            return "never"
        whole = self.rise_s.size == 1 and self.begun[0] and self.unfinished[0]
        return "always" if whole else "passes"


def find_passes(
    station: Station,
    track: EarthTrack,
    mask: HorizonMask | None = None,
    air: Air | None = None,
) -> Passes:
    """Find all passes of a satellite over a station.

    Parameters
    ----------
    station : Station
        Where from.
    track : EarthTrack
        The satellite over the rotating Earth; it says from when and for how long to look.
    mask : HorizonMask, optional
        What the satellite must stand above; left out: the horizontal plane.
    air : Air, optional
        Whether refraction lifts the satellite, so that the mask means apparent elevations (between
        its azimuths the lines are straight in geometric ones); left out: it does not.

    Returns
    -------
    Passes
        In order of time; times to 1e-6 s of what orbit and rotation give.
    """
    mask = HorizonMask() if mask is None else mask
    if air is not None:
        lowered = geometric_elevation(
            np.array(mask.elevation_rad), air.pressure_hpa, air.temperature_c
        )
        mask = HorizonMask(tuple(lowered.tolist()), mask.azimuth_rad)
    threshold = np.sin(mask.lowest_rad)

    def height(t_s: Array) -> tuple[Array, Array]:
        _, up, _, d_up = _direction(station, track, t_s)
        return up - threshold, d_up

    # every other time: the search looks at the middles of its steps anyway
    coarse = np.append(track.times_s[:-1:2], track.end_s)
    whole = sample_curve(height, coarse)
    spans = positive_spans(height, whole)
    if not mask.constant:
        parts = [_above_mask(station, track, mask, *span) for span in spans.T]
        spans = merge_spans(np.concatenate([np.zeros((2, 0)), *parts], axis=1))
    rise, set_ = spans
    top = int(np.argmax(whole.value))
    return Passes(
        rise_s=rise,
        culmination_s=_culminations(height, whole.t_s, whole.value, spans),
        set_s=set_,
        begun=rise == track.times_s[0],
        unfinished=set_ == track.end_s,
        highest_s=float(whole.t_s[top]),
        highest_rad=float(np.arcsin(np.clip(whole.value[top] + threshold, -1.0, 1.0))),
        searched_s=track.end_s,
    )


def peak_azimuth_rates(station: Station, track: EarthTrack, passes: Passes) -> Array:
    """Return the fastest that the azimuth turns in each pass.

    Parameters
    ----------
    station, track : Station, EarthTrack
        As `find_passes` was given them.
    passes : Passes
        What it returned.

    Returns
    -------
    ndarray, shape (P,)
        |dA/dt|, rad/s.
    """
    low, high = passes.rise_s, passes.set_s
    peak = np.zeros(low.size)
    # the peak of a pass near the zenith is a fraction of a second wide: look ever closer
    for _ in range(6):
        grid = low + np.linspace(0.0, 1.0, 41)[:, None] * (high - low)
        x = track.states(grid.ravel())
        rate = np.abs(rates(station, x)[3]).reshape(grid.shape)
        best = np.argmax(rate, axis=0)[None, :]
        peak = np.maximum(peak, np.take_along_axis(rate, best, axis=0)[0])
        low = np.take_along_axis(grid, np.maximum(best - 1, 0), axis=0)[0]
        high = np.take_along_axis(grid, np.minimum(best + 1, 40), axis=0)[0]
    return peak


def blind_spans(
    station: Station,
    track: EarthTrack,
    sector: BlindSector,
    rise_s: float,
    set_s: float,
    air: Air | None = None,
) -> Array:
    """Return when in a pass the satellite stands in a blind sector.

    Parameters
    ----------
    station, track : Station, EarthTrack
        Where from, and the satellite.
    sector : BlindSector
        Part of the sky; apparent elevations if there is air.
    rise_s, set_s : float
        Of the pass.
    air : Air, optional
        As for `find_passes`.

    Returns
    -------
    ndarray, shape (2, M)
        Beginnings and ends, s.
    """
    grid = _grid(rise_s, set_s)
    edges = [np.array([rise_s, set_s])]
    for azimuth in sector.azimuth_rad:
        across = _crossing_function(station, track, azimuth)
        edges.append(zeros(across, sample_curve(across, grid)))
    for elevation in sector.elevation_rad:
        limit = np.array([elevation])
        if air is not None:
            limit = geometric_elevation(limit, air.pressure_hpa, air.temperature_c)

        def over(t_s: Array, sine: float = float(np.sin(limit[0]))) -> tuple[Array, Array]:
            _, up, _, d_up = _direction(station, track, t_s)
            return up - sine, d_up

        edges.append(zeros(over, sample_curve(over, grid)))
    cuts = _drop_duplicates(edges)
    azimuth_rad, elevation_rad = rates(station, track.states(0.5 * (cuts[:-1] + cuts[1:])))[:2]
    if air is not None:
        elevation_rad = apparent_elevation(elevation_rad, air.pressure_hpa, air.temperature_c)
    inside = sector.contains(azimuth_rad, elevation_rad)
    return merge_spans(np.array([cuts[:-1][inside], cuts[1:][inside]]))


def sun_in_beam(
    station: Station, track: EarthTrack, half_angle_rad: float, rise_s: float, set_s: float
) -> Array:
    """Return when in a pass the Sun, above the horizon, stands within the beam that follows it.

    Parameters
    ----------
    station, track : Station, EarthTrack
        Where from, and the satellite.
    half_angle_rad : float
        Largest angle between the satellite and the Sun's centre.
    rise_s, set_s : float
        Of the pass.

    Returns
    -------
    ndarray, shape (2, M)
        Beginnings and ends, s.
    """

    def near(t_s: Array) -> tuple[Array, Array]:
        x = track.states(t_s)
        towards, d_towards = _unit(x[:3] - station.ecef_m[:, None], x[3:])
        sun, d_sun = _sun(track, t_s)
        value = np.einsum("in,in->n", towards, sun) - np.cos(half_angle_rad)
        slope = np.einsum("in,in->n", d_towards, sun) + np.einsum("in,in->n", towards, d_sun)
        return value, slope

    def risen(t_s: Array) -> tuple[Array, Array]:
        sun, d_sun = _sun(track, t_s)
        up = station.axes[2]
        return up @ sun - np.sin(_SUN_UP_RAD), up @ d_sun

    grid = _grid(rise_s, set_s)
    close = positive_spans(near, sample_curve(near, grid))
    if close.shape[1] == 0:
        return close
    return intersect_spans(close, positive_spans(risen, sample_curve(risen, grid)))


def eclipses(track: EarthTrack, ellipsoid: Ellipsoid = WGS84) -> Array:
    """Return when the satellite is in the umbra of the Earth.

    Parameters
    ----------
    track : EarthTrack
        The satellite.
    ellipsoid : Ellipsoid
        Of the Earth.

    Returns
    -------
    ndarray, shape (2, M)
        Beginnings and ends, s.
    """
    apart = 0.5

    def depth(t_s: Array) -> tuple[Array, Array]:
        t = np.concatenate([t_s, t_s - apart, t_s + apart]).clip(0.0, track.end_s)
        sun = sun_earth_fixed(track.start, t, track.orientation)
        margin = shadow_margin(track.states(t)[:3], sun, "umbra", ellipsoid)
        here, before, after = margin.reshape(3, -1)
        begin, end = t.reshape(3, -1)[1:]
        return here, (after - before) / (end - begin)

    return positive_spans(depth, sample_curve(depth, track.times_s))


def _above_mask(
    station: Station, track: EarthTrack, mask: HorizonMask, begin_s: float, end_s: float
) -> Array:
    """Return the intervals (2, M) above a mask of straight lines, within one above its lowest."""
    cuts = [np.array([begin_s, end_s])]
    grid = _grid(begin_s, end_s)
    for azimuth in mask.azimuth_rad:
        across = _crossing_function(station, track, azimuth)
        cuts.append(zeros(across, sample_curve(across, grid)))
    edges = _drop_duplicates(cuts)
    middles = 0.5 * (edges[:-1] + edges[1:])
    lines = mask.segment(rates(station, track.states(middles))[0])
    found = []
    for low, high, line in zip(edges[:-1], edges[1:], lines, strict=True):

        def over(t_s: Array, line: np.int64 = line) -> tuple[Array, Array]:
            azimuth, elevation, _, d_azimuth, d_elevation, _ = rates(station, track.states(t_s))
            height, slope = mask.on(np.full(t_s.shape, line), azimuth)
            return elevation - height, d_elevation - slope * d_azimuth

        found.append(positive_spans(over, sample_curve(over, np.linspace(low, high, 5))))
    return merge_spans(np.concatenate([np.zeros((2, 0)), *found], axis=1))


def _drop_duplicates(times_s: list[Array]) -> Array:
    """Return times in order, without those that differ by no more than roots are known to."""
    cuts = np.unique(np.concatenate(times_s))
    return np.asarray(cuts[np.concatenate([[True], np.diff(cuts) > _SAME_S])])


def _crossing_function(station: Station, track: EarthTrack, azimuth_rad: float) -> Function:
    """Return the function of time that changes sign where the satellite crosses an azimuth."""
    normal = station.axes.T @ np.array([np.cos(azimuth_rad), -np.sin(azimuth_rad), 0.0])

    def across(t_s: Array) -> tuple[Array, Array]:
        x = track.states(t_s)
        towards, d_towards = _unit(x[:3] - station.ecef_m[:, None], x[3:])
        return normal @ towards, normal @ d_towards

    return across


def _direction(
    station: Station, track: EarthTrack, t_s: Array
) -> tuple[Array, Array, Array, Array]:
    """Return unit vectors (3, N) to the satellite, sines of elevation (N,), and derivatives."""
    x = track.states(t_s)
    towards, d_towards = _unit(x[:3] - station.ecef_m[:, None], x[3:])
    up = station.axes[2]
    return towards, up @ towards, d_towards, up @ d_towards


def _unit(v: Array, d_v: Array) -> tuple[Array, Array]:
    """Return the directions (3, N) of vectors, and their derivatives."""
    size = np.linalg.norm(v, axis=0)
    unit = v / size
    return unit, (d_v - unit * np.einsum("in,in->n", unit, d_v)) / size


def _sun(track: EarthTrack, t_s: Array) -> tuple[Array, Array]:
    """Return Earth-fixed directions (3, N) to the Sun, and how the day turns them."""
    place = sun_earth_fixed(track.start, t_s, track.orientation)
    sun = place / np.linalg.norm(place, axis=0)
    return sun, _SOLAR_DAY_RATE * np.array([sun[1], -sun[0], np.zeros(t_s.size)])


def _grid(begin_s: float, end_s: float) -> Array:
    """Return times of a pass at most 20 s apart, or a hundredth of it."""
    step = max(20.0, (end_s - begin_s) / 100.0)
    return np.linspace(begin_s, end_s, max(5, int(np.ceil((end_s - begin_s) / step)) + 1))


def _culminations(height: Function, t_s: Array, value: Array, spans: Array) -> Array:
    """Return when in each span the satellite is highest: at an extremum within, or at an end."""
    at_ends = height(spans.ravel())[0].reshape(spans.shape)
    found = []
    for (begin, end), ends in zip(spans.T, at_ends.T, strict=True):
        inside = slice(*np.searchsorted(t_s, [begin, end], side="right").tolist())
        times = np.concatenate([[begin, end], t_s[inside]])
        found.append(times[np.argmax(np.concatenate([ends, value[inside]]))])
    return np.array(found)
