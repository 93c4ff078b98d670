"""Built-in guidance plugin: reference trajectories and guidance laws."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "guidance",
            "minimum_energy",
            "hillsphere_guidance.minimum_energy:MinimumEnergy",
            "hillsphere_guidance.specs:MinimumEnergySpec",
            "path of the least integral of the squared command, a B-spline in the full field",
        ),
        Component(
            "guidance",
            "minimum_fuel",
            "hillsphere_guidance.minimum_fuel:MinimumFuel",
            "hillsphere_guidance.specs:MinimumFuelSpec",
            "flight of the least integral of the command's size, under held commands",
        ),
        Component(
            "guidance",
            "convex",
            "hillsphere_guidance.convex:ConvexDescent",
            "hillsphere_guidance.specs:ConvexSpec",
            "descent within bounds, glide slope and tilt, by successive convex programming",
        ),
        Component(
            "compensator",
            "zem_zev",
            "hillsphere_guidance.zem_zev:ZemZev",
            "hillsphere_guidance.law_specs:ZemZevSpec",
            "zero-effort-miss/zero-effort-velocity guidance to a state at a time",
        ),
        Component(
            "compensator",
            "open_loop",
            "hillsphere_guidance.open_loop:OpenLoop",
            "hillsphere_guidance.law_specs:OpenLoopSpec",
            "no command beyond that of the reference",
        ),
        Component(
            "stage",
            "reference_trajectories",
            "hillsphere_guidance.reference_trajectories.stage:ReferenceTrajectoriesStage",
            "hillsphere_guidance.reference_trajectories.specs:ReferenceTrajectoriesSpec",
            "descents planned by guidance, with a command held on a grid, and flown again",
        ),
        Component(
            "stage",
            "ephemeris_reference",
            "hillsphere_guidance.ephemeris_reference.stage:EphemerisReferenceStage",
            "hillsphere_guidance.ephemeris_reference.specs:EphemerisReferenceSpec",
            "trajectories of an ephemeris file (CCSDS OEM) in the frame of a plant",
        ),
    ]
