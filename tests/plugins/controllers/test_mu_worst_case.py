from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.mu.blocks import (
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)
from hillsphere_controllers.mu.worst_case import interpolate_perturbation, worst_case


@settings(derandomize=True, deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), omega=st.floats(1e-3, 1e3))
def test_interpolation(seed: int, omega: float) -> None:
    """Δ(jω) is Δ; Δ(s) is stable, of its structure at all frequencies, and nowhere larger."""
    random = np.random.default_rng(seed)
    structure = BlockStructure([repeated_real(2), repeated_complex(2), full(3, 2)])
    scalar = complex(*random.normal(size=2))
    left, right = (random.normal(size=(k, 2)) @ np.array([1.0, 1j]) for k in (3, 2))
    delta = np.zeros((7, 6), dtype=complex)
    delta[:2, :2] = random.normal() * np.eye(2)
    delta[2:4, 2:4] = scalar * np.eye(2)
    delta[4:, 4:] = np.outer(left, right)
    system = interpolate_perturbation(delta, structure, omega)
    assert_allclose(system.response(np.array([omega]))[0], delta, rtol=0.0, atol=1e-9)
    assert system.is_stable
    size = np.linalg.norm(delta, 2)
    assert_allclose(hinf_norm(system).value, size, rtol=1e-6)
    other = system.response(np.array([3.0 * omega]))[0]
    assert_allclose(other[:2, :2], delta[:2, :2], rtol=0.0, atol=1e-12)
    assert_allclose(other[2:4, 2:4], other[2, 2] * np.eye(2), rtol=0.0, atol=1e-12)
    assert not other[:4, 4:].any()
    assert not other[4:, :4].any()


def oscillator() -> LtiSystem:
    """Return 1/(s² + 0.2 s + 1) as M of a stiffness δ and of a performance channel."""
    a = np.array([[0.0, 1.0], [-1.0, -0.2]])
    b = np.array([[0.0, 0.0], [-1.0, 1.0]])
    return LtiSystem(a, b, np.array([[1.0, 0.0], [1.0, 0.0]]), np.zeros((2, 2)))


def test_real_values() -> None:
    """δ = −1 takes the stiffness away: a pole goes to zero."""
    found = worst_case(
        oscillator(), BlockStructure([repeated_real(name="k")]), np.array([[-1.0 + 0j]]), 0.0
    )
    assert found.values == {"k": -1.0}
    assert found.system.order == 0
    assert abs(found.pole) <= 1e-12
    assert found.singular <= 1e-12


def test_complex_value_as_a_stable_system() -> None:
    """At resonance M = −1/(0.2 j): δ = −0.2 j, of an all-pass, leaves the loop oscillating."""
    found = worst_case(
        oscillator(), BlockStructure([repeated_complex(name="lag")]), np.array([[-0.2j]]), 1.0
    )
    assert found.values == {}
    assert found.system.order == 1
    assert_allclose(found.pole, 1j, rtol=1e-12)


def test_errors_say_what_to_do() -> None:
    one = BlockStructure([repeated_complex()])
    with pytest.raises(ConvergenceError, match=r"not make I − M Δ singular at 1 rad/s"):
        worst_case(oscillator(), one, np.array([[-0.1j]]), 1.0)
    with pytest.raises(InputError, match="real values only"):
        interpolate_perturbation(np.array([[1j]]), one, 0.0)
    with pytest.raises(InputError, match="higher rank"):
        interpolate_perturbation(np.diag([1.0 + 1j, 1.0 + 1j]), BlockStructure([full(2)]), 1.0)


def test_a_complex_value_is_none_of_a_real_block() -> None:
    with pytest.raises(InputError, match="a real block has real values"):
        interpolate_perturbation(np.array([[1.0 + 1.0j]]), BlockStructure([repeated_real()]), 1.0)
