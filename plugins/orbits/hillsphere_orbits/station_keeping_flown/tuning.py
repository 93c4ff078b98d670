"""Choice of the weights of a strategy on separate flights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from hillsphere_orbits.station_keeping_flown.sampling import Weights

__all__ = ["IMPULSE_FACTORS", "REGULATORS", "TUNABLE", "TuningResult", "count_candidates", "tune"]

IMPULSE_FACTORS = (1.0, 0.1, 0.3, 3.0)
"""Of the tolerable impulse. Only its ratio to the tolerable position matters; half-decades, because
the cost goes about as its root. The weights as written come first, so that they win ties."""
_VELOCITY_FACTORS = (0.3, 3.0)
"""Of the tolerable velocity: half a decade to either side; the factor 1 was tried with the
impulse."""
_TARGET_POINTS = ("target_point", "phase_free_target_point")
REGULATORS = ("periodic_lqr", "phase_free_lqr")
"""Strategies that weigh velocities too."""
TUNABLE = _TARGET_POINTS + REGULATORS
"""Strategies that have weights."""


@dataclass(frozen=True)
class TuningResult:
    """Weights chosen for a strategy at an interval.

    Parameters
    ----------
    weights : Weights
        The chosen ones.
    survivors : int
        Flights that survived with them, of those that tuned.
    tried : int
        Weights that were tried.
    """

    weights: Weights
    survivors: int
    tried: int


def count_candidates(strategy: str, weights: Weights) -> int:
    """Return how many weights `tune` tries."""
    return len(IMPULSE_FACTORS) + len(_second(strategy, weights))


def tune(
    strategy: str, weights: Weights, fly: Callable[[Weights], tuple[int, float]]
) -> TuningResult:
    """Choose the weights with the most survivors; among equals, the least cost.

    First over the tolerable impulse; then, with the best of these, over the tolerable velocity of a
    regulator or over fewer targets of target points.

    Parameters
    ----------
    strategy : str
        One of `TUNABLE`.
    weights : Weights
        As written.
    fly : callable
        Weights → number of survivors and a cost, always by the same measure.

    Returns
    -------
    TuningResult
        The first of equals.
    """
    tried: list[tuple[tuple[int, float], Weights]] = []

    def best(candidates: Sequence[Weights]) -> tuple[tuple[int, float], Weights]:
        for each in candidates:
            survivors, cost = fly(each)
            tried.append(((survivors, -cost if survivors else 0.0), each))
        return max(tried, key=lambda one: one[0])

    _, chosen = best([replace(weights, impulse=f * weights.impulse) for f in IMPULSE_FACTORS])
    score, chosen = best(_second(strategy, chosen))
    return TuningResult(chosen, score[0], len(tried))


def _second(strategy: str, weights: Weights) -> list[Weights]:
    if strategy in REGULATORS:
        return [replace(weights, velocity=f * weights.velocity) for f in _VELOCITY_FACTORS]
    if len(weights.targets) < 2:
        return []
    return [replace(weights, targets=weights.targets[: len(weights.targets) // 2])]
