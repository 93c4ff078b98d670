"""What a key rules out is said at its line before the first stage, not when its stage runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hillsphere.base.problems import MissionError
from hillsphere.mission import load_mission
from hillsphere.runs.mission_check import check_mission

HEAD = """format = 1
name = "small"
title = "Small"
seed = 5
"""
MOON = """[body.moon]
type = "moon"
name = "phobos"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9377
[gravity.field]
type = "ellipsoid"
axes_km = [13.03, 11.40, 9.14]
density_g_cm3 = 1.86
[plant.hill]
type = "hill"
body = "moon"
gravity = "field"
[plant.ellipse]
type = "three_body"
body = "moon"
gravity = "field"
orbit = "elliptic"
rotation = "uniform"
[stage.family]
type = "qso_family"
plant = "hill"
x_amplitudes_km = [60, 30, 20]
"""


def refusal(tmp_path: Path, text: str) -> list[str]:
    path = tmp_path / "small.toml"
    path.write_text(HEAD + text, "utf-8")
    with pytest.raises(MissionError) as caught:
        check_mission(load_mission(path))
    return str(caught.value).splitlines()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            MOON.replace("x_amplitudes_km = [60, 30, 20]", "periods_h = [7]\nx_min_km = 5000"),
            r"stage\.family: the range of amplitudes is empty: x_min 5000 km, x_max",
        ),
        (
            MOON + '[stage.robust]\ntype = "nonlinear_stability"\nplant = "ellipse"\n'
            'needs = { orbits = ["family"] }\n',
            r"stage\.robust: survival needs a plant with states x, y, z, vx, vy, vz; this one has",
        ),
    ],
)
def test_what_keys_and_plants_rule_out(tmp_path: Path, text: str, said: str) -> None:
    (line,) = refusal(tmp_path, text)
    assert re.search(r"small\.toml:\d+: " + said, line), line


@pytest.mark.parametrize(
    ("mission", "setting", "said"),
    [
        (
            "assisted-tracking", 'stage.compare.baseline="tablet"',
            r"stage\.compare\.baseline: no tracker 'tablet' is compared",
        ),
        (
            "assisted-tracking", 'stage.pointing.stations=["Alcantata"]',
            r"stage\.pointing\.stations: no passes over 'Alcantata'",
        ),
        (
            "assisted-tracking", 'stage.track.body="nobody"',
            r"stage\.track\.body: ",
        ),
        (
            "apophis-formation", "stage.reference.relative=[]",
            r"stage\.reference\.relative: ",
        ),
        (
            "apophis-formation", "stage.reference.relative.second=false",
            r"stage\.reference\.relative: 1 differences of elements for 2 spacecraft",
        ),
    ],
)  # fmt: skip
def test_what_names_nothing_that_another_table_makes(mission: str, setting: str, said: str) -> None:
    with pytest.raises(MissionError, match=said):
        check_mission(load_mission(mission, sets=(setting,)))


def test_a_message_that_begins_with_a_key_is_told_at_its_line(tmp_path: Path) -> None:
    path = tmp_path / "small.toml"
    planet = (
        MOON
        + """[stage.passes]
type = "passes"
body = "moon"
duration_h = 8
stations = [{ name = "A", latitude_deg = 0, longitude_deg = 0, mask_elevation_deg = [5] }]
[[stage.passes.satellites]]
name = "SCD"
[stage.passes.satellites.elements]
epoch = "1989-01-31T09:58:00"
semi_major_axis_km = 7180
eccentricity = 0.0436
inclination_deg = 23.82
node_deg = 240.14
perigee_deg = 15.47
mean_anomaly_deg = 350.56
"""
    )
    text = HEAD + planet
    path.write_text(text, "utf-8")
    lines = text.splitlines()
    number = 1 + lines.index('body = "moon"', lines.index("[stage.passes]"))
    with pytest.raises(
        MissionError, match=rf"small\.toml:{number}: stage\.passes\.body: passes need"
    ):
        check_mission(load_mission(path))
