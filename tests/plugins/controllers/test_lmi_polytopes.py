from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import InfeasibleError, SynthesisFailedError
from hillsphere_controllers.linear_fractional.algebra import inverse, parameter, state_space
from hillsphere_controllers.linear_fractional.polynomials import polynomial
from hillsphere_controllers.linear_fractional.uncertainties import real_parameter
from hillsphere_controllers.lmi.polytopes import corner_systems, hull_gain, hull_stability
from hillsphere_controllers.lmi.solving import cp, minimise
from hillsphere_controllers.systems.bilinear import discrete

DAMPING = 0.2


def spring(stiffness: float) -> LtiSystem:
    """ẍ + c ẋ + k x = w, z = x."""
    return LtiSystem(
        np.array([[0.0, 1.0], [-stiffness, -DAMPING]]), np.array([[0.0], [1.0]]),
        np.array([[1.0, 0.0]]), np.zeros((1, 1)),
    )  # fmt: skip


def stable(seed: int, order: int) -> LtiSystem:
    random = np.random.default_rng(seed)
    a = random.normal(size=(order, order))
    a = a - (np.linalg.eigvals(a).real.max() + 0.3) * np.eye(order)
    sizes = ((order, 2), (3, order), (3, 2))
    b, c, d = (random.normal(size=size) for size in sizes)
    return LtiSystem(a, b, c, d)


def decreases(a: Array, p: Array, *, discrete_time: bool = False) -> bool:
    change = a.T @ p @ a - p if discrete_time else a.T @ p + p @ a
    return bool(np.linalg.eigvalsh(change)[-1] < 0.0 < np.linalg.eigvalsh(p)[0])


@pytest.mark.parametrize("order", [1, 4, 8])
def test_bounded_real_lemma_gives_the_hinf_norm(order: int) -> None:
    system = stable(order, order)
    found = hull_gain([system])
    norm = hinf_norm(system).value
    assert norm * (1.0 - 1e-9) <= found.bound <= norm * (1.0 + 1e-4)
    assert found.margin > 0.0
    assert decreases(system.a, found.lyapunov[0])


def test_bounded_real_lemma_in_discrete_time() -> None:
    system = discrete(stable(3, 3), 0.3)
    found = hull_gain([system])
    norm = hinf_norm(system).value
    assert norm * (1.0 - 1e-9) <= found.bound <= norm * (1.0 + 1e-3)
    assert decreases(system.a, found.lyapunov[0], discrete_time=True)


def test_common_lyapunov_function_up_to_the_circle_criterion() -> None:
    """A stiffness that moves between k₁ and k₂ is covered just if √k₂ − √k₁ < c."""
    limit = (1.0 + DAMPING) ** 2
    found = hull_stability([spring(1.0), spring(0.99 * limit)], common=True)
    assert found is not None
    for stiffness in (1.0, 1.2, 0.99 * limit):
        assert decreases(spring(stiffness).a, found[0])
    assert hull_stability([spring(1.0), spring(1.01 * limit)], common=True) is None


def test_lyapunov_functions_that_follow_the_parameter_cover_all_constant_ones() -> None:
    found = hull_stability([spring(1.0), spring(100.0)])
    assert found is not None
    for share in np.linspace(0.0, 1.0, 11):
        a = (1.0 - share) * spring(1.0).a + share * spring(100.0).a
        assert decreases(a, (1.0 - share) * found[0] + share * found[1])


def test_gain_of_constant_and_of_moving_parameters() -> None:
    """For constant ones, 1/(c √(k − c²/4)) at the softest spring; moving ones give more."""
    hull = [spring(1.0), spring(1.3)]
    worst = 1.0 / (DAMPING * np.sqrt(1.0 - DAMPING**2 / 4.0))
    constant = hull_gain(hull)
    assert_allclose(constant.lowest, worst, rtol=1e-8)
    assert worst <= constant.bound <= worst * (1.0 + 1e-3)
    moving = hull_gain(hull, common=True)
    assert moving.bound > 1.5 * worst
    with pytest.raises(InfeasibleError, match="no solution"):
        hull_gain([spring(1.0), spring(2.0)], common=True)


def test_corners_of_an_uncertain_system() -> None:
    k, c = real_parameter("k", 1.0, 4.0), real_parameter("c", 0.1, 0.3)
    e = np.array([[0.0], [1.0], [0.0]])
    first, second, third = np.eye(3)
    constant = np.outer(first, second) + np.outer(second, third) + np.outer(third, first)
    matrix = polynomial(
        {(0, 0): constant, (1, 0): -e @ first[None], (0, 1): -e @ second[None]}, (k, c)
    )
    corners = corner_systems(state_space(matrix, 2))
    assert len(corners) == 4
    assert sorted((-s.a[1, 0], -s.a[1, 1]) for s in corners) == [
        pytest.approx(v) for v in [(1.0, 0.1), (1.0, 0.3), (4.0, 0.1), (4.0, 0.3)]
    ]
    found = hull_gain(corners)
    assert found.bound >= 1.0 / (0.1 * np.sqrt(1.0 - 0.1**2 / 4.0)) * (1.0 - 1e-9)
    with pytest.raises(InputError, match="not linear in 'k'"):
        corner_systems(inverse(parameter(k)))


def test_what_does_not_fit_is_said() -> None:
    with pytest.raises(SynthesisFailedError, match="corner 1 of the hull is not stable"):
        hull_gain([spring(1.0), spring(-1.0)])
    assert hull_stability([spring(1.0), spring(-1.0)]) is None
    with pytest.raises(InputError, match="one size"):
        hull_gain([spring(1.0), stable(1, 2)])
    with pytest.raises(InputError, match="at least one"):
        hull_stability([])
    with pytest.raises(InputError, match="orders from 1 to 20"):
        hull_gain([stable(1, 21)])


def test_a_doubtful_solution_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    class Doubtful:
        status, value = "optimal_inaccurate", 1.0

        def __init__(self, *_: object) -> None: ...

        def solve(self, **_: object) -> None: ...

    monkeypatch.setattr(cp, "Problem", Doubtful)
    with pytest.raises(
        SynthesisFailedError, match="'optimal_inaccurate', which is nothing to rely"
    ):
        minimise(cp.Variable(), [], "anything")
