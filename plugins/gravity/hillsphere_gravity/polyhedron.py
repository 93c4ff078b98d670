"""Gravity of a homogeneous polyhedron."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array, Parameter
from hillsphere.model.shapes.mesh import Mesh
from hillsphere.model.shapes.triangulation import Radial, triangulate
from hillsphere.symbolic import Expr, Params
from hillsphere_gravity.ellipsoid import homogeneous_bound
from hillsphere_gravity.mesh_body import MeshBody
from hillsphere_gravity.polyhedron_sums import PolyhedronSums
from hillsphere_gravity.polyhedron_tree import PolyhedronTree
from hillsphere_gravity.quadrupole import Quadrupole
from hillsphere_gravity.specs import PolyhedronSpec

__all__ = ["Polyhedron", "mesh_of"]

_FAR = 1000.0
"""Distance, in radii of the body, beyond which its second moments replace the sums: these have lost
six digits there."""


class Polyhedron(MeshBody):
    r"""A homogeneous polyhedron, exact inside, on and outside its surface.

    With the vectors r_e and r_f from the point to any point of an edge or a face, a, b the
    distances of an edge's ends and e its length, n the outward normal of a face, n_A the normal
    of an edge in the plane of its face A, away from it, and ω the solid angle of a face [1]_,

    .. math::

        U = \tfrac12 G\rho\Big[\sum_e r_e\cdot E_e r_e L_e - \sum_f r_f\cdot F_f r_f\omega_f\Big],
        \quad
        \nabla U = -G\rho\Big[\sum_e E_e r_e L_e - \sum_f F_f r_f\omega_f\Big],

    .. math::

        \nabla\nabla U = G\rho\Big[\sum_e E_e L_e - \sum_f F_f\omega_f\Big], \quad
        \nabla^2 U = -G\rho\sum_f\omega_f,

    where E = n n_A + n' n'_B (of both faces), F = n n and L = ln((a+b+e)/(a+b−e)).

    Parameters
    ----------
    spec : PolyhedronSpec
        Its shape and mass. Run-time parameter: ``density`` or ``gm``, whichever the spec gives.

    Raises
    ------
    InputError
        If the shape is no polyhedron and is not to be triangulated, or GM and volume give no
        density that matter has.

    Notes
    -----
    Each point costs about 25 ns for each face from 64 points on, potential, acceleration and
    gradient together (measured on one processor with AVX-512; others take longer), single
    points several times that for small meshes. A series takes nanoseconds as a whole: see
    `hillsphere_gravity.shape_harmonics` for flights outside the body.
    The terms cancel far out, in the acceleration by
    the square of the distance in radii: from 1000 radii on, where it is good to 1e-8, mass, centre
    and second moments of the body serve instead. On an edge the gradient is infinite.

    With ``relative_error``, clusters of faces are replaced by series wherever these are proven to
    be accurate enough (`hillsphere_gravity.polyhedron_tree`), inside the body too; near faces are
    summed as before. The acceleration is the exact derivative of the potential but where a point
    passes from one set of clusters to another: there both jump, by twice the bound at most. From
    afar no moments are needed.

    References
    ----------
    .. [1] R. A. Werner, D. J. Scheeres (1997), Exterior gravitation of a polyhedron derived and
       compared with harmonic and mascon gravitation representations of asteroid 4769 Castalia,
       Celestial Mechanics and Dynamical Astronomy 65(3), 313-344.
    """

    frame = "body"

    def __init__(self, spec: PolyhedronSpec) -> None:
        super().__init__(
            mesh_of(spec.shape.get(), spec.subdivisions),
            spec.density_kg_m3,
            spec.gm_m3_s2,
            spec.gravitational_constant,
        )
        if spec.density_kg_m3 is not None:
            self._parameter = Parameter("density", spec.density_kg_m3, "kg/m3", positive=True)
            self._per_unit = self.strength_per_density
        else:
            self._parameter = Parameter("gm", self.gm_m3_s2, "m3/s2", positive=True)
            self._per_unit = 1.0 / self.mesh.volume_m3
        self.gm_m3_s2 = self._per_unit * self._parameter.value * self.mesh.volume_m3
        self.relative_error = spec.relative_error

    def parameters(self) -> tuple[Parameter, ...]:
        """Return ``density`` or ``gm``."""
        return (self._parameter,)

    def acceleration_bound(self, distance: Expr, p: Params) -> Expr:
        """Return an upper bound of |∇U|, m/s², see `hillsphere_gravity.ellipsoid`."""
        gm = p[self._parameter.name] * (self._per_unit * self.mesh.volume_m3)
        radius = (0.75 * self.mesh.volume_m3 / np.pi) ** (1.0 / 3.0)
        bound = homogeneous_bound(distance, gm, float(radius), self.mesh.largest_radius_m)
        # GM/s², of which a part may be added, is below each of the two bounds
        return bound if self.relative_error is None else bound * (1.0 + self.relative_error)

    def potential_array(self, r: Array, p: Array) -> Array:
        """Return +U, m²/s², shape (N,), at r (3, N), m, with parameters p (1, N)."""
        return np.asarray(self._strength(p) * self._at(r, "potential", 1)[0])

    def acceleration_array(self, r: Array, p: Array) -> Array:
        """Return ∇U, m/s², shape (3, N)."""
        return np.asarray(self._strength(p) * self._at(r, "acceleration", 3))

    def gradient_array(self, r: Array, p: Array) -> Array:
        """Return ∇∇U, 1/s², shape (3, 3, N)."""
        return np.asarray(self._strength(p) * self._at(r, "gradient", 9).reshape(3, 3, -1))

    def laplacian_array(self, r: Array, p: Array) -> Array:
        """Return ∇²U, 1/s², shape (N,): −4πGρ inside, 0 outside; on the surface either."""
        values = np.zeros(r.shape[1])
        near = ~self._away(r)
        values[near] = self._sums(r[:, near]).laplacian()
        return np.asarray(self._strength(p) * values)

    def _strength(self, p: Array) -> Array:
        """Return Gρ (N,), 1/s²."""
        return np.asarray(self._per_unit * p[0])

    def describe(self) -> tuple[str, ...]:
        """Return GM and density in words, and the error that is allowed."""
        if self.relative_error is None:
            return super().describe()
        return (
            *super().describe(),
            f"clusters of faces as series, with errors of at most {self.relative_error:.1e} of "
            "GM/s, GM/s² and GM/s³ (s: distance, at least that of the farthest vertex), but for "
            "rounding",
        )

    def _away(self, r: Array) -> NDArray[np.bool_]:
        """Return which of the points (N,) are so far that moments replace the sums."""
        if self.relative_error is not None:
            return np.zeros(r.shape[1], dtype=np.bool_)
        return np.asarray(np.sum(r * r, axis=0) > (_FAR * self.largest_radius_m) ** 2)

    def _at(self, r: Array, quantity: str, rows: int) -> Array:
        """Return a quantity (rows, N) for Gρ = 1."""
        away = self._away(r)
        if not away.any():
            near: Array = getattr(self._sums(r), quantity)()
            return near.reshape(rows, -1)
        values = np.empty((rows, r.shape[1]))
        far: Array = getattr(self._far, quantity)(np.ascontiguousarray(r[:, away]))
        values[:, away] = far.reshape(rows, -1)
        if not away.all():
            values[:, ~away] = self._at(r[:, ~away], quantity, rows)
        return values

    @cached_property
    def _sums(self) -> PolyhedronSums | PolyhedronTree:
        if self.relative_error is not None:
            return PolyhedronTree(self.mesh, self.relative_error)
        return PolyhedronSums(self.mesh)

    @cached_property
    def _far(self) -> GravityField:
        return GravityField(Quadrupole(self.mesh))


def mesh_of(shape: object, subdivisions: int | None) -> Mesh:
    """Return the mesh of a shape, or the shape triangulated.

    Parameters
    ----------
    shape : object
        A shape of a mission.
    subdivisions : int or None
        How often each face of an icosahedron is divided into four.

    Returns
    -------
    Mesh
        Its surface.

    Raises
    ------
    InputError
        If a polyhedron is to be triangulated, or another shape is not.
    """
    mesh: object = getattr(shape, "mesh", None)
    if isinstance(mesh, Mesh):
        if subdivisions is not None:
            raise InputError("subdivisions: the shape is a polyhedron already; leave it out")
        return mesh
    if subdivisions is None or not isinstance(shape, Radial):
        raise InputError(
            f"the shape is no polyhedron but a {type(shape).__name__}; give subdivisions, by "
            "which it is triangulated"
        )
    return triangulate(shape, subdivisions)
