"""Commands about missions, plugins and the installation.

Each command imports its modules when it is called. Commands about runs are in `run_commands`, lists
and descriptions of what is installed in `reference_commands`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

# Their commands are registered by being imported; help lists them in this order.
import hillsphere.cli.author_commands
import hillsphere.cli.reference_commands
import hillsphere.cli.result_commands
import hillsphere.cli.run_commands  # noqa: F401
from hillsphere.cli.application import (
    AllowPath,
    Json,
    PluginFiles,
    Profile,
    Sets,
    StrictPlugins,
    app,
    load,
    registry_of,
)
from hillsphere.cli.completion import complete_mission
from hillsphere.cli.output import write, write_json, write_table
from hillsphere.cli.plugin_commands import shadowed_commands

if TYPE_CHECKING:
    from hillsphere.base.problems import Problem
    from hillsphere.mission.load import Mission
    from hillsphere.plugins.registry import Registry

__all__ = ["app"]


@app.callback()
def _hillsphere(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    if version:
        from hillsphere import __version__

        write(f"hillsphere {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        write(context.get_help())


@app.command()
def validate(
    missions: Annotated[
        list[str],
        typer.Argument(
            metavar="MISSION...", help="Packaged names or paths.", autocompletion=complete_mission
        ),
    ],
    sets: Sets = None,
    profile: Profile = None,
    json: Json = False,
    allow_path: AllowPath = False,
    strict_plugins: StrictPlugins = False,
    plugin: PluginFiles = None,
) -> int:
    """Check missions, under each of their profiles, without running them."""
    from hillsphere.base.errors import InputError, PluginError
    from hillsphere.cli.exit_codes import ExitCode
    from hillsphere.cli.streams import say
    from hillsphere.runs.mission_check import check_mission

    registry = registry_of(strict_plugins, plugin)
    results: list[dict[str, Any]] = []
    for name in missions:
        problems: list[dict[str, Any]] = []
        told = ""
        idle: list[str] = []
        try:
            loaded = load(name, sets, profile, registry, allow_path)
            check_mission(loaded)
            if profile is None:
                idle = _check_profiles(loaded, name, sets, registry, allow_path)
        except (InputError, PluginError) as error:
            told = str(error)
            problems = [_problem(problem) for problem in getattr(error, "problems", ())]
            problems = problems or [_problem(told)]
        results.append(
            {"mission": name, "valid": not problems, "problems": problems, "remarks": idle}
        )
        if json:
            continue
        if problems:
            say(told)
        else:
            write(f"{name}: valid ({_extent(loaded)})")
            for remark in idle:
                write(f"  {remark}")
    if json:
        write_json(results)
    return ExitCode.SUCCESS if all(r["valid"] for r in results) else ExitCode.BAD_INPUT


@app.command()
def plugins(
    json: Json = False,
    strict_plugins: Annotated[
        bool,
        typer.Option(
            "--strict-plugins",
            help="Import all that is offered too; whatever is broken is an error.",
        ),
    ] = False,
    plugin: PluginFiles = None,
) -> None:
    """List plugins and their components."""
    from hillsphere.base.errors import PluginError

    registry = registry_of(strict_plugins, plugin)
    if strict_plugins and (faults := [fault for one in registry if (fault := one.fault())]):
        raise PluginError("\n".join(faults))
    contested = _contested_components(registry)
    records = [
        {
            "kind": r.component.kind,
            "type": r.component.type,
            "plugin": r.plugin,
            "distribution": r.distribution,
            "summary": r.component.summary,
        }
        for r in registry
    ]
    if json:
        write_json(
            {
                "components": records,
                "broken": registry.broken,
                "contested": [
                    {"kind": kind, "type": type_, "message": message}
                    for (kind, type_), message in contested.items()
                ],
                "disabled": list(registry.disabled),
            }
        )
        return
    columns = ("kind", "type", "plugin", "summary")
    write_table([[r[c] for c in columns] for r in records], header=columns)
    for name, reason in sorted(registry.broken.items()):
        write(f"broken: {name}: {reason}")
    for message in contested.values():
        write(f"contested: {message}")
    for name in registry.disabled:
        write(f"disabled: {name}")


@app.command()
def doctor(json: Json = False) -> int:
    """Check the installation."""
    from hillsphere.cli.doctor import examine
    from hillsphere.cli.exit_codes import ExitCode

    registry = registry_of(strict=False)
    findings = examine(registry, _contested_components(registry))
    if json:
        write_json(
            {
                "ok": all(f.ok for f in findings),
                "checks": [
                    {"group": f.group, "name": f.name, "state": f.state, "detail": f.detail}
                    for f in findings
                ],
            }
        )
    else:
        write_table([[f.state, f.group, f.name, f.detail] for f in findings])
    return ExitCode.SUCCESS if all(f.ok for f in findings) else ExitCode.FAILED


def _problem(problem: Problem | str) -> dict[str, Any]:
    from hillsphere.base.problems import format_key

    if isinstance(problem, str):
        return {"source": "", "line": None, "key": "", "message": problem}
    return {
        "source": problem.source,
        "line": problem.line,
        "key": format_key(problem.key),
        "message": problem.message,
    }


def _check_profiles(
    mission: Mission, name: str, sets: list[str] | None, registry: Registry, allow_path: bool
) -> list[str]:
    """Check a mission, valid without a profile, under each of its profiles.

    A setting may concern a table that a profile drops; such settings are returned as sentences.
    Raises `MissionError` with all faults.
    """
    from hillsphere.base.problems import MissionError
    from hillsphere.runs.mission_check import check_mission

    problems: dict[Problem, list[str]] = {}
    idle: list[str] = []
    for profile in mission.profiles:
        try:
            check_mission(load(name, sets, profile, registry, allow_path))
        except MissionError as error:
            for problem in error.problems:
                if problem.is_idle:
                    idle.append(
                        f"profile {profile}: {problem.source} has no effect, {problem.message}"
                    )
                else:
                    problems.setdefault(problem, []).append(profile)
    if problems:
        raise MissionError(
            replace(problem, message=f"{problem.message} (with profile {', '.join(profiles)})")
            for problem, profiles in problems.items()
        )
    return idle


def _extent(mission: Mission) -> str:
    count = len(mission.order())
    text = f"{count} stage{'s' * (count != 1)}"
    if mission.profile is None and mission.profiles:
        text += f"; also with profile {', '.join(mission.profiles)}"
    return text


def _contested_components(registry: Registry) -> dict[tuple[str, str], str]:
    """Return components that two plugins, or a plugin and the core, offer, with a message each."""
    own = {
        str(command.name or command.callback.__name__)
        for command in app.registered_commands
        if command.callback
    }
    own |= {str(group.name) for group in app.registered_groups}
    return {**registry.contested, **shadowed_commands(registry, own)}
