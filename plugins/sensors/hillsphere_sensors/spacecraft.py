"""Common parts of the sensors of spacecraft: states, availability, and errors."""

from __future__ import annotations

from abc import ABC, abstractmethod
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Channel, Scene
from hillsphere.sensor_suite import CommonScene
from hillsphere_sensors.spacecraft_specs import SpacecraftSensorSpec

__all__ = ["SpacecraftSensor", "boresight_components", "line_of_sight_frame", "rotate", "turn_axes"]

Booleans = NDArray[np.bool_]

_SAME_TIME_S = 1e-6
"""Difference from a multiple of the period, s, that is rounding of the time (1e-8 s after a year)
and not a time without measurement."""
_LEVEL = 1e-11
"""Part of a boresight along ±z that is made level: less than any camera resolves."""


class SpacecraftSensor(ABC):
    """A sensor whose rows have noise and constant biases, at times when it is available.

    A subclass gives the true values (`_true`), where the geometry allows a measurement (`_sees`),
    and the standard deviations of the errors (`_sigmas`, `_bias_sigmas`). The noise is normal; that
    of an outlier is larger by a factor.

    If the scene has ``"attitude"``, shape (S, 3, N), rad, the axes of all sensors of a spacecraft
    are turned by its rotation vector, about the axes of its camera as commanded; the true
    boresight is turned with them. Zeros, or no such entry, mean the commanded attitude.

    Parameters
    ----------
    spec : SpacecraftSensorSpec
        Its parameters.
    channels : tuple of Channel
        Measured quantities.
    """

    def __init__(self, spec: SpacecraftSensorSpec, channels: tuple[Channel, ...]) -> None:
        self.common = spec
        self.channels = channels
        self._rows = sum(channel.rows for channel in channels)
        self._dropout = _threshold(spec.dropout_probability)
        self._outlier = _threshold(spec.outlier_probability)

    @property
    def draws(self) -> tuple[int, int]:
        """Normal numbers: a bias for each row; noise for each row, a dropout and an outlier."""
        return self._rows, self._rows + 2

    @property
    def takes(self) -> tuple[str, ...]:
        """Names of what the sensor takes from the scene."""
        return self.common.takes

    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return perfect measurements; see `hillsphere.interfaces.Sensor`."""
        return self._true(np.asarray(x, float), np.asarray(t_s, float), scene)

    def visible(self, x: Array, t_s: Array, scene: Scene) -> Booleans:
        """Return whether there is a measurement."""
        times = np.asarray(t_s, float)
        return self._available(times) & self._sees(np.asarray(x, float), times, scene)

    def sigma(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the standard deviations of the noise (m, N), outliers left out."""
        true = self.observe(x, t_s, scene)
        return np.array(np.broadcast_to(self._sigmas(true), true.shape))

    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        """Return the measurements, NaN where there is none.

        The rows of `constant` are the biases; those of `noise` the noise of each row, dropout and
        outlier.
        """
        true = self.observe(x, t_s, scene)
        m = self._rows
        grown = np.where(noise[m + 1] < self._outlier, self.common.outlier_factor, 1.0)
        off = self._sigmas(true) * noise[:m] * grown + self._bias_sigmas(true) * constant
        missing = ~self.visible(x, t_s, scene) | (noise[m] < self._dropout)
        return np.where(missing, np.nan, self._with_errors(true, off))

    @abstractmethod
    def _true(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the true values (m, N)."""

    @abstractmethod
    def _sigmas(self, true: Array) -> Array:
        """Return the standard deviations of the noise, (m, N) or (m, 1)."""

    @abstractmethod
    def _bias_sigmas(self, true: Array) -> Array:
        """Return the standard deviations of the biases, (m, N) or (m, 1)."""

    def _sees(self, x: Array, t_s: Array, scene: Scene) -> Booleans:
        """Return whether the geometry allows a measurement."""
        return np.ones(np.shape(t_s), dtype=bool)

    def _with_errors(self, true: Array, off: Array) -> Array:
        """Return true values with errors; angles stay within [−π, π)."""
        shown = true + off
        row = 0
        for channel in self.channels:
            if channel.kind == "angle":
                shown[row] = np.remainder(shown[row] + np.pi, 2.0 * np.pi) - np.pi
            row += channel.rows
        return shown

    def _available(self, t_s: Array) -> Booleans:
        """Return whether the schedule and the outages allow a measurement."""
        spec = self.common
        there = np.ones(t_s.shape, dtype=bool)
        if spec.period_s:
            away = np.abs(np.remainder(t_s + 0.5 * spec.period_s, spec.period_s))
            there &= np.abs(away - 0.5 * spec.period_s) <= _SAME_TIME_S
        for begin, end in spec.outages_s:
            there &= (t_s < begin) | (t_s > end)
        return there

    def _states(self, x: Array, number: int) -> Array:
        """Return the six rows of a spacecraft, counted from 1."""
        rows = x[6 * (number - 1) : 6 * number]
        if rows.ndim != 2 or rows.shape[0] != 6:
            raise InputError(
                f"{type(self).__name__}: spacecraft {number} needs rows {6 * number - 5} to "
                f"{6 * number} of the states, which are {x.shape}"
            )
        return rows

    def _angles_of_centre(self, r: Array, t_s: Array, scene: Scene) -> Array:
        """Return azimuth and elevation (2, N) of the origin from the boresight, for r (3, N).

        Sensors of one suite with the same boresight compute them once.
        """
        kept = scene.kept if isinstance(scene, CommonScene) else {}
        key = ("angles of the centre", self.common.spacecraft)
        if key not in kept:
            u, v, ahead = self._components(-r, t_s, scene)
            kept[key] = np.array([np.arctan2(u, ahead), np.arctan2(v, ahead)])
        return kept[key]

    def _from(self, scene: Scene, name: str, shape: tuple[int, ...], t_s: Array) -> Array:
        """Return an array of the scene, shape (…, N) or (…, 1)."""
        if name not in scene:
            raise InputError(
                f"{type(self).__name__}: the scene lacks {name!r}; it has: "
                f"{', '.join(sorted(scene)) or 'nothing'}"
            )
        values = np.asarray(scene[name], dtype=float)
        if values.shape[:-1] != shape or values.shape[-1] not in (1, t_s.size):
            wanted = ", ".join(map(str, (*shape, t_s.size)))
            raise InputError(
                f"{type(self).__name__}: the scene's {name!r} must be ({wanted}), got "
                f"{values.shape}"
            )
        return values

    def _turn(self, t_s: Array, scene: Scene) -> Array | None:
        """Return the attitude error (3, N) or (3, 1) of the spacecraft, rad, None without any.

        It is the rotation vector from the commanded to the true axes, about the former.
        """
        if "attitude" not in scene:
            return None
        crafts = max(*np.shape(scene["attitude"])[:1], self.common.spacecraft)
        turns = self._from(scene, "attitude", (crafts, 3), t_s)[self.common.spacecraft - 1]
        return turns if turns.any() else None

    def _components(self, way: Array, t_s: Array, scene: Scene) -> tuple[Array, Array, Array]:
        """Return the components of vectors (3, N) in the true axes of the camera."""
        u, v, ahead = boresight_components(self._boresight(scene, t_s), way)
        turn = self._turn(t_s, scene)
        if turn is not None:
            u, v, ahead = turn_axes(turn, np.array([u, v, ahead]))
        return u, v, ahead

    def _axes(self, t_s: Array, scene: Scene) -> Array:
        """Return the true axes (3, 3, N) of the camera, as rows, in the states' frame."""
        frame, turn = line_of_sight_frame(self._boresight(scene, t_s)), self._turn(t_s, scene)
        return frame if turn is None else turn_axes(turn, frame)

    def _pointing(self, t_s: Array, scene: Scene) -> Array:
        """Return the true boresight, (3, N) or (3, 1), of any length."""
        if self._turn(t_s, scene) is None:
            return self._boresight(scene, t_s)
        return np.asarray(self._axes(t_s, scene)[2])

    def _as_believed(self, way: Array, t_s: Array, scene: Scene) -> Array:
        """Return vectors (3, N) as a sensor shows them whose attitude counts as commanded."""
        turn = self._turn(t_s, scene)
        if turn is None:
            return way
        frame = line_of_sight_frame(self._boresight(scene, t_s))
        return rotate(frame.transpose(1, 0, 2), turn_axes(turn, rotate(frame, way)))

    def _boresight(self, scene: Scene, t_s: Array) -> Array:
        """Return the commanded boresight, (3, N) or (3, 1), of any length."""
        if "boresight" in scene:
            crafts = np.shape(scene["boresight"])[:1]
            if crafts and crafts[0] < self.common.spacecraft:
                raise InputError(
                    f"{type(self).__name__}: the scene's 'boresight' is that of {crafts[0]} "
                    f"spacecraft, number {self.common.spacecraft} is asked for"
                )
            boresights = self._from(scene, "boresight", (*crafts, 3), t_s)
            return np.asarray(boresights[self.common.spacecraft - 1])
        return self._from(scene, "boresight", (1, 3), t_s)


def line_of_sight_frame(boresight: Array) -> Array:
    """Return the axes (3, 3, N), as rows, of a camera with the boresights (3, N).

    The third axis is the boresight, the first z × boresight (level with the frame's xy plane), the
    second completes them. For a boresight along ±z the first axis is undefined; the boresight then
    counts as tilted towards +x by an angle that no camera resolves.

    Raises
    ------
    InputError
        If a boresight has no length, or is not finite.
    """
    size = np.sqrt(np.sum(boresight**2, axis=0))
    level = np.sqrt(boresight[0] ** 2 + boresight[1] ** 2)
    if not (level > 1e-12 * size).all():
        return line_of_sight_frame(_off_the_pole(boresight))
    z = boresight / size
    x = np.array([-boresight[1], boresight[0], np.zeros_like(level)]) / level
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])
    return np.array([x, y, z])


