"""What the page of a run says, before it is written as HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from hillsphere.interfaces.outcomes import Judgement
from hillsphere.mission.report_spec import ReportSpec
from hillsphere.show.drawing import Drawing
from hillsphere.show.presentation import AnyFigure, Metric, Table

__all__ = ["Report", "ShownFigure", "StageResult"]


@dataclass(frozen=True)
class ShownFigure:
    """A figure of the report.

    Parameters
    ----------
    figure : Figure or Chart
        The figure.
    plot : mapping or None
        Its form for plotly.js; None for one that a stage draws itself.
    drawing : Drawing or None
        Its picture, if it was drawn.
    """

    figure: AnyFigure
    plot: Mapping[str, Any] | None = None
    drawing: Drawing | None = None


@dataclass(frozen=True)
class StageResult:
    """What the report says about one stage.

    Parameters
    ----------
    stage, type, title : str
        Name and type of the stage, and what it is in words.
    state : str
        ``"done"``, ``"failed"``, ``"interrupted"`` or ``"not run"``.
    seconds : float
        Time it took.
    cached : bool
        Whether its product was taken from the cache.
    message : str
        Error message of a stage that failed.
    notes : sequence of str
        Its sentences of the verdict.
    metrics, tables, figures : mapping
        Its presentation, by identifier in the run.
    own_tables, own_figures : mapping
        The stage's own name of a table, or of a figure → that in the run.
    own_metrics : mapping
        Its metrics by the stage's own names.
    files : tuple of str
        Further files, relative to the page.
    """

    stage: str
    type: str
    title: str = ""
    state: str = "done"
    seconds: float = 0.0
    cached: bool = False
    message: str = ""
    notes: Sequence[str] = ()
    metrics: Mapping[str, Metric] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    figures: Mapping[str, ShownFigure] = field(default_factory=dict)
    own_tables: Mapping[str, str] = field(default_factory=dict)
    own_figures: Mapping[str, str] = field(default_factory=dict)
    own_metrics: Mapping[str, Metric] = field(default_factory=dict)
    files: tuple[str, ...] = ()


@dataclass(frozen=True)
class Report:
    """Content of the report.

    Parameters
    ----------
    mission, title, description : str
        Name, title and description of the mission.
    profile : str
        Name of the profile, ``""`` for none.
    verdict : str
        Verdict in one line.
    spec : ReportSpec
        What the mission says about its report.
    requirements, claims : mapping
        Outcomes by name, in the order of the mission.
    stages : sequence of StageResult
        In order.
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
    descriptions : mapping
        Table of a shape or gravity model to sentences about it.
    """

    mission: str
    title: str
    description: str
    profile: str
    verdict: str
    spec: ReportSpec
    requirements: Mapping[str, Judgement]
    claims: Mapping[str, Judgement]
    stages: Sequence[StageResult]
    started: str
    seconds: float
    command: str
    mission_text: str
    versions: Mapping[str, str]
    descriptions: Mapping[str, Sequence[str]] = field(default_factory=dict)
