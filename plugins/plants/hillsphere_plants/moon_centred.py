"""Common part of plants about a moon: its gravity, its surface, the end of a flight."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import inf
from typing import Protocol

import numpy as np

from hillsphere.engine.start_states import Centre
from hillsphere.errors import InputError
from hillsphere.gravity import (
    AnyGravityModel,
    GravityField,
    acceleration_at,
    acceleration_within,
    potential_at,
    whole_gravity,
)
from hillsphere.interfaces import (
    Array,
    ArrayGravityModel,
    ArraySurface,
    BoundedSeries,
    Enclosed,
    GravityModel,
    Parameter,
    Piecewise,
    Scales,
    SeriesGravity,
    Surface,
    Variable,
)
from hillsphere.model.bodies import OrbitingBody
from hillsphere.model.frame_motion import FrameMotion, turn_about_z
from hillsphere.model.inertial import RotatingFrame
from hillsphere.model.shapes.levels import level_within
from hillsphere.spec import Ref
from hillsphere.symbolic import (
    Expr,
    Overloaded,
    Params,
    Vec3,
    constant,
    dot,
    sum_of,
    variable,
    variables,
)
from hillsphere.time import Epoch
from hillsphere_plants.rotation import AxialRotation

__all__ = [
    "CONTROLS",
    "POSITION_AND_VELOCITY",
    "ArrayAttraction",
    "MoonCentred",
    "MoonCentredSpec",
    "SymbolicAttraction",
    "moon_of",
    "vector",
]

POSITION_AND_VELOCITY = (
    Variable("x", 1),
    Variable("y", 1),
    Variable("z", 1),
    Variable("vx", 1, -1),
    Variable("vy", 1, -1),
    Variable("vz", 1, -1),
)
CONTROLS = (Variable("ax", 1, -2), Variable("ay", 1, -2), Variable("az", 1, -2))
_PREFIX = "gravity."
_LEVEL = Variable("surface:level", unit="-")


class MoonCentredSpec(Protocol):
    """Keys that the Specs of such plants have in common."""

    @property
    def body(self) -> Ref:
        """The moon."""
        ...

    @property
    def gravity(self) -> Ref:
        """Its gravity."""
        ...

    @property
    def escape_radius_m(self) -> float | None:
        """Radius at which a flight ends as escaped."""
        ...


class MoonCentred(ABC):
    """Motion about a moon in a frame in which the moon is at rest.

    A subclass gives the equations (`_motion`, `_own_parameters`). One of `SymbolicAttraction` and
    `ArrayAttraction` gives the attraction of the moon.

    Parameters
    ----------
    spec : MoonCentredSpec
        With its references bound.
    meridian_rad : float
        Angle about +z from +x to the moon's longitude 0.
    mean_motion_rad_s : float
        Mean motion of the moon about its primary.
    """

    states: tuple[Variable, ...] = POSITION_AND_VELOCITY
    controls = CONTROLS

    def __init__(
        self, spec: MoonCentredSpec, meridian_rad: float, mean_motion_rad_s: float
    ) -> None:
        body = moon_of(spec.body)
        self._model: AnyGravityModel = whole_gravity(spec.gravity.get(), body.semi_axes_m)
        self._semi_axes_m: tuple[float, float, float] | None = body.semi_axes_m
        self._shape = body.shape
        if body.shape is None and body.semi_axes_m is None:
            self._shape = self._model if isinstance(self._model, Surface | ArraySurface) else None
        self._escape_radius_m = spec.escape_radius_m
        self.moon: OrbitingBody = body
        self.body_name: str = body.name
        self.primary_distance_m: float = body.semi_major_axis_m
        # Its square is a divisor, and underflows for a primary of next to no attraction.
        if not 0.0 < mean_motion_rad_s * mean_motion_rad_s < inf:
            raise InputError(
                f"the mean motion of {body.name!r} is {mean_motion_rad_s:.3g} rad/s, with which "
                "nothing can be computed; correct primary_gm or semi_major_axis of the body"
            )
        self.mean_motion_rad_s = mean_motion_rad_s
        self.prime_meridian_rad = meridian_rad
        self.rotation = AxialRotation.by(meridian_rad)

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
        return self._semi_axes_m if self._shape is None else self._shape.semi_axes_m()

    @property
    def surface(self) -> Surface | ArraySurface | None:
        """Shape of the moon in its body-fixed frame; None if it has none beyond `semi_axes_m`."""
        return self._shape

    @property
    def gravity_name(self) -> str:
        """Kind of the gravity model in words, for legends: ``"point mass"``."""
        return " ".join(re.findall("[A-Z][a-z0-9]*", type(self._model).__name__)).lower()

    @property
    def series_radius_m(self) -> float | None:
        """Radius inside which the gravity is a harmonic series without guarantee of convergence.

        The Brillouin sphere, that is the largest radius of the surface, or where no shape is known
        the reference radius of the series; of a `BoundedSeries` the radius from which it holds;
        None if the gravity is no series.
        """
        series = self._model.series_radius_m if isinstance(self._model, SeriesGravity) else None
        if isinstance(self._model, BoundedSeries):
            return series
        if series is None or self.semi_axes_m is None:
            return series
        if isinstance(self._shape, Enclosed):
            return self._shape.largest_radius_m
        return max(self.semi_axes_m)

    @property
    def gravity_holds_from_m(self) -> float | None:
        """Distance from the moon from which a series stands for its exact gravity; else None."""
        return self._model.holds_from_m if isinstance(self._model, BoundedSeries) else None

    def gravity_error(self, x: Array) -> Array | None:
        """Return the relative error (N,) of such a series at x (3, N), m, in the motion's frame."""
        if not isinstance(self._model, BoundedSeries):
            return None
        return self._model.acceleration_error(self._axes.T @ x)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters of the motion, then those of the gravity model, prefixed."""
        gravity = (replace(q, name=_PREFIX + q.name) for q in self._model.parameters())
        return (*self._own_parameters(), *gravity)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        """Return dx/dt, SI."""
        return self._motion(x, u, p, self._attraction(x, p))

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> Mapping[str, Expr]:
        """Return ``impact`` (where the moon has a surface) and ``escape`` (where it is asked for).

        Both are without dimension and of order one near the body: an ellipsoid's
        x²/a² + y²/b² + z²/c² − 1, and 1 − r²/R². Of a surface that is no expression the first is
        one of the `event_terms`.
        """
        events: dict[str, Expr] = {}
        place = self._place(x)
        if self._shape is not None and isinstance(x[0], Overloaded):
            events["impact"] = level_within(self._shape, place)
        elif self.event_terms:
            events["impact"] = variable(_LEVEL.name)
        elif isinstance(self._shape, Surface):
            events["impact"] = self._shape.surface(place)
        elif self._semi_axes_m is not None:
            squares = [q * q / (a * a) for q, a in zip(place, self._semi_axes_m, strict=True)]
            events["impact"] = sum_of([*squares, -1.0])
        if self._escape_radius_m is not None:
            events["escape"] = 1.0 - dot(x[:3], x[:3]) / self._escape_radius_m**2
        return events

    @property
    def event_terms(self) -> tuple[Variable, ...]:
        """The level over a surface that is a function of arrays (see `ExternalEvents`)."""
        expression = isinstance(self._shape, Surface)
        return (_LEVEL,) if isinstance(self._shape, ArraySurface) and not expression else ()

    def event_terms_array(self, x: Array, t: Array, p: Array) -> Array:
        """Return the level (1, N) over that surface at states x (n, N)."""
        if not isinstance(self._shape, ArraySurface):
            return np.zeros((0, x.shape[1]))
        return self._shape.surface_array(self._axes.T @ x[:3])[None]

    def frame_rate(self, others: Mapping[str, float]) -> Array:
        """Return the angular velocity (3,) of the frame, rad/s: the mean motion about z."""
        return np.array([0.0, 0.0, self.mean_motion_rad_s])

    def centres(self, others: Mapping[str, float]) -> Mapping[str, Centre]:
        """Return the moon, and its primary at rest at its distance on -x."""
        place = np.array([-self.primary_distance_m, 0.0, 0.0])
        speed = np.cross(self.frame_rate(others), place)
        return {
            self.body_name: self._own_centre(),
            self.moon.primary_name: Centre(self.moon.primary_gm_m3_s2, place, speed),
        }

    def _own_centre(self) -> Centre:
        return Centre(self._model.gm_m3_s2, np.zeros(3), np.zeros(3))

    def icrf_axes(self, epoch: Epoch) -> Array:
        """Return the frame's axes in the ICRF as columns (3, 3) at an epoch.

        Raises
        ------
        InputError
            If the body has no orientation.
        """
        orientation = self.moon.orientation
        if orientation is None:
            raise InputError(
                f"body {self.body_name!r} has no orientation, so that nothing says how its axes "
                "stand in the ICRF: give it pole_right_ascension_deg, pole_declination_deg and "
                "prime_meridian_deg, or axes = 'plant'"
            )
        # in a body-fixed frame x is longitude 0, so that the meridian's angle is zero
        turning = RotatingFrame(
            orientation, epoch, self.mean_motion_rad_s, self.prime_meridian_rad,
            self.primary_distance_m,
        )  # fmt: skip
        return np.ascontiguousarray(turning.axes(np.zeros(1))[:, :, 0])

    def frame_motion(self, epoch: Epoch, t_s: Array, others: Mapping[str, Array]) -> FrameMotion:
        """Return the frame at times (K,) after an epoch; see `hillsphere.model.frame_motion`."""
        turned = self.mean_motion_rad_s * t_s
        zero = np.zeros(t_s.size)
        primary = np.array([-self.primary_distance_m, 0.0, 0.0])
        speed = np.cross(self.frame_rate({}), primary)
        return FrameMotion(
            turn_about_z(self.icrf_axes(epoch), np.remainder(turned, 2.0 * np.pi)),
            np.stack([zero, zero, zero + self.mean_motion_rad_s]),
            {
                self.body_name: np.zeros((6, t_s.size)),
                self.moon.primary_name: np.concatenate([primary, speed])[:, None] + zero,
            },
        )

    def others_over_time(self, start: Mapping[str, float], t_s: Array) -> Mapping[str, Array]:
        """Return none: positions and velocities are all states."""
        return {}

    def _place(self, x: Sequence[Expr]) -> Vec3:
        """Return the position in the moon's body-fixed frame."""
        return self.rotation.to_body(vector(x[:3]))

    def _moon_gm(self, p: Params) -> Expr:
        """Return the moon's GM: following its parameter ``gm`` where the gravity has one."""
        nominal = {q.name: q.value for q in self._model.parameters()}.get("gm")
        if not nominal:
            return constant(self._model.gm_m3_s2)
        return p[_PREFIX + "gm"] * (self._model.gm_m3_s2 / nominal)

    @cached_property
    def _axes(self) -> Array:
        """Columns: the body's axes in the frame of the motion."""
        c, s = self.rotation
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    @abstractmethod
    def _own_parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the motion itself."""

    @abstractmethod
    def _motion(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], p: Params, pull: Vec3
    ) -> tuple[Expr, ...]:
        """Return dx/dt for the attraction `pull` in the frame of the motion."""

    @abstractmethod
    def _attraction(self, x: tuple[Expr, ...], p: Params) -> Vec3:
        """Return the moon's attraction in the frame of the motion, m/s²."""


