"""Frequency responses of one system at many frequencies, fast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import schur

from hillsphere.interfaces import Array

__all__ = ["Response", "largest_gains"]

Complex = NDArray[np.complex128]


class Response:
    """C (s I − A)⁻¹ B + D by one complex Schur form A = Z T Zᴴ.

    Each frequency then costs a triangular substitution, done row by row for all of them at once.

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
        self._d = np.asarray(d)
        n = len(a)
        none: Complex = np.zeros((0, 0), dtype=complex)
        t, z = schur(a, output="complex") if n else (none, none)
        self._t: Complex = t
        self._b, self._c = z.conj().T @ b, c @ z
        self.poles: Complex = np.diagonal(self._t).astype(complex)

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
        n, m = self._b.shape
        count = s.size
        x = np.empty((n, count, m), dtype=complex)
        for i in range(n - 1, -1, -1):
            right = self._t[i, i + 1 :] @ x[i + 1 :].reshape(n - 1 - i, count * m)
            x[i] = (right.reshape(count, m) + self._b[i]) / (s - self._t[i, i])[:, None]
        made = (self._c @ x.reshape(n, count * m)).reshape(-1, count, m).transpose(1, 0, 2)
        return np.asarray(made + self._d)


def largest_gains(responses: Complex) -> Array:
    """Return the largest singular values (K,) of matrices (K, p, m)."""
    p, m = responses.shape[1:]
    if p == 0 or m == 0:
        return np.zeros(len(responses))
    if min(p, m) == 1:
        return np.asarray(np.sqrt(np.sum(np.abs(responses) ** 2, axis=(1, 2))))
    return np.asarray(np.linalg.svd(responses, compute_uv=False)[:, 0])
