"""Structures whose parameters stay within bounds, by a sine substitution."""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.structured.structure import Sizes, Structure

__all__ = ["Bounded"]


class Bounded:
    r"""Parameters kept in a box by :math:`θ = m + h \sin φ`, m its middle and h half its width.

    A parameter without bounds is φ itself. The synthesis works on φ; `parameters` gives θ.

    Parameters
    ----------
    structure : Structure
        Structure whose parameters are θ.
    lower, upper : ndarray, shape (size,)
        Bounds of each θ: both finite, or both infinite.

    Raises
    ------
    InputError
        If the bounds do not fit, are not in order, or only one of a pair is finite.
    """

    def __init__(self, structure: Structure, lower: Array, upper: Array) -> None:
        self.structure = structure
        self.order, self.size = structure.order, structure.size
        self.controls, self.measurements = structure.controls, structure.measurements
        self.lower, self.upper = np.array(lower, dtype=float), np.array(upper, dtype=float)
        if self.lower.shape != (self.size,) or self.upper.shape != (self.size,):
            raise InputError(f"bounds must have {self.size} entries each, as the structure has")
        self._inside = np.isfinite(self.lower) & np.isfinite(self.upper)
        free = np.isneginf(self.lower) & np.isposinf(self.upper)
        if not (self.lower < self.upper).all():
            raise InputError("each lower bound must be below the upper one")
        if not (self._inside | free).all():
            raise InputError(
                "bounds must be finite in pairs, or infinite in pairs: give the other one a large "
                "but finite value"
            )
        lower, upper = np.where(self._inside, [self.lower, self.upper], [[-1.0], [1.0]])
        self._middle, self._half = 0.5 * (lower + upper), 0.5 * (upper - lower)

    def parameters(self, phi: Array) -> Array:
        """Return θ of φ, both (size,)."""
        return np.where(self._inside, self._middle + self._half * np.sin(phi), phi)

    def free(self, theta: Array) -> Array:
        """Return a φ of θ, moved into the box, both (size,)."""
        # not at a bound itself, where the slope of the sine vanishes and no step would leave it
        share = np.clip((np.asarray(theta) - self._middle) / self._half, -0.999, 0.999)
        return np.where(self._inside, np.arcsin(share), theta)

    def gains(self, theta: Array) -> Array:
        """Return K of φ."""
        return self.structure.gains(self.parameters(theta))

    def pull_back(self, theta: Array, slope: Array) -> Array:
        """Return the slopes of φ."""
        inner = self.structure.pull_back(self.parameters(theta), slope)
        # chain rule: dθ/dφ = h cos φ
        return inner * np.where(self._inside, self._half * np.cos(theta), 1.0)

    def typical(self, sizes: Sizes) -> tuple[Array, Array]:
        """Return middle and half width of the box; without bounds the structure's values."""
        middle, spread = self.structure.typical(sizes)
        return np.where(self._inside, 0.0, middle), np.where(self._inside, 0.7, spread)
