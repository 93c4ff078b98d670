r"""Kalman update of a Gaussian estimate with one measurement of two angles, N cases at once.

With the prior covariance P, the measurement matrix H, the innovation ν and the noise covariance R
of a measurement on the sky,

.. math::

    S = H P H^T + R, \quad K = P H^T S^{-1}, \quad δ = K ν, \quad
    P^+ = (1 - K H) P (1 - K H)^T + K R K^T,

the last equation in Joseph's form [1]_, which stays positive definite even if K is not exact. A
measurement with w = ν·S⁻¹ν / gate² > 1 is an outlier: R is increased by w − 1 times the diagonal of
S. S then grows by about w, and the outlier lies at the gate. Its weight decreases with its
distance, whether the measurement or the prior dominates S.

References
----------
.. [1] Bierman, G. J. (1977), Factorization Methods for Discrete Sequential Estimation, Academic
   Press, section II.6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hillsphere import symbolic as sy
from hillsphere.dynamics import ArrayFunction
from hillsphere.interfaces import Array
from hillsphere.symbolic import Expr

__all__ = ["Correction", "correct_estimate", "correction_of", "packing_of", "select_correction"]


@dataclass(frozen=True, eq=False)
class Correction:
    """Update of m estimated quantities by one measurement, for one linearisation.

    Parameters
    ----------
    step : ndarray, shape (m, N)
        Correction δ of the prior estimate.
    weight : ndarray, shape (N,)
        Factor by which the diagonal of S has grown: above 1 for outliers.
    shift : ndarray, shape (N,)
        Change of the predicted direction, rad, from the point of linearisation to the result.
    covariance : ndarray, shape (m, m, N)
        Covariance P⁺ after the measurement.
    """

    step: Array
    weight: Array
    shift: Array
    covariance: Array


def correct_estimate(
    prior: Array,
    slopes: Array,
    off: Array,
    variances: Array,
    gate: float,
    known: tuple[Array, Array] | None = None,
) -> Correction:
    """Correct an estimate by a measurement (see the module's equations).

    Parameters
    ----------
    prior : ndarray, shape (m, m, N)
        Covariance P before the measurement.
    slopes : ndarray, shape (2, m, N)
        Measurement matrix H: derivatives of the measured angles on the sky by the quantities.
    off : ndarray, shape (2, N)
        −ν: predicted minus measured angles at the point of linearisation, rad.
    variances : ndarray, shape (2, N)
        Diagonal of R, rad².
    gate : float
        Number of standard deviations beyond which a measurement is an outlier.
    known : tuple of ndarray, optional
        For a linearisation at another point than the prior estimate: the step (m, N) from the
        prior to that point, and the weight (N,) of the first linearisation.

    Returns
    -------
    Correction
        Corrections of all cases.
    """
    m, cases = slopes.shape[1:]
    function, (upper, full) = _compile_correction(m), packing_of(m)
    n = upper.size
    given = np.empty((n + 3 * m + 6, cases))
    given[:n] = prior.reshape(m * m, cases)[upper]
    given[n : n + 2 * m] = slopes.reshape(2 * m, cases)
    given[n + 2 * m : n + 2 * m + 2] = off
    given[n + 2 * m + 2 : n + 2 * m + 4] = variances
    given[-2 - m : -2], given[-2] = (0.0, 0.0) if known is None else known
    given[-1] = gate
    outputs = function(given)
    return Correction(outputs[:m], outputs[m], outputs[m + 1], outputs[m + 2 :][full])


def select_correction(choice: NDArray[np.bool_], new: Correction, old: Correction) -> Correction:
    """Return the `new` correction where `choice` (N,) is true, and the `old` one elsewhere."""
    both = zip(vars(new).values(), vars(old).values(), strict=True)
    return Correction(*(np.where(choice, a, b) for a, b in both))


@lru_cache(maxsize=16)
def packing_of(m: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return two index arrays of symmetric (m, m) matrices.

    The first takes the upper triangle from a flat matrix, the second a matrix from the triangle.
    """
    rows, columns = np.triu_indices(m)
    full = np.empty((m, m), dtype=np.intp)
    full[rows, columns] = full[columns, rows] = np.arange(rows.size)
    return rows * m + columns, full


@lru_cache(maxsize=16)
def _compile_correction(m: int) -> ArrayFunction:
    """Compile the correction of m quantities.

    The function takes the upper triangle of P, H, −ν at the point of linearisation, R, the known
    step, the weight (0: to be computed) and the gate. It returns step, weight, shift and the upper
    triangle of P⁺.
    """
    upper, full = packing_of(m)
    packed = sy.variables(*(f"p{k}" for k in range(upper.size)))
    flat = sy.variables(*(f"h{k}" for k in range(2 * m)))
    off, noise = sy.variables("off0", "off1"), sy.variables("noise0", "noise1")
    known, given, gate = sy.variables(*(f"step{k}" for k in range(m))), *sy.variables("w", "gate")
    prior = [[packed[k] for k in row] for row in full.tolist()]
    outputs = correction_of(prior, (flat[:m], flat[m:]), off, noise, known, given, gate)
    return ArrayFunction(outputs, (*packed, *flat, *off, *noise, *known, given, gate))


def correction_of(
    prior: Sequence[Sequence[Expr]],
    slopes: tuple[Sequence[Expr], Sequence[Expr]],
    off: Sequence[Expr],
    noise: Sequence[Expr],
    known: Sequence[Expr],
    given: Expr,
    gate: Expr,
) -> list[Expr]:
    """Return the correction as expressions: step, weight, shift and the upper triangle of P⁺.

    Parameters
    ----------
    prior : sequence of m rows
        P before the measurement.
    slopes : two rows of m
        H.
    off, noise : sequence of 2
        −ν at the point of linearisation, and the diagonal of R.
    known, given, gate
        As for `correct_estimate`; a weight of 0 is computed.
    """
    m = len(prior)
    rows, columns = np.triu_indices(m)
    # Innovation at the prior estimate in this linearisation: ν + H · (known step).
    left = [sy.dot(h, known) - q for h, q in zip(slopes, off, strict=True)]
    crossed = [[sy.dot(row, h) for h in slopes] for row in prior]
    expected = [[sy.dot(h, [row[k] for row in crossed]) for k in range(2)] for h in slopes]
    # S = H P Hᵀ + R (R is diagonal) and the squared Mahalanobis distance of the innovation
    total = [expected[k][k] + noise[k] for k in range(2)]
    p, q, r = _inverse(total[0], expected[0][1], total[1])
    # squared Mahalanobis distance νᵀ S⁻¹ ν
    distance = p * left[0] * left[0] + 2.0 * q * left[0] * left[1] + r * left[1] * left[1]
    own_weight = sy.maximum(distance / (gate * gate), 1.0)
    weight = sy.select(sy.less(given, 0.5), own_weight, given)
    grown = [v + (weight - 1.0) * s for v, s in zip(noise, total, strict=True)]
    p, q, r = _inverse(expected[0][0] + grown[0], expected[0][1], expected[1][1] + grown[1])
    # K = P Hᵀ S⁻¹ with the increased R
    gain = [(p * x + q * y, q * x + r * y) for x, y in crossed]
    step = [sy.dot(row, left) for row in gain]
    # change of the predicted direction from the point of linearisation, the larger component
    moved = [a - b for a, b in zip(step, known, strict=True)]
    shift = sy.maximum(*(sy.absolute(sy.dot(h, moved)) for h in slopes))
    rest = [[prior[i][j] - sy.dot(gain[i], crossed[j]) for j in range(m)] for i in range(m)]
    # (1 − K H) P (1 − K H)ᵀ + K R Kᵀ = A + (K R − A Hᵀ) Kᵀ with A = (1 − K H) P
    back = [[gain[i][k] * grown[k] - sy.dot(rest[i], slopes[k]) for k in range(2)]
            for i in range(m)]  # fmt: skip
    after = [rest[i][j] + sy.dot(back[i], gain[j]) for i, j in zip(rows, columns, strict=True)]
    return [*step, weight, shift, *after]


def _inverse(p: Expr, q: Expr, r: Expr) -> tuple[Expr, Expr, Expr]:
    """Return the inverse of the symmetric matrix [[p, q], [q, r]], packed likewise."""
    determinant = p * r - q * q
    return r / determinant, -q / determinant, p / determinant
