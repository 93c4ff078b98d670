"""Gravity of a homogeneous polyhedron."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array, Parameter
from hillsphere.model.shapes.mesh import Mesh
from hillsphere.model.shapes.polyhedron import MeshSurface
from hillsphere.model.shapes.triangulation import Radial, triangulate
from hillsphere.symbolic import Expr, Params
from hillsphere_gravity.ellipsoid import CODATA_2018_G, homogeneous_bound
from hillsphere_gravity.polyhedron_sums import PolyhedronSums
from hillsphere_gravity.quadrupole import Quadrupole
from hillsphere_gravity.specs import PolyhedronSpec

__all__ = ["Polyhedron"]

_FAR = 1000.0
"""Distance, in radii of the body, beyond which its second moments replace the sums: these have lost
six digits there."""
_PLAUSIBLE_KG_M3 = (100.0, 9000.0)
"""Densities that a body may have: comets and the lightest moons of Saturn have 200 to 600 kg/m³,
iron 7900. A length unit that is wrong by a factor of 1000 changes the density by 1e9."""


class Polyhedron:
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
    Each point costs about 0.1 µs for each face, acceleration or gradient: 0.5 ms for 5000 faces,
    where a degree-4 series takes 4 ns as a whole. The terms cancel far out, in the acceleration by
    the square of the distance in radii: from 1000 radii on, where it is good to 1e-8, mass, centre
    and second moments of the body serve instead. On an edge the gradient is infinite.

    References
    ----------
    .. [1] R. A. Werner, D. J. Scheeres (1997), Exterior gravitation of a polyhedron derived and
       compared with harmonic and mascon gravitation representations of asteroid 4769 Castalia,
       Celestial Mechanics and Dynamical Astronomy 65(3), 313-344.
    """

    frame = "body"

    def __init__(self, spec: PolyhedronSpec) -> None:
        self.mesh = _mesh(spec)
        volume = self.mesh.volume_m3
        constant_g = spec.gravitational_constant or CODATA_2018_G
        if spec.density_kg_m3 is not None:
            self._parameter = Parameter("density", spec.density_kg_m3, "kg/m3", positive=True)
            self._per_unit = constant_g
        else:
            gm = spec.gm_m3_s2 or 0.0
            self._parameter = Parameter("gm", gm, "m3/s2", positive=True)
            self._per_unit = 1.0 / volume
            density = gm / (CODATA_2018_G * volume)
            least, most = _PLAUSIBLE_KG_M3
            if not least <= density <= most:
                raise InputError(
                    f"GM and the volume of {volume:.4g} m³ give a density of {density:.3g} kg/m³, "
                    f"which no body has; {_suggest_unit(density)}check gm and the length_unit of "
                    "the shape"
                )
        self.gm_m3_s2 = self._per_unit * self._parameter.value * volume
        self._surface = MeshSurface(self.mesh)

    def describe(self) -> tuple[str, ...]:
        """Return GM and density in words."""
        density = self.gm_m3_s2 / (CODATA_2018_G * self.mesh.volume_m3)
        return (f"GM {self.gm_m3_s2 / 1e9:.6g} km³/s², density {density / 1e3:.4g} g/cm³",)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return ``density`` or ``gm``."""
        return (self._parameter,)

    def semi_axes_m(self) -> tuple[float, float, float]:
        """Return half the extents along x, y, z of a box about the centre, m."""
        return self._surface.semi_axes_m()

    @property
    def largest_radius_m(self) -> float:
        """Distance of the farthest vertex, m."""
        return self.mesh.largest_radius_m

    def surface_array(self, r: Array) -> Array:
        """Return the surface function (N,), see `MeshSurface`."""
        return self._surface.surface_array(r)

    def normal_array(self, r: Array) -> Array:
        """Return the outward normals (3, N) where the rays through r (3, N) meet the surface."""
        return self._surface.normal_array(r)

    @property
    def steepest_per_m(self) -> float:
        """Lipschitz constant of the surface function, 1/m."""
        return self._surface.steepest_per_m

    def acceleration_bound(self, distance: Expr, p: Params) -> Expr:
        """Return an upper bound of |∇U|, m/s², see `hillsphere_gravity.ellipsoid`."""
        gm = p[self._parameter.name] * (self._per_unit * self.mesh.volume_m3)
        radius = (0.75 * self.mesh.volume_m3 / np.pi) ** (1.0 / 3.0)
        return homogeneous_bound(distance, gm, float(radius), self.mesh.largest_radius_m)

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

    def _away(self, r: Array) -> NDArray[np.bool_]:
        """Return which of the points (N,) are so far that moments replace the sums."""
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
    def _sums(self) -> PolyhedronSums:
        return PolyhedronSums(self.mesh)

    @cached_property
    def _far(self) -> GravityField:
        return GravityField(Quadrupole(self.mesh))


def _suggest_unit(density: float) -> str:
    """Return which unit is likely wrong, by the density that results; nothing is changed by it."""
    least, most = _PLAUSIBLE_KG_M3
    # volume goes with the cube of the length, and so does GM between m³/s² and km³/s²
    for factor, unit, given in ((1e-9, "km", "m"), (1e9, "m", "km")):
        if least <= density * factor <= most:
            return (
                f"vertices in {unit} instead of {given} (or GM in {given}³/s² instead of "
                f"{unit}³/s²) would give {density * factor:.3g} kg/m³; "
            )
    return ""


def _mesh(spec: PolyhedronSpec) -> Mesh:
    shape: object = spec.shape.get()
    mesh: object = getattr(shape, "mesh", None)
    if isinstance(mesh, Mesh):
        if spec.subdivisions is not None:
            raise InputError("subdivisions: the shape is a polyhedron already; leave it out")
        return mesh
    if spec.subdivisions is None or not isinstance(shape, Radial):
        raise InputError(
            f"the shape is no polyhedron but a {type(shape).__name__}; give subdivisions, by "
            "which it is triangulated"
        )
    return triangulate(shape, spec.subdivisions)
