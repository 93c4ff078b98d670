"""The circular Hill problem about a small moon."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np

from hillsphere.gravity import (
    AnyGravityModel,
    GravityField,
    acceleration_at,
    is_array_model,
    potential_at,
)
from hillsphere.interfaces import (
    Array,
    ArrayGravityModel,
    GravityModel,
    Parameter,
    Piecewise,
    Scales,
    SeriesGravity,
    Surface,
    Variable,
)
from hillsphere.symbolic import Expr, Params, Vec3, dot, sum_of, variable
from hillsphere_plants.rotation import AxialRotation
from hillsphere_plants.specs import HillSpec

__all__ = ["ArrayHill", "Hill", "hill"]

_STATES = (
    Variable("x", 1),
    Variable("y", 1),
    Variable("z", 1),
    Variable("vx", 1, -1),
    Variable("vy", 1, -1),
    Variable("vz", 1, -1),
)
_CONTROLS = (Variable("ax", 1, -2), Variable("ay", 1, -2), Variable("az", 1, -2))
_PREFIX = "gravity."


def hill(spec: HillSpec) -> Hill | ArrayHill:
    """Make the plant: of expressions, or with array terms if the gravity is an array model."""
    gravity: AnyGravityModel = spec.gravity.get()
    if is_array_model(gravity):
        return ArrayHill(spec)
    return Hill(spec)


class _HillBase:
    """What both plants share: everything but the gravity itself."""

    states = _STATES
    controls = _CONTROLS
    mirrors: Mapping[str, tuple[int, ...]] = {
        "xz": (1, -1, 1, -1, 1, -1),
        "yz": (-1, 1, 1, 1, -1, -1),
    }
    """Time reversals that hold if the gravity has the same mirror plane; check before use."""

    def __init__(self, spec: HillSpec) -> None:
        self.spec = spec
        body = spec.body.get()
        self._model: AnyGravityModel = spec.gravity.get()
        self.body_name: str = body.name
        self.mean_motion_rad_s: float = body.mean_motion_rad_s
        self.primary_distance_m: float = body.semi_major_axis_m
        self.rotation = AxialRotation.by(spec.prime_meridian_rad)
        self._semi_axes_m: tuple[float, float, float] | None = body.semi_axes_m

    @property
    def frame(self) -> str:
        """``hill:BODY``."""
        return f"hill:{self.body_name}"

    @property
    def scales(self) -> Scales:
        """Natural units: L = (μ/n²)^(1/3) and 1/n."""
        n = self.mean_motion_rad_s
        return Scales(length_m=(self._model.gm_m3_s2 / n**2) ** (1.0 / 3.0), time_s=1.0 / n)

    @property
    def semi_axes_m(self) -> tuple[float, float, float] | None:
        """Semi-axes of the moon's surface in its body-fixed frame, m; None if it has none.

        Those of the body, or else those of the gravity model.
        """
        if self._semi_axes_m is not None:
            return self._semi_axes_m
        return self._model.semi_axes_m() if isinstance(self._model, Surface) else None

    @property
    def gravity_name(self) -> str:
        """Kind of the gravity model in words, for legends: ``"point mass"``."""
        return " ".join(re.findall("[A-Z][a-z0-9]*", type(self._model).__name__)).lower()

    @property
    def series_radius_m(self) -> float | None:
        """Radius inside which the gravity is a harmonic series without guarantee of convergence.

        The Brillouin sphere, that is the largest semi-axis, or where no shape is known the
        reference radius of the series; None if the gravity is no series.
        """
        series = self._model.series_radius_m if isinstance(self._model, SeriesGravity) else None
        return series if series is None or self.semi_axes_m is None else max(self.semi_axes_m)

    @property
    def prime_meridian_rad(self) -> float:
        """Angle about +z from +x to the body's longitude 0."""
        return self.spec.prime_meridian_rad

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the mean motion and the parameters of the gravity model, prefixed."""
        gravity = (Parameter(_PREFIX + q.name, q.value, q.unit) for q in self._model.parameters())
        return (Parameter("mean_motion", self.mean_motion_rad_s, "rad/s"), *gravity)

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return ``impact`` (where the moon has a surface) and ``escape`` (where it is asked for).

        Both are without dimension and of order one near the body: an ellipsoid's
        x²/a² + y²/b² + z²/c² − 1, and 1 − r²/R².
        """
        found: dict[str, Expr] = {}
        place = self.rotation.to_body(_vector(x[:3]))
        if self._semi_axes_m is not None:
            squares = [q * q / (a * a) for q, a in zip(place, self._semi_axes_m, strict=True)]
            found["impact"] = sum_of([*squares, -1.0])
        elif isinstance(self._model, Surface):
            found["impact"] = self._model.surface(place)
        if self.spec.escape_radius_m is not None:
            found["escape"] = 1.0 - dot(x[:3], x[:3]) / self.spec.escape_radius_m**2
        return found

    @staticmethod
    def _motion(x: tuple[Expr, ...], u: tuple[Expr, ...], n: Expr, pull: Vec3) -> tuple[Expr, ...]:
        """Return dx/dt for the attraction `pull` in the frame of the motion."""
        px, _, pz, vx, vy, vz = x
        return (
            vx,
            vy,
            vz,
            sum_of([2.0 * n * vy, 3.0 * n * n * px, pull[0], u[0]]),
            sum_of([-2.0 * n * vx, pull[1], u[1]]),
            sum_of([-n * n * pz, pull[2], u[2]]),
        )


