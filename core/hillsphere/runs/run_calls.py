"""Runs as a script or a notebook begins and opens them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from hillsphere.base.errors import InputError
from hillsphere.base.progress import Progress
from hillsphere.mission.load import Mission, load_mission
from hillsphere.plugins.registry import Registry
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere.runs.executor_choice import ExecutorChoice
from hillsphere.runs.judgements import Judgements
from hillsphere.runs.pipeline import run_mission
from hillsphere.runs.resume_choices import is_packaged
from hillsphere.runs.run_record import Failure, free_name
from hillsphere.runs.run_result import RunResult
from hillsphere.runs.run_summary import RunSummary
from hillsphere.runs.stored_results import present_again
from hillsphere.show.presentation import AnyFigure, Metric, Table

__all__ = ["load_run", "run"]

Item = TypeVar("Item")


def run(
    mission: Mission | str | os.PathLike[str],
    *,
    set: Mapping[str, Any] | None = None,  # noqa: A002 - the word of the command line
    profile: str | None = None,
    out: str | Path | None = None,
    executor: ExecutorChoice = "serial",
    figures: bool = False,
    use_cache: bool = True,
    allow_path: bool = False,
    progress: bool | Progress = False,
    registry: Registry | None = None,
) -> RunResult:
    """Run a mission.

    Parameters
    ----------
    mission : Mission, str or path
        A mission, the name of a packaged one, or the path of a mission file.
    set : mapping, optional
        Settings by key: ``{"stage.family.x_amplitudes_km": [90]}``.
    profile : str, optional
        Name of a profile of the mission.
    out : str or Path, optional
        Run directory, empty or absent; by default a new one in ``runs``.
    executor, figures, use_cache : optional
        As for `hillsphere.run_mission`.
    allow_path : bool
        Accept input files outside the directory of the mission and the packaged data.
    progress : bool or Progress
        Show progress bars on the terminal.
    registry : Registry, optional
        Components to choose from; by default all that are installed.

    Returns
    -------
    RunResult
        The result, also if stages failed: see its `state` and `failures`.

    Raises
    ------
    InputError
        If the mission, a setting or the output directory is not valid.
    PluginError, StageError, Interrupted
        As `hillsphere.run_mission`.

    Examples
    --------
    >>> result = run("phobos-qso", set={"stage.family.x_amplitudes_km": [90]})  # doctest: +SKIP
    """
    loading: dict[str, Any] = {"registry": registry, "allow_path": allow_path}
    if not isinstance(mission, Mission):
        mission = Mission.load(mission, set=set, profile=profile, **loading)
    elif set or profile:
        mission = mission.with_(set=set, profile=profile, **loading)
    shown = progress if isinstance(progress, Progress) else Progress(quiet=not progress)
    return run_mission(
        mission, out=out, use_cache=use_cache, executor=executor, figures=figures, progress=shown,
        registry=registry,
    )  # fmt: skip


def load_run(
    directory: str | Path,
    *,
    mission: Mission | str | os.PathLike[str] | None = None,
    allow_path: bool = False,
    registry: Registry | None = None,
) -> RunResult:
    """Open the results of an ended run; nothing is computed again.

    Parameters
    ----------
    directory : str or Path
        Run directory.
    mission : Mission, str or path, optional
        The mission of the run, needed if it is not a packaged one: a run directory may come from
        another user, and no file that it names is read.
    allow_path : bool
        Accept input files outside the directory of the mission and the packaged data.
    registry : Registry, optional
        Components to choose from; by default all that are installed.

    Returns
    -------
    RunResult
        Outcomes as the run found them; metrics, tables and figures as the stages present their
        stored products now.

    Raises
    ------
    InputError
        If it is no run directory, the run has not ended, or a product is damaged; if the mission
        must be given or is another one.
    """
    earlier = EarlierRun.open(directory)
    summary = RunSummary.read(directory).summary
    loaded = _mission_of(earlier, mission, allow_path, registry)
    stored = {name for name, entry in earlier.manifest["stages"].items() if entry.get("product")}
    if missing := stored - {*loaded.specs["stage"]}:
        raise InputError(f"mission {loaded.name!r} has no stage {sorted(missing)[0]!r} of the run")
    products: dict[str, Any] = {}
    metrics: dict[str, Metric] = {}
    tables: dict[str, Table] = {}
    figures: dict[str, AnyFigure] = {}
    for stage, shown in present_again(earlier, loaded, stored, products):
        _add(metrics, shown.metrics, stage)
        _add(tables, shown.tables, stage)
        _add(figures, shown.figures, stage)
    return RunResult(
        directory=earlier.directory.path,
        state=summary["verdict"]["state"],
        judgements=Judgements.from_json(summary),
        notes=tuple(summary["verdict"]["notes"]),
        metrics=metrics,
        tables=tables,
        figures=figures,
        products={name: products[name] for name in products if name in stored},
        failures=tuple(Failure(**row) for row in summary.get("failures", ())),
        summary=summary,
        mission=loaded,
    )


def _add(all_items: dict[str, Item], items: Mapping[str, Item], stage: str) -> None:
    """Add what a stage shows, under the names that the run gave it."""
    for key, item in items.items():
        all_items[free_name({*all_items}, key, stage)] = item


def _mission_of(
    earlier: EarlierRun,
    given: Mission | str | os.PathLike[str] | None,
    allow_path: bool,
    registry: Registry | None,
) -> Mission:
    """Return the mission of a run as it is now, with the run's profile and settings."""
    if isinstance(given, Mission):
        return given
    name = str(earlier.local["mission"])
    if given is None and not is_packaged(name):
        raise InputError(
            f"the mission of {str(earlier.directory.path)!r} is not a packaged one: give it as "
            "mission=..."
        )
    return load_mission(
        name if given is None else given,
        sets=tuple(earlier.manifest.get("sets", ())),
        profile=earlier.manifest.get("profile"),
        registry=registry,
        allow_path=allow_path,
    )
