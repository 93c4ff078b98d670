"""The step map against exact solutions, and its derivatives, steps, events and array terms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import pi, sqrt
from typing import Any, Literal, cast

import numpy as np
import pytest

from hillsphere.cli.self_test import kepler_state
from hillsphere.dynamics import Derivatives, StepMap, System, Taylor, system
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.symbolic import Expr, Params, cos, dot, exp, norm, sin, variable

Law = Callable[[tuple[Expr, ...], tuple[Expr, ...], Expr, Params], tuple[Expr, ...]]


@dataclass(frozen=True)
class Equations:
    """A plant of one law, in units of order one."""

    law: Law
    states: tuple[Variable, ...]
    values: Mapping[str, float] = field(default_factory=dict)
    controls: tuple[Variable, ...] = ()
    watched: Mapping[str, Callable[[tuple[Expr, ...], Expr], Expr]] = field(default_factory=dict)
    scales: Scales = field(default_factory=lambda: Scales(1.0, 1.0))
    frame: str = "inertial"

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(Parameter(name, value) for name, value in self.values.items())

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        return self.law(x, u, t, p)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        return {name: function(x, t) for name, function in self.watched.items()}


def planar(*names: str) -> tuple[Variable, ...]:
    return tuple(Variable(name, 1, -1 if name.startswith("v") else 0) for name in names)


def kepler_law(x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
    pull = -p["gm"] * norm(x[:3]) ** -3.0
    return (*x[3:], *(pull * c for c in x[:3]))


KEPLER = Equations(kepler_law, planar("x", "y", "z", "vx", "vy", "vz"), {"gm": 1.0})
OSCILLATOR = Equations(
    lambda x, u, t, p: (x[1], -p["k"] * x[0] + (u[0] if u else 0.0)),
    planar("x", "v"),
    {"k": 4.0},
    (Variable("push"),),
    {"ground": lambda x, t: x[0] + 0.5, "late": lambda x, t: t - 1.25},
)

PENDULUM = Equations(lambda x, u, t, p: (x[1], -1.0 * sin(x[0]) + cos(t)), planar("x", "v"))


def arenstorf_law(x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
    mu = 0.012277471
    q = 1.0 - mu
    d1 = dot([x[0] + mu, x[1]], [x[0] + mu, x[1]]) ** 1.5
    d2 = dot([x[0] - q, x[1]], [x[0] - q, x[1]]) ** 1.5
    return (
        x[2],
        x[3],
        x[0] + 2.0 * x[3] - q * (x[0] + mu) / d1 - mu * (x[0] - q) / d2,
        x[1] - 2.0 * x[2] - q * x[1] / d1 - mu * x[1] / d2,
    )


@pytest.mark.parametrize("method", ["rk6", "dop853"])
def test_harmonic_oscillator(method: str) -> None:
    step_map = StepMap(system(OSCILLATOR), method)
    x0 = np.array([[1.0, 0.0, -2.0], [0.0, 3.0, 0.5]])
    t = np.array([1.7, -2.3, 5.0])
    c, s = np.cos(2 * t), np.sin(2 * t)
    exact = np.array([x0[0] * c + x0[1] / 2 * s, -2 * x0[0] * s + x0[1] * c])
    steps = {"rk6": 800, "dop853": 200}[method]
    np.testing.assert_allclose(step_map.propagate(x0, t, steps), exact, rtol=0, atol=3e-13)
    # One step of the map is what propagate repeats.
    y = x0
    for _ in range(steps):
        y = step_map.step(y, t / steps)
    np.testing.assert_array_equal(y, step_map.propagate(x0, t, steps))


@pytest.mark.parametrize("eccentricity", [0.0, 0.3, 0.6])
def test_kepler_closed_form(eccentricity: float) -> None:
    step_map = StepMap(system(KEPLER))
    x0 = kepler_state(0.0, eccentricity)
    times = np.array([0.5, 2.0, 2 * pi, -4.0])
    found = step_map.propagate(np.repeat(x0[:, None], 4, axis=1), times, 600)
    exact = np.array([kepler_state(t, eccentricity) for t in times]).T
    np.testing.assert_allclose(found, exact, rtol=0, atol=6e-13)  # measured 1.5e-13, at e = 0.6


def test_arenstorf_orbit_closes() -> None:
    # Hairer, Nørsett, Wanner (1993), section II.0, eqs (0.1), (0.2): period 17.065216560157962…
    step_map = StepMap(system(Equations(arenstorf_law, planar("x", "y", "vx", "vy"))))
    x0 = np.array([0.994, 0.0, 0.0, -2.00158510637908252240537862224])
    period = 17.0652165601579625588917206249
    # Fixed steps must resolve the pass within 0.006 of the Moon; measured closure 1.7e-8.
    end = step_map.propagate(x0, period, 30000)
    assert np.abs(end - x0).max() < 7e-8


def test_time_dependent_equations() -> None:
    # ẋ = x cos t − sin 2t e^{sin t}: x = (x0 + cos²t − 1) e^{sin t}; and ẏ = 2t.
    law = Equations(
        lambda x, u, t, p: (x[0] * cos(t) - sin(2.0 * t) * exp(sin(t)), 2.0 * t),
        (Variable("x"), Variable("y")),
    )
    starts, x0 = np.array([0.0, 0.4, 2.0]), np.array([[2.0, 1.0, 0.3], [0.0, 1.0, 2.0]])
    end = starts + 3.0
    for method in ("rk6", "dop853"):
        found = StepMap(system(law), method).propagate(x0, 3.0, 300, t0=starts)
        free = x0[0] * np.exp(-np.sin(starts)) - np.cos(starts) ** 2
        np.testing.assert_allclose(
            found[0], (free + np.cos(end) ** 2) * np.exp(np.sin(end)), rtol=1e-12
        )
        np.testing.assert_allclose(found[1], x0[1] + end**2 - starts**2, rtol=3e-14)


def test_run_time_parameters_and_controls() -> None:
    late = StepMap(system(OSCILLATOR, run_time=["k"], controls=True))
    x0 = np.array([[1.0, 1.0, 1.0], [0.5, 0.5, 0.5]])
    k, push = np.array([4.0, 9.0, 1.0]), np.array([0.0, 0.0, 0.7])
    found = late.propagate(x0, 1.3, 100, [k, push])
    w = np.sqrt(k)
    still = push / k
    exact = still + (1.0 - still) * np.cos(1.3 * w) + 0.5 / w * np.sin(1.3 * w)
    np.testing.assert_allclose(found[0], exact, rtol=1e-14)
    constant = StepMap(system(OSCILLATOR)).propagate(x0, 1.3, 100)
    np.testing.assert_allclose(found[:, 0], constant[:, 0], rtol=1e-14)
    np.testing.assert_allclose(late.propagate(x0, 1.3, 100), constant, rtol=1e-14)


def test_single_lane_loses_its_axis() -> None:
    s = system(KEPLER)
    x0 = kepler_state(0.0, 0.3)
    plain, both = StepMap(s), StepMap(s, stm=True)
    assert plain.propagate(x0, 1.0, 20).shape == (6,)
    assert plain.trajectory(x0, 1.0, 20).shape == (6, 21)
    assert [part.shape for part in both.step(x0, 0.1)] == [(6,), (6, 6)]
    assert [part.shape for part in both.step(x0[:, None], 0.1)] == [(6, 1), (6, 6, 1)]
    found = plain.locate(s.x[1], x0, 4.0, 40, direction=0, after=0.1)
    assert found.x.shape == (6,)
    assert found.phi is None
    assert float(found.time) == pytest.approx(pi, abs=1e-9)


def test_trajectory_passes_through_the_closed_form() -> None:
    step_map = StepMap(system(KEPLER))
    x0 = np.array([kepler_state(0.0, e) for e in (0.1, 0.4)]).T
    duration = np.array([4.0, -3.0])
    found = step_map.trajectory(x0, duration, 200)
    assert found.shape == (6, 201, 2)
    np.testing.assert_array_equal(found[:, 0], x0)
    np.testing.assert_array_equal(found[:, -1], step_map.propagate(x0, duration, 200))
    for j in (37, 120):
        exact = [kepler_state(j / 200 * d, e) for d, e in zip(duration, (0.1, 0.4), strict=True)]
        np.testing.assert_allclose(found[:, j], np.array(exact).T, rtol=0, atol=1e-13)


def test_the_start_is_left_alone() -> None:
    x0 = np.ascontiguousarray(np.repeat(kepler_state(0.0, 0.3)[:, None], 5, axis=1))
    kept = x0.copy()
    StepMap(system(KEPLER)).propagate(x0, 2.0, 7)
    np.testing.assert_array_equal(x0, kept)


def test_stm_is_the_derivative_and_symplectic() -> None:
    s = system(KEPLER, run_time=["gm"])
    with_stm = StepMap(s, stm=True, parameters=["gm"])
    x0 = np.array([[1.0, 0.1, 0.2, -0.1, 0.9, 0.3], [0.6, -0.5, 0.1, 0.4, 1.0, 0.0]]).T
    gm = np.array([[1.0, 1.1]])
    end, phi = with_stm.propagate(x0, 4.0, 200, gm)
    plain = StepMap(s)
    np.testing.assert_allclose(end, plain.propagate(x0, 4.0, 200, gm), rtol=0, atol=5e-14)
    assert phi.shape == (6, 7, 2)

    J = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.eye(3), np.zeros((3, 3))]])
    step = 5e-5
    for lane in range(2):
        M = phi[:, :6, lane]
        np.testing.assert_allclose(M.T @ J @ M, J, rtol=0, atol=1e-12)  # measured 2.5e-13
        assert np.linalg.det(M) == pytest.approx(1.0, abs=2e-13)
    # Central differences of the plain map with one Richardson extrapolation: error step⁴.
    for j in range(7):
        columns = []
        for h in (step, 2 * step):
            up, down, p_up, p_down = x0.copy(), x0.copy(), gm.copy(), gm.copy()
            if j < 6:
                up[j] += h
                down[j] -= h
            else:
                p_up += h
                p_down -= h
            high = plain.propagate(up, 4.0, 200, p_up)
            columns.append((high - plain.propagate(down, 4.0, 200, p_down)) / (2 * h))
        expected = (4 * columns[0] - columns[1]) / 3
        np.testing.assert_allclose(phi[:, j], expected, rtol=0, atol=2e-9)  # measured 5e-10


def test_stm_of_the_oscillator_by_state_parameter_and_control() -> None:
    s = system(OSCILLATOR, run_time=["k"], controls=True)
    _, phi = StepMap(s, stm=True, parameters=["k", "u:push"]).propagate([1.0, 0.5], 1.3, 60)
    w, t = 2.0, 1.3
    c, sn = np.cos(w * t), np.sin(w * t)
    expected = np.array(
        [
            # ∂/∂k through ω = √k: ∂ω/∂k = 1/(2ω); ∂/∂u = (1 − cos ωt)/ω².
            [c, sn / w, (-t * sn + 0.5 * (t * c / w - sn / w**2)) / (2 * w), (1 - c) / w**2],
            [-w * sn, c, (-sn - w * t * c - 0.5 * t * sn) / (2 * w), sn / w],
        ]
    )
    np.testing.assert_allclose(phi, expected, rtol=1e-14)


def test_choose_steps_meets_the_tolerance_and_not_by_far() -> None:
    x0 = np.array([kepler_state(0.0, e) for e in (0.05, 0.3, 0.5)]).T
    for method in ("rk6", "dop853"):
        step_map = StepMap(system(KEPLER), method)
        exact = np.array([kepler_state(5.0, e) for e in (0.05, 0.3, 0.5)]).T
        for tol in (1e-6, 1e-9, 1e-12):
            n = step_map.choose_steps(x0, 5.0, tol)
            error = np.abs(step_map.propagate(x0, 5.0, n) - exact).max()
            assert tol / 200 < error < 1.5 * tol


def test_choose_steps_measures_in_natural_units() -> None:
    # The same orbit a million times larger and slower: differences count in units of the plant.
    length, gm, time_s = 1e6, 1e6, 1e6
    big = Equations(kepler_law, KEPLER.states, {"gm": gm}, scales=Scales(length, time_s))
    assert gm * time_s**2 / length**3 == pytest.approx(1.0)
    x0 = kepler_state(0.0, 0.3)
    small = StepMap(system(KEPLER)).choose_steps(x0, 5.0, 1e-9)
    physical = system(big)
    n = StepMap(physical).choose_steps(x0 * physical.scale, 5.0 * time_s, 1e-9)
    assert abs(n - small) <= 1
    with_stm = [
        StepMap(system(big, normalised=unit), stm=True).choose_steps(
            x0 if unit else x0 * physical.scale, 5.0 * (1.0 if unit else time_s), 1e-9
        )
        for unit in (False, True)
    ]
    assert abs(with_stm[0] - with_stm[1]) <= 1


def test_difference_of_states_and_stm_by_hand() -> None:
    """Units of 2 m and 4 m/s: [[6, 1], [2, 3]] is [[6, 2], [1, 3]] in them, 6 its largest."""
    plant = Equations(OSCILLATOR.law, OSCILLATOR.states, {"k": 4.0}, scales=Scales(2.0, 0.5))
    step_map = StepMap(system(plant), stm=True)
    fine = np.array([[1.0], [2.0], [6.0], [1.0], [2.0], [3.0]])
    for row, change, expected in ((0, 0.1, 0.05), (1, 0.1, 0.025), (3, 0.3, 0.1), (4, 0.3, 0.025)):
        coarse = fine.copy()
        coarse[row] -= change
        assert step_map._difference(coarse, fine) == pytest.approx(expected, rel=1e-12)
        assert step_map._difference(fine, fine) == 0.0
        coarse[row] = np.nan
        assert step_map._difference(coarse, fine) == step_map._difference(fine, coarse) == np.inf


def test_choose_steps_says_when_it_cannot() -> None:
    step_map = StepMap(system(KEPLER))
    x0 = kepler_state(0.0, 0.3)
    with pytest.raises(PropagationError, match="below the rounding error"):
        step_map.choose_steps(x0, 5.0, 1e-17)
    with pytest.raises(PropagationError, match="64 steps do not meet the tolerance 1e-12"):
        step_map.choose_steps(x0, 50.0, 1e-12, most=64)
    # A fall through the centre has no step small enough.
    with pytest.raises(PropagationError, match="may meet a singularity"):
        step_map.choose_steps([1.0, 0, 0, 0, 0, 0], 2.0, 1e-10, most=4096)
    with pytest.raises(InputError, match="tol must be positive"):
        step_map.choose_steps(x0, 5.0, 0.0)


def test_non_finite_lanes_are_named() -> None:
    law = Equations(lambda x, u, t, p: (x[0] * x[0],), (Variable("x"),))
    step_map = StepMap(system(law))
    x0 = np.array([[0.1, 5.0, 0.2, 7.0]])
    with pytest.raises(PropagationError, match=r"lanes 1, 3 \(of 4\) turned non-finite \(dop853"):
        step_map.propagate(x0, 3.0, 40)
    with pytest.raises(PropagationError, match=r"lane 0 \(of 1\)"):
        step_map.step([[1e200]], 1.0)
    assert not np.isfinite(step_map.step([[1e200]], 1.0, strict=False)).any()
    with pytest.raises(PropagationError, match="lanes 1, 3"):
        step_map.trajectory(x0, 3.0, 40)
    with pytest.raises(PropagationError, match=r"lane 1 \(of 2\)"):
        step_map.locate(variable("x") - 0.11, x0[:, :2] * [1, -1e9], 1.0, 40, direction=1)
    lenient = step_map.propagate(x0, 3.0, 40, strict=False)
    assert np.isfinite(lenient).tolist() == [[True, False, True, False]]
    np.testing.assert_allclose(lenient[0, [0, 2]], [0.1 / 0.7, 0.2 / 0.4], rtol=1e-14)


@pytest.mark.parametrize(
    ("x", "duration", "steps", "message"),
    [
        (np.zeros(3), 1.0, 4, r"x must be \(2,\) or \(2, N\)"),
        (np.zeros((2, 1, 1)), 1.0, 4, "x must be"),
        (np.array([[1.0, np.nan], [0.0, 0.0]]), 1.0, 4, r"lane 1 \(of 2\) start with non-finite"),
        (np.zeros((2, 3)), np.ones(2), 4, r"duration must be a number or \(3,\), got \(2,\)"),
        (np.zeros((2, 3)), np.inf, 4, "duration must be finite"),
        (np.zeros((2, 3)), 1.0, 0, "steps must be at least 1"),
        (np.zeros((2, 3)), 1.0, 2.5, r"steps must be a whole number, got 2\.5"),
    ],
)
def test_bad_arguments(x: Array, duration: Array | float, steps: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        StepMap(system(OSCILLATOR)).propagate(x, duration, steps)


def test_steps_may_be_an_integer_of_numpy() -> None:
    step_map, x0 = StepMap(system(OSCILLATOR)), np.array([1.0, 0.0])
    found = step_map.trajectory(x0, 1.0, cast(int, np.int64(4)))
    np.testing.assert_array_equal(found, step_map.trajectory(x0, 1.0, 4))


@pytest.mark.parametrize("stm", [False, True])
def test_no_lanes_give_empty_results(stm: bool) -> None:
    s = system(OSCILLATOR, run_time=["k"])
    step_map, none = StepMap(s, stm=stm), np.zeros((2, 0))
    for p in (None, [4.0], np.zeros((1, 0))):
        found = step_map.propagate(none, np.zeros(0), 4, p)
        x, phi = found if stm else (found, np.zeros((2, 2, 0)))
        assert (x.shape, phi.shape) == ((2, 0), (2, 2, 0))
    assert step_map.trajectory(none, 1.0, 4).shape == (2, 5, 0)
    assert step_map.choose_steps(none, 1.0, 1e-9) >= 1
    crossing = step_map.locate("ground", none, 1.0, 4)
    assert (crossing.found.shape, crossing.time.shape, crossing.x.shape) == ((0,), (0,), (2, 0))
    assert s.function(*s.rhs)(none, [4.0]).shape == (2, 0)


def test_bad_configuration() -> None:
    with pytest.raises(InputError, match="no Runge-Kutta formula 'euler'"):
        StepMap(system(OSCILLATOR), "euler")
    with pytest.raises(InputError, match="give stm=True"):
        StepMap(system(OSCILLATOR, run_time=["k"]), parameters=["k"])
    with pytest.raises(InputError, match="the run-time parameters are"):
        StepMap(system(OSCILLATOR), stm=True, parameters=["k"])


def test_compact_mode_flies_the_same() -> None:
    s = system(KEPLER)
    x0 = kepler_state(0.0, 0.3)
    a, b = (StepMap(s, compact=c).propagate(x0, 3.0, 50) for c in (False, True))
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-14)


# ---- events --------------------------------------------------------------------------------


def test_events_against_closed_form() -> None:
    # x = a cos 2t falls through −1/2 at t = acos(−1/(2a))/2, and not at all for a < 1/2.
    step_map = StepMap(system(OSCILLATOR), stm=True)
    a = np.array([1.0, 2.0, 0.4, 0.75, 3.0])
    x0 = np.array([a, np.zeros(5)])
    found = step_map.locate("ground", x0, 3.0, 120)
    assert found.found.tolist() == [True, True, False, True, True]
    exact = np.arccos(-0.5 / a[found.found]) / 2
    np.testing.assert_allclose(found.time[found.found], exact, rtol=0, atol=3e-15)
    assert np.isnan(found.time[2])
    np.testing.assert_allclose(found.x[0, found.found], -0.5, rtol=0, atol=2e-15)
    np.testing.assert_array_equal(found.x[:, 2], step_map.propagate(x0, 3.0, 120)[0][:, 2])
    assert found.phi is not None
    c, s = np.cos(2 * exact), np.sin(2 * exact)
    expected = np.array([[c, s / 2], [-2 * s, c]])
    np.testing.assert_allclose(found.phi[:, :, found.found], expected, rtol=0, atol=8e-15)


@pytest.mark.parametrize(
    ("direction", "after", "duration", "expected"),
    [
        (-1, 0.0, 9.0, pi / 4),
        (1, 0.0, 9.0, 3 * pi / 4),
        (0, 0.0, 9.0, pi / 4),
        (0, 1.0, 9.0, 3 * pi / 4),
        (-1, 1.0, 9.0, 5 * pi / 4),
        # Backwards the same crossings count along the flight.
        (-1, 0.0, -9.0, -pi / 4),
        (1, 0.0, -9.0, -3 * pi / 4),
        (-1, -1.0, -9.0, -5 * pi / 4),
    ],
)
def test_direction_and_waiting(
    direction: Literal[-1, 0, 1], after: float, duration: float, expected: float
) -> None:
    s = system(OSCILLATOR)
    found = StepMap(s).locate(
        s.x[0],
        [1.0, 0.0],
        duration,
        300,
        t0=10.0,
        direction=direction,
        after=after,
    )
    assert bool(found.found)
    assert float(found.time) == pytest.approx(10.0 + expected, abs=1e-12)


def test_zero_at_the_start_is_not_a_crossing() -> None:
    s = system(OSCILLATOR)
    found = StepMap(s).locate(s.x[0], [0.0, 1.0], 4.0, 100, direction=0)
    assert float(found.time) == pytest.approx(pi / 2, abs=1e-12)


def test_events_of_time_and_of_the_end_of_a_step() -> None:
    s = system(OSCILLATOR)
    x0 = np.array([[1.0, 1.0], [0.0, 0.0]])
    found = StepMap(s).locate("late", x0, [2.0, 4.0], 16, direction=1)
    # The first lane meets it exactly at the end of a step.
    np.testing.assert_allclose(found.time, 1.25, rtol=1e-15)
    np.testing.assert_allclose(found.x[0], np.cos(2.5), rtol=3e-9)


def test_no_lane_depends_on_the_others() -> None:
    s = system(OSCILLATOR)
    step_map = StepMap(s)
    a = np.linspace(0.6, 3.0, 8)
    x0 = np.array([a, 0.1 * a])
    whole = step_map.locate("ground", x0, 3.0, 90)
    other = x0.copy()
    other[:, 1:] *= np.linspace(0.2, 5.0, 7)
    again = step_map.locate("ground", other, 3.0, 90)
    assert whole.time[0] == again.time[0]
    np.testing.assert_array_equal(whole.x[:, 0], again.x[:, 0])


def test_no_bit_of_a_lane_depends_on_its_place() -> None:
    # A vector's cosine and a single number's differ in the last bit for about three arguments in a
    # hundred; the lanes beyond the last whole vector are evaluated like the others.
    step_map = StepMap(system(PENDULUM))
    x0 = np.array([np.linspace(-3.0, 3.0, 400), np.linspace(-1.0, 1.0, 400)])
    whole = step_map.propagate(x0, 4.0, 5)
    for first in range(0, 397, 3):
        few = slice(first, first + 3)
        np.testing.assert_array_equal(step_map.propagate(x0[:, few], 4.0, 5), whole[:, few])


def test_periapsis_of_kepler_orbits_by_an_expression() -> None:
    s = system(KEPLER)
    x0 = np.array([kepler_state(1.0, e) for e in (0.05, 0.3, 0.6)]).T
    radial = dot(s.x[:3], s.x[3:])
    found = StepMap(s).locate(radial, x0, 8.0, 900, direction=1, after=0.1)
    # Started at t = 1 after pericentre with period 2π; measured 5e-14.
    np.testing.assert_allclose(found.time, 2 * pi - 1.0, rtol=0, atol=3e-13)
    np.testing.assert_allclose(np.linalg.norm(found.x[:3], axis=0), [0.95, 0.7, 0.4], rtol=1e-13)


def test_unknown_event() -> None:
    with pytest.raises(InputError, match="no event 'impact'; the system has: ground, late"):
        StepMap(system(OSCILLATOR)).locate("impact", [1.0, 0.0], 1.0, 10)


# ---- terms that are functions of arrays ----------------------------------------------------


@dataclass(frozen=True)
class ArrayKepler(Equations):
    """Kepler's problem with its gravity in numpy instead of in symbols."""

    external: tuple[Variable, ...] = (
        Variable("gx", 1, -2), Variable("gy", 1, -2), Variable("gz", 1, -2),
    )  # fmt: skip

    def external_array(self, x: Array, t: Array, p: Array) -> Array:
        r = np.sqrt((x[:3] ** 2).sum(axis=0))
        return np.asarray(-p[0] * x[:3] / r**3)

    def external_jacobian(self, x: Array, t: Array, p: Array) -> Array:
        r = np.sqrt((x[:3] ** 2).sum(axis=0))
        table = np.zeros((3, 6, x.shape[1]))
        outer = x[:3, None] * x[None, :3]
        table[:, :3] = p[0] * (3 * outer / r**5 - np.eye(3)[:, :, None] / r**3)
        return table


