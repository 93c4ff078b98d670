"""A suite of several sensors, whose measurements form one set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.interfaces.beliefs import MeasurementSet
from hillsphere.interfaces.sensing import Channel, Scene, Sensor

__all__ = ["CommonScene", "SensorSuite"]


class CommonScene(dict[str, Array]):
    """The scene of one call of a suite, with states and times common to all its sensors.

    Sensors share intermediate results of the call in `kept`, under keys that name the result and
    the object that it belongs to.

    Parameters
    ----------
    scene : Scene
        Surroundings of the sensors.
    """

    def __init__(self, scene: Scene) -> None:
        super().__init__(scene)
        self.kept: dict[tuple[str, int], Array] = {}


class SensorSuite:
    """Several sensors, each of which is a block of a `MeasurementSet`.

    Parameters
    ----------
    sensors : sequence of Sensor
        The sensors, in the order of their rows.

    Raises
    ------
    InputError
        If there is no sensor, or an item is not one.
    """

    def __init__(self, sensors: Sequence[Sensor]) -> None:
        if not sensors:
            raise InputError("a suite needs at least one sensor")
        for sensor in sensors:
            if not isinstance(sensor, Sensor):
                raise InputError(f"a suite holds sensors, got a {type(sensor).__name__}")
        self.sensors = tuple(sensors)
        self.blocks: tuple[tuple[Channel, ...], ...] = tuple(tuple(s.channels) for s in sensors)
        self._rows = [sum(channel.rows for channel in block) for block in self.blocks]

    @property
    def rows(self) -> int:
        """Number m of rows of all sensors."""
        return sum(self._rows)

    @property
    def draws(self) -> tuple[int, int]:
        """Numbers of normal numbers per case and per measurement, see `Sensor.draws`.

        Those of the first sensor come first.
        """
        return sum(s.draws[0] for s in self.sensors), sum(s.draws[1] for s in self.sensors)

    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the error-free measurements (m, N), SI, visible or not."""
        scene = CommonScene(scene)
        return np.concatenate([s.observe(x, t_s, scene) for s in self.sensors])

    def sigma(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the standard deviations (m, N) of the random errors, SI."""
        return np.concatenate([s.sigma(x, t_s, scene) for s in self.sensors])

    def visible(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        """Return for each row whether a measurement is possible, bool (m, N)."""
        seen = [s.visible(x, t_s, scene) for s in self.sensors]
        return np.repeat(seen, self._rows, axis=0)

    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        """Return the measurements with errors (m, N), SI; NaN where nothing is measured.

        constant (k, N) and noise (l, N) are standard normal, with k and l from `draws`.
        """
        if (len(constant), len(noise)) != self.draws:
            raise InputError(
                f"the suite takes {self.draws[0]} constant and {self.draws[1]} other normal "
                f"numbers, got {len(constant)} and {len(noise)}"
            )
        measured, first, other = [], 0, 0
        for sensor in self.sensors:
            k, m = sensor.draws
            own, new = constant[first : first + k], noise[other : other + m]
            measured.append(sensor.measure(x, t_s, scene, own, new))
            first, other = first + k, other + m
        return np.concatenate(measured)

    def measurements(
        self,
        x: Array,
        t_s: Array,
        scene: Scene,
        constant: Array,
        noise: Array,
        sigma: Array | None = None,
    ) -> MeasurementSet:
        """Return a set of measurements of the true states.

        Parameters
        ----------
        x : ndarray, shape (n, N)
            True states, SI.
        t_s : ndarray, shape (N,)
            Times, s.
        scene : Scene
            Surroundings of the sensors.
        constant, noise : ndarray, shape (k, N) and (l, N)
            Standard normal numbers, with k and l from `draws`.
        sigma : ndarray, shape (m, N) or (m, 1), or (N, m, m) or (1, m, m), optional
            Standard deviations, or full covariances, stated in the set; by default the true
            standard deviations.

        Returns
        -------
        MeasurementSet
            The measurements, one block per sensor; rows that are not measured are not present.
        """
        values = self.measure(x, t_s, scene, constant, noise)
        stated = self.sigma(x, t_s, scene) if sigma is None else sigma
        return MeasurementSet.of(np.asarray(t_s, dtype=float), values, stated, self.blocks)
