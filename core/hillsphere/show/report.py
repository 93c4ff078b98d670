"""The report of a run: one self-contained HTML page.

It loads nothing from the network or from other files: plotly.js, the page's own script, the style
and all figures are embedded, and a content security policy allows these two scripts by their hash
and nothing else. All text is escaped. Without scripts the page shows the static pictures.
"""

from __future__ import annotations

import json
import zlib
from base64 import b64encode
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from hashlib import sha256
from html import escape
from importlib.resources import files
from typing import Any

from hillsphere.mission.report_spec import PLACEHOLDER, SectionSpec
from hillsphere.show.charts import Chart
from hillsphere.show.drawing import Drawing
from hillsphere.show.html_tables import render_table
from hillsphere.show.outcomes import format_value
from hillsphere.show.presentation import AnyFigure
from hillsphere.show.report_content import Report, StageResult
from hillsphere.show.report_outcomes import (
    metric_card,
    metric_table,
    outcome_card,
    outcome_table,
    plain_value,
)

__all__ = ["content_policy", "render"]

_STATES = {"failed": "failed", "interrupted": "was interrupted", "not run": "was not run"}
_WITHOUT_SCRIPTS = ".plot { display: none; } .plot ~ .picture, .hint { display: block; }"
"""Style that shows the pictures where no script draws the plots."""
_NOT_EVALUATED = "not evaluated"
"""What stands in a sentence for a value that the run does not have."""
_DEFAULT_NUMBERS = 4
"""Large numbers on the first screen: one row at 1280 pixels."""
_COMPRESSION = 4
"""Level of zlib for plotly.js: 0.07 s of CPU; the highest needs 0.18 s for 4 % less."""
_LONGEST_LEAD = 110
"""Longest sentence, in characters, beside the title of a folded section."""


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
    page = _Page(report)
    main = [page.head(), page.cards(), page.overview(), *page.sections(), *page.results()]
    main.append(_appendix(report))
    plots = page.plots()
    title = escape(report.spec.question or report.title or report.mission)
    policy = content_policy(bool(plots))
    scripts = f"{plots}<script>{_own_script()}</script>"
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>\n{_asset('report.css')}</style>\n"
        f"<noscript><style>{_WITHOUT_SCRIPTS}</style></noscript>\n</head>\n<body>\n"
        f"{page.contents()}\n<main>\n"
        + "\n".join(part for part in main if part)
        + f"\n</main>\n{scripts}\n</body>\n</html>\n"
    )


def content_policy(has_plots: bool) -> str:
    """Return the content security policy of a report: of scripts only those of this version run.

    Parameters
    ----------
    has_plots : bool
        Whether the report brings plotly.js.
    """
    scripts = [_own_script(), *([_plotly()] if has_plots else [])]
    hashes = " ".join(
        f"'sha256-{b64encode(sha256(text.encode()).digest()).decode()}'" for text in scripts
    )
    return (
        "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; "
        f"script-src {hashes}; base-uri 'none'; form-action 'none'"
    )


@cache
def _asset(name: str) -> str:
    return files("hillsphere.show").joinpath(name).read_text(encoding="utf-8")


@cache
def _own_script() -> str:
    return _asset("report.js")


@cache
def _plotly() -> str:
    """Return plotly.js, which the package plotly brings."""
    return files("plotly").joinpath("package_data/plotly.min.js").read_text(encoding="utf-8")


