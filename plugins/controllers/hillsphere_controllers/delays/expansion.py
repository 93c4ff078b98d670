r"""Expansion of a system with delays about frequencies, with bounds of what is left out.

At s = s_c + jδ the delays and the integrators differ from those at s_c by

.. math::

    Θ = \operatorname{diag}(-jδ I, \; E(s) - E(s_c)), \qquad
    |Θ| \le \barΘ = \operatorname{diag}(δ I, \; 2 \sin \tfrac12 \min(T δ, π)).

With e = (x, z), the inputs of integrators and delays disturbed by d, and all at s_c,

.. math::

    e = H d + X u, \quad y = L d + G u, \quad d = Θ e \quad\Rightarrow\quad
    e(s) = (I - H Θ)^{-1} X, \quad G(s) = G + L Θ e(s), \quad
    \det P(s) = \det P(s_c) \det(I - H Θ),

where the determinant of the pencil P(s) is the characteristic function, whose zeros are the poles.
It has none where the spectral radius of :math:`|H| \barΘ` is below one, and the response is within
bounds that follow from :math:`(I - |H| \barΘ)^{-1} |X|`. Rounding enters as in [1]_: with Z the
computed inverse of P(s_c), Z P(s) = I − F − H Θ, with F of the residual and its own rounding.

References
----------
.. [1] S. M. Rump (2010), Verification methods: rigorous results using floating-point arithmetic,
   Acta Numerica 19, 287-449, section 10.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_controllers.delays.system import DelaySystem

__all__ = ["Expansion", "Pencil", "bound_perturbed", "spectral_radius_bounded"]

Complex = NDArray[np.complex128]
_EPS = float(np.finfo(float).eps)
_SAFETY = 4.0
"""Factor on the bounds of rounding: √8 for products of complex numbers, and the rounding of the
bounds themselves."""
_CHUNK = 2000
"""Frequencies that are expanded at once: for ten states and delays, some megabytes per array."""
_ROOM = 1e-9
"""Share by which a computed bound is enlarged, for the rounding in its own computation, which loses
fewer digits than this unless the solution is refused."""


@dataclass(frozen=True)
class Expansion:
    """Matrices at K frequencies, see the module; n states, q delays, N = n + q.

    Parameters
    ----------
    omega : ndarray, shape (K,)
        Frequencies, rad/s.
    z : ndarray, shape (K, N, N)
        Computed inverse of the pencil.
    residual : ndarray, shape (K, N, N)
        Bound of |F|; infinite where the pencil is singular but for rounding.
    h, h_bound : ndarray, shape (K, N, N)
        H, and a bound of its size that allows for rounding.
    x, left, g : ndarray, shape (K, N, m), (K, p, N), (K, p, m)
        X, L and G.
    x_rounding : ndarray, shape (K, N, m)
        Bound of the rounding of the product that X is.
    out : ndarray, shape (K, p, N)
        Sizes of the matrix from e to y.
    """

    omega: Array
    z: Complex
    residual: Array
    h: Complex
    h_bound: Array
    x: Complex
    left: Complex
    g: Complex
    x_rounding: Array
    out: Array


@dataclass(frozen=True)
class Pencil:
    """A system with delays as matrices.

    Parameters
    ----------
    a, b, c, d : ndarray, shape (n, n), (n, q), (q, n), (q, q)
        From states and delayed signals to derivatives and the signals to be delayed.
    times : ndarray, shape (q,)
        Delays, s.
    b_u, d_zu : ndarray, shape (n, m), (q, m)
        From the inputs.
    c_y, d_yw, d_yu : ndarray, shape (p, n), (p, q), (p, m)
        To the outputs.
    """

    a: Array
    b: Array
    c: Array
    d: Array
    times: Array
    b_u: Array = field(default_factory=lambda: np.zeros((0, 0)))
    d_zu: Array = field(default_factory=lambda: np.zeros((0, 0)))
    c_y: Array = field(default_factory=lambda: np.zeros((0, 0)))
    d_yw: Array = field(default_factory=lambda: np.zeros((0, 0)))
    d_yu: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def of(cls, system: DelaySystem) -> Pencil:
        """Return the matrices of a system."""
        (p, m), s = system.shape, system.system
        return cls(
            s.a, s.b[:, m:], s.c[p:], s.d[p:, m:], np.array(system.delays_s), s.b[:, :m],
            s.d[p:, :m], s.c[:p], s.d[:p, m:], s.d[:p, :m],
        )  # fmt: skip

    @property
    def size(self) -> int:
        """Number of states and delays."""
        return len(self.a) + len(self.times)

    def part(self, places: NDArray[np.intp]) -> Pencil:
        """Return the part of some states and delays, numbered one after the other, without ends."""
        n = len(self.a)
        x, w = places[places < n], places[places >= n] - n
        empty = np.zeros((x.size, 0)), np.zeros((w.size, 0)), np.zeros((0, x.size))
        return Pencil(
            self.a[np.ix_(x, x)], self.b[np.ix_(x, w)], self.c[np.ix_(w, x)],
            self.d[np.ix_(w, w)], self.times[w], *empty, np.zeros((0, w.size)), np.zeros((0, 0)),
        )  # fmt: skip

    def late(self, omega: Array) -> Complex:
        """Return E (K, q) at frequencies (K,)."""
        return np.asarray(np.exp(-1j * omega[:, None] * self.times))

    def matrices(self, omega: Array) -> Complex:
        """Return the pencils (K, N, N) at frequencies (K,)."""
        n, late = len(self.a), self.late(omega)
        made = np.empty((omega.size, self.size, self.size), dtype=complex)
        made[:, :n, :n] = 1j * omega[:, None, None] * np.eye(n) - self.a
        made[:, :n, n:] = -self.b * late[:, None, :]
        made[:, n:, :n] = -self.c
        made[:, n:, n:] = np.eye(len(self.times)) - self.d * late[:, None, :]
        return made

    def chunks(self, omega: Array) -> Iterator[slice]:
        """Return parts of a row of frequencies that are expanded at once."""
        return (slice(k, k + _CHUNK) for k in range(0, omega.size, _CHUNK))

    def expand(self, omega: Array) -> Expansion:
        """Return the expansions about frequencies (K,)."""
        n, size, count = len(self.a), self.size, omega.size
        pencil = self.matrices(omega)
        z = _inverses(pencil)
        into = np.zeros((size, size))
        into[:n, :n], into[:n, n:], into[n:, n:] = np.eye(n), self.b, self.d
        late = self.late(omega)
        h = z @ into
        source = np.vstack([self.b_u, self.d_zu])
        x = z @ source
        out = np.zeros((count, len(self.d_yu), size), dtype=complex)
        out[:, :, :n] = self.c_y
        out[:, :, n:] = self.d_yw * late[:, None, :]
        left = out @ h
        left[:, :, n:] += self.d_yw
        # rounding of products of `size` terms, and of the phase ω T
        unit = _SAFETY * (size + 3) * _EPS
        phase = np.zeros((count, size, size))
        turned = _SAFETY * _EPS * omega[:, None] * self.times
        phase[:, :n, n:] = np.abs(self.b) * turned[:, None, :]
        phase[:, n:, n:] = np.abs(self.d) * turned[:, None, :]
        large = np.abs(z)
        with np.errstate(invalid="ignore", over="ignore"):
            residual = np.abs(np.eye(size) - z @ pencil) + large @ (unit * np.abs(pencil) + phase)
            bound = np.abs(h) + unit * (large @ np.abs(into))
        bad = ~np.isfinite(residual).all(axis=(1, 2)) | ~np.isfinite(bound).all(axis=(1, 2))
        residual[bad], bound[bad] = np.inf, np.inf
        rounded = unit * (large @ np.abs(source))
        return Expansion(
            omega, z, residual, h, bound, x, left, out @ x + self.d_yu, rounded, np.abs(out)
        )

    def turn(self, omega: Array, half: Array, spread: Array | None = None) -> Array:
        r"""Return bounds Θ̄ (K, N) within `half` of frequencies (K,).

        With `spread` (q,), s, for all delays that differ from these by no more.
        """
        n = len(self.a)
        made = np.empty((half.size, self.size))
        made[:, :n] = half[:, None]
        angle = half[:, None] * self.times
        if spread is not None:
            angle = angle + (omega + half)[:, None] * spread
        made[:, n:] = 2.0 * np.sin(0.5 * np.minimum(angle, np.pi))
        return made * (1.0 + _SAFETY * _EPS)


def _inverses(matrices: Complex) -> Complex:
    """Return inverses (K, N, N); not a number where a matrix is exactly singular."""
    try:
        return np.asarray(np.linalg.inv(matrices))
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full_like(matrices, np.nan)
    half = len(matrices) // 2
    return np.concatenate([_inverses(matrices[:half]), _inverses(matrices[half:])])


def spectral_radius_bounded(matrices: Array) -> NDArray[np.bool_]:
    """Return which matrices (K, N, N) without negative entries have a spectral radius below one.

    Proved by a positive vector v with Y v < v; false where none is found.

    Parameters
    ----------
    matrices : ndarray, shape (K, N, N)
        Y ≥ 0.

    Returns
    -------
    ndarray of bool, shape (K,)
        True where it is proved.
    """
    ones = np.ones((*matrices.shape[:2], 1))
    return np.asarray(np.isfinite(bound_perturbed(matrices, ones)).all(axis=(1, 2)))


def bound_perturbed(matrices: Array, right: Array) -> Array:
    """Return upper bounds of (I − Y)⁻¹ R for Y, R ≥ 0; infinite where ρ(Y) < 1 is not proved.

    Parameters
    ----------
    matrices : ndarray, shape (K, N, N)
        Y.
    right : ndarray, shape (K, N, m)
        R.

    Returns
    -------
    ndarray, shape (K, N, m)
        The bounds.
    """
    count, size, m = right.shape
    made = np.full((count, size, m), np.inf)
    usable = np.isfinite(matrices).all(axis=(1, 2)) & np.isfinite(right).all(axis=(1, 2))
    y, r = matrices[usable], right[usable]
    if not size or not len(y):
        made[usable] = 0.0
        return made
    inverse = _inverses((np.eye(size) - y).astype(complex)).real
    more = 1.0 + _SAFETY * size * _EPS
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        # two solutions: the first brings the units of the entries, which the second needs as its
        # right side, for its margin to be far above rounding in every row
        units = inverse.sum(axis=2)
        test = (inverse @ units[:, :, None])[:, :, 0]
        proved = (units > 0.0).all(axis=1)
        proved &= (more * (y @ test[:, :, None])[:, :, 0] < test).all(axis=1)
        # s ≥ Y s + R makes s a bound of the solution; a share of the test covers the rounding of s
        share = (r / units[:, :, None]).max(axis=1, initial=0.0)
        s = np.maximum(inverse @ r, 0.0) + _ROOM * share[:, None, :] * test[:, :, None]
        proved &= (more * (y @ s) + r <= s).all(axis=(1, 2))
    s[~proved] = np.inf
    made[usable] = s
    return made
