"""Evaluation of gravity models: on arrays of points, at shifted positions, and their gradients.

A `GravityModel` gives potential and acceleration as expressions; `GravityField` compiles them and
their exact gradient. An `ArrayGravityModel` (a polyhedron, a table) has the same methods.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from difflib import get_close_matches
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array
from hillsphere.base.errors import ConvergenceError, InputError
from hillsphere.base.ranges import GM_M3_S2
from hillsphere.engine.dynamics.bounds import Bound
from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.dynamics.intervals import EVERYTHING
from hillsphere.interfaces.gravity import (
    ArrayGravityModel,
    BoundedGravity,
    GravityModel,
    SeriesGravity,
)
from hillsphere.interfaces.quantities import Parameter
from hillsphere.symbolic.expressions import (
    Expr,
    Overloaded,
    Params,
    Vec3,
    constant,
    jacobian,
    norm,
    parameter,
    substitute,
    variables,
)

__all__ = [
    "AnyGravityModel",
    "GravityField",
    "acceleration_at",
    "acceleration_within",
    "field_of",
    "gravity_gradient",
    "is_array_model",
    "model_parameters",
    "potential_at",
    "whole_gravity",
]

AnyGravityModel: TypeAlias = GravityModel | ArrayGravityModel
"""A gravity model that is an expression, or one that is evaluated on arrays."""

_OTHER_BODY = 100.0
"""Ratio of a body's largest semi-axis to the reference radius of its gravity from which one of them
is in a wrong unit: reference radii are within a few times the radius of the body, a wrong unit
makes 1000."""
_PLAIN = cast(Vec3, variables("gravity:x", "gravity:y", "gravity:z"))
_COMPACT_FROM = {"potential": 2700, "acceleration": 2700, "gradient": 300}
"""Number of model parameters above which an evaluator is compiled in compact mode.

