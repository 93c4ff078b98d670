"""Requirements, claims and metrics on the page of a run: cards and tables."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

from hillsphere.interfaces.outcomes import CLAIM_STATES, REQUIREMENT_STATES, Judgement
from hillsphere.show.cells import render_cell
from hillsphere.show.html_tables import heading_text
from hillsphere.show.outcomes import format_margin, format_value
from hillsphere.show.presentation import Column, Metric

__all__ = ["metric_card", "metric_table", "outcome_card", "outcome_table", "plain_value"]

_FIRST_OUTCOMES = 6
"""Requirements, and claims, on the first screen; the others are folded."""


_UNIT = re.compile(r"(?<=\d) (?=%|(?!to\b)[^\W\d])|(?<=[≤≥<>]) ")
"""The space between a number and its unit, not that before the other end of an interval, and that
after a relation."""

_WORDS = {"requirement": "asked", "claim": "published"}
"""What the value is called with which a result is compared."""


def outcome_card(what: str, one: Judgement) -> str:
    """Return a requirement or claim as a card of the first screen."""
    big = format_value(one.value, "") if one.value is not None else (one.got or one.state)
    asked = f" {_WORDS[what]} {_unbroken(one.asked)}" if one.asked else ""
    return _card(one.text, big, one.unit, f"{_badge(one.state)}{asked}")


def metric_card(name: str, metric: Metric) -> str:
    """Return a metric as a card of the first screen."""
    label = heading_text(Column(name, metric.unit))
    return _card(label, format_value(plain_value(metric.value), ""), metric.unit)


def _card(label: str, big: str, unit: str, below: str = "") -> str:
    shown = f" <span class=unit>{escape(unit)}</span>" if unit not in ("", "-") else ""
    return (
        f"<li><span class=label>{escape(label)}</span>"
        f"<span class=big>{escape(big)}{shown}</span><span class=soft>{below}</span></li>"
    )


def outcome_table(what: str, outcomes: Mapping[str, Judgement]) -> str:
    """Return the table of requirements or claims: those that need attention first, many folded."""
    if not outcomes:
        return ""
    states = REQUIREMENT_STATES if what == "requirement" else CLAIM_STATES
    ordered = sorted(outcomes.values(), key=lambda one: states.index(one.state))
    title = {"requirement": "Requirements", "claim": "Published claims"}[what]
    head = (
        f"<thead><tr><th scope=col class=text>{what}</th>"
        f"<th scope=col class=text>{_WORDS[what]}</th>"
        "<th scope=col class=text>got</th><th scope=col>state, margin</th></tr></thead>"
    )
    table = f'<table class="outcomes {what}s">{head}<tbody>'
    first, rest = ordered[:_FIRST_OUTCOMES], ordered[_FIRST_OUTCOMES:]
    if len(rest) == 1:
        first, rest = ordered, []  # a fold would take the room of the row
    more = ""
    if rest:
        counts = Counter(one.state for one in rest)
        told = ", ".join(f"{count} {state}" for state, count in counts.items())
        more = f"<details class=more-rows><summary>{len(rest)} more: {told}</summary>"
        more += f"{table}{_outcome_rows(rest)}</tbody></table></details>"
    return f"<h2>{title}</h2>{table}{_outcome_rows(first)}</tbody></table>{more}"


def _outcome_rows(outcomes: Iterable[Judgement]) -> str:
    return "".join(
        f"<tr><th scope=row class=text>{escape(one.text)}"
        f"{f' <span class=soft>{escape(one.source)}</span>' if one.source else ''}"
        f"{f'<br><span class=soft>{escape(one.reason)}</span>' if one.reason else ''}</th>"
        f"<td class=text>{_unbroken(one.asked)}</td><td class=text>{_unbroken(one.got)}</td>"
        f"<td>{_badge(one.state)}{_room(one)}</td></tr>"
        for one in outcomes
    )


def _room(one: Judgement) -> str:
    """Return how far a value is from its limit, for a cell."""
    margin = format_margin(vars(one))
    return f"<br><span class=soft>{_unbroken(margin)}</span>" if margin else ""


def _unbroken(text: str) -> str:
    """Return a text for a cell in which no line ends between a number and its unit."""
    return escape(_UNIT.sub("\N{NO-BREAK SPACE}", text))


def _badge(state: str) -> str:
    return f'<span class="badge {escape(state.replace(" ", "-"))}">{escape(state)}</span>'


def metric_table(metrics: Mapping[str, Metric]) -> str:
    """Return the table of a stage's metrics."""
    if not metrics:
        return ""
    rows = "".join(
        f"<tr><th scope=row class=text>{escape(heading_text(Column(name, metric.unit)))}</th>"
        f"<td>{render_cell(metric.value, 6)}</td>"
        f"<td class=text>{escape(metric.unit) if metric.unit not in ('', '-') else ''}</td></tr>"
        for name, metric in metrics.items()
    )
    return (
        '<div class=wide tabindex=0 role=region aria-label="Metrics"><table><thead><tr>'
        "<th scope=col class=text>metric</th><th scope=col>value</th>"
        f"<th scope=col class=text>unit</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )


def plain_value(value: Any) -> Any:
    """Return a value as Python's own type, which has the usual texts."""
    return value.item() if hasattr(value, "dtype") else value
