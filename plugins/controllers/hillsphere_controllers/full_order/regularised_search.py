"""Search for an H∞ controller where the problem as given is singular or badly conditioned.

Each step of a ladder of regularisations, from large to small, poses another problem whose central
controllers are tried on the plant as given. A large regularisation gives loops of a γ that is too
high, a small one controllers with poles so fast that rounding spoils their loops; the best loop
lies between. It is judged by its own norm alone, rounding included.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

from hillsphere.errors import HillsphereError
from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import HinfNorm
from hillsphere_controllers.full_order.gamma_problem import GammaProblem
from hillsphere_controllers.full_order.regularisation import (
    Regularisation,
    choose_regularisations,
)
from hillsphere_controllers.systems.balancing import balance_states

__all__ = ["rank_norm", "search_regularised"]

_SIZES = tuple(10.0**-k for k in range(1, 12))
"""Regularisations relative to the size of the problem: from 10 %, which changes every problem, to
where their squares are lost beside one (1e-8) and, for problems in poor units, some decades on."""
_PATIENCE = 3
"""Steps of the ladder without a gain of 1 % after which it ends."""
_GAIN = 0.99
_SHARES = (0.5, 0.8, 0.95, 0.99, 0.997)
"""Shares of the best norm that are tried as the next γ, the next one where nothing better results.
The last is finer than the 1 % that a controller may be above the best."""
_SLOWER = (2.0, 1.1, 1.02, 1.005)
"""Multiples of a doubtful norm that are tried as γ: controllers of a larger γ have slower poles."""
_DOUBTFUL = 1.5
"""Factor by which a norm counts that rounding may have changed by more than 1 %."""
_LEAP = 30.0
"""Factor between the γ tried where there is no loop yet: from any loop the search goes on down."""
_NOTHING = 1e-8
"""Norm relative to the size of the problem that counts as zero: with cheap controls and accurate
measurements there may be no least one, but for rounding."""
_MOST = 40
"""Values of γ at most per problem; halving takes as many over twelve decades."""
_HIGHEST = 1e14
"""Largest γ tried, relative to the size of the problem, where there is no loop yet."""


class Design(Protocol):
    """A design with a verified norm."""

    @property
    def norm(self) -> HinfNorm:
        """Of its closed loop with the plant as given."""


Made = TypeVar("Made", bound=Design)
Attempt = Callable[[GammaProblem, float, Regularisation], Made | None]


def search_regularised(
    plant: LtiSystem, k: int, q: int, best: Made | None, attempt: Attempt[Made], goal: float
) -> Made | None:
    """Return the best loop over a ladder of regularisations, at least as good as the one given.

    Parameters
    ----------
    plant : LtiSystem
        In continuous time, its controls and measurements in units of their size.
    k, q : int
        Numbers of controls and measurements.
    best : design or None
        The best so far.
    attempt : callable
        Of a problem, γ and its regularisation: the design at that γ, checked on the plant, or None.
    goal : float
        A norm at which the search ends.
    """
    since = 0
    for size in (0.0, *_SIZES):
        before = best
        for added in choose_regularisations(plant, k, q, size):
            try:
                problem = GammaProblem(balance_states(added.add_to(plant))[0], k, q)
            except HillsphereError:  # D12 or D21 still lacks rank: the units are too uneven
                continue
            best = _descend(problem, added, best, attempt, goal)
            if best is not None and rank_norm(best.norm) <= goal:
                return best
        if best is not None and size:
            gained = before is None or rank_norm(best.norm) < _GAIN * rank_norm(before.norm)
            since = 0 if gained else since + 1
            if since == _PATIENCE:
                break
    return best


def _descend(
    problem: GammaProblem,
    added: Regularisation,
    best: Made | None,
    attempt: Attempt[Made],
    goal: float,
) -> Made | None:
    """Return the best loop of a problem by ever smaller γ; from a large γ if there is none yet."""
    if best is None:
        gamma = problem.size
        while best is None and gamma <= _HIGHEST * problem.size:
            best = attempt(problem, gamma, added)
            gamma *= _LEAP
        if best is None:
            return None
    if best.norm.doubt:
        for share in _SLOWER:
            made = attempt(problem, share * best.norm.value, added)
            if made is not None and rank_norm(made.norm) < rank_norm(best.norm):
                best = made
    step, goal = 0, max(goal, _NOTHING * problem.size)
    for _ in range(_MOST):
        if step == len(_SHARES) or rank_norm(best.norm) <= goal:
            break
        made = attempt(problem, _SHARES[step] * best.norm.upper, added)
        if made is not None and rank_norm(made.norm) < rank_norm(best.norm):
            best = made
        else:
            step += 1
    return best


def rank_norm(norm: HinfNorm) -> float:
    """Return what loops are ranked by: the upper bound, more if rounding makes it doubtful."""
    return norm.upper * (_DOUBTFUL if norm.doubt else 1.0)
