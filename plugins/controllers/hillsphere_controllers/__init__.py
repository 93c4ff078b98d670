"""Built-in controllers plugin: laws that command a thruster, sampled or continuous."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "compensator",
            "pid",
            "hillsphere_controllers.pid:Pid",
            "hillsphere_controllers.specs:PidSpec",
            "proportional, integral and derivative action on each axis, held between samples",
        ),
        Component(
            "compensator",
            "state_space",
            "hillsphere_controllers.state_space:state_space",
            "hillsphere_controllers.specs:StateSpaceSpec",
            "linear compensator by its matrices: discrete, discretised, or with continuous states",
        ),
        Component(
            "compensator",
            "impulsive",
            "hillsphere_controllers.impulsive:Impulsive",
            "hillsphere_controllers.specs:ImpulsiveSpec",
            "linear feedback as impulses, with dead band and maximum",
        ),
    ]
