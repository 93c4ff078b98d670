"""Symbolic expressions, in which gravity models, plants and laws write their equations.

A model writes its equations once, with the functions of this module; `hillsphere.dynamics` derives
array evaluators, exact derivatives, variational equations and propagators from them. A plugin needs
no other module for its equations.

Rules of the engine that a model must follow:

- No control flow on values: use `select`. Both branches are evaluated, so both must be finite
  everywhere, and so must their derivatives.
- `where_x = substitute(model(x), {x: shifted})` is how a model is placed elsewhere: write it on
  plain variables, differentiate, then substitute. Differentiating by a composite is refused.
- Run-time parameters are named with `parameter`; the engine numbers them when it compiles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import reduce
from operator import add, mul
from typing import Any, Protocol, TypeAlias, cast

from hillsphere.base.errors import InputError
from hillsphere.symbolic._heyoka import heyoka as _hy

__all__ = [
    "Expr", "Overloaded", "Params", "Scalar", "Vec3", "absolute", "acos", "asin", "atan2",
    "constant", "cos", "cross", "dot", "eccentric_anomaly", "exp", "gradient", "greater",
    "is_zero", "jacobian", "kepler", "less", "log", "matvec", "maximum", "minimum", "norm",
    "number_in", "parameter", "parameter_names", "pi", "power", "product", "select", "sgp4", "sin",
    "spherical_harmonics_potential", "sqrt", "substitute", "sum_of", "tan", "time", "variable",
    "variable_names", "variables",
]  # fmt: skip


class Expr(Protocol):
    """An expression; supports ``+ - * / **`` with expressions and numbers, and unary minus."""

    def __add__(self, other: Scalar, /) -> Expr: ...
    def __radd__(self, other: Scalar, /) -> Expr: ...
    def __sub__(self, other: Scalar, /) -> Expr: ...
    def __rsub__(self, other: Scalar, /) -> Expr: ...
    def __mul__(self, other: Scalar, /) -> Expr: ...
    def __rmul__(self, other: Scalar, /) -> Expr: ...
    def __truediv__(self, other: Scalar, /) -> Expr: ...
    def __rtruediv__(self, other: Scalar, /) -> Expr: ...
    def __pow__(self, other: Scalar, /) -> Expr: ...
    def __neg__(self) -> Expr: ...


Scalar: TypeAlias = Expr | float | int
"""An expression or a number: the operand of a function that returns an expression."""

Vec3: TypeAlias = tuple[Expr, Expr, Expr]
"""Expressions of the three components of a vector."""

Params: TypeAlias = Mapping[str, Expr]
"""Parameter name → expression; the engine decides whether it is a constant or set at run time."""

_PARAMETER = "param:"


class Overloaded:
    """Base of types of numbers that can replace expressions, such as intervals.

    The functions below pass such an argument on to its method ``symbolic_`` + their own name, so
    that equations written for the engine can be evaluated in another arithmetic
    (`hillsphere.engine.dynamics.bounds`). Functions that only the engine has raise a TypeError.
    """

    __array_ufunc__ = None  # numpy's operators defer to the ones of this class

    @classmethod
    def of(cls, item: object) -> Any:
        """Convert a number, or an expression that is a plain number, to this type."""
        raise NotImplementedError


def _overloaded_type(*items: object) -> type[Overloaded] | None:
    """Return the type of the first operand that is an `Overloaded` number; None without one."""
    return next((type(item) for item in items if isinstance(item, Overloaded)), None)


def _call(name: str, engine: Callable[..., Any], *items: Scalar) -> Expr:
    """Call the engine's function, or the method of an operand of another arithmetic."""
    kind = _overloaded_type(*items)
    if kind is None:
        return cast(Expr, engine(*(_as_expr(item) for item in items)))
    first, *rest = (kind.of(item) for item in items)
    return cast(Expr, getattr(first, "symbolic_" + name)(*rest))


def number_in(item: object) -> float:
    """Return the value of an expression that is a plain number.

    Parameters
    ----------
    item : object
        An expression or a number.

    Returns
    -------
    float
        The number.

    Raises
    ------
    TypeError
        If the expression is anything else.
    """
    # The engine writes a number with 17 digits, from which it is read back exactly.
    text = "3.14159265358979323846" if str(item) == "π" else str(item)
    try:
        return float(text)
    except ValueError:
        raise TypeError(f"{text[:60]} is not a number") from None


