"""Range and direction of another spacecraft."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Channel, Scene
from hillsphere_sensors.body_surface import BodySurface
from hillsphere_sensors.spacecraft import SpacecraftSensor, rotate
from hillsphere_sensors.spacecraft_specs import InterSatelliteSpec

__all__ = ["InterSatellite"]

_RANGE = Channel("range", "m")
_ANGLES = (Channel("azimuth", "rad", "angle"), Channel("elevation", "rad", "angle"))


class InterSatellite(SpacecraftSensor):
    """Distance of a partner, its azimuth (from x towards y) and its elevation over the xy plane.

    The angles are in the axes of the states: the attitude counts as commanded. There is no
    measurement if the Sun is near the partner or, with a body, if its ellipsoid lies between the
    two.

    From the scene it takes, with a cone about the Sun, ``"sun"``, shape (3, N), the Sun's position
    in the states' frame, m; with a body ``"to_body"``, (3, 3, N), the matrices to the body's axes.

    Parameters
    ----------
    spec : InterSatelliteSpec
        With its references bound.

    Raises
    ------
    InputError
        If the body has no surface.
    """

    def __init__(self, spec: InterSatelliteSpec) -> None:
        channels = (*([_RANGE] if spec.range else []), *(_ANGLES if spec.angles else ()))
        super().__init__(spec, channels)
        self.spec = spec
        self.surface = BodySurface(spec.body, "inter_satellite") if spec.body is not None else None
        kept = [spec.range, spec.angles, spec.angles]
        self._kept = np.flatnonzero(kept)

    def _true(self, x: Array, t_s: Array, scene: Scene) -> Array:
        self._surroundings(t_s, scene)
        d = self._way(x)
        if self.spec.angles:
            d = self._as_believed(d, t_s, scene)
        level = d[0] * d[0] + d[1] * d[1]
        rows = np.empty((3, d.shape[1]))
        np.sqrt(level + d[2] * d[2], out=rows[0])
        np.arctan2(d[1], d[0], out=rows[1])
        np.arctan2(d[2], np.sqrt(level), out=rows[2])
        # arctan2 gives +π where the interval of angles begins at −π
        rows[1, rows[1] >= np.pi] = -np.pi
        return rows if len(self._kept) == 3 else rows[self._kept]

    def _sees(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        spec, way = self.spec, self._way(x)
        sun, turn = self._surroundings(t_s, scene)
        distance = np.sqrt(np.sum(way * way, axis=0))
        there = distance > 0.0
        if spec.maximum_range_m is not None:
            there &= distance <= spec.maximum_range_m
        own = self._states(x, spec.spacecraft)[:3]
        if sun is not None:
            towards = sun - own
            aligned = np.sum(towards * way, axis=0)
            size = np.sqrt(np.sum(towards * towards, axis=0)) * distance
            there &= aligned < np.cos(spec.sun_cone_rad) * size
        if turn is not None and self.surface is not None:
            axes = self.surface.semi_axes_m[:, None]
            a, d = rotate(turn, own) / axes, rotate(turn, way) / axes
            part = -np.sum(a * d, axis=0) / np.maximum(np.sum(d * d, axis=0), 1e-300)
            nearest = a + np.clip(part, 0.0, 1.0) * d
            there &= np.sum(nearest * nearest, axis=0) > 1.0
        return np.asarray(there)

    def _sigmas(self, true: Array) -> Array:
        spec = self.spec
        every = np.array([spec.range_sigma_m, spec.angle_sigma_rad, spec.angle_sigma_rad])
        return every[self._kept, None]

    def _bias_sigmas(self, true: Array) -> Array:
        spec = self.spec
        every = np.array([spec.range_bias_m, spec.angle_bias_rad, spec.angle_bias_rad])
        return every[self._kept, None]

    def _way(self, x: Array) -> Array:
        return self._states(x, self.spec.partner)[:3] - self._states(x, self.spec.spacecraft)[:3]

    def _surroundings(self, t_s: Array, scene: Scene) -> tuple[Array | None, Array | None]:
        sun = self._from(scene, "sun", (3,), t_s) if self.spec.sun_cone_rad else None
        turn = self._from(scene, "to_body", (3, 3), t_s) if self.surface is not None else None
        return sun, turn
