"""The files of a run directory: what JSON and CSV make of numbers, and that none is ever torn."""

from __future__ import annotations

import csv
import errno
import json
import math
import os
from datetime import UTC, datetime
from hashlib import sha256
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from hillsphere.errors import InputError, StageError
from hillsphere.presentation import Column, Printed, Table
from hillsphere.runs.run_comparison import compare_runs
from hillsphere.runs.run_summary import RunSummary
from hillsphere.runs.store import RunDirectory, csv_text, plain_json

NOW = datetime(2026, 11, 21, 3, 4, 5, tzinfo=UTC)


def directory(tmp_path: Path) -> RunDirectory:
    return RunDirectory.create(tmp_path / "run", "small", NOW)


@pytest.mark.parametrize(
    ("value", "plain"),
    [
        (math.nan, None),
        (np.float64("inf"), "inf"),
        (-math.inf, "-inf"),
        (np.float32(0.5), 0.5),
        (np.int64(3), 3),
        (np.bool_(True), True),
        (Printed("7.10"), 7.1),
        (np.array([[1.0, np.nan]]), [[1.0, None]]),
        ((1, "a", None), [1, "a", None]),
        ({1: NOW}, {"1": "2026-11-21T03:04:05+00:00"}),
        (np.str_("Φ"), "Φ"),
    ],
)
def test_json_knows_every_number(value: Any, plain: Any) -> None:
    found = plain_json(value)
    assert found == plain
    assert type(found) is type(plain)
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize("value", [object(), {1, 2}, 1j, Path("x")])
def test_json_refuses_what_it_has_no_word_for(value: Any) -> None:
    with pytest.raises(InputError, match=f"a {type(value).__name__} cannot stand in a JSON file"):
        plain_json({"a": [value]})


def test_csv_holds_every_digit_and_reads_back() -> None:
    values = [0.1 + 0.2, np.float64(1 / 3), -0.0, 1e-300, math.nan, None, 7]
    rows = [{"name": f'a,"{i}"\n', "x": value} for i, value in enumerate(values)]
    rows[0]["x_paper"] = Printed("0.30")
    columns = [Column("name", ""), Column("x"), Column("x_paper")]
    text = csv_text(Table("T", columns, rows))
    head, *lines = csv.reader(text.splitlines(keepends=True))
    assert head == ["name", "x", "x_paper"]
    assert lines[0] == ['a,"0"\n', "0.30000000000000004", "0.30"]
    assert [line[1] for line in lines[1:]] == [
        repr(1 / 3), "-0.0", "1e-300", "nan", "", "7",
    ]  # fmt: skip


def test_files_stand_where_they_belong(tmp_path: Path) -> None:
    run = directory(tmp_path)
    run.put_json("summary.json", {"Φ": math.nan})
    run.put_table("t", Table("T", [Column("a")], [{"a": 1}]))
    run.put_svg("f", b"<svg/>")
    run.put_png("f", b"png", folder="cases")
    run.put_text("report.html", "lone surrogate: \udcff")
    run.log("one\n")
    run.log("two \udcff")
    found = {p.relative_to(run.path).as_posix(): p.read_text() for p in run.path.rglob("*.*")}
    assert found == {
        "summary.json": '{\n  "Φ": null\n}\n',
        "tables/t.csv": "a\n1\n",
        "figures/f.svg": "<svg/>",
        "cases/f.png": "png",
        "report.html": "lone surrogate: \\udcff",
        "log.txt": "one\ntwo \\udcff\n",
    }


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_full_disk_keeps_the_old_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    run = directory(tmp_path)
    run.put_json("manifest.json", {"state": "running"})

    def full(*_: Any) -> NoReturn:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, call, full)
        with pytest.raises(StageError, match=r"manifest\.json cannot be written.*No space.*--out"):
            run.put_json("manifest.json", {"state": "finished"})
    assert json.loads((run.path / "manifest.json").read_text()) == {"state": "running"}
    assert {p.name for p in run.path.iterdir()} == {"manifest.json", "log.txt"}


def test_log_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    run = directory(tmp_path)
    (run.path / "log.txt").unlink()
    (run.path / "log.txt").mkdir()
    with pytest.raises(StageError, match=r"log\.txt cannot be written"):
        run.log("line")


def test_a_workspace_goes_without_those_of_others(tmp_path: Path) -> None:
    run = directory(tmp_path)
    for stage in ("one", "two"):
        (run.workspace(stage) / "kept.txt").touch()
    assert run.workspace("one") == run.path / "work" / "one"
    run.clear_workspace("one")
    assert [p.name for p in (run.path / "work").iterdir()] == ["two"]
    run.clear_workspace("one")
    run.clear_workspace("two")
    assert not (run.path / "work").exists()


def test_a_lock_is_held_once_and_released(tmp_path: Path) -> None:
    run = directory(tmp_path)
    with run.locked():
        with pytest.raises(InputError, match="still going on in another process"), run.locked():
            pass
        run.log("written nevertheless")
    with run.locked():
        assert (run.path / "log.txt").read_text() == "written nevertheless\n"


def test_a_file_system_without_locks_is_none_of_our_business(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: Any) -> NoReturn:
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr("fcntl.flock", none)
    with directory(tmp_path).locked():
        pass


def test_a_directory_that_cannot_be_written_to_cannot_be_locked(tmp_path: Path) -> None:
    run = directory(tmp_path)
    (run.path / "log.txt").unlink()
    (run.path / "log.txt").mkdir()
    with pytest.raises(InputError, match=r"run directory .* cannot be used"), run.locked():
        pass


def test_the_digest_of_a_product_is_that_of_its_file(tmp_path: Path) -> None:
    from hillsphere.products import CaseList

    run = directory(tmp_path)
    digest = run.put_product("cases/a", CaseList(("a",), ("m",), np.zeros((1, 2)), ("b", "c")))
    assert digest == sha256((run.path / "cases" / "a.npz").read_bytes()).hexdigest()


def run_with(**metrics: float) -> RunSummary:
    manifest: dict[str, Any] = {"mission": {}, "versions": {}, "platform": {}, "stages": {}}
    shown = {name: {"value": value, "unit": "dB"} for name, value in metrics.items()}
    return RunSummary(Path("run"), manifest, plain_json({"metrics": shown, "tables": {}}))


def test_not_a_number_and_infinity_differ_in_a_comparison() -> None:
    runs = [run_with(margin=value) for value in (math.nan, math.inf, -math.inf, 1.0)]
    equal = [[not compare_runs(a, b).results for b in runs] for a in runs]
    assert equal == np.eye(4, dtype=bool).tolist()


def test_what_one_run_lacks_is_compared_too() -> None:
    found = compare_runs(run_with(a=1.0, b=1.0), run_with(a=1.0, c=1.0, d=1.0))
    assert (len(found.results), found.compared) == (3, 4)
