"""True passes: the satellite's flight, and the true angles at a station."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.orientation import EarthOrientation, EarthOrientationWarning
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array, Integers, Plant, StationSensor
from hillsphere.model.earth.rotation import to_earth_fixed, to_inertial
from hillsphere_tracking.assisted_tracking.sight import Sight, Visit, shift_for
from hillsphere_tracking.assisted_tracking.specs import AssistedTrackingSpec, TrackedPassSpec
from hillsphere_tracking.assisted_tracking.turned_earth import TurnedEarth
from hillsphere_tracking.ground_track import EarthTrack
from hillsphere_tracking.mean_elements import EARTH_FIELD
from hillsphere_tracking.orbits import Orbit
from hillsphere_tracking.passes.flights import PlantFlights

__all__ = ["PassTruth", "fly_passes"]

_ANGLE = "rotation_angle"
_ANGLES = ("azimuth", "elevation")
_MOST_SAMPLES = 20_000
"""Samples of a pass at most: five and a half hours at one a second. Each costs an update of every
tracker in every case."""


@dataclass(frozen=True, eq=False)
class PassTruth:
    """One true pass, sampled at the times of the measurements.

    Parameters
    ----------
    name : str
        Name of the pass.
    sensor : StationSensor
        The antenna.
    orientation : EarthOrientation
        Orientation of the turned Earth.
    shift_rad : float
        Angle by which the Earth is turned eastwards.
    plain, tracked : Visit
        The pass about the Earth before it is turned (None if the satellite does not rise in that
        revolution), and the tracked pass.
    direction : str
        ``"ascending"`` or ``"descending"``, at the highest elevation.
    t_s : ndarray, shape (K,)
        Times of the measurements after the orbit's epoch.
    x : ndarray, shape (6, K)
        States in the orbit's frame.
    scene : dict
        Quantities of the environment for the sensor.
    start_teme : ndarray, shape (6,)
        State at the acquisition in the frame ``teme``.
    angles_rad, sigma_rad : ndarray, shape (2, K)
        True azimuth and elevation; standard deviation of the antenna's noise.
    begins : ndarray of int, shape (L,)
        First sample of each outage.
    """

    name: str
    sensor: StationSensor
    orientation: EarthOrientation
    shift_rad: float
    plain: Visit | None
    tracked: Visit
    direction: str
    t_s: Array
    x: Array
    scene: dict[str, Array]
    start_teme: Array
    angles_rad: Array
    sigma_rad: Array
    begins: Integers


class _Flights:
    """Flights of the satellite about an Earth that is turned by an angle."""

    def __init__(self, orbit: Orbit, plant: Plant | None) -> None:
        self._orbit = orbit
        self._by = None if plant is None else PlantFlights(plant)
        self._angles = _angles(plant) if plant is not None else []

    @property
    def feels_turn(self) -> bool:
        """Whether the flight depends on the angle of the Earth."""
        return self._by is not None

    def fly(self, duration_s: float, shift_rad: float) -> Orbit:
        """Return the orbit from the epoch of the elements, about an Earth turned by `shift_rad`."""
        if self._by is None:
            return self._orbit
        angle = None
        if shift_rad != 0.0:
            angle = self._angles[0] + shift_rad
        return self._by.fly(self._orbit, self._orbit.epoch, duration_s, rotation_angle_rad=angle)


def check_passes(passes: Sequence[TrackedPassSpec], plant: Plant | None) -> None:
    """Refuse passes whose sensor or plant is not suitable.

    Raises
    ------
    InputError
        If a sensor is not at a ground station, or an elevation is requested and the plant has no
        rotation angle of the Earth.
    """
    for p in passes:
        of = f"passes: {p.name}: "
        sensor = p.sensor.get()
        channels = isinstance(sensor, StationSensor) and tuple(c.name for c in sensor.channels)
        if channels != _ANGLES:
            raise InputError(
                f"{of}its sensor must be one at a ground station that measures azimuth and "
                f"elevation (type 'antenna'), got a {type(sensor).__name__}"
            )
        if p.elevation_max_rad is not None and plant is not None and not _angles(plant):
            raise InputError(
                f"{of}the plant has no parameter {_ANGLE!r}: the Earth cannot be turned to reach "
                "an elevation; leave elevation_max out, or name an earth_orbit"
            )


def _angles(plant: Plant) -> list[float]:
    """Return the plant's rotation angle of the Earth as a list, empty if it has none."""
    return [q.value for q in plant.parameters() if q.name == _ANGLE]


