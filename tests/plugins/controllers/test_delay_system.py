"""Systems with delays: their algebra is exact, and what has no meaning is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

import hillsphere_controllers as hc
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.delays.algebra import (
    append,
    approximate_delays,
    connect,
    delay,
    feedback,
    parallel,
    series,
    with_delays,
)
from hillsphere_controllers.delays.system import DelaySystem
from hillsphere_controllers.systems.algebra import append as append_plain
from hillsphere_controllers.systems.algebra import gain
from hillsphere_controllers.systems.algebra import series as plain_series
from hillsphere_controllers.systems.conversion import transfer_function

OMEGA = np.array([0.0, 0.1, 1.0, 7.3, 50.0])
S = 1j * OMEGA
LAG = transfer_function([2.0], [1.0, 3.0])
LEAD = transfer_function([1.0, 1.0], [0.2, 1.0])
INTEGRATOR = transfer_function([1.0], [1.0, 0.0])


def at(system: DelaySystem, omega: Array = OMEGA) -> NDArray[np.complex128]:
    """Return the response (K,) of one input and one output."""
    return np.asarray(system.response(omega)[:, 0, 0])


def test_algebra_is_that_of_transfer_functions() -> None:
    """Every operation against the same operation on the numbers e^{-sT} and G(s)."""
    late, lag, lead = delay(0.7), 2.0 / (S + 3.0), (S + 1.0) / (0.2 * S + 1.0)
    e = np.exp(-0.7 * S)
    assert_allclose(at(LAG @ late), lag * e, rtol=1e-13)
    assert_allclose(at(late * LAG * 3.0), 3.0 * lag * e, rtol=1e-13)
    assert_allclose(at(1.0 + late), 1.0 + e, rtol=1e-13)
    assert_allclose(at(LAG - late), lag - e, rtol=1e-13)
    assert_allclose(at(LEAD * 2.0 + late @ LAG), 2.0 * lead + e * lag, rtol=1e-13)
    assert_allclose(at(-late / 2.0), -e / 2.0, rtol=1e-13)
    assert_allclose(at(series(late, LAG, late)), lag * e**2, rtol=1e-13)
    assert_allclose(at(parallel(late, LAG, 1.0)), e + lag + 1.0, rtol=1e-13)
    # a loop that the delay's direct terms close, and a delay in either place
    assert_allclose(at(feedback(LEAD, late)), lead / (1.0 + lead * e), rtol=1e-13)
    assert_allclose(at(feedback(late, LEAD * 0.5, 1)), e / (1.0 - 0.5 * lead * e), rtol=1e-13)
    # the functions without types for delays work by the operators
    assert_allclose(at(plain_series(LAG, late)), lag * e, rtol=1e-13)  # type: ignore[arg-type]


def test_a_pole_that_feedback_moves_is_no_pole_of_the_response() -> None:
    """1/s closed by a delay: at s = 0 the integrator is infinite, the loop is 1."""
    assert_allclose(at(feedback(INTEGRATOR, delay(0.5)), np.zeros(1)), 1.0, rtol=1e-14)
    with pytest.raises(InputError, match="that of a pole"):
        (delay(0.5) @ INTEGRATOR).response(np.zeros(1))


def test_smith_predictor_takes_the_delay_out_of_the_loop() -> None:
    """With C/(1 + C (P − P e^{-sT})) the response is e^{-sT} C P/(1 + C P) (Smith 1957)."""
    controller, late = LEAD * 4.0, LAG @ delay(1.3)
    predictor = feedback(controller, LAG - late)
    loop = late @ predictor
    closed = feedback(loop, np.eye(1))
    lag, lead = 2.0 / (S + 3.0), 4.0 * (S + 1.0) / (0.2 * S + 1.0)
    wanted = np.exp(-1.3 * S) * lag * lead / (1.0 + lag * lead)
    assert_allclose(at(closed), wanted, rtol=1e-12)
    assert closed.delays_s == (1.3, 1.3)


def test_channels_have_their_own_delays() -> None:
    square = gain(np.array([[1.0, 2.0], [3.0, 4.0]]))
    made = with_delays(square, input_s=[0.0, 0.5], output_s=[0.2, 0.0])
    assert sorted(made.delays_s) == [0.2, 0.5]
    into, out = np.exp(-0.5 * S), np.exp(-0.2 * S)
    wanted = np.array([[out, 2.0 * out * into], [3.0 + 0.0 * S, 4.0 * into]])
    assert_allclose(made.response(OMEGA), np.moveaxis(wanted, -1, 0), rtol=1e-13)
    assert made[1, 0].delays_s == made.delays_s  # a part keeps the delays, as it keeps the states
    assert_allclose(at(made[0, 1]), wanted[0, 1], rtol=1e-13)
    assert_allclose(made[[1], :].response(OMEGA)[:, 0, :], wanted[1].T, rtol=1e-13)
    both = append(made, LAG)
    assert both.shape == (3, 3)
    assert_allclose(both.response(OMEGA)[:, 2, 2], 2.0 / (S + 3.0), rtol=1e-13)


def test_connection_by_names() -> None:
    plant = hc.with_names(with_delays(LAG, input_s=0.4), "u", "y")
    controller = hc.with_names(LEAD, "e", "u")
    parts: list[LtiSystem | DelaySystem] = [plant, controller]
    made = hc.connect(parts, ["e = r - y"], ["r"], ["y", "e"])
    assert isinstance(made, DelaySystem)
    assert (made.inputs, made.outputs) == (("r",), ("y", "e"))
    loop = 2.0 / (S + 3.0) * np.exp(-0.4 * S) * (S + 1.0) / (0.2 * S + 1.0)
    assert_allclose(at(made["y", "r"]), loop / (1.0 + loop), rtol=1e-12)
    assert_allclose(at(made["e", "r"]), 1.0 / (1.0 + loop), rtol=1e-12)
    assert append(plant, controller).inputs == ("u", "e")
    assert append_plain(LAG, LEAD).inputs == append(LAG, LEAD).inputs == ()
    with pytest.raises(InputError, match="no output 'x'"):
        made["x", "r"]
    with pytest.raises(InputError, match="has no names"):
        connect([delay(1.0)], [], ["u"], ["y"])


def test_undelayed_system_and_infinite_frequency() -> None:
    made = feedback(LAG, delay(1.0))
    assert_allclose(made.undelayed.poles, [-5.0])
    assert_allclose(made.response(np.array([np.inf])), 0.0)
    with pytest.raises(InputError, match="no limit"):
        delay(1.0).response(np.array([np.inf]))
    assert repr(made) == "<DelaySystem: 1 states, 1 inputs, 1 outputs, delays (1) s>"


def test_pade_takes_the_place_of_every_delay() -> None:
    """Of order 5, its error at ω T = 1 is (5!)²/(10! 11!) = 1e-10."""
    made = feedback(LEAD, delay(1.0) @ LAG)
    omega = np.array([0.1, 0.5, 1.0])
    pade = hc.pade(made, 5)
    assert isinstance(pade, LtiSystem)
    assert pade.order == made.order + 5
    assert_allclose(pade.response(omega), made.response(omega), rtol=1e-9)
    assert hc.pade(0.5, 2).order == 2
    assert approximate_delays(LAG @ DelaySystem(gain(np.eye(1)), ()), 3).order == 1


def test_toolbox_takes_systems_with_delays() -> None:
    late = hc.with_delays(LAG, input_s=0.4)
    closed = hc.feedback(late * 3.0)
    assert isinstance(closed, DelaySystem)
    assert hc.isstable(closed)
    assert hc.isstable(LAG)
    assert_allclose(hc.freqresp(late, OMEGA), late.response(OMEGA))
    curve = hc.bode(late)
    assert_allclose(
        curve.phase_rad[:, 0, 0],
        -0.4 * curve.omega_rad_s - np.arctan(curve.omega_rad_s / 3.0),
        atol=1e-9,
    )
    assert_allclose(hc.sigma(late, OMEGA).values[:, 0], np.abs(at(late)), rtol=1e-12)
    assert hc.append(late, LAG).shape == (2, 2)
    assert hc.feedback(np.eye(1), late).shape == (1, 1)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: DelaySystem(gain(np.eye(2), 0.1), (1.0,)), "discrete time"),
        (lambda: delay(1.0) @ LtiSystem([[0.5]], [[1.0]], [[1.0]], [[0.0]], 0.1), "discrete time"),  # type: ignore[arg-type]
        (lambda: DelaySystem(gain(np.eye(2)), (0.0,)), "> 0 s"),
        (lambda: DelaySystem(gain(np.eye(2)), (np.nan,)), "> 0 s"),
        (lambda: DelaySystem(gain(np.eye(2)), "late"), "row of numbers"),  # type: ignore[arg-type]
        (lambda: DelaySystem(gain(np.eye(1)), (1.0, 2.0)), "2 delays need"),
        (lambda: DelaySystem(np.eye(2), (1.0,)), "LtiSystem is needed"),  # type: ignore[arg-type]
        (lambda: with_delays(LAG, input_s=-1.0), "≥ 0 s"),
        (lambda: with_delays(LAG, output_s=[1.0, 2.0]), "one for each"),
        (lambda: delay(1.0, 2) @ LAG, "do not fit"),
        (lambda: delay(1.0, 2) + LAG, "one shape"),
        (lambda: delay(1.0, 0), "at least one channel"),
        (lambda: series(), "at least one"),
        (lambda: feedback(LAG, delay(1.0), 2), "sign"),
        (lambda: feedback(LAG, delay(1.0, 2)), "to fit"),
        # the loop -1 + 1 without the delay has no solution
        (lambda: feedback(1.0, -1.0 + delay(1.0)), "not well posed"),
        (lambda: hc.step(delay(1.0)), "step response of a system with delays"),  # type: ignore[arg-type]
        (lambda: hc.margins(delay(0.2) @ (0.5 + LAG)), "delays and a direct term"),
        (lambda: delay(-1.0), "time_s: a delay must be"),
        (lambda: hc.feedback(hc.ureal("a", 1.0), delay(1.0)), "padecover"),  # type: ignore[call-overload]
        (lambda: hc.ureal("a", 1.0) * delay(1.0), "has delays"),
        (lambda: hc.hinfsyn(delay(1.0, 2), 1, 1), "has delays"),  # type: ignore[type-var]
        (lambda: hc.to_control(delay(1.0)), "has delays"),  # type: ignore[arg-type]
        (lambda: hc.padecover(DelaySystem(LAG, ())), "no delays"),
        (lambda: hc.padecover(delay(1.0), 1, weight_order=4), "from 1 to 3"),
        (lambda: delay(1.0)("a"), "complex numbers"),
        (lambda: delay(1.0)(-1e6), "so far to the left"),
    ],
)  # fmt: skip
def test_faults(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()
