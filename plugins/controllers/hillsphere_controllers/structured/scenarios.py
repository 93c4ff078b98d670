r"""Synthesis for plants with uncertain real parameters, by active scenarios.

A plant depends on normalised parameters :math:`|δ_i| \le 1` through an upper linear fractional
transformation with Δ = diag(δᵢ I). A controller is designed for a few values of δ, the scenarios;
then the worst values for this controller are looked for in the whole box, and become scenarios too,
until there are none that are much worse [1]_. With the controller closed, Δ enters the loop as a
static controller does: the search for the worst δ has the same gradients as the design.

The worst case found is a lower bound of the true one: certify the result by an upper bound of µ.

References
----------
.. [1] P. Apkarian, M. N. Dao, D. Noll (2015), Parametric robust structured control design, IEEE
   Transactions on Automatic Control 60(7), 1857-1869.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.optimize import minimize

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Context
from hillsphere.lti import LtiSystem
from hillsphere_controllers.structured.closed_loop import OpenLoop
from hillsphere_controllers.structured.effort import Effort
from hillsphere_controllers.structured.objective import Objective, Point
from hillsphere_controllers.structured.requirements import Channel, DesignPlant, PoleRegion
from hillsphere_controllers.structured.search_runs import Progress
from hillsphere_controllers.structured.structure import Sizes, Structure
from hillsphere_controllers.structured.synthesis import StructuredDesign, synthesise
from hillsphere_controllers.systems.algebra import gain, lower_lft, upper_lft

__all__ = ["RobustDesign", "Scenario", "UncertainPlant", "synthesise_robust", "worst_case"]

_VIOLATES, _ENOUGH = 1e-3, 5e-3
"""The first is the relative excess over γ from which on a worst case becomes a scenario, the second
that up to which the design counts as robust. Below the first a scenario would change the controller
by less than the search's own accuracy."""
_NEW, _NEW_EACH = 10, 2
"""New scenarios of a round at most, and of one plant: the worst."""
_CARRIED = 0.85
"""Scenarios whose γ is below this share of the design's are dropped; the check of the whole box
brings those back that matter again."""
_FAR = 1.1
"""A worst case above this times the design's γ asks for a controller that may be quite another."""
_RANDOM, _CLIMBED = 16, 4
"""Random parameters that are looked at, and the best of all points from which the worst case is
climbed to. More find rarer worst cases, in proportion to the time."""
_FEW = 6
"""With so many parameters all corners are looked at; with more those that slopes point to, and the
following numbers of corners and of inner points at random."""
_SOME_CORNERS, _SOME_INSIDE = 16, 4
"""Random corners and inner points of a box of many parameters, see `_FEW`."""
_UNSTABLE = 50.0
"""Logarithm of the gain that stands for instability in the search for the worst case."""


@dataclass(frozen=True)
class UncertainPlant:
    """A plant with uncertain parameters, with the channels of its closed loop.

    Parameters
    ----------
    system : LtiSystem
        Its first inputs and outputs belong to Δ, its last ones are the controls u and the
        measurements y; between them are w and z.
    repeats : tuple of int
        How often each parameter stands on the diagonal of Δ.
    channels : tuple of Channel
        What is to be small.
    weight : float
        What all its norms that are minimised are multiplied with.
    name : str
        For messages.
    """

    system: LtiSystem
    repeats: tuple[int, ...]
    channels: tuple[Channel, ...] = field(default=(Channel(),))
    weight: float = 1.0
    name: str = ""

    def __post_init__(self) -> None:
        if not self.repeats or min(self.repeats) < 1 or sum(self.repeats) >= min(self.system.shape):
            raise InputError(
                f"{self.repeats} parameters on the diagonal do not fit a plant of "
                f"{self.system.shape[0]} outputs and {self.system.shape[1]} inputs"
            )

    def at(self, delta: Array) -> DesignPlant:
        """Return the plant at normalised parameters (parameters,)."""
        block = gain(np.diag(np.repeat(delta, self.repeats)))
        name = f"{self.name} at {np.array2string(np.asarray(delta), precision=3)}"
        system = upper_lft(self.system, block)
        return DesignPlant(system, self.channels, self.weight, name.strip())


