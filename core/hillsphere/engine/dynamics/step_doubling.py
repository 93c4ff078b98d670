"""Choice of the number of equal steps by step doubling."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.base.errors import InputError, PropagationError

__all__ = ["fewest_steps"]

_FIRST_STEPS = 8
"""First number of steps. With fewer the two results can agree by chance; more would be wasted on
short propagations, as the returned number is never smaller."""
_ROUNDING = 1e-9
"""A difference that no longer decreases is attributed to rounding if it is below this value, and
otherwise to steps that are still too long for the asymptotic order."""


def fewest_steps(
    difference: Callable[[int], float], order: int, tol: float, most: int, name: str
) -> int:
    """Find a number of steps that meets a tolerance.

    The difference between n and 2n steps decreases as n^−order, which predicts the next n; it grows
    by a factor of four at most. A number is returned only after its own difference was computed.

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
        Name of the propagator, for the error.

    Returns
    -------
    int
        Steps whose difference is at most `tol`.

    Raises
    ------
    InputError
        If the tolerance is not positive.
    PropagationError
        If the difference stops decreasing (rounding), or `most` steps do not suffice.
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
                f"difference stays at {best:.2g}; give a larger tolerance than that"
            )
        guess = 1.05 * n * (now / tol) ** (1.0 / order) if np.isfinite(now) else 2.0 * n
        n = int(min(4.0 * n, max(guess, n) + 1.0))
    raise PropagationError(
        f"{name}: {most} steps do not meet the tolerance {tol:g} (best difference {best:.2g}); "
        "the flight may meet a singularity, or is too long"
    )
