"""Descent for nonsmooth functions: BFGS with a weak Wolfe line search, and gradient sampling.

BFGS with a weak Wolfe line search works on functions that are smooth almost everywhere: its matrix
learns the directions in which the function has a kink [1]_. Where BFGS stalls, the gradients at
points nearby give a direction along the kink [2]_.

References
----------
.. [1] A. S. Lewis, M. L. Overton (2013), Nonsmooth optimization via quasi-Newton methods,
   Mathematical Programming 141, 135-163.
.. [2] J. V. Burke, A. S. Lewis, M. L. Overton (2005), A robust gradient sampling algorithm for
   nonsmooth, nonconvex optimization, SIAM Journal on Optimization 15(3), 751-779.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from hillsphere.interfaces import Array
from hillsphere_controllers.structured.minimax import minimax_step

__all__ = ["Landscape", "Located", "descend", "gradient_sampling"]

_SUFFICIENT, _CURVATURE = 1e-4, 0.5
"""Constants of the weak Wolfe conditions, of the decrease and of the slope. For functions that are
not smooth Lewis and Overton (2013) recommend such a small and such a middle value."""
_TRIALS = 40
"""Bisections of a line search at most: the step is then known to rounding."""
_LONGEST = 10.0
"""A step is no longer than this times |x|: gains that run away do so in steps."""
_RADII = (1e-2, 1e-3, 1e-4)
"""Radii of gradient sampling, relative to the size of the parameters. Large ones escape shallow
ridges, small ones find a descent near a sharp one."""


class Located(Protocol):
    """A point with a value, infinite where there is none."""

    @property
    def x(self) -> Array:
        """Position, shape (n,)."""
        ...

    @property
    def value(self) -> float:
        """Value of the function; infinite where it has none."""
        ...


P = TypeVar("P", bound=Located)


class Landscape(Protocol[P]):
    """A function that is smooth almost everywhere."""

    def evaluate(self, x: Array, above: float = np.inf) -> P:
        """Return the point at x (n,); its value may be infinite where it is larger than `above`."""
        ...

    def slope(self, point: P) -> Array:
        """Return the gradient there, (n,)."""
        ...


@dataclass(frozen=True)
class _Line(Generic[P]):
    point: P | None
    slope: Array


@np.errstate(over="ignore", invalid="ignore")  # far out slopes overflow: no step is taken there
def descend(
    landscape: Landscape[P],
    point: P,
    *,
    iterations: int,
    tolerance: float = 1e-7,
    target: float = -np.inf,
    patience: tuple[int, float] = (40, 1e-4),
    accepted: Callable[[P], P] | None = None,
) -> P:
    """Return a lower point by BFGS.

    Parameters
    ----------
    landscape : Landscape
        The function.
    point : Located
        Where to start, with a finite value.
    iterations : int
        At most.
    tolerance : float
        It ends where |g| max(1, |x|) is below this.
    target : float
        It ends when the value is below this.
    patience : tuple of int and float
        It ends when so many iterations have not brought such a decrease.
    accepted : callable or None
        Called with each point that is accepted; returns it, perhaps with a better known value.
    """
    n = point.x.size
    g, inverse, fresh = landscape.slope(point), np.eye(n), True
    values: deque[float] = deque(maxlen=patience[0])
    for _ in range(iterations):
        size = max(1.0, float(np.linalg.norm(point.x)))
        if np.linalg.norm(g) * size < tolerance or point.value < target:
            break
        values.append(point.value)
        if len(values) == patience[0] and values[0] - point.value < patience[1]:
            break
        direction = -inverse @ g
        if not g @ direction < 0.0:
            inverse, fresh, direction = np.eye(n), True, -g
        first = min(1.0, size / float(np.linalg.norm(direction))) if fresh else 1.0
        line = _line_search(landscape, point, g, direction, first)
        if line.point is None:
            if fresh:
                break
            inverse, fresh = np.eye(n), True
            continue
        new = line.point if accepted is None else accepted(line.point)
        if not new.value < point.value:  # known better now, it is higher: the line is searched anew
            continue
        slope = line.slope if new is line.point else landscape.slope(new)
        step, change = new.x - point.x, slope - g
        # BFGS update of the inverse Hessian; without positive curvature along the step it is
        # skipped
        along = float(step @ change)
        if along > 1e-14 * float(np.linalg.norm(step) * np.linalg.norm(change)):
            if fresh:
                # first update: scale the unit matrix to the curvature just seen
                inverse *= along / float(change @ change)
            turned = inverse @ change
            inverse += (1.0 + change @ turned / along) / along * np.outer(step, step)
            inverse -= (np.outer(turned, step) + np.outer(step, turned)) / along
            fresh = False
        point, g = new, slope
    return point


def _line_search(
    landscape: Landscape[P], point: P, g: Array, direction: Array, first: float
) -> _Line[P]:
    """Return a point that meets the weak Wolfe conditions, or else the best lower one."""
    size = max(1.0, float(np.linalg.norm(point.x)))
    longest = _LONGEST * size / float(np.linalg.norm(direction))
    low, high, t = 0.0, np.inf, min(first, longest)
    fall = float(g @ direction)
    best: _Line[P] = _Line(None, g)
    for _ in range(_TRIALS):
        level = point.value + _SUFFICIENT * t * fall
        trial = landscape.evaluate(point.x + t * direction, level)
        if not trial.value < level:
            high = t
        else:
            slope = landscape.slope(trial)
            best = _Line(trial, slope)
            if slope @ direction >= _CURVATURE * fall:
                return best
            low = t
        if high < np.inf:
            # a wall of instability may stand near: go down to it in larger steps first
            t = 0.5 * (low + high) if low > 0.0 or high < 0.1 * first else 0.3 * high
            if high - low <= 1e-12 * high or (low == 0.0 and high < 1e-11):
                break
        else:
            t = 2.0 * low
            if t > longest:
                break
    return best


@np.errstate(over="ignore", invalid="ignore")
def gradient_sampling(
    landscape: Landscape[P], point: P, random: np.random.Generator, *, rounds: int = 3
) -> P:
    """Return a lower point by gradient sampling, the same if there is none.

    Parameters
    ----------
    landscape : Landscape
        The function.
    point : Located
        Where to start.
    random : numpy.random.Generator
        Of the points nearby.
    rounds : int
        Steps at most for each radius.
    """
    n = point.x.size
    count = min(n + 1, 20)
    for radius in _RADII:
        for _ in range(rounds):
            size = radius * max(1.0, float(np.linalg.norm(point.x)) / np.sqrt(n))
            slopes = [landscape.slope(point)]
            for move in random.uniform(-size, size, (count, n)):
                near = landscape.evaluate(point.x + move)
                if np.isfinite(near.value):
                    slopes.append(landscape.slope(near))
            many = np.array(slopes)
            # shortest vector in the convex hull of the gradients: the direction of steepest descent
            step = minimax_step(
                np.zeros(len(many)), many, np.zeros(len(many), dtype=bool), np.eye(n), 1.0
            )
            if step is None or step.predicted < 1e-10:
                break
            line = _line_search(landscape, point, -step.step, step.step, 1.0)
            if line.point is None:
                break
            point = line.point
    return point
