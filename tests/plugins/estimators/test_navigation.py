"""The stage ``navigation``: filters in the loop, and what goes wrong in it."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.base.paths import missions_directory
from hillsphere.cli.endings import run
from hillsphere.errors import HillsphereError
from hillsphere.interfaces import Array
from hillsphere.plugins import validate
from hillsphere.sensor_suite import SensorSuite
from hillsphere.testing import RecordingContext
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation import bounds
from hillsphere_estimators.navigation.metrics import moment, ratio_to_bound
from hillsphere_estimators.navigation.parts import prior_of
from hillsphere_estimators.navigation.presentation import judge_consistency
from hillsphere_estimators.navigation.specs import NavigationSpec
from hillsphere_estimators.navigation.stage import NavigationStage
from hillsphere_estimators.navigation.world import FaultySensors, PerturbedReference
from hillsphere_estimators.navigation_comparison.specs import NavigationComparisonSpec
from hillsphere_estimators.navigation_comparison.stage import NavigationComparisonStage
from hillsphere_estimators.plant_model import PlantModel

FIRST = [29.0, -1503.4, 407.1]
SECOND = [-1.2, -2126.2, 550.5]


@cache
def part(name: str) -> Any:
    """Return a piece of the world of the formation navigation paper."""
    if name == "body":
        return create(
            "body", "asteroid", name="apophis", semi_major_axis_au=0.9224, eccentricity=0.1912,
            rotation_rate_rad_s=5.8177e-5, semi_axes_m=(191.0, 135.0, 95.0),
        )  # fmt: skip
    if name == "gravity":
        return create("gravity", "point_mass", gm_m3_s2=1.801599)
    if name == "plant":
        craft = {"reflectivity": 0.2, "area_to_mass_m2_kg": 0.04}
        return create(
            "plant", "proximity", body=part("body"), gravity=part("gravity"),
            spacecraft=[craft] * 2, acceleration_noise_m_s2=1e-9, radiation_noise=0.2,
        )  # fmt: skip
    if name == "law":
        return create(
            "compensator", "lyapunov_formation", plant=part("plant"), period_h=1, ramp_h=2
        )
    if name == "link":
        return create("sensor", "inter_satellite", partner=2)
    kind, number = name[:-1], int(name[-1])
    if kind == "range":
        return create(
            "sensor", "lidar", body=part("body"), spacecraft=number, angles=False,
            field_of_view_deg=30,
        )  # fmt: skip
    return create("sensor", kind, body=part("body"), spacecraft=number)


SENSORS = ("camera1", "lidar1", "camera2", "lidar2", "link")


def stage(names: tuple[str, ...] = SENSORS, **keys: Any) -> NavigationStage:
    given: dict[str, Any] = {
        "plant": "plant", "law": "law", "sensors": names, "estimator": "iterated",
        "start": {"position_m": FIRST + SECOND}, "interval_h": 1, "duration_h": 3, "step_s": 120,
        "noise_step_s": 120, **keys,
    }  # fmt: skip
    given = {key: value for key, value in given.items() if value is not None}
    spec = validate(NavigationSpec, given, where="test")

    def lookup(kind: str, name: str) -> Any:
        if kind == "estimator":
            if name in ("ukf", "ekf", "gaussian_sum"):
                return create("estimator", name)
            return create("estimator", "unscented", update=name, iterations=40)
        return part(name)

    bound = spec.bound(lookup)
    assert isinstance(bound, NavigationSpec)
    return NavigationStage(bound)


@cache
def joint() -> Any:
    return stage(report_at_h=[1]).run(RecordingContext())


def test_joint_filter_is_consistent_and_as_good_as_its_bound() -> None:
    flight = joint()
    low, high = chi_square_band(12, flight.nees.shape[1])
    assert flight.lost == 0
    assert (low < flight.nees.mean(axis=1)).all()
    assert (flight.nees.mean(axis=1) < high).all()
    rms = np.sqrt(np.mean(flight.position_error_m[:, -1] ** 2, axis=1))
    np.testing.assert_array_less(0.8 * flight.bound_m[:, -1], rms)
    np.testing.assert_array_less(rms, 1.4 * flight.bound_m[:, -1])


def test_one_linear_update_is_inconsistent() -> None:
    """Angles of 1.7e-6 rad after a prior of 150 to 220 m: as the paper's filter does it."""
    flight = stage(estimator="plain", duration_h=1).run(RecordingContext())
    assert np.mean(flight.nees[0]) > 10 * chi_square_band(12, 64)[1]


