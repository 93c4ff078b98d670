"""A homogeneous body bounded by a mesh: mass, surface, and checks of its unit of length."""

from __future__ import annotations

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.shapes.mesh import Mesh
from hillsphere.model.shapes.polyhedron import MeshSurface
from hillsphere_gravity.ellipsoid import CODATA_2018_G

__all__ = ["MeshBody"]

_PLAUSIBLE_KG_M3 = (100.0, 9000.0)
"""Densities that a body may have: comets and the lightest moons of Saturn have 200 to 600 kg/m³,
iron 7900. A length unit that is wrong by a factor of 1000 changes the density by 1e9."""
_PLAUSIBLE_M = (20.0, 3e6)
"""Largest radii that a body may have whose density alone is given: the smallest bodies with a shape
from a spacecraft's images reach to 80 m, the largest moons to 2600 km. Kilometres that are read as
metres make boulders of all bodies up to 20 km, metres read as kilometres planets of those from
3 km on."""


class MeshBody:
    """Mass and surface of a homogeneous body of a mesh.

    Parameters
    ----------
    mesh : Mesh
        The surface.
    density_kg_m3, gm_m3_s2 : float or None
        One of them.
    gravitational_constant : float or None
        G that goes with the density, m³/(kg s²); the CODATA value if None.

    Raises
    ------
    InputError
        If GM and volume give no density that matter has, or a density is given and the size is
        that of no body.
    """

    def __init__(
        self,
        mesh: Mesh,
        density_kg_m3: float | None,
        gm_m3_s2: float | None,
        gravitational_constant: float | None,
    ) -> None:
        self.mesh = mesh
        self.strength_per_density = gravitational_constant or CODATA_2018_G
        if density_kg_m3 is not None:
            _check_size(mesh, density_kg_m3 * self.strength_per_density * mesh.volume_m3)
            self.gm_m3_s2 = density_kg_m3 * self.strength_per_density * mesh.volume_m3
        else:
            self.gm_m3_s2 = gm_m3_s2 or 0.0
            _check_density(self.gm_m3_s2, mesh.volume_m3)
        self._surface = MeshSurface(mesh)

    def describe(self) -> tuple[str, ...]:
        """Return GM and density in words."""
        density = self.gm_m3_s2 / (CODATA_2018_G * self.mesh.volume_m3)
        return (f"GM {self.gm_m3_s2 / 1e9:.6g} km³/s², density {density / 1e3:.4g} g/cm³",)

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


def _check_density(gm_m3_s2: float, volume_m3: float) -> None:
    density = gm_m3_s2 / (CODATA_2018_G * volume_m3)
    least, most = _PLAUSIBLE_KG_M3
    if not least <= density <= most:
        raise InputError(
            f"GM and the volume of {volume_m3:.4g} m³ give a density of {density:.3g} kg/m³, "
            f"which no body has; {_suggest_unit(density)}check gm and the length_unit of "
            "the shape"
        )


def _check_size(mesh: Mesh, gm_m3_s2: float) -> None:
    """Refuse a body of a size that a wrong unit makes; with GM its density shows that."""
    least, most = _PLAUSIBLE_M
    radius = mesh.largest_radius_m
    if least <= radius <= most:
        return
    small = radius < least
    likely = radius * (1e3 if small else 1e-3)
    unit, given, size = ("km", "m", "boulder") if small else ("m", "km", "planet")
    shown, meant = (f"{q:.4g} m" if q < 1e3 else f"{q / 1e3:.4g} km" for q in (radius, likely))
    raise InputError(
        f"the shape reaches to {shown} from its origin, as a {size} does; its vertices are likely "
        f"in {unit} instead of {given}, which would be {meant}: check the length_unit of the "
        "shape. "
        f"If the body is of this size, give gm_m3_s2 = {gm_m3_s2:.6g} instead of its density"
    )


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
