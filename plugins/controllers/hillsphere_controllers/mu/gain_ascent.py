"""Local maxima of the gain of a loop over the parameters of a bounded Δ, and over frequency."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from hillsphere.interfaces import Array
from hillsphere_controllers.mu.ascent import FARTHEST
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.parameters import UnitPerturbation

__all__ = ["GainAscent", "GainMaximum"]

Complex = NDArray[np.complex128]

_MOST = 200
"""Steps of L-BFGS-B at most. Any Δ reached has its gain, so that an unfinished ascent does no
harm."""
_FARTHEST = 700.0
"""The logarithm of what counts as an infinite gain."""


@dataclass(frozen=True, eq=False)
class GainMaximum:
    """A local maximum of the gain.

    Parameters
    ----------
    x : ndarray, shape (k,)
        Parameters of Q.
    q : ndarray, shape (n, n)
        Q of size one, squared; Δ is as many times as large as its bound.
    z : float
        Logarithm of frequency relative to where the ascent starts.
    gain : float
        Reached.
    """

    x: Array
    q: Complex
    z: float
    gain: float


class GainAscent:
    """Local maxima of the gain that Δ leaves.

    Parameters
    ----------
    at : callable
        Returns the squared M and its derivative at z, the logarithm of frequency relative to where
        it starts; the last rows and columns are performance.
    uncertainty : BlockStructure
        Of Δ, without performance.
    moving : bool
        Whether frequency is raised too.
    """

    def __init__(
        self,
        at: Callable[[float], tuple[Complex, Complex]],
        uncertainty: BlockStructure,
        moving: bool = True,
    ) -> None:
        self.at, self.moving = at, moving
        self.uncertainty = uncertainty
        self.unit = UnitPerturbation(uncertainty)

    def random(self, generator: np.random.Generator) -> Array:
        """Return parameters (k,) drawn at random."""
        x = generator.normal(size=len(self.unit.bounds)) * np.pi
        real = [b[0] is not None for b in self.unit.bounds]
        x[real] = generator.uniform(-1.0, 1.0, sum(real))
        return x

    def best(self, starts: Sequence[Array], size: float = 1.0) -> GainMaximum:
        """Return the best of the local maxima from several parameters (k,).

        Parameters
        ----------
        starts : sequence of ndarray, shape (k,)
            Parameters of Q.
        size : float
            Of Δ.
        """
        bounds = [*self.unit.bounds, *([(-FARTHEST, FARTHEST)] if self.moving else [])]
        ends = [(0.0,) if self.moving else ()] * len(starts)
        maximum = min(
            (
                minimize(
                    self._cost, np.append(x, end), args=(size,), jac=True, method="L-BFGS-B",
                    bounds=bounds, options={"maxiter": _MOST},
                )
                for x, end in zip(starts, ends, strict=True)
            ),
            key=lambda one: float(one.fun),
        )  # fmt: skip
        count = len(self.unit.bounds)
        x = np.asarray(maximum.x[:count])
        z = float(maximum.x[-1]) if self.moving else 0.0
        return GainMaximum(x, self.unit.q(x), z, float(np.exp(-maximum.fun)))

    def performance(self, maximum: GainMaximum, size: float = 1.0) -> Complex:
        """Return the transfer matrix F_u(M, Δ) of performance (p, m) with a Δ of that size."""
        m, _ = self.at(maximum.z)
        n = self.uncertainty.size
        q = size * maximum.q
        right = np.linalg.solve(np.eye(n) - m[:n, :n] @ q, m[:n, n:])
        return np.asarray(m[n:, n:] + m[n:, :n] @ q @ right)

    def _cost(self, x: Array, size: float) -> tuple[float, Array]:
        count, n = len(self.unit.bounds), self.uncertainty.size
        m, slope = self.at(float(x[-1]) if self.moving else 0.0)
        q = size * self.unit.q(x[:count])
        inner = np.eye(n) - m[:n, :n] @ q
        try:
            # T = M₂₂ + M₂₁ Q (I − M₁₁ Q)⁻¹ M₁₂, right = (I − M₁₁ Q)⁻¹ M₁₂
            right = np.linalg.solve(inner, m[:n, n:])
            left = np.linalg.solve(inner.T, (m[n:, :n] @ q).T).T  # M₂₁ Q (I − M₁₁ Q)⁻¹
        except np.linalg.LinAlgError:
            return -_FARTHEST, np.zeros(x.size)
        t = m[n:, n:] + m[n:, :n] @ q @ right
        if not np.isfinite(t).all():
            return -_FARTHEST, np.zeros(x.size)
        u, s, vh = np.linalg.svd(t)
        if not s[0] > 0.0:
            return _FARTHEST, np.zeros(x.size)
        v, uh = vh[0].conj(), u[:, 0].conj()
        # dT = (M₂₁ + left M₁₁) dQ right, and d ln σ₁ = Re(u₁ᴴ dT v₁)/σ₁
        row = uh @ (m[n:, :n] + left @ m[:n, :n])
        gradient = size * self.unit.derivative(x[:count], row, right @ v)
        if self.moving:
            # T changes with M by [M₂₁ side, I] dM [Q right; I]
            outer, into = np.concatenate([uh @ left, uh]), np.concatenate([q @ right @ v, v])
            gradient = np.append(gradient, outer @ slope @ into)
        return -float(np.log(s[0])), -np.asarray(gradient.real) / s[0]
