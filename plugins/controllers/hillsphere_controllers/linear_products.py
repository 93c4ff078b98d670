"""Products of the stages of linear control: linear models and uncertain models.

Frozen dataclasses as those of `hillsphere.products`, where `ControlDesign` is what a synthesis
makes of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.lti import LtiSystem
from hillsphere.products.fields import Label, Shape

__all__ = ["LinearModels", "UncertainModel", "UncertainModels"]


@dataclass(frozen=True)
class LinearModels:
    """Linear models of one plant at N values of its parameters, for synthesis and LFTs.

    A stage that linearises yields this class or one that derives from it.
    """

    systems: Annotated[tuple[LtiSystem, ...], Shape("models")]
    """Generalised plants of one size and order: their last inputs are the controls, their last
    outputs the measurements, the others what disturbs and what is to be small. Their states are the
    same throughout."""
    labels: Annotated[tuple[str, ...], Shape("models"), Label("model")]
    """Name of each model."""
    parameters: Annotated[tuple[str, ...], Shape("parameters")]
    """The parameters that differ; none for a single model."""
    units: Annotated[tuple[str, ...], Shape("parameters")]
    """Units of the parameters."""
    values: Annotated[Array, Shape("parameters", "models")]
    """Values of the parameters, in their units."""
    nominal: Annotated[Array, Shape("parameters")]
    """Nominal values of the parameters."""
    controls: int
    """Number of the controls; zero if nothing closes a loop."""
    measurements: int
    """Number of the measurements; likewise."""
    weights: tuple[LtiSystem, ...]
    """Square systems at the models' ends whose outputs, by name, are outputs of the models: what
    they weight is shown by itself. None if nothing is known of them."""


@dataclass(frozen=True)
class UncertainModel:
    """A system M whose first outputs and inputs are closed by a normalised uncertainty Δ."""

    system: LtiSystem
    """M; the copies of one uncertainty stand together, in the order below."""
    names: Annotated[tuple[str, ...], Shape("uncertainties")]
    """Names of the uncertainties."""
    units: Annotated[tuple[str, ...], Shape("uncertainties")]
    """Units of the uncertainties."""
    kinds: Annotated[tuple[str, ...], Shape("uncertainties")]
    """``"real"`` for a real parameter, ``"complex"`` for a complex number, ``"full"`` for a
    matrix."""
    rows: Annotated[Integers, Shape("uncertainties")]
    """Rows of one block, which enter M."""
    columns: Annotated[Integers, Shape("uncertainties")]
    """Columns of one block."""
    times: Annotated[Integers, Shape("uncertainties")]
    """Number of copies of the block."""
    lower: Annotated[Array, Shape("uncertainties")]
    """Value of a real parameter, in its unit, at Δ = −1; −1 of other uncertainties."""
    nominal: Annotated[Array, Shape("uncertainties")]
    """Value at Δ = 0; 0 of other uncertainties."""
    upper: Annotated[Array, Shape("uncertainties")]
    """Value at Δ = 1; 1 of other uncertainties."""
    dynamic: Annotated[NDArray[np.bool_], Shape("uncertainties")]
    """Whether it may be the response of any stable system."""
    covers: Annotated[NDArray[np.bool_], Shape("uncertainties")]
    """Whether it covers what the approximation of the model left out."""


@dataclass(frozen=True)
class UncertainModels:
    """Uncertain models of one plant, for the analysis of its robustness."""

    models: Annotated[tuple[UncertainModel, ...], Shape("uncertain_models")]
    """Generalised plants: their last inputs are the controls, their last outputs the
    measurements."""
    labels: Annotated[tuple[str, ...], Shape("uncertain_models"), Label("uncertain model")]
    """Name of each uncertain model."""
    controls: int
    """Number of the controls; zero if the loops are closed."""
    measurements: int
    """Number of the measurements; likewise."""
