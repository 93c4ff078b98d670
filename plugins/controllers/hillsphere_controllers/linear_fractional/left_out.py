r"""Cover of what an approximation of an uncertain matrix leaves out, by one full block.

A truncated or reduced LFT differs from the whole one by an error E(δ). If

.. math::

    E(\delta) = L\, \Delta\, R, \qquad \lVert \Delta \rVert \le 1

for all δ, the approximation and a full block Δ between L and R contain the whole family, and a
bound of µ with that block holds for it. The block forgets that Δ depends on δ and is real: the
bound may be larger than that of the whole family, never smaller.

For an error that is affine in normalised parameters, :math:`E = \sum_j \delta_{k(j)} \sigma_j u_j
v_j^\mathsf{T}` with \|δ\| ≤ 1, let U and V have the columns √σ u and √σ v. Then
:math:`E = U\, \mathrm{diag}(\delta)\, V^\mathsf{T}`, and with
L = (U Uᵀ)^½ and R = (V Vᵀ)^½, L⁻¹ U and Vᵀ R⁻¹ have the norm one, so that ‖Δ‖ ≤ max \|δ\| ≤ 1. With
few parameters the largest ‖Δ‖ is found at the corners of their box, since the norm is convex, and
scales the block down.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import chain, count, product

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import Uncertainty

__all__ = [
    "affine_weights", "cover_error", "diagonal_weights", "entry_sizes", "sample_weights",
    "without_cover",
]  # fmt: skip

_RANK = 1e-13
"""Singular values of a weight below this share of the largest are rounding of the error's."""
_FEW = 10
"""Parameters up to which all corners of their box are looked at: a thousand norms take
milliseconds."""


def cover_error(of: Lft, left: Array, right: Array, name: str = "left_out") -> Lft:
    """Return an LFT with one more uncertainty, a full block Δ that adds L Δ R to [A B; C D].

    Parameters
    ----------
    of : Lft
        Of order n, p outputs and m inputs; n is zero for an uncertain matrix.
    left : ndarray, shape (n + p, r)
        L.
    right : ndarray, shape (c, n + m)
        R.
    name : str
        Of the block; numbered if an uncertainty has the name.

    Returns
    -------
    Lft
        With the block last, marked as a cover; the same LFT if L or R is zero.

    Raises
    ------
    InputError
        If L or R does not fit.
    """
    (p, m), n, s = of.shape, of.system.order, of.system
    if left.ndim != 2 or right.ndim != 2 or (len(left), right.shape[1]) != (n + p, n + m):
        raise InputError(
            f"a cover L Δ R of a matrix {n + p} × {n + m} needs L ({n + p}, r) and R (c, {n + m}), "
            f"got {left.shape} and {right.shape}"
        )
    if not (left.any() and right.any()):
        return of
    (r, c), (out, into) = (left.shape[1], len(right)), of.closed_channels
    names = {u.name for u in of.uncertainties}
    numbered = (f"{name}_{k}" for k in count(2))
    free = next(one for one in chain([name], numbered) if one not in names)
    d = np.block(
        [
            [s.d[:out, :into], np.zeros((out, r)), s.d[:out, into:]],
            [np.zeros((c, into + r)), right[:, n:]],
            [s.d[out:, :into], left[n:], s.d[out:, into:]],
        ]
    )
    system = LtiSystem(
        s.a, np.hstack([s.b[:, :into], left[:n], s.b[:, into:]]),
        np.vstack([s.c[:out], right[:, :n], s.c[out:]]), d, s.dt_s,
    )  # fmt: skip
    block = Uncertainty(free, "full", r, c, covers=True)
    return Lft(system, (*of.uncertainties, block), (*of.times, 1))


def without_cover(of: Lft) -> Lft:
    """Return an LFT without the blocks that cover what an approximation left out.

    A bound of µ of it does not hold for what was left out.

    Parameters
    ----------
    of : Lft
        With or without such blocks.

    Returns
    -------
    Lft
        The approximation alone; the same LFT if it has no such block.
    """
    if not any(u.covers for u in of.uncertainties):
        return of
    rows: list[int] = []
    columns: list[int] = []
    row = column = 0
    for one, times in zip(of.uncertainties, of.times, strict=True):
        ends = row + times * one.columns, column + times * one.rows
        if not one.covers:
            rows += range(row, ends[0])
            columns += range(column, ends[1])
        row, column = ends
    s = of.system
    rows += range(row, s.shape[0])
    columns += range(column, s.shape[1])
    kept = [k for k, u in enumerate(of.uncertainties) if not u.covers]
    return Lft(
        replace(
            s, b=s.b[:, columns], c=s.c[rows], d=s.d[np.ix_(rows, columns)],
            inputs=tuple(s.inputs[j] for j in columns) if s.inputs else (),
            outputs=tuple(s.outputs[i] for i in rows) if s.outputs else (),
        ),
        tuple(of.uncertainties[k] for k in kept), tuple(of.times[k] for k in kept),
    )  # fmt: skip


