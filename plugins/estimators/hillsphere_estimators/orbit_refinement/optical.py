"""The optical part: angles from the Earth over weeks, fitted by least squares.

The first belief is wrong by a hundredth of the distance, from which a filter that linearises only
once does not recover. All angles are fitted together instead, see `arc_fit`. The belief at an
earlier time follows from the rows of the same fit up to that time [1]_.

References
----------
.. [1] Bierman (1977), Factorization methods for discrete sequential estimation, chapter V.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief, MeasurementSet
from hillsphere_estimators.initialisation.arc_fit import arc_fit, arc_rows, prior_rows
from hillsphere_estimators.orbit_refinement.motion import BodiesModel
from hillsphere_estimators.roots import lower_root, upper_triangle

__all__ = ["fit_angles"]

_FARTHEST = 8.0
"""Largest distance of a fit from the prior's mean, in its standard deviations: much farther out the
states are no elliptic orbits."""


def fit_angles(
    model: BodiesModel, prior: Belief, sets: Sequence[MeasurementSet], kept: Sequence[int]
) -> tuple[list[Belief], NDArray[np.bool_]]:
    """Fit all angles, and return the beliefs after some of the times.

    Parameters
    ----------
    model : BodiesModel
        Motion and sensors; the scenes of all times.
    prior : Belief
        States (n, N) at the first time.
    sets : sequence of MeasurementSet
        At K times, in order.
    kept : sequence of int
        Rising indices of the times whose belief is returned.

    Returns
    -------
    beliefs : list of Belief
        At these times, given the measurements until then, linearised about the fit of all.
    settled : ndarray of bool, shape (N,)
        Whether the fit converged.
    """
    fit = arc_fit(model, prior, sets, farthest=_FARTHEST)
    x, n = fit.belief.x, len(prior.x)
    rows = arc_rows(model, x, sets, prior.root)
    upper, beliefs, begin = prior_rows(prior, x), [], 0
    for k in kept:
        cases = len(upper)
        some = slice(begin, k + 1)
        new = np.concatenate(
            [rows.slopes[:, some].reshape(cases, -1, n),
             rows.residual[:, some].reshape(cases, -1, 1)], axis=2,
        )  # fmt: skip
        upper = upper_triangle(np.concatenate([upper, new], axis=1))[:, :n]
        begin = k + 1
        # U z = rest solves the rows until now; the belief moves with Φ to this time
        change = np.linalg.solve(upper[:, :, :n], upper[:, :, n:])
        root = rows.phi[:, k] @ np.linalg.inv(upper[:, :, :n])
        there = rows.path[:, k] + (rows.phi[:, k] @ change)[:, :, 0].T
        beliefs.append(Belief(there, lower_root(np.swapaxes(root, 1, 2)), sets[k].t_s))
    return beliefs, fit.settled
