"""Presentation of a stage's result: metrics, tables and figures, which are drawn later."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import TYPE_CHECKING, TypeAlias

from hillsphere.base.errors import StageError
from hillsphere.show.cells import CELL_TYPES, Cell, Printed, render_cell, render_grid
from hillsphere.show.charts import Chart, Space
from hillsphere.show.colours import PALETTE

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure as MatplotlibFigure

__all__ = [
    "PALETTE", "AnyFigure", "Cell", "Column", "Figure", "Metric", "Presentation", "Printed",
    "Table", "check_presentation", "presentation_faults",
]  # fmt: skip

_IDENTIFIER = re.compile(r"[a-z][a-z0-9_]{0,99}")
_FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,80}(\.[a-z0-9]{1,8}){1,2}")

_NOTEBOOK_ROWS = 60
"""Rows of a table in a notebook, as many as pandas shows."""


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
        Probability with which the interval holds the true value; 1 for proved bounds.
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
        Probability with which an interval holds the true value; 1 for proved bounds.
    """

    name: str
    unit: str = "-"
    label: str = ""
    digits: int = 8
    interval: tuple[str, str] | tuple[()] = ()
    confidence: float | None = None


@dataclass(frozen=True, repr=False)
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
    total : int, optional
        Rows of the whole table, where only the first are listed (see `first`). Marks of figures may
        stand for any of them.
    """

    title: str
    columns: Sequence[Column]
    rows: Sequence[Mapping[str, Cell]]
    notes: Sequence[str] = ()
    total: int | None = None

    def first(self, count: int, what: str = "") -> Table:
        """Return a table that lists at most the first rows.

        Parameters
        ----------
        count : int
            Rows at most.
        what : str
            What the rows are, ``"models"``, for a note that the table is cut; empty for no note.

        Returns
        -------
        Table
            This one, if it is not longer.
        """
        total = len(self.rows)
        if total <= count:
            return self
        notes = [*self.notes, f"The first {count} of {total} {what}."] if what else self.notes
        return replace(self, rows=self.rows[:count], notes=notes, total=total)

    def __repr__(self) -> str:
        names = ", ".join(column.name for column in self.columns)
        return f"<Table {self.title!r}: {len(self.rows)} rows of {names}>"

    def _repr_html_(self) -> str:
        """Return title, first rows and notes for a notebook."""
        heads = [
            f"{c.label}, {c.unit}" if c.label and c.unit not in ("", "-") else c.label or c.name
            for c in self.columns
        ]
        rows = [
            [render_cell(row.get(c.name), c.digits) for c in self.columns]
            for row in self.rows[:_NOTEBOOK_ROWS]
        ]
        notes = list(self.notes)
        if len(self.rows) > _NOTEBOOK_ROWS:
            notes.append(f"The first {_NOTEBOOK_ROWS} of {len(self.rows)} rows.")
        told = "".join(f"<p>{escape(note)}</p>" for note in notes)
        return f"<p><b>{escape(self.title)}</b></p>{render_grid(heads, rows)}{told}"

    def to_pandas(self) -> pandas.DataFrame:
        """Return the table as a data frame.

        Returns
        -------
        pandas.DataFrame
            A column per column, by name; blank cells are missing values. ``attrs`` holds title,
            units by column and notes.

        Raises
        ------
        ImportError
            If pandas is not installed; the extra ``notebook`` brings it.
        """
        import pandas

        names = [column.name for column in self.columns]
        frame = pandas.DataFrame([[row.get(name) for name in names] for row in self.rows],
                                 columns=names)  # fmt: skip
        frame.attrs = {
            "title": self.title,
            "units": {column.name: column.unit for column in self.columns},
            "notes": list(self.notes),
        }
        return frame


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
        Further files by name (``"qso.oem"``), for other programs to read: text is written as UTF-8,
        bytes as they are.
    """

    metrics: Mapping[str, Metric] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    figures: Mapping[str, AnyFigure] = field(default_factory=dict)
    verdict: Sequence[str] = ()
    files: Mapping[str, str | bytes] = field(default_factory=dict)


_TOLD = 3
"""Faults in one message at most: a fault of one mark is usually that of all marks of its figure."""


def check_presentation(shown: object) -> Presentation:
    """Return the result of a stage's ``present``, after a check that it can be written to files.

    Parameters
    ----------
    shown : object
        What the stage returned.

    Returns
    -------
    Presentation
        The same object.

    Raises
    ------
    StageError
        If it is not a `Presentation`, or `presentation_faults` finds a fault.
    """
    if not isinstance(shown, Presentation):
        raise StageError(f"present must return a Presentation, got a {type(shown).__name__}")
    if faults := presentation_faults(shown):
        more = f"; and {len(faults) - _TOLD} more" if len(faults) > _TOLD else ""
        raise StageError("its presentation is invalid: " + "; ".join(faults[:_TOLD]) + more)
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
    faults += [
        f"file {name!r}: its content must be text or bytes, got {type(content).__name__}"
        for name, content in presentation.files.items()
        if not isinstance(content, str | bytes)
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
    table = tables[chart.table] if chart.table else None
    count = 0 if table is None else max(len(table.rows), table.total or 0)
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
    return isinstance(value, CELL_TYPES) or (
        hasattr(value, "dtype") and getattr(value, "ndim", 1) == 0
    )
