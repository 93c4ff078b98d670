"""Numbers that stand for expressions: bounds of a value and of its first two time derivatives.

A plant writes its equations on `hillsphere.symbolic`. The same functions, called with a `Bound` in
place of each state, return bounds of what they would compute: of the right-hand side over a box of
states, or of an event and its time derivatives along all flights through the box. Derivatives obey
the rules of truncated Taylor series [1]_; the coefficients are intervals.

References
----------
.. [1] R. E. Moore, R. B. Kearfott, M. J. Cloud (2009), Introduction to Interval Analysis, SIAM,
   section 9.3 (automatic generation of Taylor coefficients).
"""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics import intervals as iv
from hillsphere.engine.dynamics.interval_programs import Endpoint
from hillsphere.engine.dynamics.intervals import Interval
from hillsphere.symbolic.expressions import Overloaded, number_in

__all__ = ["UNWANTED", "Bound"]

_Part = Interval | None
"""An interval, or None for what is zero whatever the state."""

UNWANTED: Interval = (np.asarray(np.nan)[()], np.asarray(np.nan)[()])
"""Second derivative of states of which only the first is wanted: with it no other is computed."""

_CLOSE = 1e-14
"""Residual of Kepler's equation at which its iteration ends, relative to 1 + |M|: some tens of
roundings, which the bound of the anomaly includes."""


