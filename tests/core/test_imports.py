"""Listing, validating and describing stay light; the compile layer has one door."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from hillsphere.testing import HEAVY_MODULES

ROOT = Path(__file__).parents[2]
RUN = (
    "import sys\n"
    "from hillsphere.cli.endings import run\n"
    "code = run(sys.argv[1:])\n"
    f"print([name for name in {HEAVY_MODULES!r} if name in sys.modules], file=sys.stderr)\n"
    "sys.exit(code)\n"
)
MISSIONS = sorted(path.stem for path in (ROOT / "missions").glob("*.toml"))


@pytest.mark.parametrize(
    "arguments",
    [
        ["--help"],
        ["--version"],
        ["run", "--help"],
        ["resume", "--help"],
        ["rerun", "--help"],
        ["figures", "--help"],
        ["export", "--help"],
        ["plugins"],
        ["plugins", "--json"],
        ["missions"],
        ["schema"],
        ["describe", "stage", "closed_loop"],
    ],
    ids=" ".join,
)
def test_command_imports_nothing_numerical(arguments: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-c", RUN, *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines()[-1] == "[]"


def test_heyoka_is_imported_in_one_file() -> None:
    pattern = re.compile(r"^\s*(import|from)\s+heyoka\b", re.MULTILINE)
    files = [p for folder in ("core", "plugins", "examples") for p in (ROOT / folder).rglob("*.py")]
    importing = [p.relative_to(ROOT) for p in files if pattern.search(p.read_text("utf-8"))]
    assert importing == [Path("core/hillsphere/symbolic/_heyoka.py")]


def test_core_imports_no_plugin() -> None:
    names = [p.parent.name for p in (ROOT / "plugins").glob("*/*/__init__.py")]
    pattern = re.compile(rf"^\s*(import|from)\s+({'|'.join(names)})\b", re.MULTILINE)
    for path in (ROOT / "core").rglob("*.py"):
        assert not pattern.search(path.read_text("utf-8")), path