def test_metrics_are_those_of_the_flights() -> None:
    flight = joint()
    value = dict(zip(flight.metrics, flight.values, strict=True))
    np.testing.assert_array_equal(value["position_error_1_at_1h"], flight.position_error_m[0, 1])
    np.testing.assert_array_equal(value["position_error_2"], flight.position_error_m[1, -1])
    np.testing.assert_array_equal(value["nees"], flight.nees[-1])
    np.testing.assert_array_equal(value["rejected"], 0.0)
    assert [moment(t) for t in (7200.0, 5400.0, 20.0)] == ["2h", "90min", "20s"]


def test_silence_lets_the_uncertainty_grow() -> None:
    keys: dict[str, Any] = {"outages": [{"interval_h": [0.5, 2.5]}]}
    flight = stage(**keys).run(RecordingContext())
    sigma, heard = flight.position_sigma_m[0].mean(axis=1), joint().position_sigma_m[0].mean(axis=1)
    assert (flight.sent[[1, 2]] == 0).all()
    assert sigma[0] == heard[0]
    assert sigma[2] > sigma[1] > 1.5 * heard[1]
    assert sigma[3] < 0.5 * sigma[2]


def test_covariance_intersection_is_not_overconfident() -> None:
    members = [["camera1", "lidar1", "link"], ["camera2", "lidar2"]]
    flight = stage(members=members, duration_h=2).run(RecordingContext())
    high = chi_square_band(12, 64)[1]
    assert flight.nees[-1].mean() < high
    assert (flight.position_sigma_m[:, -1].mean(axis=1)
            > joint().position_sigma_m[:, 2].mean(axis=1)).all()  # fmt: skip


def test_a_wrong_thrust_is_restored_by_biases() -> None:
    """Two per cent of thrust, unknown to the filter, over three hours."""
    names = ("camera1", "lidar1", "camera2", "lidar2")
    keys: dict[str, Any] = {"truth": {"thrust": 1.02}, "interval_h": 3, "duration_h": 3}
    unaware = stage(names, **keys).run(RecordingContext())
    biases = [{"of": "thrust", "sigma": 0.02}]
    aware = stage(names, biases=biases, **keys).run(RecordingContext())
    low, high = chi_square_band(12, 64)
    assert unaware.nees[-1].mean() > 2 * high
    assert low < aware.nees[-1].mean() < high
    assert not unaware.matched
    # whoever reckons with it is better off as well
    rms = [np.sqrt(np.mean(one.position_error_m[:, -1] ** 2)) for one in (unaware, aware)]
    assert rms[1] < rms[0]


def test_accelerations_beside_the_law() -> None:
    """What a model's motion is told beside estimate and reference pushes the states."""
    model = PlantModel(part("plant"), SensorSuite([part("link")]), law=part("law"), step_s=100.0)
    x = np.array([*FIRST, 0, 0, 0, *SECOND, 0, 0, 0], dtype=float)[:, None]
    told, push = np.concatenate([x, x]), np.array([1e-7, 0, 0, 0, -2e-7, 3e-7])[:, None]
    ends = (np.zeros(1), np.full(1, 200.0))
    case = np.zeros(1, dtype=np.int64)
    still = model.advance(x, *ends, told, case)
    moved = model.advance(x, *ends, np.concatenate([told, push]), case)
    want = np.concatenate([2e4 * push[:3], 200 * push[:3], 2e4 * push[3:], 200 * push[3:]])
    # the frame turns, gravity falls off: both are small in 200 s
    atol = np.tile(np.repeat([1e-6, 1e-8], 3), 2)[:, None]
    assert (np.abs(moved - still - want) <= atol).all()


def test_flights_of_different_intervals_are_shaken_alike() -> None:
    def shaken(interval_s: float, samples: int) -> Array:
        one = PerturbedReference(
            np.zeros((6, samples)), interval_s, 60.0, np.zeros(4), lambda t: np.ones((3, len(t))),
            np.ones(4), 1, "x", np.arange(4),
        )  # fmt: skip
        steps = [one.feedforward(k, np.zeros(4), np.arange(4)) for k in range(samples - 1)]
        assert one.feedforward(samples - 1, np.zeros(4), np.arange(4)) is None
        return np.concatenate([s.u for s in steps if s is not None])

    fine, coarse = shaken(600.0, 7), shaken(3600.0, 2)
    np.testing.assert_array_equal(fine, coarse)
    assert fine.shape == (60, 3, 4)
    assert abs(fine.std() - 1.0) < 0.15


