r"""Search for the least γ at which both Riccati equations of H∞ synthesis are solvable.

As a rule it is where ρ(X Y) reaches γ². The slack γ²/ρ(X Y) − 1 rises smoothly with γ, so that a
few interpolations find its zero. Where X or Y does not exist, the interval is halved.
"""

from __future__ import annotations

import math
from typing import Protocol

__all__ = ["Solvability", "bisect_gamma", "close_in", "follow_gamma"]

_SMALLEST = 1e-12
"""γ below which the bisection ends, relative to the size of the problem: as good as zero."""
_BESIDE = 0.3
"""Distance from the interpolated zero at which the slack is asked for, in tolerances: the farther
end of the bracket comes as near, on the other side of the zero."""
_INSIDE = 0.1
"""Least distance from the ends of the bracket, in tolerances."""
_FOLLOWED = 6
"""Steps of the secant method at most. Two or three suffice from a γ that is near."""
_FARTHEST = 0.1
"""Largest change of ln γ in one step of the secant method: the slack is not linear farther off."""
_BENT = 10.0
"""Relative change of the slack's slope over a unit of ln γ, for the error of a secant step: near
the γ at which X or Y ceases to exist it is about that large."""


class Solvability(Protocol):
    """What the search asks of a problem, see `GammaProblem`."""

    size: float
    proved: float

    def solve(self, gamma: float) -> object | None:
        """Return solutions, None if γ is too small."""
        ...

    def slack(self, gamma: float) -> float | None:
        """Return a number that is positive just if γ is large enough; None where it is unknown."""
        ...


def bisect_gamma(
    problem: Solvability, low: float, high: float, tolerance: float
) -> tuple[float, float]:
    """Return the bracket at which bisection in ln γ ends.

    The least γ is first found by interpolation. That tells on which side of it nearly all γ of the
    bisection lie, so that only its last ones are solved; if these contradict that, all are.

    Parameters
    ----------
    problem : Solvability
        The problem.
    low, high : float
        A γ without and a γ with a solution.
    tolerance : float
        Relative width at which the bisection ends.

    Returns
    -------
    tuple of float
        A γ that is too small, and one that is large enough.
    """
    near = close_in(problem, low, high, tolerance)
    solved: dict[float, bool] = {low: False, high: True}
    below, above, implied = _bisect(problem, low, high, near, tolerance, solved)
    for gamma, expected in ((below, False), (above, True)):
        if gamma not in solved:
            solved[gamma] = problem.solve(gamma) is not None
        if solved[gamma] != expected:
            below, above, _ = _bisect(problem, low, high, (low, high), tolerance, solved)
            return below, above
    # the highest γ of the bisection that is proved to be too small, as if all had been solved
    for gamma in reversed(implied):
        if problem.proved >= gamma:
            break
        if gamma not in solved:
            problem.solve(gamma)
    return below, above


def _bisect(
    problem: Solvability, low: float, high: float, near: tuple[float, float], tolerance: float,
    solved: dict[float, bool],
) -> tuple[float, float, list[float]]:  # fmt: skip
    """Return the last bracket, and the γ refused; γ outside `near` are not solved."""
    refused = []
    while high > low * (1.0 + tolerance):
        middle = _halve(low, high)
        if middle <= _SMALLEST * problem.size:
            break
        if near[0] < middle < near[1] and middle not in solved:
            solved[middle] = problem.solve(middle) is not None
        if solved.get(middle, middle >= near[1]):
            high = middle
        else:
            low = middle
            refused.append(low)
    return low, high, refused


def close_in(
    problem: Solvability, low: float, high: float, tolerance: float
) -> tuple[float, float]:
    """Return a bracket of that relative width, by interpolation where the slack is known.

    Parameters
    ----------
    problem, low, high, tolerance
        As of `bisect_gamma`.

    Returns
    -------
    tuple of float
        A γ that is too small, and one that is large enough.
    """
    under: float | None = None
    over, halving = math.inf, False
    while high > low * (1.0 + tolerance):
        if low > 0.0 and under is not None and math.isfinite(over) and not halving:
            a, b = math.log(low), math.log(high)
            # 1/ρ is about a power of γ: its logarithm is interpolated
            below, above = math.log1p(under), math.log1p(over)
            zero = a - (b - a) * below / (above - below)
            beside = _BESIDE * tolerance
            zero += beside if b - zero > zero - a else -beside
            gamma = math.exp(zero)
        else:
            # ρ falls with γ: its root at the upper end is below all γ that are large enough
            least = max(low, high / math.sqrt(1.0 + over)) if math.isfinite(over) else low
            gamma = _halve(least, high)
        gamma = max(gamma, low * (1.0 + _INSIDE * tolerance))
        gamma = min(gamma, high * (1.0 - _INSIDE * tolerance))
        if gamma <= _SMALLEST * problem.size:
            break
        before = high / low if low > 0.0 else math.inf
        slack = problem.slack(gamma)
        if slack is not None and slack > 0.0:
            high, over = gamma, slack
        else:
            # far below the least γ, ρ is so large that the slack is −1 to rounding
            low, under = gamma, None if slack is None or slack <= -1.0 else slack
        # an interpolation that brought less than halving is followed by halving
        halving = before < math.inf and high > low * math.sqrt(before)
    return low, high


def _halve(low: float, high: float) -> float:
    """Return the middle in ln γ; a tenth of the upper end where the lower one is zero."""
    return math.sqrt(low * high) if low > 0.0 else 0.1 * high


def follow_gamma(
    problem: Solvability, gamma: float, slope: float, tolerance: float
) -> tuple[float, float] | None:
    """Return the γ of slack zero by the secant method, from that of a problem nearly the same.

    Parameters
    ----------
    problem : Solvability
        The problem.
    gamma, slope : float
        The γ to begin at, and the slope of the slack over ln γ, positive.
    tolerance : float
        Relative accuracy of γ.

    Returns
    -------
    tuple of float, or None
        γ and the slope; None if the method does not converge.
    """
    slack = problem.slack(gamma)
    last = math.inf
    for _ in range(_FOLLOWED):
        if slack is None or not math.isfinite(slack):
            return None
        move = min(max(-slack / slope, -_FARTHEST), _FARTHEST)
        # the slope is known but for its change over the last step
        if abs(move) * min(_BENT * last, 1.0) <= tolerance:
            return gamma * math.exp(move), slope
        gamma *= math.exp(move)
        before, slack, last = slack, problem.slack(gamma), abs(move)
        if slack is None or not (slack - before) / move > 0.0:
            return None
        slope = (slack - before) / move
    return None
