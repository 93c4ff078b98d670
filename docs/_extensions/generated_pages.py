"""Writing of generated source pages: unchanged ones keep their times, others go."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

__all__ = ["escape", "escape_bars", "heading", "with_code", "write_pages"]


def escape(text: str) -> str:
    """Return plain text as reStructuredText."""
    return re.sub(r"([\\*`|_])", r"\\\1", text)


def with_code(text: str) -> str:
    """Return text of a docstring, in which a name between single backticks is code."""
    return re.sub(r"(?<![`:\w])`([^`\n]+)`(?!`)", r"``\1``", text)


def escape_bars(lines: Sequence[str]) -> list[str]:
    """Return a docstring in which ``|x|`` is an absolute value and no substitution.

    Formulas, code between backticks and literal blocks stay as they are.
    """
    escaped, block = [], -1
    for line in lines:
        indent = len(line) - len(line.lstrip())
        if block >= 0 and line.strip() and indent <= block:
            block = -1
        if block < 0:
            parts = re.split(r"(``[^`]*``|`[^`]*`)", line)
            parts[::2] = [re.sub(r"(?<!\\)\|", r"\\|", part) for part in parts[::2]]
            escaped.append("".join(parts))
            block = indent if line.rstrip().endswith("::") else -1
        else:
            escaped.append(line)
    return escaped


def heading(text: str, underline: str) -> list[str]:
    """Return the lines of a heading."""
    return [text, underline * max(len(text), 3), ""]


def write_pages(directory: Path, pages: Mapping[str, Sequence[str]]) -> None:
    """Write ``directory/NAME.rst`` for each page, and remove pages that are no longer made.

    Parameters
    ----------
    directory : Path
        Its ``.rst`` files are all generated.
    pages : mapping of str to sequence of str
        Path below the directory, without suffix → lines.
    """
    for old in directory.rglob("*.rst"):
        if old.relative_to(directory).with_suffix("").as_posix() not in pages:
            old.unlink()
    for name, lines in pages.items():
        path = directory / f"{name}.rst"
        text = "\n".join(lines).rstrip() + "\n"
        if not path.is_file() or path.read_text("utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, "utf-8")
