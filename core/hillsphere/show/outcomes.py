"""Judgement of requirements and claims from metrics and tables.

With a confidence, an interval decides: a limit is kept if the worse end of the interval keeps it
and broken if the better end breaks it; otherwise the row is undecided. Proved bounds, an interval
of confidence one, always decide: an upper bound above a limit does not show that it is broken.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from hillsphere.base.problems import did_you_mean
from hillsphere.interfaces.outcomes import Evidence, Judgement, MissingResultError, State
from hillsphere.show.outcome_specs import (
    ComparisonSpec,
    NotDerivableSpec,
    ResultSpec,
    StatementSpec,
    ValueSpec,
)
from hillsphere.show.presentation import Cell, Column, Printed, Table
from hillsphere.show.reference import PAPER_SUFFIX, ReferenceTable, computed_columns
from hillsphere.spec.units import UNITS

__all__ = ["Comparison", "NotDerivable", "Statement", "Value", "format_margin", "format_value"]

_Plain: TypeAlias = float | int | bool | str
_RELATIONS: Mapping[str, Callable[[Any, Any], bool]] = {
    "<=": operator.le, "<": operator.lt, ">=": operator.ge, ">": operator.gt,
    "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
_SIGNS = {"<=": "≤", "<": "<", ">=": "≥", ">": ">", "==": "", "!=": "not"}
_SHOWN_DEVIATIONS = 3
"""Number of deviating cells that a comparison names; the table shows all."""
_DECADE = 10.0
"""Ratio of limit and value from which a margin is given in decades instead of percent."""
_DIGITS, _MOST_DIGITS = 4, 15
"""Significant digits of a shown result, and the most that a double keeps of a decimal number."""
_CONVERSION_ERROR = 4e-16
"""Relative rounding error of two factors of units: two units in the last place."""
_PLAIN_DIGITS = str.maketrans({"²": "2", "³": "3", "°": "deg"})
"""Powers of units as they are typed: a mission may write m/s2 or m/s²."""
_MOST_NAMES = 3
"""Cells that name a row at most; more would be the row itself."""
_KEY_TOLERANCE = 1e-9
"""Relative difference up to which a number in `row` selects a cell: far below printed digits, far
above the rounding of a unit's conversion."""


@dataclass(frozen=True)
class _Candidate:
    """One computed value, with its interval and a text that names its row."""

    value: _Plain
    unit: str
    interval: tuple[float, float] | None = None
    confidence: float | None = None
    row: str = ""

    @property
    def has_proved_bounds(self) -> bool:
        """Whether the ends of the interval are proved."""
        return self.confidence == 1.0


