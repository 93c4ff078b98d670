"""The facade over the compile layer, against the standard library and calculus by hand."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from hillsphere import symbolic as sym
from hillsphere.dynamics import ArrayFunction
from hillsphere.errors import InputError
from hillsphere.symbolic import Expr, Scalar

X, Y = sym.variables("x", "y")


def value(expression: Expr, x: float = 0.3, y: float = -0.7) -> float:
    return float(ArrayFunction([expression], [X, Y])([x, y])[0])


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (sym.sqrt, math.sqrt),
        (sym.sin, math.sin),
        (sym.cos, math.cos),
        (sym.tan, math.tan),
        (sym.asin, math.asin),
        (sym.acos, math.acos),
        (sym.exp, math.exp),
        (sym.log, math.log),
    ],
)
def test_functions_of_one_argument_equal_the_standard_library(
    function: Callable[[Scalar], Expr], expected: Callable[[float], float]
) -> None:
    assert value(function(X)) == pytest.approx(expected(0.3), rel=5e-16)
    # A number is as good as an expression.
    assert value(X * 0.0 + function(0.3)) == pytest.approx(expected(0.3), rel=5e-16)


@pytest.mark.parametrize(("y", "x"), [(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])
def test_atan2_knows_its_quadrant(y: float, x: float) -> None:
    assert value(sym.atan2(Y, X), x, y) == pytest.approx(math.atan2(y, x), rel=5e-16)


def test_arithmetic_takes_numbers_on_either_side() -> None:
    e = 2.0 + X - 1 + (3 * Y) / 4.0 - (1.0 - X) + 6.0 / X - (-Y) + X**2
    x, y = 0.3, -0.7
    assert value(e) == pytest.approx(2 + x - 1 + 3 * y / 4 - (1 - x) + 6 / x + y + x**2, rel=1e-15)
    assert value(sym.power(X, -1.5)) == pytest.approx(x**-1.5, rel=1e-15)


@pytest.mark.parametrize("x", [-2.0, -0.7, 0.0, 0.3])
def test_choices_lane_by_lane(x: float) -> None:
    assert value(sym.absolute(X), x) == abs(x)
    assert value(sym.minimum(X, Y), x) == min(x, -0.7)
    assert value(sym.maximum(X, Y), x) == max(x, -0.7)
    assert value(sym.select(sym.greater(X, Y), 1.0, 2.0), x) == (1.0 if x > -0.7 else 2.0)
    assert value(sym.select(sym.less(X, Y), 1.0, 2.0), x) == (1.0 if x < -0.7 else 2.0)


def test_vectors() -> None:
    a, b = (X, Y, 2.0), (Y, 3.0, X)
    na, nb = np.array([0.3, -0.7, 2.0]), np.array([-0.7, 3.0, 0.3])
    assert value(sym.dot(a, b)) == pytest.approx(na @ nb, rel=1e-15)
    np.testing.assert_allclose([value(e) for e in sym.cross(a, b)], np.cross(na, nb), rtol=1e-15)
    assert value(sym.norm(a)) == pytest.approx(np.linalg.norm(na), rel=1e-15)
    matrix: list[list[Scalar]] = [[1.0, X, 0.0], [Y, 2.0, -1.0]]
    expected = np.array([[1.0, 0.3, 0.0], [-0.7, 2.0, -1.0]]) @ nb
    np.testing.assert_allclose([value(e) for e in sym.matvec(matrix, b)], expected, rtol=1e-15)
    assert value(sym.sum_of([X, 1.0, Y])) == pytest.approx(0.6, rel=1e-15)
    assert value(sym.product([X, 2.0, Y])) == pytest.approx(-0.42, rel=1e-15)
    with pytest.raises(ValueError, match="zip"):
        sym.dot([X], [X, Y])


def test_substitution_is_simultaneous() -> None:
    swap: dict[Expr | str, Scalar] = {X: Y, "y": X, sym.time: 2.0 * sym.time}
    swapped = sym.substitute([X - Y, X * sym.time], swap)
    assert value(swapped[0]) == pytest.approx(-1.0, rel=1e-15)
    late = ArrayFunction([swapped[1]], [X, Y])([0.3, -0.7], t=5.0)
    assert late[0] == pytest.approx(-7.0, rel=1e-15)


def test_jacobian_by_variable_and_parameter() -> None:
    gm = sym.parameter("gm")
    table = sym.jacobian([gm * X**3, sym.sin(X * Y), sym.constant(4.0)], [X, Y, gm])
    found = ArrayFunction([e for row in table for e in row], [X, Y], ["gm"])([0.3, -0.7], [2.0])
    c = math.cos(-0.21)
    expected = [2 * 3 * 0.09, 0, 0.027, -0.7 * c, 0.3 * c, 0, 0, 0, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-15, atol=0)
    assert sym.jacobian([X, Y], []) == ((), ())
    gradient = [value(e) for e in sym.gradient(X * Y, [X, Y])]
    np.testing.assert_allclose(gradient, [-0.7, 0.3], rtol=1e-15)


def test_differentiating_by_a_composite_is_refused() -> None:
    with pytest.raises(ValueError, match="only with respect to variables"):
        sym.jacobian([X + Y], [X + Y])


def test_names_tell_variables_from_parameters() -> None:
    e = [X * sym.parameter("gm") + sym.parameter("alpha"), Y]
    assert sym.variable_names(e) == ["x", "y"]
    assert sym.parameter_names(e) == ["alpha", "gm"]
    with pytest.raises(InputError, match="run-time parameters"):
        sym.variable("param:gm")


def test_zero_is_recognised_literally() -> None:
    assert sym.is_zero(0.0)
    assert sym.is_zero(0.0 * X)
    assert sym.is_zero(sym.jacobian([X], [Y])[0][0])
    assert not sym.is_zero(X - Y)


def test_spherical_harmonics_of_degree_two_equal_the_textbook() -> None:
    # U = GM/r [1 - J2 (R/r)² P2(sin φ)], Montenbruck and Gill (2000), eq. 3.27 ff; J2 = -√5 C̄20.
    x, y, z = sym.variables("x", "y", "z")
    r = (x, y, z)
    c20, gm, radius = -4.84e-4, 3.986e14, 6.378e6
    table = [(1.0, 0.0), (0.0, 0.0), (0.0, 0.0), (c20, 0.0), (0.0, 0.0), (0.0, 0.0)]
    potential = sym.spherical_harmonics_potential(r, table, gm, radius)
    point = np.array([4e6, -3e6, 5e6])
    found = ArrayFunction([potential], r)(point)[0]
    d = np.linalg.norm(point)
    s = point[2] / d
    expected = gm / d * (1 + math.sqrt(5) * c20 * (radius / d) ** 2 * (3 * s * s - 1) / 2)
    assert found == pytest.approx(expected, rel=2e-15)


def test_array_function_checks_its_symbols_and_shapes() -> None:
    with pytest.raises(InputError, match=r"not inputs: \['y'\]"):
        ArrayFunction([X + Y], [X])
    with pytest.raises(InputError, match=r"not listed: \['gm'\]"):
        ArrayFunction([X * sym.parameter("gm")], [X])
    f = ArrayFunction([X * sym.parameter("gm"), X], [X], ["gm"])
    np.testing.assert_array_equal(f([[1.0, 2.0]], [3.0]), [[3.0, 6.0], [1.0, 2.0]])
    np.testing.assert_array_equal(f([[1.0, 2.0]], [[3.0, 4.0]]), [[3.0, 8.0], [1.0, 2.0]])
    with pytest.raises(InputError, match="none given"):
        f([[1.0, 2.0]])
    with pytest.raises(InputError, match=r"p must be \(1,\) or \(1, 2\)"):
        f([[1.0, 2.0]], [[3.0, 4.0, 5.0]])
    with pytest.raises(InputError, match=r"x must be \(1, N\)"):
        f([[1.0], [2.0]], [3.0])


def test_compact_mode_gives_the_same_numbers() -> None:
    e = [sym.exp(sym.sin(X) * Y) / (1.0 + X * X)]
    points = np.random.default_rng(1).normal(size=(2, 9))
    full, compact = (ArrayFunction(e, [X, Y], compact=c)(points) for c in (False, True))
    np.testing.assert_allclose(full, compact, rtol=1e-15)


def test_kepler_equation_over_many_revolutions() -> None:
    s, c, m = sym.variables("s", "c", "m")
    solved = ArrayFunction(
        [sym.kepler(s, c, m), *sym.gradient(sym.kepler(s, c, m), (m,))], (s, c, m)
    )
    random = np.random.default_rng(1)
    e, anomaly = random.uniform(0.0, 0.99, 500), random.uniform(0.0, 6.3, 500)
    e[:20] = 0.0
    given = np.array([e * np.sin(anomaly), e * np.cos(anomaly), random.uniform(-20.0, 20.0, 500)])
    difference, slope = solved(given)
    back = difference + given[0] * (1.0 - np.cos(difference)) - given[1] * np.sin(difference)
    np.testing.assert_allclose(back, given[2], rtol=0, atol=4e-14)
    by_hand = 1.0 / (1.0 + given[0] * np.sin(difference) - given[1] * np.cos(difference))
    np.testing.assert_allclose(slope, by_hand, rtol=1e-10)
