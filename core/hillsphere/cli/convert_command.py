"""``hillsphere convert``: a file in another format for the same content."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hillsphere.base.atomic import write_text
from hillsphere.base.errors import InputError
from hillsphere.base.problems import did_you_mean
from hillsphere.base.regular_files import open_regular
from hillsphere.cli.application import PluginFiles, registry_of
from hillsphere.cli.output import write, write_json

if TYPE_CHECKING:
    from hillsphere.interfaces.file_formats import FileFormat

__all__ = ["app"]

app = typer.Typer(add_completion=False, rich_markup_mode=None)

_BEGINNING_BYTES = 1 << 16
"""Part of a file by which its format is told. Free text before the head of an ICGEM file, the
longest beginning of all formats, takes some 10 kB."""


@app.command()
def convert(
    source: Annotated[Path, typer.Argument(metavar="IN", help="The file that is read.")],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="The file that is written.")],
    from_: Annotated[
        str | None,
        typer.Option("--from", metavar="FORMAT", help="Format of IN; by default told from it."),
    ] = None,
    to: Annotated[
        str | None,
        typer.Option(metavar="FORMAT", help="Format of OUT; by default told from its suffix."),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace OUT if it exists.")] = False,
    plugin: PluginFiles = None,
    json: Annotated[bool, typer.Option("--json", help="Write JSON to stdout.")] = False,
) -> None:
    """Write a file in another format for the same content, and say what that format cannot hold.

    Formats are listed by: hillsphere describe format.
    """
    registry = registry_of(files=plugin)
    formats: dict[str, FileFormat] = {
        record.component.type: record.load_target()(record.load_spec()())
        for record in registry.of_kind("format")
    }
    read_as = _format_of_input(source, from_, formats)
    written_as = _format_of_output(target, to, formats, formats[read_as].content)
    old, new = formats[read_as], formats[written_as]
    if old.content != new.content:
        raise InputError(
            f"{source}: a {old.content} ({read_as}) cannot become a {new.content} ({written_as})"
        )
    if read_as == written_as:
        raise InputError(f"{source}: is in the format {read_as} already")
    if not force and os.path.lexists(target):
        raise InputError(f"{target}: exists already; give another name, or --force to replace it")
    text, lost = new.write(old.read(source))
    try:
        write_text(target, text, follow_links=True)
    except OSError as error:
        raise InputError(f"{target}: cannot be written: {error.strerror or error}") from error
    if json:
        write_json(
            {
                "file": str(target), "content": new.content, "from": read_as, "to": written_as,
                "not_kept": list(lost),
            }
        )  # fmt: skip
        return
    write(f"{target}: {new.content}, {read_as} -> {written_as}")
    for line in lost:
        write(f"  not kept: {line}")


def _format_of_input(path: Path, given: str | None, formats: Mapping[str, FileFormat]) -> str:
    """Return the format of an existing file: as given, else by its first lines, else its suffix."""
    try:
        with open_regular(path) as stream:
            beginning = stream.read(_BEGINNING_BYTES).decode("latin-1")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if given is not None:
        return _check_name(given, formats)
    by_content = [name for name, one in formats.items() if one.recognises(beginning)]
    return _one(path, by_content or _by_suffix(path, formats), formats, "--from")


def _format_of_output(
    path: Path, given: str | None, formats: Mapping[str, FileFormat], content: str
) -> str:
    """Return the format of a new file: as given, else by its suffix, of the same content first."""
    if given is not None:
        return _check_name(given, formats)
    names = _by_suffix(path, formats)
    same = [name for name in names if formats[name].content == content]
    return _one(path, same or names, formats, "--to")


def _by_suffix(path: Path, formats: Mapping[str, FileFormat]) -> list[str]:
    return [name for name, one in formats.items() if path.suffix.lower() in one.suffixes]


def _check_name(name: str, formats: Mapping[str, Any]) -> str:
    if name not in formats:
        hint = did_you_mean(name, formats, otherwise="formats")
        raise InputError(f"no file format {name[:60]!r}{hint}")
    return name


def _one(path: Path, names: list[str], formats: Mapping[str, FileFormat], option: str) -> str:
    if len(names) == 1:
        return names[0]
    listed = ", ".join(names or formats)
    what = "it may be one of several" if names else "it is none of the known"
    raise InputError(f"{path}: {what} formats; choose with {option}: {listed}")
