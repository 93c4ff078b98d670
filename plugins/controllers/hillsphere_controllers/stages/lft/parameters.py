"""Selection of the uncertain parameters of linear models, their bounds, and the known ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.base.matching import match_names
from hillsphere.base.problems import did_you_mean
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Dispersion, Integers, Parameter
from hillsphere_controllers.linear_fractional.uncertainties import (
    Uncertainty,
    bound_dispersion,
    real_parameter,
)
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.stages.lft.specs import LftSpec

__all__ = ["Groups", "excess_of_bounds", "group_models", "uncertain_parameters"]

_BEYOND = 1e-9
"""Relative excess of a bound over the models' range that is rounding of the bound's own
computation."""


@dataclass(frozen=True)
class _Parameters:
    """Parameters of linear models, for dispersions."""

    found: tuple[Parameter, ...]

    def parameters(self) -> tuple[Parameter, ...]:
        """Return them."""
        return self.found


@dataclass(frozen=True)
class Groups:
    """Groups of models with equal values of their known parameters.

    Parameters
    ----------
    members : tuple of ndarray of int
        The models of each of the G groups.
    labels : tuple of str
        Name of each group.
    group : ndarray of int, shape (N,)
        Of each model.
    values : ndarray, shape (j, G)
        Of the known parameters.
    """

    members: tuple[Integers, ...]
    labels: tuple[str, ...]
    group: Integers
    values: Array


def group_models(models: LinearModels, known: Sequence[str]) -> Groups:
    """Group models by the values of their known parameters."""
    rows = [models.parameters.index(name) for name in known]
    count = len(models.systems)
    if not rows:
        all_models = np.arange(count, dtype=np.int64)
        return Groups((all_models,), ("uncertain",), np.zeros_like(all_models), np.zeros((0, 1)))
    points, group = np.unique(models.values[rows], axis=1, return_inverse=True)
    group = np.asarray(group, dtype=np.int64).ravel()
    labels = tuple(
        ", ".join(f"{models.parameters[r]}={v:.6g}" for r, v in zip(rows, point, strict=True))
        for point in points.T
    )
    members = tuple(np.flatnonzero(group == g) for g in range(points.shape[1]))
    return Groups(members, labels, group, points)


def uncertain_parameters(
    models: LinearModels, spec: LftSpec, sigmas: float | None = None
) -> tuple[Uncertainty, ...]:
    """Return the uncertain parameters with their bounds, in the order of the models.

    Parameters
    ----------
    models : LinearModels
        Whose parameters they are.
    spec : LftSpec
        Bounds, dispersions, what is known.
    sigmas : float, optional
        Instead of the Spec's number of standard deviations.

    Raises
    ------
    InputError
        If a name is unknown, or a parameter with bounds has one value in all models.
    """
    for key, names in (
        ("bounds", [bound.parameter for bound in spec.bounds]),
        ("known", list(spec.known)),
    ):
        for name in names:
            if name not in models.parameters:
                raise InputError(
                    f"{key}: the models have no parameter {name!r}"
                    f"{did_you_mean(name, models.parameters, otherwise='there are')}"
                )
    reach = spec.sigmas if sigmas is None else sigmas
    bounded = {
        u.name: u
        for ref in spec.dispersions
        for u in _bound_dispersion(models, ref.get(), reach, f"dispersions: {ref.name}")
    }
    for bound in spec.bounds:
        bounded[bound.parameter] = real_parameter(
            bound.parameter, bound.lower, bound.upper, bound.nominal
        )
    parameters = []
    for k, name in enumerate(models.parameters):
        low, high = float(models.values[k].min()), float(models.values[k].max())
        if name in spec.known or (low == high and name not in bounded):
            continue
        if low == high:
            raise InputError(
                f"{name} has bounds, but all models have the same value of it, {low:.6g}; make "
                "models at several values"
            )
        nominal = float(models.nominal[k])
        inside = low < nominal < high
        parameters.append(
            bounded.get(name) or real_parameter(name, low, high, nominal if inside else None)
        )
    return tuple(parameters)


def excess_of_bounds(models: LinearModels, parameters: Sequence[Uncertainty]) -> float:
    """Return the largest excess of bounds over the models' range, relative to that range."""
    most = 0.0
    for one in parameters:
        values = models.values[models.parameters.index(one.name)]
        low, high = float(values.min()), float(values.max())
        most = max(most, (low - one.lower) / (high - low), (one.upper - high) / (high - low))
    return most if most > _BEYOND else 0.0


def _bound_dispersion(
    models: LinearModels, dispersion: Dispersion, sigmas: float, where: str
) -> tuple[Uncertainty, ...]:
    """Return the models' parameters that a dispersion varies, with its bounds.

    Models of a stage that linearises name parameters as a mission does, ``"gravity.phobos.C2,0"``:
    the dispersion's own table selects them. Other models have plain names.
    """
    prefix = f"{dispersion.of}."
    own = prefix if any(name.startswith(prefix) for name in models.parameters) else ""
    offered = tuple(
        Parameter(name.removeprefix(own), float(value), unit)
        for name, value, unit in zip(models.parameters, models.nominal, models.units, strict=True)
        if name.startswith(own)
    )
    try:
        match_names(dispersion.keys, [one.name for one in offered], dispersion.of)
    except InputError as error:
        raise InputError(
            f"{where}: among the parameters of the models {error}. A parameter without spread "
            "(sigma 0, or relative to a nominal 0) is certain and no parameter of models: give it "
            "a spread, or leave it out of the dispersion"
        ) from error
    parameters = bound_dispersion(_Parameters(offered), dispersion, sigmas=sigmas)
    return tuple(real_parameter(f"{own}{u.name}", u.lower, u.upper, u.nominal) for u in parameters)
