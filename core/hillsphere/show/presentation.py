"""Presentation of a stage's result: metrics, tables and figures, which are drawn later."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import TYPE_CHECKING, TypeAlias

from hillsphere.base.errors import StageError
from hillsphere.show.charts import Chart, Space
from hillsphere.show.colours import PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

__all__ = [
    "PALETTE", "AnyFigure", "Cell", "Column", "Figure", "Metric", "Presentation", "Printed",
    "Table", "check_presentation", "presentation_faults",
]  # fmt: skip

_IDENTIFIER = re.compile(r"[a-z][a-z0-9_]{0,99}")
_FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,80}(\.[a-z0-9]{1,8}){1,2}")
_DECIMAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)

Cell: TypeAlias = float | int | str | bool | None
"""Content of one cell of a table; ``None`` leaves it blank."""
_CELL_TYPES = (float, int, str, type(None))
"""Its types, of which int has the truth values; a tuple, since campaigns have a million cells."""


class Printed(float):
    """A number as printed in a paper: its value and its number of digits.

    It is a float. In a table it belongs in a ``*_paper`` column beside the computed one; the report
    marks whether the two agree to the printed digit.

    Parameters
    ----------
    text : str
        The number as printed, e.g. ``"7.10"``; a typographic minus is understood.

    Raises
    ------
    ValueError
        If it is not a finite decimal number.
    """

    text: str

    def __new__(cls, text: str) -> Printed:
        """Parse the printed text."""
        plain = text.strip().replace("\u2212", "-")
        if not _DECIMAL.fullmatch(plain):
            raise ValueError(f"not a decimal number: {text!r}")
        made = super().__new__(cls, plain)
        if not math.isfinite(made):
            raise ValueError(f"too large: {text!r}")
        made.text = plain
        return made

    def __reduce__(self) -> tuple[type[Printed], tuple[str]]:
        return Printed, (self.text,)

    @property
    def last_digit(self) -> float:
        """One unit of the last printed digit: 0.01 of ``"7.10"``."""
        return float(f"1e{self._exponent}")

    @property
    def _exponent(self) -> int:
        mantissa, _, exponent = self.text.lower().partition("e")
        return int(exponent or 0) - len(mantissa.partition(".")[2])

    def difference(self, value: float) -> float:
        """Return value − printed in units of the last printed digit."""
        # Scaled in decimal: in binary 39.45 − 39.4 is 0.0500…04, half a unit and a bit.
        return float((Decimal(repr(float(value))) - Decimal(self.text)).scaleb(-self._exponent))

    def agrees(self, value: float) -> bool:
        """Whether the value, rounded to the printed digit, is the printed number."""
        return math.isfinite(value) and abs(self.difference(value)) <= 0.5


@dataclass(frozen=True)
class Metric:
    """One number of a result with its unit (``"-"`` for none).

    Parameters
    ----------
    value : float, int, bool or str
        The number, or a word.
    unit : str
        Its unit.
    interval : tuple of float, optional
        Confidence interval of the value, in its unit.
    confidence : float, optional
        Probability with which the interval holds the true value.
    """

    value: float | int | bool | str
    unit: str = "-"
    interval: tuple[float, float] | None = None
    confidence: float | None = None


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Parameters
    ----------
    name : str
        Key of its cells, with the unit, if any, as suffix (``"x0_km"``). A column ``NAME_paper``
        holds the published values for the column ``NAME``.
    unit : str
        ``"-"`` for numbers without unit, ``""`` for text.
    label : str
        Heading in the report; by default the name without the unit's suffix.
    digits : int
        Significant digits in the report; files have full precision.
    interval : tuple of str
        Names of two other columns with the lower and upper end of the cells' confidence intervals.
    confidence : float, optional
        Probability with which an interval holds the true value.
    """

    name: str
    unit: str = "-"
    label: str = ""
    digits: int = 8
    interval: tuple[str, str] | tuple[()] = ()
    confidence: float | None = None


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
        Notes for the reader: source of the ``*_paper`` columns, reasons for differences.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Mapping[str, Cell]]
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class Figure:
    """A figure of a result that a stage draws itself with matplotlib; `Chart` is one as data.

    A page can only show it as a picture.

    Parameters
    ----------
    title : str
        Heading in the report.
    draw : callable
        ``draw(figure)`` fills an empty `matplotlib.figure.Figure`; matplotlib is imported only
        when a report is made.
    caption : str
        Description of the figure's content.
    size_in : tuple of float
        Width and height in inches.
    """

    title: str
    draw: Callable[[MatplotlibFigure], None]
    caption: str = ""
    size_in: tuple[float, float] = (7.0, 4.5)


