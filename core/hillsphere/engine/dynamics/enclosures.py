r"""Enclosures of the solution over a step, from which events are proved.

A box :math:`B \ni y_0` with :math:`y_0 + [0,h]\,f(B) \subseteq B` contains the solution from
:math:`y_0` over the whole step (Picard's operator maps B into itself [1]_). The right-hand side is
evaluated in interval arithmetic, `hillsphere.engine.dynamics.bounds`. A second evaluation over the
box bounds the first two time derivatives of the events.

For states of a linear law, :math:`\dot x_c = A x_c + b(t)`, no such box exists if its time
constants are short compared with the step. By variation of constants they change by at most

.. math:: |x_c(\tau) - x_c(0)| \le G\,|A x_c(0) + b|, \quad G = \int_0^h |e^{As}|\,ds ,

element by element, for any h A.

References
----------
.. [1] R. E. Moore, R. B. Kearfott, M. J. Cloud (2009), Introduction to Interval Analysis, SIAM,
   section 10.1.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics import intervals as iv
from hillsphere.engine.dynamics.bounds import UNWANTED, Bound
from hillsphere.engine.dynamics.intervals import Interval

__all__ = [
    "Bounded",
    "Enclosure",
    "LinearRows",
    "Rates",
    "Sides",
    "bends_along",
    "derivatives_within",
    "enclose",
    "events_along",
    "growth",
    "region_slopes",
]

_ROUNDS = 8
"""Trial boxes for a step. If none contains the solution, the caller bisects the step."""
_INFLATION = 0.1
"""Relative widening of a trial box, so that a step with h‖∂f/∂y‖ < 0.1 is enclosed at the first
trial."""
_WIDENING = 0.3
"""Relative widening of a box that the solution has left: flights over a step with h‖∂f/∂y‖ = 0.7
are enclosed at the eighth trial, with 0.1 at the twelfth."""
_PIECES = 256
"""Intervals in the quadrature of G. It is an upper sum; with 256 intervals it is 1 % too large for
h‖A‖ = 3."""


Sides: TypeAlias = tuple[Array, Array]
"""Lower and upper ends: of times (K,), of states or of parameters (rows, K)."""
Rates: TypeAlias = Callable[[Sides, Sides, Sides], Sides]
"""(times, states, parameters) → bounds of the rates (rows, K), infinite where none is known."""


@dataclass(frozen=True, eq=False)
class LinearRows:
    """Rows of the states of a linear law in a system.

    Parameters
    ----------
    first : int
        Row of the law's first state.
    matrix : ndarray, shape (m, m)
        A, per unit of the system's time.
    """

    first: int
    matrix: Array


class Bounded(Protocol):
    """A system whose right-hand side and events can be evaluated in interval arithmetic."""

    @property
    def linear(self) -> LinearRows | None:
        """Rows of a linear law's states, or None."""
        ...

    def rates(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of dy/dt, one per row; raise TypeError if one is not available."""
        ...

    def events(self, t: Bound, y: Sequence[Bound], p: Sequence[Interval]) -> list[Bound]:
        """Return bounds of the events in order; raise TypeError if one is not available."""
        ...


@dataclass(frozen=True, eq=False)
class Enclosure:
    """Enclosure of states and rates over a step, for K lanes.

    Parameters
    ----------
    lo, hi : ndarray, shape (rows, K)
        Box of the states.
    rate_lo, rate_hi : ndarray, shape (rows, K)
        Box of their time derivatives.
    holds : ndarray of bool, shape (K,)
        Lanes in which the enclosure is proved.
    """

    lo: Array
    hi: Array
    rate_lo: Array
    rate_hi: Array
    holds: NDArray[np.bool_]

    def taken(self, which: NDArray[np.intp]) -> Enclosure:
        """Return those of some lanes."""
        return Enclosure(
            self.lo[:, which], self.hi[:, which], self.rate_lo[:, which], self.rate_hi[:, which],
            self.holds[which],
        )  # fmt: skip


# A box may contain a singularity; its bounds are then infinite, which is a valid result.
@np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore")
def enclose(
    system: Bounded,
    t: Array,
    h: Array,
    y: Array,
    p: Array,
    beyond: Array,
    rates: Rates | None = None,
) -> Enclosure:
    """Enclose the solutions from given states over a step.

    Parameters
    ----------
    system : Bounded
        The equations.
    t, h : ndarray, shape (K,)
        Start and length of the steps; the length is negative for backward propagation.
    y, beyond : ndarray, shape (rows, K)
        States at the start, and approximate states at the end, for the first trial box.
    p : ndarray, shape (k, K)
        Run-time parameters.
    rates : callable, optional
        Bounds of the system's rates in boxes, such as `box_bounds.BoxBounds.rates`; by default they
        are interpreted.

    Returns
    -------
    Enclosure
        Enclosure of every step; ``holds`` is False where no trial box was mapped into itself.
    """
    spread = np.abs(beyond - y)
    # A state that hardly moves needs a box wider than its rounding: 1e-12 of its size, and more
    # than zero for a state at zero.
    spread = (1.0 + _INFLATION) * spread + 1e-12 * np.abs(y) + 1e-300
    lo, hi = y - spread, y + spread
    holds = np.zeros(len(t), dtype=bool)
    box = Enclosure(lo.copy(), hi.copy(), np.full_like(y, -np.inf), np.full_like(y, np.inf), holds)
    linear = system.linear
    tube = None if linear is None else growth(linear.matrix, float(np.max(np.abs(h), initial=0.0)))
    if rates is None:

        def rates(t: Sides, y: Sides, p: Sides) -> Sides:
            held = [iv.point(row) for row in p[0]]
            return arrays(system.rates(Bound(t), box_of(*y), held), y[0])

    # Only what no trial box has held yet is tried again.
    waiting = np.arange(len(t))
    for _ in range(_ROUNDS):
        when = np.minimum(t, t + h), np.maximum(t, t + h)
        low, high = rates(when, (lo, hi), (p, p))
        new_lo, new_hi = picard(y, h, low, high)
        if linear is not None and tube is not None:
            # For the law's states the bound G |A x_c + b| of the module docstring replaces Picard's
            # operator; the rate is evaluated at their initial values.
            rows = slice(linear.first, linear.first + len(tube))
            start_lo, start_hi = lo.copy(), hi.copy()
            start_lo[rows], start_hi[rows] = y[rows], y[rows]
            own = rates(when, (start_lo, start_hi), (p, p))
            reach = tube @ np.maximum(np.abs(own[0][rows]), np.abs(own[1][rows]))
            new_lo[rows], new_hi[rows] = y[rows] - reach, y[rows] + reach
        inside: NDArray[np.bool_] = np.all((new_lo >= lo) & (new_hi <= hi), axis=0)
        for target, source in (
            (box.lo, new_lo), (box.hi, new_hi), (box.rate_lo, low), (box.rate_hi, high)
        ):  # fmt: skip
            target[:, waiting[inside]] = source[:, inside]
        holds[waiting[inside]] = True
        wider = _WIDENING * (new_hi - new_lo) + 1e-300
        lo, hi = np.minimum(lo, new_lo - wider), np.maximum(hi, new_hi + wider)
        left = ~inside & np.isfinite(hi - lo).all(axis=0)
        if not left.any():
            break
        waiting, t, h = waiting[left], t[left], h[left]
        y, p, lo, hi = y[:, left], p[:, left], lo[:, left], hi[:, left]
    return box


def picard(y: Array, h: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """Apply Picard's operator: return y + [0, h] [low, high], rounded outward."""
    a, b = h * low, h * high
    down = np.minimum(np.minimum(a, b), 0.0)
    up = np.maximum(np.maximum(a, b), 0.0)
    return iv.outward(y + np.nextafter(down, -np.inf), y + np.nextafter(up, np.inf))


@np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore")
def region_slopes(
    system: Bounded, t: Array, h: Array, y: Array, p: Array
) -> tuple[NDArray[np.bool_], tuple[Array, Array, Array, Array]]:
    """Bound the time derivatives of events over several equal steps of each lane at once.

    Parameters
    ----------
    system : Bounded
        Equations and events.
    t, h : ndarray, shape (N,)
        Start of the first step, and their length.
    y : ndarray, shape (rows, m + 1, N)
        States at the ends of m steps.
    p : ndarray, shape (k, N)
        Run-time parameters.

    Returns
    -------
    holds : ndarray of bool, shape (N,)
        Lanes in which all steps are proved to stay in one box of twice their extent.
    slopes : tuple of ndarray, shape (E, N)
        Result of `derivatives_within`, valid in these lanes.
    """
    # One box for all steps, of twice the extent of the states. By Picard's operator it holds the
    # solution over each step if it contains y + [0, h] f(B) for the extreme states y.
    low, high = y.min(axis=1), y.max(axis=1)
    spread = 0.5 * (high - low) + 1e-9 * np.maximum(np.abs(low), np.abs(high)) + 1e-300
    lo, hi = low - spread, high + spread
    last = t + (y.shape[1] - 1) * h
    when = np.minimum(t, last), np.maximum(t, last)
    held = [iv.point(row) for row in p]
    rate_lo, rate_hi = arrays(system.rates(Bound(when), box_of(lo, hi), held), lo)
    first, _ = picard(low, h, rate_lo, rate_hi)
    _, second = picard(high, h, rate_lo, rate_hi)
    holds: NDArray[np.bool_] = ((first >= lo) & (second <= hi)).all(axis=0)
    box = Enclosure(lo, hi, rate_lo, rate_hi, holds)
    return holds, derivatives_within(system, when, box, held)


def bends_along(
    system: Bounded, t: Interval, y: Sequence[tuple[Interval, Interval]], p: Sequence[Interval]
) -> list[Interval | None]:
    """Bound the second time derivatives of the states, each given with its rate.

    Parameters
    ----------
    system : Bounded
        Equations.
    t, p
        As of `derivatives_within`.
    y : sequence of (Interval, Interval)
        States and their rates, in the system's unit of time.

    Returns
    -------
    list of Interval or None
        Of each state; None where it is zero.
    """
    states = [Bound(value, rate, UNWANTED) for value, rate in y]
    return [part.rate for part in system.rates(Bound(t, iv.point(1.0), UNWANTED), states, p)]


def events_along(
    system: Bounded,
    t: Interval,
    y: Sequence[tuple[Interval, Interval]],
    bends: Sequence[Interval | None],
    p: Sequence[Interval],
) -> list[Bound]:
    """Bound the events and their first two time derivatives.

    The arguments are those of `bends_along`, with its result as `bends`; with `UNWANTED` for every
    state the second derivatives of the events are `UNWANTED` too.
    """
    states = [Bound(*both, bend) for both, bend in zip(y, bends, strict=True)]
    return system.events(Bound(t, iv.point(1.0)), states, p)


@np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore")
def derivatives_within(
    system: Bounded,
    t: Interval,
    box: Enclosure,
    p: Sequence[Interval],
) -> tuple[Array, Array, Array, Array]:
    """Bound the time derivatives of the events along flights through a box.

    Parameters
    ----------
    system : Bounded
        Equations and events.
    t : Interval
        Times, shape (K,).
    box : Enclosure
        States and their rates.
    p : sequence of Interval
        Run-time parameters.

    Returns
    -------
    rate_lo, rate_hi, second_lo, second_hi : ndarray, shape (E, K)
        Bounds of the first and second time derivatives of each event, in the system's unit of time.
    """
    sides = zip(box.lo, box.hi, box.rate_lo, box.rate_hi, strict=True)
    y = [((a, b), (c, d)) for a, b, c, d in sides]
    events = events_along(system, t, y, bends_along(system, t, y, p), p)
    shape = (len(events), box.lo.shape[1])
    out = np.zeros((4, *shape))
    for i, event in enumerate(events):
        for j, part in enumerate((event.rate, event.second)):
            if part is not None:
                out[2 * j, i], out[2 * j + 1, i] = part
    return out[0], out[1], out[2], out[3]


def growth(matrix: Array, h: float) -> Array:
    r"""Return an upper bound of :math:`\int_0^h |e^{As}| ds`, element by element.

    On an interval of length δ, :math:`|e^{A(s+r)}| \le |e^{As}|\,e^{|A|r}` for 0 ≤ r ≤ δ, so that
    the sum of :math:`|e^{As}|` over the starts s of the intervals, times
    :math:`\delta\,e^{|A|\delta}`, is an upper bound.
    """
    # Every mission with flights imports this module, few of them have vibrations to bound.
    from scipy.linalg import expm

    m = len(matrix)
    part = h / _PIECES
    step, ahead = expm(matrix * part), expm(np.abs(matrix) * part)
    total, now = np.zeros((m, m)), np.eye(m)
    for _ in range(_PIECES):
        total += np.abs(now)
        now = now @ step
    # The relative error of the exponentials is about 1e-13 for h‖A‖ up to ten; 1e-9 covers it.
    return np.asarray((total @ ahead) * part * (1.0 + 1e-9))


def box_of(lo: Array, hi: Array) -> list[Bound]:
    """Convert the rows of a box to `Bound` objects."""
    return [Bound(sides) for sides in zip(lo, hi, strict=True)]


def arrays(bounds: Sequence[Bound], like: Array) -> tuple[Array, Array]:
    """Return the values of bounds as two arrays of the shape of `like`; NaN becomes ±∞."""
    low, high = np.empty_like(like), np.empty_like(like)
    for i, bound in enumerate(bounds):
        low[i], high[i] = bound.value
    unknown = np.isnan(low) | np.isnan(high)
    low[unknown], high[unknown] = -np.inf, np.inf
    return low, high
