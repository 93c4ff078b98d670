"""The result of a run for its caller in Python."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hillsphere.base.errors import InputError, StageError
from hillsphere.runs.judgements import Judgements
from hillsphere.runs.run_record import Failure
from hillsphere.show.presentation import Metric, Table

__all__ = ["RunResult"]


@dataclass(frozen=True)
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
    metrics, tables : mapping
        Metrics and tables of the stages, by identifier.
    products : mapping
        Stage name → product, for the stages that finished.
    failures : tuple of Failure
        One per stage that failed or could not run.
    summary : mapping
        The content of ``summary.json``.
    """

    directory: Path
    state: str
    judgements: Judgements
    notes: tuple[str, ...]
    metrics: Mapping[str, Metric] = field(repr=False)
    tables: Mapping[str, Table] = field(repr=False)
    products: Mapping[str, Any] = field(repr=False)
    failures: tuple[Failure, ...]
    summary: Mapping[str, Any] = field(repr=False)

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
