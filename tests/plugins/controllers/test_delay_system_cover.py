"""Padé approximations with their error as uncertain dynamics, and a design with them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import hillsphere_controllers as hc
from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.delays.algebra import delay, feedback
from hillsphere_controllers.delays.cover import pade_cover, pade_error_weight
from hillsphere_controllers.delays.stability import judge_stability
from hillsphere_controllers.delays.system import DelaySystem
from hillsphere_controllers.systems.delay import pade_delay


@pytest.mark.parametrize("order", [1, 2, 4, 8])
@pytest.mark.parametrize("weight_order", [1, 2, 3])
def test_weight_covers_the_error_closely(order: int, weight_order: int) -> None:
    time = 0.3
    weight = pade_error_weight(time, order, weight_order)
    assert weight.is_stable
    omega = np.geomspace(1e-3, 1e4, 20001) / time
    error = np.abs(np.exp(-1j * omega * time) - pade_delay(time, order).response(omega)[:, 0, 0])
    size = np.abs(weight.response(omega)[:, 0, 0])
    seen = error > 1e-8  # the approximation itself is rounded
    ratio = size[seen] / error[seen]
    assert 1.0 < ratio.min() < 1.002  # no smaller weight of this form does
    assert size[-1] <= 2.5
    # the error of the first order by hand: 2 |sin(x/2 − arctan(x/2))|
    if order == 1:
        x = omega * time
        assert_allclose(error, 2.0 * np.abs(np.sin(0.5 * x - np.arctan(0.5 * x))), atol=1e-9)


@pytest.mark.parametrize("order", range(1, 9))
@pytest.mark.parametrize("share", [1e-6, 0.05, 1.0])
def test_weight_covers_all_delays_of_a_range(order: int, share: float) -> None:
    """Frequencies and delays at random, those at the ends of the range among them."""
    time, rng = 0.3, np.random.default_rng(order)
    weight = pade_error_weight(time, order, spread_s=share * time)
    omega = 10.0 ** rng.uniform(-4.0, 4.0, 2000) / time
    late = time * (1.0 + share * rng.choice([-1.0, 1.0, rng.uniform(-1.0, 1.0)], omega.size))
    error = np.abs(np.exp(-1j * omega * late) - pade_delay(time, order).response(omega)[:, 0, 0])
    ratio = error / np.abs(weight.response(omega)[:, 0, 0])
    seen = error > 1e-9  # the approximation itself is rounded
    assert 0.9 < ratio[seen].max() < 1.0


@pytest.mark.parametrize("spread", [-0.1, 1.1, np.nan, "0.1", (0.1, 0.1)])
def test_a_spread_is_a_part_of_the_delay(spread: object) -> None:
    with pytest.raises(InputError, match="spread"):
        hc.padecover(delay(1.0), spread_s=spread)  # type: ignore[arg-type]


def test_cover_contains_the_delay_at_every_frequency() -> None:
    """The Δ that makes each delay exact has a gain below one."""
    system = feedback(hc.transfer_function([1.0], [1.0, 1.0]), delay(0.8) @ (0.5 * delay(0.3)))
    cover = pade_cover(system, 2)
    assert [u.name for u in cover.uncertainties] == ["delay1", "delay2"]
    omega = np.array([0.3, 2.0, 11.0])
    values = {}
    for k, time in enumerate(system.delays_s):
        rest = np.exp(-1j * omega * time) - pade_delay(time, 2).response(omega)[:, 0, 0]
        values[f"delay{k + 1}"] = rest / pade_error_weight(time, 2).response(omega)[:, 0, 0]
        assert np.abs(values[f"delay{k + 1}"]).max() < 1.0
    for k in range(omega.size):
        one = {name: np.array([[[value[k]]]]) for name, value in values.items()}
        made = cover.response(omega[k : k + 1], one)[0]
        assert_allclose(made, system.response(omega[k : k + 1]), rtol=1e-10)


def test_a_design_with_the_cover_holds_with_the_delay() -> None:
    """An unstable plant e^{-0.2 s}/(s − 1): certified µ < 1, then the loop itself is judged."""
    plant = hc.with_names(
        hc.with_delays(hc.transfer_function([1.0], [1.0, -1.0]), input_s=0.2), "u", "y"
    )
    error = hc.with_names(hc.performance_weight(0.5, peak=3.0, steady_error=0.1), "e", "z1")
    effort = hc.with_names(hc.gain(np.array([[0.05]])), "u", "z2")
    parts: list[LtiSystem | DelaySystem] = [plant, error, effort]
    open_loop = hc.connect(parts, ["e = r - y"], ["r", "u"], ["z1", "z2", "e"])
    assert isinstance(open_loop, DelaySystem)
    design = hc.musyn(hc.padecover(open_loop), 1, 1, iterations=1, joint_steps=0)
    assert design.mu < 0.8
    controller = hc.with_names(design.K, "e", "u")
    closed = hc.connect([*parts, controller], ["e = r - y"], ["r"], ["z1", "z2"])
    assert isinstance(closed, DelaySystem)
    assert judge_stability(closed).stable
    norm = hc.hinfnorm(closed)
    # robust performance: the gain is at most µ for all Δ of size 1/µ > 1, the delay's among them
    assert norm.upper <= design.mu
    assert norm.value > 0.9 * design.mu
