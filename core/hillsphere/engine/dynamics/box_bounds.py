"""Bounds of a system in many boxes: of rates, and of the derivatives of states and events."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics.bounds import UNWANTED, Bound
from hillsphere.engine.dynamics.enclosures import Bounded, Sides, bends_along, events_along
from hillsphere.engine.dynamics.interval_programs import RepeatedFunction
from hillsphere.engine.dynamics.intervals import Interval

__all__ = ["BoxBounds"]


class BoxBounds:
    """Bounds of a system in boxes of times, states and parameters, in its unit of time.

    Parameters
    ----------
    equations : Bounded
        The system.
    rows : int
        Number of its states.
    after : int
        Calls of a kind before it is compiled, see `RepeatedFunction`.
    """

    def __init__(self, equations: Bounded, rows: int, after: int) -> None:
        self.equations, self._rows = equations, rows
        self._rates = RepeatedFunction(self._rates_in, after)
        self._first = RepeatedFunction(self._first_in, after)
        self._derivatives = RepeatedFunction(self._derivatives_in, after)

    # A box may contain a singularity; its bounds are then infinite, which is a valid result.
    @np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore")
    def rates(self, t: Sides, y: Sides, p: Sides) -> tuple[Array, Array]:
        """Return bounds of the rates of the states (rows, K), infinite where none is known.

        Raises
        ------
        TypeError
            For an operation of which no bound is known.
        """
        low, high = self._rates(*_stack(t, y, p))
        unknown = np.isnan(low) | np.isnan(high)
        low[unknown], high[unknown] = -np.inf, np.inf
        return low, high

    @np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore")
    def event_rates(self, t: Sides, y: Sides, rates: Sides, p: Sides) -> tuple[Array, Array]:
        """Return bounds of the first derivatives of the events (E, K), NaN where none is known.

        The arguments are those of `derivatives`.
        """
        return self._first(*_stack(t, y, rates, p))

    @np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore")
    def derivatives(self, t: Sides, y: Sides, rates: Sides, p: Sides) -> tuple[Array, Array]:
        """Bound second derivatives of the states, and both derivatives of the events.

        Parameters
        ----------
        t, y, p : pair of ndarray, shape (K,), (rows, K) and (k, K)
            Ends of K boxes.
        rates : pair of ndarray, shape (rows, K)
            Bounds of the rates in them.

        Returns
        -------
        bends : ndarray, shape (rows, K)
            Largest magnitudes of the second derivatives; infinite where no bound is known.
        slopes : ndarray, shape (4, E, K)
            Lower and upper bounds of the first, then of the second derivatives of the events; NaN
            where none is known.
        """
        low, high = self._derivatives(*_stack(t, y, rates, p))
        bends = np.maximum(np.abs(low[: self._rows]), np.abs(high[: self._rows]))
        first, second = (np.split(part[self._rows :], 2) for part in (low, high))
        slopes = np.stack([first[0], second[0], first[1], second[1]])
        return np.where(np.isnan(bends), np.inf, bends), slopes

    def _rates_in(self, given: Sequence[Interval]) -> list[Interval | None]:
        y, p = given[1 : 1 + self._rows], given[1 + self._rows :]
        rates = self.equations.rates(Bound(given[0]), [Bound(part) for part in y], p)
        return [part.value for part in rates]

    def _first_in(self, given: Sequence[Interval]) -> list[Interval | None]:
        t, y, p = self._split(given)
        events = events_along(self.equations, t, y, [UNWANTED] * self._rows, p)
        return [one.rate for one in events]

    def _derivatives_in(self, given: Sequence[Interval]) -> list[Interval | None]:
        t, y, p = self._split(given)
        bends = bends_along(self.equations, t, y, p)
        events = events_along(self.equations, t, y, bends, p)
        return [*bends, *(one.rate for one in events), *(one.second for one in events)]

    def _split(
        self, given: Sequence[Interval]
    ) -> tuple[Interval, list[tuple[Interval, Interval]], Sequence[Interval]]:
        """Return time, states with their rates, and parameters."""
        first, last = 1 + self._rows, 1 + 2 * self._rows
        return given[0], [*zip(given[1:first], given[first:last], strict=True)], given[last:]


def _stack(t: Sides, *parts: Sides) -> tuple[Array, Array]:
    """Return all lower, and all upper ends."""
    low = np.concatenate([t[0][None], *(part[0] for part in parts)])
    return low, np.concatenate([t[1][None], *(part[1] for part in parts)])
