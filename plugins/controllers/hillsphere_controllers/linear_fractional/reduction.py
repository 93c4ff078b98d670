r"""Reduction of LFTs: fewer copies of uncertainties, exactly or within a proved error.

A copy is a state of an LFT as an integrator is one of a system: Δ takes its outputs z and returns
its inputs w. Copies that no input reaches through any product of blocks, or that no output shows,
are removed without any error [1]_. Others are removed after balancing, uncertainty by uncertainty,
with the Gramians

.. math::

    Y_i = B_i B_i^\mathsf{T} + \sum_j A_{ij} Y_j A_{ij}^\mathsf{T}, \qquad
    Z_i = C_i^\mathsf{T} C_i + \sum_j A_{ji}^\mathsf{T} Z_j A_{ji}

and the error made is bounded for all Δ by the skewed µ of the difference of the two. A full block
of that size covers it (`left_out`), so that the reduced LFT contains the whole family.

References
----------
.. [1] C. L. Beck, J. Doyle (1999), A necessary and sufficient minimality condition for uncertain
   systems, IEEE Transactions on Automatic Control 44(10), 1802-1813.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere_controllers.linear_fractional.left_out import (
    cover_error,
    diagonal_weights,
    entry_sizes,
    without_cover,
)
from hillsphere_controllers.linear_fractional.transformation import Lft, evaluate_upper_lft
from hillsphere_controllers.linear_fractional.uncertainties import random_values
from hillsphere_controllers.mu.blocks import BlockStructure, full
from hillsphere_controllers.mu.upper_bound import upper_bound
from hillsphere_controllers.systems.algebra import gain

__all__ = ["ReducedLft", "gain_bound", "minimal", "reduce_lft"]

_RANK = 1e-12
"""Singular values below this share of the matrix's largest entry count as zero when reachable
subspaces are built. A larger value removes copies that act; a smaller one keeps copies that exist
only by rounding."""
_EVEN = 5
"""Rounds of equilibration: scales of outer rows, outer columns and copies depend on each other and
settle to a factor near one in a few rounds."""
_NOTHING = 1e-14
"""Of what a number does, in even units: rounding."""
_GROWTH_STEPS = 100
"""Steps of the power iteration for the growth of the words of blocks. The growth only chooses the
shrink factor, so a few digits of it suffice."""
_MOST_STEPS = 300
"""Words of blocks that are summed at most. With the shrink factor of 0.95 the remainder is below
1e-6 of the sum after 300 steps; it affects only which balance is tried, not the proved bound."""
_FADING = 0.95
"""Factor by which words of blocks count less with their length, at most."""
_SAMPLES = 500
"""Random Δ at which the proved bound is compared with the true error: half of them with real
parameters at their bounds, where the error is usually largest."""
_UNSEEN = 1e-6
"""Size of an error that no random Δ has shown, relative to the largest: its row or column needs a
unit, and the bound is proved for all Δ in any."""
_FLOOR = 1e-6
"""Of scalings that prove existence: relative to what the outputs weigh."""


@dataclass(frozen=True)
class ReducedLft:
    """An LFT with fewer copies, and the error of the reduction.

    Parameters
    ----------
    lft : Lft
        With fewer copies. If the bound is not zero, its last block ``left_out`` covers the error.
    bound : float
        The largest singular value of the difference of the matrices [A B; C D] is no larger for
        any Δ; zero if nothing but copies without effect, see `minimal`, was taken out.
    sampled : float
        The largest found among random Δ.
    """

    lft: Lft
    bound: float
    sampled: float

    @property
    def truncated(self) -> Lft:
        """The LFT without the block that covers the error: not the whole family."""
        return without_cover(self.lft)


def minimal(of: Lft) -> Lft:
    """Return the LFT without copies of numbers that have no effect; copies of full blocks stay.

    No smaller one is the same for matrices in the place of the numbers, which do not commute. What
    is below 1e-12 in even units counts for no effect: the matrices stay the same to about 2e-9 of
    their size, where coefficients lie many decades apart.

    Parameters
    ----------
    of : Lft
        The LFT.

    Returns
    -------
    Lft
        The smaller one.
    """
    for turned in (False, True):
        scales, a, b, c, counts = _equilibrate(of)
        bases = _reachable_bases(a.T, c.T, counts) if turned else _reachable_bases(a, b, counts)
        if any(basis.shape[1] < len(basis) for basis in bases):
            of = _project(
                of,
                [basis / scale for basis, scale in zip(bases, scales, strict=True)],
                [basis * scale for basis, scale in zip(bases, scales, strict=True)],
            )
    return of


def reduce_lft(of: Lft, tolerance: float, *, seed: int = 0) -> ReducedLft:
    """Remove as many copies of scalar uncertainties as a tolerance allows.

    The error is that of the matrix [A B; C D], in the units of its entries: scale states, inputs
    and outputs first.

    Parameters
    ----------
    of : Lft
        With or without states.
    tolerance : float
        Largest singular value that the difference may have for any Δ.
    seed : int
        Of the samples that the bound is compared with.

    Returns
    -------
    ReducedLft
        The least of those tried whose bound, proved by µ, is no larger than the tolerance.

    Raises
    ------
    InputError
        If the tolerance is negative.
    """
    if not tolerance >= 0.0:
        raise InputError(f"a tolerance must be ≥ 0, got {tolerance}")
    least = minimal(of)
    best = ReducedLft(least, 0.0, _sample_gain(_error(of, least), seed))
    if tolerance == 0.0:
        return best
    left, right, values = _balancing(least)
    # bisection of the number of copies removed, in the order of their singular values
    ranked = np.sort(np.concatenate([*values, np.empty(0)]))
    low, high = 0, len(ranked)
    while low < high:
        count = (low + high + 1) // 2
        # those of equal values go or stay together
        kept = [int(np.sum(v > ranked[count - 1])) for v in values]
        reduced = _project(
            least,
            [matrix[:, :k] for matrix, k in zip(left, kept, strict=True)],
            [matrix[:, :k] for matrix, k in zip(right, kept, strict=True)],
        )
        error = _error(least, reduced)
        sampled = _sample_gain(error, seed)
        bound = gain_bound(error, enough=tolerance) if sampled <= tolerance else np.inf
        if bound <= tolerance:
            low, best = count, ReducedLft(reduced, bound, sampled)
        else:
            high = count - 1
    if best.lft is least:
        return best
    error = _error(least, best.lft)
    bound = min(best.bound, gain_bound(error))
    return replace(best, lft=cover_error(best.lft, *_weights(error, bound, seed)), bound=bound)


def gain_bound(of: Lft, *, enough: float | None = None) -> float:
    """Return a bound of the largest singular value of [A B; C D] over all Δ.

    Parameters
    ----------
    of : Lft
        With or without states.
    enough : float, optional
        A bound that suffices: one below it is not improved.

    Returns
    -------
    float
        From the skewed µ with scalings; infinite if these do not show that the transformation
        exists for all Δ.
    """
    least = minimal(of)
    bound = _gain_bound(_contract(least), enough)
    return bound if np.isfinite(bound) else _gain_bound(least, enough)


def _gain_bound(of: Lft, enough: float | None) -> float:
    m11, m12, m21, m22 = of.parts()
    if not of.uncertainties or not m22.size:
        return float(np.linalg.norm(m22, 2)) if m22.size else 0.0
    p, m = m22.shape
    size = _sample_gain(of, 0) or float(max(np.abs(m21).max(), np.abs(m12).max()))
    # performance is a full block from the outputs to the inputs
    root = np.sqrt(size)
    matrix = np.block([[m11, m12 / root], [m21 / root, m22 / size]]).astype(complex)
    structure = BlockStructure([*of.blocks, full(m, p)])
    target = None if enough is None else enough / size
    bound = upper_bound(matrix, structure, skewed=[len(structure.blocks) - 1], target=target)
    return size * bound.value


def _weights(error: Lft, bound: float, seed: int) -> tuple[Array, Array]:
    """Return L and R that cover an error whose largest singular value is at most the bound.

    In units in which all rows and columns are about equally wrong, the cover is tighter than the
    bound times the identity wherever entries of the matrix have very different sizes.
    """
    _, m12, m21, m22 = error.parts()
    largest = np.abs(_sample(error, seed)).max(axis=0)
    # what the error may reach counts, though no sample has shown it
    reached = np.outer(
        np.abs(np.hstack([m21, m22])).any(axis=1), np.abs(np.vstack([m12, m22])).any(axis=0)
    )
    largest = np.where(reached, np.maximum(largest, _UNSEEN * largest.max()), 0.0)
    by_row, by_column = entry_sizes(largest)
    rows, columns = by_row > 0.0, by_column > 0.0
    d, (out, into) = error.system.d.copy(), error.closed_channels
    d[out:][rows] /= by_row[rows, None]
    d[:, into:][:, columns] /= by_column[columns]
    size = gain_bound(Lft(gain(d), error.uncertainties, error.times))
    if np.isfinite(size):
        return diagonal_weights(by_row, by_column, size)
    return diagonal_weights(rows.astype(float), columns.astype(float), bound)


def _states(of: Lft) -> tuple[Array, Array, Array, list[int]]:
    """Return A, B, C of the copies of numbers as states, and how many each number has.

    Channels of full blocks are inputs and outputs.
    """
    counts = [t for u, t in zip(of.uncertainties, of.times, strict=True) if u.kind != "full"]
    return *_split(of, _matrix(of).system.d), counts


def _split(of: Lft, matrix: Array) -> tuple[Array, Array, Array]:
    rows, columns = _places(of)
    other_rows = np.setdiff1d(np.arange(matrix.shape[0]), rows)
    other_columns = np.setdiff1d(np.arange(matrix.shape[1]), columns)
    return (
        matrix[np.ix_(rows, columns)],
        matrix[np.ix_(rows, other_columns)],
        matrix[np.ix_(other_rows, columns)],
    )


def _spans(counts: list[int]) -> list[slice]:
    ends = [int(end) for end in np.cumsum(counts)]
    return [slice(end - count, end) for end, count in zip(ends, counts, strict=True)]


def _places(of: Lft) -> tuple[Integers, Integers]:
    """Return the rows and columns of M₁₁ that belong to numbers."""
    rows: list[int] = []
    columns: list[int] = []
    row = column = 0
    for one, times in zip(of.uncertainties, of.times, strict=True):
        if one.kind != "full":
            rows += range(row, row + times)
            columns += range(column, column + times)
        row, column = row + times * one.columns, column + times * one.rows
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


def _reachable_bases(a: Array, b: Array, counts: list[int]) -> list[Array]:
    """Return orthonormal bases (nᵢ, kᵢ) of the subspaces that words of blocks reach."""
    spans = _spans(counts)
    bases = [np.zeros((count, 0)) for count in counts]
    fresh, scale = b, float(np.abs(b).max(initial=0.0))
    while True:
        added = []
        for i, span in enumerate(spans):
            there = fresh[span]
            for _ in range(2):  # once more for what rounding leaves
                there = there - bases[i] @ (bases[i].T @ there)
            u, values, _ = np.linalg.svd(there, full_matrices=False)
            new = u[:, values > _RANK * scale]
            bases[i] = np.hstack([bases[i], new])
            added.append(new)
        if not any(new.shape[1] for new in added):
            return bases
        # longer words: what the newly reached directions reach in turn
        fresh, scale = a @ np.asarray(block_diag(*added)), float(np.abs(a).max(initial=0.0))


def _equilibrate(of: Lft) -> tuple[list[float], Array, Array, Array, list[int]]:
    """Return T, one number for each number, and T⁻¹ A T, T⁻¹ B, C T in even units, and the counts.

    All other rows and columns of M are brought to one, so that what is small in its own unit alone
    is not taken for nothing. A number that does nothing beyond rounding gets zeros.
    """
    matrix = _matrix(of).system.d.copy()
    rows, columns = _places(of)
    outer_rows = np.setdiff1d(np.arange(matrix.shape[0]), rows)
    outer_columns = np.setdiff1d(np.arange(matrix.shape[1]), columns)
    counts = [t for u, t in zip(of.uncertainties, of.times, strict=True) if u.kind != "full"]
    spans = _spans(counts)
    scales = np.ones(len(counts))
    sizes = np.zeros(len(counts))
    for _ in range(_EVEN):
        matrix[outer_rows] /= _largest_norms(matrix[outer_rows], 1)[:, None]
        matrix[:, outer_columns] /= _largest_norms(matrix[:, outer_columns], 0)
        for i, span in enumerate(spans):
            into = float(
                np.abs(np.delete(matrix[rows[span]], columns[span], axis=1)).max(initial=0)
            )
            out = float(
                np.abs(np.delete(matrix[:, columns[span]], rows[span], axis=0)).max(initial=0)
            )
            sizes[i] = np.sqrt(into * out)
            if sizes[i] > 0.0:
                # a power of two that makes rows and columns of the copies equally large
                step = float(np.exp2(np.round(0.5 * np.log2(into / out))))
                scales[i] *= step
                matrix[rows[span]] /= step
                matrix[:, columns[span]] *= step
    for span, size in zip(spans, sizes, strict=True):
        if size**2 <= _NOTHING:
            matrix[rows[span]] = 0.0
            matrix[:, columns[span]] = 0.0
    return [float(scale) for scale in scales], *_split(of, matrix), counts


def _largest_norms(matrix: Array, axis: int) -> Array:
    size = np.abs(matrix).max(axis=axis, initial=0.0)
    return np.asarray(np.where(size > 0.0, size, 1.0))


def _project(of: Lft, left: list[Array], right: list[Array]) -> Lft:
    """Return the LFT whose numbers have the states x̃ᵢ = Lᵢᵀ xᵢ, xᵢ ≈ Rᵢ x̃ᵢ."""
    m11, m12, m21, _ = of.parts()
    out: list[Array] = []
    into: list[Array] = []
    counts: dict[str, int] = {}
    i = 0
    for one, times in zip(of.uncertainties, of.times, strict=True):
        if one.kind == "full":
            out.append(np.eye(times * one.columns))
            into.append(np.eye(times * one.rows))
            counts[one.name] = times
        else:
            out.append(left[i])
            into.append(right[i])
            counts[one.name] = left[i].shape[1]
            i += 1
    if not out:
        return of
    to, back = np.asarray(block_diag(*out)).T, np.asarray(block_diag(*into))
    return of.with_parts(to @ m11 @ back, to @ m12, m21 @ back, counts)


def _balancing(of: Lft) -> tuple[list[Array], list[Array], list[Array]]:
    """Return Lᵢ, Rᵢ that balance the Gramians, and their singular values, falling."""
    a, b, c, counts = _states(of)
    spans = _spans(counts)
    y, z = _gramian(a, b, spans), _gramian(a.T, c.T, spans)
    left, right, values = [], [], []
    for span in spans:
        root_y, root_z = _root(y[span, span]), _root(z[span, span])
        # square-root balancing: Z = Rz Rzᵀ, Y = Ry Ryᵀ, singular values of Rzᵀ Ry
        u, s, vt = np.linalg.svd(root_z.T @ root_y)
        safe = np.maximum(s, 1e-300)
        left.append(root_z @ u / np.sqrt(safe))
        right.append(root_y @ vt.T / np.sqrt(safe))
        values.append(s)
    return left, right, values


def _gramian(a: Array, b: Array, spans: list[slice]) -> Array:
    """Sum words of blocks; longer words count less where the sum would not converge."""
    same = np.zeros_like(a)
    for span in spans:
        same[span, span] = 1.0
    first = same * (b @ b.T)
    if not first.any():
        return first
    growth, term = 0.0, first / np.trace(first)
    for _ in range(_GROWTH_STEPS):
        term = same * (a @ term @ a.T)
        growth = float(np.trace(term))
        if growth <= 0.0:
            break
        term = term / growth
    shrink = min(1.0, _FADING / growth) if growth > 0.0 else 1.0
    total, term = first.copy(), first
    for _ in range(_MOST_STEPS):
        term = shrink * same * (a @ term @ a.T)
        total += term
        if np.trace(term) <= 1e-12 * np.trace(total):
            break
    return total


def _contract(of: Lft) -> Lft:
    """Return the LFT in coordinates that make M₁₁ contract, where words of blocks fade away.

    With k blocks, D of the Gramians of √k M has M₁₁ᵀ D M₁₁ < D: a first scaling that proves that
    the transformation exists.
    """
    a, _, c, counts = _states(of)
    k = len(counts) + 1.0
    spans = _spans(counts)
    scale = max(float(np.abs(c).max(initial=0.0)), 1e-300)
    floor = _FLOOR * scale
    d = _gramian(np.sqrt(k) * a.T, np.hstack([np.sqrt(k) * c.T, floor * np.eye(len(a))]), spans)
    left, right = [], []
    for span in spans:
        values, vectors = np.linalg.eigh(d[span, span])
        root = np.sqrt(np.maximum(values, floor**2))
        left.append(vectors * root)
        right.append(vectors / root)
    return _project(of, left, right)


def _root(y: Array) -> Array:
    values, vectors = np.linalg.eigh(0.5 * (y + y.T))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _error(one: Lft, other: Lft) -> Lft:
    """Return the difference of the matrices [A B; C D]."""
    return _matrix(one) - _matrix(other)


def _matrix(of: Lft) -> Lft:
    m11, m12, m21, m22 = of.parts()
    return Lft(gain(np.block([[m11, m12], [m21, m22]])), of.uncertainties, of.times)


def _sample_gain(of: Lft, seed: int) -> float:
    """Return the largest singular value of a matrix at random Δ, those at the bounds as well."""
    gains = _sample(of, seed)
    return float(np.linalg.norm(gains, 2, axis=(1, 2)).max()) if gains.size else 0.0


def _sample(of: Lft, seed: int) -> NDArray[np.complex128]:
    """Return values (N, p, m) of a matrix at random Δ, half of them with bounds of parameters."""
    values = random_values(of.uncertainties, _SAMPLES, seed=seed)
    random = np.random.default_rng(seed + 1)
    for one in of.uncertainties:
        if one.kind == "real":
            ends = random.choice([one.lower, one.upper], _SAMPLES // 2)
            values[one.name][: _SAMPLES // 2] = ends
    m11, m12, m21, m22 = (part.astype(complex) for part in of.parts())
    return evaluate_upper_lft(m11, m12, m21, m22, of.deltas(values))
