r"""Lower bound of an impulse between two orbits, from their integrals of motion alone.

In a system with the integral :math:`C = W(r) - \tfrac12 v^2` the place and C give the speed.
An impulse at a place r, from an orbit with :math:`C_1` to one with :math:`C_2`, turns the velocity
and changes the speed:

.. math::

    \Delta V \ge |v_2 - v_1|
             = \frac{2\,|C_1 - C_2|}{v_1 + v_2},
    \qquad v_2^2 = v_1^2 + 2\,(C_1 - C_2).

It is the smaller the faster the orbits are there: the bound for anywhere on an orbit is that of
the place where it is fastest.

It follows from C at the place alone, before and after, so that no search can go below it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.errors import InputError
from hillsphere.interfaces import Array

__all__ = ["least_dv"]


def least_dv(speed: ArrayLike, integral: ArrayLike, other: ArrayLike) -> Array:
    """Bound from below the impulse between two orbits at a place.

    Parameters
    ----------
    speed : array_like
        Speed on the first orbit at the place; its largest speed bounds any place on it.
    integral, other : array_like
        C of the first and of the second orbit, in units of the speed squared; positive where the
        potential is, that is W − ½v².

    Returns
    -------
    ndarray
        |v₂ − v₁| in the unit of the speed, broadcast; infinite where the second orbit's energy
        does not reach the place.

    Raises
    ------
    InputError
        If a speed is negative or not a number.
    """
    v, c, d = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in (speed, integral, other)))
    if not np.all(v >= 0.0):
        raise InputError(f"speeds must be numbers ≥ 0, got {np.min(v)}")
    square = v**2 + 2.0 * (c - d)
    reached = square >= 0.0
    total = v + np.sqrt(np.where(reached, square, 1.0))
    # the quotient keeps its digits where the speeds are nearly equal
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = np.where(total > 0.0, 2.0 * np.abs(c - d) / total, 0.0)
    return np.where(reached, gap, np.inf)
