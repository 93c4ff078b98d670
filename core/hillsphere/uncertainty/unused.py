"""Check of a dispersion that no campaign uses against the quantities of its table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.base.errors import InputError
from hillsphere.base.matching import match_names
from hillsphere.interfaces.dispersion import Dispersion
from hillsphere.interfaces.quantities import Parameter

__all__ = ["check_dispersion"]


def check_dispersion(dispersion: Dispersion, offered: Sequence[Parameter]) -> None:
    """Check names, unit and sizes of a dispersion.

    Parameters
    ----------
    dispersion : Dispersion
        The distribution.
    offered : sequence of Parameter
        The quantities of the table to which it applies.

    Raises
    ------
    InputError
        If a name matches no quantity, a quantity has another unit, or sizes or correlations are
        given for another number of quantities than the names match.
    """
    by_name = {parameter.name: parameter for parameter in offered}
    names = match_names(dispersion.keys, list(by_name), dispersion.of)
    for name in names:
        if dispersion.unit and by_name[name].unit != dispersion.unit:
            raise InputError(
                f"its numbers are in {dispersion.unit}, but {name} is in {by_name[name].unit}; "
                "give another unit, or leave it out for SI"
            )
    nominal = np.array([by_name[name].value for name in names])
    dispersion.quantiles(np.full((len(names), 1), 0.5), nominal)
