"""Actuation of a law: held commands, impulses, or a continuous law's compiled equations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.simulation.flow import thrust_vectors
from hillsphere.interfaces.control import Compensator
from hillsphere.interfaces.loop import Actuator, CommandSteps, ContinuousLaw

__all__ = ["Act", "ByEquations", "ByHold", "ByImpulse", "Done", "Extra", "Later", "magnitude"]


@dataclass(frozen=True)
class Later:
    """A later part of a period, in which another command is held.

    Parameters
    ----------
    begin, end : float
        Fractions of the period at which it begins and ends.
    value : ndarray, shape (p, B) or (p, 1)
        Command for `Act.hold`.
    rate : ndarray, shape (B,), or None
        As in `Done`.
    """

    begin: float
    end: float
    value: Array
    rate: Array | None


@dataclass(frozen=True)
class Done:
    """Result of a sample for a block.

    Parameters
    ----------
    y : ndarray, shape (rows, B)
        State after the sample.
    own, command, done : ndarray, shape (p, B)
        The law's command without feedforward; the command to the actuator, with the mean of the
        feedforward over the period; and the executed command.
    spent : ndarray, shape (B,), or None
        Δv of an impulse, m/s; None without one.
    rate : ndarray, shape (B,), or None
        Δv spent per second from the sample on, m/s²; None if a state of the system integrates it.
    later : tuple of Later
        Further parts of the period, in order; `rate` is valid until the first of them begins.
    """

    y: Array
    own: Array
    command: Array
    done: Array
    spent: Array | None
    rate: Array | None
    later: tuple[Later, ...] = ()


@dataclass(frozen=True)
class Extra:
    """Feedforward (p, B) or (p, 1), in steps or None; normal numbers (noise, B) of the actuator."""

    feedforward: Array | CommandSteps | None
    w: Array


class Act(Protocol):
    """A law that acts on one block, with its states and the run-time parameters of the flight."""

    p: Array
    """Run-time parameters of the propagated system, (k, B)."""
    counts: bool
    """Whether the last state of that system is the spent Δv."""

    def begin(self, x: Array) -> Array:
        """Return the initial state of the propagated system for states x (n, B) of the plant."""
        ...

    def at(self, k: int, t: Array, y: Array, seen: Array, ref: Array, extra: Extra) -> Done:
        """Apply the law at sample k."""
        ...

    def hold(self, value: Array) -> None:
        """Set the command that is held in a later part of the period."""
        ...

    @property
    def own_along(self) -> Callable[[Array, Array, Array], Array] | None:
        """The law's command without feedforward, (p, N); None if it changes at samples only.

        A function of times (N,), states (rows, N) and run-time parameters (k, N).
        """
        ...


class _ByCompensator:
    """Common part of held and impulsive actuation."""

    counts = False
    own_along = None

    def __init__(
        self, law: Compensator, actuator: Actuator | None, gain: Array | None, rows: int, width: int
    ) -> None:
        self._law, self._actuator, self._gain, self._rows = law, actuator, gain, rows
        self._xc = law.initial(width)

    def begin(self, x: Array) -> Array:
        """Return the states."""
        return x

    def _own(self, k: int, t: Array, seen: Array, ref: Array) -> Array:
        """Return the law's command, after a check of its shape."""
        command, self._xc = self._law.step(k, t, seen, ref, self._xc)
        if command.shape != (self._rows, len(t)):
            what = "velocities" if self._law.actuation == "impulse" else "controls"
            raise InputError(
                f"{type(self._law).__name__} commands {command.shape}; the plant has "
                f"{self._rows} {what} and {len(t)} lanes"
            )
        return command

    def _did(self, command: Array, w: Array) -> Array:
        """Return the executed command; execution errors apply to the total command."""
        done = command if self._actuator is None else self._actuator.execute(command, w)
        return done if self._gain is None else np.einsum("ijN,jN->iN", self._gain, done)


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
        """Hold the law's command."""
        own, feed = self._own(k, t, seen, ref), extra.feedforward
        if isinstance(feed, CommandSteps):
            done = self._did(own + feed.u[0], extra.w)
            self.p[self._held] = done
            rest = [self._did(own + u, extra.w) for u in feed.u[1:]]
            later = _later(feed, rest, [magnitude(one) for one in rest])
            return Done(y, own, own + feed.mean(), done, None, magnitude(done), later)
        command = own if feed is None else own + feed
        done = self._did(command, extra.w)
        self.p[self._held] = done
        return Done(y, own, command, done, None, magnitude(done))

    def hold(self, value: Array) -> None:
        """Hold another command."""
        self.p[self._held] = value


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

    @property
    def memory(self) -> Array:
        """The law's states, which it replaces but never changes."""
        return self._xc

    @memory.setter
    def memory(self, states: Array) -> None:
        self._xc = states

    def at(self, k: int, t: Array, y: Array, seen: Array, ref: Array, extra: Extra) -> Done:
        """Add the law's impulse to the velocities."""
        own, feed = self._own(k, t, seen, ref), extra.feedforward
        if isinstance(feed, CommandSteps):
            raise InputError(
                "the reference's command changes between samples; an impulse cannot do that"
            )
        command = own if feed is None else own + feed
        done = self._did(command, extra.w)
        after = y.copy()
        after[self._velocities] += done
        return Done(after, own, command, done, magnitude(done), self._idle)

    def hold(self, value: Array) -> None:
        """Do nothing, since no command is held."""


class ByEquations:
    """A continuous law, whose measurement and reference are updated at samples."""

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
        """Return the states of plant and law, and the effort, which is zero."""
        width = x.shape[1]
        return np.concatenate([x, self._law.initial(width), np.zeros((1, width))])

    def at(self, k: int, t: Array, y: Array, seen: Array, ref: Array, extra: Extra) -> Done:
        """Update the measurement and reference of the law."""
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
        feed = extra.feedforward
        later: tuple[Later, ...] = ()
        to_mean: Array | float = 0.0
        if isinstance(feed, CommandSteps):
            later = _later(feed, feed.u[1:], [None] * len(feed.u[1:]))
            to_mean = feed.mean() - feed.u[0]
            feed = feed.u[0]
        if feed is not None:
            self.p[self._feed] = feed
        self.p[self._ref] = ref
        if self._held:
            self.p[self._seen] = seen
        done = self._command(y, self.p, t)[: self._controls]
        own = done if feed is None else done - self.p[self._feed]
        command = done + to_mean if later else done
        return Done(y, own, command, done, None, None, later)

    def hold(self, value: Array) -> None:
        """Change the feedforward."""
        self.p[self._feed] = value

    def own_along(self, t: Array, y: Array, p: Array) -> Array:
        """Return the law's command without feedforward, see `Act`."""
        p = p.copy()
        p[self._feed] = 0.0  # without feedforward, which may change between samples
        return self._command(y, p, t)[: self._controls]


def _later(
    feed: CommandSteps, values: Sequence[Array] | Array, rates: Sequence[Array | None]
) -> tuple[Later, ...]:
    """Return the parts of a period after the first step, with the commands held in them."""
    ends = np.cumsum(feed.shares).tolist()
    ends[-1] = 1.0
    return tuple(map(Later, ends[:-1], ends[1:], values, rates))


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
