"""Structured synthesis for sampled plants, on the double integrator with a held input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.structured.bounded import Bounded
from hillsphere_controllers.structured.requirements import (
    Channel,
    DesignPlant,
    SampledPoleRegion,
)
from hillsphere_controllers.structured.sampled_plants import sampled_norms, synthesise_sampled
from hillsphere_controllers.structured.sampled_structure import (
    image_structure,
    sampled_controller_of,
)
from hillsphere_controllers.structured.single_loop import Pid, TransferFunction
from hillsphere_controllers.structured.structure import (
    Alike,
    Diagonal,
    Structure,
    free_state_space,
    mask_gains,
    static,
)
from hillsphere_controllers.systems.algebra import lower_lft

PERIOD = 2.0
LIMIT = 2.5


def plant(period: float = PERIOD) -> LtiSystem:
    """Return r, v and a disturbance d that an impulse makes a step; z = r, and u at the plant."""
    t = period
    a = np.array([[1, t, t * t / 2], [0, 1, t], [0, 0, 0.9999]])
    push = np.array([t * t / 2, t, 0])
    b = np.column_stack([[0, 0, 1.0], push, push])
    c = np.array([[2 / t**2, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0]])
    d = np.zeros((4, 3))
    d[1, 1:] = 1.0
    return LtiSystem(a, b, c, d, period)


def design() -> DesignPlant:
    return DesignPlant(
        plant(), (Channel((0,), (0,), "h2"), Channel((1,), (1,), "hinf", 1.0, LIMIT))
    )


def test_norms_are_those_of_the_sampled_loop_and_limits_hold() -> None:
    found = synthesise_sampled(
        design(), free_state_space(1, 1, 2), starts=1, effort="quick", seed=1
    )
    assert found.controller.dt_s == PERIOD
    loop = lower_lft(plant(), found.controller)
    assert np.abs(loop.poles).max() < 1.0
    # the response to an impulse, summed up sample by sample
    x, squares = loop.b[:, 0].copy(), loop.d[0, 0] ** 2
    for _ in range(20_000):
        squares += float(loop.c[0] @ x) ** 2
        x = loop.a @ x
    assert found.gamma == pytest.approx(np.sqrt(squares), rel=1e-6)
    theta = np.linspace(1e-4, np.pi, 20_000)
    peak = np.abs(loop.response(theta / PERIOD)[:, 1, 1]).max()
    assert peak <= LIMIT * (1 + 1e-5)
    assert peak > 0.99 * LIMIT  # the limit holds the design


def test_a_loop_that_is_not_stable_has_no_norm() -> None:
    none = LtiSystem(np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), np.zeros((1, 2)), PERIOD)
    assert sampled_norms(design(), none) == [np.inf, np.inf]


def test_faults() -> None:
    with pytest.raises(InputError, match="structure of the kind Alike has no image"):
        synthesise_sampled(design(), Alike(Diagonal([free_state_space(1, 1, 2)])))
    with pytest.raises(InputError, match="of one period, got"):
        synthesise_sampled(
            [design(), DesignPlant(plant(1.0), design().channels)], free_state_space(1, 1, 2)
        )


MASK = mask_gains(np.array([[0.9, 0.0, np.nan], [0.0, np.nan, 1.0], [np.nan, 1.0, 0.0]]), 2)


@pytest.mark.parametrize(
    "structure",
    [
        MASK,
        TransferFunction(2, 1),
        Pid(),
        Diagonal([MASK, Pid(integral=False), static(1, 1)]),
        Bounded(free_state_space(1, 1, 1), np.full(4, -0.9), np.full(4, 0.9)),
    ],
)
def test_image_is_that_of_the_controller_and_so_are_its_slopes(structure: Structure) -> None:
    image = image_structure(structure, PERIOD)
    random = np.random.default_rng(0)
    theta = 0.3 * random.normal(size=image.size)
    k, n = image.gains(theta), image.order
    made = LtiSystem(k[:n, :n], k[:n, n:], k[n:, :n], k[n:, n:])
    exact = sampled_controller_of(image, theta, PERIOD)
    z = np.array([1.3 + 0.4j, -0.2 + 1.1j])
    np.testing.assert_allclose(made(2.0 / PERIOD * (z - 1.0) / (z + 1.0)), exact(z), rtol=1e-9)
    slope = random.normal(size=(2, *k.shape))
    numeric = [
        np.sum(slope * (image.gains(theta + 1e-6 * e) - image.gains(theta - 1e-6 * e)), (1, 2))
        / 2e-6
        for e in np.eye(image.size)
    ]
    np.testing.assert_allclose(
        image.pull_back(theta, slope), np.array(numeric).T, rtol=1e-6, atol=1e-7
    )


def test_fixed_entries_stay_exactly() -> None:
    image = image_structure(Diagonal([MASK, static(1, 1)]), PERIOD)
    controller = sampled_controller_of(image, np.arange(1.0, 5.0), PERIOD)
    assert controller.dt_s == PERIOD
    assert controller.a.tolist() == [[0.9, 0.0], [0.0, 2.0]]
    assert controller.d.tolist() == [[0.0, 0.0], [0.0, 4.0]]


def lag_plant() -> DesignPlant:
    """Return z = (y − w, 0.3 u), y = 0.2/(z − 0.8) (u + w): the loop's error and effort."""
    return DesignPlant(
        LtiSystem(
            np.array([[0.8]]), np.array([[0.0, 0.2]]), np.array([[1.0], [0.0], [-1.0]]),
            np.array([[-1.0, 0.0], [0.0, 0.3], [1.0, 0.0]]), 0.1,
        )
    )  # fmt: skip


