"""Bounds of rates, and of the derivatives of states and events, in boxes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.dynamics.enclosures import Bounded, bends_along, events_along
from hillsphere.engine.dynamics.interval_programs import RepeatedFunction
from hillsphere.engine.dynamics.intervals import Interval
from hillsphere.engine.simulation.regions import Boxes

__all__ = ["RegionBounds"]


class RegionBounds:
    """Bounds of a system in boxes, in its unit of time.

    Parameters
    ----------
    equations : Bounded
        The system.
    rows : int
        Number of its states.
    """

    def __init__(self, equations: Bounded, rows: int) -> None:
        self._equations, self._rows = equations, rows
        self._rates = RepeatedFunction(self._rates_in)
        self._derivatives = RepeatedFunction(self._derivatives_in)

    # A box may contain a singularity; its bounds are then infinite, which is a valid result.
    @np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore")
    def rates(self, boxes: Boxes) -> tuple[Array, Array]:
        """Return bounds of the rates of the states (rows, R)."""
        low, high = self._rates(*_stack(boxes, boxes.lo, boxes.hi))
        unknown = np.isnan(low) | np.isnan(high)
        return np.where(unknown, -np.inf, low), np.where(unknown, np.inf, high)

    @np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore")
    def derivatives(self, boxes: Boxes, low: Array, high: Array) -> tuple[Array, Array]:
        """Bound second derivatives of the states, and both derivatives of the events.

        Parameters
        ----------
        boxes : Boxes
            R boxes.
        low, high : ndarray, shape (rows, R)
            Bounds of the rates in them.

        Returns
        -------
        bends : ndarray, shape (rows, R)
            Largest magnitudes of the second derivatives; infinite where no bound is known.
        slopes : ndarray, shape (4, E, R)
            Lower and upper bounds of the first, then of the second derivatives of the events; NaN
            where none is known.
        """
        sides = [np.concatenate(part) for part in ((boxes.lo, low), (boxes.hi, high))]
        down, up = self._derivatives(*_stack(boxes, *sides))
        bends = np.maximum(np.abs(down[: self._rows]), np.abs(up[: self._rows]))
        first, second = (np.split(part[self._rows :], 2) for part in (down, up))
        slopes = np.stack([first[0], second[0], first[1], second[1]])
        return np.where(np.isnan(bends), np.inf, bends), slopes

    def _rates_in(self, given: Sequence[Interval]) -> list[Interval | None]:
        y, p = given[1 : 1 + self._rows], given[1 + self._rows :]
        rates = self._equations.rates(Bound(given[0]), [Bound(part) for part in y], p)
        return [part.value for part in rates]

    def _derivatives_in(self, given: Sequence[Interval]) -> list[Interval | None]:
        first, last = 1 + self._rows, 1 + 2 * self._rows
        y, t, p = [*zip(given[1:first], given[first:last], strict=True)], given[0], given[last:]
        bends = bends_along(self._equations, t, y, p)
        events = events_along(self._equations, t, y, bends, p)
        return [*bends, *(one.rate for one in events), *(one.second for one in events)]


def _stack(boxes: Boxes, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Return lower and upper ends of time, of `lo` and `hi`, and of the parameters."""
    return (
        np.concatenate([boxes.t_lo[None], lo, boxes.p_lo]),
        np.concatenate([boxes.t_hi[None], hi, boxes.p_hi]),
    )
