"""The search from one start: stabilisation, BFGS descent, polishing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeGuard

import numpy as np

from hillsphere.errors import Interrupted
from hillsphere.interfaces import Array
from hillsphere_controllers.structured.active_plants import ActiveSet, minimise_active
from hillsphere_controllers.structured.closed_loop import OpenLoop
from hillsphere_controllers.structured.descent import descend, gradient_sampling
from hillsphere_controllers.structured.objective import Objective, Point
from hillsphere_controllers.structured.polish import polish_point, stationarity
from hillsphere_controllers.structured.records import KEPT, Problem, SearchResult, Start
from hillsphere_controllers.structured.route_names import STARTS
from hillsphere_controllers.structured.stabilise import stabilise
from hillsphere_controllers.structured.structure import Alike, Diagonal, Sizes, Structure

__all__ = ["Search"]

_SIZES = (10.0, 1.0, 30.0, 3.0, 100.0, 0.3)
"""Sizes of random starts in turn, in scaled parameters. Which minimum is reached depends on them,
and how large the gains of the best one are is not known: from 0.3 to 100 in half decades."""
_NEAR_SIZES = (0.3, 1.0, 0.1)
"""Likewise where the bandwidth is known."""
_POLISHED, _LEFT = 80, 30
"""Steps of polishing, and after the parts of a controller were lowered together."""
_DRAWS, _ATTEMPTS = 6, 3
"""Random starts of a search from which stabilisation is tried, and attempts to lower the parts of a
controller together. More of them cost time where no controller of the structure stabilises the
plants."""
_OFTEN = 10
"""In the descent, one point in so many is certified, and the last one."""
_HARDER = 10.0
"""Factor by which the penalty of violated constraints grows."""
_PENALTIES = 4
"""Rounds with a growing penalty at most; a still larger penalty makes the descent
ill-conditioned."""
STATIONARY = 1e-2
"""Norm of the certificate's residual, relative, up to which a point counts as a local minimum."""
_RESCALED, _WORTH = 3, 1e-5
"""Searches in the scale of the parameters found at most, and the relative decrease of γ that is
worth another one."""
_LEAST = 1e-3
"""Share of the largest scaled parameter below which the others are not scaled down further."""


class Reached(Exception):  # noqa: N818 - no error
    """A search is below its target."""


