"""Built-in view plugin: the command ``view``, a page of runs on this machine (extra ``web``)."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return [
        Component(
            "command",
            "view",
            "hillsphere_view.view_command:app",
            "",
            "Show, compare and start runs on a page that this machine serves to you.",
        ),
    ]