AnyFigure: TypeAlias = Figure | Chart


@dataclass(frozen=True)
class Presentation:
    """Metrics, tables, figures, verdict and files of a stage.

    Parameters
    ----------
    metrics, tables, figures : mapping
        Items by identifier (lower case, underscores), which is the name of the file too. If two
        stages of a mission use the same one, the later becomes ``IDENTIFIER_STAGE``.
    verdict : sequence of str
        Sentences for the head of the report, model-validity warnings among them.
    files : mapping
        Further text files by name (``"qso.oem"``), for other programs to read.
    """

    metrics: Mapping[str, Metric] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    figures: Mapping[str, AnyFigure] = field(default_factory=dict)
    verdict: Sequence[str] = ()
    files: Mapping[str, str] = field(default_factory=dict)


def check_presentation(shown: object) -> Presentation:
    """Return the result of a stage's ``present``, after a check that it can be written to files.

    Raises
    ------
    StageError
        If it is not a `Presentation`, or `presentation_faults` finds a fault.
    """
    if not isinstance(shown, Presentation):
        raise StageError(f"present must return a Presentation, got a {type(shown).__name__}")
    if faults := presentation_faults(shown):
        raise StageError("its presentation is invalid: " + "; ".join(faults))
    return shown


def presentation_faults(presentation: Presentation) -> list[str]:
    """Return the faults of a presentation, one sentence each.

    Parameters
    ----------
    presentation : Presentation
        Presentation of a stage.

    Returns
    -------
    list of str
        Faults: an identifier that cannot name a file, a column that occurs twice, a cell without a
        column, a value that is not a number, a text or ``None``, or a mark of a figure that stands
        for a row that no table has. Empty without any.
    """
    faults = []
    for what, group in (
        ("metric", presentation.metrics),
        ("table", presentation.tables),
        ("figure", presentation.figures),
    ):
        faults += [
            f"{what} {name!r}: an identifier is lower-case letters, digits and underscores"
            for name in group
            if not _IDENTIFIER.fullmatch(name)
        ]
    faults += [
        f"file {name!r}: its name must be letters, digits, '-', '_' and '.', with a suffix"
        for name in presentation.files
        if not _FILE.fullmatch(name)
    ]
    for name, figure in presentation.figures.items():
        if isinstance(figure, Chart):
            faults += _chart_faults(name, figure, presentation.tables)
    for name, metric in presentation.metrics.items():
        if not _is_cell(metric.value):
            faults.append(f"metric {name!r}: its value is a {type(metric.value).__name__}")
    for name, table in presentation.tables.items():
        columns = [column.name for column in table.columns]
        if len(set(columns)) < len(columns):
            faults.append(f"table {name!r}: a column is listed twice in {columns}")
        faults += [
            f"table {name!r}: column {column.name!r} names {end!r} as an end of its interval, "
            "which is no column"
            for column in table.columns
            for end in column.interval
            if end not in columns
        ]
        known = set(columns)
        for index, row in enumerate(table.rows):
            if not row.keys() <= known:
                extra = sorted(row.keys() - known)
                faults.append(f"table {name!r}, row {index}: no column is called {extra}")
            faults += [
                f"table {name!r}, row {index}: {key} is a {type(value).__name__}"
                for key, value in row.items()
                if not _is_cell(value)
            ]
    return faults


def _chart_faults(name: str, chart: Chart, tables: Mapping[str, Table]) -> list[str]:
    if chart.table and chart.table not in tables:
        return [f"figure {name!r}: its table {chart.table!r} is not one of {sorted(tables)}"]
    count = len(tables[chart.table].rows) if chart.table else 0
    faults = []
    for panel in chart.panels:
        for mark in panel.solids if isinstance(panel, Space) else panel.marks:
            given = getattr(mark, "rows", None)
            rows = [] if given is None else [given] if isinstance(given, int) else list(given)
            if rows and not 0 <= min(rows) <= max(rows) < count:
                faults.append(
                    f"figure {name!r}: a {type(mark).__name__} stands for rows {min(rows)} to "
                    f"{max(rows)} of its table {chart.table!r}, which has {count}"
                )
    return faults


def _is_cell(value: object) -> bool:
    # numpy's scalars have a dtype and no axis; numpy itself is not imported here.
    return isinstance(value, _CELL_TYPES) or (
        hasattr(value, "dtype") and getattr(value, "ndim", 1) == 0
    )