class _Compared:
    """Comparison of a stage's result with a value."""

    is_kept: State
    is_broken: State

    def __init__(self, spec: ResultSpec) -> None:
        self.spec = spec

    def judge(self, evidence: Evidence) -> Judgement:
        """Return the outcome for the worst of the compared values."""
        outcomes = [
            one if isinstance(one, Judgement) else self._judge_one(one)
            for one in self._candidates(evidence)
        ]
        order = (self.is_broken, "undecided", self.is_kept)
        return min(outcomes, key=lambda o: (order.index(o.state), _or_inf(o.margin)))

    def _candidates(self, evidence: Evidence) -> Iterator[_Candidate | Judgement]:
        spec = self.spec
        if spec.metric:
            metric = evidence.metric(spec.stage.name, spec.metric)
            if metric.value is None:
                raise MissingResultError(f"metric {spec.metric!r} has no value")
            unit = "" if metric.unit == "-" else metric.unit
            yield _Candidate(_plain(metric.value), unit, metric.interval, metric.confidence)
            return
        table = evidence.table(spec.stage.name, spec.table)
        column = _column(table, spec.column)
        rows = _rows(table, spec.row)
        for row in rows:
            cell = row.get(column.name)
            if cell is None:  # another row may break the limit all the same
                reason = f"column {column.name!r} has no value in the row {_row_name(table, row)}"
                yield Judgement("undecided", spec.text, reason=reason, source=spec.source)
                continue
            unit = "" if column.unit == "-" else column.unit
            name = "" if len(rows) == 1 else _row_name(table, row)
            yield _Candidate(_plain(cell), unit, _interval(column, row), column.confidence, name)

    def _judge_one(self, one: _Candidate) -> Judgement:
        spec = self.spec
        limit = _in_unit(spec.value, spec.unit, one.unit)
        if _kind(limit) != _kind(one.value):
            raise MissingResultError(
                f"the result is {_kind(one.value)}, and is compared with {_kind(limit)}"
            )
        if limit != spec.value and math.isclose(limit, one.value, rel_tol=_CONVERSION_ERROR):  # type: ignore[arg-type]
            limit = one.value  # they differ by the rounding of the unit's conversion only
        state, reason = self._decide(one, limit)
        # As the mission writes it, and the result with as many digits as tell it from the limit.
        sign, shown = _SIGNS[spec.op], _write_limit(spec.value, spec.unit or one.unit)
        got = format_value(one.value, one.unit, apart_from=limit)
        if one.interval is not None and (spec.confidence is not None or one.has_proved_bounds):
            got += f" ({_interval_text(*one.interval)})"
        return Judgement(
            state=state,
            text=spec.text,
            asked=f"{sign} {shown}".strip(),
            got=f"{got}, {one.row}" if one.row else got,
            value=one.value,
            limit=limit,
            unit=one.unit,
            margin=_margin(spec.op, one.value, limit),
            interval=one.interval,
            confidence=spec.confidence,
            reason=reason,
            source=spec.source,
        )

    def _decide(self, one: _Candidate, limit: _Plain) -> tuple[State, str]:
        relation, confidence = _RELATIONS[self.spec.op], self.spec.confidence
        if isinstance(one.value, float) and math.isnan(one.value):
            return "undecided", "the result is not a number"
        if confidence is None and not one.has_proved_bounds:
            return (self.is_kept if relation(one.value, limit) else self.is_broken), ""
        if one.interval is None or one.confidence is None:
            return "undecided", "the result has no confidence interval"
        if confidence is not None and one.confidence < confidence:
            return "undecided", (
                f"the confidence interval is one of {100 * one.confidence:g} %, asked are "
                f"{100 * confidence:g} %"
            )
        low, high = one.interval
        if math.isnan(low) or math.isnan(high):
            return "undecided", "the confidence interval has an end that is not a number"
        ends = [relation(end, limit) for end in one.interval]
        if self.spec.op in ("==", "!=") and low < high and low <= float(limit) <= high:
            ends = [True, False]  # such an interval holds the limit and other values
        if all(ends):
            return self.is_kept, ""
        if not any(ends):
            return self.is_broken, ""
        if one.has_proved_bounds:
            return "undecided", "the limit lies between the proved bounds of the result"
        return "undecided", f"the {100 * one.confidence:g} % interval contains the limit"


class Value(_Compared):
    """A requirement on a result of a stage.

    Parameters
    ----------
    spec : ValueSpec
        Its parameters.
    """

    is_kept = "met"
    is_broken = "not met"

    def __init__(self, spec: ValueSpec) -> None:
        super().__init__(spec)


class Statement(_Compared):
    """A claim about a result of a stage.

    Parameters
    ----------
    spec : StatementSpec
        Its parameters.
    """

    is_kept = "confirmed"
    is_broken = "refuted"

    def __init__(self, spec: StatementSpec) -> None:
        super().__init__(spec)


