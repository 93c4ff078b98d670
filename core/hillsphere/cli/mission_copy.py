"""A copy of a packaged mission under a name of its own, to be changed: `hillsphere new mission`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from hillsphere.base.problems import Key
from hillsphere.cli.spec_description import toml_value
from hillsphere.mission.toml_source import parse_toml

__all__ = ["copy_mission"]

_SENTENCE = re.compile(r"(?<=[.?!])\s+")


def copy_mission(text: str, name: str, like: str) -> str:
    """Return the text of a mission with another name and title, and without its claims.

    Comments, layout and all other tables stay. Without the claims go what refers to them: sentences
    of the report, its numbers, and what profiles say about claims.

    Parameters
    ----------
    text : str
        The packaged mission.
    name : str
        Name of the copy.
    like : str
        Name of the packaged mission.

    Returns
    -------
    str
        The text of the copy.

    Raises
    ------
    MissionError
        If the text is not sound TOML.
    """
    tables, locations, text = parse_toml(text.encode("utf-8"), like)
    title = f"{tables['title']} (changed from {like})"
    outcomes, claims = tables.get("requirement", {}), tables.get("claim", {})
    lines = text.split("\n")
    copied = [f"# A copy of the packaged mission {like}, without its claims, to be changed."]
    end = 0  # last line that is copied or left out
    for statement in locations.scan.statements:
        before = lines[end : statement.line - 1]
        written = lines[statement.line - 1 : statement.end]
        end = statement.end
        if _is_about_claims(statement.key):
            continue  # with the comments before it
        value = _value_at(tables, statement.key)
        if statement.key == ("name",):
            written = _replace_value(written, "name", tables["name"], name)
        elif statement.key == ("title",):
            written = _replace_value(written, "title", tables["title"], title)
        elif statement.key == ("report", "numbers"):
            gone = [item for item in value if item in claims and item not in outcomes]
            written = _without_items(written, gone)
        elif statement.key[-1] == "drop" and isinstance(value, list):
            written = _without_items(written, [i for i in value if i.startswith("claim.")])
        elif statement.key[0] == "report" and isinstance(value, str) and "{claim." in value:
            written = _without_claims(written, str(statement.key[-1]), value)
        copied += [*before, *written]
    copied += lines[end:]
    return re.sub(r"\n{3,}", "\n\n", "\n".join(copied))


def _is_about_claims(key: Key) -> bool:
    return key[:1] == ("claim",) or (key[:1] == ("profile",) and key[2:3] == ("claim",))


def _value_at(tables: Any, key: Key) -> Any:
    """Return the value of a key; None for the header of an array of tables."""
    value = tables
    for part in key:
        try:
            value = value[part]
        except (KeyError, IndexError, TypeError):
            return None
    return value


def _replace_value(lines: list[str], key: str, old: str, new: str) -> list[str]:
    """Replace a string that stands on one line; a comment behind it stays in its column."""
    (line,) = lines
    before = f"{key} = {toml_value(old)}"
    comment = line[len(before) :] if line.startswith(before) else ""
    after = f"{key} = {toml_value(new)}"
    column = len(line) - len(comment.lstrip())
    return [f"{after}  ".ljust(column) + comment.lstrip() if comment.strip() else after]


def _without_items(lines: list[str], items: Iterable[str]) -> list[str]:
    """Remove strings from an array; the whole key if none is left."""
    text = "\n".join(lines)
    for item in items:
        text = re.sub(rf"{re.escape(toml_value(item))}(,[ \t]*)?", "", text)
    kept = [line.rstrip() for line in text.split("\n")]
    kept = [line for line, old in zip(kept, lines, strict=True) if line or not old.strip()]
    text = "\n".join(kept)
    if len(kept) == 1:
        text = re.sub(r",?[ \t]*\]", "]", text)
    return [] if re.fullmatch(r"[^\[]*=\s*\[\s*\]\s*(#.*)?", text) else text.split("\n")


def _without_claims(lines: list[str], key: str, value: str) -> list[str]:
    """Remove the sentences that show a claim; the whole key if none is left."""
    kept = " ".join(s for s in _SENTENCE.split(value) if "{claim." not in s)
    return [f"{key} = {toml_value(kept)}"] if kept else []
