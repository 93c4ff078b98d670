"""Built-in flight plugin: the stage ``closed_loop``, a plant under a law."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "stage",
            "closed_loop",
            "hillsphere_flight.closed_loop:ClosedLoopStage",
            "hillsphere_flight.specs:ClosedLoopSpec",
            "a plant under a law that follows a reference; can be repeated by campaigns",
        ),
    ]