def affine_weights(
    left: Array, values: Array, right: Array, lost: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Return L (p, r) and R (c, m) that cover lost directions of an affine matrix.

    Parameters
    ----------
    left, values, right : ndarray, shapes (k, p, n), (k, n), (k, n, m)
        Singular value decompositions of what each of k normalised parameters changes.
    lost : ndarray of bool, shape (k, n)
        The directions that are left out.

    Returns
    -------
    tuple of ndarray
        L and R; of no columns and rows if nothing is lost.
    """
    root = np.sqrt(values)
    owner, _ = np.nonzero(lost)
    into = (left * root[:, None, :]).transpose(0, 2, 1)[lost].T
    out = (right * root[:, :, None])[lost]
    weight, inner = _weight(into)
    other, outer = _weight(out.T)
    # Δ(δ) = inner diag(δ) outerᵀ: each parameter's part
    names = np.unique(owner)
    parts = np.array([inner[:, owner == k] @ outer[:, owner == k].T for k in names])
    size = 1.0
    if parts.size and names.size <= _FEW:
        signs = np.array(list(product([-1.0, 1.0], repeat=names.size)))
        norms = np.linalg.norm(np.tensordot(signs, parts, axes=1), 2, axis=(1, 2))
        size = min(float(norms.max()), 1.0)
    return np.sqrt(size) * weight, np.sqrt(size) * other.T


def entry_sizes(largest: Array) -> tuple[Array, Array]:
    """Return sizes of rows (p,) and columns (m,) whose products are no less than the entries.

    Parameters
    ----------
    largest : ndarray, shape (p, m)
        Sizes of the entries, ≥ 0.

    Returns
    -------
    tuple of ndarray
        The sizes; zero of a row or column of zeros.
    """
    by_row = largest.max(axis=1, initial=0.0)
    unit = np.where(by_row > 0.0, by_row, 1.0)
    return by_row, np.asarray((largest / unit[:, None]).max(axis=0, initial=0.0))


def diagonal_weights(by_row: Array, by_column: Array, size: float) -> tuple[Array, Array]:
    """Return L (p, r) and R (c, m): the diagonals of sizes that are not zero, of equal norms.

    Parameters
    ----------
    by_row, by_column : ndarray, shapes (p,), (m,)
        Sizes ≥ 0.
    size : float
        Largest singular value of an error whose rows and columns are divided by them.

    Returns
    -------
    tuple of ndarray
        L and R, with which such an error is L Δ R with ‖Δ‖ ≤ 1.
    """
    rows, columns = np.flatnonzero(by_row), np.flatnonzero(by_column)
    if not (rows.size and columns.size):
        return np.zeros((by_row.size, 0)), np.zeros((0, by_column.size))
    left, right = np.zeros((by_row.size, rows.size)), np.zeros((columns.size, by_column.size))
    left[rows, range(rows.size)] = size * by_row[rows]
    right[range(columns.size), columns] = by_column[columns]
    even = np.sqrt(np.linalg.norm(right) / np.linalg.norm(left))
    return even * left, right / even


def sample_weights(errors: Array) -> tuple[Array, Array]:
    """Return diagonal L (p, r) and R (c, m) that cover errors at samples.

    Parameters
    ----------
    errors : ndarray, shape (N, p, m)
        Errors of a matrix; nothing is known of others.

    Returns
    -------
    tuple of ndarray
        With them each error is L Δ R with ‖Δ‖ ≤ 1. Of rows and columns without error there is
        none.
    """
    by_row, by_column = entry_sizes(np.abs(errors).max(axis=0))
    unit = [np.where(one > 0.0, one, 1.0) for one in (by_row, by_column)]
    scaled = errors / unit[0][:, None] / unit[1]
    return diagonal_weights(by_row, by_column, float(np.linalg.norm(scaled, 2, axis=(1, 2)).max()))


def _weight(vectors: Array) -> tuple[Array, Array]:
    """Return W (p, r) of full rank with W Wᵀ = X Xᵀ, and W⁺ X of the norm one, for X (p, j)."""
    if not vectors.size:
        return np.zeros((len(vectors), 0)), np.zeros((0, vectors.shape[1]))
    u, s, vh = np.linalg.svd(vectors, full_matrices=False)
    kept = s > _RANK * s[0]
    return u[:, kept] * s[kept], vh[kept]
