"""Dispersions as means, covariances and bounds of a model's parameters, for filters and LFTs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.matching import match_names
from hillsphere.errors import InputError
from hillsphere.interfaces.dispersion import Dispersion
from hillsphere.interfaces.quantities import Parameter

__all__ = ["Parametric", "Uncertain", "uncertain"]


class Parametric(Protocol):
    """A component with run-time parameters: gravity model, plant."""

    def parameters(self) -> Sequence[Parameter]:
        """Return them with nominal values, SI."""
        ...


@dataclass(frozen=True)
class Uncertain:
    """Uncertain parameters of a model: means, covariance and bounds.

    Parameters
    ----------
    names, units : tuple of str
        Of the k parameters.
    nominal, mean : ndarray, shape (k,)
        SI.
    covariance : ndarray, shape (k, k)
        About the mean, SI.
    lower, upper : ndarray, shape (k,)
        Bounds at so many standard deviations, within what is possible, SI.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    nominal: Array
    mean: Array
    covariance: Array
    lower: Array
    upper: Array


def uncertain(model: Parametric, dispersion: Dispersion, *, sigmas: float = 3.0) -> Uncertain:
    """Return the parameters that a dispersion varies, with mean, covariance and bounds.

    Parameters
    ----------
    model : Parametric
        Component that the dispersion's key `of` names; the caller ensures this.
    dispersion : Dispersion
        The distribution.
    sigmas : float
        How many standard deviations the bounds are away.

    Returns
    -------
    Uncertain
        In the order in which the dispersion finds them.

    Raises
    ------
    InputError
        If the model has no such parameter or it has another unit.
    """
    offered = {parameter.name: parameter for parameter in model.parameters()}
    names = match_names(dispersion.keys, list(offered), dispersion.of)
    chosen = [offered[name] for name in names]
    for parameter in chosen:
        if dispersion.unit and parameter.unit != dispersion.unit:
            raise InputError(
                f"the dispersion's numbers stand for {dispersion.unit}, but {parameter.name} is in "
                f"{parameter.unit}"
            )
    nominal = np.array([parameter.value for parameter in chosen])
    lower, upper = dispersion.bounds(nominal, sigmas)
    return Uncertain(
        names=names,
        units=tuple(parameter.unit for parameter in chosen),
        nominal=nominal,
        mean=dispersion.mean(nominal),
        covariance=dispersion.covariance(nominal),
        lower=lower,
        upper=upper,
    )
