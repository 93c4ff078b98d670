"""Navigation models: true states, a selection of them, or Gauss–Markov errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError
from hillsphere.interfaces.loop import Navigation

__all__ = ["NavigationErrors", "PerfectNavigation", "SeenStates"]


@dataclass(frozen=True)
class PerfectNavigation:
    """Navigation without errors: the law receives the true states.

    Parameters
    ----------
    noise : int
        Normal numbers that it takes at each measurement: none.
    """

    noise: int = 0

    def initial(self, t_s: Array, x: Array, w: Array) -> None:
        """Return None, since no memory is needed."""

    def observe(
        self, k: int, t_s: Array, x: Array, u: Array, w: Array, memory: Any
    ) -> tuple[Array, Any]:
        """Return the states."""
        return x, memory


class SeenStates:
    """Navigation of a selection of the states, such as positions and velocities only.

    Parameters
    ----------
    rows : sequence of int
        Rows of the states, in the order in which the law takes them.
    navigation : Navigation
        Navigation model of the selected states.
    """

    def __init__(self, rows: Sequence[int], navigation: Navigation) -> None:
        self._rows, self._navigation = list(rows), navigation
        self.noise = navigation.noise

    def initial(self, t_s: Array, x: Array, w: Array) -> Any:
        """Return the memory of the navigation."""
        return self._navigation.initial(t_s, x[self._rows], w)

    def observe(
        self, k: int, t_s: Array, x: Array, u: Array, w: Array, memory: Any
    ) -> tuple[Array, Any]:
        """Return the navigated values of the selected states, and the memory."""
        return self._navigation.observe(k, t_s, x[self._rows], u, w, memory)


class NavigationErrors:
    r"""The true states plus independent Gauss–Markov errors of zero mean.

    The error of each state is a first-order Gauss–Markov process with standard deviation σ and
    correlation time τ [1]_, stationary from the start. Its exact discretisation for samples at the
    spacing Δ is

    .. math:: e_{k+1} = e^{-\Delta/\tau} e_k + \sigma\sqrt{1 - e^{-2\Delta/\tau}}\; w_k .

    In continuous time it is white noise of unit spectral density, filtered by
    :math:`\sigma\sqrt{2/\tau}\,/\,(s + 1/\tau)`.

    Parameters
    ----------
    sigma : array_like, shape (n,)
        Standard deviations of the plant's states, SI.
    correlation_time_s : float
        τ; zero for errors that are independent from sample to sample.

    References
    ----------
    .. [1] A. Gelb, ed. (1974), Applied Optimal Estimation, MIT Press, section 3.6.
    """

    def __init__(self, sigma: Any, correlation_time_s: float = 0.0) -> None:
        self.sigma = np.array(sigma, dtype=float)
        if self.sigma.ndim != 1 or not (np.isfinite(self.sigma) & (self.sigma >= 0)).all():
            raise InputError(f"sigma must be (n,), finite and ≥ 0, got {sigma}")
        if not 0 <= correlation_time_s < np.inf:
            raise InputError(f"correlation_time_s must be ≥ 0, got {correlation_time_s}")
        self.correlation_time_s = correlation_time_s
        self.noise = len(self.sigma)

    def initial(self, t_s: Array, x: Array, w: Array) -> tuple[Array, Array]:
        """Return time and error before the first sample."""
        if len(x) != self.noise:
            raise InputError(f"sigma has {self.noise} elements, the plant {len(x)} states")
        return t_s, self.sigma[:, None] * w

    def observe(
        self, k: int, t_s: Array, x: Array, u: Array, w: Array, memory: tuple[Array, Array]
    ) -> tuple[Array, tuple[Array, Array]]:
        """Return the states with errors."""
        before, error = memory
        if self.correlation_time_s > 0:
            # The recurrence in the class docstring, with e^(−Δ/τ) for the elapsed time Δ.
            kept = np.exp((before - t_s) / self.correlation_time_s)
            error = kept * error + np.sqrt(1.0 - kept * kept) * (self.sigma[:, None] * w)
        else:
            error = self.sigma[:, None] * w
        return x + error, (t_s, error)
