"""Tools of transfers: fronts, energy bounds, closed curves, meetings, flights end to end, ranks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hillsphere import create
from hillsphere.dynamics import Taylor
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.testing import RecordingContext
from hillsphere_orbits.flow import Flow, flow_of
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.swing_transfers.stage import energy_bound
from hillsphere_orbits.transfers.curves import PolarOrbit
from hillsphere_orbits.transfers.endtoend import Leg, heights_m, verify
from hillsphere_orbits.transfers.energy import least_dv
from hillsphere_orbits.transfers.meetings import Strands, meetings
from hillsphere_orbits.transfers.pareto import front
from hillsphere_orbits.transfers.ranks import rank_correlation

BODY = {"primary_gm_km3_s2": 42828.37, "semi_major_axis_km": 9377.0, "name": "phobos"}
AXES = (13.03e3, 11.40e3, 9.14e3)


@pytest.fixture(scope="module")
def plant() -> Any:
    gravity = create(
        "gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], gm_km3_s2=7.0596507848715e-4
    )
    return create("plant", "hill", body=create("body", "moon", **BODY), gravity=gravity)


@pytest.fixture(scope="module")
def family(plant: Any) -> QsoFamily:
    stage = create(
        "stage", "qso_family", plant=plant, x_amplitudes_km=[100, 30], drift_revolutions=1
    )
    found = stage.run(RecordingContext())
    assert isinstance(found, QsoFamily)
    return found


@pytest.fixture(scope="module")
def flow(plant: Any) -> Flow:
    return flow_of(plant)


@pytest.fixture(scope="module")
def curves(flow: Flow, family: QsoFamily) -> list[PolarOrbit]:
    members, system = family.members, flow.system
    return [
        PolarOrbit(
            flow,
            members.x0[:, i] / system.unit,
            members.period_s[i] / system.time_unit_s,
            members.labels[i],
        )
        for i in range(2)
    ]


# fronts


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0.0, 1.0, 2.0, 3.0, np.inf, np.nan]),
            st.sampled_from([0.0, 1.0, 2.0, 3.0, np.inf, np.nan]),
        ),
        max_size=12,
    )
)
def test_front_is_what_nothing_dominates(costs: list[tuple[float, float]]) -> None:
    dv, tof = (np.array([c[k] for c in costs], dtype=float) for k in (0, 1))
    on = front(dv, tof)
    for i, (a, b) in enumerate(costs):
        valid = np.isfinite(a) and np.isfinite(b)
        beaten = any(
            np.isfinite(p) and np.isfinite(q) and p <= a and q <= b and (p < a or q < b)
            for p, q in costs
        )
        assert on[i] == (valid and not beaten)


def test_front_wants_pairs() -> None:
    with pytest.raises(InputError, match="must be"):
        front([1.0, 2.0], [1.0])


# energy


def test_no_impulse_is_below_its_bound() -> None:
    """Velocities in random directions with the speeds that C₁, C₂ and W = 5 allow."""
    rng = np.random.default_rng(5)
    c = rng.uniform(-3.0, 4.5, size=(2, 2000))
    speed = np.sqrt(2.0 * (5.0 - c))
    way = rng.normal(size=(2, 3, 2000))
    v = speed[:, None] * way / np.linalg.norm(way, axis=1)[:, None]
    dv, bound = np.linalg.norm(v[1] - v[0], axis=0), least_dv(speed[0], c[0], c[1])
    assert np.all(dv >= bound - 1e-14)
    np.testing.assert_allclose(bound, np.abs(speed[1] - speed[0]), rtol=0, atol=1e-14)


def test_bound_where_the_energy_does_not_reach() -> None:
    assert least_dv(1.0, 0.0, 0.6) == np.inf
    assert least_dv(1.0, 0.0, 0.5) == 1.0
    assert least_dv(0.0, 0.3, 0.3) == 0.0
    with pytest.raises(InputError, match="≥ 0"):
        least_dv(-1.0, 0.0, 0.0)


def test_bound_of_two_impulses(curves: list[PolarOrbit], family: QsoFamily) -> None:
    """The least over all orbits in between, beside a scan of their Jacobi constants."""
    c = family.members.integral
    between = np.linspace(c[0] - 3.0, c[1] + 3.0, 20001)
    one = least_dv(curves[0].largest_speed, c[0], between)
    two = least_dv(curves[1].largest_speed, c[1], between)
    bound = energy_bound(curves[0], curves[1], float(c[0]), float(c[1]))
    assert bound <= np.min(one + two) + 1e-12
    assert bound == pytest.approx(np.min(one + two), rel=1e-3)


# closed curves


def test_curve_is_the_orbit(curves: list[PolarOrbit], flow: Flow) -> None:
    """States and times in all directions, beside the Taylor propagator."""
    taylor = Taylor(flow.system)
    for curve in curves:
        times = np.linspace(0.0, curve.period, 777)[1:-1]
        way = taylor.sample(curve.x0, times)
        angle = np.arctan2(way[1], way[0])
        np.testing.assert_allclose(curve.state(angle), way, rtol=0, atol=1e-12)
        np.testing.assert_allclose(curve.time(angle), times, rtol=0, atol=1e-12)
        np.testing.assert_allclose(curve.radius(angle), np.hypot(*way[:2]), rtol=1e-12)
        fastest = np.max(np.hypot(way[3], way[4]))
        assert -1e-10 < curve.largest_speed - fastest < 1e-4 * fastest


def test_slope_of_the_radius(curves: list[PolarOrbit]) -> None:
    angle, h = np.linspace(-3.0, 3.0, 50), 1e-5
    value, slope = curves[1].log_radius(angle)
    np.testing.assert_allclose(np.exp(value), curves[1].radius(angle), rtol=1e-14)
    ahead, behind = (curves[1].log_radius(angle + s)[0] for s in (h, -h))
    np.testing.assert_allclose((ahead - behind) / (2 * h), slope, rtol=0, atol=1e-9)


def test_curve_that_is_none(curves: list[PolarOrbit], flow: Flow) -> None:
    twice = curves[0].x0, 2.0 * curves[0].period
    with pytest.raises(InputError, match="twice does not meet every direction once"):
        PolarOrbit(flow, *twice, name="twice")
    lifted = curves[0].x0 + np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="leaves the plane"):
        PolarOrbit(flow, lifted, curves[0].period)


# meetings


@pytest.fixture(scope="module")
def strands(curves: list[PolarOrbit], flow: Flow) -> Strands:
    """Trajectories from between the two orbits, some of which meet one, the other, or both."""
    rng = np.random.default_rng(11)
    x0 = np.zeros((6, 40))
    x0[0] = rng.uniform(1.8, 4.0, 40)
    x0[3] = rng.normal(0.0, 0.5, 40)
    x0[4] = -2.0 * x0[0] * rng.uniform(0.9, 1.1, 40)
    flown = Strands.fly(flow, x0, rng.uniform(4.0, 15.0, 40), 1200, periodic=False)
    # near the body sub-steps of this length are too long, and gravity is steep
    clear = np.min(np.hypot(flown.way[0], flown.way[1]), axis=0) > 0.8
    return replace(flown, way=flown.way[:, :, clear], h=flown.h[clear])


def test_all_meetings_are_found(curves: list[PolarOrbit], strands: Strands, flow: Flow) -> None:
    """Beside changes of sign of r − R on dense output of the Taylor propagator."""
    taylor, points = Taylor(flow.system), 20001
    for curve in curves:
        met = meetings(curve, strands)
        found = 0
        for lane in range(strands.h.size):
            times = np.linspace(0.0, strands.h[lane] * 1200, points)
            way = taylor.sample(strands.way[:, 0, lane], times)
            g = np.log(np.hypot(*way[:2])) - curve.log_radius(np.arctan2(way[1], way[0]))[0]
            k = np.flatnonzero((g[1:] > 0) != (g[:-1] > 0))
            expected = times[k] - g[k] * (times[k + 1] - times[k]) / (g[k + 1] - g[k])
            own = met.time[met.lane == lane]
            assert own.size == k.size
            np.testing.assert_allclose(own, expected, rtol=0, atol=1e-5)
            found += k.size
        assert found > 8
        assert not met.touch.any()


def test_meetings_are_exact(curves: list[PolarOrbit], strands: Strands, flow: Flow) -> None:
    """Both states at one place, and the trajectory's where the Taylor propagator comes to."""
    met = meetings(curves[0], strands)
    np.testing.assert_allclose(met.state[:3], met.on_curve[:3], rtol=0, atol=1e-12)
    end = Taylor(flow.system).propagate(strands.way[:, 0, met.lane], met.time)
    np.testing.assert_allclose(met.state, end, rtol=0, atol=1e-10)
    np.testing.assert_allclose(
        met.dv, np.linalg.norm(met.state[3:] - met.on_curve[3:], axis=0), rtol=1e-14
    )
    assert np.all((met.angle >= 0.0) & (met.angle <= 0.5 * np.pi))


