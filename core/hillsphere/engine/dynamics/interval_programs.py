"""Interval arithmetic of a system, recorded once and compiled.

`hillsphere.engine.dynamics.bounds` evaluates equations operation by operation on arrays. For the
few boxes of a proof nearly all of the time is the interpreter's: some microseconds per operation.
`record` calls the same code once with `Endpoint` objects, which stand for ends of intervals and
write down what is done with them. The record is compiled for arrays of lanes, hundreds of times as
fast for few of them.

The engine evaluates every recorded operation in double precision and does not reorder sums. Ends
are therefore rounded outward as `intervals.outward` does for many lanes. Should the machine fuse a
product with a sum, its result is closer to the exact one, which the same margin covers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from hillsphere.base.arrays import Array
from hillsphere.engine.dynamics.intervals import LEAST, UNIT, Interval
from hillsphere.symbolic._heyoka import heyoka as _hy

__all__ = ["Endpoint", "Program", "Record", "RepeatedFunction", "record"]

_LONGEST = 4000
"""Operations of the longest record that is compiled: that takes some three seconds. Flights about a
moon on an ellipse have 3600."""
_LARGEST_POWER = 100
"""Powers beyond are not recorded: no gravity field in use has such a degree with bounds."""
_ROUND = 1.5 * 2.0**52
"""A number of this size has no digits after the point: adding it rounds to a whole number."""
_RECORDED = 4
"""Calls before the operations are recorded, which takes as long as some three calls."""
_PROGRAMS = 64
"""Compiled records that are kept: a mission has two for each kind of plant that flies."""
_WRITTEN = (1.0, 2.0, 0.5, math.inf)
"""Magnitudes of constants that are compiled in. Others are arguments, so that plants that differ in
their numbers alone share a program. Zero is one too: the engine takes a product with a constant of
zero for zero, where the other factor may be unknown."""

_Item: TypeAlias = "int | float | str"
"""Of an operation: its name, the number of an operand in the record, or a constant."""


class _Log:
    """Operations in order, each written once."""

    def __init__(self) -> None:
        self.operations: dict[tuple[_Item, ...], int] = {}
        self.constants: list[float] = []

    def put(self, *operation: _Item) -> int:
        """Return the number of an operation; equal ones have one number."""
        return self.operations.setdefault(operation, len(self.operations))

    def number_of(self, item: Any) -> int:
        """Return the number of an operand."""
        if isinstance(item, Endpoint):
            return item.number
        value = float(item)
        if abs(value) in _WRITTEN:
            return self.put("constant", repr(value))
        if math.isnan(value):
            return self.put("constant", "nan")
        if value not in self.constants:
            self.constants.append(value)
        return self.put("argument", self.constants.index(value))


class Endpoint(NDArrayOperatorsMixin):
    """An end of an interval, or a condition on ends, in all lanes.

    The functions of NumPy that intervals need are recorded. Any other, and whatever asks for a
    value, raises a TypeError: then there is no record. Code that asks for the type of an end, as
    whether it is an array, is recorded for this type.
    """

    __slots__ = ("log", "number")

    def __init__(self, log: _Log, number: int) -> None:
        self.log, self.number = log, number

    def _with(self, name: str, *items: Any) -> Endpoint:
        return Endpoint(self.log, self.log.put(name, *(self.log.number_of(one) for one in items)))

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        if method != "__call__" or options:
            return NotImplemented
        if ufunc is np.nextafter and isinstance(inputs[1], float) and math.isinf(inputs[1]):
            return inputs[0]._with("below" if inputs[1] < 0.0 else "above", inputs[0])
        if ufunc is np.power and isinstance(inputs[1], float):
            return inputs[0]._power(inputs[1])
        return self._with(ufunc.__name__, *inputs) if ufunc.__name__ in _RULES else NotImplemented

    def __array_function__(self, function: Any, types: Any, given: Any, options: Any) -> Any:
        if function is not np.where or options or len(given) != 3:
            return NotImplemented
        return self._with("where", *given)

    def __array__(self, *options: Any, **more: Any) -> Array:
        raise TypeError("an end of an interval has no value while it is recorded")

    def __bool__(self) -> bool:
        raise TypeError("an end of an interval has no value while it is recorded")

    def eccentric_anomaly(self, eccentricity: Any) -> Endpoint:
        """Return an approximate E of E − e sin E = M for this M."""
        return self._with("eccentric_anomaly", eccentricity, self)

    def _power(self, exponent: float) -> Endpoint:
        whole = math.floor(exponent)
        if exponent - whole not in (0.0, 0.5) or not 0.0 < exponent <= _LARGEST_POWER:
            raise TypeError(f"the power {exponent} is not recorded")
        made = self._with("sqrt", self) if exponent != whole else None
        square = self
        while whole:
            if whole % 2:
                made = square if made is None else self._with("multiply", made, square)
            if whole := whole // 2:
                square = self._with("multiply", square, square)
        assert made is not None
        return made


@dataclass(frozen=True)
class Record:
    """What a function does with intervals.

    Parameters
    ----------
    count : int
        Number of intervals that it takes.
    operations : tuple of tuple
        Each a name, of the keys of the module's table of rules, and the numbers of its operands.
    results : tuple of int
        Numbers of all lower ends of the results, then of all upper ones.
    constants : tuple of float
        Values of its arguments.
    """

    count: int
    operations: tuple[tuple[_Item, ...], ...]
    results: tuple[int, ...]
    constants: tuple[float, ...]

    @property
    def is_compiled(self) -> bool:
        """Whether this process has compiled the same operations before."""
        return self.key in _compiled

    @property
    def key(self) -> tuple[Any, ...]:
        """What programs that differ in their constants alone have in common."""
        return self.count, self.operations, self.results


def record(
    function: Callable[[Sequence[Interval]], Sequence[Interval | None]], count: int
) -> Record:
    """Record a function of intervals.

    Parameters
    ----------
    function : callable
        Takes the intervals and returns some, or None for those that are zero in all lanes.
    count : int
        Number of intervals that it takes.

    Raises
    ------
    TypeError
        If the function does what cannot be recorded.
    """
    log = _Log()
    ends = [cast(Array, Endpoint(log, log.put("end", i))) for i in range(2 * count)]
    results = function(list(zip(ends[:count], ends[count:], strict=True)))
    both = [(0.0, 0.0) if one is None else one for one in results]
    numbers = tuple(log.number_of(one[side]) for side in (0, 1) for one in both)
    return Record(count, tuple(log.operations), numbers, tuple(log.constants))


class Program:
    """A record as a function of arrays.

    Parameters
    ----------
    of : Record
        What it does.
    """

    def __init__(self, of: Record) -> None:
        self._results = len(of.results) // 2
        self._lanes = _hy.recommended_simd_size()
        self._function = _compile(of)
        self._constants = np.array(of.constants)[:, None]

    def __call__(self, lo: Array, hi: Array) -> tuple[Array, Array]:
        """Evaluate the function.

        Parameters
        ----------
        lo, hi : ndarray, shape (count, K)
            Ends of the intervals, lane by lane.

        Returns
        -------
        lo, hi : ndarray, shape (results, K)
            Ends of the results; NaN where no bound is known.
        """
        lanes = lo.shape[1]
        if not lanes:
            return np.empty((self._results, 0)), np.empty((self._results, 0))
        # All lanes are computed by the same code: that for the rest of a batch may round otherwise.
        total = lanes + -lanes % self._lanes
        given = np.empty((2 * len(lo), total))
        given[: len(lo), :lanes], given[len(lo) :, :lanes] = lo, hi
        given[:, lanes:] = given[:, lanes - 1 : lanes]
        options = {}
        if count := self._function.nparams:
            options["pars"] = np.repeat(self._constants[:count], total, axis=1)
        out = self._function(given, **options)[:, :lanes]
        return out[: self._results], out[self._results :]


class RepeatedFunction:
    """A function of intervals that is compiled once it has been called some times.

    What is interpreted differs from what is compiled by some units in the last place: an end that
    is compiled is moved by one or two units where `intervals.outward` takes the next float. Results
    that must not depend on how often a process has called the function need ``after = 0``.

    Parameters
    ----------
    function : callable
        As for `record`. What cannot be recorded stays interpreted.
    after : int
        Calls before it is compiled, unless the same operations are compiled already.
    """

    def __init__(
        self, function: Callable[[Sequence[Interval]], Sequence[Interval | None]], after: int
    ) -> None:
        self._function, self._after, self._calls = function, after, 0
        self._record: Record | None = None
        self._program: Program | None = None

    def __call__(self, lo: Array, hi: Array) -> tuple[Array, Array]:
        """Evaluate the function; see `Program`."""
        self._calls += 1
        if self._calls == min(_RECORDED, self._after + 1):
            # Whatever cannot be done with endpoints; a fault of the function itself shows below.
            with suppress(Exception):
                made = record(self._function, len(lo))
                self._record = made if len(made.operations) <= _LONGEST else None
        if self._record is not None and (self._calls > self._after or self._record.is_compiled):
            self._program, self._record = Program(self._record), None
        if self._program is not None:
            return self._program(lo, hi)
        results = self._function(list(zip(lo, hi, strict=True)))
        below, above = np.zeros((2, len(results), lo.shape[1]))
        for i, one in enumerate(results):
            if one is not None:
                below[i], above[i] = one
        return below, above


_compiled: dict[tuple[Any, ...], Any] = {}
"""Compiled functions by `Record.key`, the newest last."""


def _compile(of: Record) -> Any:
    """Return the compiled function of a record's operations."""
    if (known := _compiled.get(of.key)) is not None:
        return known
    symbols = [_hy.expression(f"end_{i}") for i in range(2 * of.count)]
    made: list[Any] = []
    for name, *operands in of.operations:
        if name == "end":
            made.append(symbols[cast(int, operands[0])])
        elif name == "argument":
            made.append(_hy.par[operands[0]])
        elif name == "constant":
            made.append(_hy.expression(float(operands[0])))
        else:
            made.append(_RULES[cast(str, name)](*(made[cast(int, i)] for i in operands)))
    function = _hy.cfunc(
        [made[i] for i in of.results], vars=symbols, batch_size=_hy.recommended_simd_size()
    )
    while len(_compiled) >= _PROGRAMS:
        _compiled.pop(next(iter(_compiled)), None)
    return _compiled.setdefault(of.key, function)


