"""Frequency responses of one system at many frequencies, by its Schur form or its modes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import schur
from scipy.linalg.lapack import dgebal, dgeev, zgetrf, zgetri

from hillsphere.interfaces import Array

__all__ = ["Response", "largest_gains", "squared_gains"]

Complex = NDArray[np.complex128]

_CONDITION = 1e4
"""Of eigenvectors: beyond it, four of sixteen digits are lost, and the Schur form is used."""


class Response:
    """C (s I − A)⁻¹ B + D of one system.

    A frequency costs a substitution with the complex Schur form A = Z T Zᴴ, row by row for all of
    them at once. By modes, A = V Λ V⁻¹, it costs two products, if V is well conditioned: where the
    response is large it is as accurate; where modes cancel each other it is not.

    Parameters
    ----------
    a, b, c, d : ndarray, shape (n, n), (n, m), (p, n), (p, m)
        Matrices, real or complex.
    modes : bool
        Whether it may be found by modes; the matrices are real then.

    Attributes
    ----------
    poles : ndarray, shape (n,)
        Eigenvalues of A.
    """

    def __init__(self, a: Array, b: Array, c: Array, d: Array, *, modes: bool = False) -> None:
        self._take(a, b, c, d, _modes_of_one(a) if modes and len(a) else None)

    @classmethod
    def of_many(cls, a: Array, b: Array, c: Array, d: Array) -> list[Response]:
        """Return the responses, by modes, of J systems of one size, (J, n, n) to (J, p, m)."""
        made = []
        for j, modes in enumerate(_modes(a)):
            response = cls.__new__(cls)
            response._take(a[j], b[j], c[j], d[j], modes)
            made.append(response)
        return made

    def _take(
        self, a: Array, b: Array, c: Array, d: Array, modes: tuple[Array, Array, Array] | None
    ) -> None:
        self._d = np.asarray(d)
        self._t: Complex | None = None
        if modes is None:
            none: Complex = np.zeros((0, 0), dtype=complex)
            self._t, vectors = schur(a, output="complex") if len(a) else (none, none)
            poles, inverse = np.diagonal(self._t), vectors.conj().T
        else:
            poles, vectors, inverse = modes
        self.poles: Complex = poles.astype(complex)
        self._b: Complex = (inverse @ b).astype(complex)
        self._c: Complex = (c @ vectors).astype(complex)

    @property
    def by_modes(self) -> bool:
        """Whether it is computed by modes."""
        return self._t is None

    def __call__(self, s: Complex) -> Complex:
        """Return the responses.

        Parameters
        ----------
        s : ndarray, shape (K,)
            Finite, no poles.

        Returns
        -------
        ndarray, shape (K, p, m)
            One matrix per s.
        """
        if self._t is None:
            made = self._by_modes(1.0 / (s[:, None] - self.poles))
        else:
            made = self._apply_output(self._solve_shifted(s, self._b[:, None, :]))
        return np.asarray(made + self._d)

    def derivatives(self, omega: Array) -> tuple[Complex, Complex, Complex]:
        """Return the responses at s = jω, and their first and second derivatives by ω.

        Parameters
        ----------
        omega : ndarray, shape (K,)
            Frequencies, rad/s.

        Returns
        -------
        tuple of ndarray, shape (K, p, m)
            Three times one matrix per frequency.
        """
        s = (1j * omega).astype(complex)
        if self._t is None:
            one = 1.0 / (s[:, None] - self.poles)
            # derivatives of 1/(jω − λ): −j/(jω − λ)² and −2/(jω − λ)³
            two = one * one
            made = self._by_modes(np.concatenate([one, -1j * two, -2.0 * two * one]))
            g, first, second = made.reshape(3, omega.size, *made.shape[1:])
        else:
            x = self._solve_shifted(s, self._b[:, None, :])
            y = self._solve_shifted(s, x)
            g, first = self._apply_output(x), -1j * self._apply_output(y)
            second = -2.0 * self._apply_output(self._solve_shifted(s, y))
        return g + self._d, first, second

    def _by_modes(self, weights: Complex) -> Complex:
        """Return C V diag(w) V⁻¹ B for weights (K, n)."""
        count, (p, n) = len(weights), self._c.shape
        rows = (weights[:, None, :] * self._c).reshape(count * p, n)
        return np.asarray((rows @ self._b).reshape(count, p, self._b.shape[1]))

    def _solve_shifted(self, s: Complex, right: Complex) -> Complex:
        """Return the solution (n, K, m) of (s I − T) x = right side, (n, K or 1, m)."""
        assert self._t is not None
        n, m = self._b.shape
        count = s.size
        x = np.empty((n, count, m), dtype=complex)
        # back substitution with T, one row for all frequencies and inputs at once
        for i in range(n - 1, -1, -1):
            above = self._t[i, i + 1 :] @ x[i + 1 :].reshape(n - 1 - i, count * m)
            x[i] = (above.reshape(count, m) + right[i]) / (s - self._t[i, i])[:, None]
        return x

    def _apply_output(self, x: Complex) -> Complex:
        n, count, m = x.shape
        return (self._c @ x.reshape(n, count * m)).reshape(-1, count, m).transpose(1, 0, 2)


def _modes(a: Array) -> list[tuple[Array, Array, Array] | None]:
    """Return Λ (n,), V, V⁻¹ of real matrices (J, n, n); None where they would cost digits."""
    if not a.shape[-1]:
        return [None] * len(a)
    try:
        poles, vectors = np.linalg.eig(a)
        inverse = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        return [None] * len(a) if len(a) == 1 else [m for one in a for m in _modes(one[None])]
    scale = np.array([dgebal(one, scale=1, permute=0)[3] for one in a])
    good = _are_well_conditioned(vectors, inverse, scale)
    each = zip(poles, vectors, inverse, strict=True)
    return [modes if well else None for modes, well in zip(each, good.tolist(), strict=True)]


def _modes_of_one(a: Array) -> tuple[Array, Array, Array] | None:
    """Return the same of one matrix (n, n), by LAPACK without NumPy's wrappers, which cost more."""
    real, imaginary, _, packed, failed = dgeev(a, compute_vl=0)
    poles, vectors = real + 1j * imaginary, packed.astype(complex)
    # of a pair the two columns hold the real and the imaginary part
    pair = np.flatnonzero(imaginary > 0.0)
    if pair.size:
        vectors[:, pair] += 1j * packed[:, pair + 1]
        vectors[:, pair + 1] = vectors[:, pair].conj()
    factors, swaps, singular = zgetrf(vectors)
    if failed or singular:
        return None
    inverse, _ = zgetri(factors, swaps)
    scale = dgebal(a, scale=1, permute=0)[3]
    return (poles, vectors, inverse) if _are_well_conditioned(vectors, inverse, scale) else None


