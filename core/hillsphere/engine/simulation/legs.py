"""Data of the flight between two samples: legs, their parts and ends, and limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.engine.dynamics.proof import MARGIN
from hillsphere.engine.simulation.outcomes import STATUSES

__all__ = ["BLOCK", "End", "Held", "Leg", "Limit", "Nodes", "Sample", "Unproved"]

BLOCK = 64
"""Lanes that go through the loop together, always: another width would give other last bits."""


@dataclass(frozen=True)
class Limit:
    r"""A condition that ends a flight when it falls through zero.

    Parameters
    ----------
    name : str
        Shown as the cause.
    value : callable
        (t_s (N,), x (n, N), cases (N,)) → (N,), continuous along the flight. x are the plant's true
        states, SI; cases are the numbers of the cases, by which limits can differ.
    status : str
        One of `STATUSES`.
    lipschitz : array_like, shape (n,), optional
        Constants L with :math:`|v(t, x) - v(t, x')| \le \sum_i L_i |x_i - x'_i|`, per unit of each
        state of the plant. With them the limit is proved between the ends of sub-steps.
    drift : float
        Largest rate of change of the value with time at constant states, 1/s.
    margin : float
        Without `lipschitz`: a flight whose value falls below this at the end of a sub-step, and
        which does not end by this limit, is ``unresolved``.
    """

    name: str
    value: Callable[[Array, Array, Integers], Array]
    status: str = "constraint"
    lipschitz: ArrayLike | None = None
    drift: float = 0.0
    margin: float = MARGIN

    def __post_init__(self) -> None:
        if self.status not in STATUSES:
            raise InputError(f"status must be one of {', '.join(STATUSES)}, got {self.status!r}")
        # A bound that is negative proves anything, one that is no number nothing.
        if not (self.drift >= 0.0 and self.margin >= 0.0):
            raise InputError(
                f"limit {self.name!r}: drift and margin must be ≥ 0, got {self.drift} and "
                f"{self.margin}"
            )
        if self.lipschitz is not None:
            slopes = np.asarray(self.lipschitz, dtype=float)
            if slopes.ndim != 1 or not (slopes >= 0.0).all():
                raise InputError(
                    f"limit {self.name!r}: lipschitz must be a number ≥ 0 for each state, "
                    f"got {self.lipschitz!r}"
                )

    @property
    def bound(self) -> tuple[object, ...]:
        """Lipschitz constants, drift and margin, by which limits are compared."""
        slopes = None
        if self.lipschitz is not None:
            slopes = tuple(np.asarray(self.lipschitz, dtype=float).tolist())
        return slopes, self.drift, self.margin


@dataclass(frozen=True)
class Leg:
    """A block between two samples, or in a part of this time with a held command.

    Parameters
    ----------
    t, y : ndarray, shape (B,), (rows, B)
        Time and state at its start.
    period : ndarray, shape (B,)
        Duration, s.
    p : ndarray, shape (k, B)
        Run-time parameters.
    cases : ndarray of int, shape (B,)
        Numbers of the cases.
    flying : ndarray of bool, shape (B,)
        Lanes that still fly.
    whole : bool
        Whether all lanes fly.
    left, rate : ndarray, shape (B,), or None
        Remaining Δv at the start, m/s, None without a budget; and Δv spent per second, None if the
        last state integrates it.
    within : ndarray, shape (B,), or None
        Time between the samples, if the leg is a part of it.
    """

    t: Array
    y: Array
    period: Array
    p: Array
    cases: Integers
    flying: NDArray[np.bool_]
    whole: bool = False
    left: Array | None = None
    rate: Array | None = None
    within: Array | None = None

    @property
    def sample(self) -> Array:
        """Time between the samples (B,)."""
        return self.period if self.within is None else self.within

    def frozen(self, y: Array) -> Array:
        """Return states y (rows, B), with the initial ones in lanes that do not fly."""
        return y if self.whole else np.where(self.flying, y, self.y)

    def taken(self, lanes: Integers) -> Leg:
        """Return the leg with some of its lanes, which may be repeated."""
        return Leg(
            self.t[lanes], self.y[:, lanes], self.period[lanes],
            np.ascontiguousarray(self.p[:, lanes]), self.cases[lanes], self.flying[lanes],
            self.whole,
            None if self.left is None else self.left[lanes],
            None if self.rate is None else self.rate[lanes],
            None if self.within is None else self.within[lanes],
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Held:
    """A part of the time between two samples, in which a command is held.

    Parameters
    ----------
    t, period : ndarray, shape (B,)
        Its start and duration, s.
    p : ndarray, shape (k, B)
        Run-time parameters.
    rate : ndarray, shape (B,), or None
        Δv spent per second, None if the last state integrates it.
    steps : int
        Sub-steps.
    """

    t: Array
    period: Array
    p: Array
    rate: Array | None
    steps: int

    @property
    def times(self) -> Array:
        """Times at the ends of the sub-steps (steps + 1, B), the start first."""
        return self.t + np.arange(self.steps + 1)[:, None] * (self.period / self.steps)

    @property
    def end(self) -> Array:
        """Time at its end (B,)."""
        return self.t + self.steps * (self.period / self.steps)


@dataclass(frozen=True, eq=False)
class Sample:
    """The flight from one sample to the next, through all parts.

    Parameters
    ----------
    y, t : ndarray, shape (rows, B), (B,)
        State and time at its end.
    errors : list of ndarray, shape (B,)
        Sums of the estimated errors of the steps of each part.
    nodes : list of ndarray, shape (rows, S + 1, B)
        States at the ends of the S sub-steps of each part, the start first.
    """

    y: Array
    t: Array
    errors: list[Array]
    nodes: list[Array]


@dataclass(frozen=True)
class End:
    """End of a leg: the states of all lanes, and the causes of flights that ended in it.

    Parameters
    ----------
    y : ndarray, shape (rows, B)
        State at the end of the leg, or of the flight.
    t : ndarray, shape (B,)
        Time of this state, s.
    cause : ndarray of int, shape (B,), or None
        None if every flying lane reached the end of the leg. Otherwise, for each lane: −1 if it
        did; `Watch.diverged` if its state became non-finite; the row of `Watch` of the event that
        ended it; or `Watch.unresolved` of that row if the event could not be decided.
    doubtful : ndarray of int, shape (B,), or None
        Row of an event without a bound on its rate whose value came closer to zero than its
        margin, or −1; None if there is none. The flight continues, and is unresolved unless that
        same event ends it.
    error : ndarray, shape (B,), or None
        Sum of the estimated errors of the steps, in units of the system's scale.
    nodes : ndarray, shape (rows, S + 1, B), or None
        States at the ends of the S sub-steps, the start first; they continue after the end of a
        flight that ended in between.
    unproved : Unproved or None
        The leg, if only its ends show that it ends no flight.
    """

    y: Array
    t: Array
    cause: Integers | None
    doubtful: Integers | None = None
    error: Array | None = None
    nodes: Array | None = None
    unproved: Unproved | None = None


@dataclass(frozen=True, eq=False)
class Unproved:
    """A leg of which it is not yet proved that no flight ends in it.

    Parameters
    ----------
    leg : Leg
        The leg.
    h : ndarray, shape (B,)
        Length of its sub-steps.
    y : ndarray, shape (rows, steps + 1, B)
        States at their ends, finite.
    """

    leg: Leg
    h: Array
    y: Array

    def taken(self, lanes: Integers) -> Unproved:
        """Return some of its lanes."""
        return Unproved(self.leg.taken(lanes), self.h[lanes], self.y[:, :, lanes])

    @staticmethod
    def joined(parts: Sequence[Unproved]) -> Unproved:
        """Return legs of equally many sub-steps as one leg, with all their lanes."""

        def row(name: str) -> Any:
            rows = [getattr(part.leg, name) for part in parts]
            return None if rows[0] is None else np.concatenate(rows, axis=-1)

        leg = Leg(
            row("t"), row("y"), row("period"), row("p"), row("cases"), row("flying"), False,
            row("left"), row("rate"), row("within"),
        )  # fmt: skip
        return Unproved(
            leg,
            np.concatenate([part.h for part in parts]),
            np.concatenate([part.y for part in parts], axis=-1),
        )


@dataclass(frozen=True, eq=False)
class Nodes:
    """A propagated leg, by the states at the ends of its sub-steps.

    Parameters
    ----------
    leg : Leg
        The leg.
    h : ndarray, shape (B,)
        Length of the sub-steps.
    y : ndarray, shape (rows, steps + 1, B)
        States at their ends.
    values : ndarray, shape (E, steps + 1, B)
        Events there.
    """

    leg: Leg
    h: Array
    y: Array
    values: Array
