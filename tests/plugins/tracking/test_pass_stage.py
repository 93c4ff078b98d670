"""The stage ``passes``: what it yields and shows, and what it refuses."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Plant
from hillsphere.plugins import validate
from hillsphere.presentation import Presentation
from hillsphere.testing import RecordingContext, check_presentation, check_product, example
from hillsphere_tracking.passes.products import SUN_IN_BEAM, PassList
from hillsphere_tracking.passes.specs import PassesSpec
from hillsphere_tracking.passes.stage import PassesStage

ELEMENTS = {
    "epoch": "1989-01-31T09:58:00",
    "semi_major_axis_km": 7180,
    "eccentricity": 0.0436,
    "inclination_deg": 23.82,
    "node_deg": 240.14,
    "perigee_deg": 15.47,
    "mean_anomaly_deg": 350.56,
}
PAPER = {"name": "SCD", "elements": ELEMENTS}
GEO = {
    "name": "XM-3",
    "tle": "1 28626U 05008A   06176.46683397 -.00000205  00000-0  10000-3 0  2190\n"
    "2 28626   0.0019 286.9433 0000335  13.7918  55.6504  1.00270176  4891",
}
FALLING = {
    "tle": "1 29141U 85108AA  06170.26783845  .99999999  00000-0  13519-0 0   718\n"
    "2 29141  82.4288 273.4882 0015848 277.2124  83.9133 15.93343074  6828"
}
ALCANTARA = {
    "name": "Alcantara",
    "latitude_deg": -2.18,
    "longitude_deg": -44.26,
    "height_m": 39,
    "mask_elevation_deg": [5],
    "blind_sectors": [{"azimuth_deg": [80, 120], "elevation_deg": [0, 30], "reason": "tower"}],
    "beam_half_angle_deg": 60,
    "keyhole_elevation_deg": 80,
}
NORTH = {"name": "Svalbard", "latitude_deg": 78.23, "longitude_deg": 15.39}


EARTH = create("body", "planet", orientation="constant")
FIELD = str(Path(__file__).parents[3] / "missions" / "data" / "earth-gravity-degree6.gfc")


@cache
def plant(epoch: str = "1989-01-31T09:58:00") -> Plant:
    field = create("gravity", "harmonics", file=FIELD, max_degree=4)
    drag = {"drag_coefficient": 2.2, "area_to_mass_m2_kg": 0.01, "f107": 150, "f107_average": 150,
            "ap": 15}  # fmt: skip
    made: Plant = create("plant", "earth_orbit", body=EARTH, gravity=field, epoch=epoch, drag=drag)
    return made


def stage(**keys: Any) -> PassesStage:
    given = {"body": EARTH, "satellites": [PAPER], "stations": [ALCANTARA], **keys}
    spec = validate(PassesSpec, given, where="stage.passes")
    assert isinstance(spec, PassesSpec)
    return PassesStage(spec)


def run(**keys: Any) -> tuple[PassList, Presentation]:
    made = stage(**keys)
    product = made.run(RecordingContext())
    check_product(product)
    shown = made.present(product)
    check_presentation(shown)
    return product, shown


def test_the_papers_passes_in_a_table() -> None:
    product, shown = run()
    rows = {row["revolution"]: row for row in shown.tables["passes"].rows}
    seventh = rows[7]
    # Kuga and Carrara (1990), Table 1: 15:25, 36.8°, descending
    assert seventh["duration_min"] == pytest.approx(15.0 + 25.0 / 60.0, abs=4.0 / 60.0)
    assert seventh["elevation_max_deg"] == pytest.approx(36.8, abs=0.3)
    assert seventh["direction"] == "descending"
    assert seventh["rise"] == "1989-01-31T20:37:29.5"
    assert (rows[1]["cut"], seventh["cut"]) == ("start", "")
    assert [number for number, row in rows.items() if row["keyhole"]] == [8, 14]
    assert shown.verdict[0].startswith("11 passes in 1 day from 1989-01-31T09:58:00")
    assert any("UT1 is taken as UTC" in sentence for sentence in shown.verdict)
    # along each pass: from mask to mask, highest in between
    whole = ~(product.begun | product.unfinished)
    for end in (0, -1):
        np.testing.assert_allclose(
            np.degrees(product.elevation_rad[end, whole]), 5.0, rtol=0, atol=1e-6
        )
    assert (product.elevation_rad.max(axis=0) <= product.elevation_max_rad + 1e-12).all()
    assert ((product.sunlit_part >= 0.0) & (product.sunlit_part <= 1.0)).all()


def test_what_disturbs_lies_within_its_pass() -> None:
    product, shown = run()
    assert set(product.span_reason) == {"tower", SUN_IN_BEAM}
    assert (product.span_s[0] >= product.rise_s[product.span_pass]).all()
    assert (product.span_s[1] <= product.set_s[product.span_pass]).all()
    rows = shown.tables["passes"].rows
    for k, row in enumerate(rows):
        own = (product.span_pass == k) & (product.span_reason == "tower")
        assert row["blind_s"] == pytest.approx(np.sum(np.diff(product.span_s[:, own], axis=0)))
    assert sum(float(row["sun_in_beam_s"] or 0.0) for row in rows) > 100.0


def test_always_never_and_decayed_are_said() -> None:
    product, shown = run(satellites=[GEO, FALLING], stations=[ALCANTARA, NORTH],
                         start="2006-06-19T07:00:00", body=None)  # fmt: skip
    said = " ".join(shown.verdict)
    assert "XM-3 is always visible from Alcantara." in said
    assert "XM-3 never rises at Svalbard: its highest elevation is -" in said
    assert "'29141' has decayed 0.29 days after" in said
    assert "UT1 is taken" not in said
    assert product.searched_s[0] == 86400.0
    assert product.searched_s[1] < 25400.0
    table = {(row["station"], row["satellite"]): row for row in shown.tables["visibility"].rows}
    assert table["Alcantara", "XM-3"]["gap_max_h"] == 0.0
    assert table["Svalbard", "XM-3"]["gap_max_h"] == pytest.approx(24.0)
    assert table["Svalbard", "29141"]["visible"] == "passes"


def test_old_elements_are_said_to_be_old() -> None:
    _, shown = run(satellites=[GEO], start="2006-08-25", duration_h=1)
    assert any("elements of XM-3 are up to 61 days" in sentence for sentence in shown.verdict)


def test_dates_beyond_the_earths_known_rotation_are_said() -> None:
    _, shown = run(body=None, start="2200-01-01", duration_h=1)
    assert any("Earth orientation" in sentence for sentence in shown.verdict)


def test_satellites_flown_by_a_plant() -> None:
    theory, _ = run(duration_h=12)
    product, shown = run(plant=plant(), duration_h=12)
    assert product.rise_s.size == theory.rise_s.size
    off = np.abs(product.culmination_s - theory.culmination_s)
    assert 0.01 < off.max() < 3.0
    assert not any("plant" in sentence or "comes down" in sentence for sentence in shown.verdict)


@pytest.mark.slow
def test_a_flown_satellite_that_falls_is_said_to() -> None:
    elements = {**ELEMENTS, "semi_major_axis_km": 6548, "eccentricity": 0.001}
    product, shown = run(
        plant=plant("1989-04-01"), satellites=[{"name": "low", "elements": elements}, PAPER]
    )
    said = " ".join(shown.verdict)
    assert "'low' has come down to the ground +0." in product.end_reasons[0] + said
    assert "low comes down to 0 km. Below 180 km" in said
    assert "SCD comes down" not in said
    assert "The epoch of the plant is 59 days away" in said
    assert product.searched_s[0] < product.searched_s[1] == 86400.0


def test_refraction_is_a_switch() -> None:
    plain, _ = run(duration_h=2)
    seen, shown = run(duration_h=2, refraction=True)
    assert seen.rise_s[1] < plain.rise_s[1]
    assert np.degrees(seen.elevation_rad[0, 1]) == pytest.approx(5.0, abs=1e-6)
    assert "apparent" in shown.tables["passes"].notes[0]


def test_satellites_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "one.tle"
    path.write_text(GEO["tle"])
    product, _ = run(satellites=[{"file": str(path)}], duration_h=1, label="two")
    assert product.satellites == ("28626",)
    assert product.start == "2006-06-25T11:12:14.455008"


def test_two_stages_do_not_share_names() -> None:
    _, shown = run(duration_h=2, label="two")
    names = [*shown.tables, *shown.figures, *shown.metrics]
    assert all(name.endswith("_two") for name in names)


@pytest.mark.parametrize(
    ("keys", "match"),
    [
        ({"start": "1989-02-30"}, "start: '1989-02-30' is no date"),
        ({"stations": [ALCANTARA, ALCANTARA]}, "stations: a name stands twice"),
        ({"stations": [{**ALCANTARA, "latitude_deg": 91}]}, "latitude_deg"),
        ({"stations": [{**ALCANTARA, "mask_azimuth_deg": [0, 9]}]}, "as many azimuths"),
        ({"stations": [{**ALCANTARA, "mask_azimuth_deg": [9, 0], "mask_elevation_deg": [1, 2]}]},
         "must rise"),
        ({"stations": []}, "stations"),
        ({"satellites": [{"tle": "nonsense"}]}, "no element set"),
        ({"duration_d": 1000}, "duration_d"),
        ({"plant": example("plant", "hill")}, "type 'earth_orbit'"),
        ({"body": create("body", "moon", primary_gm_m3_s2=1e13, semi_major_axis_m=1e7)},
         "body of type 'planet', got Moon"),
    ],
)  # fmt: skip
def test_wrong_keys_are_refused(keys: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        stage(**keys)


def test_a_satellite_that_is_gone_before_the_start_is_an_error() -> None:
    with pytest.raises(PropagationError, match=r"'29141' has decayed"):
        stage(satellites=[FALLING], start="2006-07-01").run(RecordingContext())
