r"""Residuals of a fit, and what they would be if the model were right.

With rows A of the derivatives by the unknowns z, in units of the measurements' noise and of the
prior's standard deviations, the residuals of a fit of gain K are

.. math:: r = W (A z + v), \quad W = 1 - A_e K_e, \quad
          \operatorname{Var} r = W (1 + A A^\mathsf{T}) W^\mathsf{T},

the index e for the states that are estimated; z and the noise v have unit variance. Considered
states are among z and not in e, so that what they add to the residuals is expected. A constant
error b of rows adds b d, and its score dᵀ r has the variance dᵀ Var(r) d [1]_.

References
----------
.. [1] Friedland (1969), Treatment of bias in recursive filtering, IEEE Trans. Automatic Control
   14(4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere.interfaces import Array, EstimationModel
from hillsphere_estimators.differences import layout_of
from hillsphere_estimators.linearisation import sensitivity, transition

__all__ = ["Residuals", "linearise_arc"]

_INDISTINCT = 1e-6
"""Share of a constant error that is left in the residuals below which the states take it up whole:
it can then not be told from them."""


@dataclass(frozen=True)
class Residuals:
    """Residuals of one case about a fit.

    Parameters
    ----------
    residual : ndarray, shape (M,)
        Measured less expected, in standard deviations of the noise.
    rows : ndarray, shape (M, n)
        Derivatives of the expected values by the states at the start, in these units, times the
        root of the prior.
    used : ndarray of bool, shape (M,)
        Values of the fit.
    free : ndarray of bool, shape (n,)
        States that are estimated.
    """

    residual: Array
    rows: Array
    used: NDArray[np.bool_]
    free: NDArray[np.bool_]

    def sigma(self) -> Array:
        """Return the standard deviations (M,) that the residuals should have, in units of noise.

        A value of the fit has drawn the states towards it, and its residual is smaller than its
        noise; the residual of another is larger, by the uncertainty of the states.
        """
        gain, left = self._gain_and_left()
        own = self.rows[self.used][:, self.free]
        used = (
            1.0
            - 2.0 * np.sum(own * gain.T, axis=1)
            + np.sum((own @ (gain @ gain.T)) * own, axis=1)
            + np.sum(left * left, axis=1)
        )
        variance = np.empty(len(self.residual))
        variance[self.used] = np.maximum(used, 0.0)
        other = self.rows[~self.used]
        variance[~self.used] = 1.0 + np.sum((other @ self._covariance()) * other, axis=1)
        return np.asarray(np.sqrt(variance))

    def constant_error(self, direction: Array) -> tuple[float, float]:
        """Return the score of a constant error and its standard deviation.

        Parameters
        ----------
        direction : ndarray, shape (M,)
            What the error adds to each residual; zero elsewhere.

        Returns
        -------
        score, sigma : float
            sigma is 0 if the states take up the error.
        """
        d = direction[self.used]
        gain, left = self._gain_and_left()
        own = self.rows[self.used][:, self.free]
        w = d - gain.T @ (own.T @ d)
        variance = float(w @ w + np.sum((left.T @ d) ** 2))
        if variance <= _INDISTINCT * float(d @ d):
            return 0.0, 0.0
        return float(d @ self.residual[self.used]), float(np.sqrt(variance))

    def weakest(self) -> tuple[float, Array]:
        """Return how little the data say about the combination of states they say least about.

        Returns
        -------
        share : float
            Its standard deviation after the fit over that of the prior.
        direction : ndarray, shape (e,)
            The combination of the e estimated states, in units of the prior.
        """
        free = np.flatnonzero(self.free)
        values, vectors = np.linalg.eigh(self._covariance()[np.ix_(free, free)])
        return float(np.sqrt(max(values[-1], 0.0))), vectors[:, -1]

    def _solved(self) -> Array:
        """Return the covariance (n, n) of all unknowns in units of the prior, by QR."""
        own = self.rows[self.used]
        upper = np.linalg.qr(np.concatenate([np.eye(own.shape[1]), own]), mode="r")
        root = np.linalg.inv(upper)
        return np.asarray(root @ root.T)

    def _gain_and_left(self) -> tuple[Array, Array]:
        """Return K_e (e, M) and W A (M, n)."""
        own = self.rows[self.used]
        gain = (self._solved() @ own.T)[self.free]
        return gain, own - own[:, self.free] @ (gain @ own)

    def _covariance(self) -> Array:
        """Return the covariance (n, n) of the errors of all states, the considered ones as before.

        The error of the estimates is (1 − K_e A) z − K_e v, that of considered states z.
        """
        own = self.rows[self.used]
        gain = np.zeros((own.shape[1], len(own)))
        gain[self.free] = (self._solved() @ own.T)[self.free]
        kept = np.eye(own.shape[1]) - gain @ own
        return np.asarray(kept @ kept.T + gain @ gain.T)


def linearise_arc(
    model: EstimationModel,
    prior: Belief,
    fitted: Belief,
    sets: Sequence[MeasurementSet],
) -> tuple[Array, Array]:
    """Return residuals (M,) and rows (M, n) of one case about a fit, see `Residuals`.

    Parameters
    ----------
    model : EstimationModel
        Motion and measurements.
    prior, fitted : Belief
        At the start; N = 1.
    sets : sequence of MeasurementSet
        In order; the rows that are present count.
    """
    now, phi = fitted, prior.root[0]
    none = np.zeros((0, 1))
    residuals, rows = [], []
    for one in sets:
        x, step = transition(model, now, one.t_s, none)
        phi, now = step[0] @ phi, Belief(x, now.root, one.t_s)
        layout, own = layout_of(one.blocks), one.present[:, 0]
        z, slopes = sensitivity(model, now, layout)
        sigma = one.sigma[own, 0]
        residuals.append(layout.difference(one.values, z)[own, 0] / sigma)
        rows.append(slopes[0][own] @ phi / sigma[:, None])
    return np.concatenate(residuals), np.concatenate(rows)
