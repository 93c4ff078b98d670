"""Frequency responses of one system at many frequencies, by its Schur form or its modes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import schur
from scipy.linalg.lapack import dgebal

from hillsphere.interfaces import Array

__all__ = ["Response", "largest_gains"]

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
        self._take(a, b, c, d, _modes(a[None])[0] if modes and len(a) else None)

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
    # of the balanced matrix and columns of length one: states of another scale cost no digits
    scale = np.array([dgebal(one, scale=1, permute=0)[3] for one in a])
    columns = np.sum(np.abs(vectors / scale[:, :, None]) ** 2, axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        rows = np.sum(np.abs(inverse * scale[:, None, :]) ** 2, axis=2)
        good = a.shape[-1] * np.sum(rows * columns, axis=1) < _CONDITION**2
    each = zip(poles, vectors, inverse, strict=True)
    return [modes if well else None for modes, well in zip(each, good.tolist(), strict=True)]


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
