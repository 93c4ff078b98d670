r"""Multipliers: scalings D and G of one block as rational functions of frequency.

With a basis of stable functions φ, those of first- and second-order lags, and real matrices X, Y,

.. math::

    S(s) = \tfrac12 X_0 + \sum_k X_k φ_k(s), \qquad D = S + S^\mathsf{H}, \qquad
    jG = T - T^\mathsf{H}, \quad T(s) = \tfrac12 Y_0 + \sum_k Y_k φ_k(s),

with X₀ symmetric and Y₀ skew. So every D and G is that of a real system, and both are linear in X
and Y; the poles of φ can move too. The same poles serve D and G: the states are then shared.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from hillsphere.interfaces import Array
from hillsphere_controllers.mu.blocks import Block

__all__ = ["Multiplier"]

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Multiplier:
    """D and G of one block, of the order of its poles.

    A full block has a D that is a number times the identity: its matrices are one by one.

    Parameters
    ----------
    block : Block
        Whose scalings they are.
    pairs : ndarray, shape (k, 2)
        Logarithms of the natural frequency, rad/s, and of the damping of second-order lags.
    single : float or None
        Logarithm of the rate of a first-order lag, rad/s; None without one.
    x : ndarray, shape (1 + order, r, r)
        X, X₀ first.
    y : ndarray, shape (1 + order, r, r), or None
        Y, of a real block.
    fixed : bool
        Whether D stays what it is: one scaling may be divided out of all.
    """

    block: Block
    pairs: Array
    single: float | None
    x: Array
    y: Array | None
    fixed: bool = False

    @classmethod
    def constant(cls, block: Block, d: Array, *, fixed: bool = False) -> Multiplier:
        """Return a constant D (r, r), and G = 0."""
        y = np.zeros((1, *d.shape)) if block.kind == "real" else None
        return cls(block, np.zeros((0, 2)), None, np.asarray(d, dtype=float)[None], y, fixed)

    @property
    def order(self) -> int:
        """Number of poles."""
        return 2 * len(self.pairs) + (self.single is not None)

    @property
    def _free(self) -> list[tuple[bool, int, int, int]]:
        """Return the free entries: of Y rather than X, function, row, column."""
        r = self.x.shape[1]
        made = [(False, 0, i, j) for i in range(r) for j in range(i, r)]
        every = [(k, i, j) for k in range(1, len(self.x)) for i in range(r) for j in range(r)]
        made += [(False, *place) for place in every]
        if self.y is not None:
            made += [(True, 0, i, j) for i in range(r) for j in range(i + 1, r)]
            made += [(True, *place) for place in every]
        return made

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 0 if self.fixed else len(self._free) + self.order

    @property
    def poles(self) -> Array:
        """Parameters of the poles (order,), logarithms."""
        single = [] if self.single is None else [self.single]
        return np.concatenate([self.pairs.ravel(), single])

    def step(self, step: Array, low: float, high: float) -> Multiplier:
        """Return the multiplier after a step of its parameters, natural frequencies kept inside.

        Parameters
        ----------
        step : ndarray, shape (size,)
            Change of the entries, then of the poles.
        low, high : float
            Logarithms of the frequencies between which the poles stay, rad/s.
        """
        if self.fixed:
            return self
        x = self.x.copy()
        y = None if self.y is None else self.y.copy()
        for (of_y, k, i, j), change in zip(self._free, step, strict=False):
            if not of_y:
                x[k, i, j] += change
                if k == 0 and i != j:
                    x[0, j, i] += change
            elif y is not None:
                y[k, i, j] += change
                if k == 0:
                    y[0, j, i] -= change
        last = step[len(self._free) :]
        pairs = self.pairs + last[: self.pairs.size].reshape(-1, 2)
        pairs[:, 0] = np.clip(pairs[:, 0], low, high)
        pairs[:, 1] = np.clip(pairs[:, 1], *_DAMPING)
        single = self.single
        if single is not None:
            single = float(np.clip(single + last[-1], low, high))
        return replace(self, pairs=pairs, single=single, x=x, y=y)

    def scale(self, factor: float) -> Multiplier:
        """Return D and G times a number."""
        return replace(self, x=factor * self.x, y=None if self.y is None else factor * self.y)

    def add_pole(self, omega_rad_s: float) -> Multiplier:
        """Return the same D and G with a pole more, of that size, that has no effect as yet."""
        new = float(np.log(omega_rad_s))
        none = np.zeros((1, *self.x.shape[1:]))
        if self.single is None:
            y = None if self.y is None else np.concatenate([self.y, none])
            return replace(self, single=new, x=np.concatenate([self.x, none]), y=y)
        # p/(s + p) = (p q + p s)/((s + p)(s + q))
        # two first-order lags become one second-order lag of the geometric mean frequency
        middle = 0.5 * (self.single + new)
        damping = np.log(np.cosh(0.5 * (self.single - new)))
        pairs = np.vstack([self.pairs, [middle, min(max(damping, _DAMPING[0]), _DAMPING[1])]])
        share = np.exp(self.single - middle)
        x = np.concatenate([self.x, share * self.x[-1:]])
        y = None if self.y is None else np.concatenate([self.y, share * self.y[-1:]])
        return replace(self, pairs=pairs, single=None, x=x, y=y)

    def values(self, omega: Array) -> tuple[Complex, Complex]:
        """Return D and jG of the squared block (K, n, n) at frequencies (K,)."""
        phi, _ = self._basis(omega)
        return self._spread(_hermitian_sum(phi, self.x)), self._spread(
            _hermitian_difference(phi, self.y, self.x.shape)
        )

    def tangents(self, omega: Array) -> tuple[Complex, Complex]:
        """Return the derivatives (K, size, n, n) of D and jG in the parameters."""
        r, free = self.x.shape[1], self._free
        phi, more = self._basis(omega)
        d = np.zeros((omega.size, self.size, r, r), dtype=complex)
        g = np.zeros_like(d)
        for p, (of_y, k, i, j) in enumerate(free):
            # X₀ and Y₀ change in two places at once, but on the diagonal
            one = phi[:, k] * (2.0 if k == 0 and i != j else 1.0)
            if of_y:
                g[:, p, i, j] += one
                g[:, p, j, i] -= one.conj()
            else:
                d[:, p, i, j] += one
                d[:, p, j, i] += one.conj()
        for q in range(self.order):
            d[:, len(free) + q] = _hermitian_sum(more[:, :, q], self.x)
            g[:, len(free) + q] = _hermitian_difference(more[:, :, q], self.y, self.x.shape)
        return self._spread(d), self._spread(g)

    def system(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Return A, B of the basis, and C and D of S and of T; C and D of T are zero without G."""
        r = self.x.shape[1]
        parts: list[Array] = [np.zeros((0, 0))]
        into: list[Array] = [np.zeros((0, 1))]
        for log_omega, log_zeta in self.pairs:
            omega, zeta = np.exp(log_omega), np.exp(log_zeta)
            parts.append(np.array([[0.0, omega], [-omega, -2.0 * zeta * omega]]))
            into.append(np.array([[0.0], [omega]]))
        if self.single is not None:
            rate = np.exp(self.single)
            parts.append(np.array([[-rate]]))
            into.append(np.array([[rate]]))
        one = np.eye(r)
        a: Array = np.asarray(np.kron(block_diag(*parts), one), dtype=float)
        b: Array = np.asarray(np.kron(np.vstack(into), one), dtype=float)
        y = np.zeros_like(self.x) if self.y is None else self.y
        c_x, c_y = (np.hstack([np.zeros((r, 0)), *z[1:]]) for z in (self.x, y))
        return a, b, c_x, 0.5 * self.x[0], c_y, 0.5 * y[0]

    def _basis(self, omega: Array) -> tuple[Complex, Complex]:
        """Return φ (K, 1 + order), φ₀ = 1/2, and its derivatives in the poles."""
        count = self.order
        phi = np.zeros((omega.size, 1 + count), dtype=complex)
        more = np.zeros((omega.size, 1 + count, count), dtype=complex)
        phi[:, 0] = 0.5
        there = np.isfinite(omega)
        s = 1j * omega[there]
        for k, (log_omega, log_zeta) in enumerate(self.pairs):
            w, z = np.exp(log_omega), np.exp(log_zeta)
            below = s * s + 2.0 * z * w * s + w * w
            for column, above, lift in ((0, w * w + 0.0 * s, 2.0), (1, w * s, 1.0)):
                at = 1 + 2 * k + column
                phi[there, at] = above / below
                # derivatives by ln ω and ln ζ; lift is the power of ω in the numerator
                turn = 2.0 * z * w * s
                more[there, at, 2 * k] = (lift - (turn + 2.0 * w * w) / below) * above / below
                more[there, at, 2 * k + 1] = -turn * above / below**2
        if self.single is not None:
            rate = np.exp(self.single)
            phi[there, -1] = rate / (s + rate)
            more[there, -1, -1] = rate * s / (s + rate) ** 2
        return phi, more

    def _spread(self, core: Complex) -> Complex:
        if self.block.kind != "full":
            return core
        size = max(self.block.rows, self.block.columns)
        return np.asarray(core * np.eye(size))


_DAMPING = (float(np.log(0.05)), float(np.log(20.0)))
"""Logarithms of the least and largest: what is too narrow would dip between the frequencies."""


def _hermitian_sum(phi: Complex, x: Array) -> Complex:
    half = np.einsum("ok,kij->oij", phi, x)
    return np.asarray(half + half.conj().swapaxes(1, 2))


def _hermitian_difference(phi: Complex, y: Array | None, shape: tuple[int, ...]) -> Complex:
    if y is None:
        return np.zeros((len(phi), *shape[1:]), dtype=complex)
    half = np.einsum("ok,kij->oij", phi, y)
    return np.asarray(half - half.conj().swapaxes(1, 2))
