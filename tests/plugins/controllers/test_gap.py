"""Gap, ν-gap, coprime factors and loop shaping, against published and exact values."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.gap import gap, nu_gap
from hillsphere_controllers.errors import NotStabilisableError
from hillsphere_controllers.full_order.coprime import coprime_factors
from hillsphere_controllers.full_order.loop_shaping import coprime_margin, loop_shaping
from hillsphere_controllers.systems.algebra import gain
from hillsphere_controllers.systems.bilinear import discrete
from hillsphere_controllers.systems.conversion import transfer_function

FAST = transfer_function([100.0], [2.0, 1.0])
UNSTABLE = transfer_function([100.0], [2.0, -1.0])
SQUARED = transfer_function([100.0], [1.0, 2.0, 1.0])


def random_system(seed: int = 0) -> LtiSystem:
    """Return a system of four states, two inputs, three outputs, one unstable pole."""
    random = np.random.default_rng(seed)
    return LtiSystem(
        random.normal(size=(4, 4)), random.normal(size=(4, 2)), random.normal(size=(3, 4)),
        random.normal(size=(3, 2)),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("first", "second", "both", "nu"),
    [
        # K. Zhou, J. C. Doyle (1998), Essentials of Robust Control, chapter 17
        (FAST, UNSTABLE, 0.02, 0.02),
        (FAST, SQUARED, 0.8988, 0.8988),
        (UNSTABLE, SQUARED, 0.8941, 0.8941),
        # there too: (s − 1)/(s + 1) and (2 s − 1)/(s + 1) have other gaps than ν-gaps
        (
            transfer_function([1.0, -1.0], [1.0, 1.0]),
            transfer_function([2.0, -1.0], [1.0, 1.0]),
            1.0 / 3.0,
            1.0 / np.sqrt(10.0),
        ),
    ],
)
def test_zhou_doyle(first: LtiSystem, second: LtiSystem, both: float, nu: float) -> None:
    assert gap(first, second) == pytest.approx(both, abs=6e-5)
    assert nu_gap(first, second) == pytest.approx(nu, abs=6e-5)
    assert nu_gap(second, first) == pytest.approx(nu_gap(first, second), rel=1e-6)


def test_constant_gains_have_the_chordal_distance() -> None:
    """Vinnicombe: |k₁ − k₂|/√((1 + k₁²)(1 + k₂²)), the distance on the sphere of Riemann."""
    for k1, k2 in ((0.0, 1.0), (1.0, 2.0), (-1.0, 3.0)):
        exact = abs(k1 - k2) / np.sqrt((1.0 + k1**2) * (1.0 + k2**2))
        one, two = (gain(np.array([[k]])) for k in (k1, k2))
        assert nu_gap(one, two) == pytest.approx(exact, rel=1e-9)


def test_nu_gap_is_the_largest_chordal_distance_over_frequency() -> None:
    """For systems whose winding number is right; an independent formula, on a grid."""
    first, second = transfer_function([3.0], [1.0, 1.0]), transfer_function([4.0], [1.0, 2.0])
    omega = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 20_001)])
    p1, p2 = (s.response(omega)[:, 0, 0] for s in (first, second))
    distance = abs(p1 - p2) / np.sqrt((1 + abs(p1) ** 2) * (1 + abs(p2) ** 2))
    assert nu_gap(first, second) == pytest.approx(distance.max(), rel=1e-6)
    assert gap(first, second) >= nu_gap(first, second) * (1.0 - 1e-6)


def test_the_winding_number_decides() -> None:
    """1/s and −1/s: one controller stabilises either, none both; the distance is one."""
    lag, opposite = transfer_function([1.0], [1.0, 0.0]), transfer_function([-1.0], [1.0, 0.0])
    assert nu_gap(lag, opposite) == pytest.approx(1.0)
    # |P₁ − P₂| is small at every frequency here, yet the stability differs by an encirclement
    near = transfer_function([1.0], [1.0, 10.0]), transfer_function([1.0], [1.0, -10.0])
    omega = np.geomspace(1e-3, 1e3, 2001)
    p1, p2 = (s.response(omega)[:, 0, 0] for s in near)
    assert (abs(p1 - p2) / np.sqrt((1 + abs(p1) ** 2) * (1 + abs(p2) ** 2))).max() < 0.3
    assert nu_gap(*near) == 1.0
    assert gap(*near) == pytest.approx(1.0, abs=1e-4)


def test_equal_systems_and_sampled_ones() -> None:
    system = random_system()
    assert gap(system, system) < 1e-6
    assert nu_gap(system, system) < 1e-6
    other = 1.1 * system
    sampled = discrete(system, 0.1), discrete(other, 0.1)
    assert nu_gap(*sampled) == pytest.approx(nu_gap(system, other), rel=1e-6)
    with pytest.raises(InputError, match="one sampling period"):
        nu_gap(system, sampled[0])


def test_coprime_factors_are_normalised_and_give_the_system() -> None:
    system = random_system()
    factors = coprime_factors(system)
    omega = np.array([0.0, 0.3, 4.0])
    right, left = factors.right.response(omega), factors.left.response(omega)
    one = np.swapaxes(right.conj(), 1, 2) @ right
    assert_allclose(one, np.broadcast_to(np.eye(2), one.shape), atol=1e-12)
    other = left @ np.swapaxes(left.conj(), 1, 2)
    assert_allclose(other, np.broadcast_to(np.eye(3), other.shape), atol=1e-12)
    assert_allclose(right[:, :3] @ np.linalg.inv(right[:, 3:]), system.response(omega), atol=1e-11)
    assert_allclose(
        -np.linalg.inv(left[:, :, :3]) @ left[:, :, 3:], system.response(omega), atol=1e-11
    )
    assert factors.right.is_stable
    assert factors.left.is_stable


def test_skogestad_postlethwaite_example_9_3() -> None:
    """Multivariable Feedback Control, 2nd edition: 200/((10 s + 1)(0.05 s + 1)²), (s + 2)/s."""
    fast = transfer_function([1.0], [0.05, 1.0])
    plant = 200.0 * transfer_function([1.0], [10.0, 1.0]) @ fast @ fast
    design = loop_shaping(plant, transfer_function([1.0, 2.0], [1.0, 0.0]))
    assert design.least == pytest.approx(2.34, abs=0.005)
    assert design.gamma == pytest.approx(1.01 * design.least, rel=1e-3)
    assert coprime_margin(design.shaped_plant, design.shaped_controller) == pytest.approx(
        1.0 / design.gamma, rel=1e-6
    )


def test_integrator_has_the_margin_one_over_root_two() -> None:
    """P = 1/s: X = Z = 1, so that the least γ is √2, of C = −1."""
    integrator = transfer_function([1.0], [1.0, 0.0])
    assert loop_shaping(integrator, back_off=1e-3).least == pytest.approx(np.sqrt(2.0), rel=1e-9)
    best = gain(np.array([[-1.0]]))
    assert coprime_margin(integrator, best) == pytest.approx(1.0 / np.sqrt(2.0), rel=1e-9)
    assert coprime_margin(integrator, gain(np.ones((1, 1)))) == 0.0


def test_direct_terms_and_sampled_plants() -> None:
    system = random_system()
    design = loop_shaping(system)
    sampled = loop_shaping(discrete(system, 0.1))
    assert sampled.controller.dt_s == 0.1
    assert sampled.gamma == pytest.approx(design.gamma, rel=1e-6)
    # the ν-gap theorem: plants nearer than the margin are stabilised
    margin = 1.0 / design.gamma
    near = 1.05 * system
    assert nu_gap(system, near) < margin
    assert coprime_margin(near, design.shaped_controller) >= np.sin(
        np.arcsin(margin) - np.arcsin(nu_gap(system, near))
    ) * (1.0 - 1e-6)


def test_faults() -> None:
    hidden = LtiSystem(np.eye(2), np.array([[1.0], [0.0]]), np.ones((1, 2)), np.zeros((1, 1)))
    with pytest.raises(NotStabilisableError, match="no normalised coprime factors"):
        nu_gap(hidden, hidden)
    with pytest.raises(InputError, match="back-off"):
        loop_shaping(random_system(), back_off=0.0)
    with pytest.raises(InputError, match="needs a controller of 2 × 3, got 1 × 1"):
        coprime_margin(random_system(), gain(np.ones((1, 1))))
