"""Simulated true motion of bodies from one time to the next."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_estimators.orbit_refinement.motion import BodiesModel

__all__ = ["simulate_motion"]


def simulate_motion(
    model: BodiesModel, x: Array, times_s: Array, random: np.random.Generator | None
) -> list[Array]:
    """Return the true states at each time.

    Parameters
    ----------
    model : BodiesModel
        Motion, and standard deviations of the accelerations.
    x : ndarray, shape (n, N)
        States at the first time.
    times_s : ndarray, shape (K,)
        Times, s.
    random : Generator, optional
        Random numbers of the accelerations; none: there are no accelerations.

    Returns
    -------
    list of ndarray, shape (n, N)
        K of them.
    """
    cases = x.shape[1]
    none, case, states = np.zeros((0, cases)), np.arange(cases), [x]
    for before, after in pairwise(times_s.tolist()):
        last, now = np.full(cases, before), np.full(cases, after)
        there = model.advance(x, last, now, none, case)
        if random is not None:
            # a root of Q times white noise has the covariance Q
            root = model.process_noise(x, last, now, none)
            there = there + np.einsum("nij,nj->in", root, random.normal(size=root.shape[::2]))
        x = there
        states.append(x)
    return states
