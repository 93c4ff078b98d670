"""Pictures of the figures of a finished run, SVG and PNG, drawn from its stored products."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from hillsphere.base.errors import InputError, StageError, describe_error
from hillsphere.base.problems import did_you_mean
from hillsphere.mission.load import Mission
from hillsphere.plugins.registry import Registry
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere.runs.resume_choices import ResumeChoices, resume_command
from hillsphere.runs.run_record import RunRecord, free_name
from hillsphere.runs.stored_results import present_again
from hillsphere.show.drawing import draw
from hillsphere.show.presentation import AnyFigure

__all__ = ["draw_figures"]


def draw_figures(
    run: str | Path,
    name: str | None = None,
    *,
    mission: str | os.PathLike[str] | None = None,
    allow_path: bool = False,
    registry: Registry | None = None,
) -> tuple[Path, ...]:
    """Draw figures of a finished run as SVG and PNG.

    The stages present their stored products again; nothing is recomputed.

    Parameters
    ----------
    run : str or Path
        Run directory.
    name : str, optional
        A stage, for all of its figures, or a figure, by the name of its file without the suffix;
        by default every figure of the run.
    mission : str or path, optional
        The mission of the run, needed if it is not a packaged one.
    allow_path : bool
        Accept input files outside the directory of the mission and the packaged data.
    registry : Registry, optional
        Registry of components; by default of all installed plugins.

    Returns
    -------
    tuple of Path
        The written files ``figures/<name>.svg`` and ``.png`` in the run directory.

    Raises
    ------
    InputError
        If a choice must be given that is not taken from the run directory (the message has the
        command line); if the run is not finished, has no figure or stage of that name, or a fact
        that its results depend on has changed; if a product is damaged.
    StageError
        If a product cannot be shown, or a file cannot be written.
    """
    given = ResumeChoices(mission, allow_path)
    command = ("figures", *(() if name is None else (name,)))
    EarlierRun.open(run).choices(given, command, needs_executor=False)
    with EarlierRun.open(run).directory.locked():
        earlier = EarlierRun.open(run)  # as it is now that nobody else writes to it
        choices = earlier.choices(given, command, needs_executor=False)
        if earlier.state != "finished":
            again = resume_command(earlier.directory.path, earlier.local)
            raise InputError(
                f"run {str(run)!r} is not finished (its state is {earlier.state!r}); "
                f"this command continues it and draws its figures: {again} --figures"
            )
        if name is not None:
            _check_name(earlier, name)
        loaded = earlier.mission(registry, choices)
        earlier.refuse_changes(RunRecord.begun(loaded))
        earlier.directory.clear_parts()
        paths = tuple(
            path
            for free, figure in _figures(earlier, loaded, name)
            for path in _draw(earlier, free, figure)
        )
        if name is not None and not paths:
            raise InputError(f"run {str(run)!r} has no figures of {name!r}")
        return paths


def _check_name(earlier: EarlierRun, name: str) -> None:
    """Refuse a name that is neither a figure nor a stage, before anything is loaded."""
    folder = earlier.directory.path / "figures"
    drawn = sorted({path.stem for path in folder.glob("*.*") if path.suffix in (".json", ".svg")})
    valid = [*drawn, *earlier.manifest["stages"]]
    if name not in valid:
        raise InputError(
            f"run {str(earlier.directory.path)!r} has no figure or stage {name!r}"
            f"{did_you_mean(name, valid, otherwise='it has')}"
        )


def _figures(
    earlier: EarlierRun, mission: Mission, name: str | None
) -> Iterator[tuple[str, AnyFigure]]:
    """Yield the requested figures under the names that they have in the run.

    A name depends on the figures of all earlier stages, so that these present their products too.
    """
    is_stage = name in earlier.manifest["stages"]
    drawn = [s for s, spec in mission.specs["stage"].items() if getattr(spec, "figures", True)]
    used: set[str] = set()
    for stage, shown in present_again(earlier, mission, drawn):
        for key, figure in shown.figures.items():
            free = free_name(used, key, stage)
            used.add(free)
            if name in (None, stage if is_stage else free):
                yield free, figure
        if name is not None and (name == stage if is_stage else name in used):
            return


def _draw(earlier: EarlierRun, name: str, figure: AnyFigure) -> tuple[Path, ...]:
    try:
        drawing = draw(figure, png=True)
    # Errors of the figure's own code are reported with the figure's name.
    except Exception as error:
        raise StageError(f"figure {name!r} cannot be drawn: {describe_error(error)}") from error
    assert drawing.png is not None  # it was asked for
    directory = earlier.directory
    return directory.put_svg(name, drawing.svg), directory.put_png(name, drawing.png)
