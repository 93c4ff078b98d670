"""Exported campaigns are read back, by the standard library and SciPy, to the last bit."""

from __future__ import annotations

import csv
import errno
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.io import netcdf_file

from hillsphere.cases.case_classes import decided_failures, is_undecided
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.products import CaseTable
from hillsphere.products.products import Bands
from hillsphere_campaigns.export import export_bands_csv, export_csv, export_netcdf


def campaign(n: int, inputs: int = 3, metrics: int = 2) -> CaseTable:
    """Return n cases with awkward numbers and texts."""
    rng = np.random.default_rng(1)
    failed = np.arange(n) % 10 == 3
    values = rng.normal(size=(metrics, n)) * 10.0 ** rng.integers(-300, 300, size=(metrics, n))
    values[:, failed] = np.nan
    said = np.flatnonzero(failed)[:5]
    return CaseTable(
        stage="höver",
        design="random",
        planned=n + 7,
        stopped="failure ratio ±0.01",
        case=np.arange(n) * 2,
        draw=np.arange(n),
        point=np.zeros(n, dtype=np.int64),
        inputs=tuple(f"plant.gravity.C{i},0" for i in range(inputs)),
        input_units=("-",) * inputs,
        input_values=rng.normal(size=(inputs, n)),
        metrics=tuple(f"dv{j}" for j in range(metrics)),
        units=("m/s",) * metrics,
        values=values,
        status=np.where(failed, "error", "completed"),
        cause=np.where(failed, 'Größe, "x"', ""),
        failed=failed,
        message_case=said * 2,
        messages=tuple(f"ValueError: a, b\t“{k}”" for k in said),
    )


def sweep() -> CaseTable:
    table = campaign(60)
    return replace(
        table,
        point=np.repeat(np.arange(3), 20),
        swept=("stage.hover.period_s", "law"),
        swept_units=("s", ""),
        points=np.array([[0.1, 0.2, 0.3], [0.0, 1.0, 0.0]]),
        point_labels=("0.1, pid", "0.2, lqr", "0.3, pid"),
    )


def bands() -> Bands:
    rng = np.random.default_rng(2)
    values: Array = rng.normal(size=(3, 2, 7))
    values *= 10.0 ** rng.integers(-300, 300, size=(3, 2, 7))
    values[:, 1, -1] = np.nan
    count = rng.integers(1, 2000, size=(2, 7))
    levels = (0.05, 0.5, 0.9973)
    time_s = 60.1 * np.arange(7.0)
    return Bands(("x", "u.x, höher"), ("m", "-"), levels, time_s, values, count)


