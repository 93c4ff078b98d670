"""When the iterations of a case rest: each by itself, whatever its neighbours do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array

__all__ = ["distance", "rested"]


def distance(new: Belief, old: Belief) -> Array:
    """Return how far means lie apart, in standard deviations of the new belief (N,)."""
    step = np.linalg.solve(new.root, (new.x - old.x).T[:, :, None])
    return np.asarray(np.linalg.norm(step[:, :, 0], axis=1))


def rested(moving: NDArray[np.bool_], new: Belief, old: Belief) -> Belief:
    """Return the new belief of cases that move; others rest, whatever their neighbours do."""
    if moving.all():
        return new
    root = np.where(moving[:, None, None], new.root, old.root)
    return Belief(np.where(moving, new.x, old.x), root, old.t_s)
