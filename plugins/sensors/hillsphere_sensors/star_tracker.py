"""Attitude of a spacecraft by a star tracker."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Channel, Scene
from hillsphere_sensors.spacecraft import SpacecraftSensor
from hillsphere_sensors.spacecraft_specs import StarTrackerSpec

__all__ = ["StarTracker"]


class StarTracker(SpacecraftSensor):
    """Small rotation of a spacecraft from its commanded attitude, about the axes of its camera.

    The components of the rotation vector are about x, y and z (the boresight) of
    `hillsphere_sensors.camera.Camera`. The tracker points opposite to the boresight, and has no
    measurement if the Sun is too near to that direction.

    From the scene it takes ``"attitude"``, shape (S, 3, N), the true rotations of S spacecraft,
    rad; with a cone about the Sun also ``"boresight"``, (S, 3, N), and ``"sun"``, (3, N), as the
    camera.

    Parameters
    ----------
    spec : StarTrackerSpec
        Its parameters.
    """

    def __init__(self, spec: StarTrackerSpec) -> None:
        super().__init__(spec, tuple(Channel(f"turn_{axis}", "rad", "angle") for axis in "xyz"))
        self.spec = spec

    def _true(self, x: Array, t_s: Array, scene: Scene) -> Array:
        crafts = np.shape(scene.get("attitude", ()))[:1] or (1,)
        turns = self._from(scene, "attitude", (max(crafts[0], self.spec.spacecraft), 3), t_s)
        return np.array(np.broadcast_to(turns[self.spec.spacecraft - 1], (3, t_s.size)))

    def _sees(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        if not self.spec.sun_cone_rad:
            return np.ones(t_s.shape, dtype=bool)
        towards = self._from(scene, "sun", (3,), t_s) - self._states(x, self.spec.spacecraft)[:3]
        boresight = self._pointing(t_s, scene)
        aligned = -np.sum(towards * boresight, axis=0)
        size = np.sqrt(np.sum(towards**2, axis=0) * np.sum(boresight**2, axis=0))
        return np.asarray(aligned < np.cos(self.spec.sun_cone_rad) * size)

    def _sigmas(self, true: Array) -> Array:
        spec = self.spec
        return np.array([[spec.sigma_rad], [spec.sigma_rad], [spec.roll_sigma_rad]])

    def _bias_sigmas(self, true: Array) -> Array:
        return np.full((3, 1), self.spec.bias_rad)
