"""Bounds of µ that are proved in parts of the real parameters' ranges."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu import division
from hillsphere_controllers.mu.blocks import BlockStructure, full, repeated_complex, repeated_real
from hillsphere_controllers.mu.division import prove_by_branch_and_bound
from hillsphere_controllers.mu.robustness import performance_structure, robust_performance

UNCERTAINTY = BlockStructure([repeated_real(2, name) for name in ("a", "b", "c")])


def loop(seed: int = 2) -> LtiSystem:
    """Three parameters, each twice: the bound of µ with performance is 7 % above it."""
    random = np.random.default_rng(seed)
    a = random.normal(size=(4, 4))
    a -= (np.linalg.eigvals(a).real.max() + 0.15) * np.eye(4)
    b, c = 0.5 * random.normal(size=(4, 7)), 0.5 * random.normal(size=(7, 4))
    return LtiSystem(a, b, c, np.zeros((7, 7)))


def largest(system: LtiSystem, size: float) -> float:
    """Return the largest gain on a grid of the parameters and of frequencies."""
    omega = np.concatenate([[0.0], np.geomspace(1e-2, 1e2, 80)])
    m, best = system.response(omega), 0.0
    for values in product(np.linspace(-size, size, 13), repeat=3):
        delta = np.diag(np.repeat(values, 2))
        inner = np.linalg.solve(np.eye(6) - delta @ m[:, :6, :6], delta @ m[:, :6, 6:])
        best = max(best, float(np.abs(m[:, 6:, 6:] + m[:, 6:, :6] @ inner).max()))
    return best


def test_what_is_proved_is_true_and_below_the_bound_for_the_whole() -> None:
    system = loop()
    whole = performance_structure(system, UNCERTAINTY)
    found = robust_performance(system, UNCERTAINTY, gap=1e-3)
    assert found.upper > 1.05 * found.lower
    limit = 0.4 * found.upper + 0.6 * found.lower
    one = prove_by_branch_and_bound(system, whole, found.upper * 1.01)
    assert (one.proved, one.left) == (1, 0)
    several = prove_by_branch_and_bound(system, whole, limit)
    assert several.left == 0
    assert several.proved > 1
    assert largest(system, 1.0 / limit) < limit


def test_what_is_false_is_not_proved() -> None:
    system = loop()
    found = robust_performance(system, UNCERTAINTY)
    whole = performance_structure(system, UNCERTAINTY)
    assert prove_by_branch_and_bound(system, whole, 0.99 * found.lower, most=8).left > 0


def test_a_search_that_cannot_end_in_time_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """If nothing is proved, 33 parts wait after 32 looks: 64 looks cannot suffice."""
    looked: list[LtiSystem] = []

    def fail(part: LtiSystem, *_: object) -> tuple[float, float]:
        looked.append(part)
        return 1.0, 1.1

    monkeypatch.setattr(division, "find_unproved", fail)
    whole = performance_structure(loop(), UNCERTAINTY)
    found = prove_by_branch_and_bound(loop(), whole, 1e3)
    assert (found.proved, found.left) == (0, 33)
    assert len(looked) == 32


def test_other_blocks_stay_whole_and_may_be_of_any_shape() -> None:
    """µ of diag(δ I, a 2 × 1 block, a complex scalar), real δ: one part proves its upper bound."""
    system = loop(3)
    structure = BlockStructure([full(2, 1), repeated_real(4, "a"), repeated_complex(1)])
    fitting = LtiSystem(system.a, system.b, system.c[:6], system.d[:6])
    assert structure.shape == (6, 7)
    found = prove_by_branch_and_bound(fitting, structure, 1e3)
    assert (found.proved, found.left) == (1, 0)


def test_what_cannot_be_divided_is_refused() -> None:
    with pytest.raises(InputError, match="no block is real"):
        prove_by_branch_and_bound(loop(), BlockStructure([full(7, 7)]), 1.0)
    with pytest.raises(InputError, match="limit"):
        prove_by_branch_and_bound(loop(), performance_structure(loop(), UNCERTAINTY), 0.0)


def test_what_is_not_stable_or_does_not_fit_is_refused() -> None:
    one, single = np.ones((1, 1)), BlockStructure([repeated_real(1, "a")])
    with pytest.raises(InputError, match=r"pole at 1.*stabilise it first"):
        prove_by_branch_and_bound(LtiSystem(one, -one, 0.5 * one, 0.0 * one), single, 0.5)
    with pytest.raises(InputError, match="3 outputs and 3 inputs, got 1 and 1"):
        prove_by_branch_and_bound(
            LtiSystem(-one, one, one, one), BlockStructure([repeated_real(3, "a")]), 0.5
        )
