from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.errors import NotStabilisableError
from hillsphere_controllers.full_order.mixed_sensitivity import (
    mixed_sensitivity,
    mixed_sensitivity_plant,
)
from hillsphere_controllers.systems.algebra import append, lower_lft, series
from hillsphere_controllers.systems.conversion import transfer_function
from hillsphere_controllers.systems.weights import performance_weight, shelving_weight

Complex = NDArray[np.complex128]
OMEGA = np.concatenate([[0.0], np.logspace(-4, 4, 4001)])


def disturbance_process() -> LtiSystem:
    """200/((10 s + 1)(0.05 s + 1)²)."""
    lag = transfer_function([1.0], [0.05, 1.0])
    return series(transfer_function([200.0], [10.0, 1.0]), lag, lag)


def largest(*responses: Complex) -> float:
    stacked = np.concatenate(responses, axis=1)
    return float(np.linalg.svd(stacked, compute_uv=False)[:, 0].max())


def test_skogestad_postlethwaite_section_2_8() -> None:
    """S. Skogestad, I. Postlethwaite (2005), Multivariable Feedback Control: a norm of 1.37.

    W_P = (s/M + ω_B)/(s + ω_B A), M = 1.5, ω_B = 10, A = 1e-4, W_u = 1.
    """
    weight = performance_weight(10.0, 1.5, 1e-4)
    found = mixed_sensitivity(disturbance_process(), weight, 1.0)
    assert round(found.gamma, 2) == 1.37
    assert round(found.design.least, 2) == 1.37
    # from the three transfers, by their responses
    w1 = weight.response(OMEGA)
    s, ks = found.sensitivity.response(OMEGA), found.control.response(OMEGA)
    assert_allclose(largest(w1 * s, ks), found.gamma, rtol=1e-4)
    assert_allclose(s + found.complementary.response(OMEGA), 1.0, rtol=1e-9)
    g = disturbance_process().response(OMEGA)
    assert_allclose(s, 1.0 / (1.0 + g * found.controller.response(OMEGA)), rtol=1e-6)


def test_slicot_finds_no_less_for_steeper_weights() -> None:
    """The same process with the weight of second order, by SLICOT's SB10AD."""
    slycot = pytest.importorskip("slycot")
    weight = performance_weight(10.0, 1.5, 1e-4, order=2)
    found = mixed_sensitivity(disturbance_process(), weight, 1.0, tolerance=1e-6)
    plant = found.plant
    theirs = slycot.sb10ad(
        plant.order, 2, 3, 1, 1, 100.0, plant.a, plant.b, plant.c, plant.d, job=1
    )
    assert_allclose(found.design.solvable, theirs[0], rtol=1e-4)
    assert 0.99 * theirs[0] <= found.design.least <= theirs[0] * (1.0 + 1e-4)


def two_by_two() -> LtiSystem:
    entries = [transfer_function([k], [tau, 1.0]) for k, tau in ((2.0, 1.0), (1.0, 3.0))]
    mix = np.array([[1.0, 0.4], [-0.3, 1.0]])
    made = append(*entries)
    return LtiSystem(made.a, made.b @ mix, made.c, made.d @ mix)


@pytest.mark.parametrize("disturbance", [0.0, 0.1])
def test_three_weights_and_two_channels(disturbance: float) -> None:
    g = two_by_two()
    w1 = shelving_weight(100.0, 0.5, 1.0)
    w3 = shelving_weight(0.5, 100.0, 30.0)
    found = mixed_sensitivity(g, w1, 0.1, w3, disturbance=disturbance)
    responses = [
        w1.response(OMEGA) * found.sensitivity.response(OMEGA),
        0.1 * found.control.response(OMEGA),
        w3.response(OMEGA) * found.complementary.response(OMEGA),
    ]
    if disturbance:
        gw = disturbance * g.response(OMEGA)
        down = found.complementary.response(OMEGA)
        into = found.control.response(OMEGA) @ gw
        extra = [
            -w1.response(OMEGA) * (found.sensitivity.response(OMEGA) @ gw),
            -0.1 * into,
            w3.response(OMEGA) * (gw - down @ gw),
        ]
        responses = [np.concatenate(pair, axis=2) for pair in zip(responses, extra, strict=True)]
    assert_allclose(largest(*responses), found.gamma, rtol=1e-3)
    assert largest(*responses) <= found.gamma * (1.0 + 1e-9)
    loop = lower_lft(found.plant, found.controller)
    assert loop.is_stable
    assert_allclose(hinf_norm(loop).value, found.gamma, rtol=1e-9)
    assert found.gamma <= 1.02 * found.design.least


def test_a_disturbance_makes_an_integrator_solvable() -> None:
    """1/s² has its poles on the axis; what enters at the controls must be held there, too."""
    axis = transfer_function([1.0], [1.0, 0.0, 0.0])
    weight = performance_weight(0.3, 2.0, 1e-3)
    found = mixed_sensitivity(axis, weight, 0.5, disturbance=0.1)
    assert found.complementary.is_stable
    assert_allclose(found.complementary.response(np.zeros(1)), 1.0, rtol=1e-9)
    assert found.gamma < 5.0


def test_a_sampled_process() -> None:
    g = transfer_function([0.1], [1.0, -0.9], 0.1)
    weight = shelving_weight(50.0, 0.5, 1.0, dt_s=0.1)
    found = mixed_sensitivity(g, weight, 0.1)
    omega = np.linspace(0.0, np.pi / 0.1, 4001)
    top = largest(
        weight.response(omega) * found.sensitivity.response(omega),
        0.1 * found.control.response(omega),
    )
    assert_allclose(top, found.gamma, rtol=1e-4)
    assert found.controller.dt_s == 0.1


def test_the_plant_is_that_of_the_definition() -> None:
    g, w1, w3 = disturbance_process(), shelving_weight(10.0, 0.1, 1.0), shelving_weight(0.1, 9, 5)
    made = mixed_sensitivity_plant(g, w1, 2.0, w3)
    assert made.inputs == ("r", "u")
    assert made.outputs == ("z1", "z2", "z3", "e")
    gw, w1w, w3w = (s.response(OMEGA)[:, 0, 0] for s in (g, w1, w3))
    expected = np.array(
        [[w1w, -w1w * gw], [0 * gw, 2 + 0 * gw], [0 * gw, w3w * gw], [1 + 0 * gw, -gw]]
    )
    assert_allclose(np.moveaxis(made.response(OMEGA), 0, 2), expected, rtol=1e-9, atol=1e-12)


def test_what_makes_no_problem_is_refused() -> None:
    g = disturbance_process()
    with pytest.raises(InputError, match="at least one weight"):
        mixed_sensitivity(g, None)
    with pytest.raises(InputError, match="disturbance must be ≥ 0"):
        mixed_sensitivity(g, 1.0, disturbance=-1.0)
    with pytest.raises(InputError, match="W2 must take 1 signals, got 2"):
        mixed_sensitivity(g, 1.0, two_by_two())
    integrator = transfer_function([1.0], [1.0, 0.0])
    with pytest.raises(NotStabilisableError, match="the controls do not reach"):
        mixed_sensitivity(transfer_function([1.0, 0.0], [1.0, 2.0]), integrator, 1.0)
