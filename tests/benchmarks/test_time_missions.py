"""The list of mission times: what is measured, what is measured again, and what the page shows."""

from __future__ import annotations

import importlib
import json
import sys
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
FAKE = f"""#!{sys.executable}
import os, pathlib, sys
from time import process_time
child = os.fork()
end = process_time() + 0.2
while process_time() < end:
    sum(range(100))
if not child:
    os._exit(0)
os.waitpid(child, 0)
pathlib.Path(__file__).with_name("words").write_text("\\n".join(sys.argv[1:]))
sys.exit({{code}})
"""
"""A command that computes for 0.2 s in each of two processes and writes down its words."""


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> ModuleType:
    """Return the script, with a list and a page of the test's own."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    module = importlib.import_module("time_missions")
    (tmp_path / "times.json").write_text('{"machine": "M", "runs": [], "stages": []}', "utf-8")
    monkeypatch.setattr(module, "TIMES", tmp_path / "times.json")
    return module


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a checkout whose mission has two stages."""
    (tmp_path / "missions").mkdir()
    text = '[stage.a]\ntype = "t"\n[stage."b{x}"]\ntype = "t"\n'
    (tmp_path / "missions" / "toy.toml").write_text(text, "utf-8")
    return install(tmp_path, 4)


def install(tree: Path, code: int) -> Path:
    """Put a command into a checkout that ends with a code."""
    command = tree / ".venv" / "bin" / "hillsphere"
    command.parent.mkdir(parents=True, exist_ok=True)
    command.write_text(FAKE.format(code=code), "utf-8")
    command.chmod(0o755)
    return tree


def test_cpu_time_is_that_of_all_processes(script: ModuleType, tree: Path) -> None:
    got = script.measure(tree, "toy", "fast", figures=False, limit_s=60.0)
    assert 0.4 <= got["cpu_s"] < 1.5  # with the start of the interpreter
    assert got["wall_s"] > 0.0
    words = (tree / ".venv/bin/words").read_text("utf-8").split("\n")
    assert words[:2] == ["run", "toy"]
    assert words[words.index("--profile") + 1] == "fast"
    assert words[words.index("--workers") + 1] == "2"
    sets = [b for a, b in pairwise(words) if a == "--set"]
    assert sets == ["stage.a.figures=false", 'stage."b{x}".figures=false']


def test_a_run_that_fails_has_no_time(script: ModuleType, tree: Path) -> None:
    with pytest.raises(SystemExit, match="toy fast ended with 1"):
        script.measure(install(tree, 1), "toy", "fast", figures=True, limit_s=60.0)


def measured(script: ModuleType, monkeypatch: pytest.MonkeyPatch, *words: str) -> list[Any]:
    """Run the script with measurements that take 7 s; return what it measured."""
    calls: list[Any] = []

    def measure(*what: Any, **how: Any) -> dict[str, float]:
        calls.append((*what[1:], how["figures"]))
        return {"cpu_s": 7.0, "wall_s": 5.0, "memory_mb": 1.0, "others": 0.0}

    page = script.TIMES.with_name("cost.md")
    parts = (f"<!-- begin of {p} -->\n<!-- end of {p} -->\n" for p in ("missions", "stages"))
    page.write_text("text\n".join(parts), "utf-8")
    monkeypatch.setattr(script, "measure", measure)
    monkeypatch.setattr(script, "PAGE", page)
    monkeypatch.setattr(sys, "argv", ["time_missions.py", *words])
    script.main()
    return calls


def test_what_is_known_is_not_measured_again(
    script: ModuleType, tree: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ("toy", "--run", "whole", "--before", str(tree), "--commit")
    both = [("toy", "", True), ("toy", "", True), ("toy", "", False)]  # the first one compiles
    assert measured(script, monkeypatch, *words, "c1") == both
    assert measured(script, monkeypatch, *words, "c1") == []
    assert measured(script, monkeypatch, *words, "c2") == both
    rows = script.read_times()["runs"]
    assert [(row["commit"], row["figures"]) for row in rows] == [("c2", True), ("c2", False)]
    page = script.PAGE.read_text("utf-8")
    assert "| toy, whole | 7.0 | 7.0 | – | – | – | 5.0 | – |" in page
    assert "Before: c2 (" in page
    assert "Now: not measured." in page


def test_a_wall_time_beside_other_work_is_not_shown(script: ModuleType) -> None:
    row = {"mission": "m", "profile": "", "version": "now", "figures": True, "commit": "c",
           "date": "d", "cpu_s": 10.0, "wall_s": 6.0}  # fmt: skip
    for others, shown in ((0.05, "6.0"), (0.4, "–")):
        table = script.mission_table({"runs": [row | {"others": others}]})
        assert table.splitlines()[-1] == f"| m, whole | – | – | 10.0 | – | – | – | {shown} |"


def test_the_page_says_what_the_list_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    script = importlib.import_module("time_missions")
    text = (ROOT / "docs" / "theory" / "cost.md").read_text("utf-8")
    times = json.loads((ROOT / "missions" / "times.json").read_text("utf-8"))
    assert script.filled(text, times) == text, "run benchmarks/time_missions.py --page"
