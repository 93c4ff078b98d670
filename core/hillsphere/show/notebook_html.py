"""Results as HTML for notebooks; what a notebook shows needs neither script nor style sheet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape

from hillsphere.show.html_tables import render_cell
from hillsphere.show.presentation import Metric, Table

__all__ = ["grid_html", "metrics_html", "table_html"]

_MOST_ROWS = 60
"""Rows of a table in a notebook, as many as pandas shows."""


def metrics_html(metrics: Mapping[str, Metric]) -> str:
    """Return metrics as a table."""
    rows = [
        (escape(name), render_cell(one.value, 8), "" if one.unit == "-" else escape(one.unit))
        for name, one in metrics.items()
    ]
    return grid_html(("metric", "value", "unit"), rows) if rows else ""


def table_html(table: Table) -> str:
    """Return a table with its title and notes; long ones are cut."""
    heads = [
        f"{c.label or c.name}{f', {c.unit}' if c.unit not in ('', '-') and c.label else ''}"
        for c in table.columns
    ]
    rows = [
        [render_cell(row.get(c.name), c.digits) for c in table.columns]
        for row in table.rows[:_MOST_ROWS]
    ]
    notes = list(table.notes)
    if len(table.rows) > _MOST_ROWS:
        notes.append(f"The first {_MOST_ROWS} of {len(table.rows)} rows.")
    told = "".join(f"<p>{escape(note)}</p>" for note in notes)
    return f"<p><b>{escape(table.title)}</b></p>{grid_html(heads, rows)}{told}"


def grid_html(heads: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table of cells that are HTML already; the headings are text."""
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