time: Expr = cast(Expr, _hy.time)
"""The independent variable of a system of equations, s."""
pi: Expr = cast(Expr, _hy.pi)
"""The number π as an expression."""


def constant(value: float) -> Expr:
    """Return a number as an expression.

    Parameters
    ----------
    value : float
        The number.

    Returns
    -------
    Expr
        An expression without variables.
    """
    return cast(Expr, _hy.expression(float(value)))


def variable(name: str) -> Expr:
    """Return the variable of this name.

    Parameters
    ----------
    name : str
        Its name: a state's, or another quantity's that the equations are evaluated with.

    Returns
    -------
    Expr
        The variable.

    Raises
    ------
    InputError
        If the name is that of a run-time parameter.
    """
    if name.startswith(_PARAMETER):
        raise InputError(f"variable {name!r}: names with {_PARAMETER!r} are run-time parameters")
    return cast(Expr, _hy.expression(name))


def variables(*names: str) -> tuple[Expr, ...]:
    """Return the variables of these names.

    Parameters
    ----------
    *names : str
        Their names.

    Returns
    -------
    tuple of Expr
        One variable for each name, in their order.
    """
    return tuple(variable(name) for name in names)


def parameter(name: str) -> Expr:
    """Return the run-time parameter of this name; it gets its value at each evaluation.

    Parameters
    ----------
    name : str
        Name by which its value is given.

    Returns
    -------
    Expr
        The parameter.
    """
    return cast(Expr, _hy.expression(_PARAMETER + name))


def variable_names(expressions: Iterable[Expr]) -> list[str]:
    """Return the names of the variables in the expressions, sorted, without parameters.

    Parameters
    ----------
    expressions : iterable of Expr
        Any number of them.

    Returns
    -------
    list of str
        Each name once.
    """
    names = _hy.get_variables([_as_expr(e) for e in expressions])
    return [name for name in names if not name.startswith(_PARAMETER)]


def parameter_names(expressions: Iterable[Expr]) -> list[str]:
    """Return the names of the run-time parameters in the expressions, sorted.

    Parameters
    ----------
    expressions : iterable of Expr
        Any number of them.

    Returns
    -------
    list of str
        Each name once.
    """
    names = _hy.get_variables([_as_expr(e) for e in expressions])
    return [n.removeprefix(_PARAMETER) for n in names if n.startswith(_PARAMETER)]


def _as_expr(value: Scalar) -> Expr:
    return constant(value) if isinstance(value, int | float) else value


def sqrt(x: Scalar) -> Expr:
    """Square root.

    Parameters
    ----------
    x : Expr or float
        Argument, not negative.

    Returns
    -------
    Expr
        The root that is not negative.
    """
    return _call("sqrt", _hy.sqrt, x)


def sin(x: Scalar) -> Expr:
    """Sine.

    Parameters
    ----------
    x : Expr or float
        Angle, rad.

    Returns
    -------
    Expr
        Sine of x.
    """
    return _call("sin", _hy.sin, x)


def cos(x: Scalar) -> Expr:
    """Cosine.

    Parameters
    ----------
    x : Expr or float
        Angle, rad.

    Returns
    -------
    Expr
        Cosine of x.
    """
    return _call("cos", _hy.cos, x)


def tan(x: Scalar) -> Expr:
    """Tangent.

    Parameters
    ----------
    x : Expr or float
        Angle, rad.

    Returns
    -------
    Expr
        Tangent of x.
    """
    return _call("tan", _hy.tan, x)


def asin(x: Scalar) -> Expr:
    """Inverse sine, rad.

    Parameters
    ----------
    x : Expr or float
        Sine of the angle, in [−1, 1].

    Returns
    -------
    Expr
        Angle, rad, in [−π/2, π/2].
    """
    return _call("asin", _hy.asin, x)


def acos(x: Scalar) -> Expr:
    """Inverse cosine, rad. Keep the argument away from ±1, where the derivative is infinite.

    Parameters
    ----------
    x : Expr or float
        Cosine of the angle, in [−1, 1].

    Returns
    -------
    Expr
        Angle, rad, in [0, π].
    """
    return _call("acos", _hy.acos, x)


def atan2(y: Scalar, x: Scalar) -> Expr:
    """Angle of the point (x, y), rad, in (−π, π].

    Parameters
    ----------
    y, x : Expr or float
        Coordinates of the point, of one unit.

    Returns
    -------
    Expr
        Angle from the x axis, rad.
    """
    if _overloaded_type(x, y):
        return _call("atan2", _hy.atan2, x, y)
    return cast(Expr, _hy.atan2(_as_expr(y), _as_expr(x)))


