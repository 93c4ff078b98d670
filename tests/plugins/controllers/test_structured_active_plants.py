"""Searches for many plants by the highest ones: the same minimum as with all of them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.structured import active_plants
from hillsphere_controllers.structured.active_plants import farthest_plants
from hillsphere_controllers.structured.closed_loop import OpenLoop
from hillsphere_controllers.structured.descent import descend
from hillsphere_controllers.structured.objective import Objective
from hillsphere_controllers.structured.requirements import DesignPlant
from hillsphere_controllers.structured.structure import free_state_space
from hillsphere_controllers.structured.synthesis import synthesise

STATIC = free_state_space(0, 1, 1)


def lag(pole: float, gain: float = 1.0) -> DesignPlant:
    """ẋ = p x + w + g u, z = (x, u/10), y = x."""
    return DesignPlant(
        LtiSystem(
            np.array([[pole]]), np.array([[1.0, gain]]), np.array([[1.0], [0.0], [1.0]]),
            np.array([[0.0, 0.0], [0.0, 0.1], [0.0, 0.0]]),
        ),
        name=f"pole {pole}",
    )  # fmt: skip


def largest(plants: list[DesignPlant], gain: float) -> float:
    """|z| = √(1 + g²/100)/|a + k g| at ω = 0, where u = k y: the norm of a lag."""
    return max(
        float(np.hypot(1.0, 0.1 * gain) / abs(p.system.a[0, 0] + gain * p.system.b[0, 1]))
        for p in plants
    )


def test_the_minimum_is_that_of_all_plants() -> None:
    """Of ten lags two are hardest, whose gains have other signs: a scan of k gives the minimum."""
    plants = [lag(-0.2 * k, 1.0 + 0.3 * k) for k in range(8)] + [lag(2.0, 1.0), lag(-1.0, -0.1)]
    found = synthesise(plants, STATIC, starts=1, effort="quick", shaken=False)
    gains = -np.linspace(2.001, 9.999, 100_001)
    assert_allclose(found.gamma, min(largest(plants, k) for k in gains), rtol=1e-5)
    assert len(found.verified.norms) == 10


def test_plants_that_become_unstable_join(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first four want large negative gains, of which the last one bears only small ones."""
    plants = [lag(0.1 * k) for k in range(1, 6)] + [lag(-1.0, -0.3)]
    monkeypatch.setattr(active_plants, "farthest_plants", lambda loops, count: [0, 1, 2, 3])
    found = synthesise(plants, STATIC, starts=1, effort="quick", shaken=False)
    gains = -np.linspace(0.501, 3.33, 100_001)
    assert max(found.verified.abscissae_1_s) < 0.0
    assert_allclose(found.gamma, min(largest(plants, k) for k in gains), rtol=1e-5)


def test_the_plants_farthest_apart_come_first() -> None:
    loops = [OpenLoop(lag(-float(k)), STATIC) for k in (3, 2, 1, 4, 9)]
    assert set(farthest_plants(loops, 2)) == {2, 4}


def test_part_of_an_objective_has_the_levels_of_its_plants() -> None:
    loops = [OpenLoop(lag(-float(k)), STATIC) for k in range(1, 6)]
    whole = Objective(loops, STATIC, np.zeros(1), np.ones(1))
    point = whole.evaluate(np.array([0.5]))
    levels = whole.levels(point)
    assert_allclose(levels, np.log(np.hypot(1.0, 0.05) / (np.arange(1, 6) - 0.5)), rtol=1e-9)
    part = whole.restricted([1, 3])
    assert part.evaluate(np.array([0.5])).value == pytest.approx(levels[1], rel=1e-12)
    whole.take_over(part, [1, 3])
    assert whole.evaluations == 2
    assert whole.unstable(np.array([2.5]))[:2] == [0, 1]


@dataclass
class Steep:
    x: Array
    value: float


class Cliff:
    """10²⁰⁰ x²: products of its slopes are no numbers."""

    def evaluate(self, x: Array, above: float = np.inf) -> Steep:
        return Steep(x, 1e200 * float(x @ x))

    def slope(self, point: Steep) -> Array:
        return np.asarray(2e200 * point.x)


def test_slopes_that_overflow_warn_nobody() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = descend(Cliff(), Steep(np.ones(2), 2e200), iterations=5)
    assert found.value <= 2e200
