r"""Upper bound of µ by scalings D and G, at one frequency.

With D > 0 and G of the structure's form (D commutes with every Δ, G is Hermitian and not zero for
real blocks only), µ(M) ≤ β wherever

.. math::

    F = β^2 D - M^\mathsf{H} D M - j (G M - M^\mathsf{H} G) \succ 0

[1]_. The least β is a generalised eigenvalue problem, solved here by the method of centres [2]_:
at the centre of the D and G that are feasible for the present β², those of least
−log det F − log det D under tr D = n, found by Newton's method, the largest generalised eigenvalue
is well below β², and gives the next one. Gradient and Hessian need only Z = F⁻¹, Y = M Z and
R = Y Mᴴ, entry by entry.

References
----------
.. [1] M. K. H. Fan, A. L. Tits, J. C. Doyle (1991), Robustness in the presence of mixed parametric
   uncertainty and unmodeled dynamics, IEEE Transactions on Automatic Control 36(1), 25-38.
.. [2] S. Boyd, L. El Ghaoui (1993), Method of centers for minimizing generalized eigenvalues,
   Linear Algebra and its Applications 188, 63-111.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, eigh

from hillsphere.interfaces import Array, Integers
from hillsphere_controllers.mu.blocks import BlockStructure

__all__ = ["Scalings", "UpperBound", "upper_bound"]

Complex = NDArray[np.complex128]

_STEP = 0.1
_DECREMENT = 0.7
_MOST_STEPS = 200
_MOST_NEWTON = 60
_OSBORNE = 30


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


@dataclass(frozen=True)
class UpperBound:
    """A bound and the scalings that prove it.

    Parameters
    ----------
    value : float
        µ is no larger.
    scalings : Scalings
        With which F is positive for every β above the value.
    """

    value: float
    scalings: Scalings


def upper_bound(
    matrix: Complex,
    structure: BlockStructure,
    *,
    start: Scalings | None = None,
    tolerance: float = 1e-6,
) -> UpperBound:
    """Return the least upper bound of µ that D and G scalings give.

    Parameters
    ----------
    matrix : ndarray, shape (p, m)
        M, complex.
    structure : BlockStructure
        Of Δ.
    start : Scalings, optional
        To begin with, such as those of a frequency nearby.
    tolerance : float
        Relative change of the bound at which it ends.

    Returns
    -------
    UpperBound
        The bound; zero for a matrix of zeros.

    Raises
    ------
    InputError
        If the matrix does not fit the structure.
    """
    squared = structure.squared(matrix)
    size = float(np.linalg.norm(squared, 2))
    n = structure.size
    if size == 0.0:
        return UpperBound(0.0, Scalings(np.eye(n, dtype=complex), np.zeros((n, n), dtype=complex)))
    m = squared / size
    basis = _Basis(structure)
    best, x = _begin(m, basis, start, size)
    level, d, g = best
    beta2 = max(1.3 * level, level + 1e-3)
    for _ in range(_MOST_STEPS):
        x = _centre(m, basis, x, beta2)
        d, g = basis.matrices(x)
        level = _level(m, d, g)
        gained = best[0] - level
        if level < best[0]:
            best = (level, d, g)
        if best[0] <= tolerance**2 or (beta2 - level) <= tolerance * abs(best[0]):
            break
        if gained <= 0.0 and beta2 - best[0] <= 10.0 * tolerance * abs(best[0]):
            break
        beta2 = level + _STEP * (beta2 - level)
    level, d, g = best
    # G grows with M's unit: F of the matrix as given has G·size
    return UpperBound(size * float(np.sqrt(max(level, 0.0))), Scalings(d, size * g))


def _level(m: Complex, d: Complex, g: Complex) -> float:
    """Return the least β² for these scalings."""
    crossed = g @ m
    right = m.conj().T @ d @ m + 1j * (crossed - crossed.conj().T)
    return float(eigh(right, d, eigvals_only=True, subset_by_index=[len(d) - 1, len(d) - 1])[0])


def _begin(
    m: Complex, basis: _Basis, start: Scalings | None, size: float
) -> tuple[tuple[float, Complex, Complex], Array]:
    """Return a level with its scalings, and the free parameters of the latter."""
    n = len(m)
    zero = np.zeros((n, n), dtype=complex)
    d = basis.osborne(m)
    found = (_level(m, d, zero), d, zero)
    if start is not None:
        d = start.d * (n / np.trace(start.d).real)
        g = start.g / size * (n / np.trace(start.d).real)
        level = _level(m, d, g)
        if level < found[0]:
            found = (level, d, g)
    return found, basis.parameters(found[1], found[2])


def _centre(m: Complex, basis: _Basis, x: Array, b: float) -> Array:
    """Return the parameters of the centre for a level b above that of x."""
    value = basis.potential(m, x, b)
    for _ in range(_MOST_NEWTON):
        gradient, hessian = basis.derivatives(m, x, b)
        # under tr D = n: the step keeps the trace
        k = len(x)
        whole = np.zeros((k + 1, k + 1))
        whole[:k, :k] = hessian
        whole[:k, k] = whole[k, :k] = basis.trace
        try:
            step = np.linalg.solve(whole, np.append(-gradient, 0.0))[:k]
        except np.linalg.LinAlgError:
            return x
        decrement = float(-gradient @ step)
        if not decrement > 0.0:
            return x
        length = 1.0 if decrement < 0.25 else 1.0 / (1.0 + np.sqrt(decrement))
        # the damped step is always inside; a longer one is tried as long as it pays
        made = _along(m, basis, x, step, b, value, length)
        if made is None:
            return x
        x, value = made
        if np.sqrt(decrement) < _DECREMENT:
            return x
    return x


def _along(
    m: Complex, basis: _Basis, x: Array, step: Array, b: float, value: float, length: float
) -> tuple[Array, float] | None:
    """Return the best of some points along a step that is better than x, None without one."""
    best: tuple[Array, float] | None = None
    while length > 1e-10:
        there = x + length * step
        new = basis.potential(m, there, b)
        if best is not None and not new < best[1]:
            return best
        if new < value:
            best = (there, new)
            length *= 2.0
        else:
            length *= 0.5
    return best


class _Basis:
    """Free real parameters of D and G, entry by entry.

    Entry p of D or G is the place (k, l). Each real parameter is the real or imaginary part of an
    entry and its mirror image, or the common value of the diagonal of a full block.
    """

    def __init__(self, structure: BlockStructure) -> None:
        self.n = structure.size
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
                hermitian(span)
        of_d = len(rows)
        for span, block in zip(self._spans, structure.blocks, strict=True):
            if block.kind == "real":
                hermitian(span)
        self.rows: Integers = np.array(rows)
        self.columns: Integers = np.array(columns)
        self.split = of_d
        self.map = np.zeros((len(rows), len(into)), dtype=complex)
        for j, entries in enumerate(into):
            for p, weight in entries:
                self.map[p, j] = weight
        diagonal = (self.rows == self.columns) & (np.arange(len(rows)) < of_d)
        self.trace: Array = self.map[diagonal].sum(axis=0).real

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

    def osborne(self, m: Complex) -> Complex:
        """Return D of scalars that make the blocks' rows and columns of √D M √D⁻¹ alike."""
        weight = np.array(
            [[np.sum(np.abs(m[a, b]) ** 2) for b in self._spans] for a in self._spans]
        )
        np.fill_diagonal(weight, 0.0)
        d = np.ones(len(self._spans))
        for _ in range(_OSBORNE):
            for i in range(d.size):
                row, column = d[i] * (weight[i] / d).sum(), (weight[:, i] * d).sum() / d[i]
                if row > 1e-30 and column > 1e-30:
                    d[i] = np.clip(d[i] * np.sqrt(column / row), 1e-8, 1e8)
        sizes = [span.stop - span.start for span in self._spans]
        whole = np.repeat(d, sizes)
        return np.diag(whole * (self.n / whole.sum())).astype(complex)

    def potential(self, m: Complex, x: Array, b: float) -> float:
        """Return −log det F − log det D, infinite where one is not positive."""
        d, g = self.matrices(x)
        try:
            low_d = np.linalg.cholesky(d)
            low_f = np.linalg.cholesky(_form(m, d, g, b))
        except np.linalg.LinAlgError:
            return np.inf
        diagonals = np.concatenate([np.diagonal(low_d).real, np.diagonal(low_f).real])
        return -2.0 * float(np.log(diagonals).sum())

    def derivatives(self, m: Complex, x: Array, b: float) -> tuple[Array, Array]:
        """Return gradient (k,) and Hessian (k, k) of the potential."""
        d, g = self.matrices(x)
        one = np.eye(self.n)
        z = cho_solve(cho_factor(_form(m, d, g, b), check_finite=False), one, check_finite=False)
        w = cho_solve(cho_factor(d, check_finite=False), one, check_finite=False)
        y = m @ z
        r = y @ m.conj().T
        s = self.split
        kd, kg = self.rows[:s], self.rows[s:]
        ld, lg = self.columns[:s], self.columns[s:]
        # tr(Z dF) for the matrix unit at (k, l): dF = b E − Mᴴ E M, and −j(E M − Mᴴ E)
        first = np.concatenate(
            [
                b * z[ld, kd] - r[ld, kd] + w[ld, kd],
                -1j * (y[lg, kg] - y.conj().T[lg, kg]),
            ]
        )
        gradient = -(first @ self.map).real

        def pair(
            p: Complex, q: Complex, a: Integers, c: Integers, e: Integers, f: Integers
        ) -> Complex:
            """Return p[f, a] q[c, e] for units (a, c) in rows and (e, f) in columns."""
            return np.asarray(p[f[None, :], a[:, None]] * q[c[:, None], e[None, :]])

        yh = y.conj().T
        second = np.empty((self.rows.size, self.rows.size), dtype=complex)
        second[:s, :s] = (
            b * b * pair(z, z, kd, ld, kd, ld)
            - b * pair(y, yh, kd, ld, kd, ld)
            - b * pair(yh, y, kd, ld, kd, ld)
            + pair(r, r, kd, ld, kd, ld)
            + pair(w, w, kd, ld, kd, ld)
        )
        if s < self.rows.size:
            # tr(Z dF_D Z dF_G), dF_G = −j(E M − Mᴴ E)
            zy = b * (pair(y, z, kd, ld, kg, lg) - pair(z, yh, kd, ld, kg, lg))
            ry = pair(r, y, kd, ld, kg, lg) - pair(yh, r, kd, ld, kg, lg)
            second[:s, s:] = -1j * (zy - ry)
            second[s:, :s] = second[:s, s:].T
            second[s:, s:] = -(
                pair(y, y, kg, lg, kg, lg)
                + pair(yh, yh, kg, lg, kg, lg)
                - pair(r, z, kg, lg, kg, lg)
                - pair(z, r, kg, lg, kg, lg)
            )
        hessian = (self.map.T @ second @ self.map).real
        return gradient, 0.5 * (hessian + hessian.T)


def _form(m: Complex, d: Complex, g: Complex, b: float) -> Complex:
    crossed = g @ m
    return np.asarray(b * d - m.conj().T @ d @ m - 1j * (crossed - crossed.conj().T))
