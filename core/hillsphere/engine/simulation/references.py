"""References for control laws: fixed, sampled in time, or periodic."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.interfaces.loop import CommandSteps

__all__ = ["FixedReference", "PhaseReference", "SampledReference", "ZeroReference"]


class ZeroReference:
    """The reference zero, with the rows of the law's input."""

    def at(self, k: int, t_s: Array, y: Array, cases: Integers) -> Array:
        """Return zeros (q, N)."""
        return np.zeros_like(y)

    def feedforward(self, k: int, t_s: Array, cases: Integers) -> None:
        """Return None: there is no feedforward."""


class FixedReference:
    """A reference that is constant in time.

    Parameters
    ----------
    value : array_like, shape (q,) or (q, C)
        Reference common to all cases, or one column per case number, SI.
    """

    def __init__(self, value: Any) -> None:
        self.value = np.array(value, dtype=float)
        if self.value.ndim not in (1, 2):
            raise InputError(f"value must be (q,) or (q, C), got {self.value.shape}")

    def at(self, k: int, t_s: Array, y: Array, cases: Integers) -> Array:
        """Return the reference (q, N)."""
        return _of_cases(self.value, cases, "value")

    def feedforward(self, k: int, t_s: Array, cases: Integers) -> None:
        """Return None: there is no feedforward."""


class SampledReference:
    """A reference given by a table with one column per sample.

    Parameters
    ----------
    table : array_like, shape (q, K) or (q, K, C)
        Reference at each sample, common to all cases or one per case number, SI.
    feedforward : array_like, shape (p, K) or (p, K, C), optional
        Command that is added to the law's and held from sample to sample.
    steps : sequence of CommandSteps, optional
        Alternative to `feedforward`, one item per sample, for a command that changes between
        samples.
    """

    def __init__(
        self, table: Any, feedforward: Any = None, steps: Sequence[CommandSteps] | None = None
    ) -> None:
        if feedforward is not None and steps is not None:
            raise InputError("give feedforward or steps, not both")
        self.table = np.array(table, dtype=float)
        self.command = None if feedforward is None else np.array(feedforward, dtype=float)
        self.steps = None if steps is None else tuple(steps)
        for name, array in (("table", self.table), ("feedforward", self.command)):
            if array is not None and array.ndim not in (2, 3):
                raise InputError(f"{name} must be (rows, K) or (rows, K, C), got {array.shape}")

    def at(self, k: int, t_s: Array, y: Array, cases: Integers) -> Array:
        """Return the reference (q, N)."""
        return _of_cases(_of_sample(self.table, k, "table"), cases, "table")

    def feedforward(self, k: int, t_s: Array, cases: Integers) -> Array | CommandSteps | None:
        """Return the command to add, (p, N), or its steps."""
        if self.steps is not None:
            _check_sample(len(self.steps), k, "steps")
            return self.steps[k]
        if self.command is None:
            return None
        return _of_cases(_of_sample(self.command, k, "feedforward"), cases, "feedforward")


class PhaseReference:
    """A periodic reference as a function of phase.

    Parameters
    ----------
    motion : callable
        (phase (N,), cases (N,)) → reference (q, N), SI; the phase is in [0, 1).
    phase : callable
        (t_s (N,), y (q, N), cases (N,)) → (N,), in revolutions: t/T to track the motion in time, or
        the phase of the nearest point to follow its path only.
    """

    def __init__(
        self,
        motion: Callable[[Array, Integers], Array],
        phase: Callable[[Array, Array, Integers], Array],
    ) -> None:
        self._motion, self._phase = motion, phase

    def at(self, k: int, t_s: Array, y: Array, cases: Integers) -> Array:
        """Return the reference (q, N)."""
        return self._motion(np.mod(self._phase(t_s, y, cases), 1.0), cases)

    def feedforward(self, k: int, t_s: Array, cases: Integers) -> None:
        """Return None: there is no feedforward."""


def _check_sample(samples: int, k: int, name: str) -> None:
    if k >= samples:
        raise InputError(f"{name} has {samples} samples, but sample {k} was requested")


def _of_sample(table: Array, k: int, name: str) -> Array:
    _check_sample(table.shape[1], k, name)
    column: Array = table[:, k]
    return column


def _of_cases(value: Array, cases: Integers, name: str) -> Array:
    if value.ndim == 1:
        out = np.empty((len(value), len(cases)))
        out[:] = value[:, None]
        return out
    if cases.max() >= value.shape[1]:
        raise InputError(f"{name} has {value.shape[1]} cases, but case {cases.max()} was requested")
    return np.ascontiguousarray(value[:, cases])
