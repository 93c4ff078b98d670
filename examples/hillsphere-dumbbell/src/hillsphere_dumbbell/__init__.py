"""A dumbbell-shaped moon, zero-velocity maps and a limb sensor, as a plugin for Hillsphere."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            kind="gravity",
            type="dumbbell",
            target="hillsphere_dumbbell.dumbbell:Dumbbell",
            spec="hillsphere_dumbbell.specs:DumbbellSpec",
            summary="two spheres joined by a homogeneous rod",
        ),
        Component(
            kind="stage",
            type="zero_velocity",
            target="hillsphere_dumbbell.zero_velocity:ZeroVelocityStage",
            spec="hillsphere_dumbbell.specs:ZeroVelocitySpec",
            summary="zero-velocity curves and equilibrium points of a plant",
        ),
        Component(
            kind="sensor",
            type="limb_ranger",
            target="hillsphere_dumbbell.limb_ranger:LimbRanger",
            spec="hillsphere_dumbbell.specs:LimbRangerSpec",
            summary="apparent size of a warm, round body, which tells the distance",
        ),
    ]
