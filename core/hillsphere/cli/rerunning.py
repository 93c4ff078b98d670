"""``hillsphere rerun``: repetition of a single case of a campaign, with its history."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hillsphere.cases.block_outcome import BlockOutcome
from hillsphere.cases.case_classes import case_class
from hillsphere.cli.exit_codes import ExitCode
from hillsphere.cli.output import number, write, write_json, write_table
from hillsphere.plugins.registry import Registry
from hillsphere.runs.rerun import Rerun, rerun_case

__all__ = ["rerun_and_show"]


def rerun_and_show(
    run: Path,
    case: int,
    *,
    stage: str | None,
    mission: str | None,
    allow_path: bool,
    figures: bool,
    registry: Registry,
    json: bool,
) -> ExitCode:
    """Repeat a case; write its result, and whether it is bit-identical, to stdout.

    Parameters
    ----------
    run : Path
        Run directory.
    case : int
        Number of the case.
    stage : str or None
        The campaign.
    mission : str or None
        The mission of the run, needed if it is not a packaged one.
    allow_path : bool
        Whether it may read files outside its directory.
    figures : bool
        Write the figure of the history as PNG too.
    registry : Registry
        Registry of components.
    json : bool
        Write JSON instead of tables.

    Returns
    -------
    ExitCode
        ``FAILED`` if the result differs from that of the run.
    """
    rerun = rerun_case(
        run, case, stage=stage, mission=mission, allow_path=allow_path, figures=figures,
        registry=registry,
    )  # fmt: skip
    if json:
        write_json(_plain(rerun))
    else:
        _show(rerun)
    return ExitCode.FAILED if rerun.differences else ExitCode.SUCCESS


def _show(rerun: Rerun) -> None:
    where = f" at {rerun.point}" if rerun.point else ""
    write(f"{rerun.campaign}: case {rerun.case} of stage {rerun.stage}{where}, draw {rerun.draw}")
    now = rerun.now
    write(f"  {_ending(now)}")
    for message in now.messages:
        write(f"  {message}")
    if rerun.then is None:
        write("  the run has not computed this case")
    elif rerun.differences:
        write("  NOT the same as in the run (then -> now):")
        for line in rerun.differences:
            write(f"    {line}")
    else:
        write("  the same as in the run, to the last bit")
    write_table(
        [f"  {name}", number(value), "" if unit == "-" else unit]
        for name, value, unit in [
            *((name, value, unit) for name, (value, unit) in rerun.inputs.items()),
            *zip(now.metrics, now.values[:, 0].tolist(), now.units, strict=True),
        ]
    )
    if rerun.traceback:
        write(rerun.traceback.rstrip("\n"))
    for path in rerun.files:
        write(f"history: {path}")


def _ending(row: BlockOutcome) -> str:
    cause = f" ({row.cause[0]})" if row.cause[0] else ""
    judged = case_class(str(row.status[0]), bool(row.failed[0]))
    word = {"failure": "failed", "success": "succeeded"}.get(judged, judged)
    return f"{word}: {row.status[0]}{cause}"


def _plain(rerun: Rerun) -> dict[str, Any]:
    return {
        "stage": rerun.campaign,
        "repeats": rerun.stage,
        "case": rerun.case,
        "draw": rerun.draw,
        "point": rerun.point,
        "inputs": {
            name: {"value": value, "unit": unit} for name, (value, unit) in rerun.inputs.items()
        },
        "now": _plain_row(rerun.now),
        "then": None if rerun.then is None else _plain_row(rerun.then),
        "differences": list(rerun.differences),
        "traceback": rerun.traceback,
        "files": [str(path) for path in rerun.files],
    }


def _plain_row(row: BlockOutcome) -> dict[str, Any]:
    values = zip(row.metrics, row.values[:, 0].tolist(), row.units, strict=True)
    return {
        "status": str(row.status[0]),
        "cause": str(row.cause[0]),
        "failed": bool(row.failed[0]),
        "messages": list(row.messages),
        "metrics": {name: {"value": value, "unit": unit} for name, value, unit in values},
    }
