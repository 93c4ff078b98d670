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
from hillsphere_estimators.roots import RANK, find_singular, solve_root

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
        If a covariance is singular: a state has no variance, or none given the others.
    """
    singular = find_singular(belief.root)
    if singular.any():
        case = int(np.argmax(singular))
        own = belief.root[case]
        known = np.abs(np.diagonal(own)) <= RANK * np.linalg.norm(own, axis=1)
        raise InputError(
            f"the covariance of a belief is singular: state {int(np.argmax(known))} of case {case} "
            "is known exactly, by itself or given the others, and the information of it is "
            "infinite; give it a small variance, or take a filter of type unscented or "
            "iterated_extended"
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
        Without dimension. States that are known exactly do not count.
    """
    # |S'⁻¹ (x' − x)|² is the quadratic form with P'⁻¹
    step = solve_root(new.root, (new.x - old.x).T[:, :, None])
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