def test_dropouts_and_outliers_come_as_often_as_asked() -> None:
    suite = SensorSuite(
        [part("link"), create("sensor", "inter_satellite", spacecraft=2, partner=1)]
    )
    faults = FaultySensors(suite, 0.3, 0.02, 30.0, [([1], 10.0, 20.0)])
    count = 20000
    x = np.repeat(np.array([*FIRST, 0, 0, 0, *SECOND, 0, 0, 0], dtype=float)[:, None], count, 1)
    t = np.zeros(count)
    scene = {"sun": np.array([[-1e11], [0.0], [0.0]])}
    w = np.random.default_rng(1).normal(size=(faults.noise, count))
    sigma = suite.sigma(x, t, scene)
    constant = np.zeros((suite.draws[0], count))
    found = faults.measurements(x, t, 0.0, scene, constant, w, sigma)
    assert found.present.mean() == pytest.approx(0.7, abs=0.015)
    off = np.abs(found.values[0] - suite.observe(x, t, scene)[0]) / sigma[0]
    far = off[found.present[0]] > 5.0
    assert far.mean() == pytest.approx(0.02, abs=0.003)
    # each is 30 sigma off, and noise beside that
    assert np.abs(off[found.present[0]][far] - 30.0).max() < 5.0
    silent = faults.measurements(x, t, 15.0, scene, constant, w, sigma)
    assert not silent.present[3:].any()
    np.testing.assert_array_equal(silent.present[:3], found.present[:3])


def test_a_bound_is_each_flights_own() -> None:
    flight = joint()
    assert flight.bounds_m.shape == flight.position_error_m.shape
    assert (flight.bounds_m[:, 1].std(axis=1) > 0.0).all()
    error, bound = np.array([3.0, 4.0, np.nan]), np.array([3.0, 4.0, 1.0])
    assert ratio_to_bound(error, bound) == (1.0, 0.0)
    # flights whose errors are as unlike as their bounds say nothing against them
    random = np.random.default_rng(1)
    size = np.exp(random.normal(size=4000))
    ratio, spread = ratio_to_bound(size * random.normal(size=4000), size)
    assert abs(ratio - 1.0) < 4.0 * spread < 0.4


