r"""Solid harmonics as compiled functions, and how their series are differentiated.

With the associated Legendre functions :math:`P_n^m` without the phase of Condon and Shortley,

.. math::

    R_n^m = \frac{\rho^n P_n^m(\sin\varphi)\,e^{im\lambda}}{(n+m)!}, \qquad
    I_n^m = \frac{(n-m)!\,P_n^m(\sin\varphi)\,e^{im\lambda}}{\rho^{n+1}}, \qquad
    \frac1{|\rho-y|} = \sum_{n\ge0}\sum_{|m|\le n} \overline{R_n^m(y)}\,I_n^m(\rho),

where :math:`F_n^{-m} = (-1)^m\,\overline{F_n^m}`. In this normalisation every derivative is one or
two harmonics of the next degree, with factors of one [1]_.

References
----------
.. [1] M. A. Epton, B. Dembart (1995), Multipole translation theory for the three-dimensional
   Laplace and Helmholtz equations, SIAM Journal on Scientific Computing 16(4), 865-897.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from hillsphere.dynamics import ArrayFunction
from hillsphere.interfaces import Array
from hillsphere.symbolic import Expr, sqrt, variable

__all__ = [
    "Complex",
    "differentiate_irregular",
    "differentiate_regular",
    "irregular_harmonics",
    "pack",
    "regular_harmonics",
    "unpack",
]

Complex = NDArray[np.complex128]

_COMPACT_FROM = 24
"""Degree from which the code is compiled in compact mode: the compilation takes seconds there, and
the functions are limited by memory, so that they are no slower."""


@cache
def irregular_harmonics(degree: int) -> ArrayFunction:
    """Return the function of points (3, N) whose rows are the I up to a degree, see `pack`."""
    x, y, z = place = [variable(name) for name in "xyz"]
    inverse = 1.0 / (x * x + y * y + z * z)
    x, y, z = x * inverse, y * inverse, z * inverse
    real: dict[tuple[int, int], Expr] = {(0, 0): sqrt(inverse)}
    imaginary: dict[tuple[int, int], Expr] = {}
    for m in range(degree + 1):
        if m:
            _step_order(real, imaginary, m, (2.0 * m - 1.0) * x, (2.0 * m - 1.0) * y)
        for n in range(m + 1, degree + 1):
            for part in (real, imaginary) if m else (real,):
                part[n, m] = (2.0 * n - 1.0) * z * part[n - 1, m]
                if n - 2 >= m:
                    part[n, m] -= (n + m - 1.0) * (n - m - 1.0) * (inverse * part[n - 2, m])
    return _compile(real, imaginary, place, degree)


@cache
def regular_harmonics(degree: int) -> ArrayFunction:
    """Return the function of points (3, N) whose rows are the R up to a degree, see `pack`."""
    x, y, z = place = [variable(name) for name in "xyz"]
    square = x * x + y * y + z * z
    real: dict[tuple[int, int], Expr] = {(0, 0): 1.0 + 0.0 * x}
    imaginary: dict[tuple[int, int], Expr] = {}
    for m in range(degree + 1):
        if m:
            _step_order(real, imaginary, m, x / (2.0 * m), y / (2.0 * m))
        for n in range(m + 1, degree + 1):
            factor = 1.0 / ((n - m) * (n + m))
            for part in (real, imaginary) if m else (real,):
                part[n, m] = (2.0 * n - 1.0) * factor * z * part[n - 1, m]
                if n - 2 >= m:
                    part[n, m] -= factor * (square * part[n - 2, m])
    return _compile(real, imaginary, place, degree)


def _step_order(
    real: dict[tuple[int, int], Expr],
    imaginary: dict[tuple[int, int], Expr],
    m: int,
    x: Expr,
    y: Expr,
) -> None:
    """Set the sectorial term of order m: that of m − 1 times x + iy."""
    a = real[m - 1, m - 1]
    if m == 1:
        real[1, 1], imaginary[1, 1] = x * a, y * a
        return
    b = imaginary[m - 1, m - 1]
    real[m, m], imaginary[m, m] = x * a - y * b, x * b + y * a


def _compile(
    real: dict[tuple[int, int], Expr],
    imaginary: dict[tuple[int, int], Expr],
    place: list[Expr],
    degree: int,
) -> ArrayFunction:
    outputs = [real[n, m] for n in range(degree + 1) for m in range(n + 1)]
    outputs += [imaginary[n, m] for n in range(degree + 1) for m in range(1, n + 1)]
    return ArrayFunction(outputs, place, compact=degree >= _COMPACT_FROM)


def pack(coefficients: Complex) -> Array:
    r"""Return the rows that multiply the harmonics for a sum over all orders.

    Parameters
    ----------
    coefficients : ndarray of complex, shape (..., N + 1, N + 1)
        c with rows n and columns m ≥ 0, of a real function.

    Returns
    -------
    ndarray, shape (..., (N + 1)²)
        w, so that :math:`\sum_n\sum_{|m|\le n}\overline{c_n^m} I_n^m` is w times the rows of
        `irregular_harmonics`: real parts of all (n, m), n first, then imaginary parts of m > 0.
    """
    n, m = np.tril_indices(coefficients.shape[-1])
    twice = np.where(m > 0, 2.0, 1.0)
    rows = coefficients[..., n, m]
    return np.concatenate([rows.real * twice, (rows.imag * twice)[..., m > 0]], axis=-1)


def unpack(rows: Array) -> Complex:
    """Return rows (..., (N + 1)²) in the order of `pack`, not doubled, as (..., N + 1, N + 1)."""
    size = round(np.sqrt(rows.shape[-1]))
    n, m = np.tril_indices(size)
    whole = np.zeros((*rows.shape[:-1], size, size), dtype=complex)
    whole[..., n, m] = rows[..., : n.size]
    whole[..., n[m > 0], m[m > 0]] += 1j * rows[..., n.size :]
    return whole


def differentiate_irregular(coefficients: Complex) -> Complex:
    r"""Return the coefficients of the gradient of a series of irregular harmonics.

    By :math:`\partial_z I_n^m = -I_{n+1}^m` and
    :math:`(\partial_x\pm i\partial_y) I_n^m = \mp I_{n+1}^{m\pm1}`.

    Parameters
    ----------
    coefficients : ndarray of complex, shape (..., N + 1, N + 1)
        As of `pack`.

    Returns
    -------
    ndarray of complex, shape (3, ..., N + 2, N + 2)
        Those of ∂x, ∂y, ∂z.
    """
    below, above = _neighbours(coefficients)
    result = np.zeros((3, *below.shape[:-2], below.shape[-2] + 1, below.shape[-1]), dtype=complex)
    result[0, ..., 1:, :] = 0.5 * (above - below)
    result[1, ..., 1:, :] = -0.5j * (above + below)
    result[2, ..., 1:, :-1] = -coefficients
    return result


def differentiate_regular(sums: Complex) -> Complex:
    r"""Return sums over n·∇R where those over n R are given.

    By :math:`\partial_z R_n^m = R_{n-1}^m` and
    :math:`(\partial_x\pm i\partial_y) R_n^m = \mp R_{n-1}^{m\pm1}`.

    Parameters
    ----------
    sums : ndarray of complex, shape (3, ..., N + 1, N + 1)
        Of vectors n times the harmonics.

    Returns
    -------
    ndarray of complex, shape (..., N + 1, N + 1)
        Of n·∇ of the harmonics; those of degree N need no others than were given.
    """
    size = sums.shape[-1]
    result = np.zeros(sums.shape[1:], dtype=complex)
    # a vector times harmonics of order m is not the sum of a real function: its conjugates of
    # negative order are formed for each component
    below, above = _neighbours(sums)
    result[..., 1:, :] = sums[2, ..., :-1, :]
    result[..., 1:, :] -= 0.5 * (above[0] - 1j * above[1])[..., :-1, :size]
    result[..., 1:, :] += 0.5 * (below[0] + 1j * below[1])[..., :-1, :size]
    return result


def _neighbours(c: Complex) -> tuple[Complex, Complex]:
    """Return c of order m − 1 and of order m + 1 at m = 0, …, N + 1, shape (..., N + 1, N + 2)."""
    below = np.zeros((*c.shape[:-1], c.shape[-1] + 1), dtype=complex)
    above = below.copy()
    below[..., 1:] = c
    # F of order −1 is −conj F of order 1
    below[..., 0] = -np.conj(c[..., 1])
    above[..., :-2] = c[..., 1:]
    return below, above
