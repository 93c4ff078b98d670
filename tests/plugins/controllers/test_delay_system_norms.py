"""H∞ and H2 norms of systems with delays: closed forms, dense samples, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize_scalar

import hillsphere_controllers as hc
from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.frequency import largest_gains
from hillsphere_controllers.delays.algebra import delay, feedback, with_delays
from hillsphere_controllers.delays.expansion import Pencil
from hillsphere_controllers.delays.gain_bounds import bound_gains
from hillsphere_controllers.delays.norms import h2_norm, hinf_norm
from hillsphere_controllers.delays.stability import judge_stability
from hillsphere_controllers.delays.system import DelaySystem
from hillsphere_controllers.systems.algebra import gain
from hillsphere_controllers.systems.conversion import transfer_function

INTEGRATOR = transfer_function([1.0], [1.0, 0.0])
LAG = transfer_function([1.0], [1.0, 1.0])


@pytest.mark.parametrize(("time_s", "tolerance"), [(1.0, 1e-9), (1.5, 1e-6), (1.5707, 1e-4)])
def test_delayed_integrator(time_s: float, tolerance: float) -> None:
    """|jω + e^{-jωT}|² = ω² + 1 − 2 ω sin ωT, whose minimum a search of one variable finds."""
    found = hinf_norm(feedback(INTEGRATOR, delay(time_s)), tolerance)
    least = minimize_scalar(
        lambda w: w * w + 1.0 - 2.0 * w * np.sin(w * time_s),
        bounds=(0.5, 1.5), method="bounded", options={"xatol": 1e-12},
    )  # fmt: skip
    exact = 1.0 / np.sqrt(least.fun)
    assert exact * (1.0 - tolerance) <= found.value <= exact * (1.0 + 1e-9)
    assert exact * (1.0 - 1e-9) <= found.upper <= found.value * (1.0 + tolerance)


def test_response_without_states() -> None:
    """1 + 0.5 e^{-sT} + …: the gains of the paths add up where their phases are equal."""
    found = hinf_norm(1.0 + 0.5 * delay(1.0))
    assert_allclose(found.upper, 1.5, rtol=1e-4)
    assert 1.4999 <= found.value <= 1.5
    several = hinf_norm(1.0 - 0.5 * delay(1.0) + 0.3 * delay(np.sqrt(2.0)))
    assert_allclose(several.upper, 1.8, rtol=1e-4)
    assert 1.75 <= several.value <= 1.8 * (1.0 + 1e-12)
    # 1/(1 − 0.5 e^{-sT}) is 2 at zero
    neutral = hinf_norm(feedback(1.0, 0.5 * delay(1.0), 1))
    assert_allclose([neutral.value, neutral.upper], 2.0, rtol=1e-4)


def test_peak_at_infinity() -> None:
    """(1 + 0.5 e^{-s}) s/(s + 1) comes as near to 1.5 as one likes."""
    found = hinf_norm((1.0 + 0.5 * delay(1.0)) @ transfer_function([1.0, 0.0], [1.0, 1.0]))
    assert 1.4999 <= found.value <= 1.5 <= found.upper <= 1.502


def test_delays_at_the_ends_change_no_norm() -> None:
    two = LtiSystem(
        np.diag([-1.0, -2.0]), np.array([[1.0, 0.5], [0.0, 2.0]]), np.eye(2), np.zeros((2, 2))
    )
    late = with_delays(with_delays(two, input_s=[1.0, 2.0], output_s=3.0), input_s=0.5)
    assert len(late.delays_s) == 6
    assert h2_norm(late) == hc.h2norm(two)
    assert hc.hinfnorm(late).value == hc.hinfnorm(two).value
    assert hc.h2norm(late) == hc.h2norm(two)
    # 1/√2 of 1/(s + 1) by hand
    assert_allclose(h2_norm(delay(1.0) @ LAG), np.sqrt(0.5), rtol=1e-12)
    assert h2_norm(delay(1.0) @ INTEGRATOR) == np.inf


@pytest.mark.parametrize(
    "system",
    [
        feedback(LAG, delay(2.0)),
        LAG @ (1.0 + delay(2.0)),  # two paths from one input
        LAG @ delay(2.0) @ LAG,  # between states
        (np.array([[1.0], [1.0]]) @ LAG) @ delay(2.0) + np.array([[1.0], [0.0]]) @ LAG,
    ],
)
def test_h2_norm_with_a_delay_inside_is_refused(system: DelaySystem) -> None:
    with pytest.raises(InputError, match="delays of 2 s are neither at one input nor"):
        h2_norm(system)


def test_a_norm_needs_stability() -> None:
    assert hinf_norm(feedback(INTEGRATOR, delay(2.0))).value == np.inf
    with pytest.raises(ConvergenceError, match="undecided"):
        hinf_norm(feedback(INTEGRATOR, delay(0.5 * np.pi)))
    with pytest.raises(InputError, match="tolerance"):
        hinf_norm(feedback(LAG, delay(1.0)), 0.0)


def random_loop(random: np.random.Generator, neutral: float) -> DelaySystem:
    a = random.normal(size=(4, 4)) - 2.5 * np.eye(4)
    d = random.normal(size=(4, 4)) * (random.random(size=(4, 4)) < 0.5)
    d[2:, 2:] *= neutral
    if not neutral:
        d[:2, 2:] = 0.0
    scale = 10.0 ** random.integers(-3, 4, size=4)
    b, c = random.normal(size=(4, 4)), 0.7 * random.normal(size=(4, 4))
    system = LtiSystem(a * scale[:, None] / scale, b * scale[:, None], c / scale, d)
    return DelaySystem(system, tuple(random.uniform(0.1, 3.0, size=2)))


@pytest.mark.parametrize("neutral", [0.0, 0.2])
def test_bounds_hold_at_dense_frequencies(neutral: float) -> None:
    random = np.random.default_rng(5)
    omega = np.concatenate([np.linspace(0.0, 40.0, 8001), np.geomspace(40.0, 1e4, 2000)])
    count = 0
    while count < 8:
        system = random_loop(random, neutral)
        if not judge_stability(system).stable:
            continue
        count += 1
        found = hinf_norm(system, 1e-3)
        largest = float(largest_gains(system.response(omega)).max())
        assert largest <= found.upper
        if np.isfinite(found.frequency_rad_s):
            there = largest_gains(system.response(np.array([found.frequency_rad_s])))[0]
            assert_allclose(found.value, there, rtol=1e-9)
        # direct terms with delays of two lengths have a looser bound
        assert found.upper <= found.value * (1.001 if not neutral else 2.0)
        assert found.value >= largest * 0.999


def test_bounds_of_intervals_hold_and_shrink_with_the_square() -> None:
    random = np.random.default_rng(2)
    pencil = Pencil.of(random_loop(random, 0.2))
    middle = np.full(3, 1.7)
    half = np.array([1e-2, 1e-3, 1e-4])
    gains, errors, uppers = bound_gains(pencil, middle, half)
    assert (errors < 1e-9 * gains).all()

    def gain_at(omega: Array) -> Array:
        return bound_gains(pencil, omega, np.zeros(omega.size))[0]

    for width, upper in zip(half, uppers, strict=True):
        assert gain_at(np.linspace(1.7 - width, 1.7 + width, 301)).max() <= upper
    # what is above the affine part falls by a hundred from one to the next
    ends = np.array([gain_at(np.array([1.7 - h, 1.7 + h])).max() for h in half])
    rest = uppers - ends
    assert rest[1] < rest[0] / 50.0
    assert rest[2] < rest[1] / 50.0


def test_systems_without_signals() -> None:
    assert hinf_norm(DelaySystem(gain(np.zeros((1, 1))), (1.0,))).value == 0.0
