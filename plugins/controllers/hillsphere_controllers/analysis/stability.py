"""Spectral abscissa: the rate of a system's slowest decay."""

from __future__ import annotations

import numpy as np

from hillsphere.lti import LtiSystem

__all__ = ["spectral_abscissa"]


def spectral_abscissa(system: LtiSystem) -> float:
    """Return the largest real part of the poles, 1/s, negative for a stable system.

    In discrete time that of the logarithm of the poles over the period, so that both measure the
    rate of the slowest decay; −inf without poles, or with all of them at z = 0.

    Parameters
    ----------
    system : LtiSystem
        In continuous or discrete time.

    Returns
    -------
    float
        The abscissa, 1/s.
    """
    if system.order == 0:
        return -np.inf
    if system.dt_s is None:
        return float(system.poles.real.max())
    largest = float(np.abs(system.poles).max())
    return float(np.log(largest) / system.dt_s) if largest > 0.0 else -np.inf