def exp(x: Scalar) -> Expr:
    """Exponential.

    Parameters
    ----------
    x : Expr or float
        Exponent.

    Returns
    -------
    Expr
        e to the power of x.
    """
    return _call("exp", _hy.exp, x)


def log(x: Scalar) -> Expr:
    """Natural logarithm.

    Parameters
    ----------
    x : Expr or float
        Argument, positive.

    Returns
    -------
    Expr
        Logarithm to the base e.
    """
    return _call("log", _hy.log, x)


def kepler(e_sin: Scalar, e_cos: Scalar, difference: Scalar) -> Expr:
    """Solve Kepler's equation D + s (1 − cos D) − c sin D = M for D, where s² + c² < 1.

    With an eccentric anomaly E₀ as origin, s = e sin E₀ and c = e cos E₀, and D and M are the
    differences of the eccentric and of the mean anomaly from there. This form has no singularity
    at e = 0.

    Parameters
    ----------
    e_sin, e_cos : Expr or float
        s and c.
    difference : Expr or float
        M, rad.

    Returns
    -------
    Expr
        D, rad.

    Raises
    ------
    TypeError
        If an argument is a bound of an interval, for which there is no solver.
    """
    if _overloaded_type(e_sin, e_cos, difference):
        raise TypeError("kepler needs expressions; intervals have no solver of Kepler's equation")
    s, c, m = _as_expr(e_sin), _as_expr(e_cos), _as_expr(difference)
    within = cast(Expr, _hy.kepDE(s, c, m))
    # The engine's D is in [0, 2π); the equation itself gives the one that belongs to M.
    return m + c * sin(within) - s * (1.0 - cos(within))


def eccentric_anomaly(eccentricity: Scalar, mean: Scalar) -> Expr:
    """Solve Kepler's equation E − e sin E = M for E, 0 ≤ e < 1, in the revolution of M.

    Unlike `kepler`, the Taylor propagator can differentiate it.

    Parameters
    ----------
    eccentricity : Expr or float
        e, in [0, 1).
    mean : Expr or float
        Mean anomaly M, rad.

    Returns
    -------
    Expr
        Eccentric anomaly E, rad.
    """
    if _overloaded_type(eccentricity, mean):
        return _call("eccentric_anomaly", _hy.kepE, mean, eccentricity)
    e, m = _as_expr(eccentricity), _as_expr(mean)
    # The engine's E is in [0, 2π); the equation itself gives the one that belongs to M.
    return m + e * sin(cast(Expr, _hy.kepE(e, m)))


def power(x: Scalar, exponent: float) -> Expr:
    """Raise x to a constant power.

    Parameters
    ----------
    x : Expr or float
        The base; positive unless the exponent is a whole number.
    exponent : float
        A number, not an expression.

    Returns
    -------
    Expr
        x to that power.
    """
    return _as_expr(x) ** exponent


def select(condition: Expr, if_true: Scalar, if_false: Scalar) -> Expr:
    """Select one of two expressions, lane by lane; both are evaluated.

    The Taylor propagator expands the branch on which its step begins. A model must declare where
    it changes branch by `switches` (`hillsphere.interfaces.Piecewise`, or `PiecewisePlant` for a
    plant); otherwise `hillsphere.dynamics.Taylor` stays on the old branch to the end of the step.
    The step map evaluates the condition at every stage and needs no `switches`.

    Parameters
    ----------
    condition : Expr
        Of `less` or `greater`.
    if_true, if_false : Expr or float
        The two branches, of one unit.

    Returns
    -------
    Expr
        The branch that the condition selects.
    """
    if isinstance(condition, _Comparison):
        kind = type(condition.difference)
        yes, no = condition.sides()
        first, last = kind.of(if_true), kind.of(if_false)
        return cast(Expr, first.symbolic_select(last, yes, no))
    return cast(Expr, _hy.select(condition, _as_expr(if_true), _as_expr(if_false)))


def greater(a: Scalar, b: Scalar) -> Expr:
    """Condition a > b, for `select`.

    Parameters
    ----------
    a, b : Expr or float
        What is compared, of one unit.

    Returns
    -------
    Expr
        The condition.
    """
    if _overloaded_type(a, b):
        return cast(Expr, _Comparison(cast(Any, a) - b))
    return cast(Expr, _hy.gt(_as_expr(a), _as_expr(b)))


