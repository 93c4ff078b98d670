"""Minimisation for many plants by those that are highest; the others are checked where it ends.

The largest norm of many plants is held up by a few of them. A search lowers that of the highest
plants alone, then closes all loops at the point found: plants that are higher there than those
looked at, or not stable, join, and the search goes on, until none is left. The result is a minimum
for all plants, as an active-set method's, while most steps close a few loops only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hillsphere_controllers.structured.closed_loop import OpenLoop
from hillsphere_controllers.structured.objective import Objective, Point

__all__ = ["ActiveSet", "minimise_active"]

_FEW = 4
"""So many plants are looked at in every step: choosing among them would save nothing."""
_FIRST = 4
"""A search begins with so many plants: those farthest apart, which often bound what the others
need; near a minimum with the highest ones."""
_LOOKED = np.logspace(-2.0, 2.0, 9)
"""Frequencies, relative to the plants' typical rate, at which plants are compared."""
_HIGHER = 1e-6
"""Relative excess over the plants looked at from which on another plant joins: far below what
tells two minima apart."""
_FAR = 0.1
"""Where the largest norm of all plants exceeds that of those looked at by less (its logarithm),
polishing leads from one minimum to the other; else the descent begins anew."""


@dataclass
class ActiveSet:
    """Numbers of the plants that a search looks at; it grows from one minimisation to the next."""

    plants: frozenset[int] = frozenset()

    @classmethod
    def highest(cls, objective: Objective, point: Point) -> ActiveSet:
        """Return the plants that are highest at a point."""
        order = np.argsort(-objective.levels(point), kind="stable")
        return cls(frozenset(order[:_FIRST].tolist()))


Minimise = Callable[[Objective, Point, int], tuple[Point, bool]]
"""Minimises from a point, only polishing in so many steps at most if these are above zero; returns
the lowest point, and whether polishing ended by itself."""


def minimise_active(
    objective: Objective,
    point: Point,
    active: ActiveSet,
    minimise: Minimise,
    accept: Callable[[Point], Point],
    *,
    polish: int,
    polish_again: int,
) -> bool:
    """Minimise for all plants of an objective; return whether the last polishing ended by itself.

    Parameters
    ----------
    objective : Objective
        Of all plants.
    point : Point
        Where to start, stable for all plants.
    active : ActiveSet
        Plants to begin with, besides the highest ones; those that joined are added.
    minimise : callable
        Minimises for some plants.
    accept : callable
        Certifies a point of all plants, and takes it into account.
    polish, polish_again : int
        Steps of polishing: of the first minimisation, zero for a whole one, and of those after it.
    """
    count = len(objective.loops)
    if count <= _FEW:
        return minimise(objective, point, polish)[1]
    known = active.plants
    if len(known) < _FIRST:
        highest = ActiveSet.highest(objective, point).plants
        known |= highest if polish else set(farthest_plants(objective.loops, _FIRST))
    while True:
        places = sorted(known)
        part = objective.restricted(places)
        try:
            lowest, converged = minimise(part, part.evaluate(point.x), polish)
        finally:
            objective.take_over(part, places)
            active.plants = known
        ended = objective.evaluate(lowest.x)
        if np.isfinite(ended.value):
            ended = accept(ended)
            levels = objective.levels(ended, max(lowest.excess, 0.0))
            higher = levels > lowest.objective + _HIGHER
            order = [j for j in np.argsort(-levels, kind="stable").tolist() if higher[j]]
            near = ended.objective < lowest.objective + _FAR
            point, polish = ended, polish_again if near or polish else 0
        else:  # on from the last point at which all are stable
            order = objective.unstable(lowest.x)
        # the set doubles at most: few rounds, and few plants that do not matter
        joined = [j for j in order if j not in known][: len(known)]
        if not joined:
            # an end at which a plant is unstable was not accepted
            return converged and bool(np.isfinite(ended.value))
        known |= set(joined)


def farthest_plants(loops: Sequence[OpenLoop], count: int) -> list[int]:
    """Return the plants that are farthest apart by their frequency responses, at most `count`.

    The first is that farthest from the mean of all, each other one that farthest from those taken.
    Entries are relative to the largest among the plants. Of plants of several shapes those of the
    first one's shape are compared.
    """
    shape = loops[0].plant.system.shape
    alike = [j for j, loop in enumerate(loops) if loop.plant.system.shape == shape]
    omega = loops[0].rate * _LOOKED
    made = np.array([loops[j].plant.system.response(omega).ravel() for j in alike])
    made /= np.maximum(np.abs(made).max(axis=0), 1e-300)
    far = np.linalg.norm(made - made.mean(axis=0), axis=1)
    taken: list[int] = []
    for _ in range(min(count, len(alike))):
        taken.append(int(np.argmax(far)))
        apart = np.linalg.norm(made - made[taken[-1]], axis=1)
        far = apart if len(taken) == 1 else np.minimum(far, apart)
    return [alike[k] for k in taken]
