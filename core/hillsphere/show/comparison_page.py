"""The comparison of two runs as an HTML page without scripts."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from typing import Any

__all__ = ["render_comparison"]

_DIGITS = 10
"""Significant digits of differing values: enough to see where they differ."""


def render_comparison(first: Any, second: Any, comparison: Any) -> str:
    """Return the page.

    Parameters
    ----------
    first, second : RunSummary
        The runs.
    comparison : RunComparison
        Their differences.

    Returns
    -------
    str
        A complete HTML document; it loads nothing.
    """
    names = [escape(run.path.name or str(run.path)) for run in (first, second)]
    verdicts = _table(
        ("run", "mission", "profile", "started", "verdict"),
        (
            (str(run.path), run.mission, run.manifest.get("profile") or "",
             run.manifest.get("started_utc", ""), run.summary["verdict"].get("text", ""))
            for run in (first, second)
        ),
    )  # fmt: skip
    results = _table(
        ("where", "what", *names),
        ((d.where, d.name, _text(d.first), _text(d.second))
         for d in comparison.results),
    )  # fmt: skip
    count = len(comparison.results)
    lead = f"{count} of {comparison.compared} results differ" if count else (
        f"All {comparison.compared} results are equal"
    )  # fmt: skip
    changes = "".join(f"<li><code>{escape(line)}</code></li>" for line in comparison.configuration)
    style = files("hillsphere.show").joinpath("report.css").read_text(encoding="utf-8")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; '
        "style-src 'unsafe-inline'\">\n"
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{names[0]} and {names[1]}</title>\n<style>\n{style}\nbody {{ display: block; }}\n"
        f"</style>\n</head>\n<body><main>\n<h1>{names[0]} and {names[1]}</h1>"
        f"<p class=lead>{lead}.</p>{verdicts}<h2>Configuration</h2>"
        + (f"<ul>{changes}</ul>" if changes else "<p>No difference.</p>")
        + "<h2>Results</h2>"
        + (results if count else "<p>No difference.</p>")
        + "</main></body>\n</html>\n"
    )


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.{_DIGITS}g}"
    return "–" if value is None else str(value)


def _escape(cell: Any) -> str:
    return escape(str(cell))


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    heads = "".join(f"<th scope=col class=text>{name}</th>" for name in head)
    body = "".join(
        "<tr>" + "".join(f"<td class=text>{cell}</td>" for cell in map(_escape, row)) + "</tr>"
        for row in rows
    )
    return (
        '<div class=wide tabindex=0 role=region aria-label="Table"><table><thead><tr>'
        f"{heads}</tr></thead><tbody>{body}</tbody></table></div>"
    )
