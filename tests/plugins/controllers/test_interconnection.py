"""Connection by names against the same arithmetic on frequency responses."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.algebra import gain
from hillsphere_controllers.systems.interconnection import connect, with_names

OMEGA = np.array([0.0, 0.4, 3.0, 50.0])


def system(seed: int, outputs: int, inputs: int, dt_s: float | None = None) -> LtiSystem:
    random = np.random.default_rng(seed)
    return LtiSystem(
        random.normal(size=(3, 3)),
        random.normal(size=(3, inputs)),
        random.normal(size=(outputs, 3)),
        0.3 * random.normal(size=(outputs, inputs)),
        dt_s,
    )


@pytest.mark.parametrize("dt_s", [None, 0.1])
@pytest.mark.parametrize("size", [1, 2])
def test_generalised_plant_of_two_weights(size: int, dt_s: float | None) -> None:
    """[W1 −W1 G; 0 W2; I −G] of mixed sensitivity."""
    g, w1, w2 = (system(k, size, size, dt_s) for k in (1, 2, 3))
    plant = connect(
        [with_names(g, "u", "y"), with_names(w1, "e", "z1"), with_names(w2, "u", "z2")],
        ["e = r - y"],
        ["r", "u"],
        ["z1", "z2", "e"],
    )
    gw, w1w, w2w = (s.response(OMEGA[:3]) for s in (g, w1, w2))
    one, zero = np.broadcast_to(np.eye(size), gw.shape), np.zeros_like(gw)
    expected = np.block([[w1w, -w1w @ gw], [zero, w2w], [one, -gw]])
    assert_allclose(plant.response(OMEGA[:3]), expected, rtol=1e-10, atol=1e-14)
    assert plant.order == 9
    assert plant.dt_s == dt_s
    assert plant.inputs == (("r", "u") if size == 1 else ("r[0]", "r[1]", "u[0]", "u[1]"))


def test_closed_loop_with_sums_of_sums() -> None:
    g, k = system(4, 1, 1), system(5, 1, 1)
    loop = connect(
        [with_names(g, "v", "y"), with_names(k, "e", "u")],
        ["v = u + d", "m = y + n", "e = -m + r"],
        ["r", "d", "n"],
        ["y", "u", "r"],
    )
    gw, kw = g.response(OMEGA)[:, 0, 0], k.response(OMEGA)[:, 0, 0]
    s = 1.0 / (1.0 + gw * kw)
    zero, one = np.zeros_like(s), np.ones_like(s)
    expected = np.array(
        [
            [gw * kw * s, gw * s, -gw * kw * s],
            [kw * s, -kw * gw * s, -kw * s],
            [one, zero, zero],
        ]
    )
    assert_allclose(np.moveaxis(loop.response(OMEGA), 0, 2), expected, rtol=1e-9, atol=1e-13)


def test_signals_of_several_systems_make_one_bus() -> None:
    """Numbers as MATLAB writes them, too; a state keeps its name."""
    named = LtiSystem(-np.eye(1), np.eye(1), np.eye(1), np.zeros((1, 1)), states=("tank",))
    parts = [
        with_names(named, ["u(1)"], ["y(1)"]),
        with_names(gain(np.array([[3.0]])), ["u(2)"], ["y(2)"]),
    ]
    made = connect(parts, ["e = r - y"], ["u", "r"], ["e"])
    assert made.inputs == ("u(1)", "u(2)", "r[0]", "r[1]")
    assert made.states == ("tank",)
    expected = np.array([[-1.0 / (1.0 + 1j), 0.0, 1.0, 0.0], [0.0, -3.0, 0.0, 1.0]])
    assert_allclose(made.response(np.array([1.0]))[0], expected, rtol=1e-14, atol=1e-300)


def test_what_does_not_connect_is_named() -> None:
    g = with_names(system(6, 1, 1), "u", "y")
    two = with_names(system(7, 2, 2), "u2", "y2")
    for systems, sums, inputs, outputs, message in (
        ([system(6, 1, 1)], [], ["u"], ["y"], "no names"),
        ([g], [], [], ["y"], "nothing makes the signal 'u'"),
        ([g], [], ["u", "w"], ["y"], "'w' is used nowhere"),
        ([g], [], ["u"], ["x"], "nothing makes the output 'x'"),
        ([g], [], ["u"], ["y", "y"], "is listed twice"),
        ([g, g], [], ["u"], ["y"], "made twice"),
        ([g], ["e = r * y"], ["u", "r"], ["e"], "a junction reads"),
        ([g, two], ["e = y - y2"], ["u", "u2"], ["e"], "does not fit"),
        ([with_names(gain(np.eye(1)), "u", "y")], ["u = y + r"], ["r"], ["y"], "not well posed"),
    ):
        with pytest.raises(InputError, match=message):
            connect(systems, sums, inputs, outputs)
    with pytest.raises(InputError, match="2 different names"):
        with_names(system(7, 2, 2), ["a"], "y")


def test_numbers_that_leave_a_signal_out_are_refused() -> None:
    """No signal of a bus is dropped, and none is taken for another."""
    for first, second, message in (
        (["y[0]", "y[1]"], ["y(1)", "y(2)"], "in two ways"),
        (["y[0]", "y[2]"], ["y(2)", "y(3)"], "in two ways"),
        (["y[0]", "y[00]"], ["w", "x"], "'y\\[00\\]' and 'y\\[0\\]'"),
        (["y[0]", "y[2]"], ["w", "x"], "have a gap"),
        (["y(2)", "y(3)"], ["w", "x"], "have a gap"),
    ):
        parts = [with_names(gain(np.ones((2, 1))), ["a"], first),
                 with_names(gain(np.ones((2, 1))), ["b"], second)]  # fmt: skip
        for sums, outputs in ((["e = y"], ["e"]), ([], ["y"])):
            with pytest.raises(InputError, match=message):
                connect(parts, sums, ["a", "b"], outputs)


def test_bus_has_the_signals_that_sums_and_inputs_give_it() -> None:
    """A signal by itself has whatever number; the name alone means all of them."""
    part = with_names(gain(np.array([[1.0], [2.0]])), ["a"], ["y[1]", "y[2]"])
    made = connect([part], ["y[0] = a + b", "e = y"], ["a", "b"], ["e"])
    assert_allclose(made.d, [[1.0, 1.0], [1.0, 0.0], [2.0, 0.0]], rtol=0, atol=0)
    apart = connect([part], ["e = y[2] - r[5]"], ["a", "r[5]"], ["e"])
    assert_allclose(apart.d, [[2.0, -1.0]], rtol=0, atol=0)
    counted = connect([part], ["e = r - y"], ["r", "a"], ["e"])
    assert counted.inputs == ("r[0]", "r[1]", "a")
