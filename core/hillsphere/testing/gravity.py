"""Checks of gravity models: consistent derivatives, Laplace's equation, and the far field."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.engine.dynamics.compiled import ArrayFunction
from hillsphere.engine.gravity import GravityField, model_parameters
from hillsphere.interfaces import Array, Parameter
from hillsphere.symbolic.expressions import variables
from hillsphere.testing.contract import check_close, derivative_by_differences, require

__all__ = ["check_gravity"]

_STEP = 2e-3
"""Step of the differences, part of the distance: balances the truncation of sixth order (h⁶ =
6e-17) with rounding (eps/h = 1e-13)."""
_MOST_PARAMETERS = 12
"""Parameters that are examined, evenly chosen from all: a field of high degree has thousands, and
the time to compile grows with each."""


def check_gravity(model: Any, points: ArrayLike, *, tol: float = 1e-8) -> None:
    """Check a gravity model.

    Parameters
    ----------
    model : GravityModel or ArrayGravityModel
        The model.
    points : array_like, shape (3, N)
        Positions outside the mass, m, in the model's frame; best at random, off every axis. Their
        distance from a singularity must be at least a tenth of that from the origin.
    tol : float
        Largest relative difference between derivatives and finite differences.

    Raises
    ------
    ContractViolation
        Unless, at all points and far out,

        - potential, acceleration and gradient are finite;
        - the acceleration is the gradient of the potential, and the gradient that of the
          acceleration, both by sixth-order differences;
        - Laplace's equation holds: the trace is below `tol` of the sum of its absolute terms;
        - the field tends to GM/r², with GM the model's ``gm_m3_s2``;
        - every run-time parameter (of many, a dozen) has the declared nominal value and changes
          the field;
        - both forms of a model that is symbolic and a function of arrays agree.
    """
    r = np.ascontiguousarray(points, dtype=float)
    require(r.ndim == 2 and r.shape[0] == 3, f"points must be (3, N), got {r.shape}")
    what = type(model).__name__
    require(isinstance(model.frame, str) and model.frame, f"{what}.frame must name a frame")
    field = GravityField(model)
    distance = np.linalg.norm(r, axis=0)
    u, g, gradient = field.potential(r), field.acceleration(r), field.gradient(r)
    for name, values in (("potential", u), ("acceleration", g), ("gradient", gradient)):
        require(np.all(np.isfinite(values)), f"{what}: {name} is not finite at every point")
    require(np.all(u > 0), f"{what}: the potential must be +U, positive outside the mass")

    steps = np.broadcast_to(_STEP * distance, r.shape)
    slope = derivative_by_differences(lambda x: field.potential(x)[None], r, steps)[0]
    check_close(f"{what}: acceleration against ∇U", g, slope, u / distance, tol)
    curvature = derivative_by_differences(field.acceleration, r, steps)
    size = np.abs(gradient).max(axis=(0, 1))
    check_close(f"{what}: gradient against ∇g", gradient, curvature, size, tol)
    diagonal = np.einsum("iin->in", gradient)
    residual = np.abs(diagonal.sum(axis=0)) / np.abs(diagonal).sum(axis=0)
    require(
        residual.max() <= tol,
        f"{what}: Laplace's equation fails outside: trace {residual.max():.1e} of its terms "
        "(are the points outside the mass?)",
    )
    if hasattr(model, "acceleration_array") and hasattr(model, "acceleration"):
        _check_two_faces(what, model, r, tol)
    _check_far_field(what, field, r, float(model.gm_m3_s2))
    _check_parameters(what, model, r, u, g)


def _check_two_faces(what: str, model: Any, r: Array, tol: float) -> None:
    parameters = tuple(model.parameters())
    position = variables("x", "y", "z")
    written = ArrayFunction(model.acceleration(position, model_parameters(parameters)), position)
    nominal = np.array([q.value for q in parameters], dtype=float)[:, None]
    by_array = np.asarray(model.acceleration_array(r, np.repeat(nominal, r.shape[1], axis=1)))
    expected = written(r)
    size = np.abs(expected).max(axis=0)
    check_close(f"{what}: array against expression", by_array, expected, size, tol)


def _check_far_field(what: str, field: GravityField, r: Array, gm: float) -> None:
    require(gm > 0 and np.isfinite(gm), f"{what}: gm_m3_s2 must be positive, got {gm}")
    size = float(np.linalg.norm(r, axis=0).max())
    direction = r / np.linalg.norm(r, axis=0)
    for reach in (1e3, 1e5):
        far = reach * size
        g = field.acceleration(far * direction)
        # A centre of mass off the origin still shows as size/far; nothing may show stronger.
        check_close(
            f"{what}: field at {far:.1e} m against −GM/r²",
            g,
            -gm / far**2 * direction,
            gm / far**2,
            10.0 / reach,
        )


def _check_parameters(what: str, model: Any, r: Array, u: Array, g: Array) -> None:
    parameters: tuple[Parameter, ...] = tuple(model.parameters())
    names = [q.name for q in parameters]
    require(len(set(names)) == len(names), f"{what}: parameter names repeat: {names}")
    if not parameters:
        return
    stride = -(-len(parameters) // _MOST_PARAMETERS)
    chosen = parameters[::stride]
    field = GravityField(model, [q.name for q in chosen])
    nominal = np.array([q.value for q in chosen])
    at_nominal = field.potential(r, nominal)
    check_close(f"{what}: potential with run-time parameters", at_nominal, u, u, 1e-12)
    pull = field.acceleration(r, nominal)
    check_close(
        f"{what}: acceleration with run-time parameters", pull, g, np.abs(g).max(axis=0), 1e-11
    )
    for i, q in enumerate(chosen):
        changed = nominal.copy()
        changed[i] = q.value * 1.001 if q.value else 1e-3
        same = np.array_equal(field.potential(r, changed), at_nominal) or np.array_equal(
            field.acceleration(r, changed), pull
        )
        require(not same, f"{what}: run-time parameter {q.name!r} changes nothing")
