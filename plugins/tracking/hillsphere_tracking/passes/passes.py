"""Passes of satellites over stations: rise, culmination and set.

A pass is an interval in which the satellite is above the station's horizon mask. `visibility`
finds the intervals in which the sine of the elevation, a smooth function of time, exceeds the
lowest point of the mask, even grazing ones. Within each interval a mask that depends on azimuth is
then evaluated segment by segment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.base.geodetic import WGS84, Ellipsoid, Station
from hillsphere.errors import InputError
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
from hillsphere_tracking.passes.track_set import TrackSet
from hillsphere_tracking.passes.visibility import find_visible
from hillsphere_tracking.sun import shadow_margin, sun_earth_fixed
from hillsphere_tracking.topocentric import apparent_elevation, geometric_elevation, rates

__all__ = [
    "Air", "Passes", "blind_spans", "eclipses", "find_all_passes", "find_passes",
    "peak_azimuth_rates", "sun_in_beam",
]  # fmt: skip

_TURN = 2.0 * np.pi
_SUN_UP_RAD = np.radians(-0.833)
"""Geometric elevation of the Sun's centre at which its upper limb appears at the horizon."""
_SOLAR_DAY_RATE = _TURN / DAY_S
_SAME_S = 1e-6
"""Times (s) nearer than this are one time: ten times the accuracy of the roots. Larger, and a short
interval between a mask's edges is lost; smaller, and rounding makes empty intervals."""

_TIMES_AT_ONCE = 1_000_000
"""Times of tracks, times the stations, that are searched at once: the arrays of a search then take
some 100 MB, whatever the number of satellites. Fewer cost more calls."""


@dataclass(frozen=True)
class Air:
    """Air at a station, for the refraction.

    Parameters
    ----------
    pressure_hpa, temperature_c : float
        Pressure and temperature at the station.
    """

    pressure_hpa: float = 1010.0
    temperature_c: float = 10.0


