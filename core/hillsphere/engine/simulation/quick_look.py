"""A quick look at what was flown: whether each lane stays where bounds already exclude an event."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.engine.dynamics.proof import ROUNDING
from hillsphere.engine.simulation.command_bounds import AffineLaw
from hillsphere.engine.simulation.legs import Held, Leg
from hillsphere.engine.simulation.regions import Boxes, Columns, Regions, Store, Tube

__all__ = ["QuickLook"]

_PAUSE = 64
"""Most looks during which no new region is tried after several in a row were of no use: then a lane
is near an event, and a region costs as much as some ten decisions without it."""

Flags = NDArray[np.bool_]


@dataclass(eq=False)
class _Known:
    """The region of each lane, for flights of a duration.

    Parameters
    ----------
    duration : float
        Longest flight.
    middle, half : ndarray, shape (rows, B)
        Where it must begin. NaN where a lane has no region.
    p_middle, p_half : ndarray, shape (k, B)
        Where its parameters must be.
    t_lo, t_hi : ndarray, shape (B,)
        When it must take place.
    need, fall : ndarray, shape (E, B)
        What the events at both ends must exceed; the same if parameters may jump in between.
    """

    duration: float
    middle: Array
    half: Array
    p_middle: Array
    p_half: Array
    t_lo: Array
    t_hi: Array
    need: Array
    fall: Array

    def put(self, lanes: Integers, other: _Known) -> None:
        """Take over the regions of some lanes."""
        for name in ("middle", "half", "p_middle", "p_half", "t_lo", "t_hi", "need", "fall"):
            getattr(self, name)[..., lanes] = getattr(other, name)


class QuickLook:
    """What is known of each lane from the legs before.

    Parameters
    ----------
    store : Store
        Regions.
    rows : ndarray of int
        Events with bounds.
    states : slice
        Which of the states that fly regions have.
    tube : callable or None
        Tube of the states of a linear law.
    law : AffineLaw or None
        Whose commands are run-time parameters of the regions.
    fixed : int
        Number of the first run-time parameters, which do not change during a flight.
    timeless : bool
        Whether the bounds hold at any time.
    """

    def __init__(
        self,
        store: Store,
        rows: Integers,
        states: slice,
        tube: Tube | None,
        law: AffineLaw | None,
        fixed: int,
        timeless: bool,
    ) -> None:
        self._store, self._rows, self._states, self._tube = store, rows, states, tube
        self._law, self._fixed, self._timeless = law, fixed, timeless
        self._long: _Known | None = None
        self._short: _Known | None = None
        # The cases whose fixed parameters were compared with regions, and which lanes agreed.
        self._asked: tuple[Integers, _Known] | None = None
        self._agreed: Flags = np.zeros(0, dtype=bool)
        self._pause = self._left = 0

    def is_far(
        self,
        leg: Leg,
        parts: Sequence[Held],
        begins: Sequence[Array],
        before: Array,
        after: Array,
    ) -> bool:
        """Return whether known regions exclude a zero of every event between two samples.

        Parameters
        ----------
        leg : Leg
            The first interval in which a command is held.
        parts : sequence of Held
            All such intervals between the two samples.
        begins : sequence of ndarray, shape (rows, B)
            States at the start of each interval; finite.
        before, after : ndarray, shape (E, B)
            Event values at the first and at the second sample.
        """
        period = leg.period if len(parts) == 1 else leg.sample
        flight = _Flight(leg, period, parts, begins, np.minimum(before, after))
        known = self._long
        if known is None or known.middle.shape[1] != len(leg.t):
            failing = leg.flying
        else:
            failing = leg.flying & ~self._inside(known, flight)
            if not failing.any():
                return True
        if self._left:
            self._left -= 1
            return False
        known = self._renewed(flight, np.flatnonzero(failing))
        useful = known is not None and bool((self._inside(known, flight) | ~leg.flying).all())
        self._pause = 0 if useful else min(2 * self._pause + 1, _PAUSE)
        self._left = self._pause
        return useful

    def is_far_between(self, leg: Leg, y: Array, values: Array) -> bool:
        """Say the same by the ends of all sub-steps.

        Parameters
        ----------
        leg : Leg
            The leg.
        y : ndarray, shape (steps + 1, rows, B)
            States at the ends of its sub-steps, finite.
        values : ndarray, shape (steps + 1, E, B)
            Events there.
        """
        known, steps = self._short, len(y) - 1
        if known is None or steps == 1 or known.middle.shape[1] != len(leg.t):
            return False
        length = float(np.abs(leg.period).max()) / steps
        if length > known.duration:
            return False
        good: Flags = np.asarray((values[:, self._rows].min(axis=0) > known.need).all(axis=0))
        good &= (np.abs(y[:, self._states] - known.middle) <= known.half).all(axis=(0, 1))
        good &= self._lasts(known, leg, leg.period)
        good &= self._agree(known, leg)
        good &= (self._departure(known, leg, y, leg.p[None], length)).all(axis=(0, 1))
        return bool((good | ~leg.flying).all())

    def remember(self, leg: Leg, steps: int, index: Integers) -> None:
        """Keep the regions of sub-steps (B,), −1 for none, to look at the next leg."""
        kept, lanes = self._store.kept, np.flatnonzero(index >= 0)
        if kept is None or not len(lanes) or steps == 1:
            return
        duration = float(np.abs(leg.period).max()) / steps
        regions = self._of(kept.taken(index[lanes]), duration)
        self._short = _nothing(regions, len(index))
        self._short.put(lanes, regions)

    def _renewed(self, flight: _Flight, lanes: Integers) -> _Known | None:
        """Return what is known when regions were found for some lanes, as far as there are any."""
        leg, period, total = flight.leg, flight.period, len(flight.leg.t)
        p_lo, p_hi = self._commands(flight)
        fixed = leg.p[: self._fixed]
        p_lo, p_hi = np.concatenate([fixed, p_lo]), np.concatenate([fixed, p_hi])
        y, ends = flight.begins[0][self._states][:, lanes], (leg.t[lanes], (leg.t + period)[lanes])
        if self._timeless:
            ends = np.zeros(len(lanes)), np.zeros(len(lanes))
        # One length for all parts between two samples.
        duration = np.abs(leg.sample[lanes])
        boxes = Boxes(y, y, p_lo[:, lanes], p_hi[:, lanes], np.minimum(*ends), np.maximum(*ends))
        columns = Columns(
            boxes, np.zeros(len(lanes), dtype=int), duration, duration, flight.least[:, lanes]
        )
        index = self._store.indices(columns)
        kept, has_regions = self._store.kept, index >= 0
        if kept is None or not has_regions.any():
            return self._long
        longest = float(np.abs(leg.sample).max())
        known = self._long
        if known is None or known.duration != longest or known.middle.shape[1] != total:
            known = None
        now = self._of(kept.taken(index[has_regions]), longest)
        if known is None:
            known = _nothing(now, total)
        known.put(lanes[has_regions], now)
        self._long, self._asked = known, None
        return known

    def _of(self, regions: Regions, duration: float) -> _Known:
        """Return what regions tell of flights of a duration."""
        inner = regions.inner(duration, self._tube)
        need, fall = regions.need(duration)[self._rows], regions.fall(duration)[self._rows]
        # A jump of a parameter may be one of an event's slope; where they are commands of a law the
        # regions' bends hold for any.
        if self._law is not None:
            fall = need
        need, fall = (each + ROUNDING * (1.0 + each) for each in (need, fall))
        return _Known(
            duration, *_centre_and_half_width(inner.lo, inner.hi),
            *_centre_and_half_width(inner.p_lo, inner.p_hi), inner.t_lo, inner.t_hi, need, fall,
        )  # fmt: skip

    def _inside(self, known: _Known, flight: _Flight) -> Flags:
        """Say of which lanes no event has a zero."""
        leg = flight.leg
        if float(np.abs(flight.period).max()) > known.duration:
            return np.zeros(len(leg.t), dtype=bool)
        need = known.need if len(flight.parts) == 1 else known.fall
        good = (flight.least[self._rows] > need).all(axis=0)
        start = flight.begins[0][self._states]
        good &= (np.abs(start - known.middle) <= known.half).all(axis=0)
        good &= self._lasts(known, leg, flight.period)
        good &= self._agree(known, leg)
        y, held, longest = flight.seen()
        good &= self._departure(known, leg, y, held, longest).all(axis=(0, 1))
        return np.asarray(good)

    def _lasts(self, known: _Known, leg: Leg, period: Array) -> Flags | bool:
        if self._timeless:
            return True
        end = leg.t + period
        inside = (known.t_lo <= np.minimum(leg.t, end)) & (np.maximum(leg.t, end) <= known.t_hi)
        return np.asarray(inside)

    def _agree(self, known: _Known, leg: Leg) -> Flags:
        """Say which lanes' parameters that do not change during a flight are in their regions."""
        asked = self._asked
        if asked is None or asked[0] is not leg.cases or asked[1] is not known:
            fixed = self._fixed
            away = np.abs(leg.p[:fixed] - known.p_middle[:fixed])
            self._agreed = np.asarray((away <= known.p_half[:fixed]).all(axis=0))
            self._asked = leg.cases, known
        return self._agreed

    def _departure(self, known: _Known, leg: Leg, y: Array, held: Array, length: float) -> Flags:
        """Say which commands of parts of a length are in their regions: (S, p, B).

        Parameters
        ----------
        known, leg
            Regions; the leg, in all parts of which the law sees the same.
        y : ndarray, shape (S + 1, rows, B)
            States where parts begin, and a last one.
        held : ndarray, shape (S or 1, k, B)
            Run-time parameters in the parts.
        length : float
            Length of the longest part.
        """
        middle, half = known.p_middle[self._fixed :], known.p_half[self._fixed :]
        if self._law is None:
            away = np.abs(held[:, self._fixed :] - middle)
        else:
            away = self._law.departure(y, leg.p, middle, length, held)
        return np.asarray(away <= half)

    def _commands(self, flight: _Flight) -> tuple[Array, Array]:
        """Return bounds of what changes of the parameters of a region, (k − fixed, B)."""
        y, held, longest = flight.seen()
        if self._law is None:
            changing = held[:, self._fixed :]
            return changing.min(axis=0), changing.max(axis=0)
        return self._law.command(y, flight.leg.p, longest, held)


