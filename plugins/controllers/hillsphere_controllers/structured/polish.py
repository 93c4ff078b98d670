"""Polishing: sequential quadratic programming (SQP) on the active peaks of a minimax problem.

Near a minimax optimum several peaks are equally high. Each is a smooth function of the parameters,
so that a quadratic model of their Lagrangian and their linear parts give fast convergence, where
a method that follows one gradient at a time zigzags.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_controllers.structured.minimax import MinimaxStep, minimax_step
from hillsphere_controllers.structured.objective import Objective, Point
from hillsphere_controllers.structured.pieces import Piece

__all__ = ["Active", "PolishedPoint", "polish_point", "stationarity"]

_ARMIJO = 0.05
"""Share of the predicted decrease that a step must reach."""
_TRIALS = 14
"""Steps tried, each corrected or damped more, before the point counts as a minimum to rounding."""
_EVEN = 1e-5
"""Peaks whose logarithms differ by less from the highest are taken for equally high in the
certificate."""
_FAR, _SMALL = 50.0, 0.5
"""Largest logarithm of a level over the reference, so that its exponential stays a number; and the
share of the highest level below which a real gain may pass through zero within a step."""
_VIOLATORS, _REMEMBERED = 3, 12
"""So many peaks that make a step too high are looked at; so many in the next steps too."""


@dataclass(frozen=True)
class Active:
    """An active peak or constraint of an optimum, with its multiplier.

    Parameters
    ----------
    plant, channel : int
        Where; channel −1: poles (plant −1: gains; −2: the controller's poles).
    omega_rad_s : float
        Peak; NaN where there is none.
    level : float
        Weighted norm there, or excess of the constraint.
    multiplier : float
        λ ≥ 0; those of the objective sum to one.
    """

    plant: int
    channel: int
    omega_rad_s: float
    level: float
    multiplier: float


@dataclass(frozen=True)
class PolishedPoint:
    """Result of polishing.

    Parameters
    ----------
    point : Point
        There.
    converged : bool
        Whether no more decrease than the tolerance was predicted.
    iterations : int
        Steps taken.
    """

    point: Point
    converged: bool
    iterations: int


def polish_point(
    objective: Objective,
    point: Point,
    *,
    accepted: Callable[[Point], Point],
    iterations: int = 80,
    tolerance: float = 1e-7,
) -> PolishedPoint:
    """Return the point that SQP steps reach, no higher than the start.

    Parameters
    ----------
    objective : Objective
        The function.
    point : Point
        Where to start, stable and certified.
    accepted : callable
        Called with each point before it is accepted; returns it, perhaps with a better known value.
    iterations : int
        At most.
    tolerance : float
        It ends when the predicted decrease of the logarithm is below this.
    """
    hessian, damping, fresh = _initial_hessian(objective, point), 0.0, True
    extra: list[Piece] = []
    for count in range(iterations):
        pieces = objective.pieces(point, extra)
        tried = _find_step(objective, point, pieces, hessian, damping, tolerance)
        extra = (tried.rejected + extra)[:_REMEMBERED]
        if tried.point is None:
            if fresh:
                return PolishedPoint(point, tried.converged, count)
            hessian, damping, fresh = _initial_hessian(objective, point), 0.0, True
            continue
        new = accepted(tried.point)
        if new.value > point.value:  # the peak that was missed is remembered now
            continue
        damping, fresh = tried.damping, False
        hessian = _update_hessian(objective, point, new, tried.held, hessian)
        point = new
    return PolishedPoint(point, False, iterations)


def stationarity(objective: Objective, point: Point) -> tuple[float, tuple[Active, ...]]:
    """Return the residual of stationarity, the least |Σ λ g| max(1, |x|), and the active pieces.

    At the top is what is within 1e-5 of the largest, or of a constraint's limit. Among these, what
    is a little higher counts no more than the others: rounding and the tolerance of polishing make
    such differences.
    """
    pieces = objective.pieces(point)
    size = max(1.0, float(np.linalg.norm(point.x)))
    # of the pieces themselves: where a gain is ill-conditioned, theirs differs a little
    highest = max((p.level for p in pieces if not p.hard), default=point.objective)
    even = [
        replace(p, level=0.0 if p.hard else point.objective)
        if p.level >= (0.0 if p.hard else highest) - _EVEN
        else p
        for p in pieces
    ]
    steep = max((float(np.linalg.norm(p.slope)) for p in pieces), default=1.0)
    # with even levels the multipliers make the gradient smallest, whatever the quadratic
    linear = _Linear.of(even, point.objective)
    step = linear.step(max(steep, 1e-8) * np.eye(point.x.size), objective.penalty, _EVEN)
    if step is None:
        return np.inf, ()
    slopes = np.array([p.slope for p in pieces])
    rest = float(np.linalg.norm(step.multipliers @ slopes)) * size
    active = tuple(
        Active(
            p.plant, p.channel, p.omega_rad_s, p.level if p.hard else float(np.exp(p.level)),
            float(weight),
        )
        for p, weight in zip(pieces, step.multipliers, strict=True)
        if weight > 1e-6
    )  # fmt: skip
    return rest, active


def _initial_hessian(objective: Objective, point: Point) -> Array:
    """Return the initial Hessian, whose first step is about a tenth of x."""
    size = _scale(point.x)
    steep = float(np.linalg.norm(size * objective.slope(point)))
    return np.diag(max(10.0 * steep, 1e-8) / size**2)


def _scale(x: Array) -> Array:
    size = np.abs(x)
    return np.maximum(size, max(1.0, 0.1 * float(size.max())))


@dataclass(frozen=True)
class _Linear:
    """Linear models of the pieces at a point: norms relative to a reference, less one.

    Not their logarithms: a gain far below the largest, as one that a parameter alone makes, rises
    in proportion to it.
    """

    values: Array
    slopes: Array
    hard: NDArray[np.bool_]
    mirrored: NDArray[np.bool_]
    """Real gains that are small may change their sign, and grow on the other side."""

    @staticmethod
    def of(pieces: Sequence[Piece], reference: float) -> _Linear:
        """Return them, for a reference that is the logarithm of a norm."""
        levels, hard = np.array([p.level for p in pieces]), np.array([p.hard for p in pieces])
        share = np.where(hard, 1.0, np.exp(np.minimum(levels - reference, _FAR)))
        real = np.array([p.omega_rad_s == 0.0 or np.isinf(p.omega_rad_s) for p in pieces])
        slopes = np.array([p.slope for p in pieces]) * share[:, None]
        values = np.where(hard, levels, share - 1.0)
        return _Linear(values, slopes, hard, ~hard & real & (share < _SMALL))

    def moved_to(self, values: Array, step: Array) -> _Linear:
        """Return the linear models with the values at the end of a step."""
        return replace(self, values=values - self.slopes @ step)

    def step(self, hessian: Array, penalty: float, near: float = np.inf) -> MinimaxStep | None:
        """Return the step; those lower than zero by more than `near` do not count."""
        if not np.isfinite(self.slopes).all() or self.hard.all():
            return None
        kept, other = self.values >= -near, self.mirrored & (self.values >= -near)
        result = minimax_step(
            np.concatenate([self.values[kept], -2.0 - self.values[other]]),
            np.concatenate([self.slopes[kept], -self.slopes[other]]),
            np.concatenate([self.hard[kept], self.hard[other]]),
            hessian,
            penalty,
        )
        if result is None:
            return None
        multipliers = np.zeros(self.values.size)
        multipliers[kept] = result.multipliers[: int(kept.sum())]
        return MinimaxStep(result.step, result.predicted, multipliers)


@dataclass(frozen=True)
class _TrialStep:
    point: Point | None
    held: list[tuple[Piece, float]]
    damping: float
    rejected: list[Piece]
    converged: bool = False


def _find_step(
    objective: Objective,
    point: Point,
    pieces: list[Piece],
    hessian: Array,
    damping: float,
    tolerance: float,
) -> _TrialStep:
    """Return an acceptable trial point; rejected steps are corrected, then shortened.

    The optimum lies in a curved valley where peaks are equally high. A step along its tangent
    leaves it: the correction takes the levels found there into account.
    """
    shape = np.diag(1.0 / _scale(point.x) ** 2)
    rejected: list[Piece] = []
    for count in range(_TRIALS):
        linear = _Linear.of(pieces, point.objective)
        step = linear.step(hessian + damping * shape, objective.penalty)
        if step is None:
            break
        if step.predicted < tolerance:
            if damping > 0.0 and count == 0:
                damping = 0.0
                continue
            return _TrialStep(None, [], 0.0, rejected, count <= 1 and damping == 0.0)
        held = [(p, float(w)) for p, w in zip(pieces, step.multipliers, strict=True) if w > 1e-9]
        length = float(step.step @ shape @ step.step)
        trial = objective.evaluate(point.x + step.step)
        # ratio of actual to predicted decrease, as in trust-region methods
        share = (point.value - trial.value) / step.predicted
        if share >= _ARMIJO:
            eased = 0.2 * damping if share > 0.5 and count == 0 else damping
            return _TrialStep(trial, held, eased, rejected)
        if np.isfinite(trial.value):
            # second-order correction: the levels at the trial point replace the linear prediction
            moved = objective.follow(trial, pieces)
            near = [p for p in objective.pieces(trial) if not p.hard]
            violators = [p for p in near if p.level > trial.objective - 1e-3][:_VIOLATORS]
            there = _Linear.of(moved, point.objective).values
            bent = linear.moved_to(there, step.step)
            corrected = bent.step(hessian + damping * shape, objective.penalty)
            if corrected is not None:
                trial = objective.evaluate(point.x + corrected.step)
                if point.value - trial.value >= _ARMIJO * step.predicted:
                    return _TrialStep(trial, held, damping, rejected)
            # what stood in the way is looked at from here too
            rejected += violators
            pieces = objective.with_extra(point, pieces, violators)
        # Levenberg-Marquardt: a larger damping shortens the step
        damping = max(4.0 * damping, step.predicted / length)
    return _TrialStep(None, [], 0.0, rejected)


def _update_hessian(
    objective: Objective,
    old: Point,
    new: Point,
    held: list[tuple[Piece, float]],
    hessian: Array,
) -> Array:
    """Return the Hessian of the Lagrangian by Powell's damped update."""
    if not held:
        return hessian
    before = _Linear.of([p for p, _ in held], old.objective)
    after = _Linear.of(objective.follow(new, [p for p, _ in held]), old.objective)
    change = np.array([w for _, w in held]) @ (after.slopes - before.slopes)
    step = new.x - old.x
    turned = hessian @ step
    curved = float(step @ turned)
    along = float(step @ change)
    if not curved > 0.0 or not np.isfinite(change).all():
        return hessian
    # Powell (1978): mix in H s, so that the update stays positive definite
    if along < 0.2 * curved:
        share = 0.8 * curved / (curved - along)
        change = share * change + (1.0 - share) * turned
        along = float(step @ change)
    made = hessian - np.outer(turned, turned) / curved + np.outer(change, change) / along
    made = 0.5 * (made + made.T)
    # in the scale of x, nothing is much flatter than anything else is steep
    size = _scale(new.x)
    values, vectors = np.linalg.eigh(size[:, None] * made * size)
    kept = (vectors * np.clip(values, 1e-10 * float(values[-1]), None)) @ vectors.T
    return np.asarray(kept / size[:, None] / size)
