"""``hillsphere new``: a mission or a plugin to begin with."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from hillsphere.base.errors import InputError
from hillsphere.cli.application import app, registry_of
from hillsphere.cli.completion import complete_mission, complete_template
from hillsphere.cli.output import write

__all__: list[str] = []

new = typer.Typer(rich_markup_mode=None, help="Begin a mission or a plugin of your own.")
app.add_typer(new, name="new")

Folder = Annotated[
    Path, typer.Option(metavar="DIR", help="Where it is made; by default the present folder.")
]


@new.command()
def mission(
    name: Annotated[str, typer.Argument(metavar="NAME", help="Name of the new mission.")],
    like: Annotated[
        str,
        typer.Option(
            metavar="MISSION",
            help="The packaged mission that is copied.",
            autocompletion=complete_mission,
        ),
    ],
    folder: Folder = Path(),
) -> None:
    """Copy a packaged mission, without the claims of its paper, to be changed."""
    from hillsphere.base.paths import missions_directory
    from hillsphere.base.problems import did_you_mean
    from hillsphere.cli.mission_copy import copy_mission
    from hillsphere.mission.tables import MISSION_NAME
    from hillsphere.mission.toml_source import read_toml

    if not re.fullmatch(MISSION_NAME, name):
        raise InputError(
            f"{name[:64]!r} cannot name a mission: use at most 64 letters, digits, '.', '_' and "
            "'-', beginning with a letter or digit"
        )
    packaged = sorted(path.stem for path in missions_directory().glob("*.toml"))
    if like not in packaged:
        hint = did_you_mean(like, packaged, otherwise="packaged missions")
        raise InputError(f"no packaged mission {like[:64]!r}{hint}")
    _, _, text = read_toml(missions_directory() / f"{like}.toml", like)
    copied = copy_mission(text, name, like)
    path = folder / f"{name}.toml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write_new(path, copied)
    except OSError as error:
        raise _unwritable(path, error) from error
    write(f"{path}\nhillsphere run {_as_argument(path)}")


@new.command()
def plugin(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Name of the package, such as limb-ranger.")
    ],
    kind: Annotated[
        str,
        typer.Option(
            metavar="KIND", help="Kind of its component.", autocompletion=complete_template
        ),
    ],
    folder: Folder = Path(),
) -> None:
    """Make a plugin package with one component, its tests and what is needed to install it."""
    from hillsphere.cli.plugin_template import plugin_files

    made = plugin_files(name, kind, registry_of(strict=False))
    place = folder / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write_folder(place, made)
    except OSError as error:
        raise _unwritable(place, error) from error
    for path in sorted(made):
        write(str(place / path))
    write(f"pip install -e {_as_argument(place)}")


def _write_new(path: Path, text: str) -> None:
    """Write a file that must not exist yet, whole or not at all."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with part.open("x", encoding="utf-8") as file:
            file.write(text)
        os.link(part, path)  # unlike a rename, refuses an existing name
    finally:
        part.unlink(missing_ok=True)


def _write_folder(place: Path, texts: Mapping[str, str]) -> None:
    """Write files into a folder that must not exist yet, whole or not at all."""
    if os.path.lexists(place):
        raise FileExistsError(0, "exists already", str(place))
    part = place.with_name(f".{place.name}.{os.getpid()}.part")
    try:
        for name, text in texts.items():
            path = part / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        part.rename(place)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _unwritable(path: Path, error: OSError) -> InputError:
    if isinstance(error, FileExistsError) and os.path.lexists(path):
        return InputError(f"{str(path)!r} exists already; give another name or folder")
    return InputError(f"{str(path)!r} cannot be written: {error.strerror or error}")


def _as_argument(path: Path) -> str:
    """Return a path as a word of a shell's line, with a separator, by which it is known as one."""
    from shlex import quote

    text = str(path)
    return quote(text if os.sep in text else os.path.join(os.curdir, text))
