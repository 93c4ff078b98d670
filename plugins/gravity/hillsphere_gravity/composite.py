"""Gravity of several models together, each with a position and an orientation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import cos, pi, sin
from typing import cast

import numpy as np

from hillsphere.errors import InputError
from hillsphere.gravity import (
    AnyGravityModel,
    GravityField,
    acceleration_at,
    is_array_model,
    potential_at,
)
from hillsphere.interfaces import (
    Array,
    BoundedGravity,
    GravityModel,
    Parameter,
    Piecewise,
    SeriesGravity,
)
from hillsphere.symbolic import (
    Expr,
    Params,
    Vec3,
    absolute,
    matvec,
    maximum,
    power,
    sum_of,
)
from hillsphere_gravity.point_mass import PointMass
from hillsphere_gravity.specs import SumSpec

__all__ = ["ArrayGravitySum", "GravitySum", "gravity_sum", "rotation_zxz"]


def gravity_sum(spec: SumSpec) -> GravitySum | ArrayGravitySum:
    """Make a sum: of expressions if every part is one, of array functions otherwise.

    Parameters
    ----------
    spec : SumSpec
        Its parts, references bound. Run-time parameters: those of each part and its ``scale``,
        prefixed with the part's name (``core.gm``, ``core.scale``).

    Returns
    -------
    GravitySum or ArrayGravitySum
        The model, in the frame of the sum.

    Raises
    ------
    InputError
        If a part has a parameter called ``scale``.
    """
    parts = [
        _Part(name, part.model.get(), part.position_m, rotation_zxz(*part.rotation_zxz_rad),
              part.scale)
        for name, part in zip(spec.part_names(), spec.parts, strict=True)
    ]  # fmt: skip
    kind = ArrayGravitySum if any(is_array_model(part.model) for part in parts) else GravitySum
    return kind(parts)


def rotation_zxz(alpha_rad: float, beta_rad: float, gamma_rad: float) -> Array:
    """Return the matrix R₃(γ) R₁(β) R₃(α) from components in the sum's axes to the part's.

    Parameters
    ----------
    alpha_rad, beta_rad, gamma_rad : float
        3-1-3 Euler angles. Multiples of 90° give exact zeros and ones.

    Returns
    -------
    numpy.ndarray, shape (3, 3)
        A rotation.
    """
    (ca, sa), (cb, sb), (cg, sg) = (_cos_sin(a) for a in (alpha_rad, beta_rad, gamma_rad))
    about_z_first = np.array([[ca, sa, 0.0], [-sa, ca, 0.0], [0.0, 0.0, 1.0]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cb, sb], [0.0, -sb, cb]])
    about_z_last = np.array([[cg, sg, 0.0], [-sg, cg, 0.0], [0.0, 0.0, 1.0]])
    matrix: Array = about_z_last @ about_x @ about_z_first
    return matrix


def _cos_sin(angle: float) -> tuple[float, float]:
    """Return cosine and sine, exact for multiples of 90°."""
    quarters = angle / (pi / 2)
    if abs(quarters - round(quarters)) < 1e-14 * max(1.0, abs(quarters)):
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    return cos(angle), sin(angle)


@dataclass(frozen=True)
class _Part:
    name: str
    model: AnyGravityModel
    position_m: tuple[float, float, float]
    rotation: Array
    scale: float


class _Sum:
    """Common part of both sums."""

    frame = "body"

    def __init__(self, parts: Sequence[_Part]) -> None:
        self._parts = tuple(parts)
        for part in self._parts:
            if "scale" in [own.name for own in part.model.parameters()]:
                raise InputError(
                    f"part {part.name!r} has a parameter 'scale' of its own, which the sum's scale "
                    "of this part would hide; the model must call it otherwise"
                )

    @property
    def gm_m3_s2(self) -> float:
        """Gravitational parameter of all parts together, m³/s²."""
        return sum(part.scale * part.model.gm_m3_s2 for part in self._parts)

    @property
    def series_radius_m(self) -> float | None:
        """Sphere about the origin that holds those of all parts that are series; None without."""
        reach = [
            float(np.linalg.norm(part.position_m)) + radius
            for part in self._parts
            if isinstance(part.model, SeriesGravity)
            and (radius := part.model.series_radius_m) is not None
        ]
        return max(reach, default=None)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parts' parameters and scales: ``core.gm``, …, ``core.scale``, …."""
        return tuple(
            replace(own, name=f"{part.name}.{own.name}")
            for part in self._parts
            for own in (*part.model.parameters(), Parameter("scale", part.scale))
        )


