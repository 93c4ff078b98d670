"""The page on estimation: its examples run and print what it shows."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

PAGE = (Path(__file__).parents[3] / "docs" / "estimation.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```python\n(.*?)```\n(?:\n```text\n(.*?)```\n)?", PAGE, re.DOTALL)
TABLE_NAMES = re.compile(r"^\| (.*?) \|", re.MULTILINE)


def test_examples_print_what_the_page_shows(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In order, in one session, as a reader would type them."""
    pytest.importorskip("filterpy")
    session = ModuleType("page")
    monkeypatch.setitem(sys.modules, "page", session)
    assert len(EXAMPLES) > 10
    with np.printoptions():  # the page sets its own
        for code, shown in EXAMPLES:
            exec(code, session.__dict__)
            assert capsys.readouterr().out == shown, code


def test_table_names_only_what_is_there() -> None:
    """Each name of the table's first column is used by some example."""
    used = "\n".join(code for code, _ in EXAMPLES)
    for cell in TABLE_NAMES.findall(PAGE):
        for name in re.findall(r"`([A-Za-z_]\w+)[^`]*`", cell):
            assert re.search(rf"\b{name}\b", used), name
