"""Worst-case gains of loops whose direct terms lead only from performance to Δ, in closed form."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator

import numpy as np
import pytest

import hillsphere_controllers as hc
from hillsphere.lti import LtiSystem
from hillsphere_controllers.linear_fractional.transformation import Lft

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
