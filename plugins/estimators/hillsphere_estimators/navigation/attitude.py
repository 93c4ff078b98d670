"""Attitude errors of spacecraft, each shared by the sensors that it carries: true, and believed.

The rotation vector from the commanded to the true attitude is a drift plus a jitter, independent
about each axis. The drift is a first-order Gauss-Markov process, constant if its correlation time
is infinite; the jitter is independent at each sample.

A filter that believes noise has a state for each axis whose values at two samples are independent.
Its update is that by noise with the full covariance J σ² Jᵀ between all sensors of a spacecraft,
J the derivatives of the measurements by the attitude [1]_.

References
----------
.. [1] Bar-Shalom, Li, Kirubarajan (2001), Estimation with Applications to Tracking and Navigation,
   Wiley, sec. 8.3, on states of correlated noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_estimators.navigation.specs import AttitudeSpec

__all__ = ["TrueAttitude", "attitude_states"]

_WHITE_S = 1e-6
"""Correlation time of states that are independent at each sample: far below any interval, so that
e^(−Δt/τ) is zero."""


@dataclass(frozen=True)
class TrueAttitude:
    """True attitude errors of S spacecraft.

    Parameters
    ----------
    spec : AttitudeSpec
        Size of drift and jitter.
    crafts : int
        Number of spacecraft, S.
    """

    spec: AttitudeSpec
    crafts: int

    @property
    def noise(self) -> int:
        """Normal numbers of each case and sample: those of the drift, then those of the jitter."""
        return 6 * self.crafts

    def advance(self, drift: Array | None, dt_s: float, w: Array) -> Array:
        """Return the drift (3 S, N), rad, at the next sample.

        Parameters
        ----------
        drift : ndarray, shape (3 S, N), optional
            At the last sample; left out: this is the first.
        dt_s : float
            Time since the last sample, s.
        w : ndarray, shape (6 S, N)
            Normal numbers.
        """
        new = self.spec.drift_sigma_rad * w[: 3 * self.crafts]
        if drift is None:
            return np.asarray(new)
        if self.spec.drift_time_s is None:
            return drift
        steps = dt_s / self.spec.drift_time_s
        # e^(−Δt/τ) b + w, Var w = σ² (1 − e^(−2Δt/τ))
        return np.asarray(np.exp(-steps) * drift + np.sqrt(-np.expm1(-2.0 * steps)) * new)

    def turns(self, drift: Array, w: Array) -> Array:
        """Return the rotation vectors (S, 3, N), rad: drift plus jitter."""
        turns = drift + self.spec.jitter_sigma_rad * w[3 * self.crafts :]
        return np.asarray(turns.reshape(self.crafts, 3, -1))


def attitude_states(spec: AttitudeSpec) -> list[tuple[float, float]]:
    """Return standard deviation, rad, and correlation time, s, of the states about each axis."""
    drift, jitter = spec.drift_sigma_rad, spec.jitter_sigma_rad
    if spec.believed == "noise":
        return [(float(np.hypot(drift, jitter)), _WHITE_S)]
    time = np.inf if spec.drift_time_s is None else spec.drift_time_s
    states = [(drift, time), (jitter, _WHITE_S)]
    return [(sigma, time) for sigma, time in states if sigma > 0.0]
