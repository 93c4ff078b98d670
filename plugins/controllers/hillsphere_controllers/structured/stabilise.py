"""Stabilisation: minimise the largest spectral abscissa of all closed loops to below zero."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_controllers.structured.closed_loop import Closed, OpenLoop
from hillsphere_controllers.structured.descent import descend, gradient_sampling
from hillsphere_controllers.structured.gradients import pole_slopes
from hillsphere_controllers.structured.objective import FURTHEST
from hillsphere_controllers.structured.structure import Structure

__all__ = ["stabilise"]

_TARGET = -1e-3
"""Spectral abscissa, relative to the plant's rate, at which stabilisation ends: the descent of the
norms moves poles farther itself."""
_STEEPEST = 1e8
"""Largest slope of the abscissa. Near a multiple pole it is infinite, and its size would swallow
the other entries of the step."""


@dataclass
class _Abscissa:
    x: Array
    value: float
    plant: int = 0
    closed: Closed | None = None


class _Landscape:
    """Largest spectral abscissa of the closed loops, each relative to its plant's rate."""

    def __init__(
        self, loops: Sequence[OpenLoop], structure: Structure, middle: Array, spread: Array
    ) -> None:
        self.loops, self.structure = loops, structure
        self.middle, self.spread = middle, spread

    def evaluate(self, x: Array, above: float = np.inf) -> _Abscissa:
        """Return the point at x."""
        with np.errstate(over="ignore", invalid="ignore"):
            gains = self.structure.gains(self.middle + self.spread * x)
        worst = _Abscissa(x, -np.inf)
        if not np.isfinite(gains).all() or float(np.abs(x).max()) > FURTHEST:
            return _Abscissa(x, np.inf)
        for j, loop in enumerate(self.loops):
            closed = loop.close(gains)
            if closed is None or not np.isfinite(closed.a).all():
                return _Abscissa(x, np.inf)
            value = float(np.linalg.eigvals(closed.a).real.max(initial=-np.inf)) / loop.rate
            if value > above:
                return _Abscissa(x, np.inf)
            if value > worst.value or worst.closed is None:
                worst = _Abscissa(x, value, j, closed)
        return worst

    def slope(self, point: _Abscissa) -> Array:
        """Return the gradient of the rightmost pole's real part."""
        closed = point.closed
        assert closed is not None
        poles, slopes = pole_slopes(closed)
        slope = np.real(slopes[int(np.argmax(poles.real))]) / self.loops[point.plant].rate
        if not np.isfinite(slope).all():  # a multiple pole without enough vectors
            slope = np.zeros_like(slope)
        # such a pole nearly: it moves with the root of K, for which no slope is too steep
        slope *= min(1.0, _STEEPEST / max(float(np.abs(slope).max()), 1e-300))
        back = self.structure.pull_back(self.middle + self.spread * point.x, slope)
        return np.asarray(back * self.spread)


def stabilise(
    loops: Sequence[OpenLoop],
    structure: Structure,
    middle: Array,
    spread: Array,
    x: Array,
    random: np.random.Generator,
) -> tuple[Array, float]:
    """Return stabilising scaled parameters (size,), and the largest abscissa over rate.

    The second is below zero where stabilisation succeeded.
    """
    landscape = _Landscape(loops, structure, middle, spread)
    point = landscape.evaluate(x)
    if not np.isfinite(point.value) or point.closed is None:
        return x, point.value
    for _ in range(3):
        point = descend(landscape, point, iterations=150, target=_TARGET, patience=(50, 1e-6))
        if point.value < 0.0:
            break
        before = point.value
        point = gradient_sampling(landscape, point, random, rounds=1)
        if not point.value < before - 1e-6:
            break
    return point.x, point.value
