"""Sensors: channels, the observed scene, and measurement errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract

if TYPE_CHECKING:
    from hillsphere.base.geodetic import Station

__all__ = ["Channel", "Scene", "Sensor", "StationSensor"]


@dataclass(frozen=True)
class Channel:
    """One measured quantity of a sensor: one row, or the three rows of a direction.

    Parameters
    ----------
    name : str
        Unique within the sensor.
    unit : str
        SI, e.g. ``"rad"``, ``"m"``, ``"m/s"``.
    kind : {"linear", "angle", "direction"}
        A number; an angle, whose differences go the short way round; a unit vector.
    """

    name: str
    unit: str
    kind: Literal["linear", "angle", "direction"] = "linear"

    @property
    def rows(self) -> int:
        """Number of rows in an array of measurements: 3 for a direction, else 1."""
        return 3 if self.kind == "direction" else 1


Scene: TypeAlias = Mapping[str, Array]
"""The surroundings of a sensor at the times of measurement: name → array, last axis N or 1."""


@runtime_checkable
class Sensor(Contract, Protocol):
    """A sensor: its measurement function, visibility, and error model.

    Pure functions on N lanes: states x (n, N), SI, positions first, at times t_s (N,), s. All
    randomness is passed in as standard normal numbers (`hillsphere.base.seeds`). Each sensor
    documents the entries of the scene that it needs.

    Two optional properties state what a mission is checked for before it runs. A sensor without
    them is not checked.

    - ``takes``, tuple of str, of the sensor and of its Spec: names of the entries of the scene that
      the sensor reads with these parameters, and no others. Without one of them `observe` or
      `visible` raises a `HillsphereError` that names the entry. A mission is refused if neither
      the plant nor the stage provides one of them (``gives`` of the plant's Spec). Attitude errors,
      ``"attitude"``, turn every sensor of a spacecraft where the scene has them; only a sensor that
      cannot do without lists them.
    - ``noise``, mapping of str to float, of the Spec: standard deviations of the random errors, SI,
      by the keys of the mission that set them; several keys of one deviation are joined by
      ``" and "``. A mission with a filter is refused if one of them is zero, because a filter
      divides by the variance.
    """

    @property
    def channels(self) -> tuple[Channel, ...]:
        """The measured quantities, with m rows in total."""
        ...

    @property
    def draws(self) -> tuple[int, int]:
        """Numbers k and l of normal numbers for a case's constant errors and for a measurement."""
        ...

    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the error-free measurements (m, N), SI, visible or not."""
        ...

    def visible(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        """Return the lanes in which a measurement is possible, bool (N,)."""
        ...

    def sigma(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the standard deviations (m, N) of the random errors, SI."""
        ...

    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        """Return the measurements with errors (m, N), SI; NaN in lanes without a measurement.

        constant (k, N) and noise (l, N) are standard normal, with k and l from `draws`.
        """
        ...


@runtime_checkable
class StationSensor(Sensor, Protocol):
    """A `Sensor` at a ground station that measures azimuth and elevation, in this order.

    It needs ``"earth_fixed"`` from the scene, shape (3, 3, N): the rotation from the states' frame
    to the Earth-fixed frame (`hillsphere.model.earth.rotation.earth_fixed`).
    """

    @property
    def station(self) -> Station:
        """The true position of the station."""
        ...

    def believed_stations(self, constant: Array) -> tuple[Station, ...]:
        """Return the station positions that trackers assume, one for each of N cases.

        constant (k, N) are the normal numbers behind the constant errors, as for `measure`.
        """
        ...

    def bias(self, x: Array, t_s: Array, scene: Scene, constant: Array) -> Array:
        """Return the systematic errors (2, N), measured minus true, rad."""
        ...
