"""The pipeline: runs a mission's stages in order, passes on their products and stores them.

The mission is checked before the first stage runs: output directory, product types, components and
their data. If a stage fails later, only the stages that need its product are skipped. `resume_run`
continues a run that ended early for any reason, without computing stored products again.
"""

from __future__ import annotations

import json
import os
import secrets
import threading
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import Any

from hillsphere.base.errors import InputError, Interrupted, StageError, describe_error
from hillsphere.base.paths import cache_directory
from hillsphere.base.progress import Progress
from hillsphere.base.signals import remedy, stop_signals
from hillsphere.mission.load import Mission, load_mission
from hillsphere.plugins.registry import Registry, default_registry
from hillsphere.products.product_codec import canonical
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere.runs.executor_choice import ExecutorChoice, executor_of, executor_table
from hillsphere.runs.judgements import judge_run
from hillsphere.runs.mission_check import check_mission
from hillsphere.runs.resume_choices import LOCAL, ResumeChoices, local_facts, resume_command
from hillsphere.runs.run_record import RunRecord, StageRecord
from hillsphere.runs.run_result import RunResult
from hillsphere.runs.stage_cache import StageCache
from hillsphere.runs.stage_context import StageContext
from hillsphere.runs.store import RunDirectory, plain_json
from hillsphere.runs.wiring import inputs_of, stages_to_repeat, takes_from
from hillsphere.show.charts import Chart
from hillsphere.show.drawing import draw
from hillsphere.show.plotly_renderer import plotly_figure
from hillsphere.show.presentation import AnyFigure, check_presentation
from hillsphere.show.report_content import ShownFigure

__all__ = ["RunResult", "resume_run", "run_mission"]

_UNSHOWN = "its product is stored, but its tables and figures are not complete"
"""Message of a stage that was interrupted after it was computed: its tables may lack rows that a
reader would take for results, so that it does not count as done. `resume_run` presents it again."""


def run_mission(
    mission: Mission | str | os.PathLike[str],
    *,
    out: str | Path | None = None,
    use_cache: bool = True,
    executor: ExecutorChoice = "serial",
    figures: bool = False,
    progress: Progress | None = None,
    registry: Registry | None = None,
) -> RunResult:
    """Run the stages of a mission and write its run directory.

    Parameters
    ----------
    mission : Mission, str or path
        From `hillsphere.load_mission`, or what that takes.
    out : str or Path, optional
        Run directory, empty or absent; by default ``runs/<mission>-<UTC>-<8 hex>`` in the working
        directory.
    use_cache : bool
        Take unchanged products from the cache, and store new ones there.
    executor : str, mapping or Executor
        Executor of campaigns: a type, ``"pool"``, its table, ``{"type": "pool", "workers": 4}``, or
        an object. ``"serial"`` uses this process. ``"pool"`` uses other processes, in which only
        components of importable modules are available. Results are bit-identical for all.
    figures : bool
        Write every figure as PNG too, which takes about as long again as the SVG that the report
        shows. `hillsphere.runs.run_figures.draw_figures` does so later.
    progress : Progress, optional
        Progress bars; by default none.
    registry : Registry, optional
        Registry of executors, whose broken plugins are listed in the log; the mission already
        holds its components.

    Returns
    -------
    RunResult
        The result, also if stages failed: see its `state` and `failures`.

    Raises
    ------
    InputError
        Before anything runs: the output directory cannot be used, a component refuses its
        parameters, a data file cannot be read, a stage needs a product of another type or repeats
        one that cannot be repeated.
    PluginError
        Before anything runs: a class cannot be imported.
    StageError
        If the run directory cannot be written to.
    Interrupted
        If the run was stopped by SIGINT, SIGTERM or SIGHUP. The run directory holds the finished
        stages, its manifest says ``"interrupted"``, and `resume_run` continues it.
    """
    if not isinstance(mission, Mission):
        mission = load_mission(mission, registry=registry)
    RunDirectory.check(out)
    with _watch_signals(progress) as (bars, stopped):
        try:
            run = _Run(mission, bars, stopped, use_cache, executor, figures, registry)
            directory = RunDirectory.create(out, mission.name, run.record.started)
        except KeyboardInterrupt:
            raise Interrupted("interrupted before any stage ran") from None
        with directory.locked():
            return run.run(directory)