class _Page:
    """The parts of the page; each figure and table is shown once, where a reader meets it first."""

    def __init__(self, report: Report) -> None:
        self.report = report
        self.by_stage = {stage.stage: stage for stage in report.stages}
        self.shown: set[str] = set()
        self.embedded: dict[str, Mapping[str, Any]] = {}
        self.values = dict(_values(report))

    def head(self) -> str:
        report, spec = self.report, self.report.spec
        profile = f" with its profile {escape(report.profile)}, not whole" if report.profile else ""
        faults = "".join(
            f"<p class=differs>Stage {escape(s.stage)} {_STATES[s.state]}"
            f"{': ' + escape(s.message) if s.message else '.'}</p>"
            for s in report.stages
            if s.state != "done"
        )
        answer = self.fill(spec.answer) if spec.answer else escape(_sentence(report.verdict))
        description = f"<p>{escape(report.description)}</p>" if report.description else ""
        return (
            f'<header id="answer"><p class=soft>Mission {escape(report.mission)}{profile} · '
            f"{escape(report.started[:10])} · computed in {_duration(report.seconds)}</p>"
            f"<h1>{escape(spec.question or report.title or report.mission)}</h1>"
            f"<p class=lead>{answer}</p>{faults}{description}</header>"
        )

    def fill(self, text: str) -> str:
        """Return escaped text with the values of its placeholders."""
        # What a profile drops has no value; a dash in a sentence would look like a fault.
        return PLACEHOLDER.sub(
            lambda match: f"<b>{escape(self.values.get(match[1], _NOT_EVALUATED))}</b>",
            escape(text, quote=False),
        )

    def cards(self) -> str:
        names = self.report.spec.numbers or list(self.report.requirements)[:_DEFAULT_NUMBERS]
        cards = "".join(filter(None, map(self._card, names)))
        return f"<ul class=cards>{cards}</ul>" if cards else ""

    def _card(self, name: str) -> str:
        for what, group in (("requirement", self.report.requirements),
                            ("claim", self.report.claims)):  # fmt: skip
            if name in group:
                return outcome_card(what, group[name])
        stage, _, own = name.partition(".")
        result = self.by_stage.get(stage)
        metric = result and result.own_metrics.get(own)
        return metric_card(own, metric) if metric else ""

    def overview(self) -> str:
        """Return the figure that carries the answer, beside requirements and claims."""
        figures = [(stage, name) for stage in self.report.stages for name in stage.figures]
        wanted, _, own = self.report.spec.figure.partition(".")
        # The first of the run if that of the mission, or its stage, is no part of it.
        lead = next(
            (
                (s, name)
                for s, name in figures
                if (s.stage, name) == (wanted, s.own_figures.get(own))
            ),
            figures[0] if figures else None,
        )
        figure = self._show_figure(*lead, is_open=True) if lead else ""
        tables = outcome_table("requirement", self.report.requirements)
        tables += outcome_table("claim", self.report.claims)
        if not (figure or tables):
            return ""
        side = f"<div class=panel>{tables}</div>" if tables else ""
        return f"<div class=overview>{figure}{side}</div>"

    def sections(self) -> Iterator[str]:
        for number, section in enumerate(self.report.spec.section, 1):
            text = self.fill(section.text)
            body = "".join(map(self._item, section.show))
            yield _fold(f"section-{number}", f"{number} {escape(section.title)}",
                        _lead(section), f"<p>{text}</p>{body}" if text else body)  # fmt: skip

    def results(self) -> Iterator[str]:
        """Return one folded section per stage with all that was not shown before."""
        yield '<h2 id="results">All results</h2>'
        for stage in self.report.stages:
            key = f"stage-{stage.stage}"
            parts = [f"<p class=differs>{escape(stage.message)}</p>" if stage.message else ""]
            if stage.notes:
                parts.append(
                    f"<ul>{''.join(f'<li>{escape(note)}</li>' for note in stage.notes)}</ul>"
                )
            parts.append(metric_table(stage.metrics))
            parts.append(self._show_all(stage))
            if stage.files:
                links = ", ".join(f'<a href="{escape(n)}">{escape(n)}</a>' for n in stage.files)
                parts.append(f"<p class=soft>Further files: {links}</p>")
            how = "from the cache" if stage.cached else _duration(stage.seconds)
            state = how if stage.state == "done" else stage.state
            title = escape(_sentence(stage.title or stage.type).rstrip("."))
            name = escape(stage.stage.replace("_", " "))
            yield _fold(key, title, f"{name}, {escape(state)}", "".join(parts))

    def _item(self, item: str) -> str:
        """Return the table and the figure ``STAGE.NAME``, or all of a stage; empty for none."""
        name, _, own = item.partition(".")
        stage = self.by_stage.get(name)
        if stage is None or stage.state != "done":
            return ""
        if not own:
            return self._show_all(stage)
        table, figure = stage.own_tables.get(own), stage.own_figures.get(own)
        parts = [self._show_table(stage, table) if table else ""]
        parts.append(self._show_figure(stage, figure) if figure else "")
        return "".join(parts)

    def _show_all(self, stage: StageResult) -> str:
        return "".join(
            [self._show_table(stage, name) for name in stage.tables]
            + [self._show_figure(stage, name) for name in stage.figures]
        )

    def _show_table(self, stage: StageResult, name: str) -> str:
        table = stage.tables[name]
        return self._once(f"table-{name}", table.title) or render_table(
            name, table, f"tables/{name}.csv"
        )

    def _show_figure(self, stage: StageResult, name: str, *, is_open: bool = False) -> str:
        title = stage.figures[name].figure.title
        return self._once(f"figure-{name}", title) or self._figure(stage, name, is_open=is_open)

    def _once(self, key: str, title: str) -> str:
        """Return a link to what was shown before; empty at the first time."""
        if key in self.shown:
            return f'<p class=soft>{escape(title)}: <a href="#{escape(key)}">shown above</a>.</p>'
        self.shown.add(key)
        return ""

    def _figure(self, stage: StageResult, name: str, *, is_open: bool) -> str:
        shown = stage.figures[name]
        figure = shown.figure
        caption = f" {escape(figure.caption)}" if figure.caption else ""
        alt = (figure.alt if isinstance(figure, Chart) else "") or figure.caption or figure.title
        picture = _picture(figure, shown.drawing, alt) if shown.drawing else ""
        plot = ""
        if shown.plot is not None:
            self.embedded[name] = shown.plot
            height = shown.plot["height"]
            table = ""
            if isinstance(figure, Chart) and figure.table:
                table = f' data-table="table-{escape(stage.own_tables[figure.table])}"'
            plot = (
                f'<div class=plot data-plot="{escape(name)}"{table} style="height:{height}px" '
                f'role=group aria-label="{escape(alt)}"></div>'
            )
        command = (
            "" if picture else "<p class='soft hint'>Its picture: "
            f"<code>hillsphere figures RUN {escape(name)}</code></p>"
        )  # fmt: skip
        css = " class=panel" if is_open else ""
        return (
            f'<figure id="figure-{escape(name)}"{css}><figcaption><b>{escape(figure.title)}.</b>'
            f"{caption}</figcaption>{plot}{picture}{command}</figure>"
        )

    def plots(self) -> str:
        """Return the figures' data and plotly.js, both as data blocks that no browser runs."""
        if not self.embedded:
            return ""
        blocks = "".join(
            f'<script type="application/json" id="plot-{escape(name)}">{_json(plot)}</script>\n'
            for name, plot in self.embedded.items()
        )
        packed = b64encode(zlib.compress(_plotly().encode(), _COMPRESSION)).decode()
        return f'{blocks}<script type="text/plain" id="plotly">{packed}</script>\n'

    def contents(self) -> str:
        sections = "".join(
            f'<li><a href="#section-{n}">{n} {escape(section.title)}</a></li>'
            for n, section in enumerate(self.report.spec.section, 1)
        )
        return (
            '<nav aria-label="Contents"><details><summary>Contents</summary>'
            f"<p>{escape(self.report.mission)}</p><ul>"
            f'<li><a href="#answer">Answer</a></li>{sections}'
            '<li><a href="#results">All results</a></li>'
            '<li><a href="#run">How it was run</a></li></ul>'
            '<input type=search id=search placeholder="Search" aria-label="Search" hidden>'
            "</details></nav>"
        )


