"""Conversion between LFTs and the uncertain models that pass between stages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, cast

import numpy as np

from hillsphere_controllers.lft.transformation import Lft
from hillsphere_controllers.lft.uncertainties import Uncertainty
from hillsphere_controllers.linear_products import UncertainModel

__all__ = ["to_lft", "uncertain_model"]


def uncertain_model(lft: Lft, units: Mapping[str, str]) -> UncertainModel:
    """Return an LFT as the product that passes between stages; units by name of a parameter."""
    found = lft.uncertainties
    return UncertainModel(
        system=lft.system,
        names=tuple(u.name for u in found),
        units=tuple(units.get(u.name, "-") for u in found),
        kinds=tuple(u.kind for u in found),
        rows=np.array([u.rows for u in found], dtype=np.int64),
        columns=np.array([u.columns for u in found], dtype=np.int64),
        times=np.array(lft.times, dtype=np.int64),
        lower=np.array([u.lower for u in found], dtype=float),
        nominal=np.array([u.nominal for u in found], dtype=float),
        upper=np.array([u.upper for u in found], dtype=float),
        dynamic=np.array([u.dynamic for u in found], dtype=bool),
    )


def to_lft(model: UncertainModel) -> Lft:
    """Return an uncertain model as an LFT.

    Raises
    ------
    InputError
        If sizes or bounds do not fit.
    """
    found = tuple(
        Uncertainty(
            name,
            cast(Literal["real", "complex", "full"], model.kinds[k]),
            int(model.rows[k]),
            int(model.columns[k]),
            float(model.lower[k]),
            float(model.nominal[k]),
            float(model.upper[k]),
            bool(model.dynamic[k]),
        )
        for k, name in enumerate(model.names)
    )
    return Lft(model.system, found, tuple(int(t) for t in model.times))
