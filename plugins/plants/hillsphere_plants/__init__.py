"""Built-in plants plugin: equations of motion near small bodies and about the Earth."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "plant",
            "hill",
            "hillsphere_plants.hill:hill",
            "hillsphere_plants.specs:HillSpec",
            "circular Hill problem about a moon, with any gravity model",
        ),
        Component(
            "plant",
            "three_body",
            "hillsphere_plants.factory:three_body",
            "hillsphere_plants.specs:ThreeBodySpec",
            "three-body problem about a moon or an asteroid, with any gravity model",
        ),
        Component(
            "plant",
            "earth_orbit",
            "hillsphere_plants.earth_orbit:EarthOrbit",
            "hillsphere_plants.earth_orbit_specs:EarthOrbitSpec",
            "flight about the turning Earth in an inertial frame, with any gravity model and drag",
        ),
        Component(
            "plant",
            "proximity",
            "hillsphere_plants.proximity_arrays:proximity",
            "hillsphere_plants.proximity_specs:ProximitySpec",
            "spacecraft near a spinning asteroid, in the Hill frame of its elliptic orbit",
        ),
        Component(
            "plant",
            "heliocentric",
            "hillsphere_plants.heliocentric:Heliocentric",
            "hillsphere_plants.proximity_specs:HeliocentricSpec",
            "an asteroid and spacecraft far from it, around the Sun",
        ),
        Component(
            "stage",
            "equilibria",
            "hillsphere_plants.equilibria.stage:EquilibriaStage",
            "hillsphere_plants.equilibria.specs:EquilibriaSpec",
            "libration points in the true gravity of a body, and the motion about them",
        ),
        Component(
            "stage",
            "formation_reference",
            "hillsphere_plants.formation_reference.stage:FormationReferenceStage",
            "hillsphere_plants.proximity_specs:FormationReferenceSpec",
            "reference trajectories of a formation, by differences of orbital elements",
        ),
    ]
