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
