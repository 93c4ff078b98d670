"""The record of whole runs, which ``hillsphere papers`` shows, is of the missions as they are."""

from __future__ import annotations

import importlib
import json
import re
from pathlib import Path
from typing import Any

import pytest

from hillsphere.base.paths import missions_directory
from hillsphere.cli.endings import run as command
from hillsphere.mission import load_mission

ROOT = Path(__file__).parents[2]
RECORD: dict[str, Any] = json.loads((missions_directory() / "record.json").read_text("utf-8"))


@pytest.mark.parametrize("name", RECORD)
def test_recorded_claims_are_those_of_the_mission(name: str) -> None:
    specs = load_mission(name).specs
    for key, kind in (("requirements", "requirement"), ("claims", "claim")):
        stated = {table: spec.text for table, spec in specs.get(kind, {}).items()}  # type: ignore[attr-defined]
        assert {row["name"]: row["text"] for row in RECORD[name][key]} == stated, (
            "run the whole mission again and record it: benchmarks/record_claims.py"
        )


def test_pages_say_what_the_record_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    pages = importlib.import_module("record_claims")
    assert (ROOT / "docs" / "papers.md").read_text("utf-8") == pages.papers_page(RECORD)
    assert pages.readme_table(RECORD) in (ROOT / "README.md").read_text("utf-8")


def test_the_discussion_says_what_the_record_says() -> None:
    text = (ROOT / "docs" / "results.md").read_text("utf-8")
    (equal,) = (row["got"] for row in RECORD["phobos-qso"]["claims"] if row["name"] == "table_1")
    counts = re.search(r"(\d+) of the (\d+) cells agree to the printed digit", text)
    assert counts is not None
    assert equal == f"{counts[1]} of {counts[2]} equal"


def test_papers_shows_the_record(capsys: pytest.CaptureFixture[str]) -> None:
    assert command(["papers", "phobos-qso"]) == 0
    shown = capsys.readouterr().out
    assert RECORD["phobos-qso"]["commit"] in shown
    assert "deviates" in shown
    assert command(["papers", "phobos"]) == 2
    assert "no recorded run of mission 'phobos'; did you mean" in capsys.readouterr().err