def _are_well_conditioned(vectors: Array, inverse: Array, scale: Array) -> NDArray[np.bool_]:
    """Return whether eigenvectors (..., n, n) cost few digits."""
    # of the balanced matrix and columns of length one: states of another scale cost no digits
    columns = np.sum(np.abs(vectors / scale[..., :, None]) ** 2, axis=-2)
    with np.errstate(over="ignore", invalid="ignore"):
        rows = np.sum(np.abs(inverse * scale[..., None, :]) ** 2, axis=-1)
        made = vectors.shape[-1] * np.sum(rows * columns, axis=-1) < _CONDITION**2
    return np.asarray(made)


def squared_gains(responses: Complex) -> Array:
    """Return the squares of the largest singular values (K,) of matrices (K, p, m).

    The largest eigenvalue of Gᴴ G or G Gᴴ, whichever is smaller; in closed form up to two by two.
    It has all its digits but the last, and is faster than the singular values.

    Parameters
    ----------
    responses : ndarray, shape (K, p, m)
        Frequency responses, complex, of which the squares are in range.

    Returns
    -------
    ndarray, shape (K,)
        The squares.
    """
    p, m = responses.shape[1:]
    columns = responses if m <= p else responses.swapaxes(1, 2)
    if min(p, m) > 2:
        return np.asarray(np.linalg.eigvalsh(columns.conj().swapaxes(1, 2) @ columns)[:, -1])
    sizes = columns.real**2 + columns.imag**2
    squares = sizes.sum(axis=1)
    if min(p, m) < 2:
        return np.asarray(squares.sum(axis=1))
    one, other = squares[:, 0], squares[:, 1]
    across = np.abs(np.einsum("ki,ki->k", columns[:, :, 0].conj(), columns[:, :, 1]))
    return np.asarray(0.5 * (one + other) + np.hypot(0.5 * (one - other), across))


def largest_gains(responses: Complex) -> Array:
    """Return the largest singular values (K,) of matrices (K, p, m).

    Parameters
    ----------
    responses : ndarray, shape (K, p, m)
        Frequency responses, complex.

    Returns
    -------
    ndarray, shape (K,)
        The largest singular value of each.
    """
    p, m = responses.shape[1:]
    if p == 0 or m == 0:
        return np.zeros(len(responses))
    if min(p, m) == 1:
        return np.asarray(np.sqrt(np.sum(np.abs(responses) ** 2, axis=(1, 2))))
    return np.asarray(np.linalg.svd(responses, compute_uv=False)[:, 0])
