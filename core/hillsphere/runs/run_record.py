"""The record of a run, from which manifest, summary and report are written."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from hillsphere.base.environment import environment, package_versions
from hillsphere.base.paths import missions_directory
from hillsphere.base.shell_words import shell_line
from hillsphere.mission.load import Mission
from hillsphere.plugins.plugin_files import plugin_files
from hillsphere.runs.judgements import Judgements, RunEvidence
from hillsphere.runs.run_manifest import SCHEMA
from hillsphere.runs.stage_cache import StageKeys, file_digest
from hillsphere.show.presentation import AnyFigure, Metric, Presentation, Table
from hillsphere.show.report import render
from hillsphere.show.report_content import Report, ShownFigure, StageResult

__all__ = ["Failure", "RunRecord", "StageRecord", "free_name"]

PLATFORM = ("system", "machine", "c_library", "cpu_features", "kernels")


@dataclass(frozen=True)
class Failure:
    """A stage that failed, was interrupted, or was not run because one that it needs failed.

    Parameters
    ----------
    stage : str
        Its name.
    state : str
        ``"failed"``, ``"interrupted"`` or ``"not run"``.
    error : str
        Class of the exception; ``""`` if there was none.
    message : str
        Error message with its location.
    """

    stage: str
    state: str
    error: str
    message: str

    def __str__(self) -> str:
        return f"stage {self.stage!r} {'was ' * (self.state != 'failed')}{self.state}" + (
            f": {self.message}" if self.message else ""
        )


@dataclass
class StageRecord:
    """Facts about one stage, which are completed while it runs.

    `product` is the SHA-256 of the file of its product, once that is written. `metrics`, `tables`
    and `figures` have the names of the run; `shown` has the stage's own, `own_tables` and
    `own_figures` give the names in the run.
    """

    name: str
    type: str
    state: str = "not run"
    key: str | None = None
    product: str | None = None
    cached: bool = False
    seconds: float = 0.0
    error: str = ""
    message: str = ""
    notes: tuple[str, ...] = ()
    metrics: dict[str, Metric] = field(default_factory=dict)
    tables: dict[str, Table] = field(default_factory=dict)
    figures: dict[str, ShownFigure] = field(default_factory=dict)
    own_tables: dict[str, str] = field(default_factory=dict)
    own_figures: dict[str, str] = field(default_factory=dict)
    files: tuple[str, ...] = ()
    shown: Presentation | None = None


@dataclass
class RunRecord:
    """Facts about a run; its methods return the contents of the files.

    `sources` holds the digest of the source files of every package that the results depend on,
    `resumed` the times at which the run was resumed.
    """

    mission: Mission
    started: datetime
    stages: dict[str, StageRecord] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)
    resumed: Sequence[datetime] = ()
    descriptions: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    finished: datetime | None = None
    judgements: Judgements = field(default_factory=Judgements)

    def __post_init__(self) -> None:
        # Now, not at the end: the run uses the files as they are at its start.
        self._inputs = {
            key: {"file": name, "sha256": file_digest(Path(path))}
            for key, path, name in self._data_files()
        }

    @classmethod
    def begun(cls, mission: Mission) -> RunRecord:
        """Return the record of a new run, in which no stage has run and all have keys."""
        keys = StageKeys(mission)
        stages = {
            name: StageRecord(
                name, mission.components["stage"][name].component.type, key=keys.of(name)
            )
            for name in mission.order()
        }
        return cls(mission, datetime.now(UTC), stages, keys.sources)

    def free_name(self, group: str, name: str, stage: str) -> str:
        """Return an identifier that no other stage has for a metric, table or figure."""
        used = {key for s in self.stages.values() for key in getattr(s, group)}
        return free_name(used, name, stage)

    def metrics(self) -> dict[str, Metric]:
        """Return the metrics of all stages."""
        return {key: item for s in self.stages.values() for key, item in s.metrics.items()}

    def tables(self) -> dict[str, Table]:
        """Return the tables of all stages."""
        return {key: item for s in self.stages.values() for key, item in s.tables.items()}

    def figures(self) -> dict[str, AnyFigure]:
        """Return the figures of all stages."""
        return {key: shown.figure for s in self.stages.values() for key, shown in s.figures.items()}

    def evidence(self) -> RunEvidence:
        """Return the metrics and tables of the finished stages, under the stages' own names."""
        return RunEvidence(
            {s.name: s.shown for s in self.stages.values() if s.state == "done" and s.shown}
        )

    def notes(self) -> list[str]:
        """Return the sentences of the verdict, each once."""
        return list(dict.fromkeys(note for s in self.stages.values() for note in s.notes))

    def failures(self) -> list[Failure]:
        """Return the stages that failed, were interrupted or could not run, in order."""
        return [
            Failure(s.name, s.state, s.error, s.message)
            for s in self.stages.values()
            if s.state in ("failed", "interrupted", "not run")
        ]

    def summary(self, state: str) -> dict[str, Any]:
        """Return the content of ``summary.json``."""
        return {
            "schema": SCHEMA,
            "mission": self.mission.name,
            "verdict": {
                "state": state,
                "text": self.judgements.verdict(state, len(self.failures())),
                "notes": self.notes(),
            },
            **self.judgements.to_json(),
            "metrics": {
                key: {"value": metric.value, "unit": metric.unit}
                for key, metric in self.metrics().items()
            },
            "tables": {
                key: {
                    "columns": [
                        {"name": c.name, "unit": c.unit, "label": c.label, "digits": c.digits}
                        for c in table.columns
                    ],
                    "rows": [
                        {c.name: row.get(c.name) for c in table.columns} for row in table.rows
                    ],
                }
                for key, table in self.tables().items()
            },
            "failures": [vars(failure) for failure in self.failures()],
        }

    def manifest(self, state: str) -> dict[str, Any]:
        """Return the content of ``manifest.json``; it names no user, host or absolute path."""
        return {
            "schema": SCHEMA,
            "state": "finished" if state == "success" else state,
            "started_utc": _utc(self.started),
            "resumed_utc": [_utc(moment) for moment in self.resumed],
            "finished_utc": _utc(self.finished) if self.finished else None,
            "command": self.command(),
            "seed": self.mission.seed,
            "profile": self.mission.profile,
            "sets": list(self.mission.sets),
            "mission": self._resolved(),
            "inputs": self._inputs,
            "versions": {
                "python": environment()["python"],
                "packages": package_versions(),
                "plugins": self._plugins(),
            },
            "sources": dict(self.sources),
            "platform": {key: environment()[key] for key in PLATFORM},
            "stages": {
                s.name: {
                    "type": s.type,
                    "state": s.state,
                    "cached": s.cached,
                    "seconds": round(s.seconds, 6),
                    "key": s.key,
                    "product": s.product,
                }
                for s in self.stages.values()
            },
        }

    def command(self) -> str:
        """Return the command line that reproduces the results."""
        path = self.mission.path
        packaged = path.parent.resolve() == missions_directory().resolve()
        words = ["hillsphere", "run", path.stem if packaged else path.name]
        if self.mission.profile is not None:
            words += ["--profile", self.mission.profile]
        for setting in self.mission.sets:
            words += ["--set", setting]
        for file in plugin_files():
            words += ["--plugin", file.name]
        return shell_line(words)

    def report(self, state: str) -> str:
        """Return the report, an HTML page."""
        finished = self.finished or datetime.now(UTC)
        mission, components = self.mission, self.mission.components["stage"]
        judged = self.judgements
        return render(
            Report(
                mission=mission.name,
                title=mission.title,
                description=mission.description,
                profile=mission.profile or "",
                verdict=judged.verdict(state, len(self.failures())),
                spec=mission.report,
                requirements=judged.requirements,
                claims=judged.claims,
                stages=[
                    StageResult(
                        s.name, s.type, components[s.name].component.summary, s.state, s.seconds,
                        s.cached, s.message, s.notes, s.metrics, s.tables, s.figures,
                        s.own_tables, s.own_figures, s.shown.metrics if s.shown else {}, s.files,
                    )
                    for s in self.stages.values()
                ],
                started=_utc(self.started),
                seconds=(finished - self.started).total_seconds(),
                command=self.command(),
                mission_text=mission.text,
                versions={
                    "python": environment()["python"], **package_versions(), **self._plugins()
                },
                descriptions=self.descriptions,
            )
        )  # fmt: skip

    def _plugins(self) -> dict[str, str]:
        """Return the plugins that the mission uses, with the Python packages that provide them."""
        records = [r for group in self.mission.components.values() for r in group.values()]
        return {r.plugin: r.distribution for r in sorted(records, key=lambda r: r.plugin)}

    def _data_files(self) -> Iterator[tuple[str, str, str]]:
        """Yield (key, absolute path, name to show) of every input file."""
        roots = (self.mission.directory, missions_directory().resolve())
        for kind, specs in self.mission.specs.items():
            for table, spec in specs.items():
                for where, text in spec.data_paths():
                    path = Path(text)
                    inside = [r for r in roots if path.is_relative_to(r)]
                    name = path.relative_to(inside[0]).as_posix() if inside else path.name
                    yield ".".join(map(str, (kind, table, *where))), text, name

    def _resolved(self) -> Any:
        names = {path: name for _, path, name in self._data_files()}
        return _rename(self.mission.resolved(), names)


def free_name(used: Container[str], name: str, stage: str) -> str:
    """Return an unused identifier: the name, with the stage appended if necessary."""
    free = name
    while free in used:
        free = f"{free}_{stage.replace('-', '_')}"
    return free


def _rename(value: Any, names: Mapping[str, str]) -> Any:
    if isinstance(value, str):
        return names.get(value, value)
    if isinstance(value, Mapping):
        return {key: _rename(item, names) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_rename(item, names) for item in value]
    return value


def _utc(moment: datetime) -> str:
    return moment.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
