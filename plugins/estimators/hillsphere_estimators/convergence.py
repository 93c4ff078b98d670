"""When the iterations of a case rest: each by itself, whatever its neighbours do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array

__all__ = ["freeze_converged", "regular_root", "regular_scales", "step_in_sigmas"]


def regular_root(belief: Belief) -> Array:
    """Return the root of a covariance that has an inverse.

    Raises
    ------
    InputError
        If a state is known exactly.
    """
    if not np.diagonal(belief.root, axis1=1, axis2=2).all():
        raise InputError(
            "a belief has a singular covariance, which has no inverse; give "
            "every state some uncertainty, or take the plain unscented update"
        )
    return belief.root


def regular_scales(scales: Array, n: int) -> Array:
    """Return the sizes of one unit of n states.

    Raises
    ------
    InputError
        If there are more or fewer, or one is not finite and above zero.
    """
    found = np.asarray(scales, dtype=float)
    if found.shape != (n,) or not (np.isfinite(found) & (found > 0.0)).all():
        raise InputError(f"scales must be {n} sizes, finite and above zero, got {found.tolist()}")
    return found


def step_in_sigmas(new: Belief, old: Belief) -> Array:
    """Return how far means lie apart, in standard deviations of the new belief (N,).

    Raises
    ------
    InputError
        If a state is known exactly.
    """
    step = np.linalg.solve(regular_root(new), (new.x - old.x).T[:, :, None])
    return np.asarray(np.linalg.norm(step[:, :, 0], axis=1))


def freeze_converged(moving: NDArray[np.bool_], new: Belief, old: Belief) -> Belief:
    """Return the new belief of cases that move; others rest, whatever their neighbours do."""
    if moving.all():
        return new
    root = np.where(moving[:, None, None], new.root, old.root)
    return Belief(np.where(moving, new.x, old.x), root, old.t_s)
