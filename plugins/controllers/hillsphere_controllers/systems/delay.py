r"""Padé approximation of a delay in continuous time.

.. math::

    e^{-sT} ≈ \frac{\sum_k c_k (-sT)^k}{\sum_k c_k (sT)^k}, \qquad
    c_k = \frac{(2N-k)!\, N!}{(2N)!\, k!\, (N-k)!}

is the diagonal Padé approximation [1]_: its gain is one, and its phase right up to about N/T.

References
----------
.. [1] G. A. Baker, P. Graves-Morris (1996), Padé Approximants, 2nd edition, Cambridge University
   Press, section 1.2.
"""

from __future__ import annotations

from math import comb, factorial

import numpy as np

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.systems.conversion import transfer_function

__all__ = ["pade_delay"]

_HIGHEST = 8
"""Order of the approximation at most: its coefficients span (2n)!/n!, and beyond eight the poles
lose digits to rounding."""


def pade_delay(time_s: float, order: int = 1) -> LtiSystem:
    """Return the diagonal Padé approximation of a delay of one signal.

    A zero-order hold delays a sampled signal by half the period on average.

    Parameters
    ----------
    time_s : float
        T, s.
    order : int
        N, from 1 to 8.

    Raises
    ------
    InputError
        If the time is not positive, or the order out of range.
    """
    if not (np.isfinite(time_s) and time_s > 0.0):
        raise InputError(f"a delay must be > 0 s, got {time_s}")
    if not 1 <= order <= _HIGHEST:
        raise InputError(f"the order of a delay must be from 1 to {_HIGHEST}, got {order}")
    below = [
        comb(order, k) * factorial(2 * order - k) / factorial(2 * order) * time_s**k
        for k in range(order, -1, -1)
    ]
    above = [c * (-1.0) ** (order - place) for place, c in enumerate(below)]
    return transfer_function(above, below)
