"""The report of a run: one self-contained HTML page.

It has no scripts and loads nothing from the network or from other files: figures are embedded as
data, the style is inline, and a content security policy forbids everything else. All text is
escaped.
"""

from __future__ import annotations

import math
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any

from hillsphere.show.charts import Chart
from hillsphere.show.drawing import Drawing
from hillsphere.show.presentation import AnyFigure, Column, Metric, Printed, Table
from hillsphere.show.reference import computed_columns, without_unit

__all__ = ["Report", "Section", "render"]

MAX_ROWS = 200
"""Most rows of a table in the report, so that the page stays readable; the CSV file has all."""
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
_HEADLINES = {
    "success": "Success",
    "failed": "A stage failed",
    "interrupted": "Interrupted",
}


@dataclass(frozen=True)
class Section:
    """Section of the report about one stage.

    Parameters
    ----------
    stage, type : str
        Name and type of the stage.
    state : str
        ``"done"``, ``"failed"``, ``"interrupted"`` or ``"not run"``.
    seconds : float
        Time it took.
    cached : bool
        Whether its product was taken from the cache.
    message : str
        Error message of a stage that failed.
    metrics, tables, figures : mapping
        Its presentation, by identifier; a figure with its drawing.
    files : tuple of str
        Further files, relative to the page.
    """

    stage: str
    type: str
    state: str = "done"
    seconds: float = 0.0
    cached: bool = False
    message: str = ""
    metrics: Mapping[str, Metric] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    figures: Mapping[str, tuple[AnyFigure, Drawing]] = field(default_factory=dict)
    files: tuple[str, ...] = ()


@dataclass(frozen=True)
class Report:
    """Content of the report.

    Parameters
    ----------
    mission, title, description : str
        Name, title and description of the mission.
    state : str
        ``"success"``, ``"failed"`` or ``"interrupted"``.
    notes : sequence of str
        Sentences of the verdict.
    sections : sequence of Section
        One per stage, in order.
    started : str
        Time of the start, UTC.
    seconds : float
        Duration of the whole run.
    command : str
        Command line that reproduces the results.
    mission_text : str
        The mission file; ``""`` if the mission was made in Python.
    versions : mapping
        Name to version.
    """

    mission: str
    title: str
    description: str
    state: str
    notes: Sequence[str]
    sections: Sequence[Section]
    started: str
    seconds: float
    command: str
    mission_text: str
    versions: Mapping[str, str]


def render(report: Report) -> str:
    """Return the report as an HTML page.

    Parameters
    ----------
    report : Report
        Content of the page.

    Returns
    -------
    str
        A complete HTML document.
    """
    body = [
        f"<header><h1>{escape(report.title or report.mission)}</h1>"
        f"<p class=subtitle>Mission <code>{escape(report.mission)}</code>, run "
        f"{escape(report.started)}, {_duration(report.seconds)}</p>",
        f"<p>{escape(report.description)}</p>" if report.description else "",
        _verdict(report),
        "</header>",
        _contents(report.sections),
        *(_section(section) for section in report.sections),
        _appendix(report),
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(report.title or report.mission)}</title>\n"
        f"<style>\n{_style()}</style>\n</head>\n<body>\n"
        + "\n".join(part for part in body if part)
        + "\n</body>\n</html>\n"
    )


@cache
def _style() -> str:
    return files("hillsphere.show").joinpath("report.css").read_text(encoding="utf-8")


def _verdict(report: Report) -> str:
    faults = [
        f"Stage {s.stage} {_STATES[s.state]}" + (f": {s.message}" if s.message else ".")
        for s in report.sections
        if s.state != "done"
    ]
    items = "".join(f"<li>{escape(note)}</li>" for note in [*faults, *report.notes])
    return (
        f'<section class="verdict {escape(report.state)}" aria-label="Verdict">'
        f"<strong>{escape(_HEADLINES.get(report.state, report.state))}</strong>"
        f"{f'<ul>{items}</ul>' if items else ''}</section>"
    )


_STATES = {"failed": "failed", "interrupted": "was interrupted", "not run": "was not run"}


def _contents(sections: Sequence[Section]) -> str:
    links = "".join(
        f'<li><a href="#stage-{escape(s.stage)}">{escape(s.stage)}</a></li>' for s in sections
    )
    return f'<nav aria-label="Contents"><ul>{links}<li><a href="#run">the run</a></li></ul></nav>'


def _section(section: Section) -> str:
    how = "taken from the cache" if section.cached else _duration(section.seconds)
    parts = [
        f'<section id="stage-{escape(section.stage)}"><h2>{escape(section.stage)}</h2>',
        f"<p class=soft>Stage of type <code>{escape(section.type)}</code>, "
        f"{escape(how if section.state == 'done' else section.state)}</p>",
        f'<p class="differs">{escape(section.message)}</p>' if section.message else "",
        _metrics(section.metrics) if section.metrics else "",
        *(_table(name, table) for name, table in section.tables.items()),
        *(_figure(figure, drawing) for figure, drawing in section.figures.values()),
        _files(section.files) if section.files else "",
        "</section>",
    ]
    return "\n".join(part for part in parts if part)


def _files(files: Sequence[str]) -> str:
    links = ", ".join(f'<a href="{escape(name)}">{escape(name)}</a>' for name in files)
    return f"<p class=soft>Further files: {links}</p>"


