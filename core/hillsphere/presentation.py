"""What a stage shows of its result: metrics, tables and figures, without drawing anything yet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

Cell: TypeAlias = float | int | str | bool | None


@dataclass(frozen=True)
class Metric:
    """One number of a result with its unit (``"-"`` where it has none)."""

    value: float | int | bool | str
    unit: str = "-"


@dataclass(frozen=True)
class Column:
    """Name and unit of a table's column; ``"-"`` for numbers without unit, ``""`` for text."""

    name: str
    unit: str = "-"


@dataclass(frozen=True)
class Table:
    """A table of a result.

    Parameters
    ----------
    title : str
        Heading in the report.
    columns : sequence of Column
        In order.
    rows : sequence of mapping
        Column name to cell; a missing cell is ``None``. Nothing is rounded here.
    notes : sequence of str
        What a reader must know: source of the ``*_paper`` columns, why a value differs.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Mapping[str, Cell]]
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class Figure:
    """A figure of a result.

    Parameters
    ----------
    title : str
        Heading in the report.
    draw : callable
        ``draw(figure)`` fills an empty `matplotlib.figure.Figure`; matplotlib is imported only
        when a report is made.
    caption : str
        What is to be seen.
    size_in : tuple of float
        Width and height in inches.
    """

    title: str
    draw: Callable[[MatplotlibFigure], None]
    caption: str = ""
    size_in: tuple[float, float] = (7.0, 4.5)


@dataclass(frozen=True)
class Presentation:
    """Everything that a stage shows.

    Parameters
    ----------
    metrics, tables, figures : mapping
        By identifier (lower case, underscores), unique within a mission.
    verdict : sequence of str
        Sentences for the head of the report, model-validity warnings among them.
    """

    metrics: Mapping[str, Metric] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    figures: Mapping[str, Figure] = field(default_factory=dict)
    verdict: Sequence[str] = ()
