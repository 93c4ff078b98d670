"""Which flights fail: by the way they ended, or by a requirement on one of their metrics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.cases.case_classes import is_undecided
from hillsphere.engine.flight_metrics import FlightMetric, Requirement, RequirementsSpec
from hillsphere.engine.simulation.outcomes import Flights

__all__ = ["Judgement", "judge_flights"]

Judgement: TypeAlias = tuple[tuple[str, ...], tuple[str, ...], NDArray[np.bool_]]
"""Status and cause of N flights, and a mask (N,) of those that failed."""


def judge_flights(
    flights: Flights,
    metrics: Sequence[FlightMetric[Any]],
    values: Array,
    errors: Array,
    require: RequirementsSpec,
    success: Sequence[str],
    largest_step_error: float,
) -> Judgement:
    """Return how flights ended and which failed.

    Parameters
    ----------
    flights : Flights
        N of them.
    metrics : sequence of FlightMetric
        The m metrics with their requirements.
    values : ndarray, shape (m, N)
        Values of the metrics, SI.
    errors : ndarray, shape (m, N)
        By how much the step error may change them, SI.
    require : RequirementsSpec
        Limits on metrics that the mission sets.
    success : sequence of str
        Statuses that are no failure.
    largest_step_error : float
        Step error beyond which a flight is undecided, in the plant's natural units.

    Returns
    -------
    status, cause : tuple of str
        Those of the flights. A flight that ended well but violates a limit is ``"requirement"``
        with the cause of the first `Requirement` that it violates, in the order of their ranks and,
        with equal ranks, of the metrics. A value violates a limit if it exceeds it, or, where the
        requirement ``is_least``, if it is below it; a value that is NaN violates every limit. A
        flight that violates no limit for certain, but may violate one within the error of the
        metric, is ``"step_error"`` with that cause. A flight with a step error beyond
        `largest_step_error` is ``"step_error"`` without a cause. A flight that an event of the
        plant ended before it began is ``"input"``.
    failed : ndarray of bool, shape (N,)
        Whether that counts as a failure; never of an undecided flight, see
        `hillsphere.cases.case_classes`.
    """
    status, cause = list(flights.status), list(flights.cause)
    words = np.array(status)
    never_began = np.isin(words, ("impact", "escape")) & (flights.samples == 0)
    # A diverged flight has no finite step error; it failed, whatever its integration error.
    coarse = (flights.step_error > largest_step_error) & (words != "diverged") & ~never_began
    undecided = is_undecided(words) | never_began | coarse
    failed = ~np.isin(words, list(success)) & ~undecided
    for lane in np.flatnonzero(never_began).tolist():
        status[lane], cause[lane] = "input", f"start ({cause[lane]})"
    for lane in np.flatnonzero(coarse & ~is_undecided(words)).tolist():
        status[lane], cause[lane] = "step_error", ""
    left_open: dict[int, str] = {}
    for row, requirement in _in_order(metrics):
        limit = require.limit(requirement.key)
        if limit is None:
            continue
        # A smallest value of the metric is a largest value of its negative.
        side = -1.0 if requirement.is_least else 1.0
        most = side * limit
        missed = requirement.cause or metrics[row].name
        reached, error = side * requirement.sign * values[row], errors[row]
        counts = ~undecided & ~failed
        if requirement.status:
            counts &= words == requirement.status
        # The negation also takes values that are NaN for exceeding the limit.
        beyond = counts & ~(reached <= most)
        either = counts & (error > 0.0) & (np.abs(reached - most) <= error)
        for lane in np.flatnonzero(either).tolist():
            left_open.setdefault(lane, missed)
        beyond &= ~either
        for lane in np.flatnonzero(beyond).tolist():
            status[lane], cause[lane] = "requirement", missed
        failed |= beyond
    for lane, missed in left_open.items():
        if not failed[lane]:
            status[lane], cause[lane] = "step_error", missed
    return tuple(status), tuple(cause), failed


def _in_order(metrics: Sequence[FlightMetric[Any]]) -> list[tuple[int, Requirement]]:
    """Return the requirements with the rows of their metrics in the order of their ranks."""
    rows = [(row, r) for row, metric in enumerate(metrics) for r in metric.requirements]
    return sorted(rows, key=lambda item: item[1].rank)
