r"""What errors of measurements that are correlated in time would mean for a filter's own errors.

Innovations that are not white show that a model is wrong, but not how. With too little process
noise a filter is overconfident. With errors of measurements that are correlated from one set to the
next it may or may not be: a filter with much process noise follows each measurement and states an
error as large as it is.

Let the errors v, in units of their noise, have the variance 1 and the correlation ρ from one set to
the next, e be the error of the estimate, P its stated covariance, K and H gain and derivatives, and
A = 1 − K H. With :math:`e^+ = A e + K v` the excess D = Cov(e, e) − P and X = Cov(e, v) follow

.. math::

    D^+ = A D A^T + A X K^T + K X^T A^T, \quad X^+ = A X + K, \quad
    D' = \Phi D^+ \Phi^T, \quad X' = \rho\, \Phi X^+,

and the innovations ν = v − H e have the covariance from one set to the next

.. math::

    \rho\,(1 - X^T H^T) - H' \Phi\, (A X - A D H^T - K X^T H^T).

The correlation ρ is the one that gives the measured sum of these [1]_. The NEES is then on average
n + tr(P⁻¹ D).

References
----------
.. [1] Mehra (1970), On the identification of variances and adaptive Kalman filtering, IEEE Trans.
   Automatic Control 15(2): the autocorrelation of the innovations of a filter that is not optimal.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_estimators.fitted_pass import FittedPass
from hillsphere_estimators.roots import solve_root

__all__ = ["coloured_nees"]

_MOST = 0.99
"""Largest correlation that is considered: over a hundred sets such errors are nearly constant."""
_HALVINGS = 8
"""Bisections for the correlation, to 0.4 %: sampling leaves it uncertain by more."""
_COMMON = 20
"""Cases from which the mean innovation over the cases, which an error common to all has, is taken
off before the correlation is measured: it takes 1/20 of the power of other errors with it."""


def coloured_nees(about: FittedPass, good: NDArray[np.bool_]) -> tuple[float, float, Array]:
    """Return the correlation of errors that explains the innovations, and the NEES it leads to.

    Parameters
    ----------
    about : FittedPass
        Filter linearised about the fit, at K sets of N cases.
    good : ndarray of bool, shape (N,)
        Cases that count.

    Returns
    -------
    rho : float
        Correlation from one set to the next, 0 to 0.99.
    power : float
        Mean square of the innovations, over their stated variances, in the presence of such errors.
    nees : ndarray, shape (K, N)
        Mean NEES per state of the filter in the presence of such errors.
    """
    measured = _measured_product(about, good)
    low, high = 0.0, _MOST
    for _ in range(_HALVINGS):
        rho = 0.5 * (low + high)
        expected = _follow(about, rho)[0]
        low, high = (rho, high) if float(expected[good].sum()) < measured else (low, rho)
    _, power, nees = _follow(about, rho)
    rows = np.sum([expected.used.sum(axis=0) for expected in about.whitened], axis=0)
    return rho, float(power[good].sum() / max(rows[good].sum(), 1)), nees


def _measured_product(about: FittedPass, good: NDArray[np.bool_]) -> float:
    """Return the sum of products of successive innovations over their stated variances."""
    scaled = []
    for expected in about.whitened:
        used = expected.used.T & good[:, None]
        size = np.sqrt(np.diagonal(expected.covariance(), axis1=1, axis2=2))
        own = np.where(used, expected.residual / size, 0.0)
        if good.sum() >= _COMMON:
            own = np.where(used, own - own.sum(axis=0) / np.maximum(used.sum(axis=0), 1), 0.0)
        scaled.append(own)
    return sum(float(np.sum(a * b)) for a, b in pairwise(scaled))


def _follow(about: FittedPass, rho: float) -> tuple[Array, Array, Array]:
    """Return the expected products and squares (N,) of innovations, and the NEES per state (K, N).

    Products are those of successive innovations as measured above; squares are summed over rows.
    """
    cases, n, m = about.whitened[0].linear.shape
    excess, cross = np.zeros((cases, n, n)), np.zeros((cases, n, m))
    products, power, errors = np.zeros(cases), np.zeros(cases), list[Array]()
    before: tuple[Array, Array, Array, NDArray[np.bool_]] | None = None
    for k, (expected, predicted, filtered) in enumerate(
        zip(about.whitened, about.predicted, about.filtered, strict=True)
    ):
        slopes = expected.linear
        used = expected.used.T
        covariance = expected.covariance()
        size = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))

        def show(columns: Array, root: Array = predicted.root, rows: Array = slopes) -> Array:
            """Return H times columns, in units of the noise."""
            return np.asarray(np.swapaxes(rows, 1, 2) @ solve_root(root, columns))

        if k:
            tie, last = about.links[k - 1], about.filtered[k - 1]

            def move(columns: Array, root: Array = last.root, gain: Array = tie.gain,
                     later: Array = tie.predicted.covariance) -> Array:  # fmt: skip
                """Return Φ times columns in the range of P: Φ P = (C P')ᵀ."""
                share = solve_root(root, solve_root(root, columns), transposed=True)
                return np.asarray(later @ np.swapaxes(gain, 1, 2) @ share)

            excess = move(np.swapaxes(move(excess), 1, 2))
            cross = rho * move(cross)
            if before is not None:
                own, other, scale, then = before
                lag = rho * other - np.swapaxes(show(move(own)), 1, 2)
                both = used & then
                each = np.diagonal(lag, axis1=1, axis2=2) / (size * scale)
                products += np.sum(np.where(both, each, 0.0), axis=1)
        gain = predicted.root @ slopes @ np.linalg.inv(covariance)
        acting = np.where(used[:, :, None] & np.eye(m, dtype=bool), 1.0, 0.0)
        seen = np.swapaxes(show(cross), 1, 2)
        far = np.swapaxes(show(excess), 1, 2)
        # Cov(ν, ν) = S + H D Hᵀ − H X − Xᵀ Hᵀ
        own_power = covariance + show(far) - seen - np.swapaxes(seen, 1, 2)
        variance = np.diagonal(own_power, axis1=1, axis2=2) / size**2
        power += np.sum(np.where(used, variance, 0.0), axis=1)
        keep_cross = cross - gain @ show(cross)
        gained = keep_cross - (far - gain @ show(far)) - gain @ seen
        before = gained, acting - seen, size, used
        mixed = keep_cross @ np.swapaxes(gain, 1, 2)
        left = excess - gain @ show(excess)
        left = left - np.swapaxes(gain @ show(np.swapaxes(left, 1, 2)), 1, 2)
        excess = left + mixed + np.swapaxes(mixed, 1, 2)
        cross = keep_cross + gain @ acting
        half = solve_root(filtered.root, excess)
        whole = solve_root(filtered.root, np.swapaxes(half, 1, 2))
        errors.append(1.0 + np.trace(whole, axis1=1, axis2=2) / n)
    return products, power, np.array(errors)
