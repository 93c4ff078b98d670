"""The reference sampled at the corrections, and the weights of a strategy's gains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_orbits.station_keeping_flown.reference_path import ReferencePath

__all__ = ["Sampling", "Weights"]

_WHOLE = 1e-9
"""Part of a period by which a whole number of corrections may miss it: rounding of the mission's
numbers, far below any tolerance of a correction."""


@dataclass(frozen=True)
class Weights:
    """Weights of deviations and impulses: one over the square of a tolerable size [1]_.

    Normalised.

    References
    ----------
    .. [1] A. E. Bryson, Y.-C. Ho (1975), Applied Optimal Control, Hemisphere.
    """

    position: float
    velocity: float
    impulse: float
    targets: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Sampling:
    """A reference at its corrections; normalised.

    Parameters
    ----------
    path : ReferencePath
        The reference; its states begin with three positions and three velocities.
    interval : float
        Time between corrections.
    count : int
        Corrections K, the first at time zero.
    """

    path: ReferencePath
    interval: float
    count: int

    @property
    def interval_s(self) -> float:
        """Time between corrections, s."""
        return self.interval * self.path.flow.system.time_unit_s

    @property
    def times(self) -> Array:
        """Times of the corrections, shape (K,)."""
        return np.asarray(self.interval * np.arange(self.count, dtype=float))

    def steps(self, count: int) -> Array:
        """Return the matrices A_k (count, 6, 6) of positions and velocities, from k = 0 on.

        Other states (the true anomaly of the moon) do not deviate.
        """
        starts = np.asarray(self.interval * np.arange(count, dtype=float))
        phi = self.path.transitions(starts, self.interval)
        return np.ascontiguousarray(np.moveaxis(phi[:6, :6], 2, 0))

    @property
    def cycle(self) -> int | None:
        """Corrections in a period of the reference; None if that is no whole number."""
        if self.path.period is None:
            return None
        # a periodic schedule of gains exists only if a whole number of intervals makes a period
        ratio = self.path.period / self.interval
        whole = round(ratio)
        return whole if whole >= 1 and abs(ratio - whole) <= _WHOLE * whole else None
