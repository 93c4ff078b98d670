"""The end of a run on the terminal: verdict, requirements, claims, and where the report is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hillsphere.cli.exit_codes import ExitCode
from hillsphere.cli.output import number, write, write_table
from hillsphere.interfaces.outcomes import CLAIM_STATES, FAILING_STATES, REQUIREMENT_STATES
from hillsphere.show.outcomes import format_margin

__all__ = ["exit_code", "show_verdict"]

_MOST_ROWS = 15
"""Most rows of requirements, claims or sentences: with headings the verdict then fits into the 25
lines of a terminal."""
_LONGEST_TEXT = 46
"""Longest text of a cell, in characters: five columns then fit into a wide terminal."""


def show_verdict(summary: Mapping[str, Any], report: Path, *, verbose: bool) -> None:
    """Write the verdict of a run to stdout.

    Parameters
    ----------
    summary : mapping
        Content of ``summary.json``.
    report : Path
        The report.
    verbose : bool
        Write all rows, with the sentences and metrics of the stages; otherwise at most 25 lines.
    """
    write(f"{summary['mission']}: {summary['verdict']['text']}")
    groups = [_rows(summary, "requirements"), _rows(summary, "claims")]
    room = sum(map(len, groups)) if verbose else _MOST_ROWS
    hidden: dict[str, int] = {}
    for what, rows in zip(("requirement", "claim"), groups, strict=True):
        if rows[:room]:
            write("")
            head = (what, "asked", "got", "margin", "")
            body = [_cells(row, verbose=verbose) for row in rows[:room]]
            write_table(_without_empty(body), [f"  {head[0]}", *_kept_heads(head[1:], body)])
        for row in rows[room:]:
            hidden[row["state"]] = hidden.get(row["state"], 0) + 1
        room = max(room - len(rows), 0)
    if hidden:
        counts = ", ".join(f"{count} {state}" for state, count in hidden.items())
        write(f"  and {sum(hidden.values())} more rows: {counts} (-v shows them)")
    notes = list(summary["verdict"].get("notes", ()))
    if verbose or not any(groups):
        _show_notes(notes, verbose=verbose)
    if verbose:
        write("")
        write_table(
            [name, number(m["value"]), "" if m["unit"] == "-" else m["unit"]]
            for name, m in summary["metrics"].items()
        )
    write("")
    write(f"report: {report}")


def exit_code(summary: Mapping[str, Any]) -> ExitCode:
    """Return the exit code of a run from its ``summary.json``."""
    state = summary["verdict"]["state"]
    if state != "success":
        return ExitCode.INTERRUPTED if state == "interrupted" else ExitCode.FAILED
    states = {row["state"] for row in summary.get("requirements", ())}
    return ExitCode.SUCCESS if states.isdisjoint(FAILING_STATES) else ExitCode.NOT_MET


def _rows(summary: Mapping[str, Any], key: str) -> list[Mapping[str, Any]]:
    states = REQUIREMENT_STATES if key == "requirements" else CLAIM_STATES
    return sorted(summary.get(key, ()), key=lambda row: states.index(row["state"]))


def _cells(row: Mapping[str, Any], *, verbose: bool) -> list[str]:
    state, reason = row["state"], row["reason"]
    told = f"{state}: {reason}" if reason and state != "confirmed" else state
    cells = [row["text"], row["asked"], row["got"], format_margin(row)]
    return [f"  {cells[0]}", *cells[1:], told] if verbose else [
        f"  {_shorten(cells[0])}", *map(_shorten, cells[1:]), told if row["state"] == "undecided"
        else _shorten(told, 2 * _LONGEST_TEXT),
    ]  # fmt: skip


def _shorten(text: str, longest: int = _LONGEST_TEXT) -> str:
    return text if len(text) <= longest else f"{text[: longest - 1].rstrip()}…"


def _kept_heads(heads: Sequence[str], body: Sequence[Sequence[str]]) -> Iterator[str]:
    for index, head in enumerate(heads, 1):
        if any(row[index] for row in body):
            yield head


def _without_empty(body: Sequence[Sequence[str]]) -> list[list[str]]:
    """Remove the columns that are empty in every row."""
    kept = [i for i in range(len(body[0])) if any(row[i] for row in body)]
    return [[row[i] for i in kept] for row in body]


def _show_notes(notes: Sequence[str], *, verbose: bool) -> None:
    shown = notes if verbose else notes[:_MOST_ROWS]
    for note in shown:
        write(f"  {note}" if verbose else f"  {_shorten(note, 3 * _LONGEST_TEXT)}")
    if len(notes) > len(shown):
        write(f"  and {len(notes) - len(shown)} more sentences (-v shows them)")
