"""A station on the Earth that measures range, range-rate or direction of a spacecraft.

References
----------
.. [1] Moyer, T. D., Formulation for Observed and Computed Values of Deep Space Network Data Types
   for Navigation, JPL, 2000, chapters 8 and 13.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.constants import NOMINAL_SOLAR_GM_M3_S2, SPEED_OF_LIGHT_M_S
from hillsphere.base.geodetic import Station
from hillsphere.interfaces import Array, Channel, Scene
from hillsphere.model.ephemeris import kepler_step
from hillsphere_sensors.heliocentric import HeliocentricSensor
from hillsphere_sensors.spacecraft import rotate
from hillsphere_sensors.spacecraft_specs import DeepSpaceStationSpec

__all__ = ["DeepSpaceStation"]

_EARTH_RATE_RAD_S = 7.292115146706979e-5
"""Rate of the Earth rotation angle, 2π × 1.00273781191135448 a day of UT1 (IERS Conventions 2010,
eq. 5.15); the same as that of `hillsphere.model.earth.rotation` in the frame GCRS."""
_ROUNDS = 4
"""Of the light time; each takes off four digits (speed over that of light)."""


class DeepSpaceStation(HeliocentricSensor):
    r"""One-way range of a spacecraft, its rate, and its direction, from a turning Earth.

    Light that arrives at t left the spacecraft at t − τ, :math:`c\tau = \rho = |r(t-\tau) - s(t)|`
    (Newtonian [1]_), s the heliocentric place of the station. Back to then the spacecraft is
    carried on its osculating orbit around the Sun: what else pulls at it, 1e-6 m/s² near a small
    asteroid, moves it by half a metre in a light time of 1000 s, the same in every model of it.
    The rate is exact for this range:

    .. math:: \dot\rho = \frac{e\cdot(\dot r - \dot s)}{1 + e\cdot\dot r/c}, \quad
              e = (r(t-\tau) - s(t))/\rho .

    The station turns with the Earth about its axis; that the axis moves itself adds up to 5e-5
    m/s, which is left out. Longitude and latitude are those of e, in the axes of the heliocentric
    states. Visible is what stands above the mask, and for telescopes while the Sun is under the
    horizon.

    From the scene it takes what every `HeliocentricSensor` does, ``"earth"``, shape (6, N), the
    Earth's heliocentric state, and ``"earth_axes"``, (3, 3, N), the matrices from heliocentric to
    Earth-fixed axes.

    Parameters
    ----------
    spec : DeepSpaceStationSpec
        Its parameters.
    """

    def __init__(self, spec: DeepSpaceStationSpec) -> None:
        channels: list[Channel] = []
        for name in spec.measures:
            if name == "range":
                channels.append(Channel("range", "m"))
            elif name == "range_rate":
                channels.append(Channel("range_rate", "m/s"))
            else:
                channels += [
                    Channel("longitude", "rad", "angle"),
                    Channel("latitude", "rad", "angle"),
                ]
        super().__init__(spec, tuple(channels))
        self.spec = spec
        self.station = Station(spec.station, spec.latitude_rad, spec.longitude_rad, spec.height_m)

    def _true(self, x: Array, t_s: Array, scene: Scene) -> Array:
        way, speed, station = self._line(x, t_s, scene)
        distance = np.sqrt(np.sum(way * way, axis=0))
        rows: list[Array] = []
        for name in self.spec.measures:
            if name == "range":
                rows.append(distance)
            elif name == "range_rate":
                along = np.sum(way * speed, axis=0) / distance
                against = np.sum(way * (speed - station[3:]), axis=0) / distance
                # the light time changes with the range: division by 1 + e·ṙ/c, see the class
                rows.append(against / (1.0 + along / SPEED_OF_LIGHT_M_S))
            else:
                longitude = np.arctan2(way[1], way[0])
                # in [−π, π): atan2 returns +π for the negative axis
                rows.append(np.where(longitude >= np.pi, -np.pi, longitude))
                rows.append(np.arctan2(way[2], np.hypot(way[0], way[1])))
        return np.array(rows)

    def _sees(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        way, _, station = self._line(x, t_s, scene)
        turn = self._from(scene, "earth_axes", (3, 3), t_s)
        there = self._elevation(turn, way) >= self.spec.mask_elevation_rad
        if self.spec.sun_below_rad is not None:
            there &= self._elevation(turn, -station[:3]) <= -self.spec.sun_below_rad
        return np.asarray(there)

    def _sigmas(self, true: Array) -> Array:
        spec = self.spec
        return self._errors(
            true, spec.range_sigma_m, spec.range_rate_sigma_m_s, spec.angle_sigma_rad
        )

    def _bias_sigmas(self, true: Array) -> Array:
        spec = self.spec
        return self._errors(true, spec.range_bias_m, spec.range_rate_bias_m_s, spec.angle_bias_rad)

    def _errors(self, true: Array, distance: float, rate: float, angle: float) -> Array:
        """Return the standard deviations of each row from those on the sky.

        An angle on the sky is an angle in longitude divided by the cosine of the latitude.
        """
        errors = np.empty_like(true)
        for row, channel in enumerate(self.channels):
            if channel.name == "longitude":
                errors[row] = angle / np.maximum(np.cos(true[row + 1]), 1e-3)
            else:
                errors[row] = {"range": distance, "range_rate": rate, "latitude": angle}[
                    channel.name
                ]
        return errors

    def _line(self, x: Array, t_s: Array, scene: Scene) -> tuple[Array, Array, Array]:
        """Return the line of sight (3, N), the spacecraft's velocity then, and the station's state.

        The spacecraft is at the time at which the light left it.
        """
        now = self._heliocentric(x, t_s, scene)
        station = self._station(t_s, scene)
        # fixed-point iteration for the time at which the light left the spacecraft
        then = now
        for _ in range(_ROUNDS):
            way = then[:3] - station[:3]
            delay = np.sqrt(np.sum(way * way, axis=0)) / SPEED_OF_LIGHT_M_S
            then = kepler_step(now, -delay, NOMINAL_SOLAR_GM_M3_S2)
        return then[:3] - station[:3], then[3:], station

    def _station(self, t_s: Array, scene: Scene) -> Array:
        """Return the heliocentric state (6, N) of the station."""
        earth = self._from(scene, "earth", (6,), t_s)
        back = self._from(scene, "earth_axes", (3, 3), t_s).transpose(1, 0, 2)
        place = self.station.ecef_m[:, None]
        # ω × r in Earth-fixed axes
        moved = _EARTH_RATE_RAD_S * np.array([-place[1], place[0], np.zeros(1)])
        return np.asarray(earth + np.concatenate([rotate(back, place), rotate(back, moved)]))

    def _elevation(self, turn: Array, way: Array) -> Array:
        """Return the elevation of a direction (3, N) over the station's horizon, rad."""
        up = self.station.axes[2][:, None]
        fixed = rotate(turn, way)
        sine = np.sum(up * fixed, axis=0) / np.sqrt(np.sum(way * way, axis=0))
        return np.asarray(np.arcsin(np.clip(sine, -1.0, 1.0)))
