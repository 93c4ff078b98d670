"""Local maxima of a real eigenvalue of Q M over the parameters of Q and over frequency.

A real eigenvalue λ > 0 of Q M makes I − M Δ singular for Δ = Q/λ, so that every maximum is a lower
bound of µ.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from hillsphere.interfaces import Array
from hillsphere_controllers.mu.blocks import BlockStructure
from hillsphere_controllers.mu.parameters import UnitPerturbation

__all__ = ["FARTHEST", "Ascent"]

Complex = NDArray[np.complex128]

_MOST = 60
"""Steps of sequential quadratic programming at most. Any point reached gives a valid lower bound,
so that an unfinished ascent does no harm."""
_CORRECTIONS = 12
"""Newton steps that bring the eigenvalue back to the real axis at most; they converge quadratically
or not at all."""
_REAL = 1e-13
"""Imaginary part of an eigenvalue, relative to its size, that counts as rounding."""
_LOST = 1e100
"""Parameters of that size tell nothing: lengths of vectors overflow soon after."""
FARTHEST = 0.7
"""Frequency moves by no more than that in its logarithm."""


class Ascent:
    """Local maxima of the eigenvalue over Q.

    Parameters
    ----------
    at : callable
        Returns the squared M (n, n) and its derivative at z, the logarithm of frequency relative to
        where it starts.
    structure : BlockStructure
        Of Q.
    moving : bool
        Whether frequency is raised too.
    """

    def __init__(
        self,
        at: Callable[[float], tuple[Complex, Complex]],
        structure: BlockStructure,
        *,
        moving: bool,
    ) -> None:
        self.at, self.moving = at, moving
        self._still = at(0.0)
        self.size = max(float(np.linalg.norm(self._still[0], 2)), 1e-300)
        self.unit = UnitPerturbation(structure)
        self.bounds = [*self.unit.bounds, *([(-FARTHEST, FARTHEST)] if moving else [])]

    def merit(self, q: Complex) -> float:
        """Return the merit of a start: the largest real less imaginary part of an eigenvalue."""
        values = np.linalg.eigvals(q @ self._still[0])
        return float(np.max(np.abs(values.real) - np.abs(values.imag)))

    def eigenvalue(self, x: Array) -> tuple[complex, Complex]:
        """Return the eigenvalue of Q M with the largest merit, over ‖M‖, and its gradient (k,)."""
        m, slope = self.at(float(x[-1])) if self.moving else self._still
        q = self.unit.q(x)
        values, vectors = np.linalg.eig(q @ m)
        best = int(np.argmax(values.real - np.abs(values.imag)))
        right = vectors[:, best]
        try:
            # dλ = yᴴ d(Q M) x, with the left eigenvector y scaled to yᴴ x = 1: a row of the inverse
            # of the right eigenvectors
            left = np.linalg.inv(vectors)[best] / self.size
        except np.linalg.LinAlgError:  # defective: any direction will do for one step
            left = right.conj() / self.size
        made = self.unit.derivative(x, left, m @ right)
        if self.moving:
            made = np.append(made, left @ (q @ (slope @ right)))
        return complex(values[best] / self.size), made

    def climb(self, q: Complex) -> tuple[Complex, float] | None:
        """Return the Δ of a local maximum reached from Q, and its z; None without a real one."""
        # Q and −Q are both admissible: the one with the larger eigenvalue is taken
        begun, other = self._initial_parameters(q), self._initial_parameters(-q)
        if self.eigenvalue(other)[0].real > self.eigenvalue(begun)[0].real:
            begun = other
        last: tuple[bytes, tuple[complex, Complex]] = (b"", (0j, np.zeros(0, dtype=complex)))

        def looked(x: Array) -> tuple[complex, Complex]:
            nonlocal last
            if not np.abs(x).max(initial=0.0) < _LOST:
                raise FloatingPointError("the search has left along a direction that is flat")
            # objective and constraint are asked for the same x in turn: one eigenvalue problem
            # serves both
            if x.tobytes() != last[0]:
                last = (x.tobytes(), self.eigenvalue(x))
            return last[1]

        x = None
        with suppress(FloatingPointError):
            minimum = minimize(
                lambda x: -looked(x)[0].real,
                begun,
                jac=lambda x: -looked(x)[1].real,
                bounds=self.bounds,
                constraints={
                    "type": "eq",
                    "fun": lambda x: looked(x)[0].imag,
                    "jac": lambda x: looked(x)[1].imag,
                },
                method="SLSQP",
                options={"maxiter": _MOST, "ftol": 1e-11},
            )
            # SQP keeps the constraint Im λ = 0 only to its tolerance
            x = self._shift_to_real(np.asarray(minimum.x))
        if x is None:
            x = self._shift_to_real(begun)
        if x is None:
            return None
        value, _ = self.eigenvalue(x)
        if not value.real > 1e-12:
            return None
        return self.unit.q(x) / (value.real * self.size), float(x[-1]) if self.moving else 0.0

    def _initial_parameters(self, q: Complex) -> Array:
        x = self.unit.parameters(q)
        return np.append(x, 0.0) if self.moving else x

    def _shift_to_real(self, x: Array) -> Array | None:
        """Return parameters nearby whose eigenvalue is real to rounding, None if there are none."""
        low = np.array([-np.inf if b[0] is None else b[0] for b in self.bounds])
        high = np.array([np.inf if b[1] is None else b[1] for b in self.bounds])
        if not np.isfinite(x).all():
            return None
        x = np.clip(x, low, high)
        for _ in range(_CORRECTIONS):
            value, slope = self.eigenvalue(x)
            if abs(value.imag) <= _REAL * abs(value):
                return x
            # Newton step on Im λ along its gradient, in the parameters that are not at a bound
            step = -value.imag * slope.imag
            moves = ((step < 0.0) | (x < high)) & ((step > 0.0) | (x > low))
            size = float(np.sum(slope.imag[moves] ** 2))
            if not size > 1e-24:
                return None
            x = np.clip(x + np.where(moves, step, 0.0) / size, low, high)
        value, _ = self.eigenvalue(x)
        return x if abs(value.imag) <= 1e-10 * abs(value) else None
