"""The search for the least γ: the ends of plain bisection, by fewer solutions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.plugins.controllers.test_hinf_synthesis import random_plant, scalar_plant

from hillsphere_controllers.errors import SynthesisFailedError
from hillsphere_controllers.full_order.gamma_problem import GammaProblem
from hillsphere_controllers.full_order.gamma_search import bisect_gamma, close_in, follow_gamma
from hillsphere_controllers.full_order.hinf import hinf_synthesis, least_gamma


@dataclass
class Problem:
    """Solvable above `least`; X exists above `exists`, and ρ falls with γ as 1/(γ − exists)."""

    least: float
    exists: float = 0.0
    size: float = 1.0
    proved: float = 0.0
    proves_below: float = math.inf
    shift: float = 0.0
    """By how much the slack's zero is displaced, so that it contradicts the solutions."""
    asked: list[float] = field(default_factory=list)

    def solve(self, gamma: float) -> Any:
        self.asked.append(gamma)
        if gamma < self.least and gamma < self.proves_below:
            self.proved = max(self.proved, gamma)
        return None if gamma < self.least else ("X", "Y")

    def slack(self, gamma: float) -> float | None:
        self.asked.append(gamma)
        if gamma <= self.exists:
            return None
        zero = self.least * (1.0 + self.shift)
        rho = zero**2 * (zero - self.exists) / (gamma - self.exists)
        return gamma**2 / rho - 1.0


def plain_bisection(least: float, low: float, high: float, tolerance: float) -> Any:
    count = 0
    while high > low * (1.0 + tolerance):
        middle, count = math.sqrt(low * high) if low else 0.1 * high, count + 1
        low, high = (middle, high) if middle < least else (low, middle)
    return low, high, count


@pytest.mark.parametrize("exists", [0.0, 1.2, 1.2999])
@pytest.mark.parametrize(("low", "high"), [(0.1, 9.0), (0.0, 1e4)])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-6])
def test_interpolation_ends_as_bisection_does(
    exists: float, low: float, high: float, tolerance: float
) -> None:
    problem = Problem(1.3, exists)
    below, above, count = plain_bisection(1.3, low, high, tolerance)
    assert bisect_gamma(problem, low, high, tolerance) == (below, above)
    assert problem.proved == below
    if tolerance == 1e-6:
        # X exists from 1.2999 on: nothing is known of ρ at smaller γ, and halving is all there is
        assert len(problem.asked) <= (count + 2 if exists == 1.2999 else 0.7 * count)
    bracket = close_in(problem, low, high, tolerance)
    assert bracket[0] < 1.3 <= bracket[1] <= bracket[0] * (1.0 + tolerance)


@pytest.mark.parametrize("shift", [-0.1, -1e-3, 1e-3, 0.1])
def test_solutions_that_contradict_the_slack_decide(shift: float) -> None:
    problem = Problem(1.3, shift=shift)
    ends = bisect_gamma(problem, 0.1, 9.0, 1e-4)
    assert ends == plain_bisection(1.3, 0.1, 9.0, 1e-4)[:2]


def test_what_bisection_would_have_proved_is_proved() -> None:
    """Rounding hides proofs above 1.2; the highest γ of the bisection below that is proved."""
    problem, plain = Problem(1.3, proves_below=1.2), Problem(1.3, proves_below=1.2)
    low, high = 0.1, 9.0
    bisect_gamma(problem, low, high, 1e-4)
    while high > low * (1.0 + 1e-4):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if plain.solve(middle) is None else (low, middle)
    assert problem.proved == plain.proved > 0.9


def test_the_secant_method_follows_a_zero_and_says_where_it_cannot() -> None:
    problem = Problem(1.3, 1.0)
    found = follow_gamma(problem, 1.302, 5.0, 1e-6)
    assert found is not None
    assert_allclose(found[0], 1.3, rtol=1e-6)
    # d/dln γ of γ² (γ − 1)/(1.3² 0.3) at 1.3
    assert_allclose(found[1], 2.0 + 1.3 / 0.3, rtol=1e-2)
    assert len(problem.asked) <= 4
    assert follow_gamma(problem, 0.9, 5.0, 1e-6) is None
    # a step of a slope that is too small leaves the γ for which X exists
    assert follow_gamma(Problem(1.3, 1.25), 1.302, 0.01, 1e-6) is None


@pytest.mark.parametrize("a", [-2.0, 1.0, 3.0])
def test_the_least_gamma_in_closed_form(a: float) -> None:
    """See `test_scalar_problem_in_closed_form`; then of a plant nearby, from what was found."""
    gamma, slope = least_gamma(scalar_plant(a), 1, 1, tolerance=1e-8)
    assert_allclose(gamma, a + np.sqrt(a * a + 2.0), rtol=2e-8)
    near = least_gamma(scalar_plant(a + 1e-3), 1, 1, tolerance=1e-8, near=(gamma, slope))
    assert_allclose(near[0], a + 1e-3 + np.sqrt((a + 1e-3) ** 2 + 2.0), rtol=2e-8)


def test_a_synthesis_solves_few_riccati_equations(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bisection to 1e-6 took 25 in all; the least γ is that of `least_gamma`."""
    asked: list[float] = []
    for name in ("solve", "slack"):
        method = getattr(GammaProblem, name)

        def counted(self: Any, gamma: float, _method: Any = method, **options: Any) -> Any:
            asked.append(gamma)
            return _method(self, gamma, **options)

        monkeypatch.setattr(GammaProblem, name, counted)
    for seed in range(2):
        plant = random_plant(seed, 4, 1, 2)
        asked.clear()
        found = hinf_synthesis(plant, 1, 2, tolerance=1e-6, regularisation=0.0)
        assert len(asked) <= 19
        gamma, slope = least_gamma(plant, 1, 2)
        assert_allclose(gamma, found.solvable, rtol=2e-6)
        asked.clear()
        least_gamma(plant, 1, 2, near=(gamma * 1.001, slope))
        assert len(asked) <= 4


def test_no_gamma_at_all_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(GammaProblem, "bracket", lambda self: (0.0, None))
    with pytest.raises(SynthesisFailedError, match="for no γ"):
        least_gamma(scalar_plant(1.0), 1, 1)


class Saturated(Problem):
    """Below the least γ the spectral radius is so large that the slack is −1 to rounding."""

    def slack(self, gamma: float) -> float | None:
        return -1.0 if gamma < 0.999 * self.least else super().slack(gamma)


def test_a_slack_of_minus_one_says_only_that_gamma_is_too_small() -> None:
    problem = Saturated(1.3)
    ends = bisect_gamma(problem, 0.1, 9.0, 1e-4)
    assert ends == plain_bisection(1.3, 0.1, 9.0, 1e-4)[:2]
