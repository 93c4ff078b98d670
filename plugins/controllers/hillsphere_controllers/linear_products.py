"""Products of the stages of linear control: linear models and uncertain models.

Frozen dataclasses as those of `hillsphere.products`, where `ControlDesign` is what a synthesis
makes of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.lti import LtiSystem

__all__ = ["LinearModels", "UncertainModel", "UncertainModels"]


@dataclass(frozen=True)
class LinearModels:
    """Linear models of one plant at N values of its parameters, for synthesis and LFTs.

    A stage that linearises yields this class or one that derives from it.

    Parameters
    ----------
    systems : tuple of LtiSystem
        Generalised plants of one size and order: their last inputs are the controls, their last
        outputs the measurements, the others what disturbs and what is to be small. Their states
        are the same throughout.
    labels : tuple of str
        Name of each.
    parameters, units : tuple of str
        The k parameters that differ; none for a single model.
    values : ndarray, shape (k, N)
        Their values, in their units.
    nominal : ndarray, shape (k,)
        Their nominal values.
    controls, measurements : int
        Numbers of the controls and of the measurements; both zero if nothing closes a loop.
    weights : tuple of LtiSystem
        Square systems at the models' ends whose outputs, by name, are outputs of the models: what
        they weight is shown by itself. None if nothing is known of them.
    """

    systems: tuple[LtiSystem, ...]
    labels: tuple[str, ...]
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    nominal: Array
    controls: int
    measurements: int
    weights: tuple[LtiSystem, ...]


@dataclass(frozen=True)
class UncertainModel:
    """A system M whose first outputs and inputs are closed by a normalised uncertainty Δ.

    Parameters
    ----------
    system : LtiSystem
        M; the copies of one uncertainty stand together, in the order below.
    names, units : tuple of str
        Of the k uncertainties.
    kinds : tuple of str
        ``"real"`` for a real parameter, ``"complex"`` for a complex number, ``"full"`` for a
        matrix.
    rows, columns, times : ndarray of int, shape (k,)
        Size of one block, whose rows enter M, and number of its copies.
    lower, nominal, upper : ndarray, shape (k,)
        Of real parameters, in their units: Δ = −1, 0, 1. Of the others −1, 0, 1.
    dynamic : ndarray of bool, shape (k,)
        Whether it may be the response of any stable system.
    """

    system: LtiSystem
    names: tuple[str, ...]
    units: tuple[str, ...]
    kinds: tuple[str, ...]
    rows: Integers
    columns: Integers
    times: Integers
    lower: Array
    nominal: Array
    upper: Array
    dynamic: NDArray[np.bool_]


@dataclass(frozen=True)
class UncertainModels:
    """Uncertain models of one plant, for the analysis of its robustness.

    Parameters
    ----------
    models : tuple of UncertainModel
        Generalised plants: their last inputs are the controls, their last outputs the measurements.
    labels : tuple of str
        Name of each.
    controls, measurements : int
        Numbers of the controls and of the measurements; both zero if the loops are closed.
    """

    models: tuple[UncertainModel, ...]
    labels: tuple[str, ...]
    controls: int
    measurements: int
