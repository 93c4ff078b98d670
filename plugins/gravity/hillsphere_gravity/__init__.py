"""Built-in gravity: point mass, ellipsoid, polyhedron, spherical harmonics, and sums of models.

Read in this order to write a plugin of your own: this module tells the framework what the package
brings, `specs` declares the parameters of each model, and one module per model holds its equations,
written once as expressions; values on arrays, gradients and run-time parameters follow from them.
"""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


def _gravity(type_: str, target: str, spec: str, summary: str) -> Component:
    return Component(
        "gravity",
        type_,
        f"hillsphere_gravity.{target}",
        f"hillsphere_gravity.specs:{spec}",
        summary,
    )


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        _gravity("point_mass", "point_mass:PointMass", "PointMassSpec", "a point mass"),
        _gravity(
            "ellipsoid",
            "ellipsoid:Ellipsoid",
            "EllipsoidSpec",
            "a homogeneous tri-axial ellipsoid, exact inside and outside",
        ),
        _gravity(
            "harmonics",
            "harmonics:Harmonics",
            "HarmonicsSpec",
            "a spherical-harmonic series from a table or a file (ICGEM, PDS SHADR, .cof)",
        ),
        _gravity(
            "polyhedron",
            "polyhedron:Polyhedron",
            "PolyhedronSpec",
            "a homogeneous body of any shape, exact for a mesh of triangles inside and outside",
        ),
        _gravity(
            "shape_harmonics",
            "shape_harmonics:ShapeHarmonics",
            "ShapeHarmonicsSpec",
            "the series of a homogeneous body of any shape, for orbits outside a sphere about it",
        ),
        _gravity(
            "sum", "composite:gravity_sum", "SumSpec", "a sum of models, each placed and turned"
        ),
        Component(
            "command",
            "gravity",
            "hillsphere_gravity.command:app",
            "",
            "show potential and acceleration of a gravity file at given places",
        ),
        Component(
            "format",
            "icgem",
            "hillsphere_gravity.field_formats:Icgem",
            "hillsphere.formats.specs:FileFormatSpec",
            "a gravity field of ICGEM (.gfc)",
        ),
        Component(
            "format",
            "shadr",
            "hillsphere_gravity.field_formats:Shadr",
            "hillsphere.formats.specs:FileFormatSpec",
            "a gravity field of the Planetary Data System (.shadr, .sha, .tab)",
        ),
    ]
