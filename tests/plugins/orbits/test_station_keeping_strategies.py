"""Station-keeping strategies: references, gains and laws against independent computations."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from hillsphere import create
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array
from hillsphere.products import PeriodicOrbits, Trajectories
from hillsphere.testing import check_compensator
from hillsphere_orbits.flow import flow_of
from hillsphere_orbits.stability import multipliers
from hillsphere_orbits.station_keeping_flown.reference_path import (
    ReferencePath,
    paths_of_flights,
    paths_of_orbits,
    unstable_left_subspace,
)
from hillsphere_orbits.station_keeping_flown.sampling import Sampling, Weights
from hillsphere_orbits.station_keeping_flown.strategies import (
    FloquetMode,
    GainSchedule,
    periodic_lqr_gains,
    target_point_gains,
)
from hillsphere_orbits.station_keeping_index.stage import correction_speed

# Starts near to the orbits 1:17 at z = 70 and 110 km and 1:25 at 70 km of the Phobos QSO
# bifurcation paper's Table 3: x0, vy, period, natural units; corrected below.
NEAR = {
    (17, 70): (1.4353205091, -2.9770999293, 99.2029857682),
    (17, 110): (1.1222635470, -2.3394355303, 99.8311886639),
    (25, 70): (1.7661724307, -3.6147854108, 149.2944694693),
}
WEIGHTS = Weights(position=0.1, velocity=0.2, impulse=0.02, targets=(1, 3))


@cache
def plant() -> Any:
    # the Phobos QSO bifurcation paper, section 2
    gravity = create(
        "gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], gm_km3_s2=7.059650784871513e-4
    )
    body = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0
    )
    return create("plant", "hill", body=body, gravity=gravity)


@cache
def orbits() -> PeriodicOrbits:
    """Orbits that meet the plane xz perpendicularly twice, by Newton's method on half a period."""
    flow, scales = flow_of(plant()), plant().scales
    x0, period = np.zeros((6, len(NEAR))), np.empty(len(NEAR))
    for i, ((_, z_km), (x, vy, t)) in enumerate(NEAR.items()):
        x0[[0, 2, 4], i], period[i] = (x, z_km * 1e3 / scales.length_m, vy), t
    for _ in range(4):
        end, phi = flow.with_matrix(x0, 0.5 * period, 400)
        rate = flow.rate(end)
        for i in range(period.size):
            rows = [1, 3, 5]
            jacobian = np.column_stack([phi[rows, 0, i], phi[rows, 4, i], 0.5 * rate[rows, i]])
            step = np.linalg.solve(jacobian, end[rows, i])
            x0[0, i] -= step[0]
            x0[4, i] -= step[1]
            period[i] -= step[2]
    end, phi = flow.with_matrix(x0, period, 800)
    return PeriodicOrbits(
        frame="hill:phobos",
        states=flow.names,
        x0=x0 * flow.system.unit[:, None],
        period_s=period * scales.time_s,
        integral=np.full(period.size, np.nan),
        monodromy=phi,
        residual=np.linalg.norm(end - x0, axis=0),
        labels=tuple(f"1:{n}, {z} km" for n, z in NEAR),
        length_m=scales.length_m,
        time_s=scales.time_s,
    )


@cache
def paths() -> tuple[ReferencePath, ...]:
    return tuple(paths_of_orbits(plant(), orbits()))


def test_states_of_a_periodic_reference() -> None:
    path = paths()[0]
    t = np.array([0.0, 0.3, 17.123, 60.0])
    start = np.repeat(orbits().x0[:, :1], t.size, axis=1) / path.flow.system.unit[:, None]
    flown = path.flow.plain.propagate(start, t, 2000)
    np.testing.assert_allclose(path.states(t), flown, rtol=0, atol=4e-9)
    assert path.period is not None
    np.testing.assert_allclose(path.states(t + 4 * path.period), flown, rtol=0, atol=4e-9)
    value, rate = path.interpolate(t)
    np.testing.assert_allclose(value, flown, rtol=0, atol=1e-6)
    np.testing.assert_allclose(rate, path.flow.rate(flown), rtol=0, atol=1e-4)


def test_transitions_are_chained() -> None:
    """Over a period they are the monodromy matrix, though nowhere integrated at a stretch."""
    for i, path in enumerate(paths()):
        whole = path.transitions(np.zeros(1), float(path.period or 0.0))[:, :, 0]
        size = np.max(np.abs(whole))
        np.testing.assert_allclose(whole, orbits().monodromy[:, :, i], rtol=0, atol=8e-6 * size)


def test_one_metre_in_one_period() -> None:
    """A metre grows to kilometres and to hundreds of them: one period cannot be flown there."""
    growth = [np.linalg.norm(orbits().monodromy[:3, :3, i], 2) for i in range(2)]
    assert 5e3 < growth[0] < 15e3
    assert 3e5 < growth[1] < 7e5
    e_folding_h = orbits().period_s / 3600.0 / np.log(np.abs(multipliers(orbits().monodromy)[0]))
    assert e_folding_h[1] == pytest.approx(11.36, abs=0.01)


