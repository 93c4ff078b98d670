"""Specs of the requirements and claims that a mission states."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, Self, TypeAlias

from pydantic import model_validator

from hillsphere.spec.base import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    data_path,
    option,
    reference,
    rule,
)
from hillsphere.spec.result_names import PUBLISHED, is_named, nearest_name

_Misfits: TypeAlias = Iterator[tuple[tuple[str | int, ...], str]]
"""Location and message of every name that a stage does not have."""

__all__ = ["ComparisonSpec", "NotDerivableSpec", "ResultSpec", "StatementSpec", "ValueSpec"]


def _result_names(stage: str, tables: Mapping[str, Mapping[str, Spec]]) -> ResultNames | None:
    """Return what a stage presents; None if it is no stage, or does not say."""
    spec = tables.get("stage", {}).get(stage)
    return spec.result_names() if isinstance(spec, StageSpec) else None


def _missing_metric(stage: str, metric: str, tables: Mapping[str, Mapping[str, Spec]]) -> _Misfits:
    names = _result_names(stage, tables)
    if names is not None and not is_named(metric, names.metrics):
        hint = nearest_name(metric, names.metrics) if names.metrics else "; it has none"
        yield ("metric",), f"stage {stage!r} has no metric {metric[:60]!r}{hint}"


def _missing_columns(
    stage: str,
    table: str,
    columns: Sequence[tuple[tuple[str | int, ...], str]],
    tables: Mapping[str, Mapping[str, Spec]],
) -> _Misfits:
    names = _result_names(stage, tables)
    if names is None:
        return
    if not is_named(table, names.tables):
        hint = nearest_name(table, names.tables) if names.tables else "; it has none"
        yield ("table",), f"stage {stage!r} has no table {table[:60]!r}{hint}"
        return
    known = names.columns_of(table)
    for where, column in columns:
        if known and not is_named(column.removesuffix(PUBLISHED), known):
            hint = nearest_name(column, known)
            yield where, f"table {table!r} of stage {stage!r} has no column {column[:60]!r}{hint}"


class _OutcomeSpec(Spec):
    """The words of a requirement or claim."""

    text: str = option("the requirement or statement in words, as tables show it", min_length=1)
    source: str = option("where it is stated, such as 'Table 2' of a paper", default="")


class ResultSpec(_OutcomeSpec):
    """A result of a stage and the value that it is compared with."""

    examples = (
        {"text": "orbits close", "stage": "family", "metric": "closure_max", "op": "<=",
         "value": 1e-9},
        {
            "text": "periods are short", "stage": "family", "table": "table_1",
            "column": "period_h", "op": "<=", "value": 8, "unit": "h",
        },
    )  # fmt: skip

    stage: Ref = reference("stage", "the stage whose result is compared")
    metric: str = option("name of one of its metrics", default="")
    table: str = option("instead of a metric: name of one of its tables", default="")
    row: dict[str, float | int | bool | str] = option(
        "column and value of the table's rows that are compared; every such row must comply, and "
        "the worst is shown. By default all rows",
        default={},
    )
    column: str = option("column of the table that holds the compared values", default="")
    op: Literal["<=", "<", ">=", ">", "==", "!="] = option(
        "relation in which the result must stand to 'value'"
    )
    value: float | int | bool | str = option("value that the result is compared with")
    unit: str = option(
        "unit of 'value', such as 'km' or 'm/s'; by default that of the result", default=""
    )
    confidence: float | None = option(
        "probability with which the answer must hold: the result's confidence interval decides, "
        "and a result without one is undecided. By default the result itself decides, unless it "
        "has proved bounds: these always decide",
        default=None, gt=0.0, lt=1.0,
    )  # fmt: skip

    @model_validator(mode="after")
    def _one_result(self) -> Self:
        if bool(self.metric) == bool(self.table):
            raise rule("metric", "give either 'metric', or 'table' and 'column'")
        if bool(self.table) != bool(self.column):
            raise rule("column", "'table' and 'column' belong together")
        if self.row and not self.table:
            raise rule("row", "'row' selects rows of a 'table'")
        if isinstance(self.value, bool | str):
            if self.op not in ("==", "!="):
                raise rule("op", "a text, true or false can only be compared by '==' and '!='")
            if self.unit:
                raise rule("unit", "a text, true or false has no unit")
            if self.confidence is not None:
                raise rule("confidence", "a text, true or false has no confidence interval")
        return self

    def misfits(
        self, tables: Mapping[str, Mapping[str, Spec]]
    ) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield the names that the stage does not have, as far as it declares what it has."""
        if self.metric:
            yield from _missing_metric(self.stage.name, self.metric, tables)
        else:
            columns = [(("column",), self.column), *((("row", name), name) for name in self.row)]
            yield from _missing_columns(self.stage.name, self.table, columns, tables)


class ValueSpec(ResultSpec):
    """A requirement on a metric, or on the cells of a table."""


class StatementSpec(ResultSpec):
    """A statement about a metric, or about the cells of a table."""


class ComparisonSpec(_OutcomeSpec):
    """A comparison of a table with published values, to their printed digits."""

    examples = (
        {
            "text": "initial states of the orbits", "source": "Table 1", "stage": "family",
            "table": "table_1",
        },
    )  # fmt: skip

    stage: Ref = reference("stage", "the stage whose table is compared")
    table: str = option("name of the table", min_length=1)
    columns: tuple[str, ...] = option(
        "the compared columns; by default all that have published values", default=()
    )
    row: dict[str, float | int | bool | str] = option(
        "column and value of the compared rows; by default all rows", default={}
    )
    reference: DataPath | None = data_path(
        "cited CSV file of the published values; by default those beside the table's own "
        "columns, NAME_paper",
        default=None,
    )
    on: str = option("column by which rows are matched with those of 'reference'", default="")
    last_digits: float = option(
        "largest difference from a published value in units of its last printed digit; 0.5 is "
        "agreement after rounding",
        default=0.5, ge=0.5, le=1e6,
    )  # fmt: skip

    @model_validator(mode="after")
    def _matched(self) -> Self:
        if (self.reference is None) != (not self.on):
            raise rule("on", "'reference' and 'on' belong together")
        return self

    def misfits(
        self, tables: Mapping[str, Mapping[str, Spec]]
    ) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield the names that the stage does not have, as far as it declares what it has."""
        columns = [(("row", name), name) for name in self.row]
        yield from _missing_columns(self.stage.name, self.table, columns, tables)


class NotDerivableSpec(_OutcomeSpec):
    """A statement that cannot be derived from what its source gives."""

    examples = (
        {
            "text": "the margin is 3 dB", "source": "Section 4",
            "reason": "the source does not give the weights",
        },
    )  # fmt: skip

    reason: str = option("what is missing", min_length=1)
