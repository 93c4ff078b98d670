r"""Where the frame of a plant stands among the stars along a flight, and states turned by it.

With the axes A of the frame (columns, ICRF), its angular velocity ω along its own axes, and a
centre at c with the inertial velocity w along the axes, an inertial state about the centre is

.. math:: r' = A (r - c), \quad v' = A (v + \omega\times r - w) .
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.base.errors import InputError
from hillsphere.base.time import Epoch

__all__ = ["FrameMotion", "PlacedPlant", "craft_rows", "epoch_of", "frame_motion", "turn_about_z"]

_STATES = ("x", "y", "z", "vx", "vy", "vz")
"""Names of the states of one spacecraft; of several they end with its number."""


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """A frame at K times.

    Parameters
    ----------
    axes : ndarray, shape (3, 3, K)
        Axes as columns, in the inertial axes `axes_name`.
    rate : ndarray, shape (3, K)
        Angular velocity along the frame's own axes, rad/s.
    centres : mapping of str to ndarray, shape (6, K)
        Bodies: position in the frame, m, and inertial velocity along its axes, m/s; the body at
        the origin first.
    axes_name : str
        Name of the inertial axes in messages.
    """

    axes: Array
    rate: Array
    centres: Mapping[str, Array]
    axes_name: str = "ICRF"

    def centre(self, name: str | None) -> str:
        """Return the name of a centre, by default the one at the origin.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        if name is None:
            return next(iter(self.centres))
        for one in self.centres:
            if one.lower() == name.lower():
                return one
        raise InputError(f"centre: must be {' or '.join(self.centres)}, got {name}")

    def to_inertial(self, x: Array, centre: str | None = None) -> Array:
        """Return inertial states (6, K) about a centre, of states (6, K) in the frame."""
        c = self.centres[self.centre(centre)]
        place = x[:3] - c[:3]
        speed = x[3:6] + np.cross(self.rate, x[:3], axis=0) - c[3:]
        return np.concatenate([np.einsum("ijn,jn->in", self.axes, q) for q in (place, speed)])

    def from_inertial(self, x: Array, centre: str | None = None) -> Array:
        """Return states (6, K) in the frame; the inverse of `to_inertial`."""
        c = self.centres[self.centre(centre)]
        place, speed = (np.einsum("jin,jn->in", self.axes, q) for q in (x[:3], x[3:6]))
        place = place + c[:3]
        return np.concatenate([place, speed + c[3:] - np.cross(self.rate, place, axis=0)])


@runtime_checkable
class PlacedPlant(Contract, Protocol):
    """A plant that knows how its frame stands among the stars along a flight."""

    def frame_motion(self, epoch: Epoch, t_s: Array, others: Mapping[str, Array]) -> FrameMotion:
        """Return the frame at times (K,), s after an epoch, K ≥ 1, the first one the start.

        `others` are the states that are neither position nor velocity at these times, by name.
        """
        ...

    def others_over_time(self, start: Mapping[str, float], t_s: Array) -> Mapping[str, Array]:
        """Return these other states (K,) at times after their values at the first time, by name."""
        ...


def frame_motion(
    plant: object, epoch: Epoch, t_s: Array, others: Mapping[str, Array]
) -> FrameMotion:
    """Return where the frame of a plant stands at times after an epoch.

    Parameters
    ----------
    plant : object
        A `PlacedPlant`.
    epoch : Epoch
        Origin of the times.
    t_s : ndarray, shape (K,)
        Times, s.
    others : mapping of str to ndarray, shape (K,)
        States that are neither position nor velocity, by name.

    Raises
    ------
    InputError
        If the plant does not know its frame among the stars: the message names the missing key.
    """
    if not isinstance(plant, PlacedPlant):
        raise InputError(
            f"plant: {type(plant).__name__} does not say how its frame stands among the stars, "
            "which an ephemeris in inertial axes needs"
        )
    return plant.frame_motion(epoch, np.atleast_1d(np.asarray(t_s, dtype=float)), others)


def epoch_of(plant: object, epoch: str | Epoch | None, scale: str = "TDB") -> Epoch:
    """Return the instant of time 0 of a flight: the one given, or else that of the plant's clock.

    Raises
    ------
    InputError
        If neither is known, or the text is no date.
    """
    if isinstance(epoch, Epoch):
        return epoch
    own = getattr(plant, "epoch", None)
    if epoch is None and own is None:
        raise InputError(
            "epoch: the times of a flight count from an instant that it does not know; give it, "
            "such as epoch = '2027-06-01T00:00:00'"
        )
    try:
        if epoch is not None:
            return Epoch.parse(epoch, scale)
        return own.to(scale) if isinstance(own, Epoch) else Epoch.parse(str(own), "TDB").to(scale)
    except InputError as error:
        raise InputError(f"epoch: {error}") from error


def craft_rows(states: tuple[str, ...]) -> list[list[int]]:
    """Return the six rows of each spacecraft among the states of a plant.

    Raises
    ------
    InputError
        If there are no positions and velocities in space.
    """
    if all(name in states for name in _STATES):
        return [[states.index(name) for name in _STATES]]
    rows: list[list[int]] = []
    while all(f"{name}{len(rows) + 1}" in states for name in _STATES):
        rows.append([states.index(f"{name}{len(rows) + 1}") for name in _STATES])
    if not rows:
        raise InputError(
            f"an ephemeris message needs the states {', '.join(_STATES)}, got {', '.join(states)}"
        )
    return rows


def turn_about_z(axes: Array, angle: Array) -> Array:
    """Return axes (3, 3, K): those given (3, 3) turned by angles (K,) about their z."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = (axes[:, k, None] for k in range(3))
    return np.stack([x * c + y * s, y * c - x * s, np.broadcast_to(z, (3, angle.size))], axis=1)