@dataclass(frozen=True)
class Scenario:
    """Values of a plant's parameters, and γ of the closed loop there.

    Parameters
    ----------
    plant : int
        Which plant.
    delta : ndarray, shape (parameters,)
        Normalised values, from −1 to 1.
    gamma : float
        Largest weighted norm; infinite if the closed loop is not stable.
    """

    plant: int
    delta: Array
    gamma: float


@dataclass(frozen=True)
class RobustDesign:
    """A controller for uncertain plants.

    Parameters
    ----------
    design : StructuredDesign
        The controller, and what it does in the scenarios.
    scenarios : tuple of Scenario
        Those it was designed for.
    worst : Scenario
        The worst that was found in the whole box; of the scenarios, if the design was interrupted.
    each : ndarray, shape (plants,)
        γ of the worst that was found for each plant; NaN if the design was interrupted.
    starts : ndarray, shape (starts,)
        γ from every start, for the scenarios known when they were begun from.
    ends : ndarray, shape (starts, size)
        Parameters at which these ended; NaN where no allowed controller was found.
    rounds : int
        Designs made.
    converged : bool
        Whether the worst is no more than 0.5 % above the design's γ.
    """

    design: StructuredDesign
    scenarios: tuple[Scenario, ...]
    worst: Scenario
    each: Array
    starts: Array
    ends: Array
    rounds: int
    converged: bool


