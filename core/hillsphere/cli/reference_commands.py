"""Commands that tell what is installed: ``missions``, ``describe``, ``schema``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from hillsphere.base.errors import InputError
from hillsphere.cli.application import Json, PluginFiles, app, registry_of
from hillsphere.cli.completion import complete_kind, complete_type
from hillsphere.cli.output import write, write_json, write_table
from hillsphere.cli.streams import say

_MOST_BYTES = 1 << 20
"""Largest size of the file of measured times; that of the packaged missions takes 30 kB."""
TIMES = "times.json"
"""Measured times of the packaged missions, beside these."""
_UNKNOWN = "–"


@app.command()
def missions(json_: Json = False) -> None:
    """List the packaged missions with their profiles and how long they take."""
    from hillsphere.mission.load import packaged_missions

    machine, cpu_s = _measured_times()
    packaged = [
        (name, title, _runs(name, cpu_s.get(name, {}))) for name, title in packaged_missions()
    ]
    if json_:
        write_json(
            [{"name": name, "title": title, "cpu_s": runs} for name, title, runs in packaged]
        )
        return
    rows = []
    for name, title, runs in packaged:
        shown = ", ".join(f"{p} {_duration(seconds)}" for p, seconds in runs.items() if p)
        rows.append((name, _duration(runs[""]), shown or _UNKNOWN, title))
    write_table(rows, header=("mission", "CPU time", "profiles", "title"))
    write(f"\nCPU time of one run without the cache, {machine}; –: not measured")


@app.command()
def describe(
    kind: Annotated[
        str | None,
        typer.Argument(
            metavar="[KIND]",
            help="Kind of components, such as stage.",
            autocompletion=complete_kind,
        ),
    ] = None,
    type_: Annotated[
        str | None,
        typer.Argument(
            metavar="[TYPE]", help="A type, such as qso_family.", autocompletion=complete_type
        ),
    ] = None,
    json_: Json = False,
    plugin: PluginFiles = None,
) -> None:
    """Describe kinds of components, the types of a kind, or the keys of a type."""
    from hillsphere.cli import describing

    registry = registry_of(files=plugin)
    if kind is None:
        describing.describe_kinds(registry, json_)
    elif type_ is None:
        describing.describe_kind(registry, kind, json_)
    else:
        describing.describe_component(registry, kind, type_, json_)


@app.command()
def schema(
    folder: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Write one file per kind of table there instead."),
    ] = None,
    plugin: PluginFiles = None,
) -> None:
    """Write the JSON Schema of mission files."""
    from hillsphere.mission.schema import mission_schema, split_schema

    registry = registry_of(files=plugin)
    whole = mission_schema(registry)
    if folder is None:
        write_json(whole)
    else:
        for path in _write_documents(folder, split_schema(whole)):
            write(str(path))
    for message in registry.contested.values():
        say(f"not in the schema: {message}")


def _write_documents(folder: Path, documents: Mapping[str, Any]) -> list[Path]:
    """Write JSON documents into a folder, which is made if needed; return their paths."""
    from hillsphere.base.atomic import write_text

    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, document in documents.items():
            write_text(folder / name, json.dumps(document, indent=2, ensure_ascii=False) + "\n")
    except OSError as error:
        place = error.filename or folder
        raise InputError(f"{place}: cannot be written: {error.strerror or error}") from error
    return [folder / name for name in documents]


def _measured_times() -> tuple[str, dict[str, dict[str, float]]]:
    """Return what the times are of, and CPU seconds by mission and profile of this version.

    The list holds runs of an earlier version too, and runs without figures.
    """
    from hillsphere.base.json_files import read_json
    from hillsphere.base.paths import missions_directory

    times = read_json(missions_directory() / TIMES, _MOST_BYTES)
    cpu_s: dict[str, dict[str, float]] = {}
    for run in times["runs"]:
        if run["version"] == "now" and run["figures"]:
            cpu_s.setdefault(run["mission"], {})[run["profile"]] = run["cpu_s"]
    return str(times["machine"]), cpu_s


def _runs(name: str, measured: dict[str, float]) -> dict[str, float | None]:
    """Return CPU seconds by profile, ``""`` for the whole mission first; None if not measured."""
    from hillsphere.base.paths import missions_directory
    from hillsphere.base.problems import MissionError
    from hillsphere.mission.toml_source import read_toml

    try:
        tables, _, _ = read_toml(missions_directory() / f"{name}.toml", name)
    except MissionError:  # its title says what is wrong
        return {"": None}
    profiles = tables.get("profile")
    names = list(profiles) if isinstance(profiles, dict) else []
    return {profile: measured.get(profile) for profile in ("", *names)}


def _duration(seconds: float | None) -> str:
    """Write a duration to the accuracy at which it can be foretold: ``"1 min 40 s"``."""
    if seconds is None:
        return _UNKNOWN
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min"
