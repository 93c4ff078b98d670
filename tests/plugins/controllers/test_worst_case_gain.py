"""Worst-case gains of loops whose direct terms lead only from performance to Δ, in closed form."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator

import numpy as np
import pytest

import hillsphere_controllers as hc
from hillsphere.lti import LtiSystem
from hillsphere_controllers.linear_fractional.algebra import join_inputs
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.mu.gain_division import divide_gain
from hillsphere_controllers.mu.robustness import performance_structure

INTEGRATOR = hc.transfer_function([1], [1, 0])
HALF = 2.0 / np.sqrt(3.0)
"""With L = (1 + δ/2)/s, |δ| ≤ 1: at ω the largest |L/(1 + L)| is 1/(√(16 ω²/9 + 1) − 2ω/3), since
1/(1 + δ/2) fills the disc of radius 2/3 about 4/3, and the largest |1/(1 + L)| is
ω/(√(1 + ω²) − 1/2). Their maxima are both 2/√3, at ω = √3/4 and √3."""


@pytest.fixture(autouse=True)
def no_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def times(name: str, share: float, size: int = 1) -> Lft:
    """Return I + share · Δ."""
    return np.eye(size) + share * hc.ultidyn(name, (size, size))


def discrete(dt_s: float) -> LtiSystem:
    one = np.eye(1)
    return LtiSystem(one, dt_s * one, one, 0.0 * one, dt_s)


def on_grid(response: Callable[[np.ndarray], np.ndarray], *shares: float) -> float:
    """Return the largest |L/(1 + L)| over frequencies and the phases of blocks of unit size."""
    phases = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 361))
    factor = np.ones(1)
    for share in shares:
        factor = np.outer(factor, 1.0 + share * phases).ravel()
    omega = np.geomspace(0.1, 10.0, 400)
    loops = (one * factor for one in response(omega))
    return max(float(np.abs(loop / (1.0 + loop)).max()) for loop in loops)


@pytest.mark.parametrize(
    ("loop", "right"),
    [
        (lambda: hc.feedback(INTEGRATOR * times("d", 0.5), 1), HALF),
        (lambda: hc.feedback(times("d", 0.5) * INTEGRATOR, 1), HALF),
        (lambda: hc.feedback(1, INTEGRATOR * times("d", 0.5)), HALF),
        (lambda: hc.feedback(INTEGRATOR, times("d", 0.5)), 2.0),  # 1/(1 − 1/2) at rest
        (lambda: hc.feedback(INTEGRATOR * hc.ureal("k", 1.0, percentage=50), 1), 1.0),
        (
            lambda: hc.feedback(
                hc.append(INTEGRATOR, INTEGRATOR) * times("D", 0.5, 2), np.eye(2)
            ),
            HALF,
        ),
    ],
    ids=["input", "output", "sensitivity", "return path", "real", "two channels"],
)  # fmt: skip
def test_the_known_gain_is_between_the_bounds(loop: Callable[[], Lft], right: float) -> None:
    found = hc.wcgain(loop())
    assert found.lower_bound == pytest.approx(right, rel=1e-6)
    assert right * (1.0 - 1e-9) <= found.upper_bound <= 1.011 * right


def test_several_blocks_and_discrete_time() -> None:
    two = INTEGRATOR * times("d", 0.5) * times("e", 0.2)
    sampled = discrete(0.1) * times("d", 0.5)
    with_real = two * hc.ureal("k", 1.0, percentage=1e-6)
    right = on_grid(lambda w: 1.0 / (1j * w), 0.5, 0.2)
    in_z = on_grid(lambda w: 0.1 / (np.exp(0.1j * w) - 1.0), 0.5)
    for loop, least in ((two, right), (with_real, right), (sampled, in_z)):
        found = hc.wcgain(hc.feedback(loop, 1))
        # a grid finds no more than the largest gain
        assert least <= found.lower_bound * (1.0 + 1e-9)
        assert found.lower_bound == pytest.approx(least, rel=1e-3)
        assert found.lower_bound <= found.upper_bound <= 1.011 * found.lower_bound


def two_masses() -> Lft:
    """Return the sensitivity at the force on the first of two masses, k from 0.5 to 2 N/m.

    The benchmark problem of the American Control Conference (Wie and Bernstein 1992) with a
    proportional and derivative law at the first mass. The spring acts on both masses and stands in
    the system twice.
    """
    k = hc.ureal("k", 1.0, range=(0.5, 2.0))
    spring = k @ np.array([[1.0, -1.0, 0.0, 0.0]])
    still = np.zeros((4, 4))
    still[0, 2] = still[1, 3] = 1.0
    at = np.eye(4)[:, :, None]
    a = still - at[2] @ spring + at[3] @ spring
    plant = hc.uss(a, at[2], np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 1)))
    return hc.feedback(1, plant * hc.transfer_function([1, 1], [1e-3, 1]))


def test_two_masses_on_an_uncertain_spring() -> None:
    """S = 1/(1 + C (s² + k)/(s² (s² + 2 k))) on a grid of k and frequency."""
    loop = two_masses()
    assert loop.times == (2,)
    s = 1j * np.geomspace(0.1, 10.0, 4001)
    k = np.linspace(0.5, 2.0, 61)[:, None]
    law = (s + 1.0) / (1e-3 * s + 1.0)
    free = s**2 * (s**2 + 2.0 * k)
    gains = np.abs(free / (free + law * (s**2 + k)))
    found = hc.wcgain(loop)
    assert found.lower_bound == pytest.approx(float(gains.max()), rel=1e-4)
    assert found.lower_bound <= found.upper_bound <= 1.011 * found.lower_bound
    assert found.worst["k"] == pytest.approx(0.5, rel=1e-6)


def test_ranges_are_divided_where_a_bound_is_loose() -> None:
    """1/(s² + c s + k), c = 0.2, k = 1, ± 50 %: the peak 1/(c √(k − c²/4)) is worst at both least.

    Whatever the bound for the whole ranges was, the parts prove one near the peak.
    """
    c, k = hc.ureal("c", 0.2, percentage=50), hc.ureal("k", 1.0, percentage=50)
    at = np.array([[0.0], [1.0]])
    a = np.array([[0.0, 1.0], [0.0, 0.0]]) - at @ join_inputs(k, c)
    loop = hc.uss(a, at, np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    right = 1.0 / (0.1 * np.sqrt(0.5 - 0.1**2 / 4.0))
    structure = performance_structure(loop.system, loop.structure)
    found = divide_gain(
        loop.system, loop.structure, structure, 3.2e5, 1.05 * right, gap=0.02, most=4
    )
    assert right <= found.upper <= 1.05 * right
    assert found.parts >= 2
    # the middle of a part is no more than the worst
    assert 0.0 < found.lower <= right
    # a range of c beyond zero has no bound: the middle of a part is not stable
    wide = hc.ureal("c", 0.2, percentage=250)
    a = np.array([[0.0, 1.0], [0.0, 0.0]]) - at @ join_inputs(k, wide)
    loop = hc.uss(a, at, np.array([[1.0, 0.0]]), np.zeros((1, 1)))
    found = divide_gain(loop.system, loop.structure, structure, np.inf, 1.0, gap=0.02)
    assert (found.upper, found.lower) == (np.inf, np.inf)
    place = [u.name for u in loop.uncertainties].index("c")
    assert wide.uncertainties[0].physical(found.values[place]) < 0.0


def test_a_loop_with_a_time_constant_that_stands_twice_ends() -> None:
    """K/(T s + 1) with K and T ± 10 %: K = 0, or T = 0, is the nearest that is not stable.

    Both are at ten times the ranges. 1/T stands twice, and no scaling of two copies of one signal
    is the best.
    """
    gain, lag = hc.ureal("K", 1.0, percentage=10), hc.ureal("T", 1.0, percentage=10)
    plant = gain * (1 / lag) * hc.feedback(INTEGRATOR, 1 / lag)
    loop = hc.feedback(plant * hc.transfer_function([0.5, 2.0, 1.5], [0.05, 1.0, 0.0]), 1)
    assert loop.times == (1, 2)
    found = hc.robstab(loop, gap=1e-3)
    assert found.lower_bound <= found.upper_bound
    assert found.undecided_gap == 0.0
    assert 9.98 <= found.lower_bound <= 10.0
    assert found.upper_bound == pytest.approx(10.0, rel=1e-6)
