"""Constant errors of measurements, as a linear filter's innovations show them.

References
----------
.. [1] Friedland (1969), Treatment of bias in recursive filtering, IEEE Trans. Automatic Control
   14(4).
"""

from __future__ import annotations

import numpy as np

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array
from hillsphere_estimators.innovations import WhitenedInnovation
from hillsphere_estimators.smoother import Link

__all__ = ["ConstantErrors"]


class ConstantErrors:
    r"""Score of constant errors of m rows, from the innovations of a linear filter.

    A constant error b of the measurements, in units of their noise, adds B b to the innovation and
    D b to the estimate. With the gain K, D' = Φ D, B = 1 − H D' and D = D' + K B before and after
    each update; the score Σ Bᵀ S⁻¹ ν has the covariance Σ Bᵀ S⁻¹ B [1]_.

    Parameters
    ----------
    cases, n, m : int
        Numbers of cases, states and rows.
    """

    def __init__(self, cases: int, n: int, m: int) -> None:
        self.effect = np.zeros((cases, n, m))
        self.score, self.information = np.zeros((cases, m)), np.zeros((cases, m, m))

    def move(self, tie: Link, before: Belief) -> None:
        """Move the effect with the motion; Φᵀ = P⁻¹ C P', from the smoother gain C."""
        back = np.linalg.solve(before.root, tie.gain @ tie.predicted.covariance)
        phi = np.swapaxes(np.linalg.solve(np.swapaxes(before.root, 1, 2), back), 1, 2)
        self.effect = phi @ self.effect

    def add(self, belief: Belief, expected: WhitenedInnovation, covariance: Array) -> None:
        """Take an update into account; the innovation is that of the prior."""
        slopes = np.linalg.solve(np.swapaxes(belief.root, 1, 2), expected.linear)
        own = np.eye(covariance.shape[1]) * expected.used.T[:, :, None]
        seen = own - np.swapaxes(slopes, 1, 2) @ self.effect
        solved = np.linalg.solve(
            covariance, np.concatenate([expected.residual[:, :, None], seen], axis=2)
        )
        self.score += (np.swapaxes(seen, 1, 2) @ solved[:, :, :1])[:, :, 0]
        self.information += np.swapaxes(seen, 1, 2) @ solved[:, :, 1:]
        self.effect = self.effect + belief.root @ expected.linear @ solved[:, :, 1:]