def boresight_components(boresight: Array, way: Array) -> tuple[Array, Array, Array]:
    """Return the components of vectors (3, N) in the axes of `line_of_sight_frame`.

    The axes are not formed, which saves time: a filter calls this at every sigma point.

    Raises
    ------
    InputError
        If a boresight has no length, or is not finite.
    """
    bx, by, bz = boresight
    rx, ry, rz = way
    square = bx * bx + by * by
    size = np.sqrt(square + bz * bz)
    level = np.sqrt(square)
    if not (level > 1e-12 * size).all():
        return boresight_components(_off_the_pole(boresight), way)
    # dot products with z × b/|·|, with the axis that completes the frame, and with b/|b|
    flat = bx * rx + by * ry
    return (
        (bx * ry - by * rx) / level,
        (level * rz - bz * flat / level) / size,
        (flat + bz * rz) / size,
    )


def _off_the_pole(boresight: Array) -> Array:
    """Return boresights (3, N), those along ±z tilted by less than any camera resolves."""
    bx, by, bz = boresight
    size = np.sqrt(bx * bx + by * by + bz * bz)
    if not ((size > 0.0) & (size < np.inf)).all():
        raise InputError(
            "boresight: a vector of some length is needed, got one of length zero or not a number; "
            "a spacecraft at the origin of its states cannot look there"
        )
    steep = np.sqrt(bx * bx + by * by) <= 1e-12 * size
    return np.array([np.where(steep, _LEVEL * size, bx), np.where(steep, 0.0, by), bz])


