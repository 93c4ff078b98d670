"""Product of the stage ``lft``."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array, Integers
from hillsphere_controllers.linear_products import UncertainModels

__all__ = ["FittedModels"]


@dataclass(frozen=True)
class FittedModels(UncertainModels):
    """Uncertain models, and the errors of their fit to N linear models.

    Parameters
    ----------
    parameters : tuple of str
        The uncertain parameters, k.
    exponents : tuple of ndarray of int, shape (T, k)
        Terms of each model's polynomial, in the order of their choice; none for affine fits, as are
        shares, errors and left_out_error.
    shares, errors : tuple of ndarray, shape (T,)
        What each term adds to the explained share of the sum of squares, and the largest error of
        an entry relative to its range with the terms up to each.
    left_out_error : ndarray, shape (G,)
        Largest error at a sample of a fit to all others; infinite if the samples are just enough.
    before, after : ndarray of int, shape (G, k)
        Copies of each parameter before and after the reduction.
    bound, sampled : ndarray, shape (G,)
        What the reduction costs, relative to the largest change of the matrix [A B; C D]: a bound
        for all Δ, and the largest found at random.
    dropped : ndarray, shape (G,)
        Of affine fits: root of the sum of squares of the directions left out, relative to the
        nominal matrix on the rows and columns that change; zero for others.
    checks : ndarray of int, shape (G,)
        Of affine fits: models beyond those that it takes to find the slopes; with none, nothing
        tells whether the matrices are affine. Zero for others.
    group : ndarray of int, shape (N,)
        Which uncertain model stands for each of the models.
    response_error : ndarray, shape (N,)
        Largest singular value of the difference of the frequency responses, relative to the
        largest of the model; NaN if its parameters are beyond the bounds, and for affine fits,
        which meet the matrices of all models before anything is left out.
    beyond : float
        By how much the bounds reach beyond the models, relative to these models' range.
    tolerance : float
        Tolerance that was asked of the fit.
    known : tuple of str
        The j known parameters.
    known_values : ndarray, shape (j, G)
        Their values, of each uncertain model.
    size_sigmas : ndarray, shape (s,)
        Standard deviations for which sizes were compared.
    sizes : ndarray of int, shape (s, G)
        Copies of all parameters together with bounds at so many.
    """

    parameters: tuple[str, ...]
    exponents: tuple[Integers, ...]
    shares: tuple[Array, ...]
    errors: tuple[Array, ...]
    left_out_error: Array
    before: Integers
    after: Integers
    bound: Array
    sampled: Array
    dropped: Array
    checks: Integers
    group: Integers
    response_error: Array
    beyond: float
    tolerance: float
    known: tuple[str, ...]
    known_values: Array
    size_sigmas: Array
    sizes: Integers