def norm_on_circle(plant: DesignPlant, controller: LtiSystem) -> float:
    """Return the largest gain of the sampled loop on a fine grid; infinite if it is not stable."""
    loop = lower_lft(plant.system, controller)
    if np.abs(loop.poles).max() >= 1.0:
        return np.inf
    theta = np.linspace(0.0, np.pi, 4001)
    gains = np.linalg.svd(loop(np.exp(1j * theta)), compute_uv=False)
    return float(gains.max())


def test_masked_gain_has_the_norm_of_a_scan() -> None:
    """An integrator 1/(z − 1) with one free gain: the best is found by a scan of the gain too."""
    only = mask_gains(np.array([[0.95, np.nan], [1.0, 0.0]]), 1)
    found = synthesise_sampled(lag_plant(), only, starts=2, effort="quick", seed=1)
    assert found.controller.a.tolist() == [[0.95]]
    assert found.controller.d.tolist() == [[0.0]]

    def value(gain: float) -> float:
        controller = LtiSystem(
            np.array([[0.95]]), np.array([[gain]]), np.eye(1), np.zeros((1, 1)), 0.1
        )
        return norm_on_circle(lag_plant(), controller)

    scan = min(value(gain) for gain in np.linspace(-1.0, 2.0, 301))
    assert found.gamma <= scan * (1.0 + 1e-4)
    assert found.gamma == pytest.approx(norm_on_circle(lag_plant(), found.controller), rel=1e-4)


def test_pid_and_transfer_function_of_a_sampled_plant() -> None:
    pi = synthesise_sampled(lag_plant(), Pid(derivative=False), starts=2, seed=1)
    assert np.abs(pi.controller.poles - 1.0).max() < 1e-9  # the integral
    assert pi.gamma == pytest.approx(norm_on_circle(lag_plant(), pi.controller), rel=1e-4)
    # (b₁ z + b₀)/(z + a₀) contains every PI with a leak: it does no worse than its limit
    first = synthesise_sampled(lag_plant(), TransferFunction(1), starts=2, effort="quick", seed=1)
    assert first.gamma == pytest.approx(norm_on_circle(lag_plant(), first.controller), rel=1e-4)
    free = synthesise_sampled(
        lag_plant(), free_state_space(1, 1, 1), starts=2, effort="quick", seed=1
    )
    assert first.gamma == pytest.approx(free.gamma, rel=1e-3)
    assert first.gamma <= pi.gamma * (1.0 + 1e-4)


def test_region_of_sampled_poles() -> None:
    """A mode of decay ζω and frequency ω is at z = exp((−ζ ± j √(1 − ζ²)) ω T)."""
    zeta, omega = 0.3, 0.8
    s = omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
    z = np.array([np.exp(s * PERIOD), 0.4, -0.5, 0.0])
    images = (2.0 / PERIOD * (z - 1.0) / (z + 1.0)).astype(np.complex128)
    region = SampledPoleRegion(zeta * omega, zeta, omega, PERIOD)
    rows, slopes = region.excess(images)
    np.testing.assert_allclose(rows[:, 0], 0.0, atol=1e-12)
    assert rows[0, 1] == pytest.approx(1.0 + np.log(0.4) / PERIOD / (zeta * omega))
    assert rows[1, 1] == pytest.approx(zeta - 1.0)  # real and positive: damping 1
    half = np.log(0.5) + 1j * np.pi  # s T of z = −1/2
    assert rows[1, 2] == pytest.approx(zeta + half.real / abs(half))
    assert rows[2, 3] == pytest.approx(1.0 / (omega * PERIOD))  # a pole at zero is too fast
    border = np.exp(-omega * PERIOD)
    low, high = (
        region.excess(np.array([2.0 / PERIOD * (p - 1.0) / (p + 1.0)], dtype=np.complex128))
        for p in (border - 1e-7, border + 1e-7)
    )
    assert low[0][2, 0] == pytest.approx(-high[0][2, 0], rel=1e-4)  # the same slope on both sides
    assert low[1][2, 0].real == pytest.approx(high[1][2, 0].real, rel=1e-4)
    assert (replace(region, filters=1).excess(images)[0][:, 3] == -np.inf).all()
    step = 1e-6
    for turn in (1.0, 1j):
        ahead, behind = (
            region.excess((images[:2] + k * step * turn).astype(np.complex128))[0] for k in (1, -1)
        )
        np.testing.assert_allclose(
            (slopes[:, :2] * turn).real, (ahead - behind) / (2 * step), rtol=1e-6, atol=1e-8
        )