def _metrics(metrics: Mapping[str, Metric]) -> str:
    rows = "".join(
        f"<tr><td class=text>{escape(name.replace('_', ' '))}</td>"
        f"<td>{_cell(metric.value, 8)}</td><td class=text>{_unit(metric.unit)}</td></tr>"
        for name, metric in metrics.items()
    )
    return (
        "<div class=wide><table><thead><tr><th class=text>Metric</th><th>Value</th>"
        f"<th class=text>Unit</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _table(name: str, table: Table) -> str:
    twins = computed_columns(table.columns)
    head = "".join(_heading(column, column.name in twins) for column in table.columns)
    rows = "".join(_row(table.columns, twins, row) for row in table.rows[:MAX_ROWS])
    notes = list(table.notes)
    if any(isinstance(row.get(twin), Printed) for row in table.rows for twin in twins):
        notes.append(
            "✓ agrees with the paper to its printed digit; Δ difference (computed − paper) in "
            "units of the paper's last digit."
        )
    more = f", of which the first {MAX_ROWS} are shown" if len(table.rows) > MAX_ROWS else ""
    notes.append(f"All digits: tables/{name}.csv ({len(table.rows)} rows{more}).")
    return (
        f"<h3>{escape(table.title)}</h3><div class=wide><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{rows}</tbody></table></div>"
        + "".join(f"<p class=notes>{escape(note)}</p>" for note in notes)
    )


def _heading(column: Column, twin: bool) -> str:
    label = column.label or ("paper" if twin else _stem(column))
    unit = "" if twin else column.unit  # the same as its left neighbour's
    classes = ("twin" if twin else "") + (" text" if not column.unit else "")
    return f'<th class="{classes.strip()}">{escape(label)}{_unit(unit, "unit")}</th>'


def _stem(column: Column) -> str:
    """Return the heading of a column without its unit, which is shown below: x0 for ``x0_km``."""
    return without_unit(column).replace("_", " ")


def _unit(unit: str, css: str = "") -> str:
    shown = escape(unit) if unit not in ("", "-") else ""
    return f'<span class="{css}">{shown}</span>' if css else shown


def _row(columns: Iterable[Column], twins: Mapping[str, str], row: Mapping[str, Any]) -> str:
    cells = []
    for column in columns:
        value = row.get(column.name)
        if column.name in twins:
            ours = row.get(twins[column.name])
            cells.append(f"<td class=twin>{_cell(value, column.digits)}{_mark(ours, value)}</td>")
        else:
            kind = " class=text" if not column.unit or isinstance(value, str) else ""
            cells.append(f"<td{kind}>{_cell(value, column.digits)}</td>")
    return f"<tr>{''.join(cells)}</tr>"


def _mark(ours: Any, printed: Any) -> str:
    if not isinstance(printed, Printed) or isinstance(ours, str) or ours is None:
        return ""
    value = float(ours)
    if printed.agrees(value):
        return ' <span class=agrees title="agrees to the printed digit">✓</span>'
    if not math.isfinite(value):
        return " <span class=differs>Δ</span>"
    title = "difference in units of the last printed digit"
    return f' <span class=differs title="{title}">Δ {printed.difference(value):+.2f}</span>'


def _cell(value: Any, digits: int) -> str:
    if hasattr(value, "dtype"):
        value = value.item()
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Printed):
        return escape(value.text)
    if isinstance(value, float):
        return "–" if math.isnan(value) else f"{value:.{digits}g}"
    return escape(str(value))


def _figure(figure: AnyFigure, drawing: Drawing) -> str:
    # As an image, not inline: identifiers in one figure cannot then meet those of another.
    kind, data, width = "svg+xml", drawing.svg, ""  # an SVG knows its own size
    if drawing.is_large and drawing.png is not None:
        kind, data = "png", drawing.png
        # It has more pixels than it should take on the page.
        size = figure.size if isinstance(figure, Chart) else figure.size_in
        width = f' width="{round(96 * size[0])}"'
    caption = f" {escape(figure.caption)}" if figure.caption else ""
    return (
        f'<figure><img alt="{escape(figure.title)}"{width} '
        f'src="data:image/{kind};base64,{b64encode(data).decode()}">'
        f"<figcaption><b>{escape(figure.title)}.</b>{caption}</figcaption></figure>"
    )


def _appendix(report: Report) -> str:
    timings = "".join(
        f"<tr><td class=text>{escape(s.stage)}</td><td class=text>{escape(s.type)}</td>"
        f"<td class=text>{escape('from the cache' if s.cached else s.state)}</td>"
        f"<td>{s.seconds:.2f}</td></tr>"
        for s in report.sections
    )
    versions = "".join(
        f"<tr><td class=text>{escape(name)}</td><td class=text>{escape(version)}</td></tr>"
        for name, version in report.versions.items()
    )
    mission = (
        f"<h3>Mission file</h3><pre>{escape(report.mission_text)}</pre>"
        if report.mission_text
        else ""
    )
    return (
        '<section id="run"><h2>The run</h2><h3>To get these results again</h3>'
        f"<pre>{escape(report.command)}</pre>{mission}"
        "<h3>Time</h3><div class=wide><table><thead><tr><th class=text>Stage</th>"
        "<th class=text>Type</th><th class=text>State</th><th>Time<span class=unit>s</span></th>"
        f"</tr></thead><tbody>{timings}</tbody></table></div>"
        "<h3>Versions</h3><div class=wide><table><thead><tr><th class=text>Name</th>"
        f"<th class=text>Version</th></tr></thead><tbody>{versions}</tbody></table></div>"
        "<p class=notes>The resolved mission, seeds and hashes of all inputs stand in "
        "manifest.json, all numbers in summary.json.</p></section>"
    )


def _duration(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
