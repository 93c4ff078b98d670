"""Completion of names on the command line: missions, profiles, kinds, types, stages of a run.

Nothing numerical is imported. A callback never fails: while a line is typed, there is no place for
a message, so that a fault of a mission or a plugin only leaves names out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any

import typer

__all__ = [
    "complete_kind", "complete_mission", "complete_profile", "complete_setting", "complete_stage",
    "complete_template", "complete_type",
]  # fmt: skip

_Names = Callable[[typer.Context, str], Iterable[str]]


def _completing(names: _Names) -> Callable[[typer.Context, str], list[str]]:
    """Return a callback that offers the names that begin with what is typed."""

    @wraps(names)
    def complete(ctx: typer.Context, incomplete: str) -> list[str]:
        try:
            return [name for name in names(ctx, incomplete) if name.startswith(incomplete)]
        except (Exception, SystemExit):  # a plugin's module may do anything
            return []

    return complete


@_completing
def complete_mission(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Offer the packaged missions; the shell completes paths itself."""
    from hillsphere.base.paths import missions_directory

    return sorted(path.stem for path in missions_directory().glob("*.toml"))


@_completing
def complete_profile(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Offer the profiles of the missions that stand on the command line."""
    return [name for tables in _missions(ctx) for name in tables.get("profile", {})]


@_completing
def complete_setting(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Offer ``kind.table.key=`` for the keys that the missions on the command line write."""
    from hillsphere.mission.tables import MISSION_KINDS

    return [
        f"{kind}.{name}.{key}="
        for tables in _missions(ctx)
        for kind in MISSION_KINDS
        for name, table in tables.get(kind, {}).items()
        for key in table
    ]


@_completing
def complete_kind(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Offer the kinds of components."""
    from hillsphere.plugins.registry import KINDS

    return KINDS


@_completing
def complete_template(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Offer the kinds of components for which there is a template of a plugin."""
    from hillsphere.cli.plugin_template import TEMPLATES

    return TEMPLATES


@_completing
def complete_type(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Offer the installed types of the kind that stands on the command line."""
    from hillsphere.plugins.registry import default_registry

    kind = ctx.params.get("kind") or ""
    return [record.component.type for record in default_registry().of_kind(str(kind))]


@_completing
def complete_stage(ctx: typer.Context, incomplete: str) -> Iterable[str]:
    """Offer the stages of the run that stands on the command line."""
    from hillsphere.base.errors import InputError
    from hillsphere.runs.run_manifest import read_manifest

    stages: list[str] = []
    for word in _words(ctx, "run"):
        with suppress(InputError, OSError):  # a word of another meaning
            stages += read_manifest(Path(word))["stages"]
    return stages


def _words(ctx: typer.Context, *parameters: str) -> Iterator[str]:
    """Yield the values of arguments that stand on the command line."""
    for parameter in parameters:
        given = ctx.params.get(parameter) or ()
        yield from [str(given)] if isinstance(given, str | Path) else map(str, given)
    # An option at the end of the line, whose value is being completed, leaves the line unparsed.
    yield from ctx.args


def _missions(ctx: typer.Context) -> Iterator[dict[str, Any]]:
    """Yield the tables of the missions that stand on the command line."""
    from hillsphere.base.paths import missions_directory
    from hillsphere.base.problems import MissionError
    from hillsphere.mission.toml_source import read_toml

    for word in _words(ctx, "mission", "missions"):
        packaged = missions_directory() / f"{word}.toml"
        is_packaged = "/" not in word and packaged.is_file()
        with suppress(MissionError):  # a word of another meaning
            yield read_toml(packaged if is_packaged else Path(word), word)[0]