def resume_run(
    run: str | Path,
    *,
    mission: str | os.PathLike[str] | None = None,
    allow_path: bool = False,
    executor: ExecutorChoice | None = None,
    figures: bool | None = None,
    progress: Progress | None = None,
    registry: Registry | None = None,
) -> RunResult:
    """Continue a run that was interrupted or killed, or in which a stage failed.

    Stored products are loaded and the other stages run; campaigns continue from their checkpoints.
    All stages present their products anew.

    Parameters
    ----------
    run : str or Path
        Its run directory. Since it may come from another user, choices other than a packaged
        mission and a local executor must be given (`hillsphere.runs.resume_choices`).
    mission : str or path, optional
        The mission of the run, needed if it is not a packaged one.
    allow_path : bool
        Accept input files outside the directory of the mission and the packaged data.
    executor : str, mapping or Executor, optional
        As for `run_mission`; by default as in the earlier run, if that was ``"serial"`` or
        ``"pool"``.
    figures : bool, optional
        As for `run_mission`; by default as in the earlier run.
    progress, registry : optional
        As for `run_mission`.

    Returns
    -------
    RunResult
        Bit-identical to that of an uninterrupted run; also for a run that is already finished.

    Raises
    ------
    InputError
        If a choice must be given that is not taken from the run directory (the message has the
        command line); if the directory is not one of a run, another process is writing to it, or a
        fact that the results depend on has changed: the mission, its inputs, the code, the versions
        of the numerical packages, the processor's features. The message lists every difference.
    PluginError, StageError, Interrupted
        As `run_mission`.
    """
    given = ResumeChoices(mission, allow_path, executor)
    EarlierRun.open(run).choices(given, ("resume",))
    with _watch_signals(progress) as (bars, stopped), RunDirectory(Path(run)).locked():
        try:
            earlier = EarlierRun.open(run)  # as it is now that nobody else writes to it
            choices = earlier.choices(given, ("resume",))
            loaded = earlier.mission(registry, choices)
            executor = choices.executor or "serial"
            use_cache = earlier.local.get("cache", True)
            if figures is None:
                figures = earlier.local.get("figures", False)
            again = _Run(loaded, bars, stopped, use_cache, executor, figures, registry, earlier)
        except KeyboardInterrupt:
            raise Interrupted("interrupted before any stage ran") from None
        earlier.directory.clear_parts()
        return again.run(earlier.directory)


@contextmanager
def _watch_signals(progress: Progress | None) -> Iterator[tuple[Progress, threading.Event]]:
    """Show progress, and handle the signals that end a run, within the block."""
    stopped = threading.Event()
    with stop_signals(stopped), progress or Progress(quiet=True) as bars:
        yield bars, stopped


