"""Guidance: a task, its solver and the flight that solves it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.interfaces.plant import Plant

__all__ = ["Guidance", "GuidanceTask", "GuidedFlight"]


@dataclass(frozen=True)
class GuidanceTask:
    """From where to where guidance is to plan a flight, and in which time.

    Parameters
    ----------
    start : ndarray, shape (n,)
        All states of the plant at the start, SI.
    end_position_m, end_velocity_m_s : ndarray, shape (d,)
        The plant's positions and velocities at the end, in their order.
    duration_s : float
        Length of the flight.
    time_s : float
        Time at the start.
    up : ndarray, shape (d,), or None
        Unit vector away from the ground at the end, if the flight ends on one.
    """

    start: Array
    end_position_m: Array
    end_velocity_m_s: Array
    duration_s: float
    time_s: float = 0.0
    up: Array | None = None


@dataclass(frozen=True)
class GuidedFlight:
    """A planned flight, as functions of the time since its start.

    Parameters
    ----------
    duration_s : float
        Its length.
    states : callable
        t (K,) → the plant's states (n, K), SI.
    command : callable
        t (K,) → its controls (p, K), SI, just after t where they jump.
    breaks_s : ndarray, shape (B,)
        Times between which the command is smooth, rising from 0 to the duration.
    account : str
        How it was found and how well, in a few words.
    """

    duration_s: float
    states: Callable[[Array], Array]
    command: Callable[[Array], Array]
    breaks_s: Array
    account: str = ""


@runtime_checkable
class Guidance(Contract, Protocol):
    """Plans a flight between two states of a plant, with the command that flies it.

    Where there is no such flight the method raises, a named error that says what cannot be met.
    """

    def plan(self, plant: Plant, task: GuidanceTask) -> GuidedFlight:
        """Return a flight that begins at the start and ends at the end of the task."""
        ...
