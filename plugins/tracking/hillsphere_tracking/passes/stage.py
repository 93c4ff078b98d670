"""The stage ``passes``: passes of satellites over ground stations, and their disturbances."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.base.geodetic import Ellipsoid, Station
from hillsphere.base.orientation import EarthOrientationWarning, doubts
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context
from hillsphere.model.earth.planet import Planet, StationedPlanet
from hillsphere.model.earth.specs import PlanetSpec
from hillsphere.presentation import Presentation
from hillsphere.time import Epoch
from hillsphere_tracking.ground_track import EarthTrack, ground_points
from hillsphere_tracking.orbits import Orbit
from hillsphere_tracking.passes.flights import PlantFlights
from hillsphere_tracking.passes.masks import BlindSector, HorizonMask
from hillsphere_tracking.passes.passes import (
    Air,
    Passes,
    blind_spans,
    eclipses,
    find_all_passes,
    peak_azimuth_rates,
    sun_in_beam,
)
from hillsphere_tracking.passes.presentation import present_passes
from hillsphere_tracking.passes.products import SUN_IN_BEAM, PassList
from hillsphere_tracking.passes.search import intersect_spans
from hillsphere_tracking.passes.sources import (
    blind_sectors_of,
    covering,
    element_warnings,
    mask_of,
    orbits_from,
    station_of,
)
from hillsphere_tracking.passes.specs import PassesSpec
from hillsphere_tracking.sun import sun_earth_fixed
from hillsphere_tracking.topocentric import angles, apparent_elevation, rates

__all__ = ["PassesStage"]

_SAMPLES = 121
"""Samples along a pass for plots and for the spline of the stage ``pointing``: a hundredth of a low
revolution is then eight samples. Products grow in proportion to it."""
_FRESH_DAYS = 30.0
"""Days from its epoch after which a plant gives a warning: a month of precession turns the Earth's
axis by 4″, and the Sun by 30°."""
_GROUND_S = DAY_S
"""Length (s) of the ground tracks on the map: a day shows all longitudes, more days cover the
map."""
_THICK_AIR_M = 180e3
"""Height (m) below which models of the upper atmosphere are extrapolated, and a fall by them is too
slow."""


@dataclass(frozen=True)
class _Site:
    """A station with its mask, blind sectors, beam and keyhole."""

    station: Station
    mask: HorizonMask
    sectors: tuple[BlindSector, ...]
    beam_rad: float | None
    keyhole_rad: float | None


class PassesStage:
    """Passes of satellites over ground stations.

    Parameters
    ----------
    spec : PassesSpec
        Spec of the stage; files of elements are read.

    Raises
    ------
    InputError
        If a satellite, station or date cannot be used.
    """

    def __init__(self, spec: PassesSpec) -> None:
        self.spec = spec
        body = Planet(PlanetSpec()) if spec.body is None else spec.body.get()
        if not isinstance(body, StationedPlanet):
            raise InputError(
                f"body: passes need a body of type 'planet', got {type(body).__name__}; leave it "
                "out for the Earth"
            )
        self.ellipsoid, self.orientation = body.ellipsoid, body.orientation
        self.flights = None if spec.plant is None else PlantFlights(spec.plant.get())
        self.orbits: tuple[Orbit, ...] = orbits_from(spec.satellites, self.orientation)
        self.sites = tuple(
            _Site(station_of(s, self.ellipsoid), mask_of(s), blind_sectors_of(s),
                  s.beam_half_angle_rad, s.keyhole_elevation_rad)
            for s in spec.stations
        )  # fmt: skip
        names = [site.station.name for site in self.sites]
        if len(set(names)) < len(names):
            raise InputError(f"stations: a name is listed twice in {', '.join(names)}")
        try:
            self.start = Epoch.parse(spec.start, "UTC") if spec.start else self.orbits[0].epoch
        except InputError as error:
            raise InputError(f"start: {error}") from error
        if self.flights is None:
            self.orbits = covering(self.orbits, self.start, spec.duration_s)
        self.air = Air(spec.pressure_hpa, spec.temperature_c) if spec.refraction else None

    def run(self, ctx: Context) -> PassList:
        """Find the passes of every satellite over every station.

        Parameters
        ----------
        ctx : Context
            Progress.

        Returns
        -------
        PassList
            Passes, with topocentric coordinates along each.

        Raises
        ------
        PropagationError
            If a satellite has decayed before the start.
        """
        with warnings.catch_warnings():
            # the verdict of the stage contains this warning
            warnings.simplefilter("ignore", EarthOrientationWarning)
            return self._find_passes(ctx)

    def present(self, product: PassList) -> Presentation:
        """Show the passes as tables, sky plots and a map."""
        return present_passes(product, self.start, self.spec.label)

    def _find_passes(self, ctx: Context) -> PassList:
        tracks = [
            EarthTrack(self._fly(orbit), self.start, self.spec.duration_s, self.orientation)
            for orbit in self.orbits
        ]
        found = find_all_passes(
            [site.station for site in self.sites], tracks, [site.mask for site in self.sites],
            self.air,
        )  # fmt: skip
        advance = ctx.track("passes", len(self.orbits))
        shadows: list[Array] = []
        columns: list[dict[str, Array]] = []
        spans: list[tuple[int, int, float, str, float, float]] = []
        for n, track in enumerate(tracks):
            shadow = eclipses(track, self.ellipsoid)
            for s, site in enumerate(self.sites):
                columns.append(self._columns(s, n, site, track, found[s][n], shadow))
                spans += self._spans(s, n, site, track, found[s][n])
            shadows.append(shadow)
            advance(1)
        merged = {key: np.concatenate([one[key] for one in columns], axis=-1) for key in columns[0]}
        order = np.lexsort((merged["satellite"], merged["rise_s"], merged["station"]))
        merged = {key: value[..., order] for key, value in merged.items()}
        number = {
            (int(s), int(n), float(rise)): k
            for k, (s, n, rise) in enumerate(
                zip(merged["station"], merged["satellite"], merged["rise_s"], strict=True)
            )
        }
        spans.sort(key=lambda span: (number[span[:3]], span[4]))
        ground_s, ground = _ground(tracks, self.ellipsoid)
        shape = (len(self.sites), len(self.orbits))
        each = [one for row in found for one in row]
        return PassList(
            stations=tuple(site.station.name for site in self.sites),
            satellites=tuple(orbit.name for orbit in self.orbits),
            start=self.start.isot(np.zeros(1), 6)[0],
            refracted=self.air is not None,
            place_rad=np.array(
                [[q.station.latitude_rad, q.station.longitude_rad] for q in self.sites]
            ).T,
            mask_rad=np.array([q.mask.at(np.radians(np.arange(361.0))) for q in self.sites]).T,
            searched_s=np.array([track.end_s for track in tracks]),
            end_reasons=tuple(track.end_reason for track in tracks),
            visibility=np.array([one.visibility for one in each]).reshape(shape),
            highest_s=np.array([one.highest_s for one in each]).reshape(shape),
            highest_rad=self._to_apparent(np.array([one.highest_rad for one in each])).reshape(
                shape
            ),
            **merged,
            span_pass=np.array([number[span[:3]] for span in spans], dtype=np.int64),
            span_reason=np.array([span[3] for span in spans], dtype=np.str_),
            span_s=np.array([span[4:] for span in spans], dtype=float).reshape(-1, 2).T,
            eclipse_satellite=np.repeat(np.arange(len(tracks)), [q.shape[1] for q in shadows]),
            eclipse_s=np.concatenate(shadows, axis=1),
            ground_s=ground_s,
            ground=ground,
            warnings=self._warnings(tracks),
        )

    def _fly(self, orbit: Orbit) -> Orbit:
        """Return the orbit of a satellite: by the plant if there is one, else by its elements."""
        if self.flights is None:
            return orbit
        return self.flights.fly(orbit, self.start, self.spec.duration_s)

    def _columns(
        self, s: int, n: int, site: _Site, track: EarthTrack, passes: Passes, shadow: Array
    ) -> dict[str, Array]:
        """Return the product's fields for the passes of one satellite over one station."""
        station, count = site.station, passes.rise_s.size
        share = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
        t_s = passes.rise_s + share * (passes.set_s - passes.rise_s)
        azimuth, elevation, distance, _, _, range_rate = (
            q.reshape(t_s.shape) for q in rates(station, track.states(t_s.ravel()))
        )
        top = track.states(passes.culmination_s)
        highest_azimuth, highest, _ = angles(station, top[:3])
        highest = self._to_apparent(highest)
        # The Sun's parallax, 9″, is neglected: the station is at the Earth's centre for it.
        sun = sun_earth_fixed(self.start, passes.culmination_s, self.orientation)
        sun_azimuth, sun_elevation, _ = angles(station, sun)
        nodes = track.node_times()
        dark = [
            float(np.sum(np.diff(intersect_spans(np.array([[rise], [set_]]), shadow), axis=0)))
            for rise, set_ in zip(passes.rise_s, passes.set_s, strict=True)
        ]
        return {
            "station": np.full(count, s),
            "satellite": np.full(count, n),
            "revolution": 1 + np.searchsorted(nodes, passes.culmination_s),
            "ascending": top[5] > 0.0,
            "rise_s": passes.rise_s,
            "culmination_s": passes.culmination_s,
            "set_s": passes.set_s,
            "begun": passes.begun,
            "unfinished": passes.unfinished,
            "highest_azimuth_rad": highest_azimuth,
            "elevation_max_rad": highest,
            "peak_azimuth_rate_rad_s": peak_azimuth_rates(station, track, passes),
            "keyhole": highest >= (site.keyhole_rad or np.inf),
            "sunlit_part": 1.0 - np.array(dark) / (passes.set_s - passes.rise_s),
            "t_s": t_s,
            "azimuth_rad": azimuth,
            "elevation_rad": self._to_apparent(elevation),
            "range_m": distance,
            "range_rate_m_s": range_rate,
            "sun_rad": np.array([sun_azimuth, self._to_apparent(sun_elevation)]),
        }

    def _spans(
        self, s: int, n: int, site: _Site, track: EarthTrack, passes: Passes
    ) -> list[tuple[int, int, float, str, float, float]]:
        """Return the disturbances: station, satellite, rise, reason, beginning and end of each."""
        spans = []
        for rise, set_ in zip(passes.rise_s.tolist(), passes.set_s.tolist(), strict=True):
            disturbed = [
                (sector.reason, blind_spans(site.station, track, sector, rise, set_, self.air))
                for sector in site.sectors
            ]
            if site.beam_rad is not None:
                close = sun_in_beam(site.station, track, site.beam_rad, rise, set_)
                disturbed.append((SUN_IN_BEAM, close))
            spans += [
                (s, n, rise, reason, float(begin), float(end))
                for reason, intervals in disturbed
                for begin, end in intervals.T
            ]
        return spans

    def _to_apparent(self, elevation_rad: Array) -> Array:
        if self.air is None:
            return elevation_rad
        return apparent_elevation(elevation_rad, self.air.pressure_hpa, self.air.temperature_c)

    def _warnings(self, tracks: list[EarthTrack]) -> tuple[str, ...]:
        sentences = element_warnings(
            self.orbits, self.start, self.spec.duration_s, self.spec.oldest_elements_s
        )
        span_s = [0.0, self.spec.duration_s]
        if self.flights is not None:
            since = self.flights.epoch.seconds_since(self.start)
            span_s.append(since)
            sentences += self._flight_warnings(since, tracks)
        sentences += doubts(self.orientation, self.start, np.array(span_s))
        return tuple(sentences)

    def _flight_warnings(self, plant_epoch_s: float, tracks: list[EarthTrack]) -> list[str]:
        """Return warnings about flights by the plant, whose epoch is `plant_epoch_s` after start.

        Below 180 km the plant extrapolates the density of the upper atmosphere, which is then too
        low.
        """
        sentences = []
        away = max(-plant_epoch_s, plant_epoch_s - self.spec.duration_s) / DAY_S
        if away > _FRESH_DAYS:
            sentences.append(
                f"The epoch of the plant is {away:.0f} days away from the search. Quantities that "
                "the plant holds constant, such as the Earth's axis, have changed; give it a "
                "nearer epoch."
            )
        heights = [max(_lowest(track, self.ellipsoid), 0.0) for track in tracks]
        sentences += [
            f"{track.orbit.name} comes down to {height / 1e3:.0f} km. Below "
            f"{_THICK_AIR_M / 1e3:.0f} km the drag of the atmosphere model is too small: the time "
            "of its reentry may be wrong by hours."
            for track, height in zip(tracks, heights, strict=True)
            if height < _THICK_AIR_M
        ]
        return sentences


def _lowest(track: EarthTrack, ellipsoid: Ellipsoid) -> float:
    """Return the least height above the ellipsoid, m."""
    return float(ground_points(track.states(track.times_s)[:3], ellipsoid)[2].min())


def _ground(tracks: list[EarthTrack], ellipsoid: Ellipsoid) -> tuple[Array, Array]:
    """Return times (G, N) and ground points (3, G, N) of one day at most; NaN after the ends."""
    times = [track.times_s[track.times_s <= _GROUND_S] for track in tracks]
    most = max(t.size for t in times)
    ground_s = np.full((most, len(tracks)), np.nan)
    ground = np.full((3, most, len(tracks)), np.nan)
    for n, (t, track) in enumerate(zip(times, tracks, strict=True)):
        ground_s[: t.size, n] = t
        ground[:, : t.size, n] = ground_points(track.states(t)[:3], ellipsoid)
    return ground_s, ground
