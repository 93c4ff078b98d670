"""Frequencies at which systems are drawn."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem

__all__ = ["frequencies"]

_PER_DECADE = 60
"""Grid points per decade; lightly damped peaks get points of their own beside the grid."""
_MOST = 600
"""Grid points at most, where poles span more than ten decades; it bounds the time and the size of a
figure."""
_LOWEST = 1e-4
"""Slower poles, relative to the median, such as those of weights that stand for integrators, are
not looked at below."""
_BESIDE = 1e-3
"""So far, relatively, from the poles: some lie on the imaginary axis."""


def frequencies(
    systems: Iterable[LtiSystem], more: Sequence[float] = (), *, decades: float = 1.0
) -> Array:
    """Return frequencies (K,), rad/s, from below the slow poles to above the fast ones.

    Parameters
    ----------
    systems : iterable of LtiSystem
        Of one sampling period. Frequencies close to their poles are among those returned, so that
        resonances are seen.
    more : sequence of float
        Frequencies that are wanted besides, rad/s; those outside of that range are left out.
    decades : float
        By how much the ends lie beyond the poles.
    """
    candidates: list[Array] = [np.zeros(0)]
    top = np.inf
    for system in systems:
        poles = system.poles
        if system.dt_s is not None:
            poles = np.asarray(np.log(poles[np.abs(poles) > 1e-12]) / system.dt_s)
            top = np.pi / system.dt_s
        candidates += [np.abs(poles), np.abs(poles.imag)]
    size: Array = np.concatenate(candidates).astype(float)
    size = size[(size > 0.0) & np.isfinite(size)]
    size = size[size >= _LOWEST * np.median(size)] if size.size else np.array([1.0])
    high = min(np.log10(size.max()) + decades, float(np.log10(top)))
    low = min(np.log10(size.min()) - decades, high - 1.0)
    count = int(min(_MOST, _PER_DECADE * (high - low)))
    beside = np.concatenate([size * (1.0 - _BESIDE), size * (1.0 + _BESIDE)])
    wanted = np.array([w for w in more if 10.0**low <= w <= 10.0**high])
    made = np.unique(np.concatenate([np.logspace(low, high, count), beside, wanted]))
    return made[made <= top]
