"""Convergence of iterated updates, case by case, and the regularity that they need.

A batch iterates until its last case has converged. The result of a case must not depend on which
other cases share its batch, so that converged cases are left unchanged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array

__all__ = ["freeze_converged", "regular_root", "regular_scales", "step_in_sigmas"]


def regular_root(belief: Belief) -> Array:
    """Return the root of a covariance after a check that it can be inverted.

    Parameters
    ----------
    belief : Belief
        Belief of N cases of n states.

    Returns
    -------
    ndarray, shape (N, n, n)
        Lower triangular S with P = S Sᵀ, the root of the belief itself.

    Raises
    ------
    InputError
        If a diagonal element of a root is zero: that state has no variance.
    """
    # the determinant of a triangular root is the product of its diagonal
    if not np.diagonal(belief.root, axis1=1, axis2=2).all():
        raise InputError(
            "the covariance of a belief is singular: a state has zero variance. Iterated updates "
            "need its inverse; give the state a small variance, or take the plain unscented update"
        )
    return belief.root


def regular_scales(scales: Array, n: int) -> Array:
    """Return the scales of n states after a check.

    Parameters
    ----------
    scales : ndarray, shape (n,)
        Size of one unit of each state, SI.
    n : int
        Number of states.

    Raises
    ------
    InputError
        If there are more or fewer than n, or one is not finite and positive.
    """
    given = np.asarray(scales, dtype=float)
    if given.shape != (n,) or not (np.isfinite(given) & (given > 0.0)).all():
        raise InputError(f"scales must be {n} sizes, finite and above zero, got {given.tolist()}")
    return given


def step_in_sigmas(new: Belief, old: Belief) -> Array:
    r"""Return the length of the step between two means in standard deviations.

    .. math:: \sqrt{(x' - x)^T P'^{-1} (x' - x)}, \quad P' = S' S'^T

    Parameters
    ----------
    new, old : Belief
        Beliefs of the same N cases, after and before an iteration; P' is the covariance after it.

    Returns
    -------
    ndarray, shape (N,)
        Without dimension.

    Raises
    ------
    InputError
        If the new covariance is singular.
    """
    # |S'⁻¹ (x' − x)|² is the quadratic form with P'⁻¹
    step = np.linalg.solve(regular_root(new), (new.x - old.x).T[:, :, None])
    return np.asarray(np.linalg.norm(step[:, :, 0], axis=1))


def freeze_converged(iterating: NDArray[np.bool_], new: Belief, old: Belief) -> Belief:
    """Return `new` for cases that still iterate and `old` for those that have converged.

    Parameters
    ----------
    iterating : ndarray of bool, shape (N,)
        True for cases that still iterate.
    new, old : Belief
        Beliefs of the same N cases, after and before this iteration.
    """
    # the common case of the first iterations, without a copy
    if iterating.all():
        return new
    root = np.where(iterating[:, None, None], new.root, old.root)
    return Belief(np.where(iterating, new.x, old.x), root, old.t_s)
