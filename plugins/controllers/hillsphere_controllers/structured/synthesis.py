r"""Synthesis of a controller of a fixed structure for one or many plants.

.. math::

    \min_θ \max_{j, c} \; w_{jc} \, \| T_{jc}(K(θ)) \|

over the channels c of the plants j, where every closed loop is to be stable. The function is
neither smooth nor convex. From each of several starts the loops are stabilised, the largest norm is
lowered by BFGS, and the peaks that are equally high at its minimum are lowered together by
sequential quadratic programming [1]_, [2]_; the best are then perturbed and lowered again. The
results are local minima. Searches by other routes follow (`routes`), and the verdict says which of
them arrive at the same γ, and how far it is above a lower bound (`verdict`).

References
----------
.. [1] J. V. Burke, D. Henrion, A. S. Lewis, M. L. Overton (2006), HIFOO - a MATLAB package for
   fixed-order controller design and H∞ optimization, IFAC Proceedings 39(9), 339-344.
.. [2] P. Apkarian, D. Noll (2006), Nonsmooth H∞ synthesis, IEEE Transactions on Automatic Control
   51(1), 71-86.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from hillsphere.errors import InputError, Interrupted
from hillsphere.interfaces import Array, Context
from hillsphere.lti import LtiSystem
from hillsphere_controllers.structured.choice import SAME, best_verified, explain_failure
from hillsphere_controllers.structured.effort import Effort, effort_number
from hillsphere_controllers.structured.polish import Active
from hillsphere_controllers.structured.records import Problem, SearchResult, Start
from hillsphere_controllers.structured.reduced_start import reduced_start
from hillsphere_controllers.structured.requirements import DesignPlant, PoleRegion
from hillsphere_controllers.structured.route_names import RESTARTS, STARTS
from hillsphere_controllers.structured.routes import applicable_routes
from hillsphere_controllers.structured.search import Search
from hillsphere_controllers.structured.search_runs import Progress, SearchRun
from hillsphere_controllers.structured.structure import Diagonal, Structure, controller_of
from hillsphere_controllers.structured.verdict import Verdict, make_verdict
from hillsphere_controllers.structured.verification import (
    Verified,
    full_order,
)

__all__ = ["StructuredDesign", "synthesise"]

_SHAKES = (1.0, 1e-1, 1e-2)
"""Scatter of the second searches around a good minimum, relative: wide ones leave its basin, narrow
ones finish its convergence. The last is left out for a minimum that has converged."""
_ABOUT = 0.1
"""Scatter of a start around zero gains. There the gradient by the gains of the states vanishes, so
that exactly zero would be a saddle."""
_KEPT = 3
"""Different minima around which second searches begin."""
_ENOUGH = 3
"""Routes that arrived at the best γ, the starts among them, beyond which only a larger effort than
the normal one searches on."""
_NEARBY = 0.05
"""Minima whose γ is higher than the best by more, relative, are not searched on from in their own
scale: that has lowered none by so much."""


@dataclass(frozen=True)
class StructuredDesign:
    """A controller of a fixed structure, its γ and the searches for it.

    Parameters
    ----------
    controller : LtiSystem
        u = K(s) y, without a change of sign.
    theta : ndarray, shape (size,)
        Its parameters in the structure.
    gamma : float
        Largest weighted norm of the channels without a limit, computed anew from the closed loops
        of the plants as they were given.
    verified : Verified
        Norms of all channels and closed loops' largest real parts of poles, computed so.
    residual : float
        Least |Σ λ g| max(1, |x|) of multipliers λ and gradients g of the logarithms of the peaks
        that are equally high, in scaled parameters x: zero at a local minimum. A change of x
        by a share s of |x| lowers γ, to first order, by no more than the share s times this. It is
        not small where the method got stuck. It may be small where γ is an infimum that no finite
        gain reaches: look at `theta`, and see `largest_gain` of `synthesise`.
    active : tuple of Active
        Peaks and constraints that hold the minimum, with their multipliers.
    converged : bool
        Whether the last step promised no more than 1e-7 of γ and the residual is below 1e-2. It is
        a sign of a local minimum, and no certificate: it says nothing of other minima (see
        `starts`), nor of whether the gradients were all seen where singular values coincide. It
        may be False at an optimum whose gain is the same over a range of frequencies, which no few
        peaks hold, as that of a controller of full order: compare γ with `lower_bound` there.
    lower_bound : float
        No controller of any order or structure reaches a γ below this; 0 if nothing is known, as
        for plants to which the Riccati equations do not apply.
    starts : ndarray, shape (starts,)
        γ of every start; infinite where no allowed controller was found.
    ends : ndarray, shape (starts, size)
        Parameters at which they ended; NaN where no allowed controller was found.
    shaken : ndarray, shape (K,)
        γ of the searches that began near the best of them.
    interrupted : bool
        Whether the synthesis was stopped: the best until then.
    evaluations : int
        How often a set of closed loops was made.
    verdict : Verdict
        Which routes arrived at γ, and its gap to controllers of full order.
    equals : ndarray, shape (E, 2)
        Of the controllers between which a preference decided: γ, and the value that was to be
        small; the one that was taken stands first. None without a preference.
    """

    controller: LtiSystem
    theta: Array
    gamma: float
    verified: Verified
    residual: float
    active: tuple[Active, ...]
    converged: bool
    lower_bound: float
    starts: Array
    ends: Array
    shaken: Array
    interrupted: bool
    evaluations: int
    verdict: Verdict
    equals: Array = field(default_factory=lambda: np.zeros((0, 2)))


def synthesise(
    plants: DesignPlant | Sequence[DesignPlant],
    structure: Structure,
    *,
    starts: int = 10,
    seed: int = 1,
    effort: Effort = "normal",
    initial: Iterable[Array] = (),
    scatter: float = 0.0,
    target: float = 0.0,
    region: PoleRegion | None = None,
    largest_gain: float | None = None,
    controller_stable: bool = False,
    bandwidth_rad_s: float | None = None,
    shaken: bool = True,
    prefer: Callable[[LtiSystem], float] | None = None,
    tie: float = 1e-3,
    name: str = "",
    progress: Callable[[Progress], None] | None = None,
    ctx: Context | None = None,
) -> StructuredDesign:
    """Return the best controller found from several starts.

    Parameters
    ----------
    plants : DesignPlant or sequence of DesignPlant
        All are closed by the same controller.
    structure : Structure
        Of the controller.
    starts : int
        How many: those of `initial`, one about the middle of the structure's typical parameters,
        one from the controller of full order if there is one and K is linear in the parameters, and
        random ones; 0: those of `initial` alone, which are near a minimum.
    seed : int
        Of all that is random; with it the result is the same, for any number of workers.
    effort : {"quick", "normal", "thorough"} or float
        How many searches follow by other routes (`route_names`), in units of `starts`: 0, 1 and 5,
        or any number ≥ 0. With more than 1 so many more random starts follow too. A route's
        controller is taken only if its γ is lower by more than 1e-4, relative. None follow where
        the starts reach the lower bound or the target, or are all near given parameters.
    initial : iterable of ndarray, shape (size,)
        Parameters to begin with.
    scatter : float
        If positive, the starts beyond those of `initial` are not random controllers, but the first
        of `initial` with its scaled parameters changed at random by this, relative; all are taken
        to be near a minimum, so that polishing will do.
    target : float
        A search ends once γ is below this; 0: none does.
    region : PoleRegion or None
        Where all closed loops' poles are to be; None: in the left half-plane.
    largest_gain : float or None
        Limit of the Frobenius norm of K: some plants have their infimum at infinite gain.
    controller_stable : bool
        Whether the controller itself is to be stable: its poles are kept below zero by a
        hundred-thousandth of the plants' rate at least.
    bandwidth_rad_s : float or None
        About the bandwidth expected: the scale of the parameters, and so of random starts, follows
        from the plants' gains there; None: from the sizes of all their poles, those of weights
        among them.
    shaken : bool
        Whether searches near the best controllers follow.
    prefer : callable or None
        Of the controllers whose γ is the best one within `tie`, that for which this is smallest is
        returned; None: the one with the best γ.
    tie : float
        Relative.
    name : str
        Tells this synthesis from others of one stage, where searches are kept.
    progress : callable or None
        Called each time a search has ended, and of those in this process, not in a worker, when one
        has found a lower γ. An exception that it raises ends the synthesis; if that is
        KeyboardInterrupt, as from the keyboard, or `hillsphere.errors.Interrupted`, the best until
        then is returned.
    ctx : Context or None
        Of the stage: the workers of its executor do the searches, and its workspace keeps what
        those found that have ended: an interrupted run that is resumed does not repeat them. None:
        this process does them.

    Returns
    -------
    StructuredDesign
        Controller, its γ recomputed, and what is known of its quality.

    Raises
    ------
    InputError
        If sizes, numbers or channels do not fit.
    NotStabilisableError
        If no controller, or none that was found, stabilises all plants.
    SynthesisFailedError
        If none that was found keeps the constraints, or what was found does not pass the check.
    """
    many = (plants,) if isinstance(plants, DesignPlant) else tuple(plants)
    given = [np.asarray(theta, dtype=float) for theta in initial]
    if not many or starts < (0 if given else 1):
        raise InputError(f"a synthesis needs a plant and a start, got {len(many)} and {starts}")
    if not isinstance(starts, int | np.integer):
        raise InputError(f"starts must be a whole number, got {starts}")
    if any(theta.shape != (structure.size,) or not np.isfinite(theta).all() for theta in given):
        raise InputError(
            f"initial parameters must be {structure.size} finite numbers each, as the structure has"
        )
    if not 0.0 <= scatter < np.inf or (scatter and not given):
        raise InputError(f"a scatter is about initial parameters, ≥ 0 and finite, got {scatter}")
    if not 0.0 <= target < np.inf:
        raise InputError(f"a target must be ≥ 0 and finite, got {target}")
    if largest_gain is not None and not largest_gain > 0.0:
        raise InputError(f"a limit of the gain must be > 0, got {largest_gain}")
    if bandwidth_rad_s is not None and not 0.0 < bandwidth_rad_s < np.inf:
        raise InputError(f"a bandwidth must be > 0 and finite, got {bandwidth_rad_s}")
    amount = effort_number(effort)
    confined = starts == 0 or scatter > 0.0
    full = full_order(many, structure)
    least = 0.0 if full is None else full.bound
    routed = full
    if routed is None and amount > 0.0 and not confined:
        routed = full_order(many, structure, regularised=True)
    problem = Problem(
        many, structure, region, largest_gain, controller_stable, bandwidth_rad_s,
        near=confined, target=target, full=routed,
    )  # fmt: skip
    search = Search(problem)
    run = SearchRun(problem, progress, ctx, name)
    alike = isinstance(structure, Diagonal) and structure.alike
    begun = [(theta, 0.0) for theta in given]
    if scatter:
        begun += [(given[0], scatter)] * (starts - len(given))
    elif not alike:
        # zero gains are a saddle for a controller with states: about them
        begun.append((search.middle, _ABOUT))
    count = max(starts, len(begun)) if starts else len(given)
    if full is not None and len(begun) < count:
        rate = search.loops[0].rate
        theta = reduced_start(full.plant, full.controller, structure, search.middle, rate)
        begun += [] if theta is None else [(theta, 0.0)]
    first = run.all(
        [Start(i, _seed(seed, i), *begun[i] if i < len(begun) else (None,)) for i in range(count)]
    )
    good = _sort_allowed(first)
    second: list[SearchResult] = []
    if shaken and good and not run.interrupted and good[0].gamma > least * (1.0 + SAME):
        second = run.all(_perturbed_starts(good, seed, count))
    base = _sort_allowed(first + second)
    reached = base[0].gamma if base else np.inf
    if count > 1 and alike and base and not (confined or run.interrupted or base[0].settled):
        # searches of equal parts end after some steps of them apart: only the best one goes on
        place = count + len(second)
        if reached >= max(target, least * (1.0 + SAME)):
            second += run.all(
                [Start(place, _seed(seed, place), base[0].theta, 0.0, RESTARTS, 0, True)]
            )
            base = _sort_allowed(first + second)
            reached = base[0].gamma
    ended = confined or reached < max(target, least * (1.0 + SAME))
    others: list[SearchResult] = []
    remarks: dict[str, str] = {}
    if amount > 0.0 and not ended:
        others, remarks = _search_routes(run, problem, first + second, amount, count, seed, shaken)
    candidates = base + [f for f in _sort_allowed(others) if f.gamma < reached * (1.0 - SAME)]
    candidates.sort(key=lambda f: f.gamma)
    if not candidates:
        if run.interrupted:
            raise Interrupted("stopped before any allowed controller was found")
        raise explain_failure(first + others)
    best, check, equals = best_verified(problem, candidates, prefer, tie)
    return StructuredDesign(
        controller_of(structure, best.theta),
        best.theta,
        check.gamma,
        check,
        best.residual,
        best.active,
        best.converged,
        least,
        np.array([f.gamma if f.allowed else np.inf for f in first]),
        np.array([f.theta if f.allowed else np.full(structure.size, np.nan) for f in first]),
        np.array([f.gamma if f.allowed else np.inf for f in second]),
        run.interrupted,
        sum(f.evaluations for f in first + second + others),
        make_verdict(
            first + second + others, remarks, check.gamma, least,
            np.inf if routed is None else routed.gamma,
            confined=confined or check.gamma < target,
        ),
        equals,
    )  # fmt: skip


def _search_routes(
    run: SearchRun,
    problem: Problem,
    known: Sequence[SearchResult],
    amount: float,
    count: int,
    seed: int,
    shaken: bool,
) -> tuple[list[SearchResult], dict[str, str]]:
    """Return the results of searches by other routes, and why some routes do not apply.

    The first searches are one by each route. The others follow unless several routes have arrived
    at one γ already.
    """
    routes, remarks = applicable_routes(problem)
    places = iter(range(len(known), 1 << 30))
    searches = int(np.ceil(amount * count))

    def start(
        route: str,
        variant: int,
        theta: Array | None = None,
        *,
        perturbation: float = 0.0,
        rescaled: bool = False,
    ) -> Start:
        place = next(places)
        return Start(place, _seed(seed, place), theta, perturbation, route, variant, rescaled)

    kinds = len(routes)
    planned = [start(routes[i % kinds], i // kinds) for i in range(searches)]
    more = round(max(0.0, amount - 1.0) * count)
    planned += [start(STARTS, count + i) for i in range(more)]
    results: list[SearchResult] = [] if run.interrupted else run.all(planned[:kinds])
    best = _sort_allowed([*known, *results])
    agreeing = 0
    if best:
        so_far = make_verdict([*known, *results], {}, best[0].gamma, 0.0, np.inf)
        agreeing = len(so_far.arrived)
    if not run.interrupted and (amount > 1.0 or agreeing < _ENOUGH):
        results += run.all(planned[kinds:])
    pool = _sort_allowed([*known, *results])
    if run.interrupted or not pool:
        return results, remarks
    lowest = pool[0]
    # the others have gone on in their own scale already
    last = [
        start(one.start.route, 0, one.theta, rescaled=True)
        for one in _different(pool)
        if one.start.route in (STARTS, RESTARTS)
        and not one.settled
        and one.gamma <= lowest.gamma * (1.0 + _NEARBY)
    ]
    if shaken and lowest.start.route not in (STARTS, RESTARTS):
        last += [start(RESTARTS, 0, lowest.theta, perturbation=by) for by in _SHAKES[:2]]
    return results + run.all(last), remarks


def _sort_allowed(results: Iterable[SearchResult]) -> list[SearchResult]:
    return sorted((f for f in results if f.allowed), key=lambda f: f.gamma)


def _different(good: Sequence[SearchResult]) -> list[SearchResult]:
    """Return the best different minima."""
    different: list[SearchResult] = []
    for result in good:
        if all(abs(result.gamma - f.gamma) > SAME * f.gamma for f in different):
            different.append(result)
    return different[:_KEPT]


def _seed(seed: int, number: int) -> int:
    return int(np.random.SeedSequence(seed, spawn_key=(number,)).generate_state(1)[0])


def _perturbed_starts(good: Sequence[SearchResult], seed: int, number: int) -> list[Start]:
    """Return starts near the best different minima, at most as many as there were."""
    starts: list[Start] = []
    for result in _different(good):
        for shake in _SHAKES[: 2 if result.settled else None]:
            place = number + len(starts)
            starts.append(Start(place, _seed(seed, place), result.theta, shake, RESTARTS))
    return starts[:number]
