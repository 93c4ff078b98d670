"""The stage ``reference_trajectories``: RT1–RT3, starts from elsewhere, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, GuidedFlight, Parameter
from hillsphere.plugins import validate
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_guidance.errors import InfeasibleGuidanceError
from hillsphere_guidance.reference_trajectories.specs import ReferenceTrajectoriesSpec


def descent(name: str, x_km: float, lat: float, lon: float, **keys: Any) -> dict[str, Any]:
    return {
        "name": name,
        "start": {"position_km": [x_km, 0, 0], "others": {"true_anomaly": 0.0}},
        "site": {"latitude_deg": lat, "longitude_deg": lon},
        "touchdown_speed_m_s": 0.5,
        "duration_s": 7980,
        **keys,
    }


RT = [
    descent("rt1", 16.56, 12, 25),
    descent("rt2", 16.56, -15, 15),
    descent("rt3", -16.56, -11, -165),
]


def stage(
    plant: Any, descents: list[dict[str, Any]] = RT, guidance: Any = None, **keys: Any
) -> Any:
    planner = guidance or create("guidance", "minimum_energy")
    return create(
        "stage", "reference_trajectories", plant=plant, guidance=planner, descents=descents, **keys
    )


@pytest.fixture(scope="module")
def references(phobos: Any) -> tuple[Any, Any]:
    made = stage(phobos)
    return made, made.run(RecordingContext())


def test_three_landings_on_phobos(references: tuple[Any, Any]) -> None:
    product = references[1]
    np.testing.assert_allclose(product.dv_m_s, [8.0548, 8.1925, 7.8449], rtol=0, atol=1e-3)
    np.testing.assert_allclose(product.dv_held_m_s, product.dv_m_s, rtol=0, atol=1e-4)
    ends = product.flights.x[:, -1]
    places = [
        (11028.690721, 5142.762943, 2586.561225),
        (11653.511524, 3122.549002, -3232.700604),
        (-12014.966528, -3219.400578, -2417.859472),
    ]
    speeds = [
        (-0.395495, -0.240931, -0.188511),
        (-0.416612, -0.145836, 0.234875),
        (0.440259, 0.154113, 0.180058),
    ]
    np.testing.assert_allclose(ends[:3].T, places, rtol=0, atol=1e-6)
    np.testing.assert_allclose(ends[3:6].T, speeds, rtol=0, atol=1e-6)
    assert product.replay_m[0].max() < 1e-7
    assert product.replay_held_m[0].max() < 2e-5


def test_grid_and_command(references: tuple[Any, Any]) -> None:
    product = references[1]
    flights = product.flights
    assert flights.labels == flights.plans == ("rt1", "rt2", "rt3")
    assert flights.frame == "body:phobos"
    assert flights.controls == ("ax", "ay", "az")
    np.testing.assert_allclose(flights.t_s[:, 0], np.arange(799) * 10.0, rtol=0, atol=0)
    assert flights.u is not None
    assert flights.u.shape == (3, 799, 3)
    assert np.array_equal(flights.u[:, -1], flights.u[:, -2])
    middle = 0.5 * (product.command[:, 1:] + product.command[:, :-1])
    np.testing.assert_allclose(flights.u[:, :-1], middle, rtol=0, atol=2e-5)
    # heights fall to the ground at the end and not before
    np.testing.assert_allclose(product.height_m[-1], 0.0, rtol=0, atol=1e-6)
    assert (product.height_m[:-1] > 1.0).all()


def test_what_is_shown(references: tuple[Any, Any]) -> None:
    made, product = references
    shown = made.present(product)
    check_product(product)
    check_presentation(shown)
    row = shown.tables["reference_trajectories"].rows[0]
    assert row["descent"] == "rt1"
    assert row["latitude_deg"] == pytest.approx(12.0)
    assert row["touchdown_m_s"] == pytest.approx(0.5)
    assert shown.metrics["replay_error"].value < 1e-7
    assert any("closer than 13.03 km" in sentence for sentence in shown.verdict)
    assert not any("below the surface" in sentence for sentence in shown.verdict)
    (space,) = shown.figures["reference_trajectories"].panels
    paths = [solid for solid in space.solids if getattr(solid, "times", None) is not None]
    for i, path in enumerate(paths):
        here = np.isfinite(product.flights.t_s[:, i])
        np.testing.assert_array_equal(path.points, product.flights.x[:3, here, i] / 1e3)
        np.testing.assert_array_equal(path.times, product.flights.t_s[here, i] / 3600.0)
    assert len(paths) == len(product.flights.labels)


def test_starts_from_other_distances_and_published_costs(phobos: Any, tmp_path: Path) -> None:
    published = tmp_path / "costs.csv"
    published.write_text("# source: somebody, 2020\ndescent,dv_m_s\nrt1,8.05\n", encoding="utf-8")
    made = stage(
        phobos, RT[:1], start_distances_km=[20, 30], step_s=60, reference=str(published),
        note="Sites were chosen.", label="far",
    )  # fmt: skip
    product = made.run(RecordingContext())
    assert product.flights.labels == ("rt1", "rt1 from 20 km", "rt1 from 30 km")
    assert product.descents == ("rt1", "rt1", "rt1")
    np.testing.assert_allclose(product.start_distance_m, [16560.0, 20e3, 30e3], rtol=1e-12)
    assert (np.diff(product.dv_m_s) > 1.0).all()
    shown = made.present(product)
    table = shown.tables["reference_trajectories_far"]
    assert table.rows[0]["dv_m_s_paper"] == 8.05
    assert "dv_m_s_paper" not in table.rows[1]
    assert table.notes[0] == "Sites were chosen."
    assert any("1 of 1 values agree" in note for note in table.notes)


def test_durations_may_differ_and_steps_be_broken(uniform: Any) -> None:
    descents = [
        {"name": name, "start": {"position_m": [100, 0, 500]}, "end_position_m": [0, 0, 0],
         "duration_s": duration}
        for name, duration in (("short", 75), ("long", 104))
    ]  # fmt: skip
    product = stage(uniform, descents).run(RecordingContext())
    t = product.flights.t_s
    np.testing.assert_allclose(t[:9, 0], [0, 10, 20, 30, 40, 50, 60, 70, 75], rtol=0, atol=0)
    assert np.isnan(t[9:, 0]).all()
    assert np.isnan(product.flights.x[:, 9:, 0]).all()
    np.testing.assert_allclose(t[:, 1], [*np.arange(0.0, 95.0, 10.0), 104.0], rtol=0, atol=0)
    assert product.replay_held_m.max() < 1e-9
    assert product.surface_m is None
    assert np.isnan(product.height_m).all()


class TabulatedPointMass:
    """A point mass that hides its formula."""

    frame = "body"
    gm_m3_s2 = 7.0875e5

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def potential_array(self, r: Array, p: Array) -> Array:
        return np.asarray(self.gm_m3_s2 / np.linalg.norm(r, axis=0))

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return np.asarray(-self.gm_m3_s2 * r / np.linalg.norm(r, axis=0) ** 3)


def test_gravity_of_arrays() -> None:
    """What is no expression is flown again by the step map, and is the same flight."""
    body = create(
        "body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0,
        semi_axes_km=(11.0, 11.0, 11.0),
    )  # fmt: skip
    found = []
    for gravity in (TabulatedPointMass(), create("gravity", "point_mass", gm_m3_s2=7.0875e5)):
        plant = create("plant", "hill", body=body, gravity=gravity)
        down = descent("down", -18.0, 0, 10)
        del down["start"]["others"]
        found.append(stage(plant, [down], step_s=60).run(RecordingContext()))
    assert found[0].replay_held_m[0].max() < 1e-4
    np.testing.assert_allclose(found[0].flights.x, found[1].flights.x, rtol=0, atol=1e-3)
    assert found[0].dv_m_s[0] == pytest.approx(found[1].dv_m_s[0], rel=1e-7)


def test_a_path_through_the_body_is_said(phobos: Any) -> None:
    made = stage(phobos, [descent("through", -16.56, 12, 25)], step_s=60)
    shown = made.present(made.run(RecordingContext()))
    assert any("through: the path runs below the surface" in s for s in shown.verdict)


class Hopeless:
    """Guidance that finds nothing."""

    def plan(self, plant: Any, task: Any) -> GuidedFlight:
        raise InfeasibleGuidanceError("too far")


def test_a_descent_that_cannot_be_planned_is_named(phobos: Any) -> None:
    with pytest.raises(StageError, match="descent 'rt1': too far"):
        stage(phobos, RT[:1], Hopeless()).run(RecordingContext())


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"start": {"position_km": [16, 0, 0]}}, "start.others: the plant's states beside"),
        ({"start": {"position_km": [16, 0], "others": {"true_anomaly": 0.0}}}, "has 3 axes, got 2"),
        (
            {"start": {"position_km": [5, 0, 0], "others": {"true_anomaly": 0.0}}},
            r"'rt1': start.position: it must be outside of .*got \[5000.* m, 8030 m below ground",
        ),
        (
            {"start": {"position_km": [0, 0, 0], "others": {"true_anomaly": 0.0}}},
            "start.position: .* at its centre",
        ),
        ({"touchdown_speed_m_s": None}, "belong together"),
        ({"end_position_km": [1, 2, 3]}, "give one of site and end_position_m"),
        ({"end_velocity_m_s": [1, 2, 3]}, "it belongs to end_position_m"),
    ],
)
def test_descents_that_are_refused(phobos: Any, keys: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        stage(phobos, [{**RT[0], **keys}])


def test_a_start_from_another_distance_is_outside(phobos: Any) -> None:
    with pytest.raises(InputError, match=r"start_distances: it must be outside .* 3030 m below"):
        stage(phobos, RT[:1], start_distances_km=[10.0])
    stage(phobos, RT[:1], start_distances_km=[13.03])


def test_names_must_differ(phobos: Any) -> None:
    with pytest.raises(InputError, match="two descents are called rt1"):
        stage(phobos, [RT[0], RT[0]])


def test_a_site_needs_a_surface(uniform: Any) -> None:
    down = descent("down", 1.0, 0, 10)
    del down["start"]["others"]
    with pytest.raises(InputError, match="no surface to land on"):
        stage(uniform, [down])


def test_published_costs_need_their_columns(phobos: Any, tmp_path: Path) -> None:
    published = tmp_path / "costs.csv"
    published.write_text("# source: somebody\nname,dv_m_s\nrt1,8\n", encoding="utf-8")
    with pytest.raises(InputError, match="need the columns descent and dv_m_s"):
        stage(phobos, RT, reference=str(published))


@pytest.mark.parametrize(
    ("compare", "said"),
    [
        (["series"], "compare: 'series' is the plant itself, from which it cannot differ"),
        (["solid", "series"], "compare: 'series' is the plant itself"),
        (["solid", "mesh", "solid"], "compare: 'solid' is listed twice; leave it out"),
        (["solid", "mesh"], ""),
    ],
)
def test_a_plant_is_compared_with_others_each_once(compare: list[str], said: str) -> None:
    keys = {"plant": "series", "guidance": "energy", "descents": RT[:1], "compare": compare}
    if not said:
        assert validate(ReferenceTrajectoriesSpec, keys, where="stage")
        return
    with pytest.raises(InputError, match=said):
        validate(ReferenceTrajectoriesSpec, keys, where="stage")


def test_other_plants_are_compared_along_the_paths(uniform: Any) -> None:
    """Uniform fields: the difference is the same everywhere; times and ends are the flight's."""
    hop = [
        {"name": "hop", "start": {"position_m": [0, 0, 500]}, "end_position_m": [50, 0, 400],
         "duration_s": 400},
        {"name": "long", "start": {"position_m": [0, 0, 500]}, "end_position_m": [50, 0, 400],
         "duration_s": 600},
    ]  # fmt: skip
    others = [type(uniform)((0.0, 0.003, -0.016)), type(uniform)((0.0, 0.0, -0.02))]
    made = stage(uniform, hop, compare=others)
    product = made.run(RecordingContext())
    check_product(product)
    assert len(product.compared) == 2
    here = np.isfinite(product.flights.t_s)
    assert here[:, 0].sum() < here[:, 1].sum()
    np.testing.assert_allclose(product.difference_m_s2[0][here], 5e-3, rtol=1e-12)
    np.testing.assert_allclose(product.difference_m_s2[1][here], 0.0, rtol=0, atol=1e-15)
    assert np.isnan(product.difference_m_s2[:, ~here]).all()
    shown = made.present(product)
    check_presentation(shown)
    rows = shown.tables["reference_differences"].rows
    assert [row["descent"] for row in rows] == ["hop", "long"] * 2
    assert rows[0]["at_50_percent_mm_s2"] == pytest.approx(5.0, rel=1e-12)
    chart = shown.figures["reference_differences"]
    marks = [mark for panel in chart.panels for mark in panel.marks]
    assert [mark.rows for mark in marks] == list(range(len(rows)))
    assert [rows[mark.rows]["descent"] for mark in marks] == [mark.label for mark in marks]
    with pytest.raises(InputError, match=r"compare: '\(given\)' is the plant itself"):
        stage(uniform, hop, compare=[others[0], uniform])
    with pytest.raises(InputError, match=r"compare: '\(given\)' is listed twice; leave it out"):
        stage(uniform, hop, compare=[*others, others[0]])
    with pytest.raises(InputError, match=r"compare: plant .* with the states x, vx; it must be"):
        stage(uniform, hop, compare=[type(uniform)((0.0,))])
