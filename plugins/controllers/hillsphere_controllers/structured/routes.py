"""Routes to a minimum of a structured synthesis besides random starts.

Each ends with the search of `search.Search`; they differ by where it begins and so by why they
fail. A route from another controller follows a path of stable loops (`continuation`); a gain bound
that is released in steps leads to minima with small gains and to those at infinite gain along their
valleys. At its end each search goes on in the scale of the parameters found, in which the valleys
of large gains are not narrow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.lti import LtiSystem
from hillsphere_controllers.structured.continuation import follow_blend
from hillsphere_controllers.structured.descent import descend
from hillsphere_controllers.structured.neighbours import larger_structure, smaller_structure
from hillsphere_controllers.structured.objective import Objective
from hillsphere_controllers.structured.records import Problem, SearchResult, Start
from hillsphere_controllers.structured.reduced_start import (
    gain_size,
    reduced_start,
    static_starts,
)
from hillsphere_controllers.structured.route_names import BOUNDED, FULL_ORDER, LARGER, SMALLER
from hillsphere_controllers.structured.search import Search
from hillsphere_controllers.structured.stabilise import stabilise
from hillsphere_controllers.structured.structure import Diagonal, Structure, controller_of

__all__ = ["RouteSearch", "applicable_routes"]

_BOUNDS = (1.0, 10.0, 0.1)
"""First gain bounds of the route that releases them, in units of the gain of typical parameters.
The very first is of the gain of the controller of full order, which knows better what the plant
needs."""
_INSIDE, _DRAWS = 0.5, 6
"""Size of the first gains in units of the bound, and how often they are drawn until they can be
made to stabilise the plants."""
_ABOUT = 0.1
"""Scatter about zero gains, where a double pole has no slope."""
_RELEASES = (1.0, 10.0, 100.0)
"""Multiples of the first bound at which the search stays for some steps."""
_STAY = 60
"""Steps of descent under each bound."""


@dataclass(frozen=True)
class _Begun:
    """Where the search of a route begins; none, with a remark, if the route leads nowhere."""

    theta: Array | None
    remark: str = ""
    evaluations: int = 0
    interrupted: bool = False


class RouteSearch:
    """Searches of one problem by any route.

    Parameters
    ----------
    problem : Problem
        The problem.
    tell : callable or None
        As of `Search`.
    """

    def __init__(self, problem: Problem, tell: Callable[[float], None] | None = None) -> None:
        self._search, self._tell = Search(problem, tell), tell

    def __call__(self, start: Start) -> SearchResult:
        """Search from one start, by its route, and return the result."""
        if start.rescaled:
            return self._search.rescaled(start)
        prepare = {
            FULL_ORDER: self._from_full_order,
            LARGER: self._from_larger,
            SMALLER: self._from_smaller,
            BOUNDED: self._from_bound,
        }.get(start.route)
        if prepare is None:
            return self._search(start)
        begun = prepare(start, np.random.default_rng(start.seed))
        if begun.theta is None:
            none = np.full(self._search.problem.structure.size, np.nan)
            return SearchResult(
                start, none, np.inf, np.inf, evaluations=begun.evaluations,
                interrupted=begun.interrupted, note=begun.remark,
            )  # fmt: skip
        result = self._search(replace(start, theta=begun.theta))
        spent = begun.evaluations + result.evaluations
        if result.allowed and not result.interrupted and not result.settled:
            better = self._search.rescaled(replace(start, theta=result.theta))
            spent += better.evaluations
            if better.allowed and better.gamma < result.gamma:
                result = better
            result = replace(result, interrupted=better.interrupted)
        note = "" if result.allowed else "no allowed controller was found at its end"
        return replace(result, start=start, evaluations=spent, note=note)

    def _from_full_order(self, start: Start, random: np.random.Generator) -> _Begun:
        full = self._search.problem.full
        if full is None:
            return _Begun(None, "no controller of full order was found")
        return self._along(start.variant, full.plant, full.controller, random)

    def _from_larger(self, start: Start, random: np.random.Generator) -> _Begun:
        problem = self._search.problem
        more = larger_structure(problem.structure)
        found = self._neighbour(more, start)
        if not found.allowed or found.interrupted:
            return _Begun(
                None, "no controller of the larger structure was found", found.evaluations,
                found.interrupted,
            )  # fmt: skip
        plant = problem.plants[0].system
        # the other way round: from the middle of the parameters first
        begun = self._along(
            1 - start.variant if start.variant < 2 else start.variant, plant,
            controller_of(more, found.theta), random,
        )  # fmt: skip
        return replace(begun, evaluations=begun.evaluations + found.evaluations)

    def _along(
        self,
        variant: int,
        plant: LtiSystem,
        controller: LtiSystem,
        random: np.random.Generator,
    ) -> _Begun:
        """Return the end of the path from a controller.

        The path's first K(θ) is in turn nearest to the controller, the middle of the typical
        parameters, the nearest, and random. Instead of the first path, a constant gain like the
        controller's at some frequency is taken if there is one that stabilises the plants.
        """
        search = self._search
        structure, middle = search.problem.structure, search.middle
        firsts = [middle]
        if variant in (0, 2):
            nearest, constants = self._like(plant, controller)
            constant = self._lowest(constants)
            if variant == 0 and constant is not None:
                return _Begun(constant)
            # where the nearest one is unstable itself the path begins at the middle
            firsts = [middle] if nearest is None else [nearest, middle]
        elif variant > 2:
            firsts = []
        # random ones: first choice of the later paths, and where an integrator needs the right sign
        firsts += [middle + search.spread * random.normal(size=middle.size) for _ in range(_DRAWS)]
        count = 0
        for first in firsts:
            theta, share, more = follow_blend(
                search.problem.plants, structure, controller, first, search.spread
            )
            count += more
            if share > 0.0:
                return _Begun(theta, "", count)
        return _Begun(None, "its first loops are not stable for all plants", count)

    def _like(self, plant: LtiSystem, controller: LtiSystem) -> tuple[Array | None, list[Array]]:
        """Return the parameters nearest to a controller, and those of constant gains like it."""
        search = self._search
        structure, middle = search.problem.structure, search.middle
        try:
            return (
                reduced_start(plant, controller, structure, middle, search.loops[0].rate),
                static_starts(plant, controller, structure, middle),
            )
        except (InputError, np.linalg.LinAlgError):
            # poles so near the imaginary axis that there is no balanced form, or a loop that is
            # not well posed in floating point: the path begins elsewhere
            return None, []

    def _lowest(self, starts: Sequence[Array]) -> Array | None:
        """Return the parameters whose loops are stable with the lowest norm, none if none are."""
        search = self._search
        objective = Objective(search.loops, search.problem.structure, search.middle, search.spread)
        points = [objective.evaluate((theta - search.middle) / search.spread) for theta in starts]
        stable = [point for point in points if np.isfinite(point.value)]
        if not stable:
            return None
        return objective.theta(min(stable, key=lambda point: point.value).x)

    def _from_smaller(self, start: Start, random: np.random.Generator) -> _Begun:
        pair = smaller_structure(self._search.problem.structure)
        assert pair is not None  # the route is planned only where there is one
        less, pad = pair
        found = self._neighbour(less, start)
        if not found.allowed or found.interrupted:
            return _Begun(
                None, "no controller of the order below was found", found.evaluations,
                found.interrupted,
            )  # fmt: skip
        search = self._search
        theta = pad(found.theta, search.middle, search.spread, search.loops[0].rate, random)
        return _Begun(theta, "", found.evaluations)

    def _neighbour(self, structure: Structure, start: Start) -> SearchResult:
        problem = replace(
            self._search.problem, structure=structure, near=False, target=0.0, full=None
        )
        tell = self._tell

        def hear(gamma: float) -> None:
            # progress is told of controllers of the structure only; a stop is noticed here too
            if tell is not None:
                tell(np.inf)

        search = Search(problem, hear)
        if start.variant == 0 and structure.order == 0:
            return search(Start(0, start.seed, search.middle, _ABOUT))
        return search(Start(start.variant, start.seed))

    def _from_bound(self, start: Start, random: np.random.Generator) -> _Begun:
        search = self._search
        problem, structure = search.problem, search.problem.structure
        plain = Objective(search.loops, structure, search.middle, search.spread)
        typical = float(np.linalg.norm(structure.gains(search.middle + search.spread)))
        variants = [by * typical for by in _BOUNDS]
        if problem.full is not None:
            variants.insert(0, gain_size(problem.full.plant, problem.full.controller))
        bound = variants[start.variant % len(variants)]
        for _ in range(_DRAWS):
            x = _INSIDE * bound / typical * random.normal(size=structure.size)
            x, abscissa = stabilise(
                search.loops, structure, search.middle, search.spread, x, random
            )
            if abscissa < 0.0:
                break
        if not abscissa < 0.0:
            return _Begun(None, "no stabilising controller was found", plain.evaluations)
        spent = plain.evaluations
        for release in _RELEASES:
            limit = min(bound * release, problem.largest_gain or np.inf)
            objective = Objective(
                search.loops, structure, search.middle, search.spread, problem.region, limit,
                problem.controller_stable,
            )  # fmt: skip
            point = objective.evaluate(x)
            if np.isfinite(point.value):
                x = descend(objective, point, iterations=_STAY).x
            spent += objective.evaluations
        return _Begun(plain.theta(x), "", spent)


def applicable_routes(problem: Problem) -> tuple[tuple[str, ...], dict[str, str]]:
    """Return the routes that apply to a problem, and why the others do not.

    Parameters
    ----------
    problem : Problem
        With the controller of full order, if there is one.

    Returns
    -------
    tuple of tuple of str and dict
        Names in the order in which they are tried; remarks by name.
    """
    applied: list[str] = []
    remarks: dict[str, str] = {}
    if problem.full is None:
        remarks[FULL_ORDER] = "no controller of full order was found"
    else:
        applied.append(FULL_ORDER)
    applied.append(LARGER)
    if smaller_structure(problem.structure) is None:
        if problem.structure.order == 0:
            remarks[SMALLER] = "a static gain has no order below"
        else:
            kind = type(problem.structure).__name__
            parts = isinstance(problem.structure, Diagonal)
            remarks[SMALLER] = (
                f"{'the parts of this structure have' if parts else f'this {kind} has'} no "
                "order below that is contained in it"
            )
    else:
        applied.append(SMALLER)
    applied.append(BOUNDED)
    return tuple(applied), remarks