@pytest.mark.parametrize("gap, meets, touches", [(0.0, 1, 1), (-1e-9, 2, 0), (1e-9, 0, 0)])
def test_tangency(
    curves: list[PolarOrbit], flow: Flow, gap: float, meets: int, touches: int
) -> None:
    """A slower trajectory across the x axis where the orbit crosses it, or a hair beside.

    It is less curved there and lies outside.
    """
    x = curves[0].x0.copy()
    x[0] *= 1.0 + gap
    x[4] *= 0.9
    start = Taylor(flow.system).propagate(x, -1.0)
    path = Strands.fly(flow, start[:, None], np.array([1.7]), 150, periodic=False)
    met = meetings(curves[0], path)
    assert met.time.size == meets
    assert np.count_nonzero(met.touch) == touches
    if meets:
        np.testing.assert_allclose(met.time, 1.0, rtol=0, atol=1e-3)
    # the extremum itself, whatever the gap
    k = int(np.argmin(np.abs(met.bends.time - 1.0)))
    assert met.bends.value[k] == pytest.approx(np.log1p(gap), abs=1e-12)
    assert met.bends.dv[k] == pytest.approx(0.1 * abs(curves[0].x0[4]), rel=1e-8)


def test_closed_trajectory_meets_once_at_its_seam(curves: list[PolarOrbit], flow: Flow) -> None:
    """An orbit of the family, stretched: where it starts on the curve it does so once."""
    inner = curves[1]
    states = inner.state(np.array([0.3, 1.9]))
    path = Strands.fly(flow, states, np.full(2, inner.period), 200)
    met = meetings(curves[0], path)
    assert met.time.size == 0
    # and every orbit has four extrema of r/R about another one, wherever it is started
    assert np.bincount(met.bends.lane).tolist() == [4, 4]