class _Run:
    """One run: its fixed choices, and the records that are completed while it lasts."""

    def __init__(
        self,
        mission: Mission,
        progress: Progress,
        stopped: threading.Event,
        use_cache: bool,
        executor: ExecutorChoice,
        figures: bool,
        registry: Registry | None,
        earlier: EarlierRun | None = None,
    ) -> None:
        self.mission = mission
        self.progress = progress
        self.stopped = stopped
        self.figures = figures
        self.registry = registry
        self.earlier = earlier
        self.products: dict[str, Any] = {}
        # Stages whose products a repetition might not reproduce: they are not cached.
        self.by_chance: set[str] = set()
        # Stages with data from the resumed run directory, which another user may have written. They
        # are not cached, since other runs trust the cache.
        self.from_directory: set[str] = set()
        self.specs = mission.specs["stage"]
        checked = check_mission(mission)
        self.order, self.classes, self.stages = checked.order, checked.classes, checked.stages
        self.judges = checked.judges
        self.executor = executor_of(executor, registry or default_registry())
        # The cache is checked here, before other processes start and even if it is not used, so
        # that a warning about it is given once.
        cache_directory()
        self.cache = StageCache() if use_cache else None
        self.record = RunRecord.begun(mission)
        self.record.descriptions = checked.descriptions
        if earlier is not None:
            earlier.continue_in(self.record)
        self.local = local_facts(
            mission, cache=use_cache, executor=executor_table(executor), figures=figures
        )

    def run(self, directory: RunDirectory) -> RunResult:
        self.directory = directory
        with remedy(self._how_to_go_on()):
            return self._run()

    def _how_to_go_on(self) -> str:
        place = self.directory.path
        return f"results so far are in {place}; continue with: {resume_command(place, self.local)}"

    def _run(self) -> RunResult:
        directory = self.directory
        for plugin, reason in (self.registry.broken if self.registry else {}).items():
            directory.log(f"plugin {plugin} was set aside as broken: {reason}")
        directory.put_json(LOCAL, self.local)
        try:
            self._put_manifest("running")
            for number, name in enumerate(self.order, 1):
                with self.progress.stage(name, number, len(self.order)):
                    self._stage(name)
                self._put_manifest("running")
            state = "failed" if self.record.failures() else "success"
            summary = self._finish(state)
        except (KeyboardInterrupt, Interrupted) as stop:
            self.stopped.set()
            self._stopped()
            done = [s.name for s in self.record.stages.values() if s.state == "done"]
            kept = f"{stop.kept}; " if isinstance(stop, Interrupted) and stop.kept else ""
            raise Interrupted(
                f"interrupted; finished stages: {', '.join(done) or 'none'}; {kept}"
                f"{self._how_to_go_on()}"
            ) from None
        return RunResult(
            directory=directory.path,
            state=state,
            judgements=self.record.judgements,
            notes=tuple(self.record.notes()),
            metrics=self.record.metrics(),
            tables=self.record.tables(),
            figures=self.record.figures(),
            products=self.products,
            failures=tuple(self.record.failures()),
            summary=summary,
            mission=self.mission,
        )

    def _put_manifest(self, state: str) -> None:
        self.directory.put_json("manifest.json", self.record.manifest(state))

    def _stopped(self) -> None:
        for stage in self.record.stages.values():
            # A stage of the earlier part of a resumed run is "done" before it is presented anew.
            if stage.state == "running" or (stage.state == "done" and stage.shown is None):
                stage.state = "interrupted"
                stage.message = _UNSHOWN if stage.product else ""
        # First: should a second signal end this, the manifest already says how the run ended.
        self._put_manifest("interrupted")
        self._finish("interrupted")

    def _finish(self, state: str) -> Mapping[str, Any]:
        self.record.finished = datetime.now(UTC)
        evidence = self.record.evidence()
        self.record.judgements = judge_run(self.mission, self.judges, evidence)
        summary: Mapping[str, Any] = plain_json(self.record.summary(state))
        self.directory.put_json("summary.json", summary)
        self.directory.put_text("report.html", self.record.report(state))
        # Last: a run whose manifest says that it is finished has all its files.
        self._put_manifest(state)
        return summary

    def _stage(self, name: str) -> None:
        """Run one stage, or record why it cannot run; only an interruption is raised."""
        record = self.record.stages[name]
        missing = [other for other in takes_from(self.specs[name]) if other not in self.products]
        if missing:
            record.state = "not run"
            record.message = f"it needs {', '.join(missing)}"
            return
        record.state = "running"
        # Without a key, a random fingerprint, which no other run has.
        fingerprint = record.key or secrets.token_hex(32)
        context = StageContext(
            name, self.mission.seed, self.directory, self.progress, self.stopped, fingerprint,
            self.executor,
        )  # fmt: skip
        context.info(f"started ({record.type})")
        begun = perf_counter()
        try:
            inputs = inputs_of(self.specs[name], self.products)
            self.products[name] = self._product(record, inputs, context)
            self._present(name, record, inputs)
            record.state = "done"
        except Interrupted:
            raise
        # Border between the framework and a stage: any error of a plugin, SystemExit included,
        # fails the stage, is reported in one sentence, and leaves its traceback in the log.
        except (Exception, SystemExit) as error:
            record.state = "failed"
            record.error = type(error).__name__
            record.message = describe_error(error)
            context.info("failed\n" + "".join(traceback.format_exception(error)))
        finally:
            record.seconds += perf_counter() - begun
        context.info(f"{record.state} after {record.seconds:.2f} s")

    def _product(
        self, record: StageRecord, inputs: Mapping[str, Any], context: StageContext
    ) -> Any:
        """Return the product of a stage and store it in the run directory."""
        taken = takes_from(self.specs[record.name])
        settled = self.by_chance.isdisjoint(taken)
        if self.earlier is not None and (
            record.product
            or not self.from_directory.isdisjoint(taken)
            or (self.directory.path / "work" / record.name).exists()
        ):
            self.from_directory.add(record.name)
        product = self._stored(record, context)
        if product is None:
            product = self._cached(record, context) if settled else None
            if product is None:
                product = self._computed(record, inputs, context)
                kept = settled and record.name not in self.from_directory
                if kept and getattr(product, "reproducible", True):
                    self._keep(record, product, context)
            record.product = self.directory.put_product(record.name, product)
            self._put_manifest("running")
        if not settled or not getattr(product, "reproducible", True):
            self.by_chance.add(record.name)
        self.directory.clear_workspace(record.name)
        return product

    def _stored(self, record: StageRecord, context: StageContext) -> Any:
        """Return the product that an earlier part of this run has stored, or ``None``."""
        if self.earlier is None or not record.product:
            return None
        try:
            product = self.earlier.product(record.name, self.classes[record.name])
        except (InputError, OSError) as error:
            context.info(f"its product is damaged and computed again: {error}")
            record.product, record.cached, record.seconds = None, False, 0.0
            return None
        context.info("taken from the earlier part of this run")
        return product

    def _cached(self, record: StageRecord, context: StageContext) -> Any:
        if self.cache is None or record.key is None:
            return None
        try:
            product = self.cache.load(record.key, self.classes[record.name])
        except (InputError, OSError) as error:
            context.info(f"its cache entry is damaged and computed again: {error}")
            return None
        except StageError as error:
            context.info(f"it is computed again, as its cache entry stays unread: {error}")
            return None
        if product is not None:
            context.info(f"taken from the cache ({record.key[:16]})")
            record.cached = True
        return product

    def _computed(
        self, record: StageRecord, inputs: Mapping[str, Any], context: StageContext
    ) -> Any:
        expected = self.classes[record.name]
        repeated = stages_to_repeat(self.mission, record.name, self.products)
        product = self.stages[record.name].run(context, **repeated, **inputs)
        if not isinstance(product, expected):
            raise StageError(
                f"it must yield a {expected.__name__}, but yielded a {type(product).__name__}"
            )
        # Later stages receive the product in the form that a resumed run would load.
        return canonical(product)

    def _keep(self, record: StageRecord, product: Any, context: StageContext) -> None:
        if self.cache is not None and record.key is not None:
            try:
                self.cache.save(record.key, product)
            except OSError as error:
                context.info(f"its result could not be kept in the cache: {error}")

    def _present(self, name: str, record: StageRecord, inputs: Mapping[str, Any]) -> None:
        shown = check_presentation(self.stages[name].present(self.products[name], **inputs))
        record.shown, record.notes = shown, tuple(shown.verdict)
        for key, metric in shown.metrics.items():
            record.metrics[self.record.free_name("metrics", key, name)] = metric
        for key, table in shown.tables.items():
            free = self.record.free_name("tables", key, name)
            self.directory.put_table(free, table)
            record.tables[free] = table
            record.own_tables[key] = free
        figures = shown.figures if getattr(self.specs[name], "figures", True) else {}
        for key, figure in figures.items():
            free = self.record.free_name("figures", key, name)
            record.own_figures[key] = free
            is_lead = self._is_lead(name, key)
            record.figures[free] = self._show_figure(free, figure, is_lead=is_lead)
        for key, content in shown.files.items():
            self.directory.put_file(f"files/{name}/{key}", content)
            record.files = (*record.files, f"files/{name}/{key}")

    def _is_lead(self, stage: str, name: str) -> bool:
        """Return whether a figure stands on the first screen of the report, where all see it."""
        lead = self.mission.report.figure
        if lead.partition(".")[0] in self.specs:
            return f"{stage}.{name}" == lead
        return not any(record.figures for record in self.record.stages.values())

    def _show_figure(self, name: str, figure: AnyFigure, *, is_lead: bool) -> ShownFigure:
        """Return a figure for the report; write its data, and its pictures if they are wanted.

        A chart is drawn by the reader's browser. Its picture is drawn if it was asked for, and for
        the first screen, which is printed.
        """
        try:
            plot = plotly_figure(figure) if isinstance(figure, Chart) else None
            drawing = None
            if plot is None or is_lead or self.figures:
                drawing = draw(figure, png=self.figures)
        # Errors of the figure's own code are reported with the figure's name.
        except Exception as error:
            text = f"figure {name!r} cannot be drawn: {describe_error(error)}"
            raise StageError(text) from error
        if plot is not None:
            text = json.dumps(plot, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
            self.directory.put_text(f"figures/{name}.json", text)
        if drawing is not None:
            self.directory.put_svg(name, drawing.svg)
            if self.figures and drawing.png is not None:
                self.directory.put_png(name, drawing.png)
        return ShownFigure(figure, plot, drawing)
