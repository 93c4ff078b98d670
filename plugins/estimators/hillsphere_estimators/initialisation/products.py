"""Product of the stage ``initialisation``: beliefs before a navigation begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.products.fields import Shape

__all__ = ["StartingBelief"]


@dataclass(frozen=True)
class StartingBelief:
    """Beliefs from sensors alone, of many random cases, with the true states beside them."""

    names: Annotated[tuple[str, ...], Shape("states")]
    """Names of the states."""
    t_s: float
    """Time of the beliefs, that of the last measurement."""
    means: Annotated[Array, Shape("states", "cases")]
    """Means, SI."""
    covariances: Annotated[Array, Shape("cases", "states", "states")]
    """Covariances, SI."""
    truths: Annotated[Array, Shape("states", "cases")]
    """True states at that time, SI."""
    squares: Annotated[Array, Shape("cases")]
    """Sum of the squared residuals of the fit, in units of their noise."""
    rows: Annotated[Array, Shape("cases")]
    """Number of measured values of the fit."""
    settled: Annotated[Array, Shape("cases")]
    """1 where the fit converged, else 0."""

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
