"""Invariant manifolds: flights with events, modes, fundamental domains, the stage.

The orbits are members of the family 1:17 about the ellipsoid of the Phobos QSO bifurcation paper,
from states that two integrators agree on to the digits given.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.dynamics import Taylor
from hillsphere.errors import HillsphereError, InputError, StageError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.products import OrbitSet, PeriodicOrbits
from hillsphere.symbolic import Expr, Params
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_orbits.flow import Flow, flow_of
from hillsphere_orbits.invariant_manifolds.flight import FlightEnds, Watch, fly
from hillsphere_orbits.invariant_manifolds.products import Manifolds
from hillsphere_orbits.invariant_manifolds.sampling import (
    Leaves,
    LocalManifold,
    classify_manifolds,
    leaves,
    sides_are_images,
)
from hillsphere_orbits.invariant_manifolds.stage import orbits_on, period_steps, trial_places

BODY = {"primary_gm_km3_s2": 42828.37, "semi_major_axis_km": 9377.0, "name": "phobos"}
# z0 km: x0, vy0, T, λ of members of 1:17
MEMBERS = {
    70.0: (1.435320509108, -2.977099929327, 99.20298576821, 873.8202),
    110.0: (1.122263547025, -2.339435530321, 99.83118866385, 44743.298),
}


def make_plant(**keys: Any) -> Any:
    gravity = create(
        "gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], density_g_cm3=1.860,
        gravitational_constant=6.674e-11,
    )  # fmt: skip
    body = create("body", "moon", **BODY)
    return create("plant", "hill", body=body, gravity=gravity, **keys)


@pytest.fixture(scope="module")
def plant() -> Any:
    return make_plant()


@pytest.fixture(scope="module")
def flow(plant: Any) -> Flow:
    return flow_of(plant)


def member(flow: Flow, plant: Any, z_km: float) -> tuple[Array, float]:
    x, vy, period, _ = MEMBERS[z_km]
    z = z_km * 1e3 / plant.scales.length_m
    return np.array([x, 0.0, z, 0.0, vy, 0.0]), period


@pytest.fixture(scope="module")
def orbits(plant: Any, flow: Flow) -> OrbitSet:
    """Both members of 1:17, and the stable planar orbit QSO-M."""
    rows = [member(flow, plant, z) for z in MEMBERS]
    rows.append((np.array([50e3 / plant.scales.length_m, 0, 0, 0, -4.30361916578273, 0]),
                 5.84788873948051))  # fmt: skip
    x = np.stack([row[0] for row in rows], axis=1)
    period = np.array([row[1] for row in rows])
    _, monodromy = flow.with_matrix(x, period, 1400)
    scales = plant.scales
    return OrbitSet(
        PeriodicOrbits(
            frame=flow.system.frame,
            states=flow.names,
            x0=x * flow.system.unit[:, None],
            period_s=period * scales.time_s,
            integral=np.full(3, np.nan),
            monodromy=monodromy,
            residual=np.zeros(3),
            labels=("1:17, 70 km", "1:17, 110 km", "QSO-M"),
            length_m=scales.length_m,
            time_s=scales.time_s,
        )
    )


@pytest.fixture(scope="module")
def local(plant: Any, flow: Flow, orbits: OrbitSet) -> LocalManifold:
    x0, period = member(flow, plant, 70.0)
    steps = period_steps(flow, x0, period, orbits.members.monodromy[:, :, 0])
    return LocalManifold.of(flow, x0, period, steps)


@pytest.fixture(scope="module")
def watch(flow: Flow) -> Watch:
    x, y, z = flow.system.x[:3]
    return Watch(flow.system, {"z": z, "cylinder": x * x + y * y - 9.0, **flow.system.events})


def flown(flow: Flow, watch: Watch, x: Array, h: float, steps: int) -> FlightEnds:
    return fly(
        flow.plain, watch, x, h,
        lambda lanes, first, way: (
            np.full(lanes.size, way.shape[1]), np.ones((way.shape[1] - 1, lanes.size), bool)
        ), steps,
        tuple(name for name in ("impact",) if name in watch.names),
    )  # fmt: skip


def started(flow: Flow, plant: Any, count: int) -> Array:
    """Neighbours of the orbit, which leave it at different rates."""
    x0, _ = member(flow, plant, 70.0)
    shift = np.random.default_rng(4).normal(size=(6, count)) * 0.03
    return np.ascontiguousarray(x0[:, None] + shift)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_zeros_beside_the_taylor_propagator(
    plant: Any, flow: Flow, watch: Watch, sense: float
) -> None:
    """The same crossings, all of them, at the same times, by another integrator and root finder."""
    x, duration = started(flow, plant, 6), 20.0
    ours = flown(flow, watch, x, sense * duration / 400, 400)
    xs = flow.system.x
    record = {"z": xs[2], "cylinder": xs[0] * xs[0] + xs[1] * xs[1] - 9.0}
    theirs = Taylor(flow.system, record=record).fly(x, sense * duration)
    met = 0
    for e, name in enumerate(("z", "cylinder")):
        for lane, (times, states) in enumerate(theirs.crossings[name]):
            own = (ours.zeros.lane == lane) & (ours.zeros.event == e)
            assert own.sum() == times.size
            # integration error of 400 sub-steps, 1.4e-10 measured
            np.testing.assert_allclose(ours.zeros.time[own], times, rtol=0, atol=7e-10)
            np.testing.assert_allclose(ours.zeros.x[:, own], states, rtol=0, atol=2e-9)
            met += times.size
    assert met > 50
    values = watch(ours.zeros.x)[0][ours.zeros.event, np.arange(ours.zeros.lane.size)]
    assert np.abs(values).max() <= 1e-13


def test_two_zeros_in_one_sub_step(plant: Any, flow: Flow) -> None:
    """A cylinder that is only just touched from outside, between two ends of sub-steps."""
    x, h, steps = started(flow, plant, 1), 0.11, 120
    way = flow.plain.trajectory(x, steps * h, steps)[:, :, 0]
    xs = flow.system.x
    square = xs[0] * xs[0] + xs[1] * xs[1]
    turns = flown(flow, Watch(flow.system, {"turn": xs[0] * xs[3] + xs[1] * xs[4]}), x, h, steps)
    low = [k for k in range(turns.zeros.lane.size) if turns.zeros.rising[k]]
    found = 0
    for k in low:
        deepest = np.sum(turns.zeros.x[:2, k] ** 2)
        j = int(turns.zeros.time[k] / h)
        ends = np.sum(way[:2, j : j + 2] ** 2, axis=0)
        level = deepest + 0.3 * (ends.min() - deepest)
        grazed = flown(flow, Watch(flow.system, {"cylinder": square - float(level)}), x, h, steps)
        inside = (grazed.zeros.time > j * h) & (grazed.zeros.time < (j + 1) * h)
        assert inside.sum() == 2
        assert grazed.zeros.rising[inside].tolist() == [False, True]
        found += 1
    assert found >= 3


def test_impact_ends_a_flight(plant: Any, flow: Flow) -> None:
    unit = plant.scales.length_m
    x = np.array([[20e3 / unit, 30e3 / unit], [0, 0], [0, 0], [-1.5, 0], [0, -2.8], [0, 0]], float)
    watch = Watch(flow.system, {"z": flow.system.x[0], **flow.system.events})
    ends = flown(flow, watch, x, 0.05, 100)
    assert ends.ended_by.tolist() == [watch.names.index("impact"), -1]
    square = np.sum((ends.x[:3, 0] * unit / np.array([13.03e3, 11.40e3, 9.14e3])) ** 2)
    assert square == pytest.approx(1.0, abs=1e-12)
    assert ends.time[0] < 1.0
    assert ends.time[1] == pytest.approx(5.0)
    # nothing is met after the end
    assert np.all(ends.zeros.time[ends.zeros.lane == 0] <= ends.time[0])


@pytest.mark.parametrize("z_km", MEMBERS)
def test_multiplier(flow: Flow, plant: Any, z_km: float) -> None:
    """Literals of the members; both manifolds have the same, in their own sense."""
    x0, period = member(flow, plant, z_km)
    for stable in (False, True):
        found = LocalManifold.of(flow, x0, period, 1200, stable=stable)
        # limited by the seven digits of the smaller literal
        assert found.multiplier == pytest.approx(MEMBERS[z_km][3], rel=1e-7)
        assert found.sides == (1, -1)


def test_mode_is_carried_by_the_flow(local: LocalManifold, flow: Flow) -> None:
    steps = local.orbit.shape[1]
    end, phi = flow.with_matrix(local.orbit[:, 0], steps * local.h, steps)
    np.testing.assert_allclose(end, local.orbit[:, 0], rtol=0, atol=1e-8)
    v = local.mode[:, 0]
    assert np.linalg.norm(v) == pytest.approx(1.0)
    np.testing.assert_allclose(phi @ v, local.multiplier * v, rtol=0, atol=1e-6)


def fly_leaves(local: LocalManifold, watch: Watch, p: Array, side: int = 1, **keys: Any) -> Leaves:
    given = {"start": 1e-5, "distance": 1e-3, "duration": 10.0, **keys}
    return leaves(local, watch, p, side, **given)


def test_each_trajectory_is_met_once(local: LocalManifold, watch: Watch) -> None:
    """The end of the fundamental domain is its start one period later."""
    found = fly_leaves(local, watch, np.array([0.0, 0.5, 1.0]))
    clock = found.node * local.h
    period = local.h * local.orbit.shape[1]
    leaving = clock + found.left
    # two ends of the linear motion; the manifold's curvature there is of first order in `start`:
    # 2.1e-3 measured
    assert leaving[0] == pytest.approx(leaving[2] + period, abs=8e-3)
    assert abs(leaving[0] - leaving[1]) > 1.0
    zeros = [found.ends.zeros.select(found.ends.zeros.lane == k) for k in (0, 2)]
    after = [z.x[:, z.event == 0][:, -6:] for z in zeros]
    np.testing.assert_allclose(after[0], after[1], rtol=0, atol=0.02)


def test_known_zeros_are_found_alone(local: LocalManifold, watch: Watch) -> None:
    """Looked for beside their times only, with the same bits as among all."""
    p = np.array([0.1, 0.35, 0.6])
    every = fly_leaves(local, watch, p)
    zeros = every.ends.zeros
    zeros = zeros.select((zeros.event == 0) & (zeros.time > every.left[zeros.lane]))
    last = [np.flatnonzero(zeros.lane == lane)[-1] for lane in range(p.size)]
    alone = fly_leaves(local, watch, p, near=zeros.time[last])
    np.testing.assert_array_equal(alone.left, every.left)
    found = alone.ends.zeros
    assert found.lane.size < every.ends.zeros.lane.size
    same = [np.flatnonzero((found.lane == k) & (found.event == 0))[-1] for k in range(p.size)]
    np.testing.assert_array_equal(found.x[:, same], zeros.x[:, last])


def test_distance_where_times_begin(local: LocalManifold, watch: Watch, flow: Flow) -> None:
    found = fly_leaves(local, watch, np.linspace(0.0, 0.9, 4))
    for k in range(4):
        x = flow.plain.propagate(found.start[:, k], found.left[k], 3000)
        clock = found.node[k] * local.h + found.left[k]
        orbit = flow.plain.propagate(local.orbit[:, 0], clock % 99.20298576821, 3000)
        assert np.linalg.norm(x - orbit) == pytest.approx(1e-3, rel=8e-5)


def test_the_stable_manifold_is_the_mirror_image(
    plant: Any, flow: Flow, local: LocalManifold, watch: Watch
) -> None:
    """S = diag(1, −1, 1, −1, 1, −1) with time reversed keeps the orbit and swaps the manifolds."""
    x0, period = member(flow, plant, 70.0)
    stable = LocalManifold.of(flow, x0, period, local.orbit.shape[1], stable=True)
    mirror = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
    side = int(np.sign((mirror * local.mode[:, 0]) @ stable.mode[:, 0]))
    p = np.array([0.1, 0.6])
    out, back = fly_leaves(local, watch, p), fly_leaves(stable, watch, p, side)
    np.testing.assert_allclose(back.left, -out.left, rtol=1e-7)
    assert back.ends.zeros.time.size == out.ends.zeros.time.size
    np.testing.assert_allclose(back.ends.zeros.time, -out.ends.zeros.time, rtol=0, atol=1e-4)
    image = mirror[:, None] * out.ends.zeros.x
    np.testing.assert_allclose(back.ends.zeros.x, image, rtol=0, atol=1e-3)


def test_sides_of_odd_and_even_orders(local: LocalManifold, plant: Any) -> None:
    """Reflections of the ellipsoid map one side on the other if n is odd; a drift in x does not."""
    assert sides_are_images(local, trial_places())
    assert not sides_are_images(local, trial_places(), ((1, -1, 1),))


class Twisted:
    """A circle of period 2π whose neighbourhood turns by half a turn: λ = −exp(2π √(a² − ¼)).

    With u = (z, vz) and the angle t on the circle, u̇ = a [[cos t, sin t], [sin t, −cos t]] u; in
    axes that turn by t/2 the equations are constant with eigenvalues ±√(a² − ¼), and the axes come
    back reversed.
    """

    a = 0.75
    frame = "test"
    states = tuple(Variable(name, 1) for name in ("x", "y", "z", "vx", "vy", "vz"))
    controls: tuple[Variable, ...] = ()
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return (
            -x[1], x[0], self.a * (x[0] * x[2] + x[1] * x[5]),
            -x[4], x[3], self.a * (x[1] * x[2] - x[0] * x[5]),
        )  # fmt: skip

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {}


def test_negative_multiplier() -> None:
    flow = flow_of(Twisted())
    x0 = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = LocalManifold.of(flow, x0, 2.0 * np.pi, 60)
    exact = -np.exp(2.0 * np.pi * np.sqrt(Twisted.a**2 - 0.25))
    assert found.multiplier == pytest.approx(exact, rel=1e-9)
    assert found.growth == pytest.approx(exact**2, rel=1e-9)
    assert found.sides == (1,)
    # two periods; half-way the mode is on the other side
    assert found.orbit.shape == (6, 120)
    np.testing.assert_allclose(found.mode[:, 60], exact * found.mode[:, 0], rtol=0, atol=1e-7)
    # both sides of the orbit are sampled by one: starts beyond half the domain lie on the other
    watch = Watch(flow.system, {"z": flow.system.x[2]})
    ends = fly_leaves(found, watch, np.linspace(0.0, 1.0, 9)[:-1], start=1e-4, duration=1.0)
    assert np.isfinite(ends.left).all()


def rotated(angle: float, size: float) -> Array:
    c, s = size * np.cos(angle), size * np.sin(angle)
    return np.array([[c, -s], [s, c]])


def test_kinds() -> None:
    """By multipliers: on the circle, real off it, and off it in a complex quadruple."""
    stable, unstable, quadruple = np.eye(6), np.eye(6), np.eye(6)
    stable[:2, :2], stable[2:4, 2:4] = rotated(0.3, 1.0), rotated(1.0, 1.0)
    unstable[:2, :2], unstable[2:4, 2:4] = np.diag([3.0, 1 / 3.0]), rotated(1.0, 1.0)
    quadruple[:2, :2], quadruple[2:4, 2:4] = rotated(0.7, 2.0), rotated(0.7, 0.5)
    kinds = classify_manifolds(np.stack([stable, unstable, quadruple], axis=2))
    assert kinds == ("stable", "unstable", "complex")


def test_no_manifold_of_a_stable_orbit(flow: Flow, orbits: OrbitSet) -> None:
    x0, period = orbits_on(flow, orbits.members)
    with pytest.raises(InputError, match="a manifold needs a real one off the unit circle"):
        LocalManifold.of(flow, x0[:, 2], float(period[2]), 80)


def stage(plant: Any, **keys: Any) -> Any:
    given = {"needs": {"orbits": ["orbits"]}, "trajectories": 5, "duration_d": 4, **keys}
    return create("stage", "invariant_manifolds", plant=plant, **given)


@pytest.fixture(scope="module")
def product(plant: Any, orbits: OrbitSet) -> Manifolds:
    made = stage(plant, members=["1:17, 70 km", "QSO-M"], cylinders_km=[100, 30])
    found = made.run(RecordingContext(), orbits=(orbits,))
    assert isinstance(found, Manifolds)
    check_product(found)
    check_presentation(made.present(found, orbits=(orbits,)))
    return found


def test_what_the_stage_yields(product: Manifolds) -> None:
    assert product.kinds == ("unstable", "stable")
    assert product.multiplier[0] == pytest.approx(873.8202, rel=1e-7)
    assert np.isnan(product.multiplier[1])
    # two manifolds, two sides, five trajectories; none of the stable orbit
    assert product.orbit.tolist() == [0] * 20
    assert product.stable.tolist() == [False] * 10 + [True] * 10
    assert product.side.tolist() == ([1] * 5 + [-1] * 5) * 2
    assert product.events == ("plane z = 0", "cylinder 100 km", "cylinder 30 km", "impact")
    assert product.one_side.tolist() == [True, False]


def test_times_and_places_of_the_stage(product: Manifolds) -> None:
    sense = np.where(product.stable, -1.0, 1.0)
    assert np.all(product.start_time_s * sense < 0.0)
    assert np.all(product.end_time_s * sense >= 4 * 86400.0)
    assert np.all(product.met_time_s * sense[product.met_trajectory] <= 4 * 86400.0)
    radius = np.hypot(product.met[0], product.met[1])
    for event, expected in ((1, 100e3), (2, 30e3)):
        own = product.met_event == event
        np.testing.assert_allclose(radius[own], expected, rtol=1e-12)
    assert np.abs(product.met[2, product.met_event == 0]).max() <= 1e-7
    assert np.count_nonzero(product.met_event == 0) > 400


def test_escape_ends_trajectories(orbits: OrbitSet) -> None:
    plant = make_plant(escape_radius_km=110)
    found = stage(plant, members=["1:17, 70 km"], directions=["unstable"], duration_d=6).run(
        RecordingContext(), orbits=(orbits,)
    )
    ended = np.array(found.ended_by)
    assert "escape" in ended
    far = np.linalg.norm(found.end[:3, ended == "escape"], axis=0)
    np.testing.assert_allclose(far, 110e3, rtol=1e-11)


def test_orbits_of_other_equations(orbits: OrbitSet) -> None:
    gravity = create("gravity", "point_mass", gm_km3_s2=7.1e-4)
    other = create("plant", "hill", body=create("body", "moon", **BODY), gravity=gravity)
    with pytest.raises(StageError, match="do not solve the equations of this stage's plant"):
        stage(other).run(RecordingContext(), orbits=(orbits,))


def test_unknown_member(plant: Any, orbits: OrbitSet) -> None:
    with pytest.raises(InputError, match="no orbit is called '1:99'; there are: 1:17, 70 km"):
        stage(plant, members=["1:99"]).run(RecordingContext(), orbits=(orbits,))


def test_only_stable_orbits(plant: Any, orbits: OrbitSet) -> None:
    made = stage(plant, members=["QSO-M"])
    found = made.run(RecordingContext(), orbits=(orbits,))
    assert found.orbit.size == 0
    shown = made.present(found, orbits=(orbits,))
    assert "Stable, without manifolds: QSO-M." in shown.verdict


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"trajectories": 0}, "trajectories"),
        ({"duration_d": 0}, "duration_d"),
        ({"distance": 1e-5}, "must be smaller than distance"),
        ({"cylinders_km": [30, 30]}, "is listed twice"),
        ({"directions": []}, "directions"),
        ({"needs": {"orbits": []}}, "orbits"),
    ],
)
def test_bad_keys(plant: Any, keys: Mapping[str, Any], words: str) -> None:
    with pytest.raises(HillsphereError, match=words):
        stage(plant, **keys)


def test_complex_orbits_are_listed(plant: Any, orbits: OrbitSet) -> None:
    """A quadruple off the circle has no single direction: said, not flown."""
    members = orbits.members
    matrix = np.eye(6)
    matrix[:2, :2], matrix[2:4, 2:4] = rotated(0.7, 2.0), rotated(0.7, 0.5)
    other = replace(members, monodromy=np.repeat(matrix[:, :, None], 3, axis=2))
    made = stage(plant, members=["QSO-M"])
    found = made.run(RecordingContext(), orbits=(OrbitSet(other),))
    assert found.kinds == ("complex",)
    assert found.orbit.size == 0
    assert "Complex unstable: QSO-M." in made.present(found, orbits=(orbits,)).verdict