def _values(report: Report) -> Iterator[tuple[str, str]]:
    """Yield the placeholders of texts with their values."""
    for kind, group in (("requirement", report.requirements), ("claim", report.claims)):
        for name, one in group.items():
            yield f"{kind}.{name}", one.got or one.state
            yield f"{kind}.{name}.state", one.state
    for stage in report.stages:
        for own, metric in stage.own_metrics.items():
            unit = "" if metric.unit == "-" else metric.unit
            yield f"{stage.stage}.{own}", format_value(plain_value(metric.value), unit)


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _lead(section: SectionSpec) -> str:
    """Return the first sentence of a section, if it is short and has no placeholder."""
    first = section.text.partition(". ")[0].rstrip(".")
    return escape(first) if len(first) <= _LONGEST_LEAD and "{" not in first else ""


def _fold(key: str, title: str, lead: str, body: str) -> str:
    tail = f" <span class=soft>— {lead}</span>" if lead else ""
    return (
        f'<details id="{escape(key)}"><summary><h3>{title}</h3>{tail}</summary>\n{body}\n</details>'
    )


def _picture(figure: AnyFigure, drawing: Drawing, alt: str) -> str:
    # As an image, not inline: identifiers in one figure cannot then meet those of another.
    kind, data, width = "svg+xml", drawing.svg, ""  # an SVG knows its own size
    if drawing.is_large and drawing.png is not None:
        kind, data = "png", drawing.png
        # It has more pixels than it should take on the page.
        size = figure.size if isinstance(figure, Chart) else figure.size_in
        width = f' width="{round(96 * size[0])}"'
    return (
        f'<img class=picture alt="{escape(alt)}"{width} '
        f'src="data:image/{kind};base64,{b64encode(data).decode()}">'
    )