def turn_axes(turn: Array, vectors: Array) -> Array:
    """Return the components (3, …, N) of vectors in axes turned by a rotation vector.

    The rotation is Rodrigues's by the opposite vector, exact for any angle.

    Parameters
    ----------
    turn : ndarray, shape (3, N) or (3, 1)
        Rotation vector of the axes, rad, in components of the axes before.
    vectors : ndarray, shape (3, …, N)
        Components in the axes before.
    """
    a, b, c = turn.reshape(3, *(1,) * (vectors.ndim - 2), turn.shape[-1])
    x, y, z = vectors
    half = 0.5 * np.sqrt(a * a + b * b + c * c)
    # sin θ/θ and (1 − cos θ)/θ², with the limits at zero; np.sinc(t) is sin(πt)/(πt)
    first, second = np.sinc(2.0 * half / np.pi), 0.5 * np.sinc(half / np.pi) ** 2
    across = b * z - c * y, c * x - a * z, a * y - b * x
    twice = (
        b * across[2] - c * across[1],
        c * across[0] - a * across[2],
        a * across[1] - b * across[0],
    )
    return np.array([v - first * p + second * q
                     for v, p, q in zip(vectors, across, twice, strict=True)])  # fmt: skip


def rotate(matrices: Array, vectors: Array) -> Array:
    """Return matrices (3, 3, N or 1) times vectors (3, …, N)."""
    between = (slice(None),) * 2 + (None,) * (vectors.ndim - 2)
    a, (x, y, z) = matrices[between], vectors
    return np.array([row[0] * x + row[1] * y + row[2] * z for row in a])


def _threshold(probability: float) -> float:
    """Return the number below which a normal one lies with this probability."""
    if probability in (0.0, 1.0):
        return np.inf if probability else -np.inf
    return NormalDist().inv_cdf(probability)