_NAN, _INF = _hy.expression(math.nan), _hy.expression(math.inf)
_ZERO, _ONE = _hy.expression(0.0), _hy.expression(1.0)


def _not(a: Any) -> Any:
    return _ONE - a


def _is_nan(a: Any) -> Any:
    return _not(_hy.lte(a, _INF))


def _magnitude(a: Any) -> Any:
    return _hy.select(_hy.lt(a, _ZERO), -a, a)


def _minimum(a: Any, b: Any) -> Any:
    # A NaN in either makes both conditions false.
    return _hy.select(_hy.lt(a, b), a, _hy.select(_hy.gte(a, b), b, _NAN))


def _maximum(a: Any, b: Any) -> Any:
    return _hy.select(_hy.gt(a, b), a, _hy.select(_hy.lte(a, b), b, _NAN))


def _fmin(a: Any, b: Any) -> Any:
    return _hy.select(_is_nan(a), b, _hy.select(_is_nan(b), a, _minimum(a, b)))


def _fmax(a: Any, b: Any) -> Any:
    return _hy.select(_is_nan(a), b, _hy.select(_is_nan(b), a, _maximum(a, b)))


def _unit(a: Any) -> Any:
    """Return at least one unit in the last place of a number."""
    return _magnitude(a) * _hy.expression(UNIT) + _hy.expression(LEAST)