class Comparison:
    """A claim that a table agrees with published values.

    Parameters
    ----------
    spec : ComparisonSpec
        Its parameters.
    """

    def __init__(self, spec: ComparisonSpec) -> None:
        self.spec = spec
        self.reference = None if spec.reference is None else ReferenceTable.read(spec.reference)

    def judge(self, evidence: Evidence) -> Judgement:
        """Return whether every compared cell agrees, and which do not."""
        spec = self.spec
        table = evidence.table(spec.stage.name, spec.table)
        for name in spec.columns:
            _column(table, name)
        rows: Sequence[Mapping[str, Cell]] = _rows(table, spec.row)
        source, twins = spec.source, computed_columns(table.columns)
        if self.reference is not None:
            rows = self._beside(table, rows, twins)
            source = source or self.reference.source
            twins = {f"{column.name}{PAPER_SUFFIX}": column.name for column in table.columns}
        compared = [
            (row, name, printed)
            for row in rows
            for twin, name in twins.items()
            if isinstance(printed := row.get(twin), Printed)
            and (not spec.columns or name in spec.columns)
        ]
        if not compared:
            raise MissingResultError(f"table {spec.table!r} has no published values to compare")
        if idle := [name for name in spec.columns if name not in {c[1] for c in compared}]:
            raise MissingResultError(f"column {idle[0]!r} has no published values to compare")
        apart = [
            f"{_row_name(table, row)}, {name}: {_deviation(row.get(name), printed)}"
            for row, name, printed in compared
            if not _agrees(row.get(name), printed, spec.last_digits)
        ]
        more = len(apart) - _SHOWN_DEVIATIONS
        shown = [*apart[:_SHOWN_DEVIATIONS], *([f"and {more} more"] if more > 0 else [])]
        equal = len(compared) - len(apart)
        digits = "" if spec.last_digits == 0.5 else f" ± {spec.last_digits:g} last digits"
        return Judgement(
            state="refuted" if apart else "confirmed",
            text=spec.text,
            asked=f"{len(compared)} printed value{'s' * (len(compared) != 1)}{digits}",
            got=f"{equal} of {len(compared)} equal",
            reason="; ".join(shown),
            source=source,
        )

    def _beside(
        self, table: Table, rows: Sequence[Mapping[str, Cell]], twins: Mapping[str, str]
    ) -> list[dict[str, Cell]]:
        """Return the rows with the published values of the reference, all of which are used.

        A row belongs to the published one whose cell it agrees with to the printed digit.
        """
        spec, reference = self.spec, self.reference
        assert reference is not None  # it was read with the Spec
        if spec.on not in reference.columns:
            raise MissingResultError(f"the published values have no column {spec.on!r}")
        known = [column.name for column in table.columns]
        for name in reference.columns:
            is_number = any(isinstance(row[name], Printed) for row in reference.rows)
            if is_number and not spec.columns and name not in known:
                hint = did_you_mean(name, known, otherwise="the table has")
                raise MissingResultError(f"the published column {name!r} is not computed{hint}")
        made, used = [], set()
        for row in rows:
            wide = {name: value for name, value in row.items() if name not in twins}
            for index, published in enumerate(reference.rows):
                if _is_same_key(row.get(spec.on), published[spec.on]):
                    used.add(index)
                    wide |= {
                        f"{name}{PAPER_SUFFIX}": value
                        for name, value in published.items()
                        if name != spec.on and isinstance(value, Printed)
                    }
            made.append(wide)
        lost = [row[spec.on] for index, row in enumerate(reference.rows) if index not in used]
        if lost and not spec.row:
            names = ", ".join(getattr(key, "text", str(key)) for key in lost[:_SHOWN_DEVIATIONS])
            raise MissingResultError(f"not computed: published rows with {spec.on} {names}")
        return made


class NotDerivable:
    """A claim that cannot be derived from what its source gives.

    Parameters
    ----------
    spec : NotDerivableSpec
        Its parameters.
    """

    def __init__(self, spec: NotDerivableSpec) -> None:
        self.spec = spec

    def judge(self, evidence: Evidence) -> Judgement:
        """Return the stated reason; no result is read."""
        spec = self.spec
        return Judgement("not derivable", spec.text, reason=spec.reason, source=spec.source)


def format_margin(row: Mapping[str, Any]) -> str:
    """Return the distance of a value from its limit: ``"3 decades"``, ``"12 %"``.

    Parameters
    ----------
    row : mapping
        Fields of a `hillsphere.interfaces.outcomes.Judgement`.

    Returns
    -------
    str
        Empty without a limit or a finite margin.
    """
    # An infinite margin is a text in summary.json.
    if isinstance(row["margin"], str | None) or row["asked"][:1] not in ("≤", "<", "≥", ">"):
        return ""
    margin, value, limit = float(row["margin"]), float(row["value"]), float(row["limit"])
    if not math.isfinite(margin):
        return ""
    smaller, larger = sorted((abs(value), abs(limit)))
    if margin > 0.0 and smaller > 0.0 and value * limit > 0.0 and larger / smaller >= _DECADE:
        decades = math.floor(math.log10(larger / smaller))
        return f"{decades} decade{'s' * (decades != 1)}"
    if limit == 0:
        return f"{margin:.3g} {row['unit']}".strip().replace("-", "−")
    return f"{100.0 * margin / abs(limit):.3g} %".replace("-", "−")


def format_value(value: _Plain | None, unit: str, *, apart_from: _Plain | None = None) -> str:
    """Return a value with its unit as a reader sees it: ``"1.19 m/s"``, ``"yes"``.

    Parameters
    ----------
    value : float, int, bool, str or None
        The value; numbers have four significant digits.
    unit : str
        Its unit, ``""`` for none.
    apart_from : float, int, bool or str, optional
        Another number: further digits are shown until the two look different.
    """
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = value if isinstance(value, str) else _number(value, _DIGITS)
    if isinstance(value, float) and isinstance(apart_from, float | int) and value != apart_from:
        digits = _DIGITS
        while text == _number(float(apart_from), digits) and digits < _MOST_DIGITS:
            digits += 1
            text = _number(value, digits)
    return f"{text} {unit}".strip() if unit != "°" else f"{text}°"


def _interval_text(low: float, high: float) -> str:
    """Return an interval in words, without an end that is infinite."""
    ends = [format_value(end, "") for end in (low, high)]
    if high == math.inf:
        return "no finite end" if low == -math.inf else f"at least {ends[0]}"
    return f"at most {ends[1]}" if low == -math.inf else " to ".join(ends)


