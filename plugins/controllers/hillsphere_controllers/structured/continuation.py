r"""Continuation from one controller to the controller of a structure.

.. math::

    K_λ = (1 - λ) K_0 + λ K(θ), \quad 0 \le λ \le 1 .

At λ = 0 the loops are those of the known controller K₀, of any order; at λ = 1 those of the
structure. Along the way θ minimises the largest norm for each λ, from the θ of the one before: the
loops stay stable, so that θ need not be drawn at random in the hope that it stabilises them. Where
the path ends before λ = 1, as where K₀ and every K(θ) stabilise by opposite signs, its last θ is
still a start.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.structured.closed_loop import OpenLoop
from hillsphere_controllers.structured.descent import descend
from hillsphere_controllers.structured.objective import Objective
from hillsphere_controllers.structured.requirements import DesignPlant
from hillsphere_controllers.structured.structure import Sizes, Structure

__all__ = ["Blend", "follow_blend"]

_STEP, _SHORTEST = 0.25, 0.02
"""First step of λ, and the shortest one that is tried where the loops turn unstable."""
_ITERATIONS = 25
"""Steps of descent for each λ: the path is to be followed, not found exactly."""


class Blend:
    """The controller (1 − λ) K₀ + λ K(θ) as a structure of θ.

    Parameters
    ----------
    structure : Structure
        Gives K(θ).
    controller : LtiSystem
        K₀, from y to u.
    share : float
        λ, from 0 to 1.
    """

    def __init__(self, structure: Structure, controller: LtiSystem, share: float) -> None:
        self.structure, self.controller, self.share = structure, controller, share
        self.order, self.size = structure.order + controller.order, structure.size
        self.controls, self.measurements = structure.controls, structure.measurements

    def gains(self, theta: Array) -> Array:
        """Return K: the states of K(θ) first, then those of K₀."""
        k, n, share = self.structure.order, self.order, self.share
        own, other = self.structure.gains(theta), self.controller
        made = np.zeros((n + self.controls, n + self.measurements))
        made[:k, :k], made[:k, n:] = own[:k, :k], own[:k, k:]
        made[k:n, k:n], made[k:n, n:] = other.a, other.b
        made[n:, :k], made[n:, k:n] = share * own[k:, :k], (1.0 - share) * other.c
        made[n:, n:] = share * own[k:, k:] + (1.0 - share) * other.d
        return made

    def pull_back(self, theta: Array, slope: Array) -> Array:
        """Return the slopes of θ."""
        k, n = self.structure.order, self.order
        own = np.concatenate([np.arange(k), np.arange(n, n + self.measurements)])
        rows = np.concatenate([np.arange(k), np.arange(n, n + self.controls)])
        inner = slope[..., rows[:, None], own]
        weight = np.concatenate([np.ones(k), np.full(self.controls, self.share)])
        return self.structure.pull_back(theta, weight[:, None] * inner)

    def typical(self, sizes: Sizes) -> tuple[Array, Array]:
        """Return the structure's typical values."""
        return self.structure.typical(sizes)


def follow_blend(
    plants: Sequence[DesignPlant],
    structure: Structure,
    controller: LtiSystem,
    theta: Array,
    spread: Array,
) -> tuple[Array, float, int]:
    """Return θ at the end of the path, the λ there, and how often closed loops were made.

    Parameters
    ----------
    plants : sequence of DesignPlant
        All are closed by the same controller; limits and regions are left to the search after it.
    structure : Structure
        Gives K(θ).
    controller : LtiSystem
        K₀, from y to u.
    theta : ndarray, shape (size,)
        Where the path begins.
    spread : ndarray, shape (size,)
        Scale of θ.

    Returns
    -------
    tuple of ndarray, float, int
        λ is 1 if the path was followed to its end, and 0 if not even K₀, with a very small share of
        K(θ) or none, makes stable loops.
    """
    theta, share, step, count = np.asarray(theta, dtype=float), 0.0, _STEP, 0
    loops = [OpenLoop(plant, Blend(structure, controller, 1.0)) for plant in plants]
    middle, x = theta, np.zeros(theta.size)
    stable = False
    # an integrator of K(θ) makes stable loops only with a gain of its own
    for share in (0.0, _SHORTEST):
        objective = Objective(loops, Blend(structure, controller, share), middle, spread)
        count += 1
        if stable := bool(np.isfinite(objective.evaluate(x).value)):
            break
    if not stable:
        return middle, 0.0, count
    while share < 1.0:
        ahead = min(1.0, share + step)
        objective = Objective(loops, Blend(structure, controller, ahead), middle, spread)
        point = objective.evaluate(x)
        if not np.isfinite(point.value):
            count += objective.evaluations
            step *= 0.5
            if step < _SHORTEST:
                break
            continue
        point = descend(objective, point, iterations=_ITERATIONS)
        x, share, step = point.x, ahead, min(2.0 * step, _STEP)
        count += objective.evaluations
    return np.asarray(middle + spread * x), share, count