LENGTH, TIME = 3.0e4, 5.0e3
SI_GM = LENGTH**3 / TIME**2


def tidal_law(x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
    """Kepler with a tide along x that swings with time, and a push along z."""
    tide = 0.1 / TIME**2 * x[0] * (1.0 + 0.2 * cos(t / TIME))
    gx, gy, gz = (-p["gm"] * c * norm(x[:3]) ** -3.0 for c in x[:3])
    return (*x[3:], gx + tide, gy, gz + (u[0] if u else 0.0))


def tidal_law_with_array(
    x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
) -> tuple[Expr, ...]:
    tide = 0.1 / TIME**2 * x[0] * (1.0 + 0.2 * cos(t / TIME))
    return (*x[3:], variable("gx") + tide, variable("gy"), variable("gz") + u[0])


def pair(normalised: bool) -> tuple[System, System]:
    arguments = (
        KEPLER.states,
        {"gm": SI_GM},
        (Variable("push", 1, -2),),
        {"near": lambda x, t: norm(x[:3]) - 0.8 * LENGTH},
        Scales(LENGTH, TIME),
    )
    symbolic = Equations(tidal_law, *arguments)
    array = ArrayKepler(tidal_law_with_array, *arguments)
    first, second = (
        system(plant, run_time=["gm"], normalised=normalised, controls=True)
        for plant in (symbolic, array)
    )
    return first, second


@pytest.mark.parametrize("normalised", [False, True])
@pytest.mark.parametrize("method", ["rk6", "dop853"])
def test_array_terms_fly_like_symbols(method: str, normalised: bool) -> None:
    symbolic, array = pair(normalised)
    assert symbolic.external is None
    assert array.external is not None
    hat = np.array([[1.0, 0.1, 0.2, -0.1, 0.9, 0.3], [0.8, -0.5, 0.1, 0.4, 0.9, 0.0]]).T
    x0 = hat * symbolic.scale[:, None]
    clock = 1.0 if normalised else TIME
    p = np.array([[SI_GM, 1.2 * SI_GM], [0.0, 0.02 * LENGTH / TIME**2]])
    t0 = np.array([0.3, 0.0]) * clock

    maps = [StepMap(s, method, stm=True, parameters=["u:push"]) for s in (symbolic, array)]
    (x1, phi1), (x2, phi2) = (m.propagate(x0, 4.0 * clock, 150, p, t0) for m in maps)
    scale = symbolic.scale
    np.testing.assert_allclose(x2 / scale[:, None], x1 / scale[:, None], rtol=0, atol=2e-13)
    by = np.append(scale, LENGTH / TIME**2)
    factor = (by / scale[:, None])[:, :, None]
    np.testing.assert_allclose(phi2 * factor, phi1 * factor, rtol=0, atol=1e-11)

    none, no_phi = maps[1].propagate(x0[:, :0], 4.0 * clock, 2)
    assert (none.shape, no_phi.shape) == ((6, 0), (6, 7, 0))

    plain1, plain2 = (StepMap(s, method) for s in (symbolic, array))
    a, b = (m.trajectory(x0, 4.0 * clock, 150, p, t0) for m in (plain1, plain2))
    np.testing.assert_allclose(
        b / scale[:, None, None], a / scale[:, None, None], rtol=0, atol=2e-13
    )
    assert plain2.choose_steps(x0, 2.0 * clock, 1e-9, p) == pytest.approx(
        plain1.choose_steps(x0, 2.0 * clock, 1e-9, p), abs=1
    )
    c, d = (m.locate("near", x0, 4.0 * clock, 150, p, t0) for m in (plain1, plain2))
    assert c.found.any()
    np.testing.assert_array_equal(c.found, d.found)
    np.testing.assert_allclose(d.time / clock, c.time / clock, rtol=0, atol=1e-12)


def test_array_terms_have_exact_derivatives() -> None:
    symbolic, array = pair(True)
    x = np.array([[1.0, 0.1, 0.2, -0.1, 0.9, 0.3], [0.8, -0.5, 0.1, 0.4, 0.9, 0.0]]).T
    (f1, A1), (f2, A2) = (Derivatives(s, ["u:push"]).both(x, t=0.4) for s in (symbolic, array))
    np.testing.assert_allclose(f2, f1, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(A2, A1, rtol=1e-13, atol=2e-15)


def test_what_array_terms_cannot_do() -> None:
    _, array = pair(True)
    with pytest.raises(InputError, match="use StepMap"):
        Taylor(array)
    with pytest.raises(InputError, match=r"may depend on \['gm'\]"):
        StepMap(array, stm=True, parameters=["gm"])


@dataclass(frozen=True)
class Misshapen(ArrayKepler):
    """Array terms of the wrong shapes."""

    def external_array(self, x: Array, t: Array, p: Array) -> Array:
        return super().external_array(x, t, p)[: 2 if t[0] == 1.0 else 3]

    def external_jacobian(self, x: Array, t: Array, p: Array) -> Array:
        return np.zeros((3, 3, x.shape[1]))


def test_array_terms_of_the_wrong_shape() -> None:
    plant = Misshapen(tidal_law_with_array, KEPLER.states, {"gm": 1.0}, (Variable("push"),))
    x0 = kepler_state(0.0, sqrt(0.5))
    with pytest.raises(InputError, match=r"external_array must return \(3, 1\), got \(2, 1\)"):
        StepMap(system(plant)).propagate(x0, 1.0, 2, t0=1.0)
    with pytest.raises(InputError, match=r"external_jacobian must return \(3, 6, 1\)"):
        StepMap(system(plant), stm=True).propagate(x0, 1.0, 2)


def test_errors_of_given_steps_are_told_lane_by_lane() -> None:
    """Kepler orbits from round to grazing: the true errors, by Kepler's equation, within twice."""
    eccentricity = np.array([0.0, 0.3, 0.6, 0.97])
    x = np.zeros((6, 4))
    x[0], x[4] = 1.0 - eccentricity, np.sqrt((1.0 + eccentricity) / (1.0 - eccentricity))
    flow = StepMap(system(KEPLER))
    told = flow.estimate_errors(x, 2.0 * pi, 60)
    true = np.abs(flow.propagate(x, 2.0 * pi, 60) - x).max(axis=0)
    assert (true[:3] < 2.0 * told[:3] + 1e-14).all()
    assert (told[:3] < 2.0 * true[:3] + 1e-14).all()
    assert told[3] > 0.1  # hopeless, and told
    kept = told < 1e-3
    np.testing.assert_array_equal(kept, [True, True, True, False])
    adaptive = Taylor(flow.system).propagate(x[:, ~kept], 2.0 * pi)
    np.testing.assert_allclose(adaptive, x[:, ~kept], atol=1e-9)