class GravitySum(_Sum):
    """U(r) = Σ sᵢ Uᵢ(Rᵢ (r − rᵢ)), all parts written as expressions.

    Parameters
    ----------
    parts : sequence
        Name, model, position, rotation and scale of each; made by `gravity_sum`.
    """

    def potential(self, r: Vec3, p: Params) -> Expr:
        """Return +U, m²/s², at the position r, m, in the frame of the sum."""
        return sum_of(
            p[f"{part.name}.scale"] * potential_at(model, local, own)
            for part, model, local, own in self._local(r, p)
        )

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        """Return ∇U, m/s², at the position r, m, in the frame of the sum."""
        terms = []
        for part, model, local, own in self._local(r, p):
            # the transpose rotates back from the part's axes
            turned = matvec(part.rotation.T.tolist(), acceleration_at(model, local, own))
            terms.append([p[f"{part.name}.scale"] * component for component in turned])
        x, y, z = (sum_of(components) for components in zip(*terms, strict=True))
        return (x, y, z)

    def switches(self, r: Vec3, p: Params) -> tuple[Expr, ...]:
        """Return the branch functions of all parts that have branches, at their places."""
        return tuple(
            switch
            for _, model, local, own in self._local(r, p)
            if isinstance(model, Piecewise)
            for switch in model.switches(local, own)
        )

    def _local(self, r: Vec3, p: Params) -> Iterator[tuple[_Part, GravityModel, Vec3, Params]]:
        """Yield each part with its model, the position in its frame and its own parameters."""
        for part in self._parts:
            model = cast(GravityModel, part.model)  # gravity_sum has seen to it
            shifted = [r[i] - part.position_m[i] for i in range(3)]
            x, y, z = matvec(part.rotation.tolist(), shifted)
            own = {q.name: p[f"{part.name}.{q.name}"] for q in model.parameters()}
            yield part, model, (x, y, z), own


class ArrayGravitySum(_Sum):
    """The same sum on arrays, where a part cannot be written as an expression.

    Parameters
    ----------
    parts : sequence
        Name, model, position, rotation and scale of each; made by `gravity_sum`.
    """

    def __init__(self, parts: Sequence[_Part]) -> None:
        super().__init__(parts)
        self._fields = [
            GravityField(part.model, [q.name for q in part.model.parameters()])
            for part in self._parts
        ]

    def acceleration_bound(self, distance: Expr, p: Params) -> Expr:
        """Return an upper bound of |∇U|, m/s²: the sum of those of the parts.

        Raises
        ------
        TypeError
            If a part has none.
        """
        terms = []
        for part in self._parts:
            own = {q.name: p[f"{part.name}.{q.name}"] for q in part.model.parameters()}
            # a point at `distance` is at least this far from the part's centre
            near = maximum(distance - float(np.linalg.norm(part.position_m)), 0.0)
            if isinstance(part.model, BoundedGravity):
                most = part.model.acceleration_bound(near, own)
            elif isinstance(part.model, PointMass):
                most = own["gm"] * power(near, -2.0)
            else:
                raise TypeError(f"part {part.name!r} of the gravity has no bound")
            terms.append(absolute(p[f"{part.name}.scale"]) * most)
        return sum_of(terms)

    def potential_array(self, r: Array, p: Array) -> Array:
        """Return +U, m²/s², shape (N,), at r (3, N), m, with parameters p (k, N)."""
        terms = [s * field.potential(x, own) for _, field, x, own, s in self._local(r, p)]
        return np.asarray(np.sum(terms, axis=0))

    def acceleration_array(self, r: Array, p: Array) -> Array:
        """Return ∇U, m/s², shape (3, N)."""
        terms = [
            s * (part.rotation.T @ field.acceleration(x, own))
            for part, field, x, own, s in self._local(r, p)
        ]
        return np.asarray(np.sum(terms, axis=0))

    def gradient_array(self, r: Array, p: Array) -> Array:
        """Return the gravity gradient, 1/s², shape (3, 3, N)."""
        terms = [
            s * np.einsum("ki,klN,lj->ijN", part.rotation, field.gradient(x, own), part.rotation)
            for part, field, x, own, s in self._local(r, p)
        ]
        return np.asarray(np.sum(terms, axis=0))

    def _local(
        self, r: Array, p: Array
    ) -> Iterator[tuple[_Part, GravityField, Array, Array, Array]]:
        """Yield each part with its field, positions in its frame, own parameters and scale."""
        row = 0
        for part, field in zip(self._parts, self._fields, strict=True):
            own = p[row : row + len(field.run_time)]
            row += len(field.run_time) + 1
            position = np.asarray(part.position_m)[:, None]
            yield part, field, part.rotation @ (r - position), own, p[row - 1]