def less(a: Scalar, b: Scalar) -> Expr:
    """Condition a < b, for `select`.

    Parameters
    ----------
    a, b : Expr or float
        What is compared, of one unit.

    Returns
    -------
    Expr
        The condition.
    """
    if _overloaded_type(a, b):
        return cast(Expr, _Comparison(cast(Any, b) - a))
    return cast(Expr, _hy.lt(_as_expr(a), _as_expr(b)))


class _Comparison:
    """The condition that a difference is positive, in another arithmetic."""

    def __init__(self, difference: Any) -> None:
        self.difference = difference

    def sides(self) -> tuple[Any, Any]:
        """Return where the condition certainly holds, and where it certainly does not."""
        low, high = self.difference.value
        return low > 0.0, high <= 0.0


def minimum(a: Scalar, b: Scalar) -> Expr:
    """Return the smaller of two expressions, lane by lane.

    Parameters
    ----------
    a, b : Expr or float
        What is compared, of one unit.

    Returns
    -------
    Expr
        The smaller one; its derivative is that of the branch taken.
    """
    if _overloaded_type(a, b):
        return _call("minimum", _hy.select, a, b)
    return select(less(a, b), a, b)


def maximum(a: Scalar, b: Scalar) -> Expr:
    """Return the larger of two expressions, lane by lane.

    Parameters
    ----------
    a, b : Expr or float
        What is compared, of one unit.

    Returns
    -------
    Expr
        The larger one; its derivative is that of the branch taken.
    """
    if _overloaded_type(a, b):
        return -minimum(-cast(Expr, a), -cast(Expr, b))
    return select(greater(a, b), a, b)


def is_zero(e: Scalar) -> bool:
    """Return whether an expression is the literal zero (``0 * x`` is, ``x - x`` is not).

    Parameters
    ----------
    e : Expr or float
        Any expression or number.

    Returns
    -------
    bool
        True only for the number zero.
    """
    return not _overloaded_type(e) and bool(_as_expr(e) == constant(0.0))


def absolute(x: Scalar) -> Expr:
    """Absolute value, by `select`; its derivative at zero is −1.

    Parameters
    ----------
    x : Expr or float
        Argument, of any unit.

    Returns
    -------
    Expr
        The argument without its sign.
    """
    e = _as_expr(x)
    if _overloaded_type(e):
        return maximum(e, -e)
    return select(greater(e, 0.0), e, -e)


def sum_of(terms: Iterable[Scalar]) -> Expr:
    """Sum of any number of terms, which compiles to faster code than a chain of ``+``.

    Parameters
    ----------
    terms : iterable of Expr or float
        Any number of them, of one unit; none give zero.

    Returns
    -------
    Expr
        The sum.
    """
    items = list(terms)
    if _overloaded_type(*items):
        return cast(Expr, reduce(add, items))
    return cast(Expr, _hy.sum([_as_expr(term) for term in items]))


def product(factors: Iterable[Scalar]) -> Expr:
    """Product of any number of factors.

    Parameters
    ----------
    factors : iterable of Expr or float
        Any number of them; none give one.

    Returns
    -------
    Expr
        The product.
    """
    items = list(factors)
    if _overloaded_type(*items):
        return cast(Expr, reduce(mul, items))
    return cast(Expr, _hy.prod([_as_expr(factor) for factor in items]))


def dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Expr:
    """Scalar product.

    Parameters
    ----------
    a, b : sequence of Expr or float
        The vectors, of one length.

    Returns
    -------
    Expr
        Sum of the products of their elements.
    """
    if _overloaded_type(*a, *b):
        return sum_of([cast(Any, x) * y for x, y in zip(a, b, strict=True)])
    return sum_of(_as_expr(x) * y for x, y in zip(a, b, strict=True))


