"""A laser altimeter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Channel, Scene
from hillsphere_sensors.body_surface import BodySurface
from hillsphere_sensors.spacecraft import SpacecraftSensor, rotate
from hillsphere_sensors.spacecraft_specs import LidarSpec

__all__ = ["Lidar"]

_RANGE = Channel("range", "m")
_ANGLES = (Channel("azimuth", "rad", "angle"), Channel("elevation", "rad", "angle"))


class Lidar(SpacecraftSensor):
    r"""Range to the surface of an asteroid, and the direction of the laser spot.

    With the spot ``below`` the spacecraft the range is :math:`|r| - R(\hat r)`, R the radius of the
    surface in that direction; azimuth and elevation are those of the spot in the axes of the camera
    (`hillsphere_sensors.camera.Camera`). With the spot in the direction of ``pointing`` the range
    is the distance along the boresight to the ellipsoid. With a field of view the spot ``below`` is
    measured only if the centre of mass lies in that cone about the boresight.

    From the scene it takes ``"to_body"``, shape (3, 3, N), the matrices from the states' frame to
    the body's. If it measures angles, has a field of view or points along the boresight, it also
    takes ``"boresight"``, (S, 3, N), the commanded boresights of S spacecraft in the states' frame.

    Parameters
    ----------
    spec : LidarSpec
        With its references bound.

    Raises
    ------
    InputError
        If the body has no surface or, for ``pointing``, one that is no ellipsoid.
    """

    def __init__(self, spec: LidarSpec) -> None:
        super().__init__(spec, (_RANGE, *_ANGLES) if spec.angles else (_RANGE,))
        self.spec = spec
        self.surface = BodySurface(spec.body, "lidar")
        if spec.spot == "pointing" and not self.surface.is_ellipsoid:
            raise InputError(
                "lidar: spot = 'pointing' needs an ellipsoid; give the body semi-axes, or take "
                "the spot 'below'"
            )

    def _true(self, x: Array, t_s: Array, scene: Scene) -> Array:
        r = self._states(x, self.spec.spacecraft)[:3]
        distance, _ = self._range(r, t_s, scene)
        if not self.spec.angles:
            return distance[None]
        return np.concatenate([distance[None], self._angles_of_centre(r, t_s, scene)])

    def _sees(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        r = self._states(x, self.spec.spacecraft)[:3]
        distance, met = self._range(r, t_s, scene)
        if self.spec.maximum_range_m is not None:
            met = met & (distance <= self.spec.maximum_range_m)
        if self.spec.field_of_view_rad is not None:
            u, v, ahead = self._components(-r, t_s, scene)
            off = np.arctan2(np.sqrt(u * u + v * v), ahead)
            met = met & (off <= 0.5 * self.spec.field_of_view_rad)
        return met

    def _sigmas(self, true: Array) -> Array:
        spec = self.spec
        angle = np.hypot(spec.pointing_sigma_rad, spec.attitude_sigma_rad)
        return np.array([[spec.range_sigma_m], [angle], [angle]])[: len(true)]

    def _bias_sigmas(self, true: Array) -> Array:
        spec = self.spec
        angle = spec.pointing_bias_rad
        return np.array([[spec.range_bias_m], [angle], [angle]])[: len(true)]

    def _range(self, r: Array, t_s: Array, scene: Scene) -> tuple[Array, NDArray[np.bool_]]:
        turn = self._from(scene, "to_body", (3, 3), t_s)
        place = rotate(turn, r)
        if self.spec.spot == "below":
            away = np.sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
            distance = away - self.surface.radius(place)
            return distance, np.asarray(distance > 0.0)
        boresight = self._pointing(t_s, scene)
        beam = rotate(turn, boresight / np.sqrt(np.sum(boresight**2, axis=0)))
        return self.surface.ray(place, np.broadcast_to(beam, place.shape))
