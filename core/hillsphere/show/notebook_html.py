"""Results as HTML for notebooks; what a notebook shows needs neither script nor style sheet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from hillsphere.show.html_tables import render_cell
from hillsphere.show.presentation import Metric, Table

if TYPE_CHECKING:
    from hillsphere.runs.run_result import RunResult

__all__ = ["metrics_html", "result_html", "table_html"]

_MOST_ROWS = 60
"""Rows of a table in a notebook, as many as pandas shows."""


def result_html(result: RunResult) -> str:
    """Return verdict, requirements, claims and metrics of a run."""
    parts = [f"<p><b>{escape(result.summary['verdict']['text'])}</b></p>"]
    for what, group in (
        ("requirement", result.judgements.requirements), ("claim", result.judgements.claims),
    ):  # fmt: skip
        if group:
            heads = (what, "published" if what == "claim" else "asked", "got", "outcome")
            rows = [(one.text, one.asked, one.got, one.state) for one in group.values()]
            parts.append(_grid(heads, [map(escape, row) for row in rows]))
    names = ", ".join(map(escape, result.tables))
    parts += [metrics_html(result.metrics), f"<p>tables: {names or '–'}</p>"]
    parts.append(f"<p>figures: {', '.join(map(escape, result.figures)) or '–'}</p>")
    return "".join(parts)


def metrics_html(metrics: Mapping[str, Metric]) -> str:
    """Return metrics as a table."""
    rows = [
        (escape(name), render_cell(one.value, 8), "" if one.unit == "-" else escape(one.unit))
        for name, one in metrics.items()
    ]
    return _grid(("metric", "value", "unit"), rows) if rows else ""


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
    return f"<p><b>{escape(table.title)}</b></p>{_grid(heads, rows)}{told}"


def _grid(heads: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    head = "".join(f"<th>{escape(text)}</th>" for text in heads)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
