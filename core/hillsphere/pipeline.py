"""Running a mission: its stages in order, their products from one to the next, all on disk.

Everything that can be wrong with the mission is found before the first stage runs: the output
directory, the types that stages pass on, the components and their data. After that a stage that
fails takes with it only the stages that need its product.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import Any

from hillsphere.assembly import Assembly
from hillsphere.drawing import Drawing, draw
from hillsphere.errors import (
    HillsphereError,
    InputError,
    Interrupted,
    PluginError,
    StageError,
)
from hillsphere.mission import Mission
from hillsphere.plugins import Registry, load_object
from hillsphere.presentation import Figure, Metric, Presentation, Table, presentation_faults
from hillsphere.problems import with_article
from hillsphere.progress import Progress
from hillsphere.run_record import Failure, RunRecord, StageRecord
from hillsphere.spec import Ref, Spec
from hillsphere.stage_cache import StageCache, StageKeys
from hillsphere.stage_context import StageContext, stop_signals
from hillsphere.store import RunDirectory, plain_json

__all__ = ["RunResult", "run_mission"]


@dataclass(frozen=True)
class RunResult:
    """What a run left behind.

    Parameters
    ----------
    directory : Path
        The run directory.
    state : str
        ``"success"`` or ``"failed"``.
    notes : tuple of str
        Sentences of the verdict.
    metrics, tables : mapping
        What the stages show, by identifier.
    products : mapping
        Stage name to product, of the stages that finished.
    failures : tuple of Failure
        One per stage that failed or could not run.
    summary : mapping
        The content of ``summary.json``.
    """

    directory: Path
    state: str
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
    def report(self) -> Path:
        """The report."""
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


def run_mission(
    mission: Mission,
    *,
    out: str | Path | None = None,
    use_cache: bool = True,
    progress: Progress | None = None,
    registry: Registry | None = None,
) -> RunResult:
    """Run the stages of a mission and write its run directory.

    Parameters
    ----------
    mission : Mission
        From `hillsphere.load_mission`.
    out : str or Path, optional
        Run directory, empty or absent; by default ``runs/<mission>-<UTC>-<8 hex>`` in the working
        directory.
    use_cache : bool
        Take unchanged results of stages from the cache, and put new ones there.
    progress : Progress, optional
        Where progress is shown; by default nowhere.
    registry : Registry, optional
        Where broken plugins are listed from, for the log; the mission already holds its
        components.

    Returns
    -------
    RunResult
        Also if stages failed: see its `state` and `failures`.

    Raises
    ------
    InputError
        Before anything runs: the output directory cannot be used, a component refuses its
        parameters, a data file cannot be read, or a stage needs a product of another type.
    PluginError
        Before anything runs: a class cannot be imported.
    StageError
        If the run directory cannot be written to.
    Interrupted
        If the run was stopped by SIGINT or SIGTERM; what was finished is in the run directory, and
        its manifest says ``"interrupted"``.
    """
    RunDirectory.check(out)
    stopped = threading.Event()
    with stop_signals(stopped), progress or Progress(quiet=True) as bars:
        try:
            run = _Run(mission, bars, stopped, use_cache)
            run.start(out, registry)
        except KeyboardInterrupt:
            raise Interrupted("interrupted before any stage ran") from None
        return run.run()


class _Run:
    """One run: what is fixed before it starts, and the records that grow while it lasts."""

    def __init__(
        self, mission: Mission, progress: Progress, stopped: threading.Event, use_cache: bool
    ) -> None:
        self.mission = mission
        self.progress = progress
        self.stopped = stopped
        self.order = mission.order()
        self.products: dict[str, Any] = {}
        self.specs: Mapping[str, Spec] = mission.specs["stage"]
        self.classes = {name: self._class_of(name) for name in self.order}
        self._check_needs()
        assembly = Assembly(mission)
        self.stages = {name: assembly.get("stage", name) for name in self.order}
        self.cache = StageCache() if use_cache else None
        keys = StageKeys(mission)
        self.keys = {name: keys.of(name) if use_cache else None for name in self.order}

    def _class_of(self, stage: str) -> type:
        path = getattr(self.specs[stage], "produces", "")
        what = f"stage {stage!r} ({self._type(stage)})"
        if not path:
            raise PluginError(f"{what}: its Spec does not say what it produces")
        return _product_class(path, what)

    def _type(self, stage: str) -> str:
        return self.mission.components["stage"][stage].component.type

    def _check_needs(self) -> None:
        """Every need must be met by a stage whose product is of the class that is needed."""
        for name in self.order:
            for where, path, ref in self.specs[name].needs_of():
                wanted = _product_class(path, f"stage {name!r} ({self._type(name)})")
                given = self.classes[ref.name]
                if not issubclass(given, wanted):
                    raise InputError(
                        f"{self.mission.places['stage', name]}: stage.{name}."
                        f"{'.'.join(map(str, where))}: needs {with_article(wanted.__name__)}, but "
                        f"stage {ref.name!r} yields {with_article(given.__name__)}"
                    )

    def start(self, out: str | Path | None, registry: Registry | None) -> None:
        started = datetime.now(UTC)
        self.directory = RunDirectory.create(out, self.mission.name, started)
        self.record = RunRecord(self.mission, started)
        for plugin, reason in (registry.broken if registry else {}).items():
            self.directory.log(f"plugin {plugin} was set aside as broken: {reason}")
        self.directory.put_json("manifest.json", self.record.manifest("running"))

    def run(self) -> RunResult:
        try:
            for number, name in enumerate(self.order, 1):
                with self.progress.stage(name, number, len(self.order)):
                    self._stage(name)
                self.directory.put_json("manifest.json", self.record.manifest("running"))
        except (KeyboardInterrupt, Interrupted):
            self.stopped.set()
            self._stopped()
            done = [s.name for s in self.record.stages.values() if s.state == "done"]
            raise Interrupted(
                f"interrupted; finished stages: {', '.join(done) or 'none'}; results so far are in "
                f"{self.directory.path}"
            ) from None
        state = "failed" if self.record.failures() else "success"
        summary = self._finish(state)
        return RunResult(
            directory=self.directory.path,
            state=state,
            notes=tuple(self.record.notes()),
            metrics=self.record.metrics(),
            tables=self.record.tables(),
            products=self.products,
            failures=tuple(self.record.failures()),
            summary=summary,
        )

    def _stopped(self) -> None:
        for name in self.order:
            stage = self.record.stages.setdefault(name, StageRecord(name, self._type(name)))
            if stage.state == "running":
                # Its product is stored as soon as it is there; presenting it may come too late.
                stage.state = "done" if name in self.products else "interrupted"
        self._finish("interrupted")

    def _finish(self, state: str) -> Mapping[str, Any]:
        self.record.finished = datetime.now(UTC)
        # The manifest first: should a second signal end this, it already says how the run ended.
        self.directory.put_json("manifest.json", self.record.manifest(state))
        summary: Mapping[str, Any] = plain_json(self.record.summary(state))
        self.directory.put_json("summary.json", summary)
        self.directory.put_text("report.html", self.record.report(state))
        return summary

    def _stage(self, name: str) -> None:
        """Run one stage, or say why not; only an interruption leaves this method."""
        record = StageRecord(name, self._type(name), key=self.keys[name])
        self.record.stages[name] = record
        missing = sorted(
            {ref.name for _, _, ref in self.specs[name].needs_of() if ref.name not in self.products}
        )
        if missing:
            record.message = f"it needs {', '.join(missing)}"
            return
        record.state = "running"
        context = StageContext(name, self.mission.seed, self.directory, self.progress, self.stopped)
        context.info(f"started ({record.type})")
        begun = perf_counter()
        try:
            inputs = self._inputs(name)
            product = self._product(name, record, inputs, context)
            self.directory.put_product(name, product)
            self.products[name] = product
            self._present(name, record, inputs)
            record.state = "done"
        except Interrupted:
            raise
        # The border between the framework and a stage: whatever a plugin raises (SystemExit too)
        # fails its stage, is told in one sentence, and leaves its traceback in the log.
        except (Exception, SystemExit) as error:
            record.state = "failed"
            record.error = type(error).__name__
            record.message = _sentence(error)
            context.info("failed\n" + "".join(traceback.format_exception(error)))
        finally:
            record.seconds = perf_counter() - begun
        context.info(f"{record.state} after {record.seconds:.2f} s")

    def _inputs(self, name: str) -> dict[str, Any]:
        needs = getattr(self.specs[name], "needs", None)
        if not isinstance(needs, Spec):
            return {}
        return {field: self._given(getattr(needs, field)) for field in type(needs).model_fields}

    def _given(self, value: Any) -> Any:
        if isinstance(value, Ref):
            return self.products[value.name]
        if isinstance(value, tuple):
            return tuple(self._given(item) for item in value)
        if isinstance(value, dict):
            return {key: self._given(item) for key, item in value.items()}
        return value

    def _product(
        self, name: str, record: StageRecord, inputs: dict[str, Any], context: StageContext
    ) -> Any:
        expected = self.classes[name]
        if self.cache is not None and record.key is not None:
            try:
                product = self.cache.load(record.key, expected)
            except (InputError, OSError) as error:
                context.info(f"its cache entry is damaged and computed again: {error}")
            else:
                if product is not None:
                    context.info(f"taken from the cache ({record.key[:16]})")
                    record.cached = True
                    return product
        product = self.stages[name].run(context, **inputs)
        if not isinstance(product, expected):
            raise StageError(
                f"it must yield a {expected.__name__}, but yielded a {type(product).__name__}"
            )
        if self.cache is not None and record.key is not None:
            try:
                self.cache.save(record.key, product)
            except OSError as error:
                context.info(f"its result could not be kept in the cache: {error}")
        return product

    def _present(self, name: str, record: StageRecord, inputs: dict[str, Any]) -> None:
        shown = self.stages[name].present(self.products[name], **inputs)
        if not isinstance(shown, Presentation):
            raise StageError(f"present must return a Presentation, got a {type(shown).__name__}")
        if faults := presentation_faults(shown):
            raise StageError("its presentation is not sound: " + "; ".join(faults))
        record.notes = tuple(shown.verdict)
        for key, metric in shown.metrics.items():
            record.metrics[self.record.free_name("metrics", key, name)] = metric
        for key, table in shown.tables.items():
            free = self.record.free_name("tables", key, name)
            self.directory.put_table(free, table)
            record.tables[free] = table
        for key, figure in shown.figures.items():
            drawing = _drawn(key, figure)
            free = self.record.free_name("figures", key, name)
            self.directory.put_drawing(free, drawing)
            record.figures[free] = (figure, drawing)
        for key, text in shown.files.items():
            self.directory.put_text(f"files/{name}/{key}", text)
            record.files = (*record.files, f"files/{name}/{key}")


def _product_class(path: str, what: str) -> type:
    try:
        found = load_object(path)
    except (ImportError, AttributeError, ValueError) as error:
        raise PluginError(f"{what}: product class {path!r} cannot be imported: {error}") from error
    if not isinstance(found, type):
        raise PluginError(f"{what}: {path!r} is not a class")
    return found


def _drawn(key: str, figure: Figure) -> Drawing:
    try:
        return draw(figure)
    # What a figure's own code raises, told with the figure's name.
    except Exception as error:
        raise StageError(f"figure {key!r} cannot be drawn: {_sentence(error)}") from error


def _sentence(error: BaseException) -> str:
    """Return the message of an error; its class too where the framework did not raise it."""
    text = " ".join(str(error).split())
    if isinstance(error, HillsphereError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