def _json(value: Any) -> str:
    """Return JSON that can stand in a script element."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")


def _appendix(report: Report) -> str:
    timings = _rows(
        (s.stage, s.type, "from the cache" if s.cached else s.state, f"{s.seconds:.2f}")
        for s in report.stages
    )
    mission = (
        f"<h3>Mission file</h3><pre tabindex=0>{escape(report.mission_text)}</pre>"
        if report.mission_text
        else ""
    )
    models = "".join(
        f"<li>{escape(name)}: {escape('; '.join(sentences))}</li>"
        for name, sentences in report.descriptions.items()
    )
    models = f"<h3>Shapes and gravity</h3><ul>{models}</ul>" if models else ""
    body = (
        f"{models}<h3>To get these results again</h3>"
        f"<pre tabindex=0>{escape(report.command)}</pre>{mission}"
        "<h3>Time</h3><div class=wide tabindex=0 role=region aria-label=\"Time\"><table><thead><tr>"
        "<th scope=col class=text>stage</th><th scope=col class=text>type</th>"
        "<th scope=col class=text>state</th><th scope=col>time<span class=unit>s</span></th></tr>"
        f"</thead><tbody>{timings}</tbody></table></div><h3>Versions</h3>"
        '<div class=wide tabindex=0 role=region aria-label="Versions"><table><thead><tr>'
        "<th scope=col class=text>name</th><th scope=col class=text>version</th></tr></thead>"
        f"<tbody>{_rows(report.versions.items())}</tbody></table></div>"
        "<p class=notes>The resolved mission, seeds and hashes of all inputs are in "
        "manifest.json, all numbers in summary.json.</p>"
    )  # fmt: skip
    return _fold("run", "How it was run", "command, mission file, time, versions", body)


def _rows(rows: Iterable[Sequence[str]]) -> str:
    return "".join(
        f"<tr><th scope=row class=text>{escape(first)}</th>"
        + "".join(f"<td class=text>{escape(cell)}</td>" for cell in rest)
        + "</tr>"
        for first, *rest in rows
    )


def _duration(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
