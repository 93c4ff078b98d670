"""``hillsphere run`` and ``resume``: run a mission and show its results."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hillsphere.base.progress import Progress
from hillsphere.cli.exit_codes import ExitCode
from hillsphere.cli.output import write, write_json
from hillsphere.cli.streams import say
from hillsphere.cli.verdict import exit_code, show_verdict
from hillsphere.mission.load import Mission
from hillsphere.plugins.registry import Registry
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere.runs.pipeline import RunResult, resume_run, run_mission
from hillsphere.runs.run_figures import draw_figures
from hillsphere.runs.run_summary import RunSummary

__all__ = ["resume_and_show", "run_and_show"]


def run_and_show(
    mission: Mission,
    *,
    registry: Registry,
    out: Path | None,
    use_cache: bool,
    executor: Mapping[str, Any],
    figures: bool,
    quiet: bool,
    json: bool,
    verbose: bool,
) -> ExitCode:
    """Run a mission, its progress on stderr; write its verdict and its report's path to stdout.

    Parameters
    ----------
    mission : Mission
        The mission.
    registry : Registry
        Registry of executors and plugins.
    out : Path or None
        Run directory.
    use_cache : bool
        Whether results of stages may come from the cache.
    executor : mapping
        Table of the executor.
    figures : bool
        Write figures as PNG too.
    quiet : bool
        Show no progress even on a terminal.
    json : bool
        Write ``summary.json`` with the run directory instead of the verdict.
    verbose : bool
        Write all rows of the verdict, and the sentences and metrics of the stages.

    Returns
    -------
    ExitCode
        ``FAILED`` if a stage failed; stderr then names the stage and the error. Otherwise
        ``NOT_MET`` if a requirement is not met or undecided.
    """
    result = run_mission(
        mission, out=out, use_cache=use_cache, executor=executor, figures=figures,
        progress=Progress(quiet=quiet), registry=registry,
    )  # fmt: skip
    return _show_end(result, json, verbose)


def resume_and_show(
    run: Path,
    *,
    mission: str | None,
    allow_path: bool,
    registry: Registry,
    executor: Mapping[str, Any],
    figures: bool,
    quiet: bool,
    json: bool,
    verbose: bool,
) -> ExitCode:
    """Continue a run and show it as `run_and_show` does, or report that it is finished.

    Parameters
    ----------
    run : Path
        Run directory.
    mission : str or None
        The mission of the run, needed if it is not a packaged one.
    allow_path : bool
        Whether it may read files outside its directory.
    registry : Registry
        Registry of components.
    executor : mapping
        Table of the executor; empty for that of the earlier run.
    figures : bool
        Write figures as PNG too, of a run that is finished as well.
    quiet : bool
        Show no progress even on a terminal.
    json : bool
        Write ``summary.json`` with the run directory instead of the verdict.
    verbose : bool
        Write all rows of the verdict, and the sentences and metrics of the stages.

    Returns
    -------
    ExitCode
        As of `run_and_show`, also if nothing was left to do.
    """
    earlier = EarlierRun.open(run)
    name = str(earlier.manifest["mission"].get("name"))
    # A product that was damaged since is computed again.
    if earlier.state == "finished" and earlier.has_its_products():
        drawn: tuple[Path, ...] = ()
        if figures:
            drawn = draw_figures(run, mission=mission, allow_path=allow_path, registry=registry)
        summary = RunSummary.read(run).summary
        if json:
            _write_summary(summary, run)
        else:
            count = len({path.stem for path in drawn})
            done = f"{count} figures were drawn" if drawn else "nothing is left to do"
            write(f"{name}: this run is finished; {done}")
            write(f"report: {run / 'report.html'}")
        return exit_code(summary)
    # What the command line runs by default; a run from Python may have had an executor of its own.
    chosen = executor or (None if earlier.local.get("executor") else {"type": "pool"})
    result = resume_run(
        run, mission=mission, allow_path=allow_path, executor=chosen, figures=figures or None,
        progress=Progress(quiet=quiet), registry=registry,
    )  # fmt: skip
    return _show_end(result, json, verbose)


def _show_end(result: RunResult, json: bool, verbose: bool) -> ExitCode:
    for failure in result.failures:
        say(str(failure))
    if json:
        _write_summary(result.summary, result.directory)
    else:
        show_verdict(result.summary, result.report, verbose=verbose)
    return exit_code(result.summary)


def _write_summary(summary: Mapping[str, Any], directory: Path) -> None:
    paths = {"directory": str(directory), "report": str(directory / "report.html")}
    write_json({**summary, **paths})
