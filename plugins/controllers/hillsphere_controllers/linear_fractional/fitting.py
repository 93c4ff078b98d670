r"""Polynomials fitted to sampled matrices, term by term.

One set of monomials serves all entries, so that the LFT made of the fit stays small. Terms are
chosen by orthogonal least squares [1]_: of those left, the one comes next whose part orthogonal to
those chosen explains the largest share of the samples' sum of squares.

References
----------
.. [1] S. Chen, S. A. Billings, W. Luo (1989), Orthogonal least squares methods and their
   application to non-linear system identification, International Journal of Control 50(5),
   1873-1896.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.linear_fractional.polynomials import (
    Terms,
    evaluate_polynomial,
    scaled_polynomial,
)
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty

__all__ = ["PolynomialFit", "fit_polynomial"]

_DEPENDENT = 1e-10
"""A monomial of unit length counts as dependent on the chosen ones if less than this remains beside
them; its coefficient would amplify rounding by the inverse."""


@dataclass(frozen=True, eq=False)
class PolynomialFit:
    """A polynomial of q = (p − p₀)/g fitted to sampled matrices.

    Parameters
    ----------
    uncertainties : tuple of Uncertainty
        The parameters p, with p₀ and g.
    terms : mapping of tuple of int to ndarray
        Exponents of the q → coefficients (p, m), in the order of their choice.
    shares : tuple of float
        Influence of each term: what it adds to the explained share of the weighted sum of squares
        about zero, one in all for an exact fit.
    errors : tuple of float
        Largest weighted error at the samples with the terms up to each.
    left_out_error : float
        Largest weighted error at a sample of a fit to all others: far above the last of `errors`
        where there are too many terms for the samples.
    """

    uncertainties: tuple[Uncertainty, ...]
    terms: Terms
    shares: tuple[float, ...]
    errors: tuple[float, ...]
    left_out_error: float

    @property
    def error(self) -> float:
        """Largest weighted error at the samples."""
        return self.errors[-1]

    def __call__(self, points: Array) -> Array:
        """Return the polynomial's values (N, p, m) at parameters (k, N), in their units."""
        return evaluate_polynomial(
            self.terms, _normalise_points(np.asarray(points, dtype=float), self.uncertainties)
        )

    def lft(self) -> Lft:
        """Return the polynomial as an LFT."""
        return scaled_polynomial(self.terms, self.uncertainties)