class Hill(_HillBase):
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

    def __init__(self, spec: HillSpec) -> None:
        super().__init__(spec)
        self.gravity: GravityModel = spec.gravity.get()

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return dx/dt, SI."""
        place = self.rotation.to_body(_vector(x[:3]))
        pull = self.rotation.from_body(acceleration_at(self.gravity, place, _of_gravity(p)))
        return self._motion(x, u, p["mean_motion"], pull)

    def switches(self, x: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
        """Return where the gravity model changes branch: the surface of an ellipsoid."""
        if not isinstance(self.gravity, Piecewise):
            return ()
        return self.gravity.switches(self.rotation.to_body(_vector(x[:3])), _of_gravity(p))

    def integral(self, x: tuple[Expr, ...], p: Params) -> Expr:
        """Return the Jacobi constant C, m²/s²; larger means closer or slower."""
        n = p["mean_motion"]
        tide = 0.5 * n * n * (3.0 * x[0] * x[0] - x[2] * x[2])
        place = self.rotation.to_body(_vector(x[:3]))
        potential = potential_at(self.gravity, place, _of_gravity(p))
        return tide + potential - 0.5 * dot(x[3:6], x[3:6])


class ArrayHill(_HillBase):
    """The same problem with gravity that is a function of arrays (a polyhedron, a table).

    The attraction enters the equations as three terms that the step map evaluates at each stage;
    the Jacobi constant is a function of arrays too.

    Parameters
    ----------
    spec : HillSpec
        With its references bound.
    """

    external = (
        Variable("hill:gx", 1, -2),
        Variable("hill:gy", 1, -2),
        Variable("hill:gz", 1, -2),
    )

    def __init__(self, spec: HillSpec) -> None:
        super().__init__(spec)
        self.gravity: ArrayGravityModel = spec.gravity.get()
        names = [q.name for q in self.gravity.parameters()]
        self._field = GravityField(self.gravity, run_time=names)
        c, s = self.rotation
        # columns: the body's axes in the frame of the motion
        self._axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return dx/dt, SI, with the attraction as the variables of `external`."""
        pull = _vector([variable(v.name) for v in self.external])
        return self._motion(x, u, p["mean_motion"], pull)

    def external_array(self, x: Array, t: Array, p: Array) -> Array:
        """Return the attraction (3, N), m/s², at states x (6, N); p (k, N) as `parameters`."""
        return np.asarray(self._axes @ self._field.acceleration(self._axes.T @ x[:3], p[1:]))

    def external_jacobian(self, x: Array, t: Array, p: Array) -> Array:
        """Return the derivatives (3, 6, N) of the attraction by the states."""
        slopes = np.zeros((3, 6, x.shape[1]))
        body = self._field.gradient(self._axes.T @ x[:3], p[1:])
        slopes[:, :3] = np.einsum("ia,abk,jb->ijk", self._axes, body, self._axes)
        return slopes

    def integral_array(self, x: Array) -> Array:
        """Return the Jacobi constant C (N,), m²/s², at states x (6, N), SI, nominal parameters."""
        n = self.mean_motion_rad_s
        values = np.array([q.value for q in self.gravity.parameters()])
        potential = self._field.potential(self._axes.T @ x[:3], values)
        tide = 0.5 * n**2 * (3.0 * x[0] ** 2 - x[2] ** 2)
        return np.asarray(tide + potential - 0.5 * np.sum(x[3:6] ** 2, axis=0))


def _vector(components: Sequence[Expr]) -> Vec3:
    x, y, z = components
    return (x, y, z)


def _of_gravity(p: Params) -> Params:
    return {k.removeprefix(_PREFIX): v for k, v in p.items() if k.startswith(_PREFIX)}
