r"""One measurement of two angles taken into a Gaussian estimate, N cases at once.

With the prior covariance P, the slopes H, the innovation ν and the noise R of a measurement on the
sky,

.. math::

    S = H P H^T + R, \quad K = P H^T S^{-1}, \quad δ = K ν, \quad
    P^+ = (1 - K H) P (1 - K H)^T + K R K^T,

the last in Joseph's form [1]_, which stays symmetric and positive. A measurement with
ν·S⁻¹ν > gate² is an outlier: R grows in proportion.

References
----------
.. [1] Bierman, G. J. (1977), Factorization Methods for Discrete Sequential Estimation, Academic
   Press, section II.6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array

__all__ = ["Correction", "chosen", "corrected", "posterior"]


@dataclass(frozen=True, eq=False)
class Correction:
    """What one linearisation makes of a measurement; m quantities are estimated.

    Parameters
    ----------
    step : ndarray, shape (N, m)
        From the state before the measurement.
    gain : ndarray, shape (N, m, 2)
        K.
    slopes : ndarray, shape (N, 2, m)
        H.
    variances : ndarray, shape (N, 2)
        Diagonal of R.
    weight : ndarray, shape (N,)
        By how much R has grown: above 1 for outliers.
    shift : ndarray, shape (N,)
        How far, rad, the step leads from where H was taken.
    """

    step: Array
    gain: Array
    slopes: Array
    variances: Array
    weight: Array
    shift: Array


def corrected(
    prior: Array,
    slopes: Array,
    off: Array,
    variances: Array,
    gate: float,
    known: tuple[Array, Array] | None,
) -> Correction:
    """Return the correction that a measurement makes.

    Parameters
    ----------
    prior : ndarray, shape (N, m, m)
        Covariance before.
    slopes : ndarray, shape (N, 2, m)
        What a unit of each quantity changes in what is measured.
    off : ndarray, shape (2, N)
        What is expected less what is measured, where the slopes were taken.
    variances : ndarray, shape (N, 2)
        Of the measurement's noise.
    gate : float
        Standard deviations beyond which it is an outlier.
    known : tuple of ndarray, or None
        If the slopes were not taken at the state before: the step (N, m) from there, and the
        weight found there.

    Returns
    -------
    Correction
        For all cases.
    """
    left = -off.T[:, :, None]
    if known is not None:
        # what the state before would have left, to this linearisation
        left = left + slopes @ known[0][:, :, None]
    crossed = prior @ slopes.transpose(0, 2, 1)
    expected = slopes @ crossed
    inverse = _inverse(expected, variances)
    if known is None:
        distance = (left.transpose(0, 2, 1) @ (inverse @ left))[:, 0, 0]
        weight = np.maximum(distance / gate**2, 1.0)
    else:
        weight = known[1]
    if (weight > 1.0).any():
        variances = variances * weight[:, None]
        inverse = _inverse(expected, variances)
    gain = crossed @ inverse
    step = gain @ left
    moved = step if known is None else step - known[0][:, :, None]
    shift = np.abs(slopes @ moved).max(axis=(1, 2))
    return Correction(step[:, :, 0], gain, slopes, variances, weight, shift)


def posterior(prior: Array, taken: Correction, unit: Array) -> Array:
    """Return the covariance (N, m, m) after a correction; `unit` is the unit matrix (m, m)."""
    rest = unit - taken.gain @ taken.slopes
    covariance = rest @ prior @ rest.transpose(0, 2, 1)
    covariance += (taken.gain * taken.variances[:, None, :]) @ taken.gain.transpose(0, 2, 1)
    return np.asarray(0.5 * (covariance + covariance.transpose(0, 2, 1)))


def chosen(choice: NDArray[np.bool_], new: Correction, old: Correction) -> Correction:
    """Return the new correction in the cases chosen, else the old."""

    def one(name: str) -> Array:
        this, that = getattr(new, name), getattr(old, name)
        return np.asarray(np.where(choice.reshape(-1, *(1,) * (this.ndim - 1)), this, that))

    return Correction(*(one(name) for name in vars(new)))


_SIGNS = np.array([1.0, -1.0, -1.0, 1.0])


def _inverse(expected: Array, variances: Array) -> Array:
    """Return S⁻¹ (N, 2, 2): adjugate by determinant."""
    flat = expected.reshape(-1, 4).copy()
    flat[:, ::3] += variances
    adjugate = flat[:, ::-1] * _SIGNS
    adjugate /= flat[:, :1] * flat[:, 3:] - flat[:, 1:2] * flat[:, 2:3]
    return np.asarray(adjugate.reshape(-1, 2, 2))