class Search:
    """Searches of one problem.

    Parameters
    ----------
    problem : Problem
        The problem.
    tell : callable or None
        Called with γ each time that a search finds a lower one. If it raises `Interrupted`, or
        KeyboardInterrupt, the best until then is returned.

    Raises
    ------
    InputError
        If its parts do not fit.
    """

    def __init__(self, problem: Problem, tell: Callable[[float], None] | None = None) -> None:
        self.problem, self._tell = problem, tell
        self.loops = [OpenLoop(plant, problem.structure) for plant in problem.plants]
        omega = problem.bandwidth_rad_s
        self._common = _mean_sizes(
            [loop.sizes if omega is None else loop.sizes_at(omega) for loop in self.loops]
        )
        self._sizes = _SIZES if omega is None else _NEAR_SIZES
        self.middle, self.spread = problem.structure.typical(self._common)

    def __call__(self, start: Start) -> SearchResult:
        """Search from one start and return its result."""
        random = np.random.default_rng(start.seed)
        structure = self.problem.structure
        objective = self._objective(structure, self.middle, self.spread)
        best = Best(objective, self._tell, self.problem.target)
        near = self.problem.near and start.theta is not None
        spent, active = 0, ActiveSet()
        try:
            together = start.route == STARTS and not near and start.perturbation == 0.0
            if _has_equal_parts(structure) and together:
                if start.theta is not None:
                    self._taken(start, objective, best)
                # equal parts are varied together first, then apart
                x, abscissa, spent = self._together(Alike(structure), start, random, best, active)
            else:
                x, abscissa = self._stable(start, random, objective)
            point = objective.evaluate(x)
            if not np.isfinite(point.value):
                if best.point is not None:
                    return self._result(start, objective, best.point)
                theta = objective.theta(x)
                return SearchResult(
                    start, theta, np.inf, abscissa, evaluations=objective.evaluations + spent
                )
            steps = _POLISHED if near else _LEFT if spent else 0
            converged = _minimise_from(objective, point, random, best, active, polish=steps)
        except Reached:
            converged = False
        except (KeyboardInterrupt, Interrupted):
            if best.point is None:
                raise
            return self._result(start, objective, best.point, interrupted=True)
        result = self._result(start, objective, best.known, converged=converged)
        return replace(result, evaluations=result.evaluations + spent)

    def rescaled(self, start: Start) -> SearchResult:
        """Return what searches find that go on from parameters, each in the scale of the last ones.

        In the scale of typical parameters the valley of a minimum with large gains is so narrow
        that a descent stagnates on its way; in that of the parameters found it is not.
        """
        assert start.theta is not None
        random = np.random.default_rng(start.seed)
        structure, theta, last, spent = self.problem.structure, start.theta, np.inf, 0
        result = SearchResult(start, theta, np.inf, np.inf)
        for _ in range(_RESCALED):
            size = np.abs((theta - self.middle) / self.spread)
            size = np.maximum(size, max(_LEAST * float(size.max()), 1e-300))
            objective = self._objective(structure, self.middle, self.spread * size)
            best = Best(objective, self._tell, self.problem.target)
            point = objective.evaluate((theta - self.middle) / self.spread / size)
            if not np.isfinite(point.value):
                break
            converged, stopped = False, False
            try:
                active = ActiveSet.highest(objective, point)
                converged = _minimise_from(objective, point, random, best, active)
            except Reached:
                stopped = True
            except (KeyboardInterrupt, Interrupted):
                if best.point is None:
                    raise
                return self._result(start, objective, best.point, interrupted=True)
            spent += objective.evaluations
            found = self._result(start, objective, best.known, converged=converged)
            result, theta = replace(found, evaluations=spent), found.theta
            if stopped or not found.gamma < last * (1.0 - _WORTH):
                break
            last = found.gamma
        return result

    def _objective(self, structure: Structure, middle: Array, spread: Array) -> Objective:
        problem = self.problem
        return Objective(
            self.loops, structure, middle, spread, problem.region, problem.largest_gain,
            problem.controller_stable,
        )  # fmt: skip

    def _taken(self, start: Start, objective: Objective, best: Best) -> None:
        """Take given parameters into account without a search."""
        point = objective.evaluate((np.asarray(start.theta) - self.middle) / self.spread)
        if np.isfinite(point.value):
            best.accept(point)

    def _together(
        self,
        alike: Alike,
        start: Start,
        random: np.random.Generator,
        best: Best,
        active: ActiveSet,
    ) -> tuple[Array, float, int]:
        """Return scaled parameters, the largest spectral abscissa, and evaluations of closed loops.

        The parts of the controller are lowered together: a gain that several of them hold up falls
        with all of them, where BFGS lowers that of one after the other. With parameters given, all
        parts begin at those of the first.
        """
        if start.theta is not None:
            start = replace(start, theta=np.asarray(start.theta)[: alike.size])
        middle, spread = alike.typical(self._common)
        objective = self._objective(alike, middle, spread)
        lowest = Best(objective, self._tell, self.problem.target)

        def apart(x: Array) -> Array:
            return np.asarray((alike.apart(objective.theta(x)) - self.middle) / self.spread)

        theta, least = self.middle, np.inf
        for _ in range(_ATTEMPTS):
            x, abscissa = self._stable(start, random, objective)
            least = min(least, abscissa)
            point = objective.evaluate(x)
            converged = False
            if np.isfinite(point.value):
                try:
                    converged = _minimise_from(objective, point, random, lowest, active)
                except (KeyboardInterrupt, Interrupted, Reached):
                    if lowest.point is not None:
                        best.accept(best.objective.evaluate(apart(lowest.point.x)))
                    raise
            theta = apart(lowest.known.x if lowest.point is not None else x)
            if converged:
                break
            start = replace(start, theta=None)  # stuck: another one
        return theta, least, objective.evaluations

    def _stable(
        self, start: Start, random: np.random.Generator, objective: Objective
    ) -> tuple[Array, float]:
        """Return scaled parameters, and the largest spectral abscissa they give, below 0 if stable.

        Where the loops cannot be stabilised from random ones, others are drawn.
        """
        middle, spread = objective.middle, objective.spread
        n, best = middle.size, (middle, np.inf)
        for draw in range(_DRAWS):
            if start.theta is None:
                x = self._sizes[(start.number + draw) % len(self._sizes)] * random.normal(size=n)
            else:
                x = (np.asarray(start.theta, dtype=float) - middle) / spread
                size = np.maximum(np.abs(x), 0.1 * max(1.0, float(np.abs(x).max())))
                x = x + start.perturbation * size * random.normal(size=n)
            found = stabilise(self.loops, objective.structure, middle, spread, x, random)
            if found[1] < 0.0 and np.isfinite(objective.evaluate(found[0]).value):
                return found
            # stable, but with poles so fast that it is not for certain in floating point
            found = found[0], max(found[1], 0.0)
            best = min(best, found, key=lambda pair: pair[1])
            if start.theta is not None and start.perturbation == 0.0:
                break
        return best

    def _result(
        self,
        start: Start,
        objective: Objective,
        point: Point,
        *,
        converged: bool = False,
        interrupted: bool = False,
    ) -> SearchResult:
        residual, active = stationarity(objective, point)
        abscissa = max(
            float(loop.response.poles.real.max(initial=-np.inf)) / open_loop.rate
            for loop, open_loop in zip(point.loops, self.loops, strict=True)
        )
        return SearchResult(
            start, objective.theta(point.x), float(np.exp(point.objective)), abscissa,
            point.excess, converged and residual < STATIONARY, residual, active,
            objective.evaluations, interrupted,
        )  # fmt: skip


