"""`hillsphere passes`: the passes of the stage, listed without a mission."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.cli.endings import run
from hillsphere.mission import load_mission
from hillsphere.testing import RecordingContext
from hillsphere_tracking.live.setup import specs_within
from hillsphere_tracking.passes.products import PassList
from hillsphere_tracking.satellite_specs import StationSpec

TLE = """ISS (ZARYA)
1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
"""
PLACE = "48.08,11.28,580"


@pytest.fixture
def elements(tmp_path: Path) -> Path:
    path = tmp_path / "iss.tle"
    path.write_text(TLE)
    return path


def listed(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, Any]:
    assert run(["passes", *map(str, arguments), "--json"]) == 0
    shown: dict[str, Any] = json.loads(capsys.readouterr().out)
    return shown


def test_passes_are_those_of_the_stage(elements: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shown = listed(capsys, elements, "--station", PLACE, "--days", 1, "--mask", 10)
    place = {"name": "x", "latitude_deg": 48.08, "longitude_deg": 11.28, "height_m": 580,
             "mask_elevation_deg": [10]}  # fmt: skip
    stage = create("stage", "passes", satellites=[{"tle": TLE}], stations=[place], duration_d=1)
    product: PassList = stage.run(RecordingContext())
    assert len(shown["passes"]) == product.rise_s.size > 3
    for row, elevation in zip(shown["passes"], product.elevation_max_rad, strict=True):
        assert row["elevation_deg"] == pytest.approx(np.degrees(elevation))
        assert row["elevation_deg"] >= 10.0 - 1e-9
        assert row["rise_utc"] <= row["highest_utc"] <= row["set_utc"]
    assert [row["begun"] for row in shown["passes"]][1:] == [False] * (len(shown["passes"]) - 1)


def test_table_and_stations_of_a_mission(
    elements: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--station", "Cuiabá", "--mission", "assisted-tracking", "--station", PLACE]
    assert run(["passes", str(elements), *given]) == 0
    head, *lines, mask = capsys.readouterr().out.splitlines()
    # A station of a mission brings its mask, which is no option of this command line.
    (station,) = (
        spec for spec in specs_within(load_mission("assisted-tracking"), StationSpec)
        if spec.name == "Cuiabá"
    )  # fmt: skip
    angle = np.degrees(station.mask_elevation_rad[0])
    assert mask == (
        f"Cuiabá: above the elevation mask of the mission's station, {angle:.3g}°; "
        "--mask sets another"
    )
    assert run(["passes", str(elements), *given, "--mask", "3"]) == 0
    assert "elevation mask" not in capsys.readouterr().out
    assert listed(capsys, elements, *given)["masks_deg"]["Cuiabá"] == [pytest.approx(angle)]
    assert head.split()[:2] == ["station", "satellite"]
    assert {line.split("  ")[0] for line in lines} == {"Cuiabá", PLACE}
    rises = [row["rise_utc"] for row in listed(capsys, elements, *given)["passes"]]
    assert rises == sorted(rises)


def test_no_pass_is_said(elements: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["passes", str(elements), "--station", "89,0"]) == 0
    assert capsys.readouterr().out.startswith("no pass in 1 days; highest elevation -")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--station", "a,b"], "expected a name or LAT,LON"),
        (["--station", "Cuiaba"], "give LAT,LON[,HEIGHT_M], or --mission"),
        (["--station", "Cuiaba", "--mission", "assisted-tracking"], "did you mean 'Cuiabá'?"),
        (["--station", "99,0"], "latitude"),
        (["--station", PLACE, "--days", "0"], "--days: must be > 0"),
        (["--station", PLACE, "--satellite", "MIR"], "MIR"),
        (["--station", PLACE, "--start", "soon"], "start"),
        ([], "Missing option '--station'"),
    ],
)
def test_bad_input_ends_with_2(
    arguments: list[str], message: str, elements: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["passes", str(elements), *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--station", "95,11"], "--station '95,11': latitude: must be ≤ 90 deg, got 95.0 deg"),
        (["--station", PLACE, "--station", "48,400"], "--station '48,400': longitude: must be ≤ 3"),
        (["--station", "48,11,1e9"], "--station '48,11,1e9': height: must be ≤ 9000 m"),
        (["--station", PLACE, "--mask", "95"], "--mask: must be < 90 deg, got 95.0 deg"),
        (["--station", PLACE, "--days", "-1"], "--days: must be > 0 d, got -1.0 d"),
        (["--station", PLACE, "--oldest", "0"], "--oldest: must be > 0 d"),
        (["--station", PLACE, "--start", "2019-13-01"], "--start: '2019-13-01' is no date"),
        (["--station", PLACE, "--checksum", "x"], "--checksum: must be one of 'refuse', 'warn'"),
    ],
)
def test_a_refused_value_is_named_by_its_option(
    elements: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    assert run(["passes", str(elements), *options]) == 2
    assert capsys.readouterr().err.startswith(message)
