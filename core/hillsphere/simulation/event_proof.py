"""Bounds of the derivatives of all that may end a flight, over its sub-steps.

The bounds of one sub-step cost as much as some tens of sub-steps. Most of the time they need not
be sharp: they are computed for a region, a box about the state of each lane that is several times
as large as a leg, and hold for as long as the sub-steps are proved to stay inside. Only what they
cannot decide is enclosed sub-step by sub-step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics.bounds import Bound
from hillsphere.dynamics.enclosures import (
    Bounded,
    Enclosure,
    arrays,
    boxed,
    derivatives_within,
    enclose,
    growth,
)
from hillsphere.dynamics.proof import MARGIN, ROUNDING, Pieces, Slopes
from hillsphere.interfaces import Array
from hillsphere.simulation.law_bounds import LawBounds

if TYPE_CHECKING:
    from hillsphere.simulation.ends import Leg, Limit

__all__ = ["EventProof"]

_FIRST, _LEAST, _MOST = 16.0, 0.5, 64.0
"""Half width of a region in legs' movements: at first, and within which it is adapted. The first
serves sixteen legs of a steady flight; more than 64 would hardly save anything more."""

_COMMAND = 0.1
"""Least room for a command, in units of the plant's scales: a tenth of its typical attraction."""
_FADING = 0.7
"""Part of an earlier change of a held value that is still reckoned with at the next region."""
_ROUNDS = 8
"""Enlargements of a region; a region that none makes large enough serves no lane that leaves it."""


@dataclass(eq=False)
class _Region:
    """A box of states (rows, B), parameters (k, B) and times, with what is bounded in it."""

    lo: Array
    hi: Array
    p_lo: Array
    p_hi: Array
    t_lo: Array
    t_hi: Array
    rate_lo: Array
    rate_hi: Array
    slopes: Slopes
    steep: Array
    bend: Array
    used: int = 0


@dataclass(frozen=True, eq=False)
class _View:
    """A leg as its region sees it: equations, states, parameters; least room for commands."""

    bounded: Bounded
    y: Array
    p_lo: Array
    p_hi: Array
    least: Array


