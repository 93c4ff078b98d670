"""Discovery of plugins and the registry of the components that they offer.

The public names are those of `hillsphere.plugins.registry`, which is imported when one of them is
used, so that other modules of this package load without it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hillsphere.plugins.registry import (
        API_VERSION,
        ENTRY_POINT_GROUP,
        KINDS,
        Component,
        Registered,
        Registry,
        create,
        default_registry,
        discover,
        hookimpl,
        hookspec,
        kind_words,
        load_object,
        validate,
    )

__all__ = [
    "API_VERSION",
    "ENTRY_POINT_GROUP",
    "KINDS",
    "Component",
    "Registered",
    "Registry",
    "create",
    "default_registry",
    "discover",
    "hookimpl",
    "hookspec",
    "kind_words",
    "load_object",
    "validate",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("hillsphere.plugins.registry"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