def _write_limit(value: _Plain, unit: str) -> str:
    """Return a limit as the mission writes it."""
    if isinstance(value, bool | str):
        return format_value(value, "")
    return f"{_number(value, _MOST_DIGITS)} {unit}".strip()


def _number(value: float | int, digits: int) -> str:
    """Return a number with so many significant digits, a whole number with all of its digits."""
    text = str(value) if isinstance(value, int) else f"{value:.{digits}g}"
    mantissa, e, exponent = text.partition("e")
    return (f"{mantissa}e{int(exponent)}" if e else text).replace("-", "−")


def _kind(value: _Plain) -> str:
    if isinstance(value, bool):
        return "true or false"
    return "a text" if isinstance(value, str) else "a number"


def _plain(cell: Any) -> _Plain:
    made: _Plain = cell.item() if hasattr(cell, "dtype") else cell
    return made


def _or_inf(margin: float | None) -> float:
    return math.inf if margin is None else margin


def _margin(op: str, value: _Plain, limit: _Plain) -> float | None:
    if isinstance(value, bool | str) or isinstance(limit, bool | str):
        return None
    if op in ("<=", "<"):
        return float(limit - value)
    if op in (">=", ">"):
        return float(value - limit)
    return -abs(float(value - limit)) if op == "==" else abs(float(value - limit))


def _in_unit(value: _Plain, unit: str, wanted: str) -> _Plain:
    """Convert a value to the unit of the result."""
    given, own = unit.translate(_PLAIN_DIGITS), wanted.translate(_PLAIN_DIGITS)
    if not unit or given == own or isinstance(value, bool | str):
        return value
    for units in UNITS.values():
        factors = {suffix.replace("_", "/"): factor for suffix, factor in units.items()}
        if given in factors and own in factors:
            return float(value) * factors[given] / factors[own]
    raise MissingResultError(f"the result is in {wanted or 'no unit'}, and the value in {unit}")


def _column(table: Table, name: str) -> Column:
    for column in table.columns:
        if column.name == name:
            return column
    hint = did_you_mean(name, [c.name for c in table.columns], otherwise="it has")
    raise MissingResultError(f"table {table.title!r} has no column {name!r}{hint}")


def _rows(table: Table, selected: Mapping[str, _Plain]) -> list[Mapping[str, Cell]]:
    for name in selected:
        _column(table, name)
    rows = [row for row in table.rows if _is_selected(row, selected)]
    if not rows:
        given = ", ".join(f"{name} = {value!r}" for name, value in selected.items())
        raise MissingResultError(
            f"table {table.title!r} has no row with {given}" if given
            else f"table {table.title!r} has no rows"
        )  # fmt: skip
    return rows


def _is_selected(row: Mapping[str, Cell], selected: Mapping[str, _Plain]) -> bool:
    for name, wanted in selected.items():
        cell = row.get(name)
        if isinstance(wanted, bool | str) or isinstance(cell, bool | str | None):
            if cell != wanted:
                return False
        elif not math.isclose(float(cell), float(wanted), rel_tol=_KEY_TOLERANCE):
            return False
    return True


def _row_name(table: Table, row: Mapping[str, Cell]) -> str:
    """Return the first cells of a row, as many as tell it from the others."""
    names: list[str] = []
    alike: list[Mapping[str, Cell]] = list(table.rows)
    for column in table.columns:
        cell = row.get(column.name)
        names.append(format_value(None if cell is None else _plain(cell), ""))
        alike = [other for other in alike if other.get(column.name) == cell]
        if len(alike) <= 1 or len(names) == _MOST_NAMES:
            break
    return ", ".join(names)


def _interval(column: Column, row: Mapping[str, Cell]) -> tuple[float, float] | None:
    ends = [row.get(name) for name in column.interval]
    if len(ends) != 2 or any(isinstance(end, str | bool | None) for end in ends):
        return None
    return float(ends[0]), float(ends[1])  # type: ignore[arg-type]


def _is_same_key(cell: Cell, key: Printed | str | None) -> bool:
    if isinstance(key, Printed) and isinstance(cell, float | int):
        return key.agrees(cell)
    return cell is not None and cell == key


def _agrees(cell: Cell, printed: Printed, last_digits: float) -> bool:
    if isinstance(cell, str | None) or not math.isfinite(cell):
        return False
    return abs(printed.difference(cell)) <= last_digits


def _deviation(cell: Cell, printed: Printed) -> str:
    if isinstance(cell, str | None) or not math.isfinite(cell):
        return f"{cell if isinstance(cell, str) else 'no value'} for {printed.text}"
    return f"{cell:.6g} for {printed.text}"
