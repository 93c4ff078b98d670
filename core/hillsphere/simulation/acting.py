"""What a law does at a sample: held, as an impulse, or through its compiled equations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hillsphere.dynamics import ArrayFunction
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Compensator
from hillsphere.simulation.flow import thrust_vectors
from hillsphere.simulation.protocols import Actuator, ContinuousLaw

__all__ = ["Act", "ByEquations", "ByHold", "ByImpulse", "Done", "Extra", "magnitude"]


@dataclass(frozen=True)
class Done:
    """What a sample did to a block.

    Parameters
    ----------
    y : ndarray, shape (rows, B)
        State after it.
    command, done : ndarray, shape (p, B)
        What was asked of the actuator, and what it did.
    spent : ndarray, shape (B,), or None
        Δv spent at once; None for none.
    rate : ndarray, shape (B,), or None
        Δv spent per second until the next sample; None if a state of the system counts it.
    """

    y: Array
    command: Array
    done: Array
    spent: Array | None
    rate: Array | None


@dataclass(frozen=True)
class Extra:
    """Feedforward (p, B) or (p, 1) or None, and normal numbers (noise, B) of the actuator."""

    feedforward: Array | None
    w: Array


class Act(Protocol):
    """A law at work on one block; holds its memory there and the parameters of the flight."""

    p: Array
    """Run-time parameters of the system that flies, (k, B)."""
    counts: bool
    """Whether the last state of that system is the Δv spent."""

    def begin(self, x: Array) -> Array:
        """Return the state of the system that flies for states x (n, B) of the plant."""
        ...

    def at(self, k: int, t: Array, y: Array, seen: Array, ref: Array, extra: Extra) -> Done:
        """Act at sample k."""
        ...


class _ByCompensator:
    """What held and impulsive actuation share."""

    counts = False

    def __init__(
        self, law: Compensator, actuator: Actuator | None, gain: Array | None, rows: int, width: int
    ) -> None:
        self._law, self._actuator, self._gain, self._rows = law, actuator, gain, rows
        self._xc = law.initial(width)

    def begin(self, x: Array) -> Array:
        """Return the states."""
        return x

    def _acted(
        self, k: int, t: Array, seen: Array, ref: Array, extra: Extra
    ) -> tuple[Array, Array]:
        command, self._xc = self._law.step(k, t, seen, ref, self._xc)
        if command.shape != (self._rows, len(t)):
            what = "velocities" if self._law.actuation == "impulse" else "controls"
            raise InputError(
                f"{type(self._law).__name__} commands {command.shape}; the plant has "
                f"{self._rows} {what} and {len(t)} lanes"
            )
        if extra.feedforward is not None:
            command = command + extra.feedforward
        done = command if self._actuator is None else self._actuator.execute(command, extra.w)
        if self._gain is not None:
            done = np.einsum("ijN,jN->iN", self._gain, done)
        return command, done


class ByHold(_ByCompensator):
    """Commands held until the next sample, as the last run-time parameters of the plant."""

    def __init__(
        self,
        law: Compensator,
        actuator: Actuator | None,
        gain: Array | None,
        p: Array,
        rows: int,
        width: int,
    ) -> None:
        super().__init__(law, actuator, gain, rows, width)
        self.p = np.concatenate([p, np.zeros((rows, width))])
        self._held = slice(len(p), len(p) + rows)

    def at(self, k: int, t: Array, y: Array, seen: Array, ref: Array, extra: Extra) -> Done:
        """Hold what the law says."""
        command, done = self._acted(k, t, seen, ref, extra)
        self.p[self._held] = done
        return Done(y, command, done, None, magnitude(done))


class ByImpulse(_ByCompensator):
    """Commands added to the velocities."""

    def __init__(
        self,
        law: Compensator,
        actuator: Actuator | None,
        gain: Array | None,
        p: Array,
        velocities: list[int],
        width: int,
    ) -> None:
        super().__init__(law, actuator, gain, len(velocities), width)
        self.p = p
        self._velocities = velocities
        self._idle = np.zeros(width)

    def at(self, k: int, t: Array, y: Array, seen: Array, ref: Array, extra: Extra) -> Done:
        """Change the velocities by what the law says."""
        command, done = self._acted(k, t, seen, ref, extra)
        after = y.copy()
        after[self._velocities] += done
        return Done(after, command, done, magnitude(done), self._idle)


class ByEquations:
    """A continuous law: at a sample its measurement and reference are renewed."""

    counts = True

    def __init__(
        self,
        law: ContinuousLaw,
        command: ArrayFunction,
        gain: Array | None,
        p: Array,
        controls: int,
        width: int,
    ) -> None:
        self._law, self._command, self._controls = law, command, controls
        held = law.inputs if law.measurement == "held" else 0
        if gain is None:
            gain = np.repeat(np.eye(controls)[:, :, None], width, axis=2)
        self._feed = slice(len(p), len(p) + controls)
        first = len(p) + controls + controls**2
        self._ref = slice(first, first + law.inputs)
        self._seen = slice(first + law.inputs, first + law.inputs + held)
        self._held = bool(held)
        self.p = np.concatenate(
            [
                p,
                np.zeros((controls, width)),
                gain.reshape(controls**2, width),
                np.zeros((law.inputs + held, width)),
            ]
        )

    def begin(self, x: Array) -> Array:
        """Return the states of plant and law, and the effort, zero."""
        width = x.shape[1]
        return np.concatenate([x, self._law.initial(width), np.zeros((1, width))])

    def at(self, k: int, t: Array, y: Array, seen: Array, ref: Array, extra: Extra) -> Done:
        """Renew what the law sees."""
        law, q = self._law, self._law.inputs
        if seen.shape[0] != q or ref.shape[0] != q:
            raise InputError(
                f"{type(law).__name__} takes {q} inputs; navigation gives {seen.shape[0]}, the "
                f"reference {ref.shape[0]}"
            )
        m = len(law.states)
        own = y[-1 - m : -1]
        renewed = law.sample(k, t, seen, ref, own)
        if renewed is not own:
            y = y.copy()
            y[-1 - m : -1] = renewed
        if extra.feedforward is not None:
            self.p[self._feed] = extra.feedforward
        self.p[self._ref] = ref
        if self._held:
            self.p[self._seen] = seen
        command = self._command(y, self.p, t)[: self._controls]
        return Done(y, command, command, None, None)


def magnitude(u: Array) -> Array:
    """Return the size (B,) of commands u (p, B): the sum over the thrust vectors."""
    if not len(u):
        return np.zeros(u.shape[1])
    squares, vectors = u * u, thrust_vectors(len(u))
    if vectors == 1:
        size: Array = np.sqrt(np.add.reduce(squares, axis=0))
    else:
        each = squares.reshape(vectors, -1, u.shape[1])
        size = np.sum(np.sqrt(np.sum(each, axis=1)), axis=0)
    return size
