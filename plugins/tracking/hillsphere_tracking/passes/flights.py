"""Numerical flights of satellites by a plant, with initial states from published elements.

The theory of the elements gives only the osculating state at their epoch; from there on the force
model of the plant determines the motion.
"""

from __future__ import annotations

from typing import Protocol, cast, get_args

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.dynamics import Taylor, system
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array, Plant
from hillsphere.model.earth.rotation import InertialFrame, to_earth_fixed, to_inertial
from hillsphere.time import Epoch
from hillsphere_tracking.flown_orbit import FlownOrbit, estimate_interpolation_error
from hillsphere_tracking.orbits import Orbit

__all__ = ["EarthPlant", "FlownOrbit", "PlantFlights", "fly_satellite"]

_ANGLE = "rotation_angle"
_ENDS = {"impact": "has come down to the ground"}
_LEAST_STATES = 9
"""States of a flight at least, however short: five of them are then inside, at which the error of
interpolation can be estimated."""
_MOST_STATES = 500_000
"""States of a flight at most: half a year in steps of 30 s, whose polynomials take 100 MB."""
_HALVINGS = 12
"""Rounds in which steps are halved at most: 30 s become 7 ms. A flight that needs more has a jump,
which `FlownOrbit` then reports."""


class EarthPlant(Plant, Protocol):
    """Plant of a satellite about the Earth, with an epoch."""

    @property
    def epoch(self) -> Epoch:
        """Origin of the plant's time."""
        ...


class PlantFlights:
    """Flights of satellites by one plant, whose propagator is compiled once.

    The Taylor propagator has internal state: use one object per thread.

    Parameters
    ----------
    plant : EarthPlant
        Plant with positions and velocities in ``teme`` or ``gcrs`` and an epoch. Satellites can be
        flown at any time, but quantities that the plant holds constant (in ``gcrs`` the Earth's
        axis) have their value of the plant's epoch.

    Raises
    ------
    InputError
        If the plant has no epoch, another frame, or other states.
    """

    def __init__(self, plant: Plant) -> None:
        epoch = getattr(plant, "epoch", None)
        names = [v.name for v in plant.states]
        if not isinstance(epoch, Epoch) or plant.frame not in get_args(InertialFrame):
            raise InputError(
                "satellites are flown by a plant about the Earth (type 'earth_orbit') with an "
                f"epoch, in the frame teme or gcrs; got {type(plant).__name__} in "
                f"{plant.frame!r}"
            )
        if len(names) != 6:
            raise InputError(
                "satellites are flown by a plant with three positions and three velocities, "
                f"{type(plant).__name__} has the states {', '.join(names)}"
            )
        self.epoch = epoch
        self.frame = cast(InertialFrame, plant.frame)
        angles = [q.value for q in plant.parameters() if q.name == _ANGLE]
        self._angle_rad = angles[0] if angles else None
        flow = system(plant, run_time=[_ANGLE] if angles else [], normalised=True)
        self._unit, self._clock_s = flow.unit[:, None], flow.time_unit_s
        self._sampled = Taylor(flow)
        self._ended = Taylor(flow, events=tuple(flow.events))

    def fly(
        self,
        orbit: Orbit,
        start: Epoch,
        duration_s: float,
        *,
        rotation_angle_rad: float | None = None,
        step_s: float = 30.0,
    ) -> FlownOrbit:
        """Fly a satellite; see `fly_satellite` for parameters, result and errors."""
        if not (np.isfinite(duration_s) and duration_s > 0.0 and step_s > 0.0):
            raise InputError(
                f"duration and step must be positive and finite, got {duration_s} s, {step_s} s"
            )
        # the flight begins at the epoch of the elements, or at `start` if that is earlier
        begin = start.seconds_since(orbit.epoch)
        first = min(begin, 0.0)
        end, ending = begin + duration_s, ""
        x = orbit.states(np.array([first]))
        if orbit.frame != self.frame:
            fixed = to_earth_fixed(orbit.frame, x, orbit.epoch, np.array([first]))
            x = to_inertial(self.frame, fixed, orbit.epoch, np.array([first]))
        shift = orbit.epoch.seconds_since(self.epoch)
        x, t0 = x / self._unit, (first + shift) / self._clock_s
        p = self._parameters(rotation_angle_rad)
        flight = self._ended.fly(x, (end - first) / self._clock_s, p, t0)
        if (event := flight.ended_by[0]) is not None:
            end = float(flight.time[0]) * self._clock_s - shift
            how = _ENDS.get(event, f"has met the event {event!r}")
            ending = f"{how} {end / DAY_S:+.4f} days from the epoch of its elements"
            if end <= begin:
                raise PropagationError(
                    f"satellite {orbit.name!r} {ending}; ask for earlier times, or give newer "
                    "elements"
                )
        count = max(_LEAST_STATES, int(np.ceil((end - begin) / step_s)) + 1)
        if count > _MOST_STATES:
            raise InputError(
                f"satellite {orbit.name!r}: a flight of {(end - begin) / DAY_S:.4g} days in steps "
                f"of {step_s:g} s has {count} states, at most {_MOST_STATES}; fly it for a shorter "
                "time or in longer steps"
            )

        def sampled(t: Array) -> Array:
            scaled = self._sampled.sample(x, (t + shift) / self._clock_s, p, t0)[:, :, 0]
            return np.asarray(scaled * self._unit)

        t = np.linspace(begin, end, count)
        states = sampled(t)
        for _ in range(_HALVINGS):
            middle, off, allowed = estimate_interpolation_error(t, states)
            coarse = middle[off > allowed]
            if coarse.size == 0:
                break
            # Halve the steps around each state that its four neighbours do not reproduce.
            steps = np.unique(coarse + np.arange(-2, 2)[:, None])
            t = np.insert(t, steps + 1, 0.5 * (t[steps] + t[steps + 1]))
            states = sampled(t)
        return FlownOrbit(orbit.name, orbit.epoch, self.frame, t, states, ending=ending)

    def _parameters(self, rotation_angle_rad: float | None) -> Array | None:
        if self._angle_rad is None:
            if rotation_angle_rad is not None:
                raise InputError(f"the plant has no parameter {_ANGLE!r} to be set")
            return None
        angle = self._angle_rad if rotation_angle_rad is None else rotation_angle_rad
        return np.array([angle])