def cross(a: Sequence[Scalar], b: Sequence[Scalar]) -> Vec3:
    """Vector product of two 3-vectors.

    Parameters
    ----------
    a, b : sequence of Expr or float, length 3
        The vectors.

    Returns
    -------
    tuple of Expr, length 3
        a × b.
    """
    ax, ay, az = (cast(Any, x) for x in a) if _overloaded_type(*b) else (_as_expr(x) for x in a)
    bx, by, bz = (_as_expr(x) for x in b)
    return (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def norm(a: Sequence[Scalar]) -> Expr:
    """Euclidean length.

    Parameters
    ----------
    a : sequence of Expr or float
        A vector of any length.

    Returns
    -------
    Expr
        Its length, in the unit of its elements.
    """
    kind = _overloaded_type(*a)
    if kind is None:
        return sqrt(dot(a, a))
    # Another arithmetic may bound a length more tightly than the root of a sum.
    first, *rest = (kind.of(item) for item in a)
    return cast(Expr, first.symbolic_norm(*rest))


def matvec(matrix: Sequence[Sequence[Scalar]], vector: Sequence[Scalar]) -> tuple[Expr, ...]:
    """Matrix times vector.

    Parameters
    ----------
    matrix : sequence of rows
        n rows of m elements.
    vector : sequence of Expr or float
        m elements.

    Returns
    -------
    tuple of Expr
        The product, n elements.
    """
    return tuple(dot(row, vector) for row in matrix)


def substitute(
    expressions: Sequence[Expr],
    replacements: Mapping[Expr, Scalar] | Mapping[str, Scalar] | Mapping[Expr | str, Scalar],
) -> tuple[Expr, ...]:
    """Replace variables simultaneously.

    Parameters
    ----------
    expressions : sequence of Expr
        Expressions to rewrite.
    replacements : mapping
        Variable (or its name) → expression that replaces it.

    Returns
    -------
    tuple of Expr
        In the order given.
    """
    table = {
        (variable(key) if isinstance(key, str) else key): _as_expr(value)
        for key, value in replacements.items()
    }
    return tuple(cast("list[Expr]", _hy.subs([_as_expr(e) for e in expressions], table)))


def jacobian(expressions: Sequence[Scalar], by: Sequence[Expr]) -> tuple[tuple[Expr, ...], ...]:
    """Jacobian matrix: exact first derivatives.

    Parameters
    ----------
    expressions : sequence of Expr
        m functions.
    by : sequence of Expr
        n variables or run-time parameters (plain, not composite).

    Returns
    -------
    tuple of tuple of Expr
        m rows of n derivatives.
    """
    functions = [_as_expr(e) for e in expressions]
    if not functions or not by:
        return ((),) * len(functions)
    tensors = _hy.diff_tensors(functions, diff_args=list(by), diff_order=1)
    table = tensors.jacobian
    return tuple(
        tuple(cast(Expr, table[i][j]) for j in range(len(by))) for i in range(len(functions))
    )


def gradient(expression: Scalar, by: Sequence[Expr]) -> tuple[Expr, ...]:
    """Gradient: exact derivatives of one function by n variables.

    Parameters
    ----------
    expression : Expr or float
        The function.
    by : sequence of Expr
        The variables, n of them.

    Returns
    -------
    tuple of Expr
        Derivative by each variable, in their order.
    """
    return jacobian([expression], by)[0]


def spherical_harmonics_potential(
    r: Vec3,
    coefficients: Sequence[tuple[Scalar, Scalar]],
    gm: Scalar,
    radius: Scalar,
) -> Expr:
    """Potential of a spherical-harmonic series, +U, finite at the poles.

    Parameters
    ----------
    r : Vec3
        Body-fixed position.
    coefficients : sequence of (C, S)
        Fully normalised (4π), in degree-then-order order, degrees 0 and 1 included.
    gm, radius : Scalar
        Gravitational parameter and reference radius, in units that fit `r`.

    Returns
    -------
    Expr
        (GM/R) Σ (R/r)^{n+1} P̄nm(sin φ)(C̄ cos mλ + S̄ sin mλ).
    """
    table = [[_as_expr(c), _as_expr(s)] for c, s in coefficients]
    return cast(Expr, _hy.model.sh_gravity_pot(list(r), table, _as_expr(gm), _as_expr(radius)))


def sgp4(elements: Sequence[Scalar], minutes: Scalar) -> tuple[Expr, ...]:
    """Return the state that the analytic theory SGP4 gives, without its part for deep space.

    Parameters
    ----------
    elements : sequence of 7
        Mean motion of the element set (rad/min), e, i, Ω, ω, M (rad) and the drag term B*.
    minutes : Scalar
        Time since the epoch of the elements, min.

    Returns
    -------
    tuple of 7 Expr
        Position (km) and velocity (km/s) in TEME, and the theory's error code, 0 for none.
    """
    return tuple(_hy.model.sgp4([*map(_as_expr, elements), _as_expr(minutes)]))