class EventProof:
    """Bounds for one watch.

    Parameters
    ----------
    bounded : Bounded or None
        The equations that fly, in interval arithmetic.
    events : int
        Number of the plant's events.
    limits : sequence of Limit
        Of the user; their rows follow those of the events.
    monotone : bool
        Whether a last row, the Δv at hand, follows. It never rises, so that its values at the ends
        of a sub-step decide it.
    """

    def __init__(
        self, bounded: Bounded | None, events: int, limits: Sequence[Limit], monotone: bool
    ) -> None:
        self._bounded, self._events, self._limits = bounded, events, tuple(limits)
        rows = events + len(limits)
        self.bounded_rows = np.zeros(rows + monotone, dtype=bool)
        self.margins = np.array([*[MARGIN] * events, *(q.margin for q in limits), 0.0])[
            : rows + monotone
        ]
        self._monotone = monotone
        self.budget_row = rows if monotone else None
        self.budget_rows = np.arange(rows + monotone)[:, None] == (rows if monotone else -1)
        self._factor, self._tried = _FIRST, False
        self._region: _Region | None = None
        self._last: Array | None = None
        self._reach: Array | None = None
        self._moved = np.zeros((0, 0))
        self._tube: tuple[float, Array] | None = None

    def ready(self, leg: Leg) -> None:
        """Find out, at a first leg, which rows have bounds at all."""
        if self._tried:
            return
        self._tried = True
        if self._monotone:
            self.bounded_rows[-1] = True
        if self._bounded is None:
            return
        y, p, t = leg.y[:, :1], leg.p[:, :1], leg.t[:1]
        y = np.where(np.isfinite(y), y, 0.0)
        try:
            box = enclose(self._bounded, t, 0.0 * t, y, p, y)
            when = (t, t)
            held = [(row, row) for row in p]
            low, high, _, _ = derivatives_within(self._bounded, when, box, held)
        except TypeError:  # an operation of which no bound is known
            self._bounded = None
            return
        # Of a surface without a slope nothing is known.
        self.bounded_rows[: self._events] = ~(np.isinf(low) & np.isinf(high)).any(axis=1)
        for i, limit in enumerate(self._limits, start=self._events):
            self.bounded_rows[i] = limit.lipschitz is not None

    def of_pieces(self, leg: Leg, pieces: Pieces, t: Array) -> Slopes:
        """Bound the slopes over pieces that begin at times `t` (B,) of their lanes, sharply."""
        assert self._bounded is not None
        begin, length = t[pieces.lane] + pieces.begin, pieces.end - pieces.begin
        p = leg.p[:, pieces.lane]
        box = enclose(self._bounded, begin, length, pieces.y0, p, pieces.y1)
        when = (np.minimum(begin, begin + length), np.maximum(begin, begin + length))
        held = [(row, row) for row in p]
        return self._slopes(when, box, held, ~box.holds, self._bounded)

    def _slopes(
        self,
        when: tuple[Array, Array],
        box: Enclosure,
        p: Sequence[tuple[Array, Array]],
        unknown: NDArray[np.bool_],
        bounded: Bounded,
    ) -> Slopes:
        parts = derivatives_within(bounded, when, box, p)
        rows, lanes = len(self.bounded_rows), box.lo.shape[1]
        found = np.empty((4, rows, lanes))
        found[0::2], found[1::2] = -np.inf, np.inf
        found[:, : self._events] = parts
        speed = np.maximum(np.abs(box.rate_lo), np.abs(box.rate_hi))
        for i, limit in enumerate(self._limits, start=self._events):
            if limit.lipschitz is not None:
                by = np.asarray(limit.lipschitz, dtype=float)
                most = by @ speed[: len(by)] * (1.0 + ROUNDING) + limit.drift
                found[0, i], found[1, i] = -most, most
        found[0::2][np.isnan(found[0::2])] = -np.inf
        found[1::2][np.isnan(found[1::2])] = np.inf
        if unknown.any():
            found[0::2, :, unknown], found[1::2, :, unknown] = -np.inf, np.inf
        return found[0], found[1], found[2], found[3]

    @np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore")
    def of_leg(self, leg: Leg, y: Array, h: Array) -> tuple[NDArray[np.bool_], Slopes | None]:
        """Bound the slopes over all sub-steps of a leg.

        Parameters
        ----------
        leg : Leg
            The leg.
        y : ndarray, shape (rows, steps + 1, B)
            States at the ends of its sub-steps.
        h : ndarray, shape (B,)
            Length of a sub-step.

        Returns
        -------
        holds : ndarray of bool, shape (B,)
            Lanes whose bounds are proved for the whole leg.
        slopes : Slopes or None
            Of the leg's lanes, (E, B); None if there are none.
        """
        if self._bounded is None:
            return np.zeros(len(h), dtype=bool), None
        view = self._seen(leg, y, h)
        low, high = view.y.min(axis=1), view.y.max(axis=1)
        region = self._region
        if region is not None and region.lo.shape == low.shape:
            holds = self._inside(region, leg, view, low, high, h)
            if (holds | ~leg.flying).all():
                region.used += 1
                return holds, region.slopes
            # It was left: the next one is larger, unless this one served long.
            if region.used < _MOST:
                self._factor = min(2.0 * self._factor, _MOST)
        region = self._region = self._made(leg, view, low, high)
        holds = self._inside(region, leg, view, low, high, h)
        if not (holds | ~leg.flying).all():
            self._factor = max(0.25 * self._factor, _LEAST)
            self._reach = None
        return holds, region.slopes

    def _seen(self, leg: Leg, y: Array, h: Array) -> _View:
        """Return a leg as its region sees it: under an affine law the plant and its command."""
        assert self._bounded is not None
        law = self._bounded.affine if isinstance(self._bounded, LawBounds) else None
        if law is None:
            return _View(self._bounded, y, leg.p, leg.p, np.zeros((0, 1)))
        lo, hi = law.command(y, leg.p, float(np.max(np.abs(h))))
        kept, plant = leg.p[: law.plant.parameters], law.plant.plant
        least = _COMMAND * plant.plant.scales.of(plant.plant.controls)[:, None]
        rows = y[: len(plant.unit)]
        return _View(law.plant, rows, np.concatenate([kept, lo]), np.concatenate([kept, hi]), least)

    def _made(self, leg: Leg, view: _View, low: Array, high: Array) -> _Region:
        """Return a region about a leg, enlarged until the leg's sub-steps stay in it."""
        y, bounded = view.y, view.bounded
        factor, t, h = self._factor, leg.t, leg.period / (y.shape[1] - 1)
        spread = factor * np.max(np.abs(y - y[:, :1]), axis=1)
        spread += 1e-9 * np.maximum(np.abs(low), np.abs(high)) + 1e-300
        if self._reach is not None and self._reach.shape == spread.shape:
            spread = np.fmax(spread, 0.5 * self._reach)
        p, moved = 0.5 * (view.p_lo + view.p_hi), np.zeros_like(view.p_lo)
        if self._last is not None and self._last.shape == p.shape:
            # What is held changes at samples only: remember how much, and forget it slowly.
            now = np.maximum(np.abs(p - self._last), _FADING * self._moved)
            self._moved, moved = now, 2.0 * now
        else:
            self._moved = moved
        self._last = p.copy()
        p_lo, p_hi = view.p_lo - moved, view.p_hi + moved
        if count := len(view.least):
            room = np.maximum(np.maximum(np.abs(view.p_lo), np.abs(view.p_hi))[-count:], view.least)
            p_lo[-count:] -= room
            p_hi[-count:] += room
        ahead = (1.0 + factor) * leg.period
        when = (np.minimum(t, t + ahead), np.maximum(t, t + ahead))
        held = list(zip(p_lo, p_hi, strict=True))
        for _ in range(_ROUNDS):
            lo, hi = low - spread, high + spread
            low_rate, high_rate = arrays(bounded.rates(Bound(when), boxed(lo, hi), held), lo)
            down, up = self._reached(bounded, low_rate, high_rate, h)
            out = (low + down < lo) | (high + up > hi)
            # Half of the room is left for where the flight goes in later legs.
            self._reach = 2.0 * np.maximum(up, -down)
            if not (out.any(axis=0) & leg.flying).any():
                break
            spread = np.where(out, np.fmax(spread, self._reach), spread)
        if self._reach is not None:
            self._reach[~np.isfinite(self._reach)] = 0.0
        box = Enclosure(lo, hi, low_rate, high_rate, np.ones(lo.shape[1], dtype=bool))
        slopes = self._slopes(when, box, held, np.zeros(lo.shape[1], dtype=bool), bounded)
        a, b, _c, d = slopes
        return _Region(
            lo, hi, p_lo, p_hi, *when, low_rate, high_rate, slopes,
            0.5 * np.maximum(np.abs(a), np.abs(b)), np.maximum(d, 0.0) * 0.125,
        )  # fmt: skip

    def _reached(self, bounded: Bounded, low: Array, high: Array, h: Array) -> tuple[Array, Array]:
        """Return how far states may move in a sub-step, down and up (rows, B)."""
        a, b = h * low, h * high
        down, up = np.minimum(np.minimum(a, b), 0.0), np.maximum(np.maximum(a, b), 0.0)
        linear = bounded.linear
        if linear is not None:
            rows = slice(linear.first, linear.first + len(linear.matrix))
            fastest = np.maximum(np.abs(low[rows]), np.abs(high[rows]))
            up[rows] = self._growth(linear.matrix, float(np.max(np.abs(h)))) @ fastest
            down[rows] = -up[rows]
        return down, up

    def _inside(
        self, region: _Region, leg: Leg, view: _View, low: Array, high: Array, h: Array
    ) -> NDArray[np.bool_]:
        """Say of which lanes all solutions of the leg's sub-steps stay in the region."""
        down, up = self._reached(view.bounded, region.rate_lo, region.rate_hi, h)
        # Rounding of these sums is far below the region's own margin of 1e-9.
        inside: NDArray[np.bool_] = (
            ((low + down >= region.lo) & (high + up <= region.hi)).all(axis=0)
            & ((view.p_lo >= region.p_lo) & (view.p_hi <= region.p_hi)).all(axis=0)
            & (leg.t >= region.t_lo)
            & (leg.t + leg.period <= region.t_hi)
        )
        return inside

    def _growth(self, matrix: Array, h: float) -> Array:
        known = self._tube
        if known is None or not h <= known[0] <= (1.0 + 2e-6) * h:
            # Steps of one length differ by rounding: the bound is that of one a little longer.
            h *= 1.0 + 1e-6
            self._tube = known = (h, growth(matrix, h))
        return known[1]

    @np.errstate(invalid="ignore", over="ignore")
    def is_far(self, least: Array, h: Array, flying: NDArray[np.bool_]) -> bool:
        """Say whether values of at least `least` (E, B) stay positive over steps h (B,)."""
        region = self._region
        assert region is not None
        w = np.abs(h)
        need = np.fmin(region.steep * w, region.bend * (w * w)) + ROUNDING * (1.0 + np.abs(least))
        far: NDArray[np.bool_] = least > need
        done = bool((far | ~self.bounded_rows[:, None] | ~flying).all())
        if not done and region.used:
            # Perhaps it is only too large: the next leg gets a smaller one.
            self._factor, self._region, self._reach = max(0.5 * self._factor, _LEAST), None, None
        return done