class Best:
    """The best point of a search so far: the lowest that keeps the constraints.

    Parameters
    ----------
    objective : Objective
        What certifies the points.
    tell : callable or None
        Called with the γ of each that keeps the constraints.
    target : float
        One with a γ below this ends the search by `Reached`.
    """

    def __init__(
        self,
        objective: Objective,
        tell: Callable[[float], None] | None = None,
        target: float = 0.0,
    ) -> None:
        self.objective, self._tell, self.target = objective, tell, target
        self.point: Point | None = None
        self._count = 0

    @property
    def known(self) -> Point:
        """The point; there must have been one."""
        assert self.point is not None
        return self.point

    def remember(self, point: Point) -> Point:
        """Remember the peaks of a point that a method goes on from; now and then certify it.

        One that is not certified may be higher than it seems, and is not the best one.
        """
        self._count += 1
        if self._count % _OFTEN == 0:
            return self.accept(point)
        self.objective.remember(point)
        return point

    def accept(self, point: Point) -> Point:
        """Certify a point that a method goes on from, and take it into account."""
        return self._taken(self.objective.certify(point))

    def _taken(self, point: Point) -> Point:
        self.objective.remember(point)
        if np.isfinite(point.value):
            key = (max(point.excess - KEPT, 0.0), point.objective)
            old = self.point
            if old is None or key < (max(old.excess - KEPT, 0.0), old.objective):
                self.point = point
                gamma = float(np.exp(point.objective))
                if self._tell is not None and key[0] == 0.0:
                    self._tell(gamma)
                if key[0] == 0.0 and gamma < self.target:
                    raise Reached
        return point


def _has_equal_parts(structure: Structure) -> TypeGuard[Diagonal]:
    return isinstance(structure, Diagonal) and structure.alike


def _minimise_from(
    objective: Objective,
    point: Point,
    random: np.random.Generator,
    best: Best,
    active: ActiveSet,
    *,
    polish: int = 0,
) -> bool:
    """Minimise from a point; near a minimum only polish it, in at most `polish` steps.

    Returns whether polishing ended by itself.
    """

    def minimise(part: Objective, begun: Point, steps: int) -> tuple[Point, bool]:
        alone = part is objective
        lowest = best if alone else Best(part, target=best.target)
        try:
            converged = _minimise_all(part, begun, random, lowest, polish=steps)
        except Reached:
            if alone:
                raise
            converged = False
        except (KeyboardInterrupt, Interrupted):
            if not alone and lowest.point is not None:
                best.accept(objective.evaluate(lowest.point.x))
            raise
        return lowest.known, converged

    return minimise_active(
        objective, best.accept(point), active, minimise, best.accept, polish=polish,
        polish_again=polish or _POLISHED,
    )  # fmt: skip


def _minimise_all(
    objective: Objective,
    point: Point,
    random: np.random.Generator,
    best: Best,
    *,
    polish: int,
) -> bool:
    """Minimise for all plants of an objective, as `_minimise_from`."""
    point = best.accept(point)
    converged = False
    for _ in range(_PENALTIES):
        if not polish:
            point = descend(objective, point, iterations=150, accepted=best.remember)
            point = best.accept(point)
        iterations = polish or _POLISHED
        polished = polish_point(objective, point, accepted=best.remember, iterations=iterations)
        if not (polished.converged or polish):
            point = gradient_sampling(objective, best.accept(polished.point), random, rounds=1)
            polished = polish_point(objective, best.accept(point), accepted=best.remember)
        point, converged = best.accept(polished.point), polished.converged
        if point.excess <= KEPT:
            break
        # constraints are still violated: raise the penalty and go on from here
        objective.penalty *= _HARDER
        point = objective.evaluate(point.x)
    return converged


def _mean_sizes(sizes: Sequence[Sizes]) -> Sizes:
    """Return the geometric mean of the sizes of all plants."""

    def mean(values: Sequence[Array]) -> Array:
        return np.asarray(np.exp(np.mean(np.log(np.array(values)), axis=0)))

    return Sizes(
        mean([s.controls for s in sizes]),
        mean([s.measurements for s in sizes]),
        float(mean([np.array(s.rate) for s in sizes])),
    )
