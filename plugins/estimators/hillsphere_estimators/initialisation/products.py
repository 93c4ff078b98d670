"""What is believed at first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array

__all__ = ["StartingBelief"]


@dataclass(frozen=True)
class StartingBelief:
    """Beliefs from sensors alone, of M random cases.

    Parameters
    ----------
    names : tuple of str
        The states.
    t_s : float
        When, s.
    means : ndarray, shape (n, M)
        Means, SI.
    covariances : ndarray, shape (M, n, n)
        Covariances, SI.
    truths : ndarray, shape (n, M)
        True states then.
    squares, rows : ndarray, shape (M,)
        Sums of the squared residuals in units of their noise, and how many values were measured.
    settled : ndarray, shape (M,)
        1 where the fit converged, else 0.
    """

    names: tuple[str, ...]
    t_s: float
    means: Array
    covariances: Array
    truths: Array
    squares: Array
    rows: Array
    settled: Array

    @property
    def mean(self) -> Array:
        """Mean of the first case (n,)."""
        return self.means[:, 0]

    @property
    def covariance(self) -> Array:
        """Covariance of the first case (n, n)."""
        return np.asarray(self.covariances[0])

    @property
    def truth(self) -> Array:
        """True state of the first case (n,)."""
        return self.truths[:, 0]

    @property
    def nees(self) -> Array:
        """Normalised errors squared (M,), χ² with n degrees of freedom if consistent."""
        off = (self.means - self.truths).T[:, :, None]
        return np.asarray(np.sum(off * np.linalg.solve(self.covariances, off), axis=(1, 2)))
