"""Offsets that quasi-satellite orbits around an ellipsoid bear, flown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hillsphere import create
from hillsphere.dynamics import Taylor
from hillsphere.errors import HillsphereError, StageError
from hillsphere.interfaces import Array
from hillsphere.products import Bifurcations
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_orbits.nonlinear_stability.edges import first_losses
from hillsphere_orbits.nonlinear_stability.nearby_resonances import nearby_resonances
from hillsphere_orbits.nonlinear_stability.products import NonlinearStability
from hillsphere_orbits.nonlinear_stability.sampled_orbits import SampledOrbits, retrace
from hillsphere_orbits.nonlinear_stability.survival import Fate, Fates, Survival
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.sources import members_of
from hillsphere_orbits.spatial_qso_families.products import SpatialFamilies

AXES = np.array([13.03e3, 11.40e3, 9.14e3])
MU = 7.059650784871513e-4  # km³/s²: the Phobos QSO bifurcation paper, eq. 1
BODY = {"primary_gm_km3_s2": 42828.37, "semi_major_axis_km": 9377.0, "name": "phobos"}
LA, LB, LC = 0, 1, 2  # x = 30, 22, 20 km: QSO-La, -Lb, -Lc of Table 1
FAST: dict[str, Any] = {
    "random_directions": 0,
    "doublings": 1,
    "scan": 1,
    "duration_d": 2,
    "draws": 4,
}


def hill(gravity: Any) -> Any:
    return create("plant", "hill", body=create("body", "moon", **BODY), gravity=gravity)


def family_of(plant: Any, x_km: list[float], **keys: Any) -> QsoFamily:
    stage = create(
        "stage", "qso_family", plant=plant, x_amplitudes_km=x_km, drift_revolutions=1, **keys
    )
    found = stage.run(RecordingContext())
    assert isinstance(found, QsoFamily)
    return found


@pytest.fixture(scope="module")
def family(plant: Any) -> QsoFamily:
    return family_of(plant, [30, 22, 20], x_min_km=18, x_max_km=35)


@pytest.fixture(scope="module")
def survival(plant: Any) -> Survival:
    return Survival(plant)


@pytest.fixture(scope="module")
def around(survival: Survival, family: QsoFamily) -> SampledOrbits:
    return retrace(survival.map, family.members)


def judge(plant: Any, **keys: Any) -> Any:
    keys = {"needs": {"orbits": ["family"]}, **keys}
    return create("stage", "nonlinear_stability", plant=plant, **keys)


def run(plant: Any, family: QsoFamily, seed: int = 1, **keys: Any) -> NonlinearStability:
    found = judge(plant, **keys).run(RecordingContext(seed), orbits=(family,))
    assert isinstance(found, NonlinearStability)
    return found


def starts(around: SampledOrbits, orbit: int, offsets: Array) -> tuple[Array, Array]:
    """Return starts (6, N) and limits (3, N) of an orbit with normalised offsets (6, N)."""
    x = around.way[:, 0, [orbit]] + offsets
    limits = np.repeat(2.0 * around.amplitude[:, [orbit]], x.shape[1], axis=1)
    limits[2] = np.inf
    return np.ascontiguousarray(x), limits


def injection(survival: Survival, count: int) -> Array:
    """Table 2 of the paper: 100 m and 3 cm/s per axis."""
    sigma = np.array([100.0] * 3 + [0.03] * 3) / survival.system.unit
    return np.asarray(np.random.default_rng(5).normal(size=(6, count)) * sigma[:, None])


def by_taylor(
    survival: Survival, x: Array, limits: Array, duration: float
) -> tuple[NDArray[np.int64], Array]:
    """Fates and times (N,) by another integrator, to the spacing of its samples, 0.01."""
    times = np.arange(0.0, duration, 0.01)
    way = Taylor(survival.system, tol=1e-15).sample(x, times)
    box = np.max(np.abs(way[:3]) / limits[:, None], axis=0) > 1.0
    squares = (way[:3] * survival.system.unit[0] / AXES[:, None, None]) ** 2
    hit = np.sum(squares, axis=0) < 1.0
    over = np.where((box | hit).any(axis=0), np.argmax(box | hit, axis=0), -1)
    lane = np.arange(x.shape[1])
    fate = np.where(hit[over, lane], Fate.IMPACT, Fate.ESCAPE)
    return np.where(over < 0, Fate.SURVIVES, fate), np.where(over < 0, duration, times[over])


@pytest.fixture(scope="module")
def given(plant: Any, family: QsoFamily) -> NonlinearStability:
    """Return fates of published offsets of ẏ over 30 days, and of two metres beside."""
    speeds = [[0, v, 0] for v in (3, 10, -10, 30, -30)]
    return run(
        plant, family, **{**FAST, "duration_d": 30}, velocity_offsets_cm_s=speeds,
        position_offsets_m=[[2, 0, 0]], position_max_m=1, velocity_max_cm_s=0.01,
    )  # fmt: skip


def test_fates_of_given_offsets(given: NonlinearStability) -> None:
    """QSO-La escapes or falls; the two orbits below it survive 30 days at ±30 cm/s."""
    assert given.offset.shape == (6, 6)
    np.testing.assert_allclose(given.offset[:, 0], [2, 0, 0, 0, 0, 0], rtol=0, atol=0)
    np.testing.assert_allclose(given.offset[4], [0, 0.03, 0.1, -0.1, 0.3, -0.3], rtol=0, atol=1e-15)
    la = [Fate(int(f)) for f in given.offset_fate[LA]]
    assert la[:4] == [Fate.SURVIVES, Fate.ESCAPE, Fate.ESCAPE, Fate.IMPACT]
    hours = given.offset_time_s[LA] / 3600.0
    # By Taylor series at 1e-15, sampled every 0.012 h, with this rule: 454.72, 93.55, 104.16.
    np.testing.assert_allclose(hours[1:4], [454.71, 93.55, 104.15], rtol=0, atol=0.03)
    for orbit in (LB, LC):
        assert not given.offset_fate[orbit].any()
        np.testing.assert_allclose(given.offset_time_s[orbit], 30 * 86400.0, rtol=1e-14)
    assert given.drift < 5e-6


@pytest.mark.slow
def test_same_fates_by_taylor_series(survival: Survival, around: SampledOrbits) -> None:
    """Injection errors of QSO-La, half of which are lost within 30 days."""
    duration = 30 * 86400.0 / survival.system.time_unit_s
    x, limits = starts(around, LA, injection(survival, 40))
    ours = survival.fly(x, limits, duration)
    fate, time = by_taylor(survival, x, limits, duration)
    assert {int(f) for f in ours.fate} == {Fate.SURVIVES, Fate.ESCAPE, Fate.IMPACT}
    same = ours.fate == fate
    # a lane at an edge may fall to either side
    assert np.count_nonzero(~same) <= 1
    np.testing.assert_allclose(ours.time[same], time[same], rtol=0, atol=0.2)


def test_fate_does_not_depend_on_the_lanes_beside(
    survival: Survival, around: SampledOrbits
) -> None:
    duration = 20 * 86400.0 / survival.system.time_unit_s
    x, limits = starts(around, LA, injection(survival, 21))
    together = survival.fly(x, limits, duration)
    assert together.lost.any()
    for i in (0, 7, 20):
        alone = survival.fly(x[:, [i]], limits[:, [i]], duration)
        for name in ("fate", "time", "drift"):
            assert getattr(alone, name)[0] == getattr(together, name)[i]


def test_flight_that_starts_beyond_a_limit(survival: Survival, around: SampledOrbits) -> None:
    unit = survival.system.unit[0]
    offset = np.zeros((6, 3))
    offset[0] = np.array([-20e3, 31e3, 0.0]) / unit  # in the body; beyond 60 km; as it is
    x, limits = starts(around, LA, offset)
    fates = survival.fly(x, limits, 1.0)
    assert fates.fate.tolist() == [Fate.IMPACT, Fate.ESCAPE, Fate.SURVIVES]
    np.testing.assert_array_equal(fates.time, [0.0, 0.0, 1.0])


def test_graze_between_two_steps(survival: Survival) -> None:
    """A fast pass that is below the surface for less than a step: seen, and not if it is above.

    A straight line at twice the speed of an orbit, tangent to the surface at (0, 0, c) but for
    a hair; the bend over its length is taken out by shooting at the point of the tangent.
    """
    unit = survival.system.unit[0]
    fates = []
    for depth in (20.0, -20.0):  # m
        tip = np.zeros((6, 1))
        tip[2], tip[3] = (AXES[2] - depth) / unit, 5.0
        start = Taylor(survival.system).propagate(tip, -0.05)
        found = survival.fly(start, np.full((3, 1), np.inf), 0.1)
        fates.append(Fate(int(found.fate[0])))
        if depth > 0.0:
            half = AXES[0] * np.sqrt(1.0 - (1.0 - depth / AXES[2]) ** 2) / unit / 5.0
            # in time units, by the length of the chord of the ellipse y = 0
            assert found.time[0] == pytest.approx(0.05 - half, abs=0.2 * half)
    assert fates == [Fate.IMPACT, Fate.SURVIVES]


def test_fall_into_a_point_mass_is_unresolved() -> None:
    point = hill(create("gravity", "point_mass", gm_km3_s2=MU))
    survival = Survival(point)
    x = np.zeros((6, 2))
    # one falls along the axis, on which nothing bends its way; the other circles
    x[2, 0], x[0, 1], x[4, 1] = 0.3, 0.3, -1.0 / np.sqrt(0.3) - 0.3
    fates = survival.fly(x, np.full((3, 2), 5.0), 3.0)
    assert fates.fate.tolist() == [Fate.UNRESOLVED, Fate.SURVIVES]


def test_orbits_around(around: SampledOrbits, family: QsoFamily) -> None:
    """Amplitudes are those of the family; half a turn on the state is the opposite one."""
    unit = family.members.length_m
    np.testing.assert_allclose(around.amplitude[0] * unit, [30e3, 22e3, 20e3], rtol=1e-9)
    np.testing.assert_allclose(around.amplitude[1] * unit, family.y_max_m, rtol=1e-6)
    half = around.way[:, (around.way.shape[1] - 1) // 2]
    np.testing.assert_allclose(half, -around.way[:, 0], rtol=0, atol=1e-9)


def test_limits_do_not_depend_on_longer_orbits_beside(
    survival: Survival, around: SampledOrbits, family: QsoFamily, spatial: SpatialFamilies
) -> None:
    """An orbit of 17 revolutions makes the common samples ten times as many."""
    beside = retrace(survival.map, members_of(family, spatial))
    assert beside.way.shape[1] > 5 * around.way.shape[1]
    np.testing.assert_allclose(beside.amplitude[:2, :3], around.amplitude[:2], rtol=1e-6)


def synthetic(offset: Array, lost: NDArray[np.bool_]) -> Fates:
    return Fates(np.where(lost, Fate.ESCAPE, 0).astype(np.int64), offset, np.zeros(offset.size))


def test_first_loss_of_a_known_set() -> None:
    """Rows lost above 0.7, in a tongue below that as well, everywhere, and nowhere."""

    def known(row: NDArray[np.intp], offset: Array) -> Fates:
        tongue = (row == 1) & (offset > 0.36) & (offset < 0.38)
        lost = ((row < 2) & (offset > 0.7)) | tongue | (row == 2)
        return synthetic(offset, lost)

    edges = first_losses(known, np.ones(4), doublings=4, scan=16)
    np.testing.assert_array_less(edges.survived[[0, 1]], [0.7, 0.36 + 1e-12])
    np.testing.assert_array_less([0.7, 0.36], edges.lost[[0, 1]])
    assert edges.lost[1] < 0.38
    # a sixteenth of the gap that held the loss
    np.testing.assert_allclose((edges.lost - edges.survived)[:2] * 16 * 16, [1, 1], rtol=1e-9)
    assert edges.survived[2] == 0.0
    assert 0.0 < edges.lost[2] <= 0.5**4 / 16
    assert edges.survived[3] == 1.0
    assert np.isinf(edges.lost[3])
    np.testing.assert_array_equal(edges.fate, [Fate.ESCAPE] * 3 + [Fate.SURVIVES])
    np.testing.assert_array_equal(edges.time[:3], edges.lost[:3])
    assert np.isnan(edges.time[3])
    # the coarse search steps over the tongue, as it says
    coarse = first_losses(known, np.ones(4), doublings=0, scan=2)
    assert coarse.lost[1] > 0.7


@pytest.fixture(scope="module")
def radii(plant: Any, family: QsoFamily) -> NonlinearStability:
    """QSO-La, -Lb and -Lc over ten days."""
    return run(plant, family, duration_d=10, random_directions=1, doublings=5, scan=4, draws=40)


def test_edges_lie_where_they_are_said_to(
    radii: NonlinearStability, survival: Survival, around: SampledOrbits
) -> None:
    """Both sides of the edge of QSO-La, in every direction, by Taylor series."""
    duration = 10 * 86400.0 / survival.system.time_unit_s
    with_loss = np.isfinite(radii.lost[LA])
    assert np.count_nonzero(with_loss) >= 10
    step = radii.direction[:, with_loss] / survival.system.unit[:, None]
    for side, lost in ((radii.survived, False), (radii.lost, True)):
        x, limits = starts(around, LA, step * side[LA, with_loss])
        fate, _ = by_taylor(survival, x, limits, duration)
        assert np.count_nonzero((fate != Fate.SURVIVES) == lost) >= fate.size - 1
    gap = radii.lost[LA, with_loss] - radii.survived[LA, with_loss]
    # all of them lie beyond the first part of their scan, which is 16 times the gap
    assert np.all(gap <= radii.lost[LA, with_loss] / 16)


def test_stability_radii(radii: NonlinearStability) -> None:
    """Those of QSO-La are the smallest by far: regression of the first digits."""
    position = radii.survived[np.arange(3), radii.weakest(velocity=False)]
    velocity = radii.survived[np.arange(3), radii.weakest(velocity=True)]
    assert position[LA] < 0.2 * position[[LB, LC]].min()
    assert velocity[LA] < 0.2 * velocity[[LB, LC]].min()
    assert 0.02 < velocity[LA] < 0.06
    for velocity_side, radius in ((False, position), (True, velocity)):
        own = radii.direction[3:].any(axis=0) == velocity_side
        np.testing.assert_array_equal(radius, radii.survived[:, own].min(axis=1))
    assert not radii.reference_fate.any()
    np.testing.assert_allclose(np.linalg.norm(radii.direction, axis=0), 1.0, rtol=1e-12)
    assert radii.directions[:2] == ("+x", "-x")
    assert np.isinf(radii.limit_m[2]).all()
    np.testing.assert_allclose(radii.limit_m[:2], 2.0 * radii.amplitude_m[:2], rtol=1e-12)


def test_orbits_of_one_name_are_told_apart(family: QsoFamily) -> None:
    both = members_of(family, family)
    assert both.labels == (
        "x = 30 km", "x = 22 km", "x = 20 km", "x = 30 km #2", "x = 22 km #2", "x = 20 km #2",
    )  # fmt: skip


def test_draws_of_an_orbit_do_not_depend_on_the_others(plant: Any, family: QsoFamily) -> None:
    keys = {**FAST, "duration_d": 9, "draws": 24, "phases": [0, 0.25]}
    all_three = run(plant, family, **keys)
    one = replace(
        family,
        members=replace(
            family.members,
            **{n: getattr(family.members, n)[..., :1] for n in
               ("x0", "period_s", "integral", "monodromy", "residual")},
            labels=family.members.labels[:1],
        ),
    )  # fmt: skip
    alone = run(plant, one, **keys)
    for name in ("counts", "median_loss_s", "lost"):
        whole = getattr(all_three, name)
        part = whole[:, :1] if name == "counts" else whole[:1]
        np.testing.assert_array_equal(part, getattr(alone, name))
    assert alone.counts[Fate.SURVIVES].min() < 24
    other = run(plant, one, seed=2, **keys)
    assert not np.array_equal(other.median_loss_s, alone.median_loss_s)
    assert np.isfinite(alone.median_loss_s).all()
    # the phases have draws of their own
    assert alone.median_loss_s[0, 0] != alone.median_loss_s[0, 1]


def test_survival_probability(given: NonlinearStability, radii: NonlinearStability) -> None:
    np.testing.assert_array_equal(radii.counts.sum(axis=0), 40)
    share = radii.counts[Fate.SURVIVES] / 40
    assert np.all((radii.low <= share) & (share <= radii.high))
    assert share[LA, 0] < 0.95
    np.testing.assert_array_equal(share[[LB, LC]], 1.0)
    assert np.isnan(radii.median_loss_s[[LB, LC]]).all()
    assert 0.0 < radii.median_loss_s[LA, 0] < 10 * 86400.0


def test_resonances_near_the_published_orbit(
    plant: Any, family: QsoFamily, survival: Survival
) -> None:
    """QSO-La lies half a kilometre from the in-plane 1:3, at 29.507 km."""
    found = nearby_resonances(family, 9, 2000.0)
    stage = create(
        "stage", "bifurcations", plant=plant, needs={"family": "family"}, planar=["1:3"],
        vertical=["1:7"],
    )  # fmt: skip
    exact = stage.run(RecordingContext(), family=family)
    assert isinstance(exact, Bifurcations)
    names = [(r.plane, r.d, r.n) for r in found if r.member == LA]
    assert names == [("planar", 1, 3), ("vertical", 1, 7)]
    for i, resonance in enumerate(found[:2]):
        x = exact.orbits.x0[0, i]
        assert resonance.x_m == pytest.approx(x, abs=0.5)
        assert resonance.distance_m == pytest.approx(x - 30e3, abs=0.5)
        # the offset puts the member on the level of the resonant orbit
        state = family.members.x0[:, [LA]].copy()
        state[4] += resonance.vy_offset_m_s
        value = survival.integral(state / survival.system.unit[:, None])[0]
        assert value == pytest.approx(exact.orbits.integral[i], abs=1e-5)
    assert found[0].x_m == pytest.approx(29507.0, abs=1.0)
    assert nearby_resonances(family, 9, 100.0) == []


def test_family_without_indices_or_integral(family: QsoFamily) -> None:
    """Complex multipliers leave gaps in the indices; a plant may have no integral."""
    indices = family.curve_indices.copy()
    x = family.curve.x0[0]
    indices[:, (x > 29e3) & (x < 31e3)] = np.nan
    assert not [r for r in nearby_resonances(replace(family, curve_indices=indices), 9, 2000.0)
                if r.member == LA]  # fmt: skip
    curve = replace(family.curve, integral=np.full(x.size, np.nan))
    found = nearby_resonances(replace(family, curve=curve), 9, 2000.0)
    assert found
    assert all(np.isnan(r.vy_offset_m_s) for r in found)


@pytest.fixture(scope="module")
def spatial(plant: Any) -> SpatialFamilies:
    """Return the family 1:17 near the plane, where it is stable, and at 70 km."""
    planar = family_of(plant, [46], x_min_km=45, x_max_km=47, curve_members=21)
    stage = create(
        "stage", "bifurcations", plant=plant, needs={"family": "family"}, vertical=["1:17"]
    )
    bifurcations = stage.run(RecordingContext(), family=planar)
    stage = create(
        "stage", "spatial_qso_families", plant=plant, needs={"bifurcations": "b"},
        z_amplitudes_km=[10, 70],
    )  # fmt: skip
    found = stage.run(RecordingContext(), bifurcations=bifurcations)
    assert isinstance(found, SpatialFamilies)
    return found


@pytest.mark.slow
def test_an_unstable_orbit_bears_nothing(
    plant: Any, family: QsoFamily, spatial: SpatialFamilies
) -> None:
    stage = judge(
        plant, needs={"orbits": ["family", "families"]}, random_directions=0,
        doublings=0, scan=1, draws=20, position_max_m=100, velocity_max_cm_s=1,
    )  # fmt: skip
    product = stage.run(RecordingContext(), orbits=(family, spatial))
    assert product.labels == ("x = 30 km", "x = 22 km", "x = 20 km", "1:17, 10 km", "1:17, 70 km")
    stable, unstable = 3, 4
    assert spatial.member_stable.tolist() == [True, False]
    assert product.reference_fate[unstable] == Fate.ESCAPE
    assert product.reference_time_s[unstable] < 30 * 86400.0
    assert not product.survived[unstable].any()
    assert not product.lost[unstable].any()
    assert product.counts[Fate.ESCAPE, unstable, 0] == 20
    assert product.counts[Fate.SURVIVES, stable, 0] == 20
    assert np.all(product.survived[stable] == product.largest[stable])
    assert np.isfinite(product.limit_m[2, [stable, unstable]]).all()
    shown = stage.present(product, orbits=(family, spatial))
    check_presentation(shown)
    check_product(product)
    rows = shown.tables["nonlinear_stability"].rows
    assert rows[unstable]["radius_position_m"] == 0.0
    assert rows[stable]["radius_position_fate"] == "not lost"
    assert rows[LA]["nearest_resonance"] == "planar 1:3"
    assert any("Lost even without an offset" in sentence for sentence in shown.verdict)
    assert (
        "|x|, |y| or |z| (planar orbits, to a twentieth of their extent: |x|"
        in shown.tables["survival_edges"].notes[0]
    )


def test_tables(plant: Any, given: NonlinearStability, radii: NonlinearStability) -> None:
    shown = judge(plant, label="again").present(given)
    assert set(shown.tables) == {
        f"{name}_again"
        for name in ("nonlinear_stability", "survival_probability", "survival_edges",
                     "nearby_resonances", "offset_fates")
    }  # fmt: skip
    row = shown.tables["offset_fates_again"].rows[2]
    assert row["fate"] == "escape"
    assert row["dvy_cm_s"] == pytest.approx(10.0, rel=1e-12)
    assert row["time_h"] == pytest.approx(93.55, abs=0.03)
    assert shown.tables["offset_fates_again"].rows[0]["fate"] == "survives"
    assert shown.tables["offset_fates_again"].rows[0]["time_h"] is None
    shown = judge(plant).present(radii)
    assert "offset_fates" not in shown.tables
    check_presentation(shown)
    rule = shown.tables["survival_probability"].notes[0]
    assert "within 10 days it goes beyond 2 times" in rule
    assert "meets the surface" in rule


def test_orbits_of_another_plant(family: QsoFamily) -> None:
    other = hill(create("gravity", "point_mass", gm_km3_s2=MU))
    with pytest.raises(StageError, match="do not solve the equations of this stage's plant"):
        run(other, family, **FAST)


def test_no_members(plant: Any, family: QsoFamily) -> None:
    none = replace(
        family,
        members=replace(
            family.members,
            **{n: getattr(family.members, n)[..., :0] for n in
               ("x0", "period_s", "integral", "monodromy", "residual")},
            labels=(),
        ),
    )  # fmt: skip
    with pytest.raises(StageError, match="hand on no orbit"):
        run(plant, none, **FAST)


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"needs": {}}, "orbits"),
        ({"draws": 0}, "must be ≥ 1"),
        ({"limit": 1}, "must be > 1"),
        ({"phases": [1.0]}, "must be < 1"),
        ({"phases": [0.5, 0.5]}, "a value is listed twice"),
        ({"phases": []}, "at least 1 item"),
        ({"velocity_offsets_cm_s": [[0, 1, 0], [0, 1, 0]]}, "a value is listed twice"),
        ({"duration_d": 0}, "must be > 0"),
        ({"scan": 0}, "must be ≥ 1"),
        ({"confidence": 1}, "must be < 1"),
    ],
)
def test_bad_keys(plant: Any, keys: Mapping[str, Any], words: str) -> None:
    with pytest.raises(HillsphereError, match=words):
        judge(plant, **keys)


@pytest.mark.slow
def test_an_orbit_that_gravity_lifts_by_metres_is_judged_as_planar() -> None:
    """Degree-4 harmonics lift x = 100 km by 4 m: an error of 100 m along z is not its loss."""
    file = Path(__file__).parents[3] / "missions" / "data" / "phobos-gravity-degree4.gfc"
    plant = hill(create("gravity", "harmonics", file=str(file)))
    family = family_of(plant, [100], x_min_km=90, x_max_km=105, curve_members=21, accuracy=1e-10)
    found = run(plant, family, **{**FAST, "draws": 16})
    assert 1.0 < found.amplitude_m[2, 0] < 10.0
    assert np.isinf(found.limit_m[2, 0])
    assert found.counts[Fate.SURVIVES, 0, 0] == 16
    along_z = [i for i, name in enumerate(found.directions) if name in ("+z", "-z", "+vz", "-vz")]
    assert np.all(found.survived[0, along_z] > 0.0)