def fly_satellite(
    orbit: Orbit,
    plant: Plant,
    start: Epoch,
    duration_s: float,
    *,
    rotation_angle_rad: float | None = None,
    step_s: float = 30.0,
) -> FlownOrbit:
    """Fly a satellite by a plant, from the osculating state of its elements.

    The flight begins at the orbit's epoch, or at `start` if that is earlier, with the state that
    the theory of the elements gives there. The Taylor propagator integrates it. Steps between
    stored states are halved where the interpolation error exceeds 1e-9 of the distance.

    Parameters
    ----------
    orbit : Orbit
        Orbit of the satellite, which gives the initial state.
    plant : EarthPlant
        Plant with positions and velocities in ``teme`` or ``gcrs`` and an epoch, ``earth_orbit``.
    start : Epoch
        Beginning of the requested interval.
    duration_s : float
        Length of the requested interval.
    rotation_angle_rad : float, optional
        Rotation angle of the Earth at the plant's epoch; by default the plant's own.
    step_s : float
        Longest interval between two stored states.

    Returns
    -------
    FlownOrbit
        Orbit in the frame of the plant, with the name and epoch of `orbit`. If the satellite
        reaches the ground, the orbit ends there.

    Raises
    ------
    InputError
        If the plant is not suitable, a duration is not positive, or there are too many states.
    PropagationError
        If the orbit does not exist at the beginning of the flight, or ends before `start`.

    Notes
    -----
    For several satellites or several angles use `PlantFlights`, which compiles once.
    """
    return PlantFlights(plant).fly(
        orbit, start, duration_s, rotation_angle_rad=rotation_angle_rad, step_s=step_s
    )
