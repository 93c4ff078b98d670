from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem

LAG = LtiSystem(np.array([[-2.0]]), np.array([[4.0]]), np.array([[1.0]]), np.array([[0.5]]))


def test_response_of_a_lag() -> None:
    omega = np.array([0.0, 1.0, 2.0, np.inf])
    expected = 0.5 + 4.0 / (1j * omega[:3] + 2.0)
    assert_allclose(LAG.response(omega)[:, 0, 0], [*expected, 0.5], rtol=1e-15)


def test_response_in_discrete_time() -> None:
    delay = LtiSystem(
        np.zeros((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)), dt_s=0.1
    )
    omega = np.array([0.0, 3.0, 31.0])
    assert_allclose(delay.response(omega)[:, 0, 0], np.exp(-0.1j * omega), rtol=0, atol=1e-15)


def test_stability_needs_the_open_half_plane_or_disc() -> None:
    one = np.ones((1, 1))
    assert LAG.is_stable
    assert not LtiSystem(0.0 * one, one, one, one).is_stable
    assert LtiSystem(0.0 * one, one, one, one, dt_s=1.0).is_stable
    assert not LtiSystem(-one, one, one, one, dt_s=1.0).is_stable


def test_a_part_by_names() -> None:
    system = LtiSystem(
        np.diag([-1.0, -2.0]), np.eye(2), np.array([[1.0, 2.0], [3.0, 4.0]]), np.zeros((2, 2)),
        inputs=("u", "v"), outputs=("y", "z"),
    )  # fmt: skip
    part = system.of(["z", "y"], ["v"])
    assert part.inputs == ("v",)
    omega = np.array([0.7])
    assert_allclose(part.response(omega), system.response(omega)[:, ::-1, 1:], rtol=1e-15)
    with pytest.raises(InputError, match="no input 'w'; there are: u, v"):
        system.of(["z"], ["w"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"b": np.ones((2, 1))}, "B must be 1 × 1 to fit the others, got 2 × 1"),
        ({"a": np.array([[np.nan]])}, "A must be a matrix of finite numbers"),
        ({"c": np.ones(1)}, "C must be a matrix of finite numbers, got shape"),
        ({"dt_s": 0.0}, "a sampling period must be a number > 0 s, got 0.0"),
        ({"inputs": ("u", "v")}, "inputs: 1 different names are needed"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict[str, object], message: str) -> None:
    given = {"a": LAG.a, "b": LAG.b, "c": LAG.c, "d": LAG.d} | change
    with pytest.raises(InputError, match=message):
        LtiSystem(**given)  # type: ignore[arg-type]


# --- arithmetic

TWO = LtiSystem(
    np.array([[-1.0, 0.5], [0.0, -3.0]]), np.eye(2), np.array([[1.0, 2.0], [3.0, 4.0]]),
    np.array([[0.0, 1.0], [0.5, 0.0]]), inputs=("u", "v"), outputs=("y", "z"),
)  # fmt: skip
AT = np.array([0.3 + 0.2j, -1.5j, 2.0])


def test_series_is_the_product_of_matrices_right_one_first() -> None:
    other = LtiSystem(-np.eye(1), np.array([[1.0, 2.0]]), np.array([[1.0], [-1.0]]), np.eye(2))
    assert_allclose((TWO @ other)(AT), TWO(AT) @ other(AT), rtol=1e-13)
    assert_allclose((TWO * other)(AT), TWO(AT) @ other(AT), rtol=1e-13)
    assert (TWO @ other).outputs == ("y", "z")
    row = np.array([[1.0, 2.0]])
    assert_allclose((row @ TWO)(AT), row @ TWO(AT), rtol=1e-13)
    assert_allclose((TWO * row.T)(AT), TWO(AT) @ row.T, rtol=1e-13)
    with pytest.raises(InputError, match="1 outputs into 2 inputs do not fit"):
        TWO @ LAG


def test_sums_and_factors() -> None:
    assert_allclose((TWO + TWO)(AT), 2.0 * TWO(AT), rtol=1e-13)
    assert_allclose((2.0 * TWO - TWO / 2.0)(AT), 1.5 * TWO(AT), rtol=1e-13)
    assert_allclose((np.eye(2) - TWO)(AT), np.eye(2) - TWO(AT), rtol=1e-13)
    assert_allclose((-TWO)(AT), -TWO(AT), rtol=1e-13)
    assert_allclose((1.0 + LAG)(AT), 1.0 + LAG(AT), rtol=1e-13)
    assert_allclose((1 - LAG * np.float64(3.0))(AT), 1.0 - 3.0 * LAG(AT), rtol=1e-13)
    with pytest.raises(InputError, match="a number is no term of a sum of 2 × 2 systems"):
        TWO + 1.0
    with pytest.raises(InputError, match="one shape"):
        TWO + LAG
    sampled = LtiSystem(LAG.a / 9.0, LAG.b, LAG.c, LAG.d, 0.1)
    with pytest.raises(InputError, match="different sampling periods"):
        LAG @ sampled
    assert (2.0 - sampled).dt_s == 0.1
    with pytest.raises(TypeError):
        LAG + "a"


def test_parts_by_index_slice_and_name() -> None:
    whole = TWO(AT)
    assert_allclose(TWO[0, 1](AT), whole[:, :1, 1:], rtol=1e-13)
    assert_allclose(TWO["z", :](AT), whole[:, 1:, :], rtol=1e-13)
    assert_allclose(TWO[::-1, ["v"]](AT), whole[:, ::-1, 1:], rtol=1e-13)
    assert_allclose(TWO[[-1], 0](AT), whole[:, 1:, :1], rtol=1e-13)
    assert TWO[["z", "y"], 0].outputs == ("z", "y")
    for outputs, inputs in ((2, 0), ("u", 0), (0, True)):
        with pytest.raises(InputError, match=r"no (output|input) "):
            TWO[outputs, inputs]
    with pytest.raises(InputError, match=r"G\[outputs, inputs\]"):
        TWO[0]  # type: ignore[index]


def test_values_have_the_shape_of_s() -> None:
    assert LAG(1.0 + 1j).shape == (1, 1)
    assert LAG(1.0).item() == pytest.approx(0.5 + 4.0 / 3.0)
    assert TWO(AT.reshape(3, 1)).shape == (3, 1, 2, 2)
    assert LAG(np.inf).item() == 0.5
    assert_allclose(LAG(1j * np.array([0.7])), LAG.response(np.array([0.7])), rtol=1e-15)
    with pytest.raises(InputError, match="is that of a pole"):
        LAG(-2.0)
    with pytest.raises(InputError, match="complex numbers"):
        LAG(np.nan)


def test_repr_is_one_line() -> None:
    assert repr(LAG) == "<LtiSystem: 1 state, 1 input, 1 output, continuous time, stable>"
    one = np.ones((1, 1))
    loose = LtiSystem(1.5 * one, one, one, one, 0.1, ("u",), ("y",))
    assert repr(loose) == (
        "<LtiSystem: 1 state, 1 input (u), 1 output (y), sampled every 0.1 s, 1 pole not stable>"
    )


def test_it_stays_frozen_and_compares_by_identity() -> None:
    with pytest.raises(AttributeError):
        LAG.dt_s = 1.0  # type: ignore[misc]
    assert len({LAG, -LAG}) == 2
