"""SLICOT as a source of guesses: the same results with it, a named error without it."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.full_order import hinf
from hillsphere_controllers.full_order.hinf import hinf_synthesis


def plant(seed: int, order: int) -> LtiSystem:
    """Two controls and measurements, weighted and noisy; poles about −1."""
    random = np.random.default_rng(seed)
    a = random.normal(size=(order, order)) / np.sqrt(order) - np.eye(order)
    d = np.zeros((6, 6))
    d[2:4, 4:], d[4:, 2:4] = np.eye(2), np.eye(2)
    return LtiSystem(a, random.normal(size=(order, 6)), random.normal(size=(6, order)), d)


@pytest.mark.parametrize("order", [3, 8, 20])
def test_the_result_is_the_same_within_the_tolerance(order: int) -> None:
    pytest.importorskip("slycot", reason="the extra 'slicot' is not installed")
    one, other = (
        hinf_synthesis(plant(order, order), 2, 2, tolerance=1e-5, slicot=use)
        for use in (False, True)
    )
    assert_allclose(other.solvable, one.solvable, rtol=1.1e-5)
    assert_allclose(other.gamma, one.gamma, rtol=1e-4)
    assert other.least <= one.solvable
    assert other.closed_loop.is_stable


@pytest.mark.parametrize("share", [np.nan, 0.3, 0.999, 1.001, 5.0])
def test_a_wrong_guess_changes_nothing(monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    one = hinf_synthesis(plant(1, 3), 2, 2, tolerance=1e-5)
    monkeypatch.setattr(hinf, "hinf_guess", lambda *given: share * one.solvable)
    other = hinf_synthesis(plant(1, 3), 2, 2, tolerance=1e-5, slicot=True)
    assert_allclose(other.solvable, one.solvable, rtol=1.1e-5)
    assert other.least <= one.solvable


def test_without_slycot_its_use_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "slycot", None)
    assert hinf_synthesis(plant(1, 3), 2, 2).gamma > 0.0
    with pytest.raises(InputError, match=r"install hillsphere\[slicot\]"):
        hinf_synthesis(plant(1, 3), 2, 2, slicot=True)