class Bound(Overloaded):
    """Bounds of a quantity along a flight, lane by lane.

    Parameters
    ----------
    value : Interval
        Bounds of the quantity itself.
    rate, second : Interval or None
        Bounds of its first and second time derivative; None if they are zero. `UNWANTED` for a
        second of which nothing is asked, nor of what is computed from it.
    """

    __slots__ = ("rate", "second", "value")

    def __init__(self, value: Interval, rate: _Part = None, second: _Part = None) -> None:
        self.value, self.rate, self.second = value, rate, second

    @classmethod
    def of(cls, item: object) -> Bound:
        """Return an operand as a bound.

        Raises
        ------
        TypeError
            If it is an expression that is no number: of that no bound is known.
        """
        if isinstance(item, Bound):
            return item
        if isinstance(item, int | float | np.floating):
            return cls(iv.point(float(item)))
        return cls(iv.point(number_in(item)))

    def __add__(self, other: object) -> Bound:
        b = Bound.of(other)
        return Bound(
            iv.add(self.value, b.value),
            _add(self.rate, b.rate),
            _add(self.second, b.second),
        )

    __radd__ = __add__

    def __neg__(self) -> Bound:
        return Bound(iv.negate(self.value), _negate(self.rate), _negate(self.second))

    def __sub__(self, other: object) -> Bound:
        return self + (-Bound.of(other))

    def __rsub__(self, other: object) -> Bound:
        return Bound.of(other) + (-self)

    def __mul__(self, other: object) -> Bound:
        if other is self:
            return self**2
        b = Bound.of(other)
        rate = _add(_times(self.rate, b.value), _times(self.value, b.rate))
        second = _add(_times(self.second, b.value), _times(self.value, b.second))
        if second is not UNWANTED:
            second = _add(second, _double(_times(self.rate, b.rate)))
        return Bound(iv.multiply(self.value, b.value), rate, second)

    __rmul__ = __mul__

    def __truediv__(self, other: object) -> Bound:
        return self * Bound.of(other) ** -1.0

    def __rtruediv__(self, other: object) -> Bound:
        return Bound.of(other) * self**-1.0

    def __pow__(self, exponent: object) -> Bound:
        n = float(exponent) if isinstance(exponent, int | float) else number_in(exponent)
        x = self.value
        if n == 1.0:
            return self
        if self.rate is None and self.second is None:
            return Bound(iv.power(x, n))
        first = iv.multiply(iv.point(n), x if n == 2.0 else iv.power(x, n - 1.0))
        if self.second is UNWANTED:
            return self._chained(iv.power(x, n), first, UNWANTED)
        second = iv.power(x, n - 2.0) if n != 2.0 else iv.point(1.0)
        factor = iv.multiply(iv.point(n), iv.point(n - 1.0))
        return self._chained(iv.power(x, n), first, iv.multiply(factor, second))

    def _chained(self, value: Interval, first: Interval, second: Interval) -> Bound:
        """Return F of self, from bounds of F, F′ and F″: Ḟ = F′ẋ, F̈ = F″ẋ² + F′ẍ."""
        if self.rate is None:
            return Bound(value, None, _times(first, self.second))
        if self.second is UNWANTED:
            return Bound(value, iv.multiply(first, self.rate), UNWANTED)
        bend = iv.multiply(second, iv.square(self.rate))
        return Bound(value, iv.multiply(first, self.rate), _add(bend, _times(first, self.second)))

    def symbolic_sqrt(self) -> Bound:
        """Return the square root."""
        return self**0.5

    def symbolic_norm(self, *others: Bound) -> Bound:
        """Return the length of a vector x: it changes no faster than x, and bends no more downward.

        At zero it has no derivative, but its slopes stay within ±|ẋ|, and its kink is convex:
        the second derivative of |x|, (|ẋ|² − (ẋ·x/|x|)²)/|x| + ẍ·x/|x|, is at least −|ẍ|.
        """
        x = (self, *others)
        squared = self**2
        for part in others:
            squared = squared + part**2
        length = squared**0.5
        if length.rate is not None:
            speed = _largest([part.rate for part in x])
            length.rate = np.fmax(length.rate[0], -speed), np.fmin(length.rate[1], speed)
        if length.second is UNWANTED or length.rate is None or length.second is None:
            return length
        pull = _largest([part.second for part in x])
        # At zero and at rest the upper bound is 0 · ∞; the lower one must not suffer by it.
        low, high = np.fmax(length.second[0], -pull), length.second[1]
        length.second = low, np.where(np.isnan(high), np.inf, high)
        return length

    def symbolic_sin(self) -> Bound:
        """Return the sine."""
        s, c = iv.sin(self.value), iv.cos(self.value)
        return self._chained(s, c, iv.negate(s))

    def symbolic_cos(self) -> Bound:
        """Return the cosine."""
        s, c = iv.sin(self.value), iv.cos(self.value)
        return self._chained(c, iv.negate(s), iv.negate(c))

    def symbolic_tan(self) -> Bound:
        """Return the tangent."""
        return self.symbolic_sin() / self.symbolic_cos()

    def symbolic_exp(self) -> Bound:
        """Return the exponential."""
        e = iv.monotone(np.exp, self.value)
        return self._chained(e, e, e)

    def symbolic_log(self) -> Bound:
        """Return the natural logarithm."""
        slope = iv.reciprocal(self.value)
        return self._chained(iv.monotone(np.log, self.value), slope, iv.negate(iv.square(slope)))

    def symbolic_asin(self) -> Bound:
        """Return the inverse sine."""
        x = self.value
        root = iv.power(iv.add(iv.point(1.0), iv.negate(iv.square(x))), -0.5)
        inside = np.maximum(x[0], -1.0), np.minimum(x[1], 1.0)
        return self._chained(
            iv.monotone(np.arcsin, inside), root, iv.multiply(x, iv.power(root, 3.0))
        )

    def symbolic_acos(self) -> Bound:
        """Return the inverse cosine."""
        return 0.5 * np.pi - self.symbolic_asin()

    def symbolic_atan2(self, y: Bound) -> Bound:
        """Return the angle of (self, y): θ̇ = (x ẏ − y ẋ)/(x² + y²); θ̈ follows from it."""
        angle = iv.atan2(y.value, self.value)
        if all(part is None for part in (self.rate, self.second, y.rate, y.second)):
            return Bound(angle)
        x0, y0 = Bound(self.value, self.rate), Bound(y.value, y.rate)
        x1, y1 = Bound(*_both_known(self.rate, self.second)), Bound(*_both_known(y.rate, y.second))
        turning = (x0 * y1 - y0 * x1) / (x0**2 + y0**2)
        return Bound(angle, turning.value, turning.rate)

    def symbolic_minimum(self, other: Bound) -> Bound:
        """Return the smaller; where either may be, its rate is that of one of them."""
        first: NDArray[np.bool_] = self.value[1] < other.value[0]
        last: NDArray[np.bool_] = other.value[1] < self.value[0]
        low = np.minimum(self.value[0], other.value[0]), np.minimum(self.value[1], other.value[1])
        return Bound(
            low,
            _choose_branch(first, last, self.rate, other.rate, True),
            _choose_branch(first, last, self.second, other.second, False),
        )

    def symbolic_select(self, other: Bound, yes: NDArray[np.bool_], no: NDArray[np.bool_]) -> Bound:
        """Return self where a condition surely holds and other where it surely does not.

        Where it may, the value is one of both, and jumps perhaps: nothing is known of its rate.
        """
        value = _choose_branch(yes, no, self.value, other.value, True)
        assert value is not None
        return Bound(
            value,
            _choose_branch(yes, no, self.rate, other.rate, False),
            _choose_branch(yes, no, self.second, other.second, False),
        )

    def symbolic_eccentric_anomaly(self, eccentricity: Bound) -> Bound:
        """Return E of E − e sin E = M for this M and a constant eccentricity 0 ≤ e < 1.

        E rises with M. With e it rises where sin M > 0 and falls where sin M < 0, so that its
        extremes are at ends of e. Ė = Ṁ/(1 − e cos E).
        """
        if eccentricity.rate is not None or eccentricity.second is not None:
            raise TypeError("no bound of the eccentric anomaly for an eccentricity that changes")
        low, high = eccentricity.value
        shapes = (low,) if low is high else (low, high)
        first, last = ([_eccentric_anomaly(e, m) for e in shapes] for m in self.value)
        value = reduce(np.minimum, [a[0] for a in first]), reduce(np.maximum, [a[1] for a in last])
        e = Bound(eccentricity.value)
        shape = 1.0 / (1.0 - e * Bound(value).symbolic_cos())
        slope = shape.value
        bend = iv.negate((e * Bound(value).symbolic_sin() * shape**3.0).value)
        return self._chained(value, slope, bend)