def test_left_unstable_direction() -> None:
    for path in paths()[:2]:
        times = np.array([0.0, 5.0, 31.4, 70.0, 98.0])
        w = path.unstable_rows(times)
        assert w.shape == (1, 6, 5)
        np.testing.assert_allclose(np.linalg.norm(w[0], axis=0), 1.0, atol=1e-12)
        # the flow itself is the multiplier 1: it has no unstable component
        flow = path.flow.rate(path.states(times))
        across = np.sum(w[0] * flow, axis=0) / np.linalg.norm(flow, axis=0)
        np.testing.assert_allclose(across, 0.0, rtol=0, atol=1e-8)
        # carried forwards from the start it is the same direction
        for k, t in enumerate(times[1:3], start=1):
            phi = path.transitions(np.zeros(1), float(t))[:, :, 0]
            back = w[0, :, k] @ phi
            turned = back / np.linalg.norm(back) * np.sign(back @ w[0, :, 0])
            np.testing.assert_allclose(turned, w[0, :, 0], rtol=0, atol=1e-7)
    assert paths()[2].unstable == 0


def test_unstable_subspace_of_a_complex_quadruple() -> None:
    """Two directions, invariant under the matrix, for multipliers 2 e^±i and their inverses."""
    rng = np.random.default_rng(3)
    c, s = np.cos(1.0), np.sin(1.0)
    turn = np.array([[c, -s], [s, c]])
    middle = np.array([[1.0, 0.4], [0.0, 1.0]])
    diagonal = np.zeros((6, 6))
    diagonal[:2, :2], diagonal[2:4, 2:4], diagonal[4:, 4:] = 2.0 * turn, 0.5 * turn, middle
    basis = rng.normal(size=(6, 6))
    monodromy = basis @ diagonal @ np.linalg.inv(basis)
    w = unstable_left_subspace(monodromy)
    assert w.shape == (2, 6)
    image = w @ monodromy
    np.testing.assert_allclose(image - (image @ w.T) @ w, 0.0, rtol=0, atol=1e-10)
    np.testing.assert_allclose(np.abs(np.linalg.eigvals(image @ w.T)), 2.0, rtol=1e-9)


@pytest.mark.parametrize("i", [0, 1])
def test_first_correction_is_that_of_the_index(i: int) -> None:
    """Its standard deviation for Table 2's errors is sqrt(σ_v² + σ_r² |w_r|²/|w_v|²)."""
    path = paths()[i]
    unit = path.flow.system.unit
    sigma = np.array([100.0] * 3 + [0.03] * 3) / unit
    gain = path.floquet_gains(np.zeros(1))[:, :, 0]
    found = np.sqrt(np.trace(gain @ np.diag(sigma**2) @ gain.T))
    expected = correction_speed(orbits().monodromy[:, :, i : i + 1], sigma[0], sigma[3])
    assert found == pytest.approx(float(expected[0]), rel=1e-6)


def test_floquet_mode_nulls_the_unstable_component_with_the_least_impulse() -> None:
    path = paths()[0]
    unit = path.flow.system.unit
    law = FloquetMode(6 * 3600.0, path)
    rng = np.random.default_rng(5)
    t_s = np.full(40, 12 * 3600.0)
    time = t_s / path.flow.system.time_unit_s
    delta = rng.normal(size=(6, 40)) * 1e-5
    place = path.states(time)
    dv, slip = law.step(2, t_s, (place + delta) * unit[:, None], place, law.initial(40))
    dv = dv / unit[3]
    w = path.unstable_rows(time)[0]
    after = delta.copy()
    after[3:] += dv
    np.testing.assert_allclose(np.sum(w * after, axis=0), 0.0, rtol=0, atol=3e-8)
    least = np.sum(w * delta, axis=0) / np.linalg.norm(w[3:], axis=0)
    np.testing.assert_allclose(np.linalg.norm(dv, axis=0), np.abs(least), rtol=5e-3, atol=1e-8)
    # it is measured from the nearest point: a shift along the orbit asks for nothing
    shifted = path.states(time + 0.2)
    dv, slip = law.step(2, t_s, shifted * unit[:, None], place, law.initial(40))
    np.testing.assert_allclose(dv / unit[3], 0.0, rtol=0, atol=1e-5)
    np.testing.assert_allclose(slip / path.flow.system.time_unit_s, 0.2, rtol=0, atol=1e-6)


def test_laws_keep_the_contract() -> None:
    check_compensator(FloquetMode(3600.0, paths()[0]), 6, 3)
    gains = np.random.default_rng(1).normal(size=(4, 3, 6))
    check_compensator(GainSchedule(3600.0, gains), 6, 3)
    law = GainSchedule(3600.0, gains)
    with pytest.raises(InputError, match="correction 4 on 6 was asked for"):
        law.step(4, np.zeros(1), np.zeros((6, 1)), np.zeros((6, 1)), law.initial(1))
    with pytest.raises(InputError, match="finite"):
        GainSchedule(3600.0, gains * np.inf)


