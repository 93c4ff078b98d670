"""Constant errors of measurements, as a linear filter's innovations show them.

References
----------
.. [1] Friedland (1969), Treatment of bias in recursive filtering, IEEE Trans. Automatic Control
   14(4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.estimation import Belief
from hillsphere.interfaces import Array
from hillsphere_estimators.innovations import WhitenedInnovation
from hillsphere_estimators.roots import solve_root
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
        self.curvature = np.zeros((cases, m))
        """Part of the score that curvature may have added, at most."""

    def move(self, tie: Link, before: Belief) -> None:
        """Move the effect with the motion; Φᵀ = P⁻¹ C P', from the smoother gain C."""
        # D has no part in directions without variance, and Φ D = (C P')ᵀ P⁻¹ D needs none of them
        share = solve_root(before.root, solve_root(before.root, self.effect), transposed=True)
        self.effect = tie.predicted.covariance @ np.swapaxes(tie.gain, 1, 2) @ share

    def add(
        self,
        belief: Belief,
        expected: WhitenedInnovation,
        covariance: Array,
        counted: NDArray[np.bool_],
        remainder: Array,
    ) -> None:
        """Take an update into account; the innovation is that of the prior.

        Where it is not `counted` (N,) the error does not act in it, and it adds no score. The mean
        `remainder` (m, N) of its linearisation may have acted like a constant error.
        """
        # H D = (Sᵀ Hᵀ)ᵀ S⁻¹ D
        past = np.swapaxes(expected.linear, 1, 2) @ solve_root(belief.root, self.effect)
        own = np.eye(covariance.shape[1]) * (expected.used & counted).T[:, :, None]
        seen = own - past
        solved = np.linalg.solve(
            covariance, np.concatenate([expected.residual[:, :, None], seen], axis=2)
        )
        keep = counted[:, None, None]
        self.score += np.where(keep, np.swapaxes(seen, 1, 2) @ solved[:, :, :1], 0.0)[:, :, 0]
        share = np.abs(np.swapaxes(np.linalg.solve(covariance, seen), 1, 2))
        self.curvature += np.where(keep, share @ remainder.T[:, :, None], 0.0)[:, :, 0]
        self.information += np.where(keep, np.swapaxes(seen, 1, 2) @ solved[:, :, 1:], 0.0)
        self.effect = self.effect + belief.root @ expected.linear @ solved[:, :, 1:]
