"""Normalised errors squared (NEES) of estimates whose true states are known.

References
----------
.. [1] Bar-Shalom, Li, Kirubarajan (2001), Estimation with applications to tracking and navigation,
   section 5.4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.interfaces import Array, Integers
from hillsphere_estimators.roots import RANK, find_singular
from hillsphere_estimators.state_angles import check_angles, wrap_differences

__all__ = ["nees", "nees_dof"]

_ROUNDING_SIGMAS = 1e-8
"""Error, in standard deviations, of a combination of states without variance that is rounding: the
root of a covariance is rounded by some 1e-15, for errors of some standard deviations."""
_ULPS = 64 * float(np.finfo(float).eps)
"""Relative error of a state that is rounding: some operations between truth and estimate."""


def nees(
    belief: Belief, truth: Array, states: ArrayLike | None = None, *, angles: ArrayLike = ()
) -> Array:
    """Return the normalised estimation errors squared (NEES).

    Parameters
    ----------
    belief : Belief
        Estimates of n states of N cases.
    truth : ndarray, shape (n, N)
        True states, SI.
    states : array_like of int, optional
        States that count; all by default.
    angles : array_like of int, optional
        States that are angles, rad: their errors go the short way round. Those of a model are its
        attribute ``angles``.

    Returns
    -------
    ndarray, shape (N,)
        (x̂ − x)ᵀ P⁻¹ (x̂ − x); for a consistent filter χ² distributed with `nees_dof` degrees of
        freedom, as many as states if none is known exactly. Infinite in a case with an error,
        beyond rounding, of a state or combination of states that the covariance states to be known
        exactly.

    Raises
    ------
    InputError
        If the truth has another shape than the estimates, or an angle is no state.
    """
    if np.shape(truth) != belief.x.shape:
        raise InputError(f"truth must be {belief.x.shape}, as the belief, got {np.shape(truth)}")
    rows = np.arange(len(belief.x)) if states is None else np.atleast_1d(np.asarray(states))
    error = wrap_differences(belief.x - truth, check_angles(angles, len(belief.x)))
    off = error[rows].T[:, :, None]
    singular = find_singular(belief.root)
    # covariances with zeros are inverted by themselves, below
    one = np.eye(len(belief.x))
    root = np.where(singular[:, None, None], one, belief.root) if singular.any() else belief.root
    if states is None:
        squares = np.asarray(np.sum(np.linalg.solve(root, off)[:, :, 0] ** 2, axis=1))
    else:
        covariance = (root @ np.swapaxes(root, 1, 2))[:, rows[:, None], rows]
        squares = np.asarray(np.sum(off * np.linalg.solve(covariance, off), axis=(1, 2)))
    if singular.any():
        size = np.maximum(np.abs(belief.x), np.abs(truth))[rows].T[singular]
        squares[singular] = _singular_squares(belief.root[singular][:, rows], off[singular], size)
    return squares


def nees_dof(belief: Belief, states: ArrayLike | None = None) -> Integers:
    """Return the degrees of freedom of `nees`: the rank of the covariances.

    Parameters
    ----------
    belief : Belief
        Estimates of n states of N cases.
    states : array_like of int, optional
        States that count; all by default.

    Returns
    -------
    ndarray of int, shape (N,)
        Number of states, less those that are known exactly, by themselves or given the others.
    """
    rows = np.arange(len(belief.x)) if states is None else np.atleast_1d(np.asarray(states))
    dof = np.full(len(belief.t_s), len(rows))
    singular = find_singular(belief.root)
    if singular.any():
        own = belief.root[singular][:, rows]
        values = np.linalg.svd(own / _row_sizes(own), compute_uv=False)
        dof[singular] = np.sum(values > RANK * len(rows), axis=1)
    return dof


def _row_sizes(root: Array) -> Array:
    """Return the lengths (N, k, 1) of the rows of roots (N, k, n), 1 for rows of zeros."""
    size = np.linalg.norm(root, axis=2)[:, :, None]
    return np.asarray(np.where(size > 0.0, size, 1.0))


def _singular_squares(root: Array, off: Array, size: Array) -> Array:
    """Return the NEES (N,) of covariances that are singular.

    Parameters
    ----------
    root : ndarray, shape (N, k, n)
        Rows of the roots of the states that count.
    off : ndarray, shape (N, k, 1)
        Errors.
    size : ndarray, shape (N, k)
        Sizes of the states, for the rounding of their errors.
    """
    sigma = _row_sizes(root)
    vectors, values, _ = np.linalg.svd(root / sigma)
    free = np.zeros(vectors.shape[::2], dtype=bool)
    free[:, : values.shape[1]] = values > RANK * root.shape[1]
    along = (np.swapaxes(vectors, 1, 2) @ (off / sigma))[:, :, 0]
    variance = np.ones(free.shape)
    variance[:, : values.shape[1]] = np.where(free[:, : values.shape[1]], values, 1.0) ** 2
    rounding = _ROUNDING_SIGMAS + _ULPS * np.linalg.norm(size / sigma[:, :, 0], axis=1)
    wrong = (~free & ~(np.abs(along) <= rounding[:, None])).any(axis=1)
    squares = np.sum(np.where(free, along**2 / variance, 0.0), axis=1)
    return np.where(wrong, np.inf, squares)
