"""The circular Hill problem about a small moon."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hillsphere.gravity import AnyGravityModel, is_array_model
from hillsphere.interfaces import Array, Parameter, Variable
from hillsphere.symbolic import Expr, Params, Vec3, dot, sum_of
from hillsphere_plants.moon_centred import (
    ArrayAttraction,
    MoonCentred,
    SymbolicAttraction,
    moon_of,
)
from hillsphere_plants.specs import HillSpec

__all__ = ["ArrayHill", "Hill", "hill"]


def hill(spec: HillSpec) -> Hill | ArrayHill:
    """Make the plant: of expressions, or with array terms if the gravity is an array model."""
    gravity: AnyGravityModel = spec.gravity.get()
    if is_array_model(gravity):
        return ArrayHill(spec)
    return Hill(spec)


class _HillMotion(MoonCentred):
    """Hill's equations, whatever the gravity."""

    mirrors: Mapping[str, tuple[int, ...]] = {
        "xz": (1, -1, 1, -1, 1, -1),
        "yz": (-1, 1, 1, 1, -1, -1),
    }
    """Time reversals that hold if the gravity has the same mirror plane; check before use."""

    def __init__(self, spec: HillSpec) -> None:
        super().__init__(spec, spec.prime_meridian_rad, moon_of(spec.body).mean_motion_rad_s)

    def _own_parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("mean_motion", self.mean_motion_rad_s, "rad/s"),)

    def _motion(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], p: Params, pull: Vec3
    ) -> tuple[Expr, ...]:
        px, _, pz, vx, vy, vz = x
        # Coriolis terms, and the sum of tide and centrifugal acceleration (3n²x, 0, −n²z)
        n = p["mean_motion"]
        return (
            vx,
            vy,
            vz,
            sum_of([2.0 * n * vy, 3.0 * n * n * px, pull[0], u[0]]),
            sum_of([-2.0 * n * vx, pull[1], u[1]]),
            sum_of([-n * n * pz, pull[2], u[2]]),
        )


class Hill(SymbolicAttraction, _HillMotion):
    r"""Circular Hill problem: motion near a moon whose mass is small beside its primary's.

    In the frame ``hill:BODY`` (x away from the primary, y along the moon's orbital velocity, z its
    orbit normal; rotating with the mean motion n) and with the moon's attraction :math:`\nabla U`,

    .. math::

        \ddot x = 2n\dot y + 3n^2x + U_x + a_x, \quad
        \ddot y = -2n\dot x + U_y + a_y, \quad
        \ddot z = -n^2z + U_z + a_z .

    The moon is locked: its gravity and its shape stand still in this frame, turned about z by the
    angle of the prime meridian. Without control the Jacobi constant

    .. math:: C = \tfrac12(3n^2x^2 - n^2z^2) + U - \tfrac12 v^2

    is conserved (energy with the opposite sign). Natural units are
    :math:`L = (\mu/n^2)^{1/3}` and :math:`1/n`.

    Parameters
    ----------
    spec : HillSpec
        With its references bound.

    References
    ----------
    .. [1] Scheeres, D. J., Orbital Motion in Strongly Perturbed Environments, Springer, 2012
       (Hill's equations with a general potential of the secondary).
    """

    integral_variable = Variable("jacobi", 2, -2)

    def integral(self, x: tuple[Expr, ...], p: Params) -> Expr:
        """Return the Jacobi constant C, m²/s²; larger means closer or slower."""
        n = p["mean_motion"]
        tide = 0.5 * n * n * (3.0 * x[0] * x[0] - x[2] * x[2])
        return tide + self._potential(x, p) - 0.5 * dot(x[3:6], x[3:6])


class ArrayHill(ArrayAttraction, _HillMotion):
    """The same problem with gravity that is a function of arrays (a polyhedron, a table).

    The Jacobi constant is a function of arrays too.

    Parameters
    ----------
    spec : HillSpec
        With its references bound.
    """

    def integral_array(self, x: Array) -> Array:
        """Return the Jacobi constant C (N,), m²/s², at states x (6, N), SI, nominal parameters."""
        n = self.mean_motion_rad_s
        tide = 0.5 * n**2 * (3.0 * x[0] ** 2 - x[2] ** 2)
        return np.asarray(tide + self._potential_array(x) - 0.5 * np.sum(x[3:6] ** 2, axis=0))
