"""``hillsphere convert``: a file in another format for the same content."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hillsphere.base.atomic import write_text
from hillsphere.base.errors import HillsphereError, InputError, PluginError
from hillsphere.base.problems import did_you_mean
from hillsphere.base.regular_files import open_regular
from hillsphere.cli.application import PluginFiles, registry_of
from hillsphere.cli.output import write, write_json
from hillsphere.cli.streams import say

if TYPE_CHECKING:
    from hillsphere.interfaces.file_formats import FileFormat
    from hillsphere.plugins.registry import Registered, Registry

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
    lenient: Annotated[
        bool,
        typer.Option("--lenient", help="Harmless departures from a CCSDS standard are warnings."),
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace OUT if it exists.")] = False,
    plugin: PluginFiles = None,
    json: Annotated[bool, typer.Option("--json", help="Write JSON to stdout.")] = False,
) -> None:
    """Write a file in another format for the same content, and say what that format cannot hold.

    Formats are listed by: hillsphere describe format.
    """
    if str(target) == "-":
        raise InputError("OUT must be a file; '-' for the standard output is not supported")
    formats = _Formats(registry_of(files=plugin), {from_, to} - {None}, lenient=lenient)
    read_as = _format_of_input(source, from_, formats)
    written_as = _format_of_output(target, to, formats, formats[read_as].content)
    old, new = formats[read_as], formats[written_as]
    if old.content != new.content:
        raise InputError(
            f"{source}: a {old.content} ({read_as}) cannot become a {new.content} ({written_as})"
        )
    if read_as == written_as:
        raise InputError(f"{source}: is in the format {read_as} already")
    if _is_same_file(source, target):
        raise InputError(
            f"{target}: is the file that is read, which is not replaced, not even by --force; give "
            "another name"
        )
    if not force and os.path.lexists(target):
        raise InputError(f"{target}: exists already; give another name, or --force to replace it")
    with formats.blaming(read_as, "reading"):
        content, passed_over = old.read(source)
    for warning in _warnings_of(content):
        say(warning)
    try:
        with formats.blaming(written_as, "writing"):
            text, unheld = new.write(content)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    lost = (*passed_over, *unheld)
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


class _Formats(Mapping[str, "FileFormat"]):
    """The formats of a registry by name, without those whose plugin is broken.

    Parameters
    ----------
    registry : Registry
        Where they come from.
    named : set of str
        Formats that the user named: of these a broken one is an error, of others a note.
    lenient : bool
        Whether the formats that can be read leniently are.
    """

    def __init__(
        self, registry: Registry, named: Collection[str | None], *, lenient: bool = False
    ) -> None:
        self._records: dict[str, Registered] = {}
        self._formats: dict[str, FileFormat] = {}
        for record in registry.of_kind("format"):
            name = record.component.type
            self._records[name] = record
            try:
                with self.blaming(name, "loading"):
                    spec = record.load_spec()
                    keys = {"lenient": True} if lenient and "lenient" in spec.model_fields else {}
                    self._formats[name] = record.load_target()(spec(**keys))
            except PluginError as error:
                if name in named:
                    raise
                say(f"note: left out: {error}")

    def __getitem__(self, name: str) -> FileFormat:
        return self._formats[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._formats)

    def __len__(self) -> int:
        return len(self._formats)

    @contextmanager
    def blaming(self, name: str, doing: str) -> Iterator[None]:
        """Turn unforeseen exceptions into errors of the plugin that brought a format."""
        try:
            yield
        except HillsphereError:
            raise
        except Exception as error:  # a plugin's format may do anything
            raise PluginError(
                f"plugin {self._records[name].plugin!r}: file format {name!r} failed in {doing}: "
                f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
            ) from error

    def recognising(self, beginning: str) -> list[str]:
        """Return the formats whose first lines these may be."""
        names = []
        for name, one in self._formats.items():
            try:
                with self.blaming(name, "looking at the beginning of a file"):
                    if one.recognises(beginning):
                        names.append(name)
            except PluginError as error:
                say(f"note: left out: {error}")
        return names


def _warnings_of(content: Any) -> list[str]:
    """Return the warnings of messages that were read leniently, each once."""
    parts = content if isinstance(content, list | tuple) else [content]
    return list(dict.fromkeys(text for one in parts for text in getattr(one, "warnings", ())))


def _is_same_file(source: Path, target: Path) -> bool:
    """Return whether both lead to one file, by whatever names or links."""
    try:
        return os.path.samefile(source, target)
    except OSError:  # there is no target yet
        return False


def _format_of_input(path: Path, given: str | None, formats: _Formats) -> str:
    """Return the format of an existing file: as given, else by its first lines, else its suffix."""
    try:
        with open_regular(path) as stream:
            beginning = stream.read(_BEGINNING_BYTES).decode("latin-1")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    if given is not None:
        return _check_name(given, formats)
    return _one(
        path, formats.recognising(beginning) or _by_suffix(path, formats), formats, "--from"
    )


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
