"""Discovery of plugins and the registry of the components that they offer.

The public names are those of `hillsphere.plugins.registry` and `hillsphere.plugins.plugin_files`,
which are imported when one of them is used, so that other modules of this package load without
them.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hillsphere.plugins.plugin_files import PluginFile, add_plugin_file
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
    "PluginFile",
    "Registered",
    "Registry",
    "add_plugin_file",
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
        module = "plugin_files" if name in ("PluginFile", "add_plugin_file") else "registry"
        return getattr(import_module(f"hillsphere.plugins.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
