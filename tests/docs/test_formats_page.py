"""The page of file formats lists the sample files that are there, and no others."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "formats.md").read_text("utf-8").partition("## Sample files\n")[2]
DATA = (ROOT / "tests" / "data", ROOT / "tests" / "plugins" / "orbits" / "data")


def listed() -> list[str]:
    """Return the paths that the page lists, from the root."""
    paths, directory = [], ""
    for line in TEXT.splitlines():
        if match := re.fullmatch(r"In `(.+)`:", line):
            directory = match[1]
        elif match := re.fullmatch(r"- `(.+)`", line):
            paths.append(f"{directory}/{match[1]}")
    return sorted(paths)


def test_every_sample_file_is_listed_once() -> None:
    there = sorted(
        path.relative_to(ROOT).as_posix()
        for data in DATA
        for path in data.rglob("*")
        if path.is_file() and path.name != "broken.txt"
    )
    assert listed() == there
    assert len(there) >= 120
