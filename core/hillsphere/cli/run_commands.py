"""Commands that make and use runs; each imports its modules when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hillsphere.base.errors import InputError
from hillsphere.cli.application import (
    AllowPath,
    Json,
    MissionName,
    PluginFiles,
    Profile,
    Sets,
    StrictPlugins,
    app,
    load,
    registry_of,
)
from hillsphere.cli.completion import complete_mission, complete_stage
from hillsphere.cli.output import write

RunName = Annotated[Path, typer.Argument(metavar="RUN", help="Run directory.")]
Quiet = Annotated[bool, typer.Option("--quiet", help="Show no progress.")]
Workers = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=0,
        help="Processes for campaigns and other stages that divide their work; 0: none but this "
        "one. By default one per processor.",
    ),
]
ExecutorType = Annotated[
    str | None,
    typer.Option(
        "--executor",
        metavar="TYPE",
        help="Where campaigns and other stages that divide their work do it: serial, pool, dask …",
    ),
]
MissionAgain = Annotated[
    str | None,
    typer.Option(
        "--mission",
        metavar="MISSION",
        help="The run's mission; needed if it is no packaged one.",
        autocompletion=complete_mission,
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(metavar="ADDRESS", help="Use the dask cluster there, e.g. tcp://host:8786."),
]
Figures = Annotated[bool, typer.Option("--figures", help="Write figures as SVG and PNG files too.")]
Verbose = Annotated[
    bool,
    typer.Option("--verbose", "-v", help="Show all rows, and what every stage has to tell."),
]
StageName = Annotated[
    str | None,
    typer.Option(
        "--stage",
        metavar="NAME",
        help="Campaign; needed if the mission has several.",
        autocompletion=complete_stage,
    ),
]


@app.command()
def run(
    mission: MissionName,
    sets: Sets = None,
    profile: Profile = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Run directory; must be empty or absent."),
    ] = None,
    workers: Workers = None,
    executor: ExecutorType = None,
    scheduler: Scheduler = None,
    no_cache: Annotated[
        bool,
        typer.Option(
            "--no-cache", help="Neither read nor write stage results; compiled code is kept."
        ),
    ] = False,
    figures: Figures = False,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    allow_path: AllowPath = False,
    strict_plugins: StrictPlugins = False,
    plugin: PluginFiles = None,
) -> int:
    """Run a mission and write its results to a run directory."""
    chosen = _executor(executor, workers, scheduler) or {"type": "pool"}
    registry = registry_of(strict_plugins, plugin)
    loaded = load(mission, sets, profile, registry, allow_path)
    from hillsphere.cli.running import run_and_show

    return run_and_show(
        loaded, registry=registry, out=out, use_cache=not no_cache, executor=chosen,
        figures=figures, quiet=quiet, json=json, verbose=verbose,
    )  # fmt: skip


@app.command()
def resume(
    run: RunName,
    mission: MissionAgain = None,
    workers: Workers = None,
    executor: ExecutorType = None,
    scheduler: Scheduler = None,
    figures: Figures = False,
    json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
    allow_path: AllowPath = False,
    strict_plugins: StrictPlugins = False,
    plugin: PluginFiles = None,
) -> int:
    """Continue a run that was interrupted or killed, or in which a stage failed.

    A run directory is data. A mission that is not a packaged one, files outside its directory and
    an executor beyond this machine must be given again; the message says how. A run that was begun
    with --figures goes on with it.
    """
    from hillsphere.cli.running import resume_and_show

    return resume_and_show(
        run, mission=mission, allow_path=allow_path,
        registry=registry_of(strict_plugins, plugin, run),
        executor=_executor(executor, workers, scheduler), figures=figures, quiet=quiet, json=json,
        verbose=verbose,
    )  # fmt: skip


def _executor(type_: str | None, workers: int | None, scheduler: str | None) -> dict[str, Any]:
    """Return the table of the requested executor; empty without a request."""
    if scheduler is not None and type_ is None:
        type_ = "dask"
    if workers == 0:
        if type_ not in (None, "serial"):
            raise InputError(f"--workers 0: the executor {type_!r} needs at least one")
        return {"type": "serial"}
    if type_ is None and workers is None:
        return {}
    table: dict[str, Any] = {"type": type_ or "pool"}
    if workers is not None:
        table["workers"] = workers
    if scheduler is not None:
        table["scheduler"] = scheduler
    return table


@app.command()
def rerun(
    run: RunName,
    case: Annotated[int, typer.Option("--case", metavar="N", help="Number of the case.")],
    stage: StageName = None,
    mission: MissionAgain = None,
    figures: Figures = False,
    json: Json = False,
    allow_path: AllowPath = False,
    strict_plugins: StrictPlugins = False,
    plugin: PluginFiles = None,
) -> int:
    """Repeat one case of a campaign with its history, and compare it with that of the run."""
    from hillsphere.cli.rerunning import rerun_and_show

    return rerun_and_show(
        run, case, stage=stage, mission=mission, allow_path=allow_path, figures=figures,
        registry=registry_of(strict_plugins, plugin, run), json=json,
    )  # fmt: skip


@app.command()
def figures(
    run: RunName,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="ID",
            help="A stage, for all of its figures, or a figure.",
            autocompletion=complete_stage,
        ),
    ] = None,
    mission: MissionAgain = None,
    allow_path: AllowPath = False,
    strict_plugins: StrictPlugins = False,
    plugin: PluginFiles = None,
) -> None:
    """Draw figures of a finished run as SVG and PNG, from its stored products.

    No stage is computed again. Without ID all figures are drawn.
    """
    from hillsphere.runs.run_figures import draw_figures

    registry = registry_of(strict_plugins, plugin, run)
    paths = draw_figures(run, name, mission=mission, allow_path=allow_path, registry=registry)
    for path in paths:
        write(str(path))
    if not paths:
        write(f"run {str(run)!r} has no figures")
