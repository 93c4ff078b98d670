r"""One measurement of two angles taken into a Gaussian estimate, N cases at once.

With the prior covariance P, the slopes H, the innovation ν and the noise R of a measurement on the
sky,

.. math::

    S = H P H^T + R, \quad K = P H^T S^{-1}, \quad δ = K ν, \quad
    P^+ = (1 - K H) P (1 - K H)^T + K R K^T,

the last in Joseph's form [1]_, which stays positive where K is not exact. A measurement with
w = ν·S⁻¹ν / gate² > 1 is an outlier: R grows by w − 1 times the diagonal of S. So S grows by about
w, and the outlier, then at the gate, counts the less the farther it is off, be it the measurement
or the prior that makes S.

References
----------
.. [1] Bierman, G. J. (1977), Factorization Methods for Discrete Sequential Estimation, Academic
   Press, section II.6.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hillsphere import symbolic as sy
from hillsphere.dynamics import ArrayFunction
from hillsphere.interfaces import Array
from hillsphere.symbolic import Expr

__all__ = ["Correction", "correct_estimate", "select_correction"]


@dataclass(frozen=True, eq=False)
class Correction:
    """What one linearisation makes of a measurement; m quantities are estimated.

    Parameters
    ----------
    step : ndarray, shape (m, N)
        From the state before the measurement.
    weight : ndarray, shape (N,)
        By how much the diagonal of S has grown: above 1 for outliers.
    shift : ndarray, shape (N,)
        How far, rad, the step leads from where H was taken.
    covariance : ndarray, shape (m, m, N)
        After the measurement.
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
    """Return the correction that a measurement makes.

    Parameters
    ----------
    prior : ndarray, shape (m, m, N)
        Covariance before.
    slopes : ndarray, shape (2, m, N)
        What a unit of each quantity changes in what is measured.
    off : ndarray, shape (2, N)
        What is expected less what is measured, where the slopes were taken.
    variances : ndarray, shape (2, N)
        Of the measurement's noise.
    gate : float
        Standard deviations beyond which it is an outlier.
    known : tuple of ndarray, optional
        If the slopes were not taken at the state before: the step (m, N) from there, and the
        weight (N,) found there.

    Returns
    -------
    Correction
        For all cases.
    """
    m, cases = slopes.shape[1:]
    function, upper, full = _compile_correction(m)
    n = upper.size
    given = np.empty((n + 3 * m + 6, cases))
    given[:n] = prior.reshape(m * m, cases)[upper]
    given[n : n + 2 * m] = slopes.reshape(2 * m, cases)
    given[n + 2 * m : n + 2 * m + 2] = off
    given[n + 2 * m + 2 : n + 2 * m + 4] = variances
    given[-2 - m : -2], given[-2] = (0.0, 0.0) if known is None else known
    given[-1] = gate
    made = function(given)
    return Correction(made[:m], made[m], made[m + 1], made[m + 2 :][full])


def select_correction(choice: NDArray[np.bool_], new: Correction, old: Correction) -> Correction:
    """Return the new correction in the cases chosen (N,), else the old."""
    both = zip(vars(new).values(), vars(old).values(), strict=True)
    return Correction(*(np.where(choice, a, b) for a, b in both))


@lru_cache(maxsize=16)
def _compile_correction(m: int) -> tuple[ArrayFunction, NDArray[np.intp], NDArray[np.intp]]:
    """Return the correction of m quantities as a function, and how it packs covariances.

    From the upper triangle of P, H, −ν where H was taken, R, the known step and weight (0: to be
    found) and the gate: step, weight, shift, and the upper triangle of P⁺. The two index arrays
    take the triangle from a flat matrix, and a matrix from the triangle.
    """
    rows, columns = np.triu_indices(m)
    full = np.empty((m, m), dtype=np.intp)
    full[rows, columns] = full[columns, rows] = np.arange(rows.size)
    packed = sy.variables(*(f"p{k}" for k in range(rows.size)))
    flat = sy.variables(*(f"h{k}" for k in range(2 * m)))
    off, noise = sy.variables("off0", "off1"), sy.variables("noise0", "noise1")
    known, given, gate = sy.variables(*(f"step{k}" for k in range(m))), *sy.variables("w", "gate")
    prior, slopes = [[packed[k] for k in row] for row in full], (flat[:m], flat[m:])
    # what the state before would have left, to this linearisation
    left = [sy.dot(h, known) - q for h, q in zip(slopes, off, strict=True)]
    crossed = [[sy.dot(row, h) for h in slopes] for row in prior]
    expected = [[sy.dot(h, [row[k] for row in crossed]) for k in range(2)] for h in slopes]
    total = [expected[k][k] + noise[k] for k in range(2)]
    p, q, r = _inverse(total[0], expected[0][1], total[1])
    distance = p * left[0] * left[0] + 2.0 * q * left[0] * left[1] + r * left[1] * left[1]
    found = sy.maximum(distance / (gate * gate), 1.0)
    weight = sy.select(sy.less(given, 0.5), found, given)
    grown = [v + (weight - 1.0) * s for v, s in zip(noise, total, strict=True)]
    p, q, r = _inverse(expected[0][0] + grown[0], expected[0][1], expected[1][1] + grown[1])
    gain = [(p * x + q * y, q * x + r * y) for x, y in crossed]
    step = [sy.dot(row, left) for row in gain]
    moved = [a - b for a, b in zip(step, known, strict=True)]
    shift = sy.maximum(*(sy.absolute(sy.dot(h, moved)) for h in slopes))
    rest = [[prior[i][j] - sy.dot(gain[i], crossed[j]) for j in range(m)] for i in range(m)]
    # (1 − K H) P (1 − K H)ᵀ + K R Kᵀ = A + (K R − A Hᵀ) Kᵀ with A = (1 − K H) P
    back = [[gain[i][k] * grown[k] - sy.dot(rest[i], slopes[k]) for k in range(2)]
            for i in range(m)]  # fmt: skip
    after = [rest[i][j] + sy.dot(back[i], gain[j]) for i, j in zip(rows, columns, strict=True)]
    function = ArrayFunction(
        [*step, weight, shift, *after], (*packed, *flat, *off, *noise, *known, given, gate)
    )
    return function, rows * m + columns, full


def _inverse(p: Expr, q: Expr, r: Expr) -> tuple[Expr, Expr, Expr]:
    """Return the inverse of the symmetric matrix p, q; q, r."""
    determinant = p * r - q * q
    return r / determinant, -q / determinant, p / determinant
