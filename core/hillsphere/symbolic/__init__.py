"""Symbolic expressions for the equations of models, and a cache of their compiled functions.

The public names are those of `hillsphere.symbolic.expressions`, which is imported when one of them
is used, so that other modules of this package load without it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hillsphere.symbolic.expressions import (
        Expr,
        Overloaded,
        Params,
        Scalar,
        Vec3,
        absolute,
        acos,
        asin,
        atan2,
        constant,
        cos,
        cross,
        dot,
        eccentric_anomaly,
        exp,
        gradient,
        greater,
        is_zero,
        jacobian,
        kepler,
        less,
        log,
        matvec,
        maximum,
        minimum,
        norm,
        number_in,
        parameter,
        parameter_names,
        pi,
        power,
        product,
        select,
        sgp4,
        sin,
        spherical_harmonics_potential,
        sqrt,
        substitute,
        sum_of,
        tan,
        time,
        variable,
        variable_names,
        variables,
    )

__all__ = [
    "Expr",
    "Overloaded",
    "Params",
    "Scalar",
    "Vec3",
    "absolute",
    "acos",
    "asin",
    "atan2",
    "constant",
    "cos",
    "cross",
    "dot",
    "eccentric_anomaly",
    "exp",
    "gradient",
    "greater",
    "is_zero",
    "jacobian",
    "kepler",
    "less",
    "log",
    "matvec",
    "maximum",
    "minimum",
    "norm",
    "number_in",
    "parameter",
    "parameter_names",
    "pi",
    "power",
    "product",
    "select",
    "sgp4",
    "sin",
    "spherical_harmonics_potential",
    "sqrt",
    "substitute",
    "sum_of",
    "tan",
    "time",
    "variable",
    "variable_names",
    "variables",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("hillsphere.symbolic.expressions"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
