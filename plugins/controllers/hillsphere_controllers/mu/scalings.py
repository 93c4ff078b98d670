r"""Scalings D and G of a block structure, and the barrier of the scalings that prove a bound of µ.

For matrices M₁ … M_K the scalings prove β where, for every one of them,

.. math::

    F = L D - M^\mathsf{H} D M - j (G M - M^\mathsf{H} G) \succ 0, \qquad L = \beta^2 I;

in a skewed problem L is β² on some blocks and one on the others. Gradient and Hessian of the
barrier −Σ log det F − log det D need only Z = F⁻¹, Y = M Z and R = Y Mᴴ, entry by entry.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.sparse import csr_array

from hillsphere.interfaces import Array, Integers
from hillsphere_controllers.mu.blocks import BlockStructure

__all__ = ["Basis", "Scalings", "dg_form", "level"]

Complex = NDArray[np.complex128]

_OSBORNE = 30
"""Sweeps of Osborne's iteration at most. It only gives the coordinates of the optimisation: a few
per cent suffice."""
_ROUNDING = 8.0 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Scalings:
    """Scalings of a squared matrix.

    Parameters
    ----------
    d, g : ndarray, shape (n, n)
        Hermitian, D positive.
    """

    d: Complex
    g: Complex


def dg_form(m: Complex, d: Complex, g: Complex) -> Complex:
    """Return Mᴴ D M + j (G M − Mᴴ G) of matrices (..., n, n)."""
    gm = g @ m
    mh = m.conj().swapaxes(-1, -2)
    return np.asarray(mh @ d @ m + 1j * (gm - gm.conj().swapaxes(-1, -2)))


def level(m: Complex, d: Complex, g: Complex, free: NDArray[np.bool_], fixed: float) -> float:
    """Return the least β² that scalings prove for all of some matrices.

    What rounding can have added to the smallest eigenvalue of F is counted against the bound, which
    matters where G is large.

    Parameters
    ----------
    m : ndarray, shape (K, n, n)
        The matrices.
    d, g : ndarray, shape (n, n)
        Scalings.
    free : ndarray of bool, shape (n,)
        Indices whose level is β².
    fixed : float
        The level of the others.

    Returns
    -------
    float
        β², which may be negative; infinite if the fixed part alone rules out every β.
    """
    try:
        # D = K Kᴴ; with X = Kᴴ M K⁻ᴴ and Ĝ = K⁻¹ G K⁻ᴴ, F ≥ 0 is β² ≥ λ_max(Xᴴ X + j(Ĝ X − Xᴴ Ĝ))
        root = np.linalg.cholesky(d)
    except np.linalg.LinAlgError:
        return np.inf
    n = len(d)
    inverse = solve_triangular(root, np.eye(n), lower=True, check_finite=False)
    scaled_g = inverse @ g @ inverse.conj().T
    worst = -np.inf
    for one in m:
        x = root.conj().T @ one @ inverse.conj().T
        gx = scaled_g @ x
        right = x.conj().T @ x + 1j * (gx - gx.conj().T)
        # error of the smallest eigenvalue of F by rounding, counted against the bound
        guard = _ROUNDING * n * float(np.linalg.norm(gx) + np.linalg.norm(x) ** 2)
        if not free.all():
            kept = ~free
            # skewed problem: Schur complement of the blocks with a fixed level
            inner = fixed * np.eye(int(kept.sum())) - right[np.ix_(kept, kept)]
            if np.linalg.eigvalsh(inner)[0] <= guard:
                return np.inf
            side = right[np.ix_(kept, free)]
            right = right[np.ix_(free, free)] + side.conj().T @ np.linalg.solve(inner, side)
        worst = max(worst, float(np.linalg.eigvalsh(right)[-1]) + guard)
    return worst


class Basis:
    """Free real parameters of D and G, entry by entry.

    Entry p of D or G is the place (k, l). Each real parameter is the real or imaginary part of an
    entry and its mirror image, or the common value of the diagonal of a full block.

    Parameters
    ----------
    structure : BlockStructure
        With n indices and so many blocks.
    free : ndarray of bool, shape (n,)
        Indices whose level is β².
    fixed : float
        The level of the others.

    Attributes
    ----------
    trace : ndarray, shape (k,)
        Trace of D is its product with the parameters.
    of_g : ndarray of bool, shape (k,)
        Which parameters are those of G.
    """

    def __init__(self, structure: BlockStructure, free: NDArray[np.bool_], fixed: float) -> None:
        self.n = structure.size
        self.free, self.fixed = free, fixed
        rows: list[int] = []
        columns: list[int] = []
        into: list[list[tuple[int, complex]]] = []  # of each parameter: entries and weights
        self._spans = structure.spans()

        def entry(row: int, column: int) -> int:
            rows.append(row)
            columns.append(column)
            return len(rows) - 1

        def hermitian(span: slice) -> None:
            for k in range(span.start, span.stop):
                into.append([(entry(k, k), 1.0)])
                for j in range(k + 1, span.stop):
                    up, low = entry(k, j), entry(j, k)
                    into.append([(up, 1.0), (low, 1.0)])
                    into.append([(up, 1j), (low, -1j)])

        for span, block in zip(self._spans, structure.blocks, strict=True):
            if block.kind == "full":
                into.append([(entry(k, k), 1.0) for k in range(span.start, span.stop)])
            else:
                # D commutes with δ I: any Hermitian matrix; with a full block only d I
                hermitian(span)
        of_d = len(rows)
        for span, block in zip(self._spans, structure.blocks, strict=True):
            if block.kind == "real":
                # G exists for real blocks only
                hermitian(span)
        self.rows: Integers = np.array(rows)
        self.columns: Integers = np.array(columns)
        self.split = of_d
        self.map = np.zeros((len(rows), len(into)), dtype=complex)
        for j, entries in enumerate(into):
            for p, weight in entries:
                self.map[p, j] = weight
        # Each parameter has few entries: dense products with the map would take most of the time.
        self._to_parameters = csr_array(self.map.T)
        k, m = self.rows, self.columns
        d, g = slice(0, of_d), slice(of_d, None)
        self._pairs = tuple(
            _Pairs.of(self.n, k[i], m[i], k[j], m[j]) for i, j in ((d, d), (d, g), (g, g))
        )
        diagonal = (self.rows == self.columns) & (np.arange(len(rows)) < of_d)
        self.trace: Array = self.map[diagonal].sum(axis=0).real
        first = np.argmax(np.abs(self.map), axis=0)
        self._at = self.rows[first], self.columns[first]
        self.of_g: NDArray[np.bool_] = first >= of_d

    def at(self, fixed: float) -> Basis:
        """Return the same parameters with another level of the indices that are not free."""
        other = copy(self)
        other.fixed = fixed
        return other

    def levels(self, b: float) -> Array:
        """Return the diagonal (n,) of L for a level b."""
        return np.where(self.free, b, self.fixed)

    def matrices(self, x: Array) -> tuple[Complex, Complex]:
        """Return D and G."""
        entries = self.map @ x
        d, g = np.zeros((2, self.n, self.n), dtype=complex)
        s = self.split
        d[self.rows[:s], self.columns[:s]] = entries[:s]
        g[self.rows[s:], self.columns[s:]] = entries[s:]
        return d, g

    def parameters(self, d: Complex, g: Complex) -> Array:
        """Return the parameters nearest to some D and G."""
        s = self.split
        entries = np.concatenate(
            [d[self.rows[:s], self.columns[:s]], g[self.rows[s:], self.columns[s:]]]
        )
        weight = np.sum(np.abs(self.map) ** 2, axis=0)
        return np.asarray((self.map.conj().T @ entries).real / weight)

    def units(self, x: Array) -> Array:
        """Return the size (k,) of each parameter where D has so large entries."""
        d = np.diagonal(self.matrices(x)[0]).real
        return np.asarray(np.sqrt(d[self._at[0]] * d[self._at[1]]))

    def osborne(self, m: Complex) -> Complex:
        """Return D of scalars that make the blocks' rows and columns of √D M √D⁻¹ alike."""
        squares = np.sum(np.abs(m) ** 2, axis=0)
        starts = [span.start for span in self._spans]
        weight = np.add.reduceat(np.add.reduceat(squares, starts, axis=0), starts, axis=1)
        np.fill_diagonal(weight, 0.0)
        d = np.ones(len(self._spans))
        for _ in range(_OSBORNE):
            before = d.copy()
            for i in range(d.size):
                # Osborne (1960): the d that makes row and column norms equal, one block after the
                # other
                row, column = d[i] * (weight[i] / d).sum(), (weight[:, i] * d).sum() / d[i]
                if row > 1e-30 and column > 1e-30:
                    d[i] = np.clip(d[i] * np.sqrt(column / row), 1e-8, 1e8)
            if np.abs(d / before - 1.0).max() < 1e-2:
                break
        sizes = [span.stop - span.start for span in self._spans]
        whole = np.repeat(d, sizes)
        return np.diag(whole * (self.n / whole.sum())).astype(complex)

    def potential(self, m: Complex, x: Array, b: float) -> float:
        """Return −Σ log det F − log det D, infinite where one is not positive."""
        d, g = self.matrices(x)
        try:
            low_d = np.linalg.cholesky(d)
            low_f = np.linalg.cholesky(self._form(m, d, g, b))
        except np.linalg.LinAlgError:
            return np.inf
        whole = np.log(np.diagonal(low_d).real).sum()
        whole += np.log(np.diagonal(low_f, axis1=1, axis2=2).real).sum()
        return -2.0 * float(whole)

    def _form(self, m: Complex, d: Complex, g: Complex, b: float) -> Complex:
        return np.asarray(self.levels(b)[:, None] * d - dg_form(m, d, g))

    def derivatives(self, m: Complex, x: Array, b: float) -> tuple[Array, Array]:
        """Return gradient (k,) and Hessian (k, k) of the potential."""
        d, g = self.matrices(x)
        one = np.eye(self.n)
        s = self.split
        kd, kg = self.rows[:s], self.rows[s:]
        ld, lg = self.columns[:s], self.columns[s:]
        dd, dg, gg = self._pairs
        w = cho_solve(cho_factor(d, check_finite=False), one, check_finite=False)
        first = np.zeros(self.rows.size, dtype=complex)
        second = np.zeros((self.rows.size, self.rows.size), dtype=complex)
        first[:s] = w[ld, kd]
        second[:s, :s] = dd(w, w)
        # derivatives by the entries of D first; those by the real parameters follow from the map
        of_d = self.levels(b)[kd]
        for form, matrix in zip(self._form(m, d, g, b), m, strict=True):
            z = cho_solve(cho_factor(form, check_finite=False), one, check_finite=False)
            y = matrix @ z
            yh = np.ascontiguousarray(y.conj().T)
            r = y @ matrix.conj().T
            # tr(Z dF) for the matrix unit E at (k, l): dF = L E − Mᴴ E M, and −j (E M − Mᴴ E)
            first[:s] += of_d * z[ld, kd] - r[ld, kd]
            first[s:] -= 1j * (y[lg, kg] - yh[lg, kg])
            # to exchange the factors of a pair is to transpose it
            cross = of_d[:, None] * dd(y, yh)
            second[:s, :s] += np.outer(of_d, of_d) * dd(z, z) - cross - cross.T + dd(r, r)
            if s < self.rows.size:
                zy = of_d[:, None] * (dg(y, z) - dg(z, yh))
                second[:s, s:] -= 1j * (zy - dg(r, y) + dg(yh, r))
                cross = gg(r, z)
                second[s:, s:] -= gg(y, y) + gg(yh, yh) - cross - cross.T
        second[s:, :s] = second[:s, s:].T
        # from entries to the real parameters, on which they depend linearly
        gradient = -(first @ self.map).real
        hessian = (self._to_parameters @ (self._to_parameters @ second).T).real
        return gradient, 0.5 * (hessian + hessian.T)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Products of entries for all pairs of units (a, c), in rows, and (e, f), in columns.

    Parameters
    ----------
    of_p, of_q : ndarray of int
        Places of p[f, a] and q[c, e] in matrices that lie row by row.
    """

    of_p: Integers
    of_q: Integers

    @classmethod
    def of(cls, n: int, a: Integers, c: Integers, e: Integers, f: Integers) -> _Pairs:
        """Return those of matrices of order n."""
        return cls(n * f[None, :] + a[:, None], n * c[:, None] + e[None, :])

    def __call__(self, p: Complex, q: Complex) -> Complex:
        """Return p[f, a] q[c, e]; p and q are contiguous."""
        return np.asarray(p.ravel().take(self.of_p) * q.ravel().take(self.of_q))
