"""Choice of a number of equal steps by step doubling."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.base.errors import InputError, PropagationError

__all__ = ["fewest_steps"]

_FIRST_STEPS = 8
"""First number of steps. With fewer the two results can agree by chance; more would be wasted on
short propagations, as the returned number is never smaller."""
_ROUNDING = 1e-9
"""Differences that stop shrinking below this are taken for rounding, above it for coarse steps."""


def fewest_steps(
    difference: Callable[[int], float], order: int, tol: float, most: int, name: str
) -> int:
    """Find a number of steps that meets a tolerance.

    From the difference between n and 2n steps the next n follows by the order of the formula, at
    most four times as many; every number returned was itself tried.

    Parameters
    ----------
    difference : callable
        n → difference of the results of n and 2n steps; infinite if one of them is.
    order : int
        Order of the formula.
    tol : float
        Tolerance for the difference.
    most : int
        Largest number of steps to try.
    name : str
        What propagates, for the error.

    Returns
    -------
    int
        Steps whose difference is at most `tol`.

    Raises
    ------
    InputError
        If the tolerance is not positive.
    PropagationError
        If the difference stops shrinking (rounding), or `most` steps do not suffice.
    """
    if not (np.isfinite(tol) and tol > 0):
        raise InputError(f"tol must be positive, got {tol}")
    n, best, stalled = _FIRST_STEPS, np.inf, 0
    while 2 * n <= most:
        now = difference(n)
        if now <= tol:
            return n
        stalled = stalled + 1 if 0.5 * best < now < _ROUNDING else 0
        best = min(best, now)
        if stalled >= 2:
            raise PropagationError(
                f"tolerance {tol:g} is below the rounding error: with {n} steps of {name} the "
                f"difference stays at {best:.2g}; ask for more than that"
            )
        guess = 1.05 * n * (now / tol) ** (1.0 / order) if np.isfinite(now) else 2.0 * n
        n = int(min(4.0 * n, max(guess, n) + 1.0))
    raise PropagationError(
        f"{name}: {most} steps do not meet the tolerance {tol:g} (best difference {best:.2g}); "
        "the flight may meet a singularity, or is too long"
    )