def _eccentric_anomaly(e: Array, m: Array) -> Interval:
    """Return an interval that contains E of E − e sin E = m."""
    anomaly = m.eccentric_anomaly(e) if isinstance(m, Endpoint) else _solve_kepler(e, m)
    # The residual and its rounding, over the least slope 1 − e: no root is farther away.
    rounding = 4.0 * np.finfo(float).eps * (1.0 + np.abs(m))
    left = np.abs(anomaly - e * np.sin(anomaly) - m) + rounding
    error = np.where(left <= _CLOSE * (1.0 + np.abs(m)), left / (1.0 - e) + rounding, np.nan)
    return anomaly - error, anomaly + error


def _solve_kepler(e: Array, m: Array) -> Array:
    """Return E of E − e sin E = m by Newton's method, lane by lane."""
    e, m = np.broadcast_arrays(e, m)
    anomaly = m + e * np.sin(m)
    # It converges from here for e < 0.99 in fewer steps than these; a NaN stays. Converged lanes
    # keep their value, so that no lane's result depends on the others.
    moving = np.ones(np.shape(anomaly), dtype=bool)
    for _ in range(60):
        step = (anomaly - e * np.sin(anomaly) - m) / (1.0 - e * np.cos(anomaly))
        anomaly = np.where(moving, anomaly - step, anomaly)
        moving &= np.abs(step) > _CLOSE * (1.0 + np.abs(m))
        if not moving.any():
            break
    return np.asarray(anomaly)


def _add(a: _Part, b: _Part) -> _Part:
    if a is UNWANTED or b is UNWANTED:
        return UNWANTED
    if a is None:
        return b
    return a if b is None else iv.add(a, b)


def _times(a: _Part, b: _Part) -> _Part:
    if a is None or b is None:
        return None
    return UNWANTED if a is UNWANTED or b is UNWANTED else iv.multiply(a, b)


def _double(a: _Part) -> _Part:
    return None if a is None else (2.0 * a[0], 2.0 * a[1])


def _negate(a: _Part) -> _Part:
    return a if a is None or a is UNWANTED else iv.negate(a)


def _largest(vector: list[_Part]) -> Array:
    """Return an upper bound of the length of a vector of intervals."""
    total: _Part = None
    for part in vector:
        total = total if part is None else _add(total, iv.square(part))
    return np.zeros(()) if total is None else iv.power(total, 0.5)[1]


def _both_known(a: _Part, b: _Part) -> tuple[Interval, _Part]:
    return (iv.point(0.0) if a is None else a), b


def _choose_branch(
    first: NDArray[np.bool_], last: NDArray[np.bool_], a: _Part, b: _Part, either: bool
) -> _Part:
    """Return a where `first`, b where `last`; elsewhere the hull of both, or everything."""
    if a is None and b is None and either:
        return None
    if a is UNWANTED or b is UNWANTED:
        return UNWANTED
    zero = iv.point(0.0)
    a, b = (zero if a is None else a), (zero if b is None else b)
    rest = iv.hull(a, b) if either else iv.EVERYTHING
    lo = np.where(first, a[0], np.where(last, b[0], rest[0]))
    hi = np.where(first, a[1], np.where(last, b[1], rest[1]))
    return lo, hi
