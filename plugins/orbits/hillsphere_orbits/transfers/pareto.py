"""Pareto front of two costs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.errors import InputError

__all__ = ["front"]


def front(dv: ArrayLike, tof: ArrayLike) -> NDArray[np.bool_]:
    """Mark the solutions that are not dominated.

    A solution is dominated if another one is larger in neither cost and smaller in at least one;
    of solutions that are equal in both all stand.

    Parameters
    ----------
    dv, tof : array_like, shape (N,)
        The two costs, in any units; a solution with a cost that is not finite is none.

    Returns
    -------
    ndarray of bool, shape (N,)
        True on the Pareto front.

    Raises
    ------
    InputError
        If the two are not of one length.
    """
    first, second = (np.asarray(cost, dtype=float) for cost in (dv, tof))
    if first.ndim != 1 or first.shape != second.shape:
        raise InputError(f"dv and tof must be (N,) both, got {first.shape} and {second.shape}")
    on = np.zeros(first.shape, dtype=bool)
    valid = np.flatnonzero(np.isfinite(first) & np.isfinite(second))
    order = valid[np.lexsort((second[valid], first[valid]))]
    if not order.size:
        return on
    a, b = first[order], second[order]
    # the quickest of all that cost strictly less; and of those that cost the same
    begin = np.searchsorted(a, a, side="left")
    quickest = np.concatenate([[np.inf], np.minimum.accumulate(b)])
    on[order] = (b < quickest[begin]) & (b == b[begin])
    return on
