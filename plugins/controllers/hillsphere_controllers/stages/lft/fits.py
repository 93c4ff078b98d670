"""Fits of linear models over their parameters: polynomial or affine, as uncertain models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array, Integers
from hillsphere.lti import LtiSystem
from hillsphere_controllers.linear_fractional.affine import affine_fit, affine_lft
from hillsphere_controllers.linear_fractional.algebra import state_space
from hillsphere_controllers.linear_fractional.fitting import PolynomialFit, fit_polynomial
from hillsphere_controllers.linear_fractional.left_out import cover_error, sample_weights
from hillsphere_controllers.linear_fractional.reduction import ReducedLft, reduce_lft
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty
from hillsphere_controllers.stages.lft.specs import LftSpec

__all__ = ["Fit", "certain_lft", "fit_by_affine", "fit_by_polynomials"]

_AFFINE = 1e-9
"""Error of an entry, relative to its range, up to which models are affine in their parameters."""
_EXACT = 1e-6
"""Error of an entry, relative to its range, up to which a fit by polynomials is not covered: that
of the default tolerance, far below what bounds of µ are known to."""


@dataclass(frozen=True)
class Fit:
    """One uncertain model and the cost of its reduction.

    Parameters
    ----------
    lft : Lft
        The model.
    polynomial : PolynomialFit or None
        The polynomial that it realises; None for an affine fit.
    before, after : ndarray of int, shape (k,)
        Copies of each parameter before and after the reduction.
    bound, sampled : float
        Error of the reduction, relative to the largest change of the matrix: proved, and found at
        random.
    dropped : float
        Of an affine fit, see `AffineLft.dropped`; else zero.
    checks : int
        Of an affine fit, see `AffineFit.checks`; else zero.
    sizes : ndarray of int, shape (s,)
        Copies of all parameters together with other bounds.
    """

    lft: Lft
    polynomial: PolynomialFit | None
    before: Integers
    after: Integers
    bound: float
    sampled: float
    dropped: float
    checks: int
    sizes: Integers


def certain_lft(system: LtiSystem) -> Fit:
    """Return a model without uncertain parameters."""
    none = np.zeros(0, dtype=np.int64)
    return Fit(Lft(system), None, none, none, 0.0, 0.0, 0.0, 0, none)


def fit_by_polynomials(
    points: Array, systems: Sequence[LtiSystem], parameters: Sequence[Uncertainty], spec: LftSpec
) -> Fit:
    """Fit polynomials to the models' matrices, and reduce the LFT.

    Parameters
    ----------
    points : ndarray, shape (k, N)
        Values of the parameters.
    systems : sequence of LtiSystem
        The models there.
    parameters : sequence of Uncertainty
        With their bounds.
    spec : LftSpec
        Degree and tolerances.

    Raises
    ------
    InputError
        If the models cannot be fitted so well.
    """
    samples = np.array([_matrix(one) for one in systems])
    fit = fit_polynomial(
        points, samples, parameters, degree=spec.degree, tolerance=spec.tolerance,
        most_terms=spec.most_terms,
    )  # fmt: skip
    lft = fit.lft()
    middle = fit(np.array([[u.nominal] for u in parameters]))[0]
    size = float(np.linalg.norm(samples - middle, 2, axis=(1, 2)).max())
    less: ReducedLft = reduce_lft(lft, spec.reduction * size)
    made = less.lft
    if fit.errors[-1] > _EXACT:
        made = cover_error(made, *sample_weights(samples - fit(points)), "misfit")
    return Fit(
        state_space(made, systems[0].order, systems[0].dt_s), fit, _copies(lft, parameters),
        _copies(less.lft, parameters), less.bound / size, less.sampled / size,
        0.0, 0, np.zeros(0, dtype=np.int64),
    )  # fmt: skip


def fit_by_affine(
    points: Array,
    systems: Sequence[LtiSystem],
    parameters: Sequence[Uncertainty],
    others: Sequence[Sequence[Uncertainty]],
    spec: LftSpec,
) -> Fit:
    """Fit an affine function to the models' matrices, and truncate weak directions.

    Parameters
    ----------
    points, systems, parameters, spec
        As for `fit_by_polynomials`.
    others : sequence of sequence of Uncertainty
        The same parameters with other bounds, for which sizes are wanted.

    Raises
    ------
    InputError
        If the models are not affine, or too few to tell.
    """
    middle = np.array([[u.nominal] for u in parameters])
    width = np.array([[u.upper - u.lower] for u in parameters])
    # the model nearest to nominal is the base of the slopes
    nearest = int(np.argmin((((points - middle) / width) ** 2).sum(axis=0)))
    order = [nearest, *(k for k in range(len(systems)) if k != nearest)]
    samples = np.array([_matrix(systems[k]) for k in order])
    fit, first = affine_fit(points[:, order], samples, tolerance=_AFFINE), systems[0]
    made, *compared = (
        affine_lft(fit, one, truncation=spec.truncation, truncation_of=spec.truncation_of)
        for one in (parameters, *others)
    )
    sizes = [int(one.after.sum()) for one in compared]
    return Fit(
        state_space(made.lft, first.order, first.dt_s), None, made.before, made.after, made.bound,
        made.sampled, made.dropped, fit.checks, np.array(sizes, dtype=np.int64),
    )  # fmt: skip


def _matrix(system: LtiSystem) -> Array:
    return np.block([[system.a, system.b], [system.c, system.d]])


def _copies(lft: Lft, parameters: Sequence[Uncertainty]) -> Integers:
    times = dict(zip((u.name for u in lft.uncertainties), lft.times, strict=True))
    return np.array([times.get(u.name, 0) for u in parameters], dtype=np.int64)
