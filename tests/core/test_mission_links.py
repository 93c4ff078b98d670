"""Circles, orders and input files of a mission, by graphs and folders whose answers are plain."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from hillsphere.mission.links import _circles, _resolve, topological

Edges = dict[tuple[str, str], dict[tuple[str, str], Any]]


def graph(*edges: str) -> Edges:
    """Return tables and what they refer to: "a>bc" is a that refers to b and c."""
    made: Edges = {}
    for edge in edges:
        name, _, others = edge.partition(">")
        made[("k", name)] = {("k", other): ("at", other) for other in others}
    return made


@pytest.mark.parametrize(
    ("edges", "circles"),
    [
        (("a>b", "b>c", "c>"), []),
        (("a>a",), ["aa"]),
        (("a>b", "b>a"), ["aba"]),
        (("a>b", "b>c", "c>b"), ["bcb"]),  # a leads in, and stands in none
        (("a>bc", "b>d", "c>d", "d>"), []),  # two ways to one table are no circle
        (("a>bc", "b>a", "c>a"), ["aba"]),  # no table in two of them
        (("a>b", "b>a", "c>d", "d>c"), ["aba", "cdc"]),
        (("a>x", "b>"), []),  # x stands nowhere: said elsewhere
        (("a>b", "b>c", "c>d", "d>a"), ["abcda"]),
        (("c>", "b>c", "a>bc", "d>abc"), []),
    ],
)
def test_circles(edges: tuple[str, ...], circles: list[str]) -> None:
    found = _circles(graph(*edges))
    assert ["".join(name for _, name in circle) for circle in found] == circles


def test_a_dense_graph_is_searched_once() -> None:
    """Of 300 tables that each refer to all after them: 45 000 references, not 2³⁰⁰ ways."""
    asked = 0

    class Counting(dict[tuple[str, str], Any]):
        def __iter__(self) -> Any:
            nonlocal asked
            asked += 1
            return super().__iter__()

    names = [("k", f"{i:03d}") for i in range(300)]
    edges = {
        name: Counting((other, ()) for other in names[i + 1 :]) for i, name in enumerate(names)
    }
    assert _circles(edges) == []
    assert asked == 300


class Pointer:
    """A Spec that refers to tables."""

    def __init__(self, others: str) -> None:
        self.others = others

    def references(self) -> list[tuple[tuple[str, ...], str, Any]]:
        return [(("at", name), "k", type("Ref", (), {"name": name})()) for name in self.others]


@pytest.mark.parametrize(
    ("begin", "edges", "order"),
    [
        ("a", ("a>bc", "b>c", "c>"), "cba"),
        ("ab", ("a>", "b>"), "ab"),
        ("ba", ("a>", "b>"), "ba"),
        ("abc", ("a>c", "b>", "c>"), "cab"),
        ("d", ("a>", "b>a", "c>a", "d>bc"), "abcd"),
        ("d", ("a>", "b>a", "c>a", "d>cb"), "acbd"),
        ("b", ("a>b", "b>"), "b"),  # only what is reached
    ],
)
def test_each_table_stands_after_those_it_refers_to(
    begin: str, edges: tuple[str, ...], order: str
) -> None:
    specs: Any = {"k": {edge[0]: Pointer(edge[2:]) for edge in edges}}
    found = topological([("k", name) for name in begin], specs)
    assert "".join(name for _, name in found) == order


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Make the mission's folder and that of packaged data, with some files."""
    mission, packaged = tmp_path / "mission", tmp_path / "packaged"
    for folder in (mission, packaged, mission / "sub"):
        folder.mkdir()
    for path in (mission / "own", mission / "both", packaged / "both", packaged / "theirs"):
        path.write_text("1")
    (tmp_path / "outside").write_text("1")
    (mission / "link").symlink_to(tmp_path / "outside")
    os.mkfifo(mission / "pipe")
    return mission, packaged


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("own", "mission/own"),
        ("sub/../own", "mission/own"),
        ("both", "mission/both"),  # beside the mission file first
        ("theirs", "packaged/theirs"),
        ("../packaged/theirs", "packaged/theirs"),  # from the packaged data it stays inside
    ],
)
def test_an_input_file_is_found(folders: tuple[Path, Path], path: str, expected: str) -> None:
    roots = [str(folder) for folder in folders]
    for allow_path in (False, True):
        found, message = _resolve(path, roots, allow_path=allow_path)
        assert message == ""
        assert Path(found) == folders[0].parent / expected


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("none", "no file 'none' beside the mission file or in the packaged data"),
        ("sub", "'sub' is a directory; an input file is needed"),
        ("pipe", "'pipe' is not a regular file; an input file is needed"),
        ("a\0b", "'a\\x00b' is not a path: it holds a null character"),
        ("../outside", "'../outside' leads out of the directories of the mission and of the "
                       "packaged data; allow it with --allow-path"),
        ("link", "'link' leads out of the directories of the mission and of the packaged data; "
                 "allow it with --allow-path"),
        ("x" * 100, f"no file '{'x' * 100}' beside the mission file or in the packaged data"),
        ("x" * 101, f"no file '{'x' * 100}…' beside the mission file or in the packaged data"),
    ],
)  # fmt: skip
def test_an_input_file_is_refused(folders: tuple[Path, Path], path: str, message: str) -> None:
    roots = [str(folder) for folder in folders]
    assert _resolve(path, roots, allow_path=False) == ("", message)


def test_paths_that_are_allowed(folders: tuple[Path, Path]) -> None:
    roots, outside = [str(folder) for folder in folders], folders[0].parent / "outside"
    for path in (str(outside), "../outside", "link"):
        assert _resolve(path, roots, allow_path=True) == (str(outside), "")
    found, message = _resolve(str(outside), roots, allow_path=False)
    assert (found, message) == (
        "", f"{str(outside)!r} is an absolute path; allow it with --allow-path"
    )  # fmt: skip
    found, message = _resolve("../none", roots, allow_path=True)
    assert (found, message) == (
        "", "no file '../none' beside the mission file or in the packaged data"
    )  # fmt: skip


def test_a_file_that_may_not_be_read(
    folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda path, mode: mode != os.R_OK)
    found = _resolve("own", [str(folder) for folder in folders], allow_path=False)
    assert found == ("", "'own' cannot be read: permission denied")
