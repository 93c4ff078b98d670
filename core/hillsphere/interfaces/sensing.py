"""Sensors: channels, the scene that they see, and their errors."""

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
    """One thing that a sensor measures.

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
        """Number of rows that it takes in an array of measurements."""
        return 3 if self.kind == "direction" else 1


Scene: TypeAlias = Mapping[str, Array]
"""What surrounds a sensor at the times of its measurements, by name; the last axis is N or 1."""


@runtime_checkable
class Sensor(Contract, Protocol):
    """What is measured of a state, and with which errors.

    Pure functions on N lanes: states x (n, N), SI, positions first, at times t_s (N,), s. All
    randomness comes in as standard normal numbers, drawn by whoever repeats the cases
    (`hillsphere.base.seeds`). Each sensor documents what it takes from the scene.
    """

    @property
    def channels(self) -> tuple[Channel, ...]:
        """What is measured; together m rows."""
        ...

    @property
    def draws(self) -> tuple[int, int]:
        """How many normal numbers the constant errors of a case take, and each measurement."""
        ...

    def observe(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return what a perfect sensor shows, SI, (m, N), visible or not."""
        ...

    def visible(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        """Say where there is something to measure, (N,)."""
        ...

    def sigma(self, x: Array, t_s: Array, scene: Scene) -> Array:
        """Return the standard deviations of the random errors, SI, (m, N)."""
        ...

    def measure(self, x: Array, t_s: Array, scene: Scene, constant: Array, noise: Array) -> Array:
        """Return what is measured, SI, (m, N); NaN where nothing is.

        constant (k, N) and noise (l, N) are standard normal, k and l as `draws` says.
        """
        ...


@runtime_checkable
class StationSensor(Sensor, Protocol):
    """A `Sensor` at a ground station that measures azimuth and elevation, in this order.

    From the scene it takes ``"earth_fixed"``, shape (3, 3, N): what turns positions of the states'
    frame to Earth-fixed ones (`hillsphere.model.earth.rotation.earth_fixed`).
    """

    @property
    def station(self) -> Station:
        """Where it truly stands."""
        ...

    def believed_stations(self, constant: Array) -> tuple[Station, ...]:
        """Return where trackers are told that it stands, for each of N cases.

        constant (k, N) are the normal numbers behind the constant errors, as for `measure`.
        """
        ...

    def bias(self, x: Array, t_s: Array, scene: Scene, constant: Array) -> Array:
        """Return the systematic errors, measured minus true, rad, (2, N)."""
        ...