@dataclass(frozen=True, eq=False)
class _Flight:
    """What was flown between two times, see `QuickLook.is_far`."""

    leg: Leg
    period: Array
    parts: Sequence[Held]
    begins: Sequence[Array]
    least: Array

    def seen(self) -> tuple[Array, Array, float]:
        """Return states where parts begin and a last one, their parameters, the longest length."""
        if len(self.parts) == 1:
            start = self.begins[0]
            return np.array([start, start]), self.leg.p[None], float(np.abs(self.period).max())
        y = np.array([*self.begins, self.begins[-1]])
        longest = max(float(np.abs(part.period).max()) for part in self.parts)
        return y, np.array([part.p for part in self.parts]), longest


def _nothing(like: _Known, lanes: int) -> _Known:
    """Return what is known of lanes without regions: nothing."""

    def empty(of: Array) -> Array:
        return np.full((*of.shape[:-1], lanes), np.nan)

    return _Known(
        like.duration, empty(like.middle), empty(like.half), empty(like.p_middle),
        empty(like.p_half), empty(like.t_lo), empty(like.t_hi), empty(like.need), empty(like.fall),
    )  # fmt: skip


def _centre_and_half_width(lo: Array, hi: Array) -> tuple[Array, Array]:
    """Return middle and half width of boxes, the latter rounded down."""
    return 0.5 * (lo + hi), (0.5 - 1e-12) * (hi - lo)
