"""Built-in estimators plugin: filters, smoothers and what they are judged by."""

from __future__ import annotations

from hillsphere.plugins import Component, hookimpl


@hookimpl
def hillsphere_components() -> list[Component]:
    """Return the components of this package."""
    return []
