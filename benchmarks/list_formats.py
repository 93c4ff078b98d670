"""Write the second part of ``docs/formats.md``: the sample files of the tests, by format.

What stands above the heading "Sample files" is written by hand and kept. Run
``python benchmarks/list_formats.py`` after a sample file is added, renamed or removed.
"""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "formats.md"
DIRECTORIES = {
    "OPM": "tests/data/opm", "OEM": "tests/plugins/orbits/data/oem", "OCM": "tests/data/ocm",
    "Combined messages (ndm)": "tests/data/ndm", "TDM": "tests/data/tdm",
    "Gravity fields": "tests/data/gravity", "Shapes": "tests/data/shapes",
}  # fmt: skip
"""Directory of the samples under each heading."""
HEADING = "## Sample files\n"
_LEGEND = """
Words below a refused file are those of its message that the tests demand, with the line (0: the
end of the file). Where no words are given, the name of the file tells its content.
"""


def samples(directory: str) -> list[Path]:
    """Return the sample files below a directory, without the list of messages."""
    return sorted(
        p for p in (ROOT / directory).rglob("*") if p.is_file() and p.name != "broken.txt"
    )


def messages(directory: str) -> dict[str, str]:
    """Return the line and words of the message for each refused file that has an entry."""
    path = ROOT / directory / "broken.txt"
    rows = path.read_text("utf-8").splitlines()[1:] if path.is_file() else []
    parts = [row.split(" | ", 2) for row in rows if row.count(" | ") >= 2]
    return {name: f"line {line}: `` {words} ``" for name, line, words in parts}


def section(title: str, directory: str) -> str:
    """Return the list of one format."""
    words, lines = messages(directory), []
    for path in samples(directory):
        name = path.relative_to(ROOT / directory).as_posix()
        lines.append(f"- `{name}`")
        if path.parent.name == "broken" and path.name in words:
            lines.append(f"  {words[path.name]}")
    return "\n".join([f"\n### {title}\n", f"In `{directory}`:\n", *lines, ""])


def generated() -> str:
    """Return all that stands from the heading "Sample files" on."""
    parts = [section(title, directory) for title, directory in DIRECTORIES.items()]
    return HEADING + _LEGEND + "".join(parts)


if __name__ == "__main__":
    by_hand = PAGE.read_text("utf-8").partition(HEADING)[0]
    PAGE.write_text(by_hand + generated(), "utf-8")
