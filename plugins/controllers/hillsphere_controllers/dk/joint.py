r"""Joint descent: scalings and controller moved together.

Alternation converges slowly once µ is about the same at all frequencies: scalings that prove the
bound of one controller need not suit the next. But the least γ of the K-step is a function of the
scalings' parameters, smooth where the K-step is H∞ synthesis of full order, and its minimum is what
the alternation looks for. So it is minimised itself, by a quasi-Newton method with differences, in
coordinates in which steps of one change D by as much as itself (the metric of −log det D).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import block_diag

from hillsphere.errors import HillsphereError, Interrupted
from hillsphere.interfaces import Array
from hillsphere_controllers.dk.multipliers import Multiplier

__all__ = ["descend_jointly"]

_STEP = 3e-3
"""Step of the difference quotients, in units in which log D changes by about one. γ is known to
1e-6, so that the slope has three digits."""
_LEAST_SHARE = 1e-4
"""Directions in which D hardly changes count as if it changed by that share of the largest."""
_LONGEST = 0.5
"""Length of the first step, in the same units; later ones are at most four times as long. The
linear model of ln γ holds no farther."""
_ENOUGH = 0.2
"""Share of the predicted decrease that a step must reach (Armijo's rule)."""
_GAIN = 5e-4
"""Decrease of ln γ by one step below which the descent ends: half of what the search counts as
converged."""


def descend_jointly(
    gamma: Callable[[Sequence[Multiplier]], float],
    start: Sequence[Multiplier],
    omega_rad_s: Array,
    steps: int,
) -> Sequence[Multiplier]:
    """Return scalings for which the K-step reaches a lower γ, by quasi-Newton steps.

    Parameters
    ----------
    gamma : callable
        The γ that the K-step reaches with scalings; infinite if it fails.
    start : sequence of Multiplier
        To begin with.
    omega_rad_s : ndarray, shape (K,)
        Frequencies over which changes of D are measured; poles stay between them.
    steps : int
        At most so many.
    """
    if sum(one.size for one in start) == 0:
        return start
    inner = omega_rad_s[(omega_rad_s > 0.0) & np.isfinite(omega_rad_s)]
    low, high = float(np.log(inner.min())), float(np.log(inner.max()))
    ends = np.cumsum([one.size for one in start])[:-1]
    basis = _basis(start, omega_rad_s)

    def at(v: Array) -> Sequence[Multiplier]:
        parts = np.split(basis @ v, ends)
        return [one.step(part, low, high) for one, part in zip(start, parts, strict=True)]

    def cost(v: Array) -> float:
        try:
            return float(np.log(gamma(at(v))))
        except Interrupted:
            raise
        except HillsphereError:
            return np.inf

    v = np.zeros(basis.shape[1])
    value = cost(v)
    if not np.isfinite(value):
        return start
    gradient = _gradient(cost, v, value)
    inverse = np.eye(v.size) * _LONGEST / max(float(np.linalg.norm(gradient)), 1e-12)
    for _ in range(steps):
        direction = -inverse @ gradient
        if not gradient @ direction < 0.0:
            direction = -gradient
        direction *= min(1.0, 4.0 * _LONGEST / float(np.linalg.norm(direction)))
        step = _search_line(cost, v, value, direction, float(gradient @ direction))
        if step is None:
            break
        there, new = step
        gained = value - new
        slope = _gradient(cost, there, new)
        inverse = _update_inverse_hessian(inverse, there - v, slope - gradient)
        v, value, gradient = there, new, slope
        if gained < _GAIN:
            break
    return at(v)


def _basis(start: Sequence[Multiplier], omega: Array) -> Array:
    """Return directions (size, size) of about the same relative change of D and G."""
    parts = []
    for one in start:
        if one.size == 0:
            continue
        d, _ = one.values(omega)
        dd, dg = one.tangents(omega)
        # relative change K⁻¹ dD K⁻ᴴ with D = K Kᴴ, stacked over the frequencies; its singular
        # vectors are the directions
        root = np.linalg.inv(np.linalg.cholesky(d))[:, None]
        both = np.stack([dd, dg], axis=2)
        change = root[:, :, None] @ both @ root[:, :, None].conj().swapaxes(3, 4)
        flat = np.ascontiguousarray(change.swapaxes(0, 1)).reshape(one.size, -1)
        parts.append(np.hstack([flat.real, flat.imag]).T / np.sqrt(omega.size))
    rows = block_diag(*parts)
    _, sizes, vectors = np.linalg.svd(rows, full_matrices=False)
    return np.asarray(vectors.T / np.maximum(sizes, _LEAST_SHARE * sizes[0]))


def _gradient(cost: Callable[[Array], float], v: Array, value: float) -> Array:
    made = np.zeros(v.size)
    for k in range(v.size):
        moved = v.copy()
        # one-sided difference; backwards where the K-step fails ahead
        for step in (_STEP, -_STEP):
            moved[k] = v[k] + step
            there = cost(moved)
            if np.isfinite(there):
                made[k] = (there - value) / step
                break
    return made


def _search_line(
    cost: Callable[[Array], float], v: Array, value: float, direction: Array, slope: float
) -> tuple[Array, float] | None:
    """Return the best of some points along a direction, None if none is better."""
    best: tuple[Array, float] | None = None
    length = 1.0
    while length > 1e-3:
        there = v + length * direction
        new = cost(there)
        if best is not None and not new < best[1]:
            return best
        if new < value + _ENOUGH * length * slope or (best is not None and new < best[1]):
            best = (there, new)
            if length < 1.0:
                return best
            length *= 2.0
        else:
            length *= 0.5
    return best


def _update_inverse_hessian(inverse: Array, step: Array, change: Array) -> Array:
    """Return the inverse Hessian after a step, by the BFGS formula."""
    product = float(step @ change)
    if product <= 1e-10 * float(np.linalg.norm(step) * np.linalg.norm(change)):
        return inverse
    left = np.eye(step.size) - np.outer(step, change) / product
    return np.asarray(left @ inverse @ left.T + np.outer(step, step) / product)