class SymbolicAttraction(MoonCentred):
    """Gravity of expressions."""

    @cached_property
    def gravity(self) -> GravityModel:
        """The gravity model."""
        model: GravityModel = self._model  # type: ignore[assignment]  # the factory has chosen
        return model

    def switches(self, x: tuple[Expr, ...], t: Expr, p: Params) -> tuple[Expr, ...]:
        """Return functions at whose zeros the gravity model changes branch.

        An ellipsoid does at its surface.
        """
        if not isinstance(self.gravity, Piecewise):
            return ()
        return self.gravity.switches(self._place(x), _of_gravity(p))

    def _attraction(self, x: tuple[Expr, ...], p: Params) -> Vec3:
        pull = acceleration_at(self.gravity, self._place(x), _of_gravity(p))
        return self.rotation.from_body(pull)

    def _potential(self, x: tuple[Expr, ...], p: Params) -> Expr:
        return potential_at(self.gravity, self._place(x), _of_gravity(p))


class ArrayAttraction(MoonCentred):
    """Gravity that is a function of arrays (a polyhedron, a table).

    The attraction enters the equations as three terms that the step map evaluates at each stage.
    """

    external = (
        Variable("attraction:x", 1, -2),
        Variable("attraction:y", 1, -2),
        Variable("attraction:z", 1, -2),
    )

    @cached_property
    def gravity(self) -> ArrayGravityModel:
        """The gravity model."""
        model: ArrayGravityModel = self._model  # type: ignore[assignment]
        return model

    def external_array(self, x: Array, t: Array, p: Array) -> Array:
        """Return the attraction (3, N), m/s², at states x (n, N); p (k, N) as `parameters`."""
        own = p[len(self._own_parameters()) :]
        return np.asarray(self._axes @ self._field.acceleration(self._axes.T @ x[:3], own))

    def external_jacobian(self, x: Array, t: Array, p: Array) -> Array:
        """Return the derivatives (3, n, N) of the attraction by the states."""
        slopes = np.zeros((3, *x.shape))
        own = p[len(self._own_parameters()) :]
        body = self._field.gradient(self._axes.T @ x[:3], own)
        # A G Aᵀ: the body's gravity gradient in the axes of the motion
        slopes[:, :3] = np.einsum("ia,abk,jb->ijk", self._axes, body, self._axes)
        return slopes

    def _attraction(self, x: tuple[Expr, ...], p: Params) -> Vec3:
        if isinstance(x[0], Overloaded):
            pull = acceleration_within(self.gravity, self._place(x), _of_gravity(p))
            return self.rotation.from_body(pull)
        return vector(variables(*(v.name for v in self.external)))

    def _potential_array(self, x: Array) -> Array:
        values = np.array([q.value for q in self.gravity.parameters()])
        return self._field.potential(self._axes.T @ x[:3], values)

    @cached_property
    def _field(self) -> GravityField:
        return GravityField(self.gravity, run_time=[q.name for q in self.gravity.parameters()])


def moon_of(reference: Ref) -> OrbitingBody:
    """Return the moon of a reference, or raise `InputError` if the body orbits no other."""
    body: object = reference.get()
    if not isinstance(body, OrbitingBody):
        raise InputError(
            f"the plant needs a body that orbits another, as those of type 'moon' and 'asteroid' "
            f"do, got a {type(body).__name__} ({reference.name!r})"
        )
    return body


def vector(components: Sequence[Expr]) -> Vec3:
    """Return three expressions as a vector."""
    x, y, z = components
    return (x, y, z)


def _of_gravity(p: Params) -> Params:
    return {k.removeprefix(_PREFIX): v for k, v in p.items() if k.startswith(_PREFIX)}
