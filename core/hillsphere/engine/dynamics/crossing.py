"""Event location on many lanes at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.engine.dynamics.enclosures import (
    Bounded,
    Enclosure,
    derivatives_within,
    enclose,
    region_slopes,
)
from hillsphere.engine.dynamics.lanes import per_lane, refuse_non_finite
from hillsphere.engine.dynamics.march import March
from hillsphere.engine.dynamics.proof import (
    MARGIN,
    FirstCrossings,
    Pieces,
    Slopes,
    count_crossings,
    decide,
    search,
)
from hillsphere.engine.dynamics.root_finding import bracketed_roots

__all__ = ["Crossing", "first_crossing"]


@dataclass(frozen=True, eq=False)
class Crossing:
    """Where each of N lanes first meets an event.

    Parameters
    ----------
    found : ndarray of bool, shape (N,)
        Whether it does.
    time : ndarray, shape (N,)
        Time of the event on the system's clock (t0 included); NaN if not found.
    x : ndarray, shape (n, N)
        State at the event; at the end of the flight if not found.
    phi : ndarray, shape (n, n + k, N), or None
        Derivatives of the flow for the time of the event held fixed, from the start to `x`.
    resolved : ndarray of bool, shape (N,)
        Where it is proved that no earlier crossing was missed. An event that offers no bound is
        resolved where it stayed farther from zero than 0.1, its value at the ends of steps.
    """

    found: NDArray[np.bool_]
    time: Array
    x: Array
    phi: Array | None
    resolved: NDArray[np.bool_]


def first_crossing(
    march: March,
    value: Callable[[Array, Array, Array], Array],
    direction: int,
    after: ArrayLike,
    where: str | None,
    bounded: Bounded | None,
) -> Crossing:
    """Find where each lane of a march first meets an event.

    Parameters
    ----------
    march : March
        The flight.
    value : callable
        The event, (x (n, N), p (k, N), t (N,)) → (1, N).
    direction : {-1, 0, 1}
        Falling, both, rising, along the flight.
    after : array_like, shape (N,) or scalar
        Length of flight before which nothing counts.
    where : str or None
        What flies, for the error; None if non-finite lanes are to be let through.
    bounded : Bounded or None
        Equations and this event in interval arithmetic; None if there is no bound of it.

    Returns
    -------
    Crossing
        Times and states.

    Raises
    ------
    PropagationError
        If a lane turns non-finite before the event and `where` is given.
    """
    n, cases, h, y0 = march.n, march.cases, march.h, march.start
    wait = np.abs(per_lane(after, cases, "after"))

    def event(y: Array, t: Array) -> Array:
        events: Array = value(y[:n], march.p, t)[0]
        return events

    proof = _Proof(march, value, direction, bounded)
    state = _First(cases, y0)
    end = y0
    kept, levels, begun = [y0.copy()], [event(y0, march.t0)], 0
    for j, end in enumerate(march, start=1):
        g = event(end, march.t0 + j * h)
        kept.append(end.copy())
        levels.append(g)
        if len(kept) > _CHUNK or j == march.steps:
            proof.settle(state, begun, kept, levels, wait)
            kept, levels, begun = [end.copy()], [g], j
            if state.over.all():
                break
    if where is not None:
        refuse_non_finite(np.where(state.over, 0.0, end), where)

    found, begin, before = state.found, state.begin, state.before
    partial = np.empty_like(before)

    def after_partial_step(tau: Array) -> Array:
        march.stepper.bind(tau, march.p)(before, partial, begin)
        return event(partial, begin + tau)

    # The partial step can be told no better than the clock: a few units in its last place.
    width = 4.0 * np.finfo(float).eps * np.maximum(np.abs(h), np.abs(begin))
    near, far = np.where(found, state.near, 0.0), np.where(found, state.far, 0.0)
    g_near, g_far = state.g_before.copy(), state.g_after.copy()
    if state.inner.any():
        inner = state.inner
        g_near[inner], g_far[inner] = after_partial_step(near)[inner], 0.0
        g_far[inner] = after_partial_step(far)[inner]
    tau = bracketed_roots(after_partial_step, near, far, g_near, g_far, width)
    after_partial_step(tau)
    states, phi = march.split(np.where(found, partial, end))
    time = np.where(found, begin + tau, np.nan)
    if march.single:
        return Crossing(found[0], time[0], states, phi, state.resolved[0])
    return Crossing(found, time, states, phi, state.resolved)


_CHUNK = 16
"""Steps whose events are proved together: within twice the extent of so many steps bounds are
still sharp enough to decide nearly all, at a sixteenth of the cost."""


class _First:
    """The first crossing of each lane, as far as it is known."""

    def __init__(self, cases: int, y0: Array) -> None:
        self.found, self.inner = np.zeros((2, cases), dtype=bool)
        self.over = np.zeros(cases, dtype=bool)
        self.resolved = np.ones(cases, dtype=bool)
        self.before = y0.copy()
        self.begin, self.near, self.far, self.g_before, self.g_after = np.zeros((5, cases))


class _Proof:
    """Decides chunks of steps."""

    def __init__(
        self,
        march: March,
        value: Callable[[Array, Array, Array], Array],
        direction: int,
        bounded: Bounded | None,
    ) -> None:
        self._march, self._value, self._direction = march, value, direction
        self._bounded = bounded

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def settle(
        self, state: _First, begun: int, kept: list[Array], levels: list[Array], wait: Array
    ) -> None:
        """Find first crossings in the steps that follow step `begun`, lanes by lanes."""
        march, h = self._march, self._march.h
        y, g = np.stack(kept, axis=1), np.stack(levels)
        steps = len(kept) - 1
        numbers = begun + 1 + np.arange(steps)[:, None]
        # Of a step to a state that is not finite nothing can be said; the caller is told.
        finite = np.isfinite(y[: march.n, 1:]).all(axis=0)
        counts = (numbers * np.abs(h) > wait) & ~state.over & finite
        crosses = count_crossings(g[:-1], g[1:], self._direction, False)
        t = march.t0 + begun * h
        sure = self._regions(t, y, g)
        unsure = counts & ~sure
        # Only up to the first certain crossing of a lane is anything to be found out.
        certain = counts & crosses & sure
        first = np.where(certain.any(axis=0), certain.argmax(axis=0), steps)
        unsure &= np.arange(steps)[:, None] <= first
        crossings = self._searched(t, y, g, unsure) if self._bounded is not None else None
        for j in range(steps):
            here = counts[j] & ~state.over
            hit = here & crosses[j]
            inner = np.zeros_like(hit)
            if crossings is not None:
                rows = slice(j * march.cases, (j + 1) * march.cases)
                looked = here & unsure[j]
                at, opens = crossings.begin[0, rows], crossings.open_at[0, rows]
                lost = looked & np.isfinite(opens) & ~(np.abs(at) < opens)
                state.resolved[lost] = False
                hit = (hit & ~looked) | (looked & np.isfinite(at) & ~lost)
                inner = looked & hit
                state.near[inner] = at[inner]
                state.far[inner] = crossings.end[0, rows][inner]
                state.over |= lost
            elif self._bounded is None:
                close = np.minimum(np.abs(g[j]), np.abs(g[j + 1])) < MARGIN
                state.resolved[here & close] = False
            plain = hit & ~inner
            state.near[plain], state.far[plain] = 0.0, h[plain]
            state.before[:, hit], state.begin[hit] = y[:, j, hit], (t + j * h)[hit]
            state.g_before[hit], state.g_after[hit] = g[j, hit], g[j + 1, hit]
            state.inner |= inner
            state.found |= hit
            state.over |= hit

    def _regions(self, t: Array, y: Array, g: Array) -> NDArray[np.bool_]:
        """Say which steps (m, N) one box per lane decides."""
        shape = (len(g) - 1, g.shape[1])
        if self._bounded is None:
            return np.zeros(shape, dtype=bool)
        march = self._march
        try:
            holds, slopes = region_slopes(self._bounded, t, march.h, y[: march.n], march.p)
        except TypeError:  # an operation of which no bound is known
            self._bounded = None
            return np.zeros(shape, dtype=bool)
        if np.isinf(slopes[0]).all() and np.isinf(slopes[1]).all() and holds.any():
            self._bounded = None
            return np.zeros(shape, dtype=bool)
        clear, single = decide(
            g[:-1], g[1:], np.abs(march.h), _turn_slopes(slopes, march.h), self._direction, False
        )
        return (clear | single) & holds

    def _searched(
        self, t: Array, y: Array, g: Array, unsure: NDArray[np.bool_]
    ) -> FirstCrossings | None:
        """Search the steps (m, N) that are not sure, each as a lane of its own."""
        march, bounded = self._march, self._bounded
        assert bounded is not None
        which = np.flatnonzero(unsure.reshape(-1))
        if not len(which):
            return None
        steps, cases = unsure.shape
        flat = y[: march.n].reshape(march.n, -1)
        pieces = Pieces(
            which, np.zeros(len(which)), march.h[which % cases],
            flat[:, which], flat[:, which + cases],
            g.reshape(1, -1)[:, which], g.reshape(1, -1)[:, which + cases],
        )  # fmt: skip
        begun = (t + np.arange(steps)[:, None] * march.h).reshape(-1)
        rows = y.reshape(len(y), -1)

        def bounds(now: Pieces) -> Slopes:
            begin, length = begun[now.lane] + now.begin, now.end - now.begin
            p = march.p[:, now.lane % cases]
            box: Enclosure = enclose(bounded, begin, length, now.y0, p, now.y1)
            when = np.minimum(begin, begin + length), np.maximum(begin, begin + length)
            slopes = np.array(derivatives_within(bounded, when, box, [(row, row) for row in p]))
            unknown = ~box.holds
            slopes[0::2, :, unknown], slopes[1::2, :, unknown] = -np.inf, np.inf
            return slopes[0], slopes[1], slopes[2], slopes[3]

        def halve(lane: Integers, tau: Array) -> tuple[Array, Array]:
            start, p = np.ascontiguousarray(rows[:, lane]), march.p[:, lane % cases]
            p = np.ascontiguousarray(p)
            out = np.empty_like(start)
            march.stepper.bind(tau, p)(start, out, begun[lane])
            inner = np.ascontiguousarray(out[: march.n])
            return inner, self._value(inner, p, begun[lane] + tau)

        wanted = np.ones((1, len(which)), dtype=bool)
        return search(
            pieces, steps * cases, bounds, halve, self._direction, wanted, from_zero=False
        )


def _turn_slopes(slopes: Slopes, h: Array) -> Slopes:
    """Return slopes along flights that go with the sign of h."""
    a, b, c, d = slopes
    back = h < 0
    return np.where(back, -b, a), np.where(back, -a, b), c, d
