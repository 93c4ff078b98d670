"""The stage ``pointing``: mounts that follow passes of a real orbit, planned and naive."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.base.geodetic import Station
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.plugins import validate
from hillsphere.presentation import Chart, Panel, Points, Presentation
from hillsphere.spec import Ref
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_tracking.ground_track import EarthTrack, ground_points
from hillsphere_tracking.passes.products import PassList
from hillsphere_tracking.passes.sources import orbits_from, station_of
from hillsphere_tracking.passes.specs import PassesSpec
from hillsphere_tracking.passes.stage import PassesStage
from hillsphere_tracking.pointing.products import Pointing
from hillsphere_tracking.pointing.specs import PointingSpec
from hillsphere_tracking.pointing.stage import PointingStage
from hillsphere_tracking.satellite_specs import SatelliteSpec, StationSpec
from hillsphere_tracking.topocentric import angles, direction_cosines, rates

DEGREE = np.pi / 180.0
Rows = dict[tuple[str, int], dict[str, Any]]
SATELLITE = {
    "name": "SCD",
    "elements": {
        "epoch": "1989-01-31T09:58:00",
        "semi_major_axis_km": 7180,
        "eccentricity": 0.0436,
        "inclination_deg": 23.82,
        "node_deg": 240.14,
        "perigee_deg": 15.47,
        "mean_anomaly_deg": 350.56,
    },
}
ALCANTARA = {
    "name": "Alcantara",
    "latitude_deg": -2.18,
    "longitude_deg": -44.26,
    "height_m": 39,
    "mask_elevation_deg": [5],
}
CUIABA = {
    "name": "Cuiaba",
    "latitude_deg": -15.53,
    "longitude_deg": -56.07,
    "height_m": 277,
    "mask_elevation_deg": [15],
}
EARTH = create("body", "planet", orientation="constant")


def axis(low: float, high: float, rate: float = 5.0) -> dict[str, float]:
    return {"lower_deg": low, "upper_deg": high, "rate_deg_s": rate, "acceleration_deg_s2": rate}


DISH = {"name": "dish", "primary": axis(-270, 270), "secondary": axis(0, 90)}
SLOW = {"name": "slow", "primary": axis(-270, 270, 1.0), "secondary": axis(0, 90, 1.0)}
XY = {"name": "xy", "kind": "x_y", "primary": axis(-88, 88, 3), "secondary": axis(-88, 88, 3)}


def passes_over(*stations: dict[str, Any], **keys: Any) -> PassList:
    given = {"body": EARTH, "satellites": [SATELLITE], "stations": list(stations), **keys}
    spec = validate(PassesSpec, given, where="stage.passes")
    assert isinstance(spec, PassesSpec)
    return PassesStage(spec).run(RecordingContext())


def stage(*mounts: dict[str, Any], **keys: Any) -> PointingStage:
    given = {"needs": {"passes": "passes"}, "mounts": list(mounts), **keys}
    spec = validate(PointingSpec, given, where="stage.pointing")
    assert isinstance(spec, PointingSpec)
    return PointingStage(spec)


def follow(passes: PassList, *mounts: dict[str, Any], **keys: Any) -> tuple[Pointing, Presentation]:
    made = stage(*mounts, **keys)
    product = made.run(RecordingContext(), passes)
    shown = made.present(product, passes)
    check_presentation(shown)
    return product, shown


def site_of(keys: dict[str, Any]) -> Station:
    spec = validate(StationSpec, keys, where="station")
    assert isinstance(spec, StationSpec)
    return station_of(spec)


def by_pass(shown: Presentation, table: str) -> Rows:
    """Return the rows of a table by mount and revolution."""
    rows = [dict(row) for row in shown.tables[table].rows]
    return {(str(row["mount"]), int(row["revolution"] or 0)): row for row in rows}


def track() -> EarthTrack:
    spec = validate(SatelliteSpec, SATELLITE, where="satellite")
    assert isinstance(spec, SatelliteSpec)
    (orbit,) = orbits_from((spec,))
    return EarthTrack(orbit, orbit.epoch, 86400.0)


@pytest.fixture(scope="module")
def a_day() -> PassList:
    return passes_over(ALCANTARA, CUIABA)


@pytest.fixture(scope="module")
def hard(a_day: PassList) -> tuple[Pointing, Presentation]:
    """Alcantara 8 (81.3°) and 14 (84.5°), followed by two mounts."""
    return follow(a_day, DISH, XY, stations=["Alcantara"], revolutions=[8, 14])


@pytest.mark.slow
def test_commands_keep_every_limit(hard: tuple[Pointing, Presentation]) -> None:
    product, _ = hard
    check_product(product)
    for m in range(2):
        for angle, limits in (
            (product.primary_rad, product.primary_limits),
            (product.secondary_rad, product.secondary_limits),
            (product.naive_primary_rad, product.primary_limits),
            (product.naive_secondary_rad, product.secondary_limits),
        ):
            low, high, rate, acceleration = limits[:, m]
            for k, n in enumerate(product.count):
                course = angle[:n, k, m]
                move = np.diff(course, prepend=course[0])  # at rest before
                assert np.isfinite(course).all()
                assert np.isnan(angle[n:, k, m]).all()
                assert course.min() >= low - 1e-12
                assert course.max() <= high + 1e-12
                assert np.abs(move).max() <= rate * 0.1 * (1.0 + 1e-9)
                assert np.abs(np.diff(move)).max() <= acceleration * 0.01 * (1.0 + 1e-6)


def test_errors_are_those_from_the_orbit_itself(
    a_day: PassList, hard: tuple[Pointing, Presentation]
) -> None:
    """The orbit computed anew at every command, the beam by hand: no spline, no mount."""
    product, _ = hard
    site = site_of(ALCANTARA)
    for k, n in enumerate(product.count):
        times = product.rise_s[k] + 0.1 * np.arange(n)
        azimuth, elevation, _ = angles(site, track().states(times)[:3])
        satellite = direction_cosines(azimuth, elevation)
        for m, kind in enumerate(product.kinds):
            first, second = product.primary_rad[:n, k, m], product.secondary_rad[:n, k, m]
            if kind == "azimuth_elevation":
                beam = direction_cosines(first, second)
            else:  # leans first by X towards the east, then by Y towards the north
                beam = np.array(
                    [np.sin(first) * np.cos(second), np.sin(second), np.cos(first) * np.cos(second)]
                )
            missed = 2.0 * np.arcsin(0.5 * np.linalg.norm(beam - satellite, axis=0))
            np.testing.assert_allclose(missed, product.error_rad[:n, k, m], rtol=0, atol=1e-10)
        np.testing.assert_allclose(
            direction_cosines(product.azimuth_rad[:n, k], product.elevation_rad[:n, k]),
            satellite, rtol=0, atol=1e-11,
        )  # fmt: skip
        # the stated error of the course through the samples is an upper one
        assert 1e-14 < product.sampling_error_rad[k] < 1e-10


def test_a_plan_follows_what_a_naive_antenna_loses(
    hard: tuple[Pointing, Presentation],
) -> None:
    product, shown = hard
    rows, motion = by_pass(shown, "pointing_errors"), by_pass(shown, "pointing_axes")
    # 81.3° asks for 2.3°/s: nothing for a dish of 5°/s
    assert rows["dish", 8]["error_max_deg"] < 1e-5
    assert rows["dish", 8]["followed"] is True
    # 84.5° near perigee asks for 8.2°/s; naive also meets the stop and rewinds
    row = rows["dish", 14]
    assert row["error_max_deg"] == pytest.approx(1.466, rel=0.02)
    assert row["error_max_unramped_deg"] == pytest.approx(2.870, rel=0.02)
    assert row["error_max_naive_deg"] == pytest.approx(73.6, rel=0.02)
    assert row["outside_naive_s"] > 5.0 * row["outside_s"] > 0.0
    assert row["followed"] is False
    # an X/Y mount has no keyhole up there
    for revolution in (8, 14):
        assert rows["xy", revolution]["error_max_deg"] < 3e-5
        assert rows["xy", revolution]["keyhole_distance_deg"] > 60.0
    assert motion["dish", 14]["primary_begin_deg"] > 180.0
    assert motion["dish", 14]["pre_slew_s"] > 10.0
    assert motion["dish", 8]["ramp_s"] == 0.0
    assert product.telling_pass(0) == product.telling_pass(1) == 1
    chart = shown.figures["pointing_errors_by_culmination"]
    assert isinstance(chart, Chart)
    panel = chart.panels[0]
    assert isinstance(panel, Panel)
    drawn = {mark.label: mark for mark in panel.marks if isinstance(mark, Points)}
    table = shown.tables[chart.table].rows
    for label, column in (("dish, naive", "error_max_naive_deg"), ("xy, planned", "error_max_deg")):
        points = drawn[label]
        assert isinstance(points.rows, range)
        for y, k in zip(np.asarray(points.y).tolist(), points.rows, strict=True):
            assert table[k]["mount"] == label.partition(",")[0]
            assert y == max(float(str(table[k][column])), 1e-4)  # the least error drawn
    worst = shown.metrics
    assert worst["dish_error_max"].value == rows["dish", 14]["error_max_deg"]
    assert worst["dish_outside_max_naive"].value == rows["dish", 14]["outside_naive_s"]
    assert (worst["dish_followed"].value, worst["xy_followed"].value) == (1, 2)
    assert "Mount dish: the error stays within 1° in 1 of 2 passes with a plan" in shown.verdict[0]
    outside = sum(rows["dish", revolution]["outside_s"] for revolution in (8, 14))
    naive = sum(rows["dish", revolution]["outside_naive_s"] for revolution in (8, 14))
    told = f"lock angle: {outside:.3g} s in total ({naive:.3g} s without a plan)"
    assert told in shown.verdict[0]


def test_a_slow_mount_halves_its_error_too(a_day: PassList) -> None:
    _, shown = follow(a_day, SLOW, revolutions=[8], command_period_s=0.5, culmination_min_deg=60)
    row = by_pass(shown, "pointing_errors")["slow", 8]
    motion = by_pass(shown, "pointing_axes")["slow", 8]
    assert row["error_max_deg"] < 0.5 * row["error_max_unramped_deg"]
    # the ramp lasts longer than the lag that it avoids, and that is said
    assert row["outside_s"] > row["outside_unramped_s"] > 0.0
    assert any("not the time beyond" in note for note in shown.tables["pointing_errors"].notes)
    # it uses 98 percent of the rate, and leaves the rest for corrections
    assert 0.979 < motion["primary_rate_max_deg_s"] <= 1.0
    assert motion["pre_slew_s"] > 60.0


def test_needed_rates_are_those_of_the_states(
    a_day: PassList, hard: tuple[Pointing, Presentation]
) -> None:
    product, _ = hard
    chosen = np.isin(a_day.revolution, (8, 14)) & (a_day.station == 0)
    # those are rates of velocities, which a first-order theory gives to J2²
    np.testing.assert_allclose(
        product.primary_rate_on_target_rad_s[:, 0],
        a_day.peak_azimuth_rate_rad_s[chosen],
        rtol=2e-5,
    )


def test_interpolation_keeps_its_bound(a_day: PassList) -> None:
    for period, lowest, passes in ((1.0, 80, 2), (4.0, 55, 5)):
        product, _ = follow(
            a_day, XY, culmination_min_deg=lowest, prediction_period_s=period,
            command_period_s=period / 4.0,
        )  # fmt: skip
        share = product.interpolation_error_rad / product.interpolation_bound_rad
        assert share.size == passes
        assert share.max() < 1.0
        assert share.min() > 0.2  # a bound, not a guess from afar
        # whoever is told less misses more: by the cube of the period
        assert product.interpolation_error_rad.max() / DEGREE < 1e-5 * period**3


def overhead(highest_deg: float) -> tuple[dict[str, Any], float]:
    """Return a station beside the track of revolution 8, and when the satellite is highest there.

    Away across the track from where the satellite passes the zenith, until it rises no higher.
    """
    flight, near = track(), 45382.0
    times = near + np.arange(-40.0, 40.0, 0.02)
    states = flight.states(times)
    x = flight.states(np.array([near]))
    latitude, longitude, _ = ground_points(x[:3])
    zenith = direction_cosines(longitude, latitude)[[1, 0, 2], 0]
    side = np.cross(zenith, x[3:, 0])
    side /= np.linalg.norm(side)

    def place(offset: float) -> dict[str, Any]:
        normal = zenith * np.cos(offset) + side * np.sin(offset)
        return {
            "name": "beside",
            "latitude_deg": float(np.degrees(np.arcsin(normal[2]))),
            "longitude_deg": float(np.degrees(np.arctan2(normal[1], normal[0]))),
            "mask_elevation_deg": [55],
        }

    def top(offset: float) -> tuple[float, float]:
        elevation = rates(site_of(place(offset)), states)[1]
        k = int(np.argmax(elevation))
        return float(np.degrees(elevation[k])), float(times[k])

    low, high = 0.0, 0.05
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if top(middle)[0] > highest_deg else (low, middle)
    return place(low), top(low)[1]


@pytest.mark.parametrize(
    ("culmination_deg", "rounded", "peak_deg_s", "digit"),
    [
        pytest.param(81.3, 0.05, 2.3, 0.05, marks=pytest.mark.slow),
        pytest.param(88.6, 0.05, 14.0, 0.5, marks=pytest.mark.slow),
        (89.93, 0.005, 264.0, 0.5),
    ],
)
def test_azimuth_turns_the_faster_the_nearer_the_zenith(
    culmination_deg: float, rounded: float, peak_deg_s: float, digit: float
) -> None:
    """Stations moved under the track of revolution 8, which is 1111 km high over Alcantara.

    Whole digits of culmination and rate leave room, more so near the zenith: cos 89.925° is 1.15
    times cos 89.935°.
    """
    found = []
    for highest in (culmination_deg - rounded, culmination_deg + rounded):
        station, when = overhead(highest)
        passes = passes_over(station, start="1989-01-31T22:15:00", duration_min=45)
        assert passes.rise_s.size == 1
        assert np.degrees(passes.elevation_max_rad[0]) == pytest.approx(highest, abs=1e-3)
        product, _ = follow(passes, DISH, command_period_s=1)
        peak = product.primary_rate_on_target_rad_s[0, 0]
        # at the culmination the satellite moves level: |v across the sight| / (ρ cos h)
        state = track().states(np.array([when]))
        site = site_of(station)
        sight = state[:3, 0] - site.ecef_m
        distance = np.linalg.norm(sight)
        across = np.linalg.norm(np.cross(sight / distance, state[3:, 0]))
        assert peak == pytest.approx(across / distance / np.cos(highest * DEGREE), rel=3e-5)
        found.append(peak / DEGREE)
    low, high = found
    assert low <= peak_deg_s + digit
    assert high >= peak_deg_s - digit


def test_a_pre_slewed_ramp_halves_the_peak_error_of_a_real_pass() -> None:
    station, _ = overhead(88.6)
    passes = passes_over(station, start="1989-01-31T22:15:00", duration_min=45)
    over = {**DISH, "name": "plunging", "secondary": axis(0, 180)}
    product, shown = follow(passes, DISH, over)
    row, plunging = by_pass(shown, "pointing_errors").values()
    assert 0.4 < row["error_max_deg"] / row["error_max_unramped_deg"] < 0.55
    # who may go over the top need not: here it would cost more
    assert plunging["error_max_deg"] <= 1.001 * row["error_max_deg"]
    assert not product.flipped.any()


def test_through_the_zenith_over_the_top() -> None:
    station, _ = overhead(89.93)
    passes = passes_over(station, start="1989-01-31T22:15:00", duration_min=45)
    over = {**DISH, "secondary": axis(0, 180)}
    product, shown = follow(passes, over)
    assert shown.tables["pointing_axes"].rows[0]["flipped"] is True
    assert np.nanmax(product.error_rad) / DEGREE < 0.075
    assert np.nanmax(product.naive_error_rad) / DEGREE > 3.0


def test_passes_too_short_for_a_plan_are_said(a_day: PassList) -> None:
    keys = {"command_period_s": 10, "prediction_period_s": 10}
    product, shown = follow(a_day, XY, culmination_min_deg=30, **keys)
    assert product.short == 0
    # above such a mask two passes last 15 s and 23 s: two commands, where a plan needs eight
    brief = passes_over({**ALCANTARA, "mask_elevation_deg": [15.6]})
    product, shown = follow(brief, XY, **keys)
    assert product.short == np.count_nonzero(brief.set_s - brief.rise_s < 70.0) == 2
    assert product.count.size == brief.rise_s.size - 2
    assert "2 passes are left out: too short for a plan." in shown.verdict


def test_of_all_passes_those_asked_for(a_day: PassList) -> None:
    keys = {"command_period_s": 1}
    high, _ = follow(a_day, XY, culmination_min_deg=60, **keys)
    assert sorted(zip(high.stations, high.revolution.tolist(), strict=True)) == [
        ("Alcantara", 8), ("Alcantara", 14), ("Cuiaba", 10), ("Cuiaba", 13),
    ]  # fmt: skip
    one, shown = follow(a_day, XY, stations=["Cuiaba"], revolutions=[10], **keys)
    assert (one.stations, one.revolution.tolist()) == (("Cuiaba",), [10])
    assert "in 1 of 1 pass with a plan" in shown.verdict[0]
    assert "pointing_errors_by_culmination" not in shown.figures


def test_a_satellite_that_hardly_moves() -> None:
    geo = {
        "name": "XM-3",
        "tle": "1 28626U 05008A   06176.46683397 -.00000205  00000-0  10000-3 0  2190\n"
        "2 28626   0.0019 286.9433 0000335  13.7918  55.6504  1.00270176  4891",
    }
    passes = passes_over(ALCANTARA, satellites=[geo], duration_h=2, refraction=True)
    product, _ = follow(passes, DISH, command_period_s=2, prediction_period_s=10)
    assert np.nanmax(product.error_rad) < 1e-6
    assert product.sampling_error_rad[0] < 1e-9


@pytest.mark.parametrize(
    ("keys", "match"),
    [
        ({"stations": ["Cuiba"]}, "no passes over 'Cuiba'; did you mean 'Cuiaba'"),
        ({"revolutions": [40]}, r"no pass to follow: none of \d+ .* Alcantara 1 \(17.9°\)"),
        ({"culmination_min_deg": 89}, "reaches 89°"),
        (
            {"command_period_s": 0.01, "mounts": [{**DISH, "name": f"dish{n}"} for n in range(6)]},
            r"which need \d+\.\d GB of memory, at most 2 GB; choose .* command_period_s = 0\.0\d+$",
        ),
    ],
)
def test_what_does_not_fit_the_passes(a_day: PassList, keys: dict[str, Any], match: str) -> None:
    with pytest.raises(InputError, match=match):
        stage(DISH, XY, **keys).run(RecordingContext(), a_day)


@pytest.mark.parametrize(
    ("mount", "keys", "match"),
    [
        ({"primary": axis(270, -270)}, {}, "lower stop must be below the upper one, got 270°"),
        ({"primary": axis(0, 0)}, {}, "must be below"),
        ({"primary": axis(-270, 270, 0.0)}, {}, r"rate_deg_s: must be > 0"),
        ({"secondary": axis(-100, 90)}, {}, "from -90° to 180°, got -100° and 90°"),
        ({"axis_azimuth_deg": 90}, {}, "does not belong to a mount of kind 'azimuth_elevation'"),
        ({"kind": "x_y", "tilt_deg": 5}, {}, "does not belong to a mount of kind 'x_y'"),
        ({"kind": "polar"}, {}, "kind"),
        ({"name": "My dish"}, {}, "name"),
        ({}, {"mounts": []}, "mounts"),
        ({}, {"mounts": [DISH, DISH]}, "the name 'dish' is listed twice"),
        ({}, {"command_period_s": 2}, "must not be longer than the period of the predictions, 1 s"),
        ({}, {"lock_angle_deg": 0}, "lock_angle_deg"),
        ({}, {"revolutions": [0]}, "revolutions"),
    ],
)
def test_wrong_keys_are_refused(mount: dict[str, Any], keys: dict[str, Any], match: str) -> None:
    given = {"needs": {"passes": Ref("passes")}, "mounts": [{**DISH, **mount}], **keys}
    with pytest.raises(InputError, match=match):
        validate(PointingSpec, given, where="stage.pointing")


def test_axes_in_degrees_are_kept_in_radians() -> None:
    made = stage({**XY, "axis_azimuth_deg": 90}, {**DISH, "tilt_deg": 7, "tilt_towards_deg": 110})
    primary = made.mounts[0].primary
    np.testing.assert_allclose(
        [primary.lower_rad, primary.upper_rad, primary.rate_rad_s, primary.acceleration_rad_s2],
        [-88.0 * DEGREE, 88.0 * DEGREE, 3.0 * DEGREE, 3.0 * DEGREE],
        rtol=1e-15,
    )
    east: Array = np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(made.mounts[0].axes[2], east, rtol=0, atol=1e-15)
    lean = direction_cosines(np.array(110.0 * DEGREE), np.array(83.0 * DEGREE))
    np.testing.assert_allclose(made.mounts[1].axes[2], lean, rtol=0, atol=1e-15)
