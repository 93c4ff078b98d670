"""Conversion between LFTs and the uncertain models that pass between stages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, cast

import numpy as np

from hillsphere_controllers.linear_fractional.left_out import without_cover
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty
from hillsphere_controllers.linear_products import UncertainModel

__all__ = ["remove_cover", "to_lft", "uncertain_model"]


def uncertain_model(lft: Lft, units: Mapping[str, str]) -> UncertainModel:
    """Convert an LFT to a product of a stage; `units` holds the unit of each parameter."""
    uncertainties = lft.uncertainties
    return UncertainModel(
        system=lft.system,
        names=tuple(u.name for u in uncertainties),
        units=tuple(units.get(u.name, "-") for u in uncertainties),
        kinds=tuple(u.kind for u in uncertainties),
        rows=np.array([u.rows for u in uncertainties], dtype=np.int64),
        columns=np.array([u.columns for u in uncertainties], dtype=np.int64),
        times=np.array(lft.times, dtype=np.int64),
        lower=np.array([u.lower for u in uncertainties], dtype=float),
        nominal=np.array([u.nominal for u in uncertainties], dtype=float),
        upper=np.array([u.upper for u in uncertainties], dtype=float),
        dynamic=np.array([u.dynamic for u in uncertainties], dtype=bool),
        covers=np.array([u.covers for u in uncertainties], dtype=bool),
    )


def to_lft(model: UncertainModel) -> Lft:
    """Return an uncertain model as an LFT.

    Raises
    ------
    InputError
        If sizes or bounds do not fit.
    """
    uncertainties = tuple(
        Uncertainty(
            name,
            cast(Literal["real", "complex", "full"], model.kinds[k]),
            int(model.rows[k]),
            int(model.columns[k]),
            float(model.lower[k]),
            float(model.nominal[k]),
            float(model.upper[k]),
            bool(model.dynamic[k]),
            bool(model.covers[k]),
        )
        for k, name in enumerate(model.names)
    )
    return Lft(model.system, uncertainties, tuple(int(t) for t in model.times))


def remove_cover(model: UncertainModel) -> UncertainModel:
    """Return an uncertain model without the blocks that cover what its approximation left out."""
    if not model.covers.any():
        return model
    return uncertain_model(
        without_cover(to_lft(model)), dict(zip(model.names, model.units, strict=True))
    )
