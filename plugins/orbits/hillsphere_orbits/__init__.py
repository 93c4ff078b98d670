"""Built-in orbits plugin: families of periodic orbits, their stability and bifurcations.

Tools for any plant: `continuation` (Newton and pseudo-arclength), `shooting` (the equations of a
periodic orbit), `stability`, `members` (orbits at prescribed values). On them stand the
quasi-satellite orbits: `families`, and the stages ``qso_family`` and ``bifurcations``.
"""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "orbit_family",
            "qso",
            "hillsphere_orbits.families:Qso",
            "hillsphere_orbits.specs:QsoSpec",
            "quasi-satellite orbits from the far 2:1 ellipse to the body's surface",
        ),
        Component(
            "stage",
            "qso_family",
            "hillsphere_orbits.qso_family:QsoFamilyStage",
            "hillsphere_orbits.specs:QsoFamilySpec",
            "the family of quasi-satellite orbits and its members at prescribed values",
        ),
        Component(
            "stage",
            "bifurcations",
            "hillsphere_orbits.bifurcation:BifurcationStage",
            "hillsphere_orbits.specs:BifurcationSpec",
            "where other families branch off a family of planar orbits",
        ),
        Component(
            "stage",
            "spatial_qso_families",
            "hillsphere_orbits.spatial_stage:SpatialFamiliesStage",
            "hillsphere_orbits.spatial_specs:SpatialFamiliesSpec",
            "families in space from vertical bifurcations: members, multipliers, windows",
        ),
        Component(
            "stage",
            "station_keeping_index",
            "hillsphere_orbits.station_keeping:StationKeepingStage",
            "hillsphere_orbits.spatial_specs:StationKeepingSpec",
            "analytic cost of nulling the unstable component once per period",
        ),
    ]
