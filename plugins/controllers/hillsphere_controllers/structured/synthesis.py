r"""Synthesis of a controller of a fixed structure for one or many plants.

.. math::

    \min_θ \max_{j, c} \; w_{jc} \, \| T_{jc}(K(θ)) \|

over the channels c of the plants j, where every closed loop is to be stable. The function is
neither smooth nor convex. From each of several starts the loops are stabilised, the largest norm is
lowered by BFGS, and the peaks that are equally high at its minimum are lowered together by
sequential quadratic programming [1]_, [2]_; the best are then perturbed and lowered again. The
results are local minima. The number of starts that reach the best one, and a lower bound, show how
good it is.

References
----------
.. [1] J. V. Burke, D. Henrion, A. S. Lewis, M. L. Overton (2006), HIFOO - a MATLAB package for
   fixed-order controller design and H∞ optimization, IFAC Proceedings 39(9), 339-344.
.. [2] P. Apkarian, D. Noll (2006), Nonsmooth H∞ synthesis, IEEE Transactions on Automatic Control
   51(1), 71-86.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hillsphere.errors import InputError, Interrupted
from hillsphere.interfaces import Array, Context
from hillsphere.lti import LtiSystem
from hillsphere.runs.workers import Workers
from hillsphere_controllers.errors import NotStabilisableError, SynthesisFailedError
from hillsphere_controllers.structured.polish import Active
from hillsphere_controllers.structured.reduced_start import reduced_start
from hillsphere_controllers.structured.requirements import DesignPlant, PoleRegion
from hillsphere_controllers.structured.search import Problem, Search, SearchResult, Start
from hillsphere_controllers.structured.search_store import SearchStore
from hillsphere_controllers.structured.structure import Diagonal, Structure, controller_of
from hillsphere_controllers.structured.verification import Verified, full_order, verify_controller

__all__ = ["Progress", "StructuredDesign", "synthesise"]

_SHAKES = (1.0, 1e-1, 1e-2)
"""Scatter of the second searches around a good minimum, relative: wide ones leave its basin, narrow
ones finish its convergence. The last is left out for a minimum that has converged."""
_ABOUT = 0.1
"""Scatter of a start around zero gains. There the gradient by the gains of the states vanishes, so
that exactly zero would be a saddle."""
_KEPT = 3
"""Different minima around which second searches begin."""
_SAME = 1e-4
"""Minima whose γ differ by less, relative, are taken for the same."""
_SETTLED = 1e-5
"""Residual of the certificate below which a minimum needs no narrow second search."""


@dataclass(frozen=True)
class Progress:
    """Progress of a synthesis, reported when a search has ended or has found a lower γ.

    Parameters
    ----------
    done, total : int
        Searches that have ended, and all that are planned so far.
    latest : SearchResult or None
        What the last one found; None while one goes on.
    gamma : float
        The smallest γ so far; infinite if there is none.
    current : float
        The smallest γ so far of the search that goes on, or that has ended.
    """

    done: int
    total: int
    latest: SearchResult | None
    gamma: float
    current: float


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
    equals: Array = field(default_factory=lambda: np.zeros((0, 2)))


def synthesise(
    plants: DesignPlant | Sequence[DesignPlant],
    structure: Structure,
    *,
    starts: int = 10,
    seed: int = 1,
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
    problem = Problem(
        many, structure, region, largest_gain, controller_stable, bandwidth_rad_s,
        near=starts == 0 or scatter > 0.0, target=target,
    )  # fmt: skip
    search = Search(problem)
    full = full_order(many, structure)
    least = 0.0 if full is None else full.bound
    run = _Run(problem, progress, ctx, name)
    begun = [(theta, 0.0) for theta in given]
    if scatter:
        begun += [(given[0], scatter)] * (starts - len(given))
    elif not (isinstance(structure, Diagonal) and structure.alike):
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
    good = sorted((f for f in first if f.allowed), key=lambda f: f.gamma)
    second: list[SearchResult] = []
    if shaken and good and not run.interrupted and good[0].gamma > least * (1.0 + _SAME):
        second = run.all(_perturbed_starts(good, seed, count))
    candidates = sorted(good + [f for f in second if f.allowed], key=lambda f: f.gamma)
    if not candidates:
        raise _failure(first)
    best, check, equals = _best_verified(problem, candidates, prefer, tie)
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
        sum(f.evaluations for f in first + second),
        equals,
    )


class _Run:
    """Runs searches in this process or in workers, until they have ended or the user stops them."""

    def __init__(
        self,
        problem: Problem,
        progress: Callable[[Progress], None] | None,
        ctx: Context | None,
        name: str,
    ) -> None:
        self._problem = problem
        self._progress, self._ctx = progress, ctx
        self.interrupted = False
        self._done, self._total, self._gamma = 0, 0, np.inf
        self._kept: SearchStore | None = None
        if ctx is not None:
            directory = ctx.workspace() / f"searches-{ctx.fingerprint[:16]}{name}"
            self._kept = SearchStore(directory, ctx.info)

    def all(self, starts: Sequence[Start]) -> list[SearchResult]:
        """Return the results of all searches, or of the finished ones after an interruption."""
        self._total += len(starts)
        by_start: dict[int, SearchResult] = {}
        try:
            with closing(self._iterate_results(starts)) as results:
                for one in results:
                    by_start[one.start.number] = one
                    self._report_result(one)
                    if self.interrupted:
                        break
        except (KeyboardInterrupt, Interrupted):
            self.interrupted = True
            if not np.isfinite(self._gamma):
                raise
        return [by_start[number] for number in sorted(by_start)]

    def _iterate_results(self, starts: Sequence[Start]) -> Generator[SearchResult, None, None]:
        """Yield the results of searches as they end, stored ones first."""
        if self._ctx is None or self._kept is None:
            yield from map(Search(self._problem, self._report_progress), starts)
            return
        left = []
        for start in starts:
            known = self._kept.read(start)
            if known is None:
                left.append(start)
            else:
                yield known
        with Workers(self._ctx, _Searches(self._problem, self._report_progress)) as workers:
            for one in workers.ended(left):
                yield self._kept.keep(one)

    def _report_result(self, result: SearchResult) -> None:
        self._done += 1
        self.interrupted = result.interrupted
        if result.allowed:
            self._gamma = min(self._gamma, result.gamma)
        if self._progress is not None:
            self._progress(Progress(self._done, self._total, result, self._gamma, result.gamma))

    def _report_progress(self, gamma: float) -> None:
        if self._progress is not None:
            least = min(self._gamma, gamma)
            self._progress(Progress(self._done, self._total, None, least, gamma))


@dataclass(frozen=True)
class _Searches:
    """Searches for `hillsphere.runs.workers.Workers`; progress is reported in this process."""

    problem: Problem
    tell: Callable[[float], None] | None

    def prepare(self) -> Callable[[Start], SearchResult]:
        """Return the search."""
        return Search(self.problem, self.tell)

    def __reduce__(self) -> tuple[Any, ...]:
        return _Searches, (self.problem, None)


def _seed(seed: int, number: int) -> int:
    return int(np.random.SeedSequence(seed, spawn_key=(number,)).generate_state(1)[0])


def _perturbed_starts(good: Sequence[SearchResult], seed: int, number: int) -> list[Start]:
    """Return starts near the best different minima, at most as many as there were."""
    different: list[SearchResult] = []
    for result in good:
        if all(abs(result.gamma - f.gamma) > _SAME * f.gamma for f in different):
            different.append(result)
    starts: list[Start] = []
    for result in different[:_KEPT]:
        settled = result.converged and result.residual < _SETTLED
        for shake in _SHAKES[: 2 if settled else None]:
            place = number + len(starts)
            starts.append(Start(place, _seed(seed, place), result.theta, shake))
    return starts[:number]


def _best_verified(
    problem: Problem,
    candidates: Sequence[SearchResult],
    prefer: Callable[[LtiSystem], float] | None,
    tie: float,
) -> tuple[SearchResult, Verified, Array]:
    """Return the best candidate that passes the check of its closed loops.

    Among equals, within the tie, it is the one that is preferred; γ of these (E, 2) follow, with
    what was to be small, that of the one that is taken first.
    """
    passed: list[tuple[SearchResult, Verified]] = []
    reasons = []
    margin = _SAME if prefer is None else -tie / (1.0 + tie)
    for candidate in candidates:
        if passed and min(v.gamma for _, v in passed) <= candidate.gamma * (1.0 + margin):
            break
        try:
            check = verify_controller(
                problem.plants, controller_of(problem.structure, candidate.theta)
            )
        except InputError as error:  # such gains that the loop is not well posed in floating point
            reasons.append(str(error))
            continue
        wrong = check.wrong(problem.region)
        if problem.controller_stable and not check.controller_abscissa_1_s < 0.0:
            wrong = f"the controller has poles with real part {check.controller_abscissa_1_s:.3g}"
        if wrong:
            reasons.append(wrong)
        else:
            passed.append((candidate, check))
    if not passed:
        raise SynthesisFailedError(
            f"no controller found passes the check of its closed loops ({reasons[0]}); limit the "
            "gains (largest_gain), ask for a pole region, or scale the plant"
        )
    least = min(v.gamma for _, v in passed)
    if prefer is None:
        return *min(passed, key=lambda pair: pair[1].gamma), np.zeros((0, 2))
    equal = [pair for pair in passed if pair[1].gamma <= least * (1.0 + tie)]
    values = [prefer(controller_of(problem.structure, candidate.theta)) for candidate, _ in equal]
    order = np.argsort(values, kind="stable")
    best = equal[int(order[0])]
    return *best, np.array([[equal[k][1].gamma, values[k]] for k in order.tolist()])


def _failure(results: Sequence[SearchResult]) -> Exception:
    stable = [f for f in results if np.isfinite(f.gamma)]
    if stable:
        best = min(stable, key=lambda f: f.excess)
        return SynthesisFailedError(
            f"no controller found from {len(results)} starts keeps the constraints: the best "
            f"exceeds one by {100.0 * np.expm1(best.excess):.3g} %; relax them, give the "
            "structure more parameters, or use more starts"
        )
    best = min(results, key=lambda f: f.abscissa)
    return NotStabilisableError(
        f"no controller of this structure that stabilises all plants was found from {len(results)} "
        f"starts; the best has poles with a real part of {best.abscissa:.3g} times the plant's "
        "rate: give the structure more parameters, an initial controller, or use more starts"
    )