@pytest.mark.parametrize("steps, words", [(0, "steps must be at least 1"), (10, "plane z = 0")])
def test_meetings_want_planar_trajectories(flow: Flow, steps: int, words: str) -> None:
    x = np.array([[3.0, 0.0, 0.0 if not steps else 0.1, 0.0, -6.0, 0.0]]).T
    with pytest.raises(InputError, match=words):
        Strands.fly(flow, x, np.array([1.0]), steps)


# end to end


def leg(name: str, duration: Array, impulse: Array, end: Array) -> Leg:
    return Leg(name, duration, impulse, end)


def test_a_revolution_closes(plant: Any, family: QsoFamily) -> None:
    members = family.members
    seen = verify(plant, members.x0, [leg("orbit", members.period_s, np.zeros((3, 2)), members.x0)])
    assert seen.closure_km.max() < 1e-9
    assert seen.closure_m_s.max() < 1e-9
    assert not seen.impact.any()
    np.testing.assert_array_equal(seen.dv_m_s, 0.0)
    np.testing.assert_allclose(seen.duration_s, members.period_s)
    # nearest on the x axis, where the long axis of the body points
    np.testing.assert_allclose(seen.altitude_m, [86.97e3, 16.97e3], rtol=0, atol=1e-3)
    np.testing.assert_allclose(seen.distance_m, [100e3, 30e3], rtol=0, atol=1e-3)


