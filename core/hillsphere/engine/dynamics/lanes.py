"""Checks of propagators' arguments: states, durations and times of N lanes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Array
from hillsphere.base.errors import InputError, PropagationError

__all__ = ["initial_derivatives", "per_lane", "refuse_non_finite", "start_states"]

_SHOWN = 10
"""Lanes that an error lists: enough to find the fault, on one line."""


def start_states(x: ArrayLike, n: int) -> tuple[Array, bool]:
    """Check states given as (n,) or (n, N) and return them as a contiguous (n, N).

    Parameters
    ----------
    x : array_like
        States.
    n : int
        Number of states.

    Returns
    -------
    states : ndarray, shape (n, N)
        Contiguous states; N may be zero.
    single : bool
        Whether one lane was given without an axis of lanes.

    Raises
    ------
    InputError
        If the shape does not fit or a value is not finite.
    """
    states = np.ascontiguousarray(x, dtype=float)
    if states.ndim not in (1, 2) or len(states) != n:
        raise InputError(f"x must be ({n},) or ({n}, N), got {states.shape}")
    single = states.ndim == 1
    if single:
        states = states[:, None]
    if not np.isfinite(states).all():
        raise InputError(f"x: {_lanes(states)} start with non-finite states")
    return states, single


def per_lane(value: ArrayLike, cases: int, name: str) -> Array:
    """Broadcast a scalar or (N,) to (N,).

    Parameters
    ----------
    value : array_like
        Numbers.
    cases : int
        N.
    name : str
        Name of the argument, for the error.

    Returns
    -------
    ndarray, shape (N,)
        Contiguous.

    Raises
    ------
    InputError
        If the shape does not fit or a value is not finite.
    """
    array = np.asarray(value, dtype=float)
    if array.shape not in ((), (1,), (cases,)):
        raise InputError(f"{name} must be a number or ({cases},), got {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} must be finite, got {array}")
    return np.ascontiguousarray(np.broadcast_to(array, (cases,)))


def initial_derivatives(n: int, columns: int, cases: int) -> Array:
    """Return the initial derivatives [Φ Ψ] = [1 0] of all lanes as rows (n·columns, N)."""
    return np.repeat(np.eye(n, columns).reshape(-1, 1), cases, axis=1)


def refuse_non_finite(y: Array, where: str) -> None:
    """Raise `PropagationError` naming the lanes of y (rows, N) that hold a NaN or infinity."""
    if not np.isfinite(y).all():
        raise PropagationError(
            f"{_lanes(y)} turned non-finite ({where}); the flight meets a singularity or the "
            "steps are too long for it"
        )


def _lanes(y: Array) -> str:
    bad = np.flatnonzero(~np.isfinite(y).all(axis=0)).tolist()
    shown = ", ".join(str(i) for i in bad[:_SHOWN]) + (", …" if len(bad) > _SHOWN else "")
    return f"lane{'s' if len(bad) > 1 else ''} {shown} (of {y.shape[1]})"