def fly_passes(
    spec: AssistedTrackingSpec,
    orbit: Orbit,
    plant: Plant | None,
    orientation: EarthOrientation,
    advance: Callable[[int], None],
) -> tuple[PassTruth, ...]:
    """Fly the satellite and find its passes.

    Parameters
    ----------
    spec : AssistedTrackingSpec
        Spec with the passes and the period of the measurements.
    orbit : Orbit
        Orbit of the elements.
    plant : Plant or None
        Plant that flies the satellite; None for the orbit itself.
    orientation : EarthOrientation
        Orientation of the Earth.
    advance : callable
        Called with 1 after each pass.

    Returns
    -------
    tuple of PassTruth
        Passes in the order of the Spec.

    Raises
    ------
    InputError
        If a pass does not exist, does not reach its elevation, or ends before an outage.
    PropagationError
        If the satellite reaches the ground before a pass.
    """
    flights, passes = _Flights(orbit, plant), []
    with warnings.catch_warnings():
        # the verdict of the stage contains this warning
        warnings.simplefilter("ignore", EarthOrientationWarning)
        most = max(p.revolution for p in spec.passes)
        # period from the vis-viva equation; flights last beyond the last revolution's passes
        x = orbit.states(np.zeros(1))[:, 0]
        a = 1.0 / (2.0 / np.linalg.norm(x[:3]) - float(x[3:] @ x[3:]) / EARTH_FIELD.gm_m3_s2)
        if not (np.isfinite(a) and a > 0.0):
            raise InputError(f"satellite {orbit.name!r}: its orbit at the epoch is not an ellipse")
        revolution = 2.0 * np.pi * np.sqrt(a**3 / EARTH_FIELD.gm_m3_s2)
        duration = float((most + 2.2) * revolution)
        track = EarthTrack(flights.fly(duration, 0.0), orbit.epoch, duration, orientation)
        edges = np.concatenate([[0.0], track.node_times()])
        if edges.size <= most:
            raise PropagationError(
                f"satellite {orbit.name!r}: its flight has no revolution {most}"
                + (f": it {track.end_reason}" if track.end_reason else "")
            )
        for p in spec.passes:
            try:
                passes.append(_truth(p, spec.period_s, flights, track, edges, float(revolution)))
            except InputError as error:
                raise InputError(f"passes: {p.name}: {error}") from error
            advance(1)
    return tuple(passes)


def _truth(
    p: TrackedPassSpec,
    period_s: float,
    flights: _Flights,
    track: EarthTrack,
    edges: Array,
    revolution_s: float,
) -> PassTruth:
    sensor: StationSensor = p.sensor.get()
    begin, end = float(edges[p.revolution - 1]), float(edges[p.revolution])
    ends = (max(begin - revolution_s, 0.0), min(end + revolution_s, track.end_s))

    def sight(shift: float) -> Sight:
        orbit = flights.fly(ends[1], shift)
        return Sight(sensor, orbit, track.orientation, begin, end)

    plain = Sight(sensor, track.orbit, track.orientation, begin, end)
    visited = plain.visit(0.0, period_s, ends)
    shift, sight_turned, tracked = 0.0, plain, visited
    if p.elevation_max_rad is not None:
        flown = sight if flights.feels_turn else None
        shift, sight_turned = shift_for(p.elevation_max_rad, plain, flown, p.turn)
        tracked = sight_turned.visit(shift, period_s, ends)
    if tracked is None:
        raise InputError(
            f"in revolution {p.revolution} the satellite does not rise above the mask of "
            f"{sensor.station.name!r}; name another revolution, or an elevation_max"
        )
    return _sample_pass(p, sensor, period_s, sight_turned, track, shift, visited, tracked)


def _sample_pass(
    p: TrackedPassSpec,
    sensor: StationSensor,
    period_s: float,
    sight: Sight,
    track: EarthTrack,
    shift: float,
    plain: Visit | None,
    tracked: Visit,
) -> PassTruth:
    count = round((tracked.last_s - tracked.first_s) / period_s) + 1
    if count > _MOST_SAMPLES:
        raise InputError(f"it lasts {count} periods, at most {_MOST_SAMPLES}: give a longer period")
    t: Array = tracked.first_s + np.arange(count, dtype=float) * period_s
    since = t - t[0]
    begins = np.searchsorted(since, np.array(p.outages_s) - 1e-9 * period_s)
    if begins[-1] >= count:
        raise InputError(
            f"the signal is lost {p.outages_s[-1]:.6g} s after the acquisition, but the satellite "
            f"sets after {since[-1]:.6g} s; give an earlier outage"
        )
    orbit, earth = sight.orbit, TurnedEarth(track.orientation, shift)
    x = orbit.states(t)
    scene = {"earth_fixed": sight.turns(t, shift)}
    start = x[:, :1]
    if orbit.frame != "teme":
        fixed = to_earth_fixed(orbit.frame, start, orbit.epoch, t[:1], earth)
        start = to_inertial("teme", fixed, orbit.epoch, t[:1], earth)
    top = np.array([tracked.highest_s])
    over = to_earth_fixed(orbit.frame, orbit.states(top), orbit.epoch, top, earth)
    return PassTruth(
        p.name, sensor, earth, shift, plain, tracked,
        "ascending" if over[5, 0] > 0.0 else "descending",
        t, x, scene, start[:, 0], sensor.observe(x, t, scene), sensor.sigma(x, t, scene),
        begins,
    )  # fmt: skip
