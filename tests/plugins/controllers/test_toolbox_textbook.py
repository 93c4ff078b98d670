"""Textbook problems through the flat namespace, with their published numbers."""

from __future__ import annotations

import numpy as np
import pytest

import hillsphere_controllers as hc


def disturbance_process() -> hc.LtiSystem:
    """Skogestad and Postlethwaite, Multivariable Feedback Control (2005), section 2.6.3."""
    fast = hc.transfer_function([1.0], [0.05, 1.0])
    return 200.0 * hc.transfer_function([1.0], [10.0, 1.0]) * fast * fast


def test_skogestad_postlethwaite_example_2_17_mixed_sensitivity() -> None:
    """γ 1.37, M_S 1.30, M_T 1.0, gain margin 8.04, phase margin 71.2° at 7.22 rad/s."""
    plant = disturbance_process()
    w1 = hc.performance_weight(10.0, peak=1.5, steady_error=1e-4)
    design = hc.mixsyn(plant, w1, 1.0)
    assert design.gamma == pytest.approx(1.37, abs=0.01)
    assert hc.hinfnorm(design.S).value == pytest.approx(1.30, abs=0.02)
    assert hc.hinfnorm(design.T).value == pytest.approx(1.0, abs=0.01)
    # The book's margins are those of the least γ; the default keeps 0.5 % away from it.
    (margins,) = hc.margins(plant @ hc.mixsyn(plant, w1, 1.0, back_off=1e-4).K)
    assert margins.gain_upper == pytest.approx(8.04, abs=0.02)
    assert np.degrees(margins.phase_rad) == pytest.approx(71.2, abs=0.05)
    assert margins.phase_rad_s == pytest.approx(7.22, abs=0.01)
    (farther,) = hc.margins(plant @ design.K)
    assert farther.gain_upper < margins.gain_upper


def test_skogestad_postlethwaite_example_9_3_loop_shaping() -> None:
    """The least γ is 2.34, a margin of 0.43, for W₁ = (s + 2)/s."""
    design = hc.ncfsyn(disturbance_process(), hc.transfer_function([1.0, 2.0], [1.0, 0.0]))
    assert 1.0 / design.emax == pytest.approx(2.34, abs=0.005)
    assert design.emax == pytest.approx(0.43, abs=0.005)
    assert hc.ncfmargin(design.Gs, design.Ks, sign=1) == pytest.approx(1.0 / design.gamma)


def test_zhou_doyle_chapter_17_gaps() -> None:
    """Essentials of Robust Control (1998): 100/(2 s ± 1) are near, 100/(s + 1)² is far."""
    one, two = (hc.transfer_function([100.0], [2.0, sign]) for sign in (1.0, -1.0))
    three = hc.transfer_function([100.0], [1.0, 2.0, 1.0])
    for pair, both in (((one, two), 0.02), ((one, three), 0.8988), ((two, three), 0.8941)):
        made = hc.gapmetric(*pair)
        assert made.gap == pytest.approx(both, abs=6e-5)
        assert made.nugap == pytest.approx(both, abs=6e-5)


@pytest.mark.parametrize("zero", [0.5, 2.0])
def test_doyle_francis_tannenbaum_bound_by_a_zero(zero: float) -> None:
    """Feedback Control Theory (1992), section 6.2: min ‖W₁ S‖ = |W₁(z)| for one unstable zero z."""
    plant = hc.transfer_function([-1.0, zero], [1.0, 3.0, 2.0])
    w1 = hc.performance_weight(0.4, peak=2.0, steady_error=0.01)
    exact = abs(w1(zero).item())
    design = hc.mixsyn(plant, w1, 1e-4)
    assert exact * (1.0 - 1e-6) <= design.gamma <= 1.02 * exact


def test_skogestad_postlethwaite_3_7_1_spinning_satellite() -> None:
    """Each loop alone bears any gain; ±1/√(a² + 1) on both at once, 10 % for a = 10, is too much.

    The closed loop with gains 1 + ε₁, 1 + ε₂ is stable where
    1 + ε₁ + ε₂ + (a² + 1) ε₁ ε₂ > 0 and 2 + ε₁ + ε₂ > 0.
    """
    a = 10.0
    plant = hc.LtiSystem(
        np.array([[0.0, a], [-a, 0.0]]),
        np.eye(2),
        np.array([[1.0, a], [-a, 1.0]]),
        np.zeros((2, 2)),
    )
    for loop in hc.margins(plant):
        assert loop.gain_upper == np.inf
    assert hc.hinfnorm(hc.feedback(plant)).value == pytest.approx(np.sqrt(1.0 + a**2), rel=1e-6)
    gains = hc.append(hc.ureal("k1", 1.0, plusminus=0.1), hc.ureal("k2", 1.0, plusminus=0.1))
    margin = hc.robstab(hc.feedback(plant @ gains, np.eye(2)))
    exact = 10.0 / np.sqrt(a**2 + 1.0)
    assert margin.lower_bound <= exact * (1.0 + 1e-6)
    assert margin.lower_bound == pytest.approx(exact, rel=0.02)
    assert margin.upper_bound == pytest.approx(exact, rel=0.02)
    assert margin.worst["k1"] - 1.0 == pytest.approx(-(margin.worst["k2"] - 1.0), abs=2e-3)
    # all channels at once bear much less than each alone
    disk = hc.diskmargin(plant)
    assert disk.disk_margin < 0.2 < 1.9 < min(disk.loops)


def distillation() -> tuple[hc.LtiSystem, hc.LtiSystem]:
    """Return plant and inverse-based controller of the distillation process, section 8.11.3."""
    matrix = np.array([[87.8, -86.4], [108.2, -109.6]])
    plant = matrix @ hc.append(*2 * [hc.transfer_function([1.0], [75.0, 1.0])])
    action = hc.append(*2 * [hc.transfer_function([0.7 * 75.0, 0.7], [1.0, 0.0])])
    return plant, np.linalg.inv(matrix) @ action


def test_skogestad_postlethwaite_8_11_3_distillation() -> None:
    """Nominal performance 0.5, robust stability µ 0.53, robust performance µ 5.78, worst 44.93."""
    plant, controller = distillation()
    w_input = hc.transfer_function([1.0, 0.2], [0.5, 1.0])
    # the integral of the weight (s/2 + 0.05)/s leaks, or the closed loop were not stable
    w_error = hc.append(*2 * [hc.transfer_function([0.5, 0.05], [1.0, 1e-5])])
    delta = hc.append(*(w_input @ hc.ultidyn(name) for name in ("d1", "d2")))
    loop = plant @ (np.eye(2) + delta) @ controller
    weighted = w_error @ hc.feedback(np.eye(2), loop)
    assert hc.hinfnorm(weighted.nominal).value == pytest.approx(0.5, abs=0.01)
    stability = hc.robstab(weighted)
    assert 1.0 / stability.lower_bound == pytest.approx(0.53, abs=0.01)
    omega = np.geomspace(1e-2, 10.0, 61)
    bounds = hc.mussv(weighted.system, [[1, 1], [1, 1], [2, 2]], omega)
    assert bounds.upper.max() == pytest.approx(5.78, abs=0.03)
    assert bounds.lower.max() == pytest.approx(5.78, abs=0.05)
    worst = hc.wcgain(weighted)
    assert worst.lower_bound == pytest.approx(44.93, rel=0.02)
    assert worst.upper_bound >= 44.93
    margin = hc.robgain(weighted, 44.93)
    assert margin.lower_bound == pytest.approx(1.0, abs=0.03)
