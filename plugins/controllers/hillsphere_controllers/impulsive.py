"""Impulsive control: linear feedback as changes of velocity at samples."""

from __future__ import annotations

from typing import Literal

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.specs import ImpulsiveSpec

__all__ = ["Impulsive"]


class Impulsive:
    """Δv = −K (seen − reference) at each sample, none below a dead band, cut at a maximum.

    Parameters
    ----------
    spec : ImpulsiveSpec
        Gain and limits.
    """

    actuation: Literal["hold", "impulse"] = "impulse"

    def __init__(self, spec: ImpulsiveSpec) -> None:
        self.spec = spec
        self.period_s = spec.period_s
        self._gain = np.array(spec.gain)

    def initial(self, n_cases: int) -> Array:
        """Return no states, (0, N)."""
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return Δv (p, N), m/s, and no states."""
        if len(y) != self._gain.shape[1]:
            raise InputError(
                f"gain has {self._gain.shape[1]} columns; the law sees {len(y)} values"
            )
        u = self._gain @ (ref - y)
        # dead band and maximum act on the length of Δv, so that its direction is kept
        size = np.sqrt(np.sum(u * u, axis=0))
        u = np.where(size < self.spec.dead_band_m_s, 0.0, u)
        if self.spec.maximum_m_s is not None:
            u = u * np.minimum(1.0, self.spec.maximum_m_s / np.where(size > 0, size, 1.0))
        return u, xc
