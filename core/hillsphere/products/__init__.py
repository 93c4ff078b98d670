"""Products, which stages pass to each other, and their files.

The public names are those of `hillsphere.products.products`, which is imported when one of them is
used, so that other modules of this package load without it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hillsphere.products.products import (
        Bifurcations,
        CaseList,
        CaseTable,
        ControlDesign,
        FlightSet,
        Flown,
        OrbitSet,
        PeriodicOrbits,
        Trajectories,
        load_product,
        save_product,
    )

__all__ = [
    "Bifurcations",
    "CaseList",
    "CaseTable",
    "ControlDesign",
    "FlightSet",
    "Flown",
    "OrbitSet",
    "PeriodicOrbits",
    "Trajectories",
    "load_product",
    "save_product",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("hillsphere.products.products"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
