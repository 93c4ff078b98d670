from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import NotStabilisableError, SingularProblemError
from hillsphere_controllers.full_order.hinf import hinf_synthesis
from hillsphere_controllers.full_order.riccati import stabilising_solution
from hillsphere_controllers.systems.algebra import gain, lower_lft
from hillsphere_controllers.systems.bilinear import discrete


def random_plant(seed: int, order: int, controls: int, measurements: int) -> LtiSystem:
    random = np.random.default_rng(seed)
    m, p = controls + measurements + 1, controls + measurements + 1
    return LtiSystem(
        random.normal(size=(order, order)),
        random.normal(size=(order, m + controls)),
        random.normal(size=(p + measurements, order)),
        random.normal(size=(p + measurements, m + controls)),
    )


def scalar_plant(a: float) -> LtiSystem:
    """ẋ = a x + w₁ + u, z = (x, u), y = x + w₂."""
    return LtiSystem(
        np.array([[a]]),
        np.array([[1.0, 0.0, 1.0]]),
        np.array([[1.0], [0.0], [1.0]]),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
    )


@pytest.mark.parametrize("a", [-2.0, -0.1, 0.0, 1.0, 3.0])
def test_scalar_problem_in_closed_form(a: float) -> None:
    """Both equations read (1 − 1/γ²)x² − 2ax − 1 = 0; the least γ has x = γ, or x infinite."""
    # x(γ) = γ: (γ² − 1) − 2aγ − 1 = 0
    least = a + np.sqrt(a * a + 2.0)
    found = hinf_synthesis(scalar_plant(a), 1, 1, tolerance=1e-8)
    assert_allclose(found.least, least, rtol=1e-6)
    assert least * (1 - 1e-9) <= found.gamma <= least * 1.0051
    assert found.closed_loop.is_stable


def norm_by_sampling(system: LtiSystem) -> float:
    omega = np.concatenate([[0.0], np.logspace(-4, 5, 20_000)])
    return float(np.linalg.svd(system.response(omega), compute_uv=False).max())


@pytest.mark.parametrize("seed", range(6))
def test_the_closed_loop_is_what_is_said(seed: int) -> None:
    """D11, D22 not zero; γ near its least, and no higher by an independent response."""
    plant = random_plant(seed, 3 + seed, 1 + seed % 2, 2 - seed % 2)
    controls, measurements = 1 + seed % 2, 2 - seed % 2
    found = hinf_synthesis(plant, controls, measurements)
    loop = lower_lft(plant, found.controller)
    assert loop.is_stable
    assert_allclose(hinf_norm(loop).value, found.gamma, rtol=1e-9)
    assert norm_by_sampling(loop) <= found.gamma * (1 + 1e-9)
    assert found.least * (1 - 1e-3) <= found.gamma <= 1.02 * found.least


def test_no_static_controller_does_better() -> None:
    """Over a dense grid of gains that stabilise."""
    plant = scalar_plant(0.5)
    least = hinf_synthesis(plant, 1, 1, tolerance=1e-6).least
    loops = [lower_lft(plant, gain(np.array([[k]]))) for k in np.linspace(-10.0, 2.0, 121)]
    norms = [hinf_norm(loop).value for loop in loops if loop.is_stable]
    assert norms
    assert min(norms) >= least * (1 - 1e-9)


def test_discrete_time_has_the_norm_of_its_image() -> None:
    plant = random_plant(20, 4, 1, 1)
    image = discrete(plant, 0.1)
    found = hinf_synthesis(image, 1, 1)
    assert found.controller.dt_s == 0.1
    assert_allclose(found.least, hinf_synthesis(plant, 1, 1).least, rtol=1e-3)
    assert found.closed_loop.is_stable


def changed(plant: LtiSystem, **matrices: Array) -> LtiSystem:
    given = {name: matrices.get(name, getattr(plant, name)) for name in "abcd"}
    return LtiSystem(**given)


def test_what_cannot_be_stabilised_is_named() -> None:
    plant = scalar_plant(1.0)
    deaf = changed(plant, b=np.array([[1.0, 0.0, 0.0]]))
    with pytest.raises(NotStabilisableError, match="controls do not reach the mode at s = 1"):
        hinf_synthesis(deaf, 1, 1)
    blind = changed(plant, c=np.array([[1.0], [0.0], [0.0]]))
    with pytest.raises(NotStabilisableError, match="measurements do not show"):
        hinf_synthesis(blind, 1, 1)


def test_singular_problems_are_named_and_regularised() -> None:
    plant = scalar_plant(1.0)
    cheap = changed(plant, d=plant.d * [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [1.0, 1.0, 1.0]])
    with pytest.raises(SingularProblemError, match="D12 lacks full rank"):
        hinf_synthesis(cheap, 1, 1)
    found = hinf_synthesis(cheap, 1, 1, regularisation=1e-3)
    # without cost of control only the noise counts: z = x = y − w₂ can be held no smaller than w₂
    assert 1.0 - 1e-6 <= found.gamma <= 1.05
    with pytest.raises(InputError, match="2 controls and 1 measurements do not fit"):
        hinf_synthesis(gain(np.ones((1, 1))), 2, 1)


def test_zero_on_the_axis_is_named() -> None:
    """An integrator weight outside of the loop: ẋ₂ = w cannot be moved by u nor seen."""
    plant = LtiSystem(
        np.diag([-1.0, 0.0]),
        np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
        np.array([[1.0, 1.0], [0.0, 0.0], [1.0, 0.0]]),
        scalar_plant(0.0).d,
    )
    with pytest.raises(NotStabilisableError):
        hinf_synthesis(plant, 1, 1)


def test_riccati_solution_with_an_indefinite_term() -> None:
    """Scalar: 2ax + sx² + q = 0 with a + sx < 0."""
    for a, s, q in ((1.0, -1.0, 3.0), (-2.0, 1.0, 3.0), (0.0, -2.0, 0.5)):
        x = stabilising_solution(np.array([[a]]), np.array([[s]]), np.array([[q]]))
        assert x is not None
        root = np.sqrt(a * a - s * q)
        assert_allclose(x[0, 0], (-a - root) / s, rtol=1e-12)
    none = stabilising_solution(np.array([[1.0]]), np.array([[1.0]]), np.array([[3.0]]))
    assert none is None  # a² < sq: eigenvalues on the axis
