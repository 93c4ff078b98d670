"""The page of file formats lists the sample files that are there, and no others."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
BY_HAND, _, TEXT = (ROOT / "docs" / "formats.md").read_text("utf-8").partition("## Sample files\n")
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


def test_the_table_fits_a_narrow_page() -> None:
    """A page of 390 px leaves 13 letters for the first of two columns and 21 for the second."""
    rows = [row.strip("| ").split(" | ") for row in BY_HAND.splitlines() if row.startswith("|")]
    assert len(rows) >= 20
    for row in rows[2:]:
        assert len(row) == 2, row
        for cell, width in zip(row, (13, 21), strict=True):
            words = re.split(r"<br>|[ `]+", cell)
            assert max(map(len, words)) <= width, row
