"""``hillsphere run``: run a loaded mission and show what came of it."""

from __future__ import annotations

from pathlib import Path

from hillsphere.cli.endings import ExitCode, say
from hillsphere.cli.output import number, write, write_json, write_table
from hillsphere.mission import Mission
from hillsphere.pipeline import RunResult, run_mission
from hillsphere.plugins import Registry
from hillsphere.progress import Progress

__all__ = ["run_and_show"]


def run_and_show(
    mission: Mission,
    *,
    registry: Registry,
    out: Path | None,
    use_cache: bool,
    quiet: bool,
    json: bool,
) -> ExitCode:
    """Run a mission, its progress on stderr; write its metrics and its report's path to stdout.

    Parameters
    ----------
    mission : Mission
        What to run.
    registry : Registry
        Where its components come from.
    out : Path or None
        Run directory.
    use_cache : bool
        Whether results of stages may come from the cache.
    quiet : bool
        Show no progress even on a terminal.
    json : bool
        Write ``summary.json`` with the run directory instead of a table.

    Returns
    -------
    ExitCode
        ``FAILED`` if a stage failed; which one and why is told on stderr.
    """
    result = run_mission(
        mission, out=out, use_cache=use_cache, progress=Progress(quiet=quiet), registry=registry
    )
    for failure in result.failures:
        say(str(failure))
    if json:
        paths = {"directory": str(result.directory), "report": str(result.report)}
        write_json({**result.summary, **paths})
    else:
        _show(mission, result)
    return ExitCode.SUCCESS if result.ok else ExitCode.FAILED


def _show(mission: Mission, result: RunResult) -> None:
    write(f"{mission.name}: {result.state}")
    for note in result.notes:
        write(f"  {note}")
    write_table(
        [name, number(metric.value), "" if metric.unit == "-" else metric.unit]
        for name, metric in result.metrics.items()
    )
    write(f"report: {result.report}")
