"""GravityField on models that this file defines."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from hillsphere.dynamics import ArrayFunction
from hillsphere.errors import ConvergenceError, InputError
from hillsphere.gravity import (
    GravityField,
    acceleration_at,
    field_of,
    gravity_gradient,
    is_array_model,
    model_parameters,
    potential_at,
)
from hillsphere.interfaces import Parameter
from hillsphere.symbolic import Expr, Params, Vec3, dot, gradient, sqrt, variables

Array = NDArray[np.float64]
POINTS = np.random.default_rng(1).normal(size=(3, 30)) + np.array([[4.0], [3.0], [-5.0]])


class Oblate:
    """U = gm/r + j z²/r⁵; differentiates by its position, as a model may."""

    frame = "body"
    gm_m3_s2 = 2.0

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("gm", 2.0, "m3/s2"), Parameter("j", 0.3))

    def potential(self, r: Vec3, p: Params) -> Expr:
        d = sqrt(dot(r, r))
        return p["gm"] / d + p["j"] * r[2] * r[2] / (d * d * d * d * d)

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        x, y, z = gradient(self.potential(r, p), r)
        return (x, y, z)


class ArrayOblate:
    """The same on arrays."""

    frame = "body"
    gm_m3_s2 = 2.0

    def parameters(self) -> tuple[Parameter, ...]:
        return Oblate().parameters()

    def potential_array(self, r: Array, p: Array) -> Array:
        d = np.linalg.norm(r, axis=0)
        return np.asarray(p[0] / d + p[1] * r[2] ** 2 / d**5)

    def acceleration_array(self, r: Array, p: Array) -> Array:
        d = np.linalg.norm(r, axis=0)
        g = -p[0] * r / d**3 - 5.0 * p[1] * r[2] ** 2 * r / d**7
        g[2] += 2.0 * p[1] * r[2] / d**5
        return np.asarray(g)


class OwnGradient(ArrayOblate):
    """Brings its own gradient: recognisable, not right."""

    def gradient_array(self, r: Array, p: Array) -> Array:
        return np.full((3, 3, r.shape[1]), 7.0)


class Step(ArrayOblate):
    """An acceleration that jumps at x = 4."""

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return np.asarray(np.where(r[0] > 4.0, 1.0, -1.0) * np.ones_like(r))


def test_array_model_equals_expression() -> None:
    symbolic, array = GravityField(Oblate()), GravityField(ArrayOblate())
    assert not is_array_model(symbolic.model)
    assert is_array_model(array.model)
    np.testing.assert_allclose(array.potential(POINTS), symbolic.potential(POINTS), rtol=1e-15)
    expected = symbolic.acceleration(POINTS)
    assert np.max(np.abs(array.acceleration(POINTS) - expected)) <= 1e-15 * np.max(
        np.linalg.norm(expected, axis=0)
    )
    exact = symbolic.gradient(POINTS)
    size = np.abs(exact).max(axis=(0, 1))
    # Differences of fourth order; measured 2e-12.
    assert np.max(np.abs(array.gradient(POINTS) - exact) / size) <= 7e-12


def test_gradient_array_of_the_model_is_used() -> None:
    found = GravityField(OwnGradient()).gradient(POINTS)
    np.testing.assert_array_equal(found, np.full((3, 3, POINTS.shape[1]), 7.0))


def test_differences_that_do_not_agree_are_refused() -> None:
    with pytest.raises(ConvergenceError, match=r"at 1 of 2 points, first at \(4, 0, 0\) m; give"):
        GravityField(Step()).gradient(np.array([[4.0, 9.0], [0.0, 0.0], [0.0, 0.0]]))


@pytest.mark.parametrize("model", [Oblate(), ArrayOblate()], ids=["expression", "array"])
def test_run_time_parameters(model: Oblate | ArrayOblate) -> None:
    field = GravityField(model, ["j"])
    values = np.linspace(-1.0, 1.0, POINTS.shape[1])
    d = np.linalg.norm(POINTS, axis=0)
    np.testing.assert_allclose(
        field.potential(POINTS, values[None]), 2.0 / d + values * POINTS[2] ** 2 / d**5, rtol=1e-15
    )
    # Left out: nominal. One column serves all points.
    nominal = GravityField(model)
    for name in ("potential", "acceleration", "gradient"):
        expected = getattr(nominal, name)(POINTS)
        np.testing.assert_allclose(getattr(field, name)(POINTS), expected, rtol=1e-14)
        one_column = getattr(field, name)(POINTS, [0.3])
        np.testing.assert_allclose(one_column, expected, rtol=1e-14)


@pytest.mark.parametrize("model", [Oblate(), ArrayOblate()], ids=["expression", "array"])
def test_one_point_gives_one_value(model: Oblate | ArrayOblate) -> None:
    field = field_of(model, ["gm"])
    r = POINTS[:, 0]
    assert np.shape(field.potential(r)) == ()
    assert field.acceleration(r).shape == (3,)
    assert field.gradient(r, [2.0]).shape == (3, 3)
    np.testing.assert_array_equal(field.gradient(r), field.gradient(r[:, None])[..., 0])
    assert field.acceleration(np.empty((3, 0))).shape == (3, 0)


def test_placed_at_an_expression() -> None:
    x, y, z = variables("x", "y", "z")
    model = Oblate()
    p = model_parameters(model.parameters())
    shifted = (y + 1.0, x * 2.0, z)
    rows = gravity_gradient(model, shifted, p)
    function = ArrayFunction(
        [potential_at(model, shifted, p), *acceleration_at(model, shifted, p),
         *(slope for row in rows for slope in row)],
        (x, y, z),
    )  # fmt: skip
    found = function(POINTS)
    field = GravityField(model)
    moved = np.array([POINTS[1] + 1.0, POINTS[0] * 2.0, POINTS[2]])
    np.testing.assert_allclose(found[0], field.potential(moved), rtol=1e-15)
    np.testing.assert_allclose(found[1:4], field.acceleration(moved), rtol=3e-15)
    expected = field.gradient(moved)
    size = np.abs(expected).max(axis=(0, 1))
    assert np.max(np.abs(found[4:].reshape(3, 3, -1) - expected) / size) <= 6e-15


def test_gradient_is_exact() -> None:
    # Trace: −∇²(j z²/r⁵) by hand; ∇²(z² r⁻⁵) = 2 r⁻⁵, the rest cancels.
    trace = np.einsum("iiN->N", GravityField(Oblate()).gradient(POINTS))
    d = np.linalg.norm(POINTS, axis=0)
    np.testing.assert_allclose(trace, 0.3 * 2.0 * d**-5, rtol=1.4e-12)


def test_many_parameters_compile_in_compact_mode() -> None:
    class Mascons:
        frame = "body"
        gm_m3_s2 = 301.0

        def parameters(self) -> tuple[Parameter, ...]:
            return tuple(Parameter(f"gm{i}", 1.0, "m3/s2") for i in range(301))

        def potential(self, r: Vec3, p: Params) -> Expr:
            total = p["gm0"]
            for i in range(1, 301):
                total = total + p[f"gm{i}"]
            return total / sqrt(dot(r, r))

        def acceleration(self, r: Vec3, p: Params) -> Vec3:
            x, y, z = gradient(self.potential(r, p), r)
            return (x, y, z)

    found = GravityField(Mascons(), ["gm7"]).gradient([2.0, 0.0, 0.0], [2.0])
    np.testing.assert_allclose(
        np.diag(found), 302.0 / 8.0 * np.array([2.0, -1.0, -1.0]), rtol=1e-15
    )


@pytest.mark.parametrize(
    ("run_time", "message"),
    [
        (["gmm"], "the model has no parameter 'gmm'; did you mean 'gm'?"),
        (["density"], "the model has no parameter 'density'; it has: gm, j"),
        (["j", "j"], "run-time parameter 'j' occurs twice"),
    ],
)
def test_unknown_run_time_parameter(run_time: list[str], message: str) -> None:
    with pytest.raises(InputError) as caught:
        GravityField(Oblate(), run_time)
    assert str(caught.value) == message


def test_wrong_shapes() -> None:
    field = GravityField(Oblate(), ["gm"])
    with pytest.raises(InputError, match=r"r must be \(3, N\) or \(3,\), got \(30, 3\)"):
        field.potential(POINTS.T)
    with pytest.raises(InputError, match=r"p must be \(1,\) or \(1, 30\), got \(2, 1\)"):
        field.potential(POINTS, [1.0, 2.0])