def cyclic(steps: Array) -> tuple[Array, Array]:
    """Return A and B of the time-invariant system whose Riccati solution holds that of each step.

    The cyclic reformulation of S. Bittanti, P. Colaneri (2009), Periodic Systems, Springer.
    """
    p = len(steps)
    a, b = np.zeros((6 * p, 6 * p)), np.zeros((6 * p, 3 * p))
    for k in range(p):
        to, at = 6 * ((k + 1) % p), 6 * k
        a[to : to + 6, at : at + 6] = steps[k]
        b[to : to + 6, 3 * k : 3 * k + 3] = steps[k][:, 3:]
    return a, b


@pytest.mark.parametrize("cycle", [12, 24])
def test_periodic_lqr_is_the_riccati_solution(cycle: int) -> None:
    """Against SciPy's solution of the algebraic equation of the cyclic reformulation."""
    path = paths()[0]
    assert path.period is not None
    sampling = Sampling(path, path.period / cycle, 3 * cycle)
    assert sampling.cycle == cycle
    gains = periodic_lqr_gains(sampling, WEIGHTS)
    np.testing.assert_array_equal(gains[:cycle], gains[cycle : 2 * cycle])
    a, b = cyclic(sampling.steps(cycle))
    q = np.kron(np.eye(cycle), np.diag([WEIGHTS.position**-2.0] * 3 + [WEIGHTS.velocity**-2.0] * 3))
    r = np.eye(3 * cycle) / WEIGHTS.impulse**2
    p = solve_discrete_are(a, b, q, r)
    whole = np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
    for k in range(cycle):
        expected = whole[3 * k : 3 * k + 3, 6 * k : 6 * k + 6]
        np.testing.assert_allclose(gains[k], expected, rtol=0, atol=1e-5 * np.max(np.abs(expected)))


def test_periodic_lqr_without_a_whole_number_of_intervals() -> None:
    """A finite sweep; far from its end it holds the orbit as linearised."""
    path = paths()[1]
    sampling = Sampling(path, 7.3, 60)
    assert sampling.cycle is None
    gains, steps = periodic_lqr_gains(sampling, WEIGHTS), sampling.steps(60)
    closed = np.eye(6)
    for k in range(40):
        kept = np.eye(6)
        kept[3:] -= gains[k]
        closed = steps[k] @ kept @ closed
    assert np.linalg.norm(closed, 2) < 0.05


def test_target_point_makes_its_sum_least() -> None:
    path = paths()[0]
    sampling = Sampling(path, 6.0, 5)
    gains, steps = target_point_gains(sampling, WEIGHTS), sampling.steps(8)
    rng = np.random.default_rng(2)

    def cost(k: int, delta: Array, dv: Array) -> float:
        state, total = delta + np.concatenate([np.zeros(3), dv]), dv @ dv / WEIGHTS.impulse**2
        for i in range(1, 4):
            state = steps[k + i - 1] @ state
            if i in WEIGHTS.targets:
                total += state[:3] @ state[:3] / WEIGHTS.position**2
        return float(total)

    for k in range(5):
        delta = rng.normal(size=6) * 0.01
        dv = -gains[k] @ delta
        least = cost(k, delta, dv)
        for _ in range(20):
            assert cost(k, delta, dv + 1e-4 * rng.normal(size=3)) > least


def test_flights_as_references() -> None:
    """The orbit cut into nodes: the same states, and the same unstable direction away from the end.

    Its end knows nothing of what comes after; the direction is found within a few e-foldings.
    """
    path = paths()[1]
    system = path.flow.system
    t = np.linspace(0.0, 130.0, 131)
    table = path.states(t) * system.unit[:, None]
    flights = Trajectories(
        system.frame, path.flow.names, ("plan",), ("coast",),
        np.append(t, np.nan)[:, None] * system.time_unit_s,
        np.concatenate([table, np.full((6, 1), np.nan)], axis=1)[:, :, None],
    )  # fmt: skip
    (found,) = paths_of_flights(plant(), flights)
    assert found.period is None
    assert found.length == pytest.approx(130.0)
    at = np.array([0.0, 0.25, 40.3, 129.9])
    np.testing.assert_allclose(found.states(at), path.states(at), rtol=0, atol=1e-8)
    assert found.unstable == 1
    at = np.array([0.0, 20.0, 50.0])
    alike = np.abs(np.sum(found.unstable_rows(at)[0] * path.unstable_rows(at)[0], axis=0))
    np.testing.assert_allclose(alike, 1.0, rtol=0, atol=1e-5)
    # a flight beside the equations is refused
    wrong = replace(flights, x=flights.x * 1.001)
    with pytest.raises(StageError, match="does not solve the equations of this stage's plant"):
        paths_of_flights(plant(), wrong)
    with pytest.raises(StageError, match="in other:frame"):
        paths_of_flights(plant(), replace(flights, frame="other:frame"))
    with pytest.raises(StageError, match="fewer than two states"):
        paths_of_flights(plant(), replace(flights, t_s=flights.t_s * np.nan))


def test_orbits_of_other_equations() -> None:
    with pytest.raises(StageError, match="do not solve the equations"):
        paths_of_orbits(plant(), replace(orbits(), x0=orbits().x0 * 1.001))