def test_bounds_of_several_sets_of_sensors_share_their_path(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    moved: list[Any] = []
    from hillsphere_estimators.linearisation import transition

    def counted(*args: Any) -> Any:
        moved.append(args)
        return transition(*args)

    monkeypatch.setattr(bounds, "transition", counted)
    monkeypatch.setattr(bounds, "_PATHS", OrderedDict())
    sigma: dict[tuple[str, ...], Array] = {}
    for names in (SENSORS, SENSORS[:1], SENSORS):
        one = stage(names)
        plan = one._plan().plan
        x0 = np.repeat(plan.start[:, None], 2, axis=1)
        x0[0, 1] += 1.0
        begin = prior_of(plan.root, x0, np.zeros(2))
        values = one._bound(plan, x0, begin)
        np.testing.assert_array_equal(sigma.setdefault(names, values), values)
    assert (sigma[SENSORS] <= sigma[SENSORS[:1]]).all()
    # three intervals, whatever the number of sets
    assert len(moved) == 3


def test_who_does_not_see_the_asteroid_is_named_and_may_search() -> None:
    """A belief wide enough to look past it, from 64 starts."""
    names = ("camera1", "range1", "camera2", "range2")
    keys: dict[str, Any] = {"belief": {"position_relative": 0.2}, "duration_h": 1}
    lookers, searchers = stage(names, **keys), stage(names, search_beyond_deg=15, **keys)
    blind, found = lookers.run(RecordingContext()), searchers.run(RecordingContext())
    assert (blind.seen == 0.0).any()
    assert (found.seen == 1.0).all()
    said = lookers.present(blind)
    assert any("never measure" in sentence for sentence in said.verdict)
    assert any("times its bound" in sentence for sentence in said.verdict)
    rows = {row["sensor"]: row for row in said.tables["navigation_sensors"].rows}
    assert rows["camera1"]["blind"] == int(np.sum(blind.seen[0] == 0.0))
    assert not any("never measure" in one for one in searchers.present(found).verdict)
    value = dict(zip(blind.metrics, blind.values, strict=True))
    np.testing.assert_array_equal(value["least_seen"], blind.seen.min(axis=0))


def test_free_flight_spends_nothing_and_a_law_its_commands() -> None:
    free = stage(law=None, duration_h=1).run(RecordingContext())
    np.testing.assert_array_equal(free.values[free.metrics.index("dv")], 0.0)
    flight = joint()
    dv = flight.values[flight.metrics.index("dv")]
    assert (dv > 0.0).all()
    assert stage().present(flight).metrics["navigation_dv"].value == np.median(dv)


def test_lost_flights_are_never_consistent() -> None:
    flight = joint()
    nees = flight.nees.copy()
    nees[:, 10:] = np.nan
    said = stage().present(replace(flight, nees=nees, lost=54))
    assert said.metrics["navigation_consistent"].value is False
    assert stage().present(flight).metrics["navigation_consistent"].value is True
    calm = stage().present(replace(flight, nees=flight.nees / 6.0))
    assert any("cautious" in sentence for sentence in calm.verdict)
    loud = stage().present(replace(flight, nees=flight.nees * 6.0))
    assert any("overconfident" in sentence for sentence in loud.verdict)
    assert judge_consistency(12.0, 12, 64, 0)[1] > judge_consistency(12.0, 12, 64, 54)[1]


def test_faults_are_unknown_to_the_bound() -> None:
    notes = stage().present(joint()).tables["navigation"].notes
    assert not any("does not account" in note for note in notes)
    notes = stage(dropouts=0.3, outliers=0.02).present(joint()).tables["navigation"].notes
    assert any("does not account for dropouts, outliers" in note for note in notes)
    for silent, known in ([], False), (["link"], True):
        one = stage(outages=[{"sensors": silent, "interval_h": [0.2, 0.6]}])
        notes = one.present(joint()).tables["navigation"].notes
        assert any("all sensors are silent" in note for note in notes) is not known


@pytest.mark.parametrize("keys", [{"step_s": 300}, {"step_s": 600, "noise_step_s": 600}])
def test_a_step_too_long_for_the_motion_is_refused(keys: dict[str, Any]) -> None:
    """Flown all the same, NEES is 59 with steps of 300 s, and the error beyond all bounds later."""
    with pytest.raises(HillsphereError, match=r"step_s: .* s is too long: .* the step map errs by"):
        stage(**keys).run(RecordingContext())


def test_free_motion_bears_longer_steps() -> None:
    stage(law=None, step_s=1200, duration_h=1).prepare_cases(())


def test_lost_flights_leave_curves_of_the_others() -> None:
    flight = joint()
    nees, error = flight.nees.copy(), flight.position_error_m.copy()
    nees[1:, 0], error[:, 1:, 0] = np.nan, np.nan
    spec = validate(NavigationComparisonSpec, {"needs": {"flights": ["all", "some"]}}, where="test")
    assert isinstance(spec, NavigationComparisonSpec)
    one = NavigationComparisonStage(spec)
    some = replace(flight, nees=nees, position_error_m=error, lost=1)
    product = one.run(RecordingContext(), flights=(flight, some))
    assert np.isfinite(product.mean_nees).all()
    rows = one.present(product).tables["navigation_flights"].rows
    assert [row["answer"] for row in rows] == ["consistent"] * 2 + ["lost"] * 2


CONSIDERED = {"of": "acceleration", "sigma": 2e-8, "considered": True}
BAD: list[tuple[dict[str, Any], str]] = [
    ({"sensors": []}, "nothing measures"),
    ({"sensors": ["link", "link"]}, "is listed twice"),
    ({"duration_h": 0.5}, "longer than the flight"),
    ({"report_at_h": [4]}, "after the end"),
    ({"rms_from_h": 4}, "after the end"),
    ({"report_at_h": [0.5]}, "nothing is measured"),
    ({"report_at_h": [-1]}, "nothing is measured"),
    ({"report_at_h": [1, 1]}, "a time is listed twice"),
    ({"outages": [{"interval_h": [3, 1]}]}, "from, to"),
    ({"outages": [{"interval_h": [5, 6]}]}, "after the end"),
    ({"opening": "iterated"}, "takes no update"),
    ({"members": [list(SENSORS), []]}, "without any sensor"),
    ({"biases": [{"of": "thrust", "channel": "x", "sigma": 1}]}, "has no channels"),
    ({"biases": [{"of": "thrust", "sigma": 1}] * 2}, "is listed twice"),
    ({"biases": [{"of": "acceleration", "channel": "ax3", "sigma": 1}]}, "has ax1, ay1, az1, ax2"),
    ({"start": {"position_m": [0, 0, 0, *SECOND]}}, "spacecraft 1 is at the origin"),
    ({"truth": {"scale": {"gravity.gm": -1}}}, "a factor is a number from 0 on"),
    ({"truth": {"scale": {"gravity.gm": 0}}}, "gravity.gm must stay above zero"),
    ({"truth": {"scale": {"rotation_rate": 0}}}, "rotation_rate must stay above zero"),
    ({"truth": {"scale": {"eccentricity": 6}}}, "eccentricity must stay below 1"),
    ({"gate_after": 2}, "needs opening"),
    ({"members": [["camera1"], ["lidar1"]]}, "must belong to one member"),
    ({"outages": [{"sensors": ["radar"], "interval_h": [1, 2]}]}, "'radar' is none of the sensors"),
    ({"biases": [{"of": "radar", "sigma": 1}]}, "'radar' is none of the sensors"),
    ({"biases": [{"of": "lidar1", "channel": "colour", "sigma": 1}]}, "no channel 'colour'"),
    ({"start": None}, "where"),
    ({"start": {"position_m": FIRST}}, "3 numbers, the plant has 6"),
    ({"truth": {"scale": {"mass": 2}}}, "no parameter mass"),
    ({"belief": {"velocity_mm_s": 1}}, "zero is no belief"),
    ({"truth": {"sensors": ["link"]}}, "their channels must be those"),
    *(
        ({"estimator": name, "biases": [CONSIDERED]}, "estimator: it estimates all states")
        for name in ("ukf", "ekf", "gaussian_sum")
    ),
    ({"opening": "ekf", "gate_after": 1, "biases": [CONSIDERED]}, "opening: it estimates all"),
]


@pytest.mark.parametrize(("keys", "message"), BAD)
def test_bad_input(keys: dict[str, Any], message: str) -> None:
    others = {key: value for key, value in keys.items() if key != "sensors"}
    with pytest.raises(HillsphereError, match=message):
        run_stage(tuple(keys.get("sensors", SENSORS)), others)


def run_stage(names: tuple[str, ...], keys: dict[str, Any]) -> None:
    stage(names, **keys).run(RecordingContext())


@pytest.mark.parametrize("form", ["inertial", "elements"])
def test_a_start_in_another_form_is_a_start(form: str) -> None:
    """It says where flights begin as a position does, and cannot stand beside a belief."""
    given = {
        "inertial": {"position_m": [2000, 0, 0], "velocity_m_s": [0, 0.1, 0]},
        "elements": {"semi_major_axis_km": 2, "true_anomaly_deg": 0},
    }
    keys = {**NavigationSpec.examples[0], "start": {form: given[form]}}
    assert getattr(NavigationSpec.model_validate(keys).start, form) is not None
    with pytest.raises(ValueError, match=r"needs\.belief says where flights begin"):
        NavigationSpec.model_validate({**keys, "needs": {"belief": "opening"}})


def test_one_orbit_for_three_spacecraft_is_refused_by_validate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the place in the file; the same start of one spacecraft is valid."""
    text = (missions_directory() / "bennu-formation.toml").read_text("utf-8")
    form = "start = { elements = { semi_major_axis_km = 2.6, true_anomaly_deg = 20 } }"
    text = text.replace("start = { position_m = [0, -2500, 600] }", form)
    begin = text.index("start = { position_m = [0, -2500, 600, 300,")
    # the stage of three is like that of one: without a start of its own it takes the other's
    text = text[:begin] + text[text.index("\n", begin) :]
    path = tmp_path / "orbits.toml"
    path.write_text(text, "utf-8")
    monkeypatch.chdir(tmp_path)
    assert run(["validate", str(path)]) == 2
    told = capsys.readouterr().err.strip()
    assert told.count("\n") == 0
    assert "stage.three.start.elements: the plant moves 3 bodies" in told
