"""Bracketed roots of many independent functions at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hillsphere.base.arrays import Array

__all__ = ["bracketed_roots"]

_MOST = 100
"""Most evaluations. The method takes about ten; bisection alone reaches rounding after 53."""


def bracketed_roots(
    function: Callable[[Array], Array],
    a: Array,
    b: Array,
    fa: Array,
    fb: Array,
    tolerance: Array,
) -> Array:
    """Find one root per lane by Chandrupatla's method.

    The method uses inverse quadratic interpolation where it is safe, and bisection otherwise [1]_.
    A lane that has converged keeps its root, so that its result does not depend on the number of
    iterations of other lanes.

    Parameters
    ----------
    function : callable
        (N,) → (N,), lane by lane.
    a, b : ndarray, shape (N,)
        Ends of the brackets.
    fa, fb : ndarray, shape (N,)
        Values at the ends, of opposite sign or zero. Lanes with ``a == b`` keep this value.
    tolerance : ndarray, shape (N,)
        Width of the bracket at which a lane has converged.

    Returns
    -------
    ndarray, shape (N,)
        The roots.

    References
    ----------
    .. [1] T. R. Chandrupatla (1997), A new hybrid quadratic/bisection algorithm for finding the
       zero of a nonlinear function without using derivatives, Advances in Engineering Software
       28(3), 145-149.
    """
    a, b, fa, fb = a.copy(), b.copy(), fa.copy(), fb.copy()
    c, fc = a.copy(), fa.copy()
    root = np.where(np.abs(fa) < np.abs(fb), a, b)
    done = (a == b) | (fa == 0.0) | (fb == 0.0)
    # The first point is that of the secant, since the functions are nearly linear over a bracket.
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(done, 0.5, fa / (fa - fb))
    t = np.clip(t, 0.05, 0.95)
    for _ in range(_MOST):
        if done.all():
            break
        x = np.where(done, root, a + t * (b - a))
        fx = function(x)
        # The new point becomes a, b is the end of the other sign, and c the end that has left the
        # bracket.
        same = np.sign(fx) == np.sign(fa)
        c, fc = np.where(same, a, b), np.where(same, fa, fb)
        b, fb = np.where(same, b, a), np.where(same, fb, fa)
        a, fa = x, fx
        best = np.where(np.abs(fa) < np.abs(fb), a, b)
        root = np.where(done, root, best)
        with np.errstate(divide="ignore", invalid="ignore"):
            # A new point stays half a tolerance away from both ends. The lane has converged if the
            # bracket is too short for that.
            least = 0.5 * tolerance / np.abs(b - a)
            done |= ~(least <= 0.5) | (fa == 0.0) | (fb == 0.0)
            # Chandrupatla's criterion: only under these two inequalities is the inverse quadratic
            # through the three points monotone between a and b, and its root inside the bracket.
            xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
            safe = (phi**2 < xi) & ((1.0 - phi) ** 2 < 1.0 - xi)
            t = fa / (fb - fa) * fc / (fb - fc) + (c - a) / (b - a) * fa / (fc - fa) * fb / (
                fc - fb
            )
        t = np.where(safe & np.isfinite(t), t, 0.5)
        least = np.where(done, 0.0, least)
        t = np.clip(t, least, 1.0 - least)
    return root