def fit_polynomial(
    points: Array,
    samples: Array,
    uncertainties: Sequence[Uncertainty],
    *,
    degree: int = 3,
    tolerance: float = 1e-3,
    most_terms: int | None = None,
    weights: Array | None = None,
) -> PolynomialFit:
    """Fit a polynomial to matrices sampled over parameters.

    Parameters
    ----------
    points : ndarray, shape (k, N)
        Values of the parameters, in their units.
    samples : ndarray, shape (N, p, m)
        The matrices there.
    uncertainties : sequence of Uncertainty
        The k parameters, real.
    degree : int
        Largest sum of exponents of a term.
    tolerance : float
        Weighted error at which no more terms are added.
    most_terms : int, optional
        How many terms suffice, whatever the error; as many as there are if left out.
    weights : ndarray, shape (p, m), optional
        By which errors of the entries are multiplied; left out: one over the range of the samples
        of each, zero for those that are the same in all samples.

    Returns
    -------
    PolynomialFit
        The constant term is always there.

    Raises
    ------
    InputError
        If shapes do not fit, samples are too few, complex or not finite, or all terms leave an
        error above the tolerance.
    """
    if np.iscomplexobj(points) or np.iscomplexobj(samples):
        raise InputError("points and samples must be real, got complex numbers")
    p, y = np.asarray(points, dtype=float), np.asarray(samples, dtype=float)
    count = len(uncertainties)
    if p.ndim != 2 or len(p) != count or y.ndim != 3 or p.shape[1] != len(y) or not y.size:
        raise InputError(
            f"points ({count}, N) and samples (N, p, m) are needed, got {p.shape} and {y.shape}"
        )
    if any(u.kind != "real" for u in uncertainties):
        raise InputError("a polynomial is one of real parameters")
    if not (np.isfinite(p).all() and np.isfinite(y).all()):
        raise InputError("points and samples must be finite")
    if degree < 0 or (most_terms is not None and most_terms < 1):
        raise InputError(f"degree ≥ 0, most_terms ≥ 1 are needed, got {degree} and {most_terms}")
    weight = _weights(y) if weights is None else np.asarray(weights, dtype=float)
    if weight.shape != y.shape[1:]:
        raise InputError(f"weights must have the shape {y.shape[1:]}, got {weight.shape}")
    q = _normalise_points(p, uncertainties)
    exponents = [
        tuple(factors.count(v) for v in range(count))
        for size in range(degree + 1)
        for factors in combinations_with_replacement(range(count), size)
    ]
    monomials = np.array([np.prod(q ** np.array(e)[:, None], axis=0) for e in exponents]).T
    target = (y * weight).reshape(len(y), -1)
    limit = min(len(exponents), len(y), most_terms or len(exponents))
    chosen, shares, errors, basis = _select_terms(monomials, target, limit, tolerance)
    if errors[-1] > tolerance and len(chosen) < (most_terms or np.inf):
        raise InputError(
            f"{len(chosen)} terms of a degree up to {degree} leave an error of {errors[-1]:.3g}, "
            f"more than {tolerance:.3g}; raise the degree, take more samples or allow more"
        )
    coefficients = np.linalg.lstsq(monomials[:, chosen], y.reshape(len(y), -1), rcond=None)[0]
    # rounding in entries that never change would look like copies
    same = ~_varying_entries(y).ravel()
    coefficients[:, same] = 0.0
    coefficients[chosen.index(0), same] = y[0].ravel()[same]
    terms = {
        exponents[t]: row.reshape(y.shape[1:]) for t, row in zip(chosen, coefficients, strict=True)
    }
    rest = target - basis @ (basis.T @ target)
    leverage = np.sum(basis**2, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        # leave-one-out residual of a linear fit, rest/(1 − leverage), without fitting again
        without = np.abs(rest) / (1.0 - leverage)[:, None]
    alone = leverage > 1.0 - 1e-9  # a sample that fixes a term by itself tells nothing about it
    return PolynomialFit(
        tuple(uncertainties), terms, tuple(shares), tuple(errors),
        float(np.where(alone[:, None], np.inf, without).max()),
    )  # fmt: skip


def _select_terms(
    monomials: Array, target: Array, limit: int, tolerance: float
) -> tuple[list[int], list[float], list[float], Array]:
    """Return terms, their shares, errors up to each, and an orthonormal basis (N, T) of them."""
    lengths = np.linalg.norm(monomials, axis=0)
    left = monomials / np.where(lengths > 0.0, lengths, 1.0)
    rest = target.copy()
    total = float(np.sum(target**2))
    basis = np.zeros((len(target), 0))
    chosen: list[int] = []
    shares: list[float] = []
    errors: list[float] = []
    while len(chosen) < limit:
        sizes = np.linalg.norm(left, axis=0)
        free = sizes > _DEPENDENT
        free[chosen] = False
        if not free.any():
            break
        explained = np.zeros(len(sizes))
        # error reduction of each candidate: the squared projection on its part orthogonal to the
        # chosen
        explained[free] = np.sum((left[:, free].T @ rest) ** 2, axis=1) / sizes[free] ** 2
        best = int(np.argmax(np.where(free, explained, -1.0))) if chosen else 0
        column = left[:, best] / sizes[best]
        # once more against the basis (Gram-Schmidt twice), so that it stays orthogonal to rounding
        column = column - basis @ (basis.T @ column)
        column /= np.linalg.norm(column)
        before = float(np.sum(rest**2))
        basis = np.hstack([basis, column[:, None]])
        rest = rest - np.outer(column, column @ rest)
        left = left - np.outer(column, column @ left)
        chosen.append(best)
        shares.append((before - float(np.sum(rest**2))) / total if total > 0.0 else 0.0)
        errors.append(float(np.abs(rest).max()))
        if errors[-1] <= tolerance:
            break
    return chosen, shares, errors, basis


def _normalise_points(points: Array, uncertainties: Sequence[Uncertainty]) -> Array:
    nominal = np.array([u.nominal for u in uncertainties])[:, None]
    return np.asarray((points - nominal) / np.array([u.slope for u in uncertainties])[:, None])


def _weights(samples: Array) -> Array:
    spread, there = np.ptp(samples, axis=0), _varying_entries(samples)
    return np.asarray(np.where(there, 1.0 / np.where(there, spread, 1.0), 0.0))


def _varying_entries(samples: Array) -> NDArray[np.bool_]:
    """Return which entries (p, m) differ between samples by more than rounding."""
    return np.asarray(np.ptp(samples, axis=0) > 1e-14 * np.abs(samples).max(axis=0))
