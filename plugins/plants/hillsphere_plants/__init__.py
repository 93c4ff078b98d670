"""Built-in plants plugin: equations of motion near small bodies."""

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
            "hillsphere_plants.three_body:three_body",
            "hillsphere_plants.specs:ThreeBodySpec",
            "circular or elliptic three-body problem about a moon, with any gravity model",
        ),
    ]