def synthesise_robust(
    plants: UncertainPlant | Sequence[UncertainPlant],
    structure: Structure,
    *,
    rounds: int = 10,
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
    told: Callable[[str], None] | None = None,
    progress: Callable[[Progress], None] | None = None,
    ctx: Context | None = None,
) -> RobustDesign:
    """Return a controller whose worst case over all parameters is small.

    The first round designs for the nominal plants, the next ones from there for the scenarios too.
    When these are enough, the design is made anew from all starts, and checked again.

    Parameters
    ----------
    plants : UncertainPlant or sequence of UncertainPlant
        All are closed by the same controller.
    structure : Structure
        Of the controller.
    rounds : int
        Designs at most; the first has the nominal plants only.
    starts : int
        Of the last design; the first has up to three, those between begin at the one before.
    initial : iterable of ndarray, shape (size,)
        Parameters near a minimum for the nominal plants, which the first design begins at.
    scatter : float
        If positive, the other starts of the last design are about the one before, changed by this,
        relative, instead of random controllers; designs between begin at the one before alone.
    target : float
        A search ends once γ is below this for its scenarios; 0: none does.
    effort : {"quick", "normal", "thorough"} or float
        As in `synthesise`, of the designs from all starts.
    seed, region, largest_gain, controller_stable, bandwidth_rad_s, shaken, prefer, tie
        As in `synthesise`. The region is kept in the scenarios.
    told : callable or None
        Told in a sentence what each round gave.
    progress, ctx
        As in `synthesise`.

    Returns
    -------
    RobustDesign
        Of the round with the smallest worst case.

    Raises
    ------
    InputError, NotStabilisableError, SynthesisFailedError
        As in `synthesise`.
    """
    many = (plants,) if isinstance(plants, UncertainPlant) else tuple(plants)
    if rounds < 1:
        raise InputError(f"a robust design needs a round, got {rounds}")
    places = [(j, np.zeros(len(plant.repeats))) for j, plant in enumerate(many)]
    best: RobustDesign | None = None
    begun = list(initial)
    near = bool(begun)
    known: list[Array] = [np.zeros((0, len(plant.repeats))) for plant in many]
    whole = rounds == 1 or starts == 1  # whether this round is from all starts
    done, distribution, ends = False, np.zeros(0), np.zeros((0, structure.size))
    for count in range(1, rounds + 1):
        done = done or whole
        about = scatter if begun and whole and starts > 1 else 0.0
        searches = starts if whole else 0 if near else 1 if scatter else min(starts, 3)
        design = synthesise(
            [many[j].at(delta) for j, delta in places], structure, seed=seed,
            effort=effort if whole else 0.0, initial=begun,
            starts=0 if near and searches == 1 else searches,
            scatter=about, target=target, region=region,
            largest_gain=largest_gain, controller_stable=controller_stable,
            bandwidth_rad_s=bandwidth_rad_s, shaken=shaken and whole,
            prefer=prefer if whole else None, tie=tie, name=f"-{count}", progress=progress, ctx=ctx,
        )  # fmt: skip
        if whole or not distribution.size:
            distribution, ends = design.starts, design.ends
        scenarios = tuple(
            Scenario(j, delta, _gamma(many[j], norms))
            for (j, delta), norms in zip(places, design.verified.norms, strict=True)
        )
        if design.interrupted:
            highest = max(scenarios, key=lambda s: s.gamma)
            unknown = np.full(len(many), np.nan)
            return RobustDesign(
                design, scenarios, highest, unknown, design.starts, design.ends, count, False
            )
        each = [
            [
                replace(s, plant=j)
                for s in worst_case(plant, design.controller, seed=seed + count, known=known[j])
            ]
            for j, plant in enumerate(many)
        ]
        worst = max((those[0] for those in each), key=lambda s: s.gamma)
        enough = worst.gamma <= design.gamma * (1.0 + _ENOUGH)
        if told is not None:
            told(
                f"round {count}: γ = {design.gamma:.6g} for {len(places)} plants, worst case "
                f"{worst.gamma:.6g} (plant {many[worst.plant].name or worst.plant})"
            )
        at_worst = np.array([those[0].gamma for those in each])
        made = RobustDesign(design, scenarios, worst, at_worst, distribution, ends, count, enough)
        # that of all starts is taken where it is as good
        if best is None or worst.gamma < best.worst.gamma or (whole and enough):
            best = made
        best = replace(best, starts=distribution, ends=ends)
        if enough and done:
            break
        whole = not done and (enough or count == rounds - 1)
        begun, near = [design.theta], worst.gamma < _FAR * design.gamma
        places = [(s.plant, s.delta) for s in scenarios if s.gamma >= _CARRIED * design.gamma]
        worse = [
            s
            for those in each
            for s in those[:_NEW_EACH]
            if s.gamma > design.gamma * (1.0 + _VIOLATES)
            and all(s.plant != p or np.abs(s.delta - d).max() > 1e-6 for p, d in places)
        ]
        places += [(s.plant, s.delta) for s in sorted(worse, key=lambda s: -s.gamma)[:_NEW]]
        for j in range(len(many)):
            known[j] = np.array([d for p, d in places if p == j]).reshape(-1, known[j].shape[1])
    assert best is not None
    return best


