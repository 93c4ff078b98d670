"""States that are angles: differences the short way round, and means in (−π, π].

A model declares them by its attribute ``angles`` (`hillsphere.interfaces.AngularModel`).
Differences between states that come from different computations are wrapped; a mean of sigma points
is formed of such differences from the image of the middle point. It is the intrinsic circular mean
as long as no point lies half a turn or more from the mean [1]_. Points of a wide belief may lie
farther: the whole turns of their images are those nearest to the linearised function.

References
----------
.. [1] Mardia, Jupp (2000), Directional statistics, section 2.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, EstimationModel

__all__ = ["check_angles", "lift_differences", "state_angles", "wrap_differences", "wrap_means"]

_TURN = 2.0 * np.pi


def state_angles(model: EstimationModel, n: int) -> list[int]:
    """Return the states of a model that are angles, by its attribute ``angles`` if it has one.

    Parameters
    ----------
    model : EstimationModel
        The model.
    n : int
        Number of its states.

    Returns
    -------
    list of int
        Rows of the angles.

    Raises
    ------
    InputError
        If an entry is no number of a state, or is given twice.
    """
    # not isinstance with the protocol, which would look up every method at each call
    return check_angles(getattr(model, "angles", ()), n)


def check_angles(angles: ArrayLike, n: int) -> list[int]:
    """Return rows of angles among n states as a list.

    Raises
    ------
    InputError
        If an entry is no number of a state, or is given twice.
    """
    given = np.asarray(angles)
    if not given.size:
        return []
    rows = given.tolist() if given.ndim == 1 and given.dtype.kind in "iu" else []
    if not rows or len(set(rows)) < len(rows) or min(rows) < 0 or max(rows) >= n:
        raise InputError(
            f"angles must be different numbers of states, 0 to {n - 1}, got {given.tolist()}"
        )
    return rows


def wrap_differences(off: Array, angles: Sequence[int]) -> Array:
    """Return differences of states with those of angles the short way round.

    Parameters
    ----------
    off : ndarray, shape (n, ...)
        Differences; those of angles in rad.
    angles : sequence of int
        Rows of angles.

    Returns
    -------
    ndarray, shape (n, ...)
        Differences of angles in (−π, π]; the array itself if there is nothing to wrap.
    """
    if not angles:
        return off
    rows = list(angles)
    # ⌈a − 1/2⌉ whole turns leave a remainder in (−1/2, 1/2]; differences within keep their bits
    turns = np.ceil(off[rows] / _TURN - 0.5)
    if not turns.any():
        return off
    wrapped = off.copy()
    wrapped[rows] -= _TURN * turns
    return wrapped


def lift_differences(off: Array, expected: Array, angles: Sequence[int]) -> Array:
    """Return differences with those of angles within half a turn of what is expected.

    Parameters
    ----------
    off, expected : ndarray, shape (m, ...)
        Differences, and those of the linearised function; of angles in rad.
    angles : sequence of int
        Rows of angles.
    """
    lifted = off.copy()
    rows = list(angles)
    turns = np.ceil((off[rows] - expected[rows]) / _TURN - 0.5)
    lifted[rows] -= _TURN * turns
    return lifted


def wrap_means(belief: Belief, angles: Sequence[int]) -> Belief:
    """Return a belief with the means of angles in (−π, π]."""
    x = wrap_differences(belief.x, angles)
    return belief if x is belief.x else replace(belief, x=x)
