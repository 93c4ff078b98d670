"""Declaration of a component's parameters: Specs, their fields, units and type annotations.

The public names are those of `hillsphere.spec.base`, which is imported when one of them is used, so
that other modules of this package load without it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hillsphere.spec.base import (
        UNITS,
        DataPath,
        Pair,
        Ref,
        ResultNames,
        Spec,
        StageSpec,
        Vector3,
        data_path,
        need,
        option,
        quantity,
        reference,
        repeated,
        rule,
        table_name,
        unit_keys,
    )

__all__ = [
    "UNITS",
    "DataPath",
    "Pair",
    "Ref",
    "ResultNames",
    "Spec",
    "StageSpec",
    "Vector3",
    "data_path",
    "need",
    "option",
    "quantity",
    "reference",
    "repeated",
    "rule",
    "table_name",
    "unit_keys",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("hillsphere.spec.base"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