def _floor(a: Any) -> Any:
    # From 2⁵¹ on this is not the floor, but differs from `a` by no more than rounding does.
    nearest = (a + _hy.expression(_ROUND)) - _hy.expression(_ROUND)
    return _hy.select(_hy.gt(nearest, a), nearest - _ONE, nearest)


_RULES: dict[str, Callable[..., Any]] = {
    "add": lambda a, b: a + b,
    "subtract": lambda a, b: a - b,
    "multiply": lambda a, b: a * b,
    "divide": lambda a, b: a / b,
    "negative": lambda a: -a,
    "absolute": _magnitude,
    "minimum": _minimum,
    "maximum": _maximum,
    "fmin": _fmin,
    "fmax": _fmax,
    "below": lambda a: a - _unit(a),
    "above": lambda a: a + _unit(a),
    "sqrt": _hy.sqrt,
    "sin": _hy.sin,
    "cos": _hy.cos,
    "exp": _hy.exp,
    "log": _hy.log,
    "arcsin": _hy.asin,
    "arctan2": _hy.atan2,
    # The engine's own anomaly lies within one revolution.
    "eccentric_anomaly": lambda e, m: m + e * _hy.sin(_hy.kepE(e, m)),
    "floor": _floor,
    "ceil": lambda a: -_floor(-a),
    "isnan": _is_nan,
    "less": _hy.lt,
    "less_equal": _hy.lte,
    "greater": _hy.gt,
    "greater_equal": _hy.gte,
    "equal": _hy.eq,
    "bitwise_and": lambda a, b: _hy.logical_and([a, b]),
    "bitwise_or": lambda a, b: _hy.logical_or([a, b]),
    "invert": _not,
    "where": _hy.select,
}
"""How operations are compiled, by the names of NumPy's functions."""
