"""``hillsphere messages``: what the CCSDS messages of a file hold."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hillsphere.base.errors import InputError
from hillsphere.cli.output import write_json, write_table
from hillsphere.cli.streams import say

if TYPE_CHECKING:
    from hillsphere.formats.ndm import NdmMessage

__all__ = ["app"]

app = typer.Typer(add_completion=False, rich_markup_mode=None)

_LARGEST_FILE = 200_000_000
"""Bytes of a file at most: an ephemeris of a year at a state a second takes 4 GB, and is split."""


@app.command()
def messages(
    source: Annotated[
        Path, typer.Argument(metavar="FILE", help="OPM, OEM, OCM, TDM, or an <ndm> of several.")
    ],
    lenient: Annotated[
        bool,
        typer.Option("--lenient", help="Harmless departures from the standard are warnings."),
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Write JSON to stdout.")] = False,
) -> None:
    """List the messages of a file, after checking them against the standard."""
    from hillsphere.base.regular_files import read_text
    from hillsphere.formats.ndm import read_ndm

    try:
        text = read_text(source, "utf-8-sig", _LARGEST_FILE)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InputError(f"{source}: cannot be read: {reason or error}") from error
    read = read_ndm(text, str(source), lenient=lenient)
    rows = [row for one in read for row in _rows(one)]
    if json:
        write_json({"messages": rows})
    else:
        write_table((tuple(row.values()) for row in rows), header=tuple(rows[0]) if rows else ())
    for one in read:
        for warning in one.warnings:
            say(warning)


def _rows(message: NdmMessage) -> Iterator[dict[str, str]]:
    """Yield what each part of a message holds."""
    content = message.content
    parts = content if isinstance(content, list) else [content]
    for part in parts:
        name, epoch, what = _describe(message.kind, part)
        yield {
            "line": message.place.rpartition(":")[2], "kind": message.kind.upper(), "object": name,
            "epoch": epoch, "content": what or message.reason,
        }  # fmt: skip


def _describe(kind: str, part: Any) -> tuple[str, str, str]:
    """Return object, epoch and content of a part of a message, in words."""
    if part is None:
        return "", "", ""
    import numpy as np

    (when,) = part.epoch.isot(np.zeros(1), 3)
    epoch = f"{when} {part.epoch.scale}"
    if kind == "opm":
        what = f"a state about {part.center_name} in {part.frame}"
        what += ", its covariance" if part.covariance is not None else ""
        return part.object_name, epoch, what + _count(len(part.manoeuvres), "manoeuvre")
    if kind == "oem":
        what = f"{part.t_s.size} states about {part.center_name} in {part.ref_frame}"
        return part.object_name, epoch, what + _count(len(part.covariances), "covariance")
    if kind == "ocm":
        counts = (
            (len(part.trajectories), "block of states"),
            (len(part.covariances), "block of covariances"),
            (len(part.manoeuvres), "block of manoeuvres"),
            (len(part.texts), "block kept as text"),
        )
        what = "".join(_count(number, word) for number, word in counts).removeprefix(", ")
        return part.metadata.get("OBJECT_NAME", ""), epoch, what or "metadata only"
    return " ".join(part.meta.participants), epoch, ", ".join(part.series)


def _count(number: int, word: str) -> str:
    """Return ``", 2 blocks of states"``, or nothing for none."""
    if not number:
        return ""
    head, _, tail = word.partition(" ")
    plural = head if number == 1 else head + "s"
    return f", {number} {plural}{' ' + tail if tail else ''}"
