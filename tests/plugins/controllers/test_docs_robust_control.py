"""The page on robust control: its examples run and print what it shows, its missions are run."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from hillsphere.mission import load_mission
from hillsphere.runs.pipeline import RunResult, run_mission

PAGE = (Path(__file__).parents[3] / "docs" / "robust-control.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```python\n(.*?)```\n(?:\n```text\n(.*?)```\n)?", PAGE, re.DOTALL)
MISSIONS = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
TABLE_NAMES = re.compile(r"^\| (.*?) \|", re.MULTILINE)


def test_examples_print_what_the_page_shows(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In order, in one session, as a reader would type them."""
    session = ModuleType("page")
    monkeypatch.setitem(sys.modules, "page", session)
    assert len(EXAMPLES) > 20
    with np.printoptions():  # the page sets its own
        for code, shown in EXAMPLES:
            exec(code, session.__dict__)
            assert capsys.readouterr().out == shown, code


def test_tables_name_only_what_is_there() -> None:
    """Each function of a table's first column is called by some example."""
    used = "\n".join(code for code, _ in EXAMPLES)
    for cell in TABLE_NAMES.findall(PAGE):
        for name in re.findall(r"`([A-Za-z_]\w+)[^`]*`", cell):
            assert re.search(rf"\b{name}\b", used), name


def run(tmp_path: Path, text: str) -> RunResult:
    """Run a mission of the page, without figures."""
    path = tmp_path / "mission.toml"
    path.write_text(re.sub(r"(\[stage\.\w+\]\n)", r"\1figures = false\n", text), encoding="utf-8")
    mission = load_mission(str(path), allow_path=True)
    return run_mission(mission, out=tmp_path / "run", use_cache=False)


def test_mission_of_the_stages(tmp_path: Path) -> None:
    result = run(tmp_path, MISSIONS[0])
    assert result.state == "success"
    analysis: Any = result.products["check"]
    assert all(found.upper >= found.lower for found in analysis.results)


def test_mission_that_flies_a_controller(tmp_path: Path) -> None:
    result = run(tmp_path, MISSIONS[1])
    assert result.state == "success"
    flight: Any = result.products["fly"]
    assert flight.position_error_m[0] > 100.0
    assert flight.position_error_m[-1] < 5.0


@pytest.mark.slow
@pytest.mark.parametrize("law", ["lqr", "lqg", "lyapunov"])
def test_other_laws_of_the_mission_hold_the_point(tmp_path: Path, law: str) -> None:
    text = MISSIONS[1].replace('law = "lti"', f'law = "{law}"')
    text = text.replace('needs = { controller = "design" }\n', "")
    text = text.replace('sees = ["x", "y", "z"]\n', "")
    flight: Any = run(tmp_path, text).products["fly"]
    assert flight.position_error_m[-1] < 1.0
