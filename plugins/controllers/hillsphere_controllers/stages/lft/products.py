"""Product of the stage ``lft``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array, Integers
from hillsphere.products.fields import Label, Shape
from hillsphere_controllers.linear_products import UncertainModels

__all__ = ["FittedModels"]


@dataclass(frozen=True)
class FittedModels(UncertainModels):
    """Uncertain models, and the errors of their fit to N linear models."""

    parameters: Annotated[tuple[str, ...], Shape("parameters")]
    """Names of the uncertain parameters."""
    exponents: tuple[Integers, ...]
    """Terms of each model's polynomial, (terms, parameters), in the order of their choice; none for
    affine fits, as are shares, errors and left_out_error."""
    shares: tuple[Array, ...]
    """What each term adds to the explained share of the sum of squares, one array per uncertain
    model."""
    errors: tuple[Array, ...]
    """Largest error of an entry relative to its range with the terms up to each, one array per
    uncertain model."""
    left_out_error: Array
    """Largest error at a sample of a fit to all others; infinite if the samples are just enough."""
    before: Annotated[Integers, Shape("uncertain_models", "parameters")]
    """Copies of each parameter before the reduction."""
    after: Annotated[Integers, Shape("uncertain_models", "parameters")]
    """Copies of each parameter after the reduction."""
    bound: Annotated[
        Array, Shape("uncertain_models"), Label("bound of it, relative to the change", 3)
    ]
    """Error of the reduction, relative to the largest change of the matrix [A B; C D]: a bound for
    all Δ."""
    sampled: Annotated[Array, Shape("uncertain_models"), Label("largest found of it, likewise", 3)]
    """The largest such error found at random."""
    dropped: Annotated[Array, Shape("uncertain_models"), Label("left out, as a share", 3)]
    """Of affine fits: root of the sum of squares of the directions left out, relative to
    `truncation_of`; zero for others."""
    truncation_of: str
    """``"change"``: relative to the same root of all directions; ``"nominal"``: to the nominal
    matrix on the rows and columns that change."""
    checks: Annotated[Integers, Shape("uncertain_models")]
    """Of affine fits: models beyond those that it takes to find the slopes; with none, nothing
    tells whether the matrices are affine. Zero for others."""
    group: Annotated[Integers, Shape("models")]
    """Which uncertain model stands for each of the models."""
    response_error: Annotated[Array, Shape("models")]
    """Largest singular value of the difference of the frequency responses, relative to the largest
    of the model; NaN if its parameters are beyond the bounds, and for affine fits, which meet the
    matrices of all models before anything is left out."""
    beyond: float
    """By how much the bounds reach beyond the models, relative to these models' range."""
    tolerance: float
    """Tolerance that was asked of the fit."""
    known: Annotated[tuple[str, ...], Shape("known")]
    """Names of the known parameters."""
    known_values: Annotated[Array, Shape("known", "uncertain_models")]
    """Their values, of each uncertain model."""
    size_sigmas: Annotated[Array, Shape("sizes")]
    """Standard deviations for which sizes were compared."""
    sizes: Annotated[Integers, Shape("sizes", "uncertain_models")]
    """Copies of all parameters together with bounds at so many."""
