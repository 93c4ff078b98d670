r"""LFTs of matrices that are affine in real parameters, with truncation of weak directions.

.. math::

    P(p) = P(p_0) + \sum_k (p_k - p_{0k})\, P_k, \qquad P_k = \sum_i \sigma_{ki} u_{ki} v_{ki}^T

A parameter needs a copy for each singular direction of its P_k [1]_. The directions of all
parameters are pooled, each as large as its parameter may make it, and the smallest are dropped as
long as the root of the sum of their squares stays below a share of the same root of all of them,
the size of the change; or of the Frobenius norm of P(p₀), counted on those rows and columns only
that the parameters change, which may drop all of a small change of a large matrix. Each direction
that is left is one copy of its parameter, so that a parameter may keep some of its directions.

What is dropped is covered by a full block (`left_out`), so that the LFT contains the whole family.

References
----------
.. [1] B. G. Morton (1985), New applications of mu to real-parameter variation problems, Proceedings
   of the 24th IEEE Conference on Decision and Control, 233-238.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere_controllers.linear_fractional.left_out import (
    affine_weights,
    cover_error,
    without_cover,
)
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty
from hillsphere_controllers.systems.algebra import gain

__all__ = ["AffineFit", "AffineLft", "TruncationOf", "affine_fit", "affine_lft"]

TruncationOf = Literal["change", "nominal"]

_ROUNDING = 1e-14
"""What the differences of samples leave, relative to the matrices and to the largest change."""
_UNCHANGED = 1e-10
"""Changes of an entry, relative to the entry, that are not looked at: rounding."""
_SAMPLES = 500
"""Random corners at which the part left out is measured beside its bound; the bound itself does not
depend on them."""


@dataclass(frozen=True, eq=False)
class AffineFit:
    """Sampled matrices as P(p) = P₀ + Σ (pₖ − bₖ) Pₖ.

    Parameters
    ----------
    base : ndarray, shape (k,)
        b, in the units of the parameters.
    constant : ndarray, shape (p, m)
        P₀, the sample there.
    slopes : ndarray, shape (k, p, m)
        Pₖ, per unit of each parameter.
    error : float
        Largest error of an entry at the samples, relative to its range over them.
    checks : int
        Samples beyond those that it takes to find the slopes; with none, nothing tells whether the
        matrices are affine.
    """

    base: Array
    constant: Array
    slopes: Array
    error: float
    checks: int

    def __call__(self, points: Array) -> Array:
        """Return values (N, p, m) at parameters (k, N), in their units."""
        away = np.asarray(points, dtype=float) - self.base[:, None]
        return np.asarray(self.constant + np.tensordot(away.T, self.slopes, axes=1))


@dataclass(frozen=True, eq=False)
class AffineLft:
    """An affine matrix as an LFT, and the error of its truncation.

    Parameters
    ----------
    lft : Lft
        Without states; a parameter without copies does not stand in it. If anything is left out,
        its last block ``left_out`` covers that.
    before, after : ndarray of int, shape (k,)
        Copies of each parameter with all its directions, and left.
    dropped : float
        Root of the sum of squares of the directions left out, relative to that of all directions,
        or to the Frobenius norm of the nominal matrix on the rows and columns that change.
    bound, sampled : float
        Largest singular value of what is left out, relative to the largest of the change: a bound
        for all values of the parameters, and the largest at random corners of their bounds.
    """

    lft: Lft
    before: Integers
    after: Integers
    dropped: float
    bound: float
    sampled: float

    @property
    def truncated(self) -> Lft:
        """The LFT without the block that covers what is left out: not the whole family."""
        return without_cover(self.lft)


def affine_fit(points: Array, samples: Array, *, tolerance: float = 1e-9) -> AffineFit:
    """Fit an affine function to sampled matrices, and refuse if they are not affine.

    Parameters
    ----------
    points : ndarray, shape (k, N)
        Values of the parameters; the first is the base.
    samples : ndarray, shape (N, p, m)
        The matrices there.
    tolerance : float
        Largest error of an entry at a sample, relative to its range.

    Returns
    -------
    AffineFit
        The matrix as a function of the parameters.

    Raises
    ------
    InputError
        If shapes do not fit, there are too few samples, or they are not affine.
    """
    p, y = np.asarray(points, dtype=float), np.asarray(samples, dtype=float)
    if p.ndim != 2 or y.ndim != 3 or p.shape[1] != len(y) or not y.size:
        raise InputError(
            f"points (k, N) and samples (N, p, m) are needed, got {p.shape} and {y.shape}"
        )
    if not (np.isfinite(p).all() and np.isfinite(y).all()):
        raise InputError("points and samples must be finite")
    away, change = (p - p[:, :1]).T[1:], y[1:] - y[0]
    span = np.abs(away).max(axis=0, initial=0.0)
    scaled = away / np.where(span > 0.0, span, 1.0)
    if np.linalg.matrix_rank(scaled) < len(p):
        raise InputError(
            f"{len(y)} samples do not tell the effects of {len(p)} parameters apart; take one more "
            "sample than there are parameters, or more"
        )
    # slopes of all entries at once, by least squares over the samples
    coefficients = np.linalg.lstsq(scaled, change.reshape(len(change), -1), rcond=None)[0]
    rest = np.abs(change.reshape(len(change), -1) - scaled @ coefficients)
    wide = np.abs(change.reshape(len(change), -1)).max(axis=0, initial=0.0)
    size = np.abs(y).reshape(len(y), -1).max(axis=0)
    seen = wide > _UNCHANGED * size
    error = float((rest[:, seen] / wide[seen]).max(initial=0.0))
    if error > tolerance:
        raise InputError(
            f"the matrices are not affine in their parameters: one sample is {error:.3g} of its "
            f"range away, more than {tolerance:.3g}; fit polynomials instead"
        )
    slopes = coefficients.reshape(len(p), *y.shape[1:]) / span[:, None, None]
    return AffineFit(p[:, 0], y[0], slopes, error, len(y) - 1 - len(p))


def affine_lft(
    fit: AffineFit,
    uncertainties: Sequence[Uncertainty],
    *,
    truncation: float = 0.0,
    truncation_of: TruncationOf = "change",
    seed: int = 0,
) -> AffineLft:
    """Return an affine matrix as an LFT.

    Parameters
    ----------
    fit : AffineFit
        The matrix.
    uncertainties : sequence of Uncertainty
        Its k parameters with their bounds, in their order.
    truncation : float
        How much may be left out: root of the sum of squares of the directions dropped, as a share.
        0: only rounding.
    truncation_of : {"change", "nominal"}
        Of what it is the share: of the same root of all directions, the size of the change that the
        parameters make; or of the Frobenius norm of the nominal matrix on the rows and columns that
        change.
    seed : int
        Of the random corners that `AffineLft.sampled` is found at.

    Returns
    -------
    AffineLft
        The LFT, with a block that covers what is left out, and the errors of the truncation.

    Raises
    ------
    InputError
        If a parameter is not real, they are not as many as in the fit, the share is none from 0 to
        below 1, or it is one of something else.
    """
    if not 0.0 <= truncation < 1.0:
        raise InputError(f"truncation must be from 0 to below 1, got {truncation}")
    if truncation_of not in get_args(TruncationOf):
        raise InputError(
            f"truncation_of must be one of {', '.join(get_args(TruncationOf))}, got "
            f"{truncation_of!r}"
        )
    if len(uncertainties) != len(fit.base) or any(u.kind != "real" for u in uncertainties):
        raise InputError(
            f"{len(fit.base)} real parameters are needed, got "
            f"{', '.join(u.name for u in uncertainties) or 'none'}"
        )
    middle = fit(np.array([[u.nominal] for u in uncertainties]).reshape(-1, 1))[0]
    reach = np.array([max(u.upper - u.nominal, u.nominal - u.lower) for u in uncertainties])
    changes = np.abs(fit.slopes * reach[:, None, None]).max(axis=0, initial=0.0)
    changed = changes > _ROUNDING * np.maximum(np.abs(middle), changes.max(initial=0.0))
    rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
    # each slope times the largest distance of its parameter from nominal: the size of its effect
    moved = fit.slopes[:, rows[:, None], columns] * reach[:, None, None]
    left, values, right = np.linalg.svd(moved, full_matrices=False)
    nominal = float(np.linalg.norm(middle[np.ix_(rows, columns)]))
    largest = float(values.max(initial=0.0))
    there = values > _ROUNDING * (largest + nominal)
    size = nominal if truncation_of == "nominal" else float(np.sqrt((values[there] ** 2).sum()))
    kept = there & (values > _threshold(values[there], truncation * size))
    lost = there & ~kept
    left_out = left * np.where(lost, values, 0.0)[:, None] @ right
    bound, sampled = _error(moved, left_out, seed)
    made = _realise(middle, rows, columns, left, values, right, kept, uncertainties, reach)
    into, out = np.zeros((len(middle), 0)), np.zeros((0, middle.shape[1]))
    if lost.any():
        weight, other = affine_weights(left, values, right, lost)
        into, out = np.zeros((len(middle), weight.shape[1])), np.zeros((len(other), out.shape[1]))
        into[rows], out[:, columns] = weight, other
    return AffineLft(
        lft=cover_error(made, into, out),
        before=there.sum(axis=1),
        after=kept.sum(axis=1),
        dropped=float(np.sqrt((values[lost] ** 2).sum())) / size if lost.any() else 0.0,
        bound=bound,
        sampled=sampled,
    )


def _threshold(values: Array, allowed: float) -> float:
    """Return the largest value that may be dropped, the root sum of squares staying allowed."""
    ascending = np.sort(values)
    count = int(np.searchsorted(np.sqrt(np.cumsum(ascending**2)), allowed, side="right"))
    return float(ascending[count - 1]) if count else 0.0


def _realise(
    middle: Array,
    rows: Integers,
    columns: Integers,
    left: Array,
    values: Array,
    right: Array,
    kept: NDArray[np.bool_],
    uncertainties: Sequence[Uncertainty],
    reach: Array,
) -> Lft:
    (p, m), used, times = middle.shape, [], []
    into, out, curvature = [np.zeros((p, 0))], [np.zeros((0, m))], []
    for k, one in enumerate(uncertainties):
        here = kept[k]
        if not here.any():
            continue
        # p − p₀ = g δ/(1 + c δ)
        root = np.sqrt(values[k, here] * one.slope / reach[k])
        entering, seen = np.zeros((p, root.size)), np.zeros((root.size, m))
        entering[rows] = left[k][:, here] * root
        seen[:, columns] = root[:, None] * right[k][here]
        into.append(entering)
        out.append(seen)
        curvature += [one.curvature] * root.size
        used.append(one)
        times.append(int(root.size))
    matrix = np.block([[-np.diag(curvature), np.vstack(out)], [np.hstack(into), middle]])
    return Lft(gain(matrix), tuple(used), tuple(times))


def _error(moved: Array, left_out: Array, seed: int) -> tuple[float, float]:
    """Return a bound of the part left out and the largest found, relative to the largest change."""
    if not left_out.any():
        return 0.0, 0.0
    signs = np.random.default_rng(seed).choice([-1.0, 1.0], (_SAMPLES, len(moved)))
    sizes = np.linalg.norm(np.tensordot(signs, moved, axes=1), 2, axis=(1, 2))
    norms = np.linalg.norm(np.tensordot(signs, left_out, axes=1), 2, axis=(1, 2))
    bound = float(np.linalg.norm(left_out, 2, axis=(1, 2)).sum())
    largest = float(sizes.max())
    return bound / largest, float(norms.max()) / largest