def worst_case(
    plant: UncertainPlant, controller: LtiSystem, *, seed: int = 1, known: Array | None = None
) -> list[Scenario]:
    """Return local worst cases of a closed loop over all parameters, the worst first.

    Parameters
    ----------
    plant : UncertainPlant
        The plant.
    controller : LtiSystem
        From y to u.
    seed : int
        Of the random ones among the points that the search begins at.
    known : ndarray, shape (K, parameters), or None
        Points that it is to begin at too, as worst cases of controllers that differ little.

    Returns
    -------
    list of Scenario
        Different ones, as of plant 0. Their gains are reached: the worst is a lower bound of the
        worst case, with no guarantee that nothing is worse.
    """
    closed = lower_lft(plant.system, controller)
    (p, m), nd, k = closed.shape, sum(plant.repeats), len(plant.repeats)
    # Δ comes last, as a controller
    rows = np.concatenate([np.arange(nd, p), np.arange(nd)])
    columns = np.concatenate([np.arange(nd, m), np.arange(nd)])
    # with Δ as the controller the search for the worst case is a structured synthesis that
    # maximises
    turned = LtiSystem(
        closed.a, closed.b[:, columns], closed.c[rows], closed.d[np.ix_(rows, columns)]
    )
    soft = tuple(c for c in plant.channels if c.limit is None)
    structure = _Repeated(plant.repeats)
    loop = OpenLoop(DesignPlant(turned, soft, plant.weight, plant.name), structure)
    objective = Objective([loop], structure, np.zeros(k), np.ones(k))
    random = np.random.default_rng(seed)
    points = [np.zeros(k), *(() if known is None else known)]
    if k <= _FEW:
        points += list(random.uniform(-1.0, 1.0, (_RANDOM, k)))
        points += [np.array(corner) for corner in product((-1.0, 1.0), repeat=k)]
    else:
        points += _corners(objective, points)
        points += list(random.uniform(-1.0, 1.0, (_SOME_INSIDE, k)))
        points += list(random.choice([-1.0, 1.0], (_SOME_CORNERS, k)))
    # the worst points first; instability is worst of all
    first = sorted(points, key=lambda x: -min(objective.evaluate(x).value, _UNSTABLE))
    scenarios: list[Scenario] = []
    for start in first[:_CLIMBED]:
        end = _climb(objective, start)
        if all(np.abs(end.x - s.delta).max() > 1e-3 for s in scenarios):
            scenarios.append(Scenario(0, end.x, float(np.exp(end.value))))
    return sorted(scenarios, key=lambda s: -s.gamma)


def _corners(objective: Objective, points: Sequence[Array]) -> list[Array]:
    """Return the corners that the slopes of all peaks at some points point to, each once."""
    corners: dict[tuple[float, ...], Array] = {}
    for x in points:
        point = objective.evaluate(x)
        if np.isfinite(point.value):
            for piece in objective.pieces(point):
                # to first order the gain grows most towards this corner of the box
                corner = np.where(piece.slope >= 0.0, 1.0, -1.0)
                corners.setdefault(tuple(corner), corner)
    return list(corners.values())


def _climb(objective: Objective, start: Array) -> Point:
    """Return a local maximum in the box; one where the loop is unstable, if it meets such."""
    best = objective.evaluate(start)

    def value(x: Array) -> tuple[float, Array]:
        nonlocal best
        point = objective.evaluate(x.copy())
        if point.value > best.value:
            best = point
        if not np.isfinite(point.value):
            return -_UNSTABLE, np.zeros(x.size)
        return -point.value, -objective.slope(point)

    if np.isfinite(best.value):
        minimize(value, start, jac=True, method="L-BFGS-B", bounds=[(-1.0, 1.0)] * start.size)
    return objective.certify(best) if np.isfinite(best.value) else best


def _gamma(plant: UncertainPlant, norms: Sequence[float]) -> float:
    return max(
        plant.weight * channel.weight * norm
        for channel, norm in zip(plant.channels, norms, strict=True)
        if channel.limit is None
    )


class _Repeated:
    """Δ = diag(δᵢ I) as a structure of a static controller."""

    order = 0

    def __init__(self, repeats: tuple[int, ...]) -> None:
        self._owner = np.repeat(np.arange(len(repeats)), repeats)
        self.controls = self.measurements = self._owner.size
        self.size = len(repeats)

    def gains(self, theta: Array) -> Array:
        return np.diag(theta[self._owner])

    def pull_back(self, theta: Array, slope: Array) -> Array:
        diagonal = np.diagonal(slope, axis1=-2, axis2=-1)
        return np.stack(
            [diagonal[..., self._owner == i].sum(axis=-1) for i in range(self.size)], axis=-1
        )

    def typical(self, sizes: Sizes) -> tuple[Array, Array]:
        return np.zeros(self.size), np.ones(self.size)
