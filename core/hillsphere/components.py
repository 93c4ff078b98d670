"""The components that the core itself brings, registered like those of any plugin."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the core's components."""
    return [
        Component(
            "body",
            "moon",
            "hillsphere.bodies:Moon",
            "hillsphere.bodies:MoonSpec",
            "a small moon on a Keplerian orbit around its primary",
        ),
    ]