def test_misses_grow_from_leg_to_leg(plant: Any, family: QsoFamily) -> None:
    """An impulse that is planned but not needed is a miss of its own size, then of position."""
    members = family.members
    kick = np.array([[0.01, 0.01], [0.0, 0.0], [0.0, 0.0]])
    quiet = np.zeros((3, 2))
    legs = [
        leg("first", members.period_s, kick, members.x0),
        leg("second", members.period_s, quiet, members.x0),
    ]
    seen = verify(plant, members.x0, legs)
    np.testing.assert_allclose(seen.velocity_m_s[0], 0.01, rtol=1e-6)
    assert seen.position_km[0].max() < 1e-9
    assert seen.position_km[1].min() > 1e-3
    np.testing.assert_allclose(seen.dv_m_s, 0.01)


def test_impact(plant: Any, family: QsoFamily) -> None:
    fall = np.array([[15e3, 0.0, 0.0, -5.0, 0.0, 0.0]]).T
    start = np.concatenate([fall, family.members.x0[:, :1]], axis=1)
    hours = np.array([3600.0, 3600.0])
    seen = verify(plant, start, [leg("fall", hours, np.zeros((3, 2)), start)] * 2)
    assert seen.impact.tolist() == [True, False]
    assert seen.altitude_m[0] == 0.0
    assert np.isinf(seen.closure_km[0])
    assert np.isfinite(seen.closure_km[1])


@pytest.mark.parametrize(
    "legs, words", [(0, "at least one leg"), (1, "'wrong': 2 transfers, but .6, 1.")]
)
def test_flights_that_do_not_fit(plant: Any, family: QsoFamily, legs: int, words: str) -> None:
    one = leg("wrong", np.ones(2), np.zeros((3, 2)), family.members.x0[:, :1])
    with pytest.raises(InputError, match=words):
        verify(plant, family.members.x0, [one] * legs)


def test_heights(plant: Any) -> None:
    """Out along the normal of a point of the surface; nothing inside."""
    rng = np.random.default_rng(2)
    way = rng.normal(size=(3, 200))
    axes = np.array(AXES)[:, None]
    foot = axes * way / np.linalg.norm(way, axis=0)
    normal = foot / axes**2
    normal /= np.linalg.norm(normal, axis=0)
    height = 10.0 ** rng.uniform(-2.0, 6.0, 200)
    np.testing.assert_allclose(
        heights_m(plant, foot + height * normal), height, rtol=1e-9, atol=1e-9
    )
    np.testing.assert_array_equal(heights_m(plant, 0.9 * foot), 0.0)
    bare = create(
        "plant", "hill", body=create("body", "moon", **BODY),
        gravity=create("gravity", "point_mass", gm_km3_s2=7e-4),
    )  # fmt: skip
    assert np.isnan(heights_m(bare, foot)).all()


# ranks


def test_rank_correlation() -> None:
    """Four pairs in the same order: two of the 24 orders are as strongly correlated."""
    a = np.array([1.0, 2.0, 3.0, 4.0])
    assert rank_correlation(a, a**3) == (1.0, 2 / 24)
    rho, p = rank_correlation(np.arange(30.0), np.arange(30.0) ** 2 * (-1.0) ** np.arange(30))
    assert abs(rho) < 0.3
    assert p > 0.1
    assert np.isnan(rank_correlation(a[:2], a[:2])[0])
    assert np.isnan(rank_correlation(a, np.ones(4))[1])
