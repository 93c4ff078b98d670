"""States of a plant and in the rotating frame in which orbits are compared."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere_orbits.survey import LockedMoon

__all__ = ["Rung", "TrueAnomalyPlant", "describe_plant", "name_rungs"]

STATES = ("x", "y", "z", "vx", "vy", "vz")


@runtime_checkable
class TrueAnomalyPlant(Contract, Protocol):
    """A plant whose moon moves on its ellipse: the true anomaly is its seventh state."""

    def in_hill_frame(self, x: Array) -> Array:
        """Return positions and velocities (6, N) in the frame hill:BODY, SI, of states (7, N)."""
        ...

    def from_hill_frame(self, x: Array, true_anomaly_rad: Array) -> Array:
        """Return states (7, N), SI, of positions and velocities (6, N) in the frame hill:BODY."""
        ...

    def true_anomaly_after(self, start_rad: float, t_s: Array) -> Array:
        """Return the true anomaly (N,), rad, at times after it was `start_rad`."""
        ...


class Rung:
    """One plant of the ladder at given times.

    Parameters
    ----------
    plant : Plant
        States x, y, z, vx, vy, vz in the frame hill:BODY, or a `TrueAnomalyPlant` one.
    t_s : ndarray, shape (K + 1,)
        Times of the nodes.
    true_anomaly_rad : float
        True anomaly of the moon at time zero, for a plant that has one.

    Raises
    ------
    InputError
        If the plant's states are others.
    """

    def __init__(self, plant: Plant, t_s: Array, true_anomaly_rad: float) -> None:
        self.plant, self.t_s = plant, t_s
        names = tuple(v.name for v in plant.states)
        self._clocked = plant if isinstance(plant, TrueAnomalyPlant) else None
        if names[:6] != STATES or (
            self._clocked is None and (len(names) != 6 or not plant.frame.startswith("hill:"))
        ):
            raise InputError(
                f"a rung needs the states {', '.join(STATES)} in the frame hill:BODY, or a way "
                f"there and back; {type(plant).__name__} has {', '.join(names)} in {plant.frame}"
            )
        self.anomaly: Array | None = None
        if self._clocked is not None:
            self.anomaly = self._clocked.true_anomaly_after(true_anomaly_rad, t_s)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.plant.states)

    def states(self, hill: Array, nodes: slice) -> Array:
        """Return states (n, k, N) of the plant from the frame hill:BODY (6, k, N), SI."""
        if self._clocked is None or self.anomaly is None:
            return hill
        _, k, cases = hill.shape
        flat = np.ascontiguousarray(hill.reshape(6, -1))
        # the true anomaly is given by time, the same for all flights at a node
        anomaly = np.repeat(self.anomaly[nodes], cases)
        return self._clocked.from_hill_frame(flat, anomaly).reshape(self.n, k, cases)

    def hill(self, x: Array) -> Array:
        """Return states (n, …) of the plant in the frame hill:BODY (6, …), SI."""
        if self._clocked is None:
            return x
        flat = np.ascontiguousarray(x.reshape(len(x), -1))
        return self._clocked.in_hill_frame(flat).reshape(6, *x.shape[1:])


def name_rungs(given: Sequence[str], plants: Sequence[Plant]) -> tuple[str, ...]:
    """Return different names of the rungs; plants given in Python are called by their class."""
    names: list[str] = []
    for name, plant in zip(given, plants, strict=True):
        plain = type(plant).__name__ if name == "(given)" else name
        count = sum(other.split(" #")[0] == plain for other in names)
        names.append(f"{plain} #{count + 1}" if count else plain)
    return tuple(names)


def describe_plant(plant: Plant) -> str:
    """Describe a plant in words: its class, its gravity model and the rotation of its moon."""
    words = [type(plant).__name__]
    if isinstance(plant, LockedMoon):
        words.append(plant.gravity_name)
    if (mode := getattr(plant, "mode", None)) is not None:
        words.append(str(mode))
    return ", ".join(words)