def rows_of(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(encoding="utf-8", newline="") as stream:
        header, *rows = csv.reader(stream)
    return header, rows


def column(rows: list[list[str]], place: int) -> Array:
    return np.array([float(row[place]) for row in rows])


@pytest.mark.parametrize("n", [0, 1, 5000])
def test_csv_gives_back_every_bit(tmp_path: Path, n: int) -> None:
    table = campaign(n)
    export_csv(table, tmp_path / "cases.csv")
    header, rows = rows_of(tmp_path / "cases.csv")
    assert header == [
        "case", "draw", "status", "cause", "class", "failed",
        "plant.gravity.C0,0", "plant.gravity.C1,0", "plant.gravity.C2,0",
        "dv0 [m/s]", "dv1 [m/s]", "message",
    ]  # fmt: skip
    assert len(rows) == n
    read = np.array([column(rows, 6 + i) for i in range(5)]).reshape(5, n)
    assert read[:3].tobytes() == table.input_values.tobytes()
    assert_array_equal(read[3:], table.values)
    assert [row[3] for row in rows] == table.cause.tolist()
    assert [int(row[0]) for row in rows] == table.case.tolist()
    assert [row[5] for row in rows] == [str(int(f)) for f in decided_failures(table)]
    assert [row[-1] for row in rows if row[-1]] == list(table.messages)


def test_csv_of_a_sweep(tmp_path: Path) -> None:
    table = replace(sweep(), metrics=("law", "status"))
    export_csv(table, tmp_path / "cases.csv")
    header, rows = rows_of(tmp_path / "cases.csv")
    assert header[6:10] == ["point", "point_label", "stage.hover.period_s [s]", "swept law"]
    assert header[-3:] == ["metric law [m/s]", "metric status [m/s]", "message"]
    assert len(set(header)) == len(header)
    assert table.points is not None
    assert_array_equal(column(rows, 8), table.points[0][table.point])
    assert rows[25][7] == "0.2, lqr"


def texts(variable: Any) -> list[str]:
    return [b"".join(row).rstrip(b"\0").decode() for row in variable[:].copy()]


@pytest.mark.parametrize("n", [1, 5000])
def test_netcdf_gives_back_every_bit(tmp_path: Path, n: int) -> None:
    table = campaign(n)
    export_netcdf(table, tmp_path / "cases.nc")
    with netcdf_file(tmp_path / "cases.nc", mmap=False) as file:
        assert file.version_byte == 2
        assert file.dimensions["case"] == n
        assert file.stage.decode() == "höver"
        assert file.stopped.decode() == "failure ratio ±0.01"
        assert file.planned == n + 7
        for kind, names, units, values in (
            ("input", ("plant_gravity_C0_0", "plant_gravity_C1_0", "plant_gravity_C2_0"), b"1",
             table.input_values),
            ("metric", ("dv0", "dv1"), b"m/s", table.values),
        ):  # fmt: skip
            for name, row in zip(names, values, strict=True):
                variable = file.variables[f"{kind}_{name}"]
                assert variable[:].astype(float).tobytes() == row.tobytes()
                assert variable.units == units
        assert file.variables["input_plant_gravity_C1_0"].long_name == b"plant.gravity.C1,0"
        assert_array_equal(file.variables["case"][:], table.case)
        assert_array_equal(file.variables["failed"][:], decided_failures(table))
        assert_array_equal(file.variables["undecided"][:], is_undecided(table.status))
        assert texts(file.variables["status"]) == table.status.tolist()
        assert texts(file.variables["cause"]) == table.cause.tolist()
        if n > 1:
            assert texts(file.variables["message"]) == list(table.messages)
            assert_array_equal(file.variables["message_case"][:], table.message_case)


def test_netcdf_of_a_sweep(tmp_path: Path) -> None:
    table = sweep()
    export_netcdf(table, tmp_path / "cases.nc")
    assert table.points is not None
    with netcdf_file(tmp_path / "cases.nc", mmap=False) as file:
        assert file.dimensions["point"] == 3
        assert texts(file.variables["point_label"]) == list(table.point_labels)
        period = file.variables["swept_stage_hover_period_s"]
        assert_array_equal(period[:], table.points[0])
        assert period.units == b"s"
        assert_array_equal(file.variables["point_of_case"][:], table.point)


def test_csv_of_bands_gives_back_every_bit(tmp_path: Path) -> None:
    made = bands()
    export_bands_csv(made, tmp_path / "bands.csv")
    header, rows = rows_of(tmp_path / "bands.csv")
    assert header == [
        "time [s]", "x p5 [m]", "x p50 [m]", "x p99_73 [m]", "x cases", "u.x, höher p5",
        "u.x, höher p50", "u.x, höher p99_73", "u.x, höher cases",
    ]  # fmt: skip
    assert_array_equal(column(rows, 0), made.time_s)
    for i, first in enumerate((1, 5)):
        for level in range(3):
            assert_array_equal(column(rows, first + level), made.values[level, i])
        assert [row[first + 3] for row in rows] == [str(n) for n in made.count[i]]


def test_netcdf_of_bands(tmp_path: Path) -> None:
    made = bands()
    export_netcdf(replace(campaign(10), bands=made), tmp_path / "cases.nc")
    with netcdf_file(tmp_path / "cases.nc", mmap=False) as file:
        assert_array_equal(file.variables["time"][:], made.time_s)
        assert_array_equal(file.variables["level"][:], made.levels)
        for i, name in enumerate(("band_x", "band_u_x_h_her")):
            variable = file.variables[name]
            assert variable.dimensions == ("level", "time")
            assert_array_equal(variable[:], made.values[:, i])
            assert (variable.long_name.decode(), variable.units) == (
                made.names[i],
                b"m1"[i : i + 1],
            )
            assert_array_equal(file.variables[f"{name}_cases"][:], made.count[i])


def test_netcdf_names_that_look_alike(tmp_path: Path) -> None:
    table = replace(campaign(4), inputs=("a.b", "a,b", "a b"))
    export_netcdf(table, tmp_path / "cases.nc")
    with netcdf_file(tmp_path / "cases.nc", mmap=False) as file:
        names = ("input_a_b", "input_a_b_2", "input_a_b_3")
        read = [file.variables[name].long_name.decode() for name in names]
    assert read == ["a.b", "a,b", "a b"]


def test_netcdf_of_no_case(tmp_path: Path) -> None:
    export_netcdf(campaign(0), tmp_path / "cases.nc")
    with netcdf_file(tmp_path / "cases.nc", mmap=False) as file:
        assert file.planned == 7
        assert "case" not in file.dimensions


def test_numbers_beyond_the_format(tmp_path: Path) -> None:
    table = replace(campaign(2), case=np.array([0, 2**31]))
    with pytest.raises(InputError, match="export it as CSV"):
        export_netcdf(table, tmp_path / "cases.nc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("export", [export_csv, export_netcdf])
def test_a_full_disk_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, export: Any
) -> None:
    place = tmp_path / "cases"
    place.write_text("old")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("hillsphere.base.atomic.os.fsync", full)
    with pytest.raises(OSError, match="No space left"):
        export(campaign(100), place)
    assert place.read_text() == "old"
    assert list(tmp_path.iterdir()) == [place]


@pytest.mark.parametrize("export", [export_csv, export_netcdf])
def test_memory_is_bounded(tmp_path: Path, export: Any) -> None:
    """10 000 cases of 35 columns are 2.8 MB; 100 000 would stay far below 300 MB."""
    table = campaign(10_000, inputs=25, metrics=10)
    tracemalloc.start()
    try:
        export(table, tmp_path / "cases")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 20e6
