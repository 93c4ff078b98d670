"""Frequency responses of one system at many frequencies, fast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import schur

from hillsphere.interfaces import Array

__all__ = ["Response", "largest_gains"]

Complex = NDArray[np.complex128]

_CONDITION = 1e4
"""Of eigenvectors: beyond it, four of sixteen digits are lost, and the Schur form is used."""


class Response:
    """C (s I − A)⁻¹ B + D of one system.

    With well-conditioned eigenvectors, A = V Λ V⁻¹, a frequency costs two products. Otherwise it
    costs a substitution with the complex Schur form A = Z T Zᴴ, row by row for all of them at once.

    Parameters
    ----------
    a, b, c, d : ndarray, shape (n, n), (n, m), (p, n), (p, m)
        Matrices, real or complex.

    Attributes
    ----------
    poles : ndarray, shape (n,)
        Eigenvalues of A.
    """

    def __init__(self, a: Array, b: Array, c: Array, d: Array) -> None:
        poles, vectors = np.linalg.eig(a) if len(a) else (np.zeros(0), np.zeros((0, 0)))
        self._by(a, b, c, d, poles, vectors, _inverse(vectors))

    @classmethod
    def of_many(cls, a: Array, b: Array, c: Array, d: Array) -> list[Response]:
        """Return the responses of systems of one size, matrices (J, n, n) to (J, p, m)."""
        try:
            poles, vectors = np.linalg.eig(a)
            inverse = np.linalg.inv(vectors)
        except np.linalg.LinAlgError:
            return [cls(*one) for one in zip(a, b, c, d, strict=True)]
        size = np.sum(inverse.real**2 + inverse.imag**2, axis=(1, 2)) * a.shape[1]
        made = []
        for j, good in enumerate((size < _CONDITION**2).tolist()):
            response = cls.__new__(cls)
            known = inverse[j] if good else None
            response._by(a[j], b[j], c[j], d[j], poles[j], vectors[j], known)
            made.append(response)
        return made

    def _by(
        self,
        a: Array,
        b: Array,
        c: Array,
        d: Array,
        poles: Array | Complex,
        vectors: Array | Complex,
        inverse: Array | Complex | None,
    ) -> None:
        """Take the system with its poles, its eigenvectors, and their inverse if it is good."""
        self._d = np.asarray(d)
        self._t: Complex | None = None
        if inverse is None:
            self._t, vectors = schur(a, output="complex")
            poles, inverse = np.diagonal(self._t), vectors.conj().T
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
            made = self._seen(self._solved(s, self._b[:, None, :]))
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
        s = 1j * omega
        if self._t is None:
            one = 1.0 / (s[:, None] - self.poles)
            two = one * one
            made = self._by_modes(np.concatenate([one, -1j * two, -2.0 * two * one]))
            g, first, second = made.reshape(3, omega.size, *made.shape[1:])
        else:
            x = self._solved(s, self._b[:, None, :])
            y = self._solved(s, x)
            g, first = self._seen(x), -1j * self._seen(y)
            second = -2.0 * self._seen(self._solved(s, y))
        return g + self._d, first, second

    def _by_modes(self, weights: Complex) -> Complex:
        """Return C V diag(w) V⁻¹ B for weights (K, n)."""
        count, (p, n) = len(weights), self._c.shape
        rows = (weights[:, None, :] * self._c).reshape(count * p, n)
        return np.asarray((rows @ self._b).reshape(count, p, self._b.shape[1]))

    def _solved(self, s: Complex, right: Complex) -> Complex:
        """Return (s I − T)⁻¹ times what stands on the right, (n, K or 1, m), as (n, K, m)."""
        assert self._t is not None
        n, m = self._b.shape
        count = s.size
        x = np.empty((n, count, m), dtype=complex)
        for i in range(n - 1, -1, -1):
            above = self._t[i, i + 1 :] @ x[i + 1 :].reshape(n - 1 - i, count * m)
            x[i] = (above.reshape(count, m) + right[i]) / (s - self._t[i, i])[:, None]
        return x

    def _seen(self, x: Complex) -> Complex:
        n, count, m = x.shape
        return (self._c @ x.reshape(n, count * m)).reshape(-1, count, m).transpose(1, 0, 2)


def _inverse(vectors: Array | Complex) -> Array | Complex | None:
    """Return the inverse of eigenvectors of length one; None if it would cost digits."""
    try:
        found = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        return None
    size = float(np.sum(np.abs(found) ** 2))
    return found if size * len(vectors) < _CONDITION**2 else None


def largest_gains(responses: Complex) -> Array:
    """Return the largest singular values (K,) of matrices (K, p, m)."""
    p, m = responses.shape[1:]
    if p == 0 or m == 0:
        return np.zeros(len(responses))
    if min(p, m) == 1:
        return np.asarray(np.sqrt(np.sum(np.abs(responses) ** 2, axis=(1, 2))))
    return np.asarray(np.linalg.svd(responses, compute_uv=False)[:, 0])
