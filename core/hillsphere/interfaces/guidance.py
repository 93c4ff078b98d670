"""Guidance: the boundary-value task, its solver, and the planned flight."""

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
    """Boundary conditions and duration of a flight to be planned.

    Parameters
    ----------
    start : ndarray, shape (n,)
        All states of the plant at the start, SI.
    end_position_m, end_velocity_m_s : ndarray, shape (d,)
        Positions and velocities at the end, in the order of the plant's states.
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
    """A planned flight, as functions of the time since its start, s.

    Parameters
    ----------
    duration_s : float
        Duration of the flight.
    states : callable
        t (K,) → the plant's states (n, K), SI.
    command : callable
        t (K,) → the plant's controls (p, K), SI; at a jump, the value after it.
    breaks_s : ndarray, shape (B,)
        Times between which the command is smooth, rising from 0 to the duration.
    account : str
        Method and quality of the solution, in a few words.
    """

    duration_s: float
    states: Callable[[Array], Array]
    command: Callable[[Array], Array]
    breaks_s: Array
    account: str = ""


@runtime_checkable
class Guidance(Contract, Protocol):
    """Plans a flight between two states of a plant, with its open-loop command.

    `plan` raises a `HillsphereError` if there is no such flight; the message names the condition
    that cannot be met.
    """

    def plan(self, plant: Plant, task: GuidanceTask) -> GuidedFlight:
        """Return a flight that begins at the start and ends at the end of the task."""
        ...
