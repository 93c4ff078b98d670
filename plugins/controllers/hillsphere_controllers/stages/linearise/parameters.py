"""Dispersed parameters of a plant, and the values at which models are made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Parameter, Plant
from hillsphere.spec import Ref
from hillsphere_controllers.uncertain import uncertain

__all__ = ["Dispersed", "dispersed_parameters", "parameter_samples"]


@dataclass(frozen=True)
class Dispersed:
    """The q parameters of a plant that are dispersed.

    Parameters
    ----------
    names : tuple of str
        As a mission calls them: ``"gravity.phobos.C2,1"``.
    own : tuple of str
        As the plant calls them: ``"gravity.C2,1"``.
    units : tuple of str
        SI.
    nominal, lower, upper : ndarray, shape (q,)
        Nominal values and bounds.
    covariance : ndarray, shape (q, q)
        Of their distribution.
    """

    names: tuple[str, ...]
    own: tuple[str, ...]
    units: tuple[str, ...]
    nominal: Array
    lower: Array
    upper: Array
    covariance: Array

    @property
    def sigma(self) -> Array:
        """Standard deviations (q,)."""
        return np.sqrt(np.diag(self.covariance))


@dataclass(frozen=True)
class _Offered:
    found: tuple[Parameter, ...]

    def parameters(self) -> tuple[Parameter, ...]:
        return self.found


def dispersed_parameters(
    plant: Plant, plant_name: str, dispersions: Sequence[Ref], sigmas: float
) -> Dispersed:
    """Return the parameters of a plant that dispersions vary.

    Parameters
    ----------
    plant : Plant
        Equations of motion, with the parameters of its models under their kind (``"gravity.gm"``).
    plant_name : str
        Its name in the mission.
    dispersions : sequence of Ref
        Of ``plant.NAME`` or of a model of the plant.
    sigmas : float
        How many standard deviations the bounds are away.

    Returns
    -------
    Dispersed
        In the order of the dispersions, without those that have no spread.

    Raises
    ------
    InputError
        If the plant has no such parameters, or two dispersions stand for one.
    """
    names: list[str] = []
    own: list[str] = []
    units: list[str] = []
    nominal: list[Array] = []
    lower: list[Array] = []
    upper: list[Array] = []
    blocks: list[Array] = []
    for ref in dispersions:
        dispersion = ref.get()
        kind, _, name = dispersion.of.partition(".")
        prefix = "" if kind == "plant" else f"{kind}."
        offered = tuple(
            Parameter(q.name.removeprefix(prefix), q.value, q.unit)
            for q in plant.parameters()
            if q.name.startswith(prefix)
        )
        if not offered or (kind == "plant" and plant_name not in (name, "(given)")):
            raise InputError(
                f"dispersions: {ref.name} is of {dispersion.of}, of which plant {plant_name!r} "
                "takes no parameter; name dispersions of the plant or of its models"
            )
        try:
            parameters = uncertain(_Offered(offered), dispersion, sigmas=sigmas)
        except InputError as error:
            raise InputError(f"dispersions: {ref.name}: {error}") from error
        here = [
            k for k, q in enumerate(parameters.names) if parameters.lower[k] < parameters.upper[k]
        ]
        names += [f"{dispersion.of}.{parameters.names[k]}" for k in here]
        own += [prefix + parameters.names[k] for k in here]
        units += [parameters.units[k] for k in here]
        nominal.append(parameters.nominal[here])
        lower.append(parameters.lower[here])
        upper.append(parameters.upper[here])
        blocks.append(parameters.covariance[np.ix_(here, here)])
    if twice := sorted({q for q in own if own.count(q) > 1}):
        raise InputError(f"dispersions: two of them vary {twice[0]}; leave it out of one")
    return Dispersed(
        tuple(names), tuple(own), tuple(units),
        _concatenate(nominal), _concatenate(lower), _concatenate(upper),
        np.asarray(block_diag(*blocks), dtype=float).reshape(len(own), len(own)),
    )  # fmt: skip


def parameter_samples(dispersed: Dispersed, pairs: int, random: np.random.Generator) -> Array:
    """Return values of the parameters at which models are made, beside the nominal ones.

    Parameters
    ----------
    dispersed : Dispersed
        The q parameters.
    pairs : int
        Of opposite corners.
    random : Generator
        Of the corners.

    Returns
    -------
    ndarray, shape (q, 2 q + 2 pairs)
        Each parameter at its upper bound and, after all of these, at its lower one; then corners.
    """
    count = len(dispersed.names)
    middle = dispersed.nominal[:, None]
    up, down = (np.repeat(middle, count, axis=1) for _ in range(2))
    np.fill_diagonal(up, dispersed.upper)
    np.fill_diagonal(down, dispersed.lower)
    high = random.integers(2, size=(count, pairs)).astype(bool)
    corners = np.concatenate([high, ~high], axis=1)
    ends = np.where(corners, dispersed.upper[:, None], dispersed.lower[:, None])
    return np.concatenate([up, down, ends], axis=1)


def _concatenate(parts: Sequence[Array]) -> Array:
    return np.concatenate([np.zeros(0), *parts])
