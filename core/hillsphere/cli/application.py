"""The typer application of all commands, and their common options and functions."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hillsphere.cli.completion import complete_mission, complete_profile, complete_setting
from hillsphere.cli.plugin_commands import CommandGroup

if TYPE_CHECKING:
    from hillsphere.mission.load import Mission
    from hillsphere.plugins.registry import Registry

__all__ = [
    "AllowPath", "Json", "MissionName", "PluginFiles", "Profile", "Sets", "StrictPlugins", "app",
    "load", "registry_of",
]  # fmt: skip

app = typer.Typer(
    name="hillsphere",
    cls=CommandGroup,
    help="Mission analysis for small bodies: missions are TOML files, models are plugins.",
    epilog="Exit codes: 0 success, 1 a stage failed, 2 bad input, 3 internal error, "
    "4 a requirement is not met or undecided, or runs differ, 130 interrupted.",
    rich_markup_mode=None,
    invoke_without_command=True,
)

MissionName = Annotated[
    str,
    typer.Argument(
        metavar="MISSION",
        help="Name of a packaged mission, or path of a .toml.",
        autocompletion=complete_mission,
    ),
]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Replace a value, e.g. stage.a.b_km=3.",
        autocompletion=complete_setting,
    ),
]
Profile = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="Apply [profile.NAME].", autocompletion=complete_profile),
]
Json = Annotated[bool, typer.Option("--json", help="Write JSON to stdout.")]
AllowPath = Annotated[
    bool, typer.Option("--allow-path", help="Let the mission read files outside its directory.")
]
StrictPlugins = Annotated[
    bool, typer.Option("--strict-plugins", help="Stop at the first broken plugin.")
]


PluginFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--plugin",
        metavar="FILE",
        help="Execute this Python file, and use the components that it offers.",
    ),
]


def registry_of(
    strict: bool = False, files: list[Path] | None = None, run: Path | None = None
) -> Registry:
    """Return the installed plugins and those of files; the first broken one is an error if strict.

    Of a run that is given, a file must be that with which it was begun.
    """
    from hillsphere.plugins.registry import default_registry, discover

    if files:
        # Not while the command line is read, which completion does with half of one.
        from hillsphere.plugins.plugin_files import add_plugin_file
        from hillsphere.runs.resume_choices import read_local

        begun = {} if run is None else read_local(run).get("plugin_files", {})
        for path in files:
            add_plugin_file(path, begun.get(path.name))
    return discover(strict=True) if strict else default_registry()


def load(
    name: str, sets: list[str] | None, profile: str | None, registry: Registry, allow_path: bool
) -> Mission:
    """Load a mission according to the options of a command."""
    from hillsphere.mission.load import load_mission

    return load_mission(
        name, sets=tuple(sets or ()), profile=profile, registry=registry, allow_path=allow_path
    )
