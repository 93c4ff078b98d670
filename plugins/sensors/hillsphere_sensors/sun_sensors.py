"""Sensors of the Sun's light: radial velocity and direction of the Sun."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Channel, Scene
from hillsphere_sensors.heliocentric import HeliocentricSensor
from hillsphere_sensors.spacecraft import SpacecraftSensor, line_of_sight_frame
from hillsphere_sensors.spacecraft_specs import SunDopplerSpec, SunSensorSpec

__all__ = ["SunDoppler", "SunSensor"]


class SunDoppler(HeliocentricSensor):
    """Radial velocity relative to the Sun, r·v/|r|, without the light time.

    Parameters
    ----------
    spec : SunDopplerSpec
        Its parameters.
    """

    def __init__(self, spec: SunDopplerSpec) -> None:
        super().__init__(spec, (Channel("radial_velocity", "m/s"),))
        self.spec = spec

    def _true(self, x: Array, t_s: Array, scene: Scene) -> Array:
        state = self._heliocentric(x, t_s, scene)
        along = np.sum(state[:3] * state[3:], axis=0)
        return np.asarray(along / np.sqrt(np.sum(state[:3] ** 2, axis=0)))[None]

    def _sigmas(self, true: Array) -> Array:
        return np.full((1, 1), self.spec.sigma_m_s)

    def _bias_sigmas(self, true: Array) -> Array:
        return np.full((1, 1), self.spec.bias_m_s)


class SunSensor(SpacecraftSensor):
    """Unit vector to the Sun in the axes of the states; the attitude counts as commanded.

    From the scene it takes ``"sun"``, shape (3, N), the Sun's position in the states' frame, m;
    with a field of view also ``"boresight"``, (S, 3, N), of the camera: the sensor points opposite
    to it.

    Its errors are small rotations of that vector about two axes across it.

    Parameters
    ----------
    spec : SunSensorSpec
        Its parameters.
    """

    def __init__(self, spec: SunSensorSpec) -> None:
        super().__init__(spec, (Channel("sun", "-", "direction"),))
        self.spec = spec

    @property
    def draws(self) -> tuple[int, int]:
        """Normal numbers: two biases; noise about two axes, a dropout and an outlier."""
        return 2, 4

    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        """Return the measurements, NaN where there is none."""
        # the turns have two rows, the vector three: the third row of errors is empty
        nothing = np.zeros((1, noise.shape[1]))
        full = np.concatenate([noise[:2], nothing, noise[2:]])
        return super().measure(x, t_s, scene, np.concatenate([constant, nothing]), full)

    def _true(self, x: Array, t_s: Array, scene: Scene) -> Array:
        towards = self._from(scene, "sun", (3,), t_s) - self._states(x, self.spec.spacecraft)[:3]
        towards = self._as_believed(towards, t_s, scene)
        return np.asarray(towards / np.sqrt(np.sum(towards**2, axis=0)))

    def _sees(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        if self.spec.field_of_view_rad is None:
            return np.ones(t_s.shape, dtype=bool)
        boresight = self._boresight(scene, t_s)
        size = np.sqrt(np.sum(boresight**2, axis=0))
        aligned = -np.sum(self._true(x, t_s, scene) * boresight, axis=0) / size
        return np.asarray(aligned >= np.cos(0.5 * self.spec.field_of_view_rad))

    def _sigmas(self, true: Array) -> Array:
        return np.full((3, 1), self.spec.sigma_rad)

    def _bias_sigmas(self, true: Array) -> Array:
        return np.full((3, 1), self.spec.bias_rad)

    def _with_errors(self, true: Array, off: Array) -> Array:
        # axes across the direction; the Sun along z would leave them open: then by way of x
        steep = np.hypot(true[0], true[1]) < 1e-6
        frame = line_of_sight_frame(np.where(steep, np.roll(true, 1, axis=0), true))
        across = np.where(steep, np.roll(frame, -1, axis=1), frame)[:2]
        turned = true + np.einsum("an,ain->in", off[:2], across)
        return np.asarray(turned / np.sqrt(np.sum(turned**2, axis=0)))