A series of degree N has about N² parameters. Up to degree 50 (acceleration) and 16 (gradient) full
mode compiles about as fast as compact mode and runs up to twice as fast; for larger models its
compile time grows faster than the model.
"""


def is_array_model(model: AnyGravityModel) -> bool:
    """Return whether a model is a function of arrays rather than an expression.

    Parameters
    ----------
    model : AnyGravityModel
        Any gravity model.

    Returns
    -------
    bool
        True if it has no expression, as a polyhedron.
    """
    return isinstance(model, ArrayGravityModel)


def whole_gravity(
    model: AnyGravityModel, semi_axes_m: Sequence[float] | None = None
) -> AnyGravityModel:
    """Check that a model can be the whole gravity of a plant, and return it.

    A part of a sum may have zero or negative mass: a void, or a series with C00 = 0 that corrects
    another part. As the whole gravity of a plant such a model would let a spacecraft move as in
    empty space, or away from the body, without any warning.

    Parameters
    ----------
    model : GravityModel or ArrayGravityModel
        The model.
    semi_axes_m : sequence of float, optional
        Semi-axes of the body's surface, m, if they are given apart from the model.

    Returns
    -------
    GravityModel or ArrayGravityModel
        The same model.

    Raises
    ------
    InputError
        If its gravitational parameter is outside the range of bodies
        (`hillsphere.base.ranges.GM_M3_S2`), or the surface is `_OTHER_BODY` times as large or as
        small as the reference sphere of a series.
    """
    gm, (least, most) = model.gm_m3_s2, (GM_M3_S2["ge"], GM_M3_S2["le"])
    if not least <= gm <= most:
        raise InputError(
            f"gravity: the model as a whole has GM = {gm:.6g} m³/s² and attracts nothing; it must "
            f"be from {least:g} to {most:g} m³/s². Give it a mass: a series of harmonics needs "
            "C00 > 0 (1 if it is not listed), a sum at least one part that has one"
        )
    radius = model.series_radius_m if isinstance(model, SeriesGravity) else None
    if radius is not None and semi_axes_m is not None:
        ratio = max(semi_axes_m) / radius
        if not 1.0 / _OTHER_BODY < ratio < _OTHER_BODY:
            unit = "km instead of m" if ratio < 1.0 else "m instead of km"
            raise InputError(
                f"gravity: the reference radius of the series is {radius / 1e3:.4g} km, but the "
                f"surface of the body reaches to {max(semi_axes_m) / 1e3:.4g} km; its lengths are "
                f"likely in {unit}: check the length_unit of the shape, or the semi_axes"
            )
    return model


def model_parameters(parameters: Sequence[Parameter], run_time: Sequence[str] = ()) -> Params:
    """Return expressions for a model's parameters: constants, except for run-time parameters.

    Parameters
    ----------
    parameters : sequence of Parameter
        All parameters of the model.
    run_time : sequence of str
        Names of those to be set at each evaluation.

    Returns
    -------
    Params
        One expression per parameter.

    Raises
    ------
    InputError
        If a name in `run_time` is not a parameter of the model, or occurs twice.
    """
    names = [q.name for q in parameters]
    for position, name in enumerate(run_time):
        if name not in names:
            near = get_close_matches(name, names, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"it has: {', '.join(names[:20])}"
            raise InputError(f"the model has no parameter {name!r}; {hint}")
        if name in run_time[:position]:
            raise InputError(f"run-time parameter {name!r} is listed twice")
    return {
        q.name: parameter(q.name) if q.name in run_time else constant(q.value) for q in parameters
    }


def potential_at(model: GravityModel, r: Vec3, p: Params) -> Expr:
    """Return the potential at a position that may be any expression (shifted, rotated).

    Parameters
    ----------
    model : GravityModel
        The model.
    r : Vec3
        Position in the model's frame, m.
    p : Params
        One expression per parameter of the model.

    Returns
    -------
    Expr
        +U, m²/s². The model is evaluated at plain variables, for which the position is substituted
        afterwards, so that the model may differentiate by its position.
    """
    return _at(r, (model.potential(_PLAIN, p),))[0]


def acceleration_at(model: GravityModel, r: Vec3, p: Params) -> Vec3:
    """Return the acceleration, m/s², at a position that may be any expression.

    Arguments as for `potential_at`.

    Parameters
    ----------
    model : GravityModel
        The field.
    r : tuple of Expr, length 3
        Position in the frame of the model, m.
    p : Params
        Values of its parameters, as numbers or expressions.

    Returns
    -------
    tuple of Expr, length 3
        Acceleration in that frame, m/s².
    """
    if isinstance(r[0], Overloaded):
        return acceleration_within(model, r, p)
    x, y, z = _at(r, model.acceleration(_PLAIN, p))
    return (x, y, z)


def acceleration_within(model: AnyGravityModel, r: Vec3, p: Params) -> Vec3:
    """Bound the acceleration over a box of positions.

    Parameters
    ----------
    model : GravityModel or ArrayGravityModel
        The model.
    r : Vec3
        Position, `hillsphere.engine.dynamics.bounds.Bound`, m.
    p : Params
        A bound per parameter of the model.

    Returns
    -------
    Vec3
        Bounds of the acceleration, m/s². They follow from the model's own bound of the magnitude,
        which constrains neither direction nor rate, or else from its equations in interval
        arithmetic.

    Raises
    ------
    TypeError
        If the model offers neither.
    """
    if isinstance(model, BoundedGravity):
        places = [Bound.of(q) for q in r]
        distance = norm([Bound(q.value) for q in places])
        values = {name: Bound(Bound.of(value).value) for name, value in p.items()}
        most = Bound.of(model.acceleration_bound(distance, values)).value[1]
        moving = any(q.rate is not None for q in places)
        change = EVERYTHING if moving else None
        pull = Bound((-most, most), change, change)
        return cast(Vec3, (pull, pull, pull))
    if isinstance(model, ArrayGravityModel):
        raise TypeError(f"no bound of the gravity of {type(model).__name__} is known")
    return model.acceleration(r, p)


def gravity_gradient(model: GravityModel, r: Vec3, p: Params) -> tuple[Vec3, Vec3, Vec3]:
    """Return the exact gravity gradient, by automatic differentiation of the acceleration.

    Parameters
    ----------
    model : GravityModel
        The model.
    r : Vec3
        Position in the model's frame, m; any expression.
    p : Params
        One expression per parameter of the model.

    Returns
    -------
    tuple of Vec3
        Rows ∂gᵢ/∂x, ∂gᵢ/∂y, ∂gᵢ/∂z, 1/s², in the model's frame.
    """
    rows = jacobian(model.acceleration(_PLAIN, p), _PLAIN)
    flat = _at(r, [slope for row in rows for slope in row])
    return cast("tuple[Vec3, Vec3, Vec3]", (flat[0:3], flat[3:6], flat[6:9]))


def _at(r: Vec3, expressions: Sequence[Expr]) -> tuple[Expr, ...]:
    return substitute(expressions, dict(zip(_PLAIN, r, strict=True)))


class GravityField:
    """A gravity model, compiled to functions of arrays of points.

    Parameters
    ----------
    model : GravityModel or ArrayGravityModel
        The model.
    run_time : sequence of str
        Names of the k model parameters that are given at each call, in the order of the rows of
        `p`; the others are compiled as constants with their nominal values.

    Raises
    ------
    InputError
        If a run-time parameter is not one of the model's.

    Notes
    -----
    Each function is compiled at its first call. Points r are (3, N) or (3,), m, in the model's
    frame; p is (k, N) or (k,), SI, by default the nominal values.

    First call without a warm cache and time per point, spherical harmonics, one run on one shared
    core with AVX-512 (from degree 70 on the bare expressions were timed, in compact mode):

    ======  ==================  ==================
    degree  acceleration        gradient
    ======  ==================  ==================
    4       0.05 s, 4 ns        0.17 s, 19 ns
    8       0.13 s, 13 ns       0.8 s, 0.14 µs
    20      0.8 s, 0.14 µs      7 s, 1.6 µs
    50      11 s, 2.1 µs        32 s, 26 µs
    70      not measured        59 s, 21 µs
    100     18 s, 14 µs         not measured
    150     35 s, 18 µs         not measured
    200     56 s, 53 µs         not measured
    ======  ==================  ==================

    Truncate a longer series (``max_degree``), since its compilation can take minutes.

    The gradient of an `ArrayGravityModel` is its own ``gradient_array(r, p)`` -> (3, 3, N) if it
    has one, else central differences of fourth order at two steps, which must agree.
    """

    def __init__(self, model: AnyGravityModel, run_time: Sequence[str] = ()) -> None:
        self.model = model
        self.run_time = tuple(run_time)
        self._parameters = model.parameters()
        self._p = model_parameters(self._parameters, self.run_time)
        nominal = {q.name: q.value for q in self._parameters}
        self._nominal = np.array([nominal[name] for name in self.run_time])
        self._compiled: dict[str, Callable[[Array, Array], Array]] = {}

    def potential(self, r: ArrayLike, p: ArrayLike | None = None) -> Array:
        """Return +U, m²/s², shape (N,); 0-d for one point."""
        result: Array = self._call("potential", r, p)[0]
        return result

    def acceleration(self, r: ArrayLike, p: ArrayLike | None = None) -> Array:
        """Return ∇U, m/s², shape (3, N) or (3,)."""
        return self._call("acceleration", r, p)

    def gradient(self, r: ArrayLike, p: ArrayLike | None = None) -> Array:
        """Return ∂gᵢ/∂xⱼ, 1/s², shape (3, 3, N) or (3, 3).

        Raises
        ------
        ConvergenceError
            If the differences of an `ArrayGravityModel` without a gradient of its own do not
            agree.
        """
        flat = self._call("gradient", r, p)
        return flat.reshape(3, 3, *flat.shape[1:])

    def _call(self, quantity: str, r: ArrayLike, p: ArrayLike | None) -> Array:
        points = np.ascontiguousarray(r, dtype=float)
        if points.ndim not in (1, 2) or points.shape[0] != 3:
            raise InputError(f"r must be (3, N) or (3,), got {points.shape}")
        columns = points[:, None] if points.ndim == 1 else points
        values = self._nominal if p is None else np.asarray(p, dtype=float)
        if values.ndim == 1:
            values = values[:, None]
        rows, cases = len(self.run_time), columns.shape[1]
        if values.ndim != 2 or values.shape[0] != rows or values.shape[1] not in (1, cases):
            raise InputError(f"p must be ({rows},) or ({rows}, {cases}), got {values.shape}")
        if quantity not in self._compiled:
            self._compiled[quantity] = (
                self._array_function(self.model, quantity)
                if isinstance(self.model, ArrayGravityModel)
                else self._expression_function(self.model, quantity)
            )
        spread = np.ascontiguousarray(np.broadcast_to(values, (rows, cases)))
        result = self._compiled[quantity](columns, spread)
        return result[:, 0] if points.ndim == 1 else result

    def _expression_function(
        self, model: GravityModel, quantity: str
    ) -> Callable[[Array, Array], Array]:
        if quantity == "potential":
            expressions: tuple[Expr, ...] = (potential_at(model, _PLAIN, self._p),)
        elif quantity == "acceleration":
            expressions = acceleration_at(model, _PLAIN, self._p)
        else:
            rows = gravity_gradient(model, _PLAIN, self._p)
            expressions = tuple(slope for row in rows for slope in row)
        compact = len(self._parameters) > _COMPACT_FROM[quantity]
        compiled = ArrayFunction(expressions, _PLAIN, self.run_time, compact=compact)
        return lambda points, p: compiled(points, p)

    def _array_function(
        self, model: ArrayGravityModel, quantity: str
    ) -> Callable[[Array, Array], Array]:
        nominal = np.array([q.value for q in self._parameters])
        names = [q.name for q in self._parameters]
        places = [names.index(name) for name in self.run_time]

        def evaluate(points: Array, p: Array) -> Array:
            full = np.repeat(nominal[:, None], points.shape[1], axis=1)
            full[places] = p
            if quantity == "potential":
                return np.asarray(model.potential_array(points, full), dtype=float)[None, :]
            if quantity == "acceleration":
                return np.asarray(model.acceleration_array(points, full), dtype=float)
            return _array_gradient(model, points, full).reshape(9, -1)

        return evaluate


def field_of(model: AnyGravityModel, run_time: Sequence[str] = ()) -> GravityField:
    """Return ``GravityField(model, run_time)``.

    Parameters
    ----------
    model : AnyGravityModel
        The field.
    run_time : sequence of str
        Names of the parameters whose values are given at each evaluation.

    Returns
    -------
    GravityField
        The field as a function of arrays.
    """
    return GravityField(model, run_time)


# Offsets, in steps, and weights of the central difference of fourth order.
_STENCIL = ((-2.0, 1.0 / 12.0), (-1.0, -8.0 / 12.0), (1.0, 8.0 / 12.0), (2.0, -1.0 / 12.0))
_RELATIVE_STEP = 4e-4
"""Step of the differences, part of the distance: truncation (24 h⁴/r⁴ for a point mass) and
rounding both stay near 1e-12."""
_AGREEMENT = 1e-6
"""Largest relative difference between a step and half of it. A smooth field reaches 1e-11; at a
kink or in a noisy table the difference stays far larger."""


def _array_gradient(model: ArrayGravityModel, r: Array, p: Array) -> Array:
    """Gradient (3, 3, N) of an array model at r (3, N) with all its parameters p (k, N)."""
    own: Callable[[Array, Array], Array] | None = getattr(model, "gradient_array", None)
    if own is not None:
        return np.asarray(own(r, p), dtype=float)
    step = _RELATIVE_STEP * np.maximum(np.linalg.norm(r, axis=0), 1.0)
    coarse = _central_differences(model, r, p, step)
    fine = _central_differences(model, r, p, 0.5 * step)
    size = np.abs(fine).max(axis=(0, 1))
    difference = np.abs(fine - coarse).max(axis=(0, 1))
    # In a uniform field the gradient is zero, and only the rounding of the acceleration remains.
    strength = np.linalg.norm(np.asarray(model.acceleration_array(r, p)), axis=0)
    allowed = _AGREEMENT * size + 16.0 * np.finfo(float).eps * strength / step
    if (bad := np.flatnonzero(~(difference <= allowed))).size:
        where = ", ".join(f"{value:.6g}" for value in r[:, bad[0]])
        raise ConvergenceError(
            f"gravity gradient by differences does not converge at {bad.size} of {r.shape[1]} "
            f"points, first at ({where}) m; give {type(model).__name__} a method gradient_array"
        )
    return fine


def _central_differences(model: ArrayGravityModel, r: Array, p: Array, step: Array) -> Array:
    rows = np.zeros((3, 3, r.shape[1]))
    for axis in range(3):
        for offset, weight in _STENCIL:
            moved = r.copy()
            moved[axis] += offset * step
            rows[:, axis] += weight * np.asarray(model.acceleration_array(moved, p)) / step
    return rows