@dataclass(frozen=True)
class Passes:
    """The P passes of one satellite over one station.

    Parameters
    ----------
    rise_s, culmination_s, set_s : ndarray, shape (P,)
        Times after the start of the search; the culmination is the highest point of the pass.
    begun, unfinished : ndarray of bool, shape (P,)
        Whether the pass was under way at the start of the search, and at its end.
    highest_s, highest_rad : float
        Time and value of the highest geometric elevation during the search, also if the satellite
        never rises.
    searched_s : float
        Length of the search.
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
        """Visibility of the satellite: ``"always"``, ``"never"`` or ``"passes"``."""
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
    """Find all passes of a satellite over a station; see `find_all_passes`.

    Parameters
    ----------
    station : Station
        The observing station.
    track : EarthTrack
        The satellite over the rotating Earth, with the interval of the search.
    mask : HorizonMask, optional
        Horizon mask of the station; by default the horizontal plane.
    air : Air, optional
        Air that refracts the signal.

    Returns
    -------
    Passes
        Passes in order of time.
    """
    return find_all_passes([station], [track], None if mask is None else [mask], air)[0][0]


def find_all_passes(
    stations: Sequence[Station],
    tracks: Sequence[EarthTrack],
    masks: Sequence[HorizonMask] | None = None,
    air: Air | None = None,
) -> tuple[tuple[Passes, ...], ...]:
    """Find all passes of satellites over stations, which share one propagation of each satellite.

    Parameters
    ----------
    stations : sequence of Station
        S observing stations.
    tracks : sequence of EarthTrack
        T satellites over the rotating Earth, of the same start and orientation, each with the
        interval of its search.
    masks : sequence of HorizonMask, optional
        Horizon mask of each station; by default the horizontal plane.
    air : Air, optional
        Air that refracts the signal: the masks then give apparent elevations (the interpolation
        between their azimuths remains linear in geometric elevation). By default there is no
        refraction.

    Returns
    -------
    tuple of tuple of Passes
        One tuple for each station, of the passes of each track in order of time; times are accurate
        to 1e-6 s for the given orbit and orientation.

    Raises
    ------
    InputError
        If there is no station or track, the number of masks is not that of the stations, or tracks
        differ in their start or orientation.
    """
    if not stations:
        raise InputError("a search for passes needs at least one station, got none")
    masks = [HorizonMask()] * len(stations) if masks is None else masks
    if len(masks) != len(stations):
        raise InputError(f"masks: expected {len(stations)}, one a station, got {len(masks)}")
    lowered = [_geometric(mask, air) for mask in masks]
    found: list[list[Passes]] = [[] for _ in stations]
    for part in TrackSet(tracks).parts(_TIMES_AT_ONCE // len(stations)):
        seen = find_visible(stations, part, lowered)
        shape = seen.top_s.shape
        cuts = np.searchsorted(
            np.ravel_multi_index((seen.station, seen.track), shape), np.arange(seen.top_s.size + 1)
        )
        for pair, (k, j) in enumerate(np.ndindex(shape)):
            own, track = slice(int(cuts[pair]), int(cuts[pair + 1])), part.tracks[j]
            rise, set_ = seen.spans_s[:, own]
            one = Passes(
                rise_s=rise,
                culmination_s=seen.highest_s[own],
                set_s=set_,
                begun=rise == track.times_s[0],
                unfinished=set_ == track.end_s,
                highest_s=float(seen.top_s[k, j]),
                highest_rad=float(np.arcsin(np.clip(seen.top_sine[k, j], -1.0, 1.0))),
                searched_s=track.end_s,
            )
            found[k].append(one)
    return tuple(map(tuple, found))


def _geometric(mask: HorizonMask, air: Air | None) -> HorizonMask:
    """Return a mask in geometric elevations."""
    if air is None:
        return mask
    lowered = geometric_elevation(np.array(mask.elevation_rad), air.pressure_hpa, air.temperature_c)
    return HorizonMask(tuple(lowered.tolist()), mask.azimuth_rad)


def peak_azimuth_rates(station: Station, track: EarthTrack, passes: Passes) -> Array:
    """Return the largest azimuth rate of each pass.

    Parameters
    ----------
    station, track : Station, EarthTrack
        The arguments of `find_passes`.
    passes : Passes
        The result of `find_passes`.

    Returns
    -------
    ndarray, shape (P,)
        Largest |dA/dt|, rad/s.
    """
    low, high = passes.rise_s, passes.set_s
    peak = np.zeros(low.size)
    # Near the zenith the peak lasts a fraction of a second: refine the grid around it six times,
    # each time by a factor of 20.
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
    """Return the intervals of a pass in which the satellite is in a blind sector.

    Parameters
    ----------
    station, track : Station, EarthTrack
        The observing station, and the satellite over the rotating Earth.
    sector : BlindSector
        The blind sector, in apparent elevations if `air` is given.
    rise_s, set_s : float
        Rise and set of the pass.
    air : Air, optional
        As for `find_passes`.

    Returns
    -------
    ndarray, shape (2, M)
        Beginnings and ends, s.
    """
    # Cut the pass where the satellite crosses an edge of the sector: a part is inside or outside.
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
    """Return the intervals of a pass in which the Sun is up and within the antenna's beam.

    Parameters
    ----------
    station, track : Station, EarthTrack
        The observing station, and the satellite over the rotating Earth.
    half_angle_rad : float
        Angle between satellite and centre of the Sun up to which the Sun disturbs.
    rise_s, set_s : float
        Rise and set of the pass.

    Returns
    -------
    ndarray, shape (2, M)
        Beginnings and ends, s.
    """

    def near(t_s: Array) -> tuple[Array, Array]:
        x = track.states(t_s)
        towards, d_towards = _unit(x[:3] - station.ecef_m[:, None], x[3:])
        sun, d_sun = _sun(track, t_s)
        # cosine of the separation minus cosine of the half-angle: positive in the beam
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
    """Return the intervals in which the satellite is in the umbra of the Earth.

    Parameters
    ----------
    track : EarthTrack
        The satellite over the rotating Earth.
    ellipsoid : Ellipsoid
        Reference ellipsoid of the Earth.

    Returns
    -------
    ndarray, shape (2, M)
        Beginnings and ends, s.
    """
    # The derivative of the depth is a central difference over 1 s, within the interval.
    apart = 0.5

    def depth(t_s: Array) -> tuple[Array, Array]:
        t = np.concatenate([t_s, t_s - apart, t_s + apart])
        t = t.clip(track.times_s[0], track.end_s)
        sun = sun_earth_fixed(track.start, t, track.orientation)
        margin = shadow_margin(track.states(t)[:3], sun, "umbra", ellipsoid)
        here, before, after = margin.reshape(3, -1)
        begin, end = t.reshape(3, -1)[1:]
        return here, (after - before) / (end - begin)

    return positive_spans(depth, sample_curve(depth, track.times_s))


def _drop_duplicates(times_s: list[Array]) -> Array:
    """Return sorted times, without repeated ones that differ only by the accuracy of roots."""
    cuts = np.unique(np.concatenate(times_s))
    return np.asarray(cuts[np.concatenate([[True], np.diff(cuts) > _SAME_S])])


def _crossing_function(station: Station, track: EarthTrack, azimuth_rad: float) -> Function:
    """Return a function of time that changes sign when the satellite crosses an azimuth."""
    # Earth-fixed normal of the vertical plane of the azimuth
    normal = station.axes.T @ np.array([np.cos(azimuth_rad), -np.sin(azimuth_rad), 0.0])

    def across(t_s: Array) -> tuple[Array, Array]:
        x = track.states(t_s)
        towards, d_towards = _unit(x[:3] - station.ecef_m[:, None], x[3:])
        return normal @ towards, normal @ d_towards

    return across


def _direction(
    station: Station, track: EarthTrack, t_s: Array
) -> tuple[Array, Array, Array, Array]:
    """Return unit vectors (3, N) to the satellite, sin h (N,), and their time derivatives."""
    x = track.states(t_s)
    towards, d_towards = _unit(x[:3] - station.ecef_m[:, None], x[3:])
    up = station.axes[2]
    return towards, up @ towards, d_towards, up @ d_towards


def _unit(v: Array, d_v: Array) -> tuple[Array, Array]:
    """Normalise vectors (3, N); return the unit vectors and their time derivatives."""
    # derivative of v/|v|: the part of v̇ across v, over |v|
    size = np.linalg.norm(v, axis=0)
    unit = v / size
    return unit, (d_v - unit * np.einsum("in,in->n", unit, d_v)) / size


def _sun(track: EarthTrack, t_s: Array) -> tuple[Array, Array]:
    """Return Earth-fixed unit vectors (3, N) to the Sun and their time derivatives.

    The derivative is the rotation by one turn a day; the Sun's own motion is 1/365 of it.
    """
    place = sun_earth_fixed(track.start, t_s, track.orientation)
    sun = place / np.linalg.norm(place, axis=0)
    return sun, _SOLAR_DAY_RATE * np.array([sun[1], -sun[0], np.zeros(t_s.size)])


def _grid(begin_s: float, end_s: float) -> Array:
    """Return times of a pass, 20 s or a hundredth of the pass apart, whichever is longer."""
    step = max(20.0, (end_s - begin_s) / 100.0)
    return np.linspace(begin_s, end_s, max(5, int(np.ceil((end_s - begin_s) / step)) + 1))
