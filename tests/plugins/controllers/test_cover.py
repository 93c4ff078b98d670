"""Covers of sets of plants."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.linear_fractional.cover import cover_plants, fit_magnitude
from hillsphere_controllers.systems.bilinear import discrete
from hillsphere_controllers.systems.conversion import transfer_function
from hillsphere_controllers.systems.weights import shelving_weight

PLANTS = [transfer_function([k], [t, 1.0]) for k in (2.0, 2.5, 3.0) for t in (2.0, 2.5, 3.0)]
NOMINAL = transfer_function([2.5], [2.5, 1.0])


def inverse(system: LtiSystem) -> LtiSystem:
    """Return the inverse of a system of one input and output with a direct term."""
    back = 1.0 / system.d
    return LtiSystem(
        system.a - system.b @ back @ system.c, system.b @ back, -back @ system.c, back, system.dt_s
    )


def test_gain_of_a_weight_of_the_order_is_found_again() -> None:
    omega = np.geomspace(0.01, 100.0, 80)
    weight = shelving_weight(0.2, 2.0, 3.0)
    made = fit_magnitude(omega, np.abs(weight.response(omega)[:, 0, 0]), 1)
    assert_allclose(made.poles.real, weight.poles.real, rtol=1e-3)
    assert_allclose(made.d, weight.d, rtol=1e-3)


def test_gain_and_time_constant_of_a_lag() -> None:
    """(k/2.5)(2.5 s + 1)/(τ s + 1) − 1: the largest is that of k = 3, τ = 2, 0.2 to 0.5, exactly.

    At low frequency it is 3/2.5 − 1 for k = 3, at high frequency 3/2 − 1; one state suffices.
    """
    cover = cover_plants(PLANTS, NOMINAL, 1)
    ends = np.abs(cover.weight.response(np.array([0.0, 1e6]))[:, 0, 0])
    assert_allclose(ends, [0.2, 0.5], rtol=1e-4)
    assert cover.excess < 1.0 + 1e-3
    # at all frequencies, not only on the grid: ‖w⁻¹ (P_k/P₀ − 1)‖ ≤ 1, by another method
    for plant in PLANTS:
        k, tau = float(plant.response(np.array([0.0]))[0, 0, 0].real), -1.0 / plant.a[0, 0]
        change = transfer_function([k * 2.5, k], [2.5 * tau, 2.5]) - 1.0
        assert hinf_norm(inverse(cover.weight) @ change).value <= 1.0 + 1e-4


@pytest.mark.parametrize("order", [0, 2, 3])
def test_a_higher_order_covers_no_worse(order: int) -> None:
    one = cover_plants(PLANTS, NOMINAL, 1, kind="additive").excess
    made = cover_plants(PLANTS, NOMINAL, order, kind="additive")
    assert (made.excess <= one * 1.001) == (order > 1)
    size = np.abs(made.weight.response(made.omega_rad_s)[:, 0, 0])
    assert (size >= made.radius).all()


@pytest.mark.parametrize("kind", ["input", "output", "additive"])
def test_some_delta_gives_each_plant(kind: str) -> None:
    cover = cover_plants(PLANTS, NOMINAL, 1, kind=kind)  # type: ignore[arg-type]
    omega = np.array([0.37])
    at, w = NOMINAL.response(omega)[0, 0, 0], cover.weight.response(omega)[0, 0, 0]
    for plant in PLANTS:
        there = plant.response(omega)[0, 0, 0]
        delta = (there - at) / w / (1.0 if kind == "additive" else at)
        assert abs(delta) <= 1.0 + 1e-4  # between the frequencies of the fit
        made = cover.uncertain.response(omega, {"Delta": np.array([[[delta]]])})
        assert_allclose(made[0, 0, 0, 0], there, rtol=1e-9)


def test_in_discrete_time() -> None:
    plants = [discrete(plant, 0.5) for plant in PLANTS]
    cover = cover_plants(plants, discrete(NOMINAL, 0.5), 1)
    assert cover.weight.dt_s == 0.5
    assert cover.excess < 1.01


def test_faults() -> None:
    with pytest.raises(InputError, match="kind must be one of"):
        cover_plants(PLANTS, NOMINAL, 1, kind="both")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="plant 0 has 1 poles that are not stable"):
        cover_plants([transfer_function([1.0], [1.0, -1.0])], NOMINAL, 1)
    with pytest.raises(InputError, match="nothing to cover"):
        cover_plants([NOMINAL], NOMINAL, 1)
    with pytest.raises(InputError, match="rising"):
        cover_plants(PLANTS, NOMINAL, 1, omega_rad_s=np.array([1.0, 0.5]))
    tall = LtiSystem(-np.eye(1), np.eye(1), np.array([[1.0], [0.0]]), np.zeros((2, 1)))
    other = LtiSystem(-np.eye(1), np.eye(1), np.array([[1.0], [1.0]]), np.zeros((2, 1)))
    with pytest.raises(InputError, match="more than a change of its inputs"):
        cover_plants([other], tall, 1)
