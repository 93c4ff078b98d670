"""The first part: angles from the Earth over weeks, fitted by least squares.

Of an error of a hundredth of the distance a filter that linearises once makes what it never
recovers from. All angles together are fitted instead, see `arc_fit`. How the knowledge grew is told
by the rows of that fit, taken in part by part [1]_.

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
"""Standard deviations of the prior: there are no ellipses much farther out."""


def fit_angles(
    model: BodiesModel, prior: Belief, sets: Sequence[MeasurementSet], kept: Sequence[int]
) -> tuple[list[Belief], NDArray[np.bool_]]:
    """Fit all angles, and tell what was known when.

    Parameters
    ----------
    model : BodiesModel
        Motion and sensors; the scenes of all times.
    prior : Belief
        Of the states (n, N) at the first time.
    sets : sequence of MeasurementSet
        At K times, in order.
    kept : sequence of int
        After which of them, rising, it is told what was known.

    Returns
    -------
    beliefs : list of Belief
        Of the states at the times kept, linearised about the fit.
    settled : ndarray of bool, shape (N,)
        Where the fit converged.
    """
    fit = arc_fit(model, prior, sets, farthest=_FARTHEST)
    x, n = fit.belief.x, len(prior.x)
    rows = arc_rows(model, x, sets, prior.root)
    upper, found, begin = prior_rows(prior, x), [], 0
    for k in kept:
        cases = len(upper)
        some = slice(begin, k + 1)
        new = np.concatenate(
            [rows.slopes[:, some].reshape(cases, -1, n),
             rows.residual[:, some].reshape(cases, -1, 1)], axis=2,
        )  # fmt: skip
        upper = upper_triangle(np.concatenate([upper, new], axis=1))[:, :n]
        begin = k + 1
        change = np.linalg.solve(upper[:, :, :n], upper[:, :, n:])
        root = rows.phi[:, k] @ np.linalg.inv(upper[:, :, :n])
        there = rows.path[:, k] + (rows.phi[:, k] @ change)[:, :, 0].T
        found.append(Belief(there, lower_root(np.swapaxes(root, 1, 2)), sets[k].t_s))
    return found, fit.settled
