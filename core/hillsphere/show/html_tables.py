"""Tables of the report as HTML.

Constants are lifted into the caption, a table of few rows and many columns is transposed, and
columns beyond the eighth are hidden until a reader asks for them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from hillsphere.show.cells import Cell, Printed, render_cell
from hillsphere.show.presentation import Column, Table
from hillsphere.show.reference import computed_columns, without_unit

__all__ = ["heading_text", "render_table"]

MAX_ROWS = 200
"""Most rows of a table in the report, so that the page stays readable; the CSV file has all."""
_SHOWN_COLUMNS = 8
"""Columns at first sight: more do not fit a page beside the contents."""
_FEW_ROWS = 3
"""Rows up to which a table with more columns than are shown is transposed."""
_MOST_DIGITS_OFF = 100.0
"""Units of the last printed digit from which a difference is told in per cent: its size says more
than its digits."""
_FEWEST_FOR_CONSTANTS = 3
"""Rows from which a column with one value is a constant of the table, not a coincidence."""


def render_table(name: str, table: Table, csv: str) -> str:
    """Return a table as HTML.

    Parameters
    ----------
    name : str
        Its identifier in the run.
    table : Table
        The table.
    csv : str
        Path of its CSV file beside the page.

    Returns
    -------
    str
        A ``<figure>`` with caption, table and notes.
    """
    twins = computed_columns(table.columns)
    constants = [] if twins else _constants(table)
    columns = [column for column in table.columns if column not in constants]
    caption = f"<b>{escape(table.title)}</b>"
    if constants:
        row = table.rows[0]
        told = (f"{heading_text(c)} {render_cell(row.get(c.name), c.digits)}"
                f"{_unit(c.unit, ' ')}" for c in constants)  # fmt: skip
        caption += f" <span class=soft>({', '.join(told)})</span>"
    if len(table.rows) <= _FEW_ROWS and len(columns) > _SHOWN_COLUMNS:
        body, is_wide = _lay_transposed(table, columns, twins), False
    else:
        body, is_wide = _lay_upright(table, columns, twins), len(columns) > _SHOWN_COLUMNS
    notes = list(table.notes)
    if any(isinstance(row.get(twin), Printed) for row in table.rows for twin in twins):
        notes.append(
            "✓ agrees with the paper to its printed digit; Δ difference (computed − paper) in "
            "units of the paper's last digit, or in per cent if it is a hundred of them or more."
        )
    if len(table.rows) > MAX_ROWS:
        notes.append(f"The first {MAX_ROWS} of {len(table.rows)} rows; {csv} has all.")
    part = f" {MAX_ROWS} of {len(table.rows)} rows" if len(table.rows) > MAX_ROWS else ""
    buttons = f"<button type=button class=copy hidden>copy{part} as CSV</button>"
    if is_wide:
        buttons = (
            f"<button type=button class=all hidden>all {len(columns)} columns</button>{buttons}"
        )
    return (
        f'<figure class=table id="table-{escape(name)}"><figcaption>{caption}</figcaption>'
        f'<div class=wide tabindex=0 role=region aria-label="{escape(table.title)}">{body}</div>'
        f'<p class=tools>{buttons}<a href="{escape(csv)}">{escape(csv.rpartition("/")[2])}</a></p>'
        + "".join(f"<p class=notes>{escape(note)}</p>" for note in notes)
        + "</figure>"
    )


def _constants(table: Table) -> list[Column]:
    """Return the columns, the first apart, that have one value in all rows."""
    if len(table.rows) < _FEWEST_FOR_CONSTANTS:
        return []
    found = []
    for column in table.columns[1:]:
        first = table.rows[0].get(column.name)
        if all(_is_same(row.get(column.name), first) for row in table.rows):
            found.append(column)
    return found


def _is_same(one: Cell, other: Cell) -> bool:
    return type(one) is type(other) and one == other


def _lay_upright(table: Table, columns: Sequence[Column], twins: Mapping[str, str]) -> str:
    # Constants, which the caption tells, are there without being shown: a copy has every column.
    hidden = {column.name: "constant" for column in table.columns}
    hidden |= {column.name: "" for column in columns}
    hidden |= {column.name: "more" for column in columns[_SHOWN_COLUMNS:]}
    head = "".join(
        _heading(column, column.name in twins, hidden[column.name], "col")
        for column in table.columns
    )
    rows = "".join(
        f"<tr{f' data-row={index}'}>{_row(table.columns, twins, row, hidden)}</tr>"
        for index, row in enumerate(table.rows[:MAX_ROWS])
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _lay_transposed(table: Table, columns: Sequence[Column], twins: Mapping[str, str]) -> str:
    lines = []
    for column in columns:
        cells = "".join(_cell(column, twins, row, "") for row in table.rows)
        lines.append(f"<tr>{_heading(column, column.name in twins, '', 'row')}{cells}</tr>")
    return f"<table class=transposed><tbody>{''.join(lines)}</tbody></table>"


def _heading(column: Column, is_twin: bool, hidden: str, scope: str) -> str:
    text = column.label or ("paper" if is_twin else heading_text(column))
    unit = "" if is_twin else column.unit  # that of the computed column beside it
    classes = _classes("twin" * is_twin, "text" * (not column.unit), hidden)
    name = f' data-v="{escape(column.name)}"'
    return f"<th scope={scope}{classes}{name}>{escape(text)}{_unit(unit, '', 'unit')}</th>"


def heading_text(column: Column) -> str:
    """Return the label of a column, or its name without its unit, which is shown beside it."""
    return column.label or without_unit(column).replace("_", " ")


def _unit(unit: str, before: str, css: str = "") -> str:
    if unit in ("", "-"):
        return ""
    shown = before + escape(unit)
    return f'<span class="{css}">{shown}</span>' if css else shown


def _row(
    columns: Iterable[Column], twins: Mapping[str, str], row: Mapping[str, Cell],
    hidden: Mapping[str, str],
) -> str:  # fmt: skip
    return "".join(
        _cell(column, twins, row, hidden[column.name], is_first=index == 0)
        for index, column in enumerate(columns)
    )


def _cell(
    column: Column, twins: Mapping[str, str], row: Mapping[str, Cell], hidden: str, *,
    is_first: bool = False,
) -> str:  # fmt: skip
    value = row.get(column.name)
    is_twin = column.name in twins
    mark = _mark(row.get(twins[column.name]), value) if is_twin else ""
    is_text = not column.unit or isinstance(value, str)
    classes = _classes("twin" * is_twin, "text" * is_text, hidden)
    tag = "th scope=row" if is_first else "td"
    return f"<{tag}{classes}{_exact(value)}>{render_cell(value, column.digits)}{mark}</{tag[:2]}>"


def _classes(*names: str) -> str:
    kept = " ".join(filter(None, names))
    return f' class="{kept}"' if kept else ""


def _exact(value: Any) -> str:
    """Return the attribute with a cell as the CSV file has it, where its text is another."""
    plain = value.item() if hasattr(value, "dtype") else value
    if plain is None:
        return ' data-v=""'
    if isinstance(plain, Printed):
        return f" data-v={plain.text}"
    return f" data-v={plain!r}" if isinstance(plain, bool | float) else ""


def _mark(ours: Any, printed: Any) -> str:
    if not isinstance(printed, Printed) or isinstance(ours, str) or ours is None:
        return ""
    value = float(ours)
    if printed.agrees(value):
        return ' <span class=agrees title="agrees to the printed digit">✓</span>'
    if not math.isfinite(value):
        return " <span class=differs>Δ</span>"
    difference = printed.difference(value)
    title = "difference in units of the last printed digit"
    shown = f"{difference:+.2f}"
    if abs(difference) >= _MOST_DIGITS_OFF and printed != 0.0:
        title, shown = "relative difference", f"{100.0 * (value / printed - 1.0):+.3g} %"
    return f' <span class=differs title="{title}">Δ {shown}</span>'
