"""Brackets of roots and extrema of a function along a chain of samples."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array

__all__ = ["brackets", "extrema"]

_GOLDEN = 0.6180339887498949
"""(√5 − 1)/2: each new point of a golden-section search divides the bracket in this ratio."""
_BESIDE = 0.05
"""Distance, in samples, of an extra point from each end. It shows an extremum that lies farther
than about half of it from the end; nearer to the end its difference would drown in rounding."""


def brackets(values: Array, target: float) -> NDArray[np.intp]:
    """Return the i at which samples pass the target between i and i + 1; a hit counts once."""
    above = values > target
    return np.flatnonzero(above[1:] != above[:-1])


def extrema(
    function: Callable[[Array], Array], values: Array, *, flat: float = 1e-10, width: float = 1e-5
) -> tuple[Array, Array]:
    """Refine the local extrema of a function sampled at 0, 1, 2 … by golden section.

    A pair of roots between two samples shows only by the extremum between them.

    Parameters
    ----------
    function : callable
        u (N,) → f (N,), with ``function(i) = values[i]``.
    values : ndarray, shape (K,)
        The samples.
    flat : float
        Bends smaller than this are rounding.
    width : float
        Position is found to this width (the value to its square).

    Returns
    -------
    u, f : ndarray, shape (E,)
        Positions and values of the extrema inside the range.
    """
    before, after = values[1:-1] - values[:-2], values[2:] - values[1:-1]
    bent = (before * after <= 0.0) & (np.maximum(np.abs(before), np.abs(after)) > flat)
    at = np.flatnonzero(bent) + 1
    low, high = at - 1.0, at + 1.0
    # a maximum is sought as the minimum of −f
    sign = np.where(values[at] >= values[at - 1], -1.0, 1.0)
    # the samples are monotonic about an extremum next to an end: one more sample there shows it
    last = values.size - 1.0
    inner = function(np.array([_BESIDE, last - _BESIDE])) - values[[0, -1]]
    outer = values[[1, -2]] - values[[0, -1]]
    hidden = (inner * outer < 0.0) & (np.minimum(np.abs(inner), np.abs(outer)) > flat)
    low = np.concatenate([low, np.array([0.0, last - 1.0])[hidden]])
    high = np.concatenate([high, np.array([1.0, last])[hidden]])
    sign = np.concatenate([sign, -np.sign(inner[hidden])])
    if not low.size:
        return np.empty(0), np.empty(0)
    p, q = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    fp, fq = sign * function(p), sign * function(q)
    while float(np.max(high - low)) > width:
        # keep the side of the smaller inner value; one inner point of the new bracket is known
        # already
        left = fp < fq
        low, high = np.where(left, low, p), np.where(left, q, high)
        new = np.where(left, high - _GOLDEN * (high - low), low + _GOLDEN * (high - low))
        fnew = sign * function(new)
        p, q, fp, fq = (
            np.where(left, new, q),
            np.where(left, p, new),
            np.where(left, fnew, fq),
            np.where(left, fp, fnew),
        )
    u = np.where(fp < fq, p, q)
    return u, sign * np.minimum(fp, fq)
