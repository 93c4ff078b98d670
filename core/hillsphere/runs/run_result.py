"""The result of a run for its caller in Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from hillsphere.base.errors import InputError, StageError
from hillsphere.base.problems import did_you_mean
from hillsphere.mission.load import Mission
from hillsphere.runs.assembly import Assembly, build_of
from hillsphere.runs.judgements import Judgements
from hillsphere.runs.run_record import Failure
from hillsphere.show.cells import render_cell, render_grid
from hillsphere.show.presentation import AnyFigure, Metric, Table

if TYPE_CHECKING:
    import xarray

__all__ = ["RunResult"]


@dataclass(frozen=True, repr=False)
class RunResult:
    """The result of a run.

    Parameters
    ----------
    directory : Path
        The run directory.
    state : str
        ``"success"`` or ``"failed"``.
    judgements : Judgements
        Outcomes of the mission's requirements and claims.
    notes : tuple of str
        Sentences of the verdict.
    metrics, tables, figures : mapping
        Metrics, tables and figures of the stages, by identifier.
    products : mapping
        Stage name → product, for the stages that finished.
    failures : tuple of Failure
        One per stage that failed or could not run.
    summary : mapping
        The content of ``summary.json``.
    mission : Mission
        The mission, with the profile and the settings of the run.
    """

    directory: Path
    state: str
    judgements: Judgements
    notes: tuple[str, ...]
    metrics: Mapping[str, Metric]
    tables: Mapping[str, Table]
    figures: Mapping[str, AnyFigure]
    products: Mapping[str, Any]
    failures: tuple[Failure, ...]
    summary: Mapping[str, Any]
    mission: Mission = field(repr=False)

    @property
    def ok(self) -> bool:
        """Whether every stage finished."""
        return self.state == "success"

    @property
    def is_met(self) -> bool:
        """Whether every stage finished, and no requirement is missed or undecided."""
        return self.ok and self.judgements.are_met

    @property
    def report(self) -> Path:
        """Path of the report."""
        return self.directory / "report.html"

    def __repr__(self) -> str:
        return f"<RunResult {self.directory.name!r}: {self.summary['verdict']['text']}>"

    def _repr_html_(self) -> str:
        """Return verdict, outcomes, metrics and names of tables and figures for a notebook."""
        parts = [f"<p><b>{escape(self.summary['verdict']['text'])}</b></p>"]
        for heads, group in (
            (("requirement", "asked", "got", "outcome"), self.judgements.requirements),
            (("claim", "published", "got", "outcome"), self.judgements.claims),
        ):
            rows = [(one.text, one.asked, one.got, one.state) for one in group.values()]
            if rows:
                parts.append(render_grid(heads, [map(escape, row) for row in rows]))
        metrics = [
            (escape(name), render_cell(one.value, 8), "" if one.unit == "-" else escape(one.unit))
            for name, one in self.metrics.items()
        ]
        if metrics:
            parts.append(render_grid(("metric", "value", "unit"), metrics))
        for what, names in (("tables", self.tables), ("figures", self.figures)):
            parts.append(f"<p>{what}: {', '.join(map(escape, names)) or '–'}</p>")
        return "".join(parts)

    def plot(self, name: str, renderer: Literal["plotly", "matplotlib"] = "plotly") -> Any:
        """Return a figure as an object that a notebook shows.

        Parameters
        ----------
        name : str
            One of `figures`.
        renderer : {"plotly", "matplotlib"}
            Library of the object.

        Returns
        -------
        plotly.graph_objects.Figure or matplotlib.figure.Figure
            The drawn figure.

        Raises
        ------
        InputError
            If there is no such figure or renderer.
        """
        from hillsphere.show.plotting import plot

        if name not in self.figures:
            hint = did_you_mean(name, list(self.figures), otherwise="it has")
            raise InputError(f"this run has no figure {name!r}{hint or '; it has none'}")
        return plot(self.figures[name], renderer)

    def to_xarray(self, stage: str) -> xarray.Dataset:
        """Return the arrays of a stage's product; see `hillsphere.products.to_xarray`.

        Parameters
        ----------
        stage : str
            Its name.

        Raises
        ------
        StageError, InputError
            As `product`.
        ImportError
            If xarray is not installed; the extra ``notebook`` brings it.
        """
        from hillsphere.products.labelled_arrays import to_xarray

        return to_xarray(self.product(stage))

    def build(self, kind: str, name: str) -> Any:
        """Return a component of the run's mission, as the stages used it.

        Parameters
        ----------
        kind, name : str
            The table ``[kind.name]``: ``"plant", "hill"``. It is made at the first call.

        Returns
        -------
        object
            The component; a plant can be flown by `hillsphere.Motion`.

        Raises
        ------
        InputError
            If the mission has no such table; the message gives the nearest one.
        """
        return build_of(self._assembly, kind, name)

    @cached_property
    def _assembly(self) -> Assembly:
        return Assembly(self.mission)

    def product(self, stage: str) -> Any:
        """Return the product of a stage.

        Raises
        ------
        StageError
            If it failed or was not run; the message says why.
        InputError
            If the mission has no such stage.
        """
        if stage in self.products:
            return self.products[stage]
        for failure in self.failures:
            if failure.stage == stage:
                raise StageError(str(failure))
        raise InputError(f"no stage {stage!r} in this run; it has {', '.join(self.products)}")
