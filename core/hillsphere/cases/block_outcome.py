"""Outcomes of the cases of a block, and lossless joining and division of such outcomes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import StageError
from hillsphere.interfaces.cases import Flags, Histories
from hillsphere.products.fields import Shape

__all__ = [
    "BlockOutcome",
    "complete_metrics",
    "divide_outcome",
    "join_outcomes",
    "lost_rows",
    "reorder_cases",
]


@dataclass(frozen=True)
class BlockOutcome:
    """Outcomes of the cases of a block, or of a part of one, without the filler lanes."""

    numbers: Annotated[Integers, Shape("cases")]
    """Numbers of the cases, in the order of their lanes."""
    metrics: Annotated[tuple[str, ...], Shape("metrics")]
    """Names of the metrics; none if no case of the block came so far as to have any."""
    units: Annotated[tuple[str, ...], Shape("metrics")]
    """Their units."""
    values: Annotated[Array, Shape("metrics", "cases")]
    """Their values; NaN where a case has none."""
    status: Annotated[NDArray[np.str_], Shape("cases")]
    """How each case ended. Beside the stage's own words: ``"error"`` (it raised), ``"memory"``,
    ``"not_finite"``, ``"input"`` (an impossible draw), ``"killed"`` and ``"time_limit"`` (it cost
    its worker). All these are undecided."""
    cause: Annotated[NDArray[np.str_], Shape("cases")]
    """What ended each case: the exception's class, the first metric that is not finite, the input
    that cannot be."""
    failed: Annotated[Flags, Shape("cases")]
    """Whether that counts as a failure; never of an undecided case."""
    message_case: Annotated[Integers, Shape("messages")]
    """Numbers of the cases that have a message."""
    messages: Annotated[tuple[str, ...], Shape("messages")]
    """Class and text of the exception, on one line."""
    histories: Histories | None = None
    """Histories of all cases, if they were asked for and the stage keeps any."""
    tracebacks: tuple[str, ...] = ()
    """Where each of `messages` was raised, if histories were asked for; ``""`` if nowhere."""
    seconds: float = 0.0
    """Wall-clock time it took; the one thing in here that a repetition does not reproduce."""
    step_error: Annotated[Array | None, Shape("cases")] = None
    """Estimates of the step errors; NaN where a case has none, None if the stage gives none."""


def lost_rows(
    numbers: Integers, status: str, cause: str, message: str, tracebacks: tuple[str, ...] = ()
) -> BlockOutcome:
    """Return the outcome of undecided cases (n,) without metrics."""
    count = len(numbers)
    return BlockOutcome(
        numbers=numbers,
        metrics=(),
        units=(),
        values=np.zeros((0, count)),
        status=np.array([status] * count, dtype=np.str_),
        cause=np.array([cause] * count, dtype=np.str_),
        failed=np.zeros(count, dtype=np.bool_),
        message_case=numbers,
        messages=(message,) * count,
        tracebacks=tracebacks,
    )


def complete_metrics(outcomes: Sequence[BlockOutcome]) -> list[BlockOutcome]:
    """Return the outcomes with the same metrics each; values that a block did not have are NaN.

    Raises
    ------
    StageError
        If two have different metrics.
    """
    known = next((o for o in outcomes if o.metrics), None)
    if known is None:
        return list(outcomes)
    found = []
    for outcome in outcomes:
        if not outcome.metrics:
            empty = np.full((len(known.metrics), len(outcome.numbers)), np.nan)
            outcome = replace(outcome, metrics=known.metrics, units=known.units, values=empty)
        elif (outcome.metrics, outcome.units) != (known.metrics, known.units):
            raise StageError(
                f"run_cases gave metrics {_format_metrics(outcome)} for cases {_span(outcome)}, "
                f"but {_format_metrics(known)} for cases {_span(known)}; they must be the same for "
                "every block"
            )
        found.append(outcome)
    return found


def join_outcomes(outcomes: Sequence[BlockOutcome]) -> BlockOutcome:
    """Return one outcome of the cases of several, in that order; at least one is given."""
    if len(outcomes) == 1:
        return outcomes[0]
    parts = complete_metrics(outcomes)
    return BlockOutcome(
        numbers=np.concatenate([o.numbers for o in parts]),
        metrics=parts[0].metrics,
        units=parts[0].units,
        values=np.concatenate([o.values for o in parts], axis=1),
        status=np.concatenate([o.status for o in parts]),
        cause=np.concatenate([o.cause for o in parts]),
        failed=np.concatenate([o.failed for o in parts]),
        message_case=np.concatenate([o.message_case for o in parts]),
        messages=tuple(m for o in parts for m in o.messages),
        histories=_join_histories(parts),
        tracebacks=tuple(t for o in parts for t in o.tracebacks),
        seconds=sum(o.seconds for o in parts),
        step_error=_join_errors(parts),
    )


def _join_errors(parts: Sequence[BlockOutcome]) -> Array | None:
    if all(o.step_error is None for o in parts):
        return None
    return np.concatenate(
        [np.full(len(o.numbers), np.nan) if o.step_error is None else o.step_error for o in parts]
    )


def reorder_cases(outcome: BlockOutcome, order: Integers) -> BlockOutcome:
    """Return the outcomes with the case at place `order[i]` (n,) in row i."""
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    number_of = {number: i for i, number in enumerate(outcome.numbers.tolist())}
    told = np.argsort(
        [place[number_of[number]] for number in outcome.message_case.tolist()], kind="stable"
    ).astype(np.int64)
    return replace(
        outcome,
        numbers=outcome.numbers[order],
        values=np.ascontiguousarray(outcome.values[:, order]),
        status=outcome.status[order],
        cause=outcome.cause[order],
        failed=outcome.failed[order],
        message_case=outcome.message_case[told],
        messages=tuple(outcome.messages[i] for i in told),
        histories=outcome.histories and outcome.histories.of_cases(order),
        tracebacks=tuple(outcome.tracebacks[i] for i in told) if outcome.tracebacks else (),
        step_error=None if outcome.step_error is None else outcome.step_error[order],
    )


def divide_outcome(
    outcome: BlockOutcome, counts: Sequence[int], seconds: Sequence[float]
) -> list[BlockOutcome]:
    """Split a joined outcome into parts of given case counts and run times, without histories."""
    ends = np.cumsum(counts)
    # Messages are in the order of the cases, but not every case has one.
    place = {number: i for i, number in enumerate(outcome.numbers.tolist())}
    message_place = np.array([place[n] for n in outcome.message_case.tolist()], dtype=np.int64)
    parts = []
    for first, last, took in zip(ends - np.asarray(counts), ends, seconds, strict=True):
        told = np.flatnonzero((message_place >= first) & (message_place < last))
        parts.append(
            BlockOutcome(
                numbers=outcome.numbers[first:last].copy(),
                metrics=outcome.metrics,
                units=outcome.units,
                values=outcome.values[:, first:last].copy(),
                # No wider than their longest word, as they were before they were joined.
                status=np.array(outcome.status[first:last].tolist(), dtype=np.str_),
                cause=np.array(outcome.cause[first:last].tolist(), dtype=np.str_),
                failed=outcome.failed[first:last].copy(),
                message_case=outcome.message_case[told],
                messages=tuple(outcome.messages[i] for i in told),
                seconds=took,
                step_error=(
                    None if outcome.step_error is None else outcome.step_error[first:last].copy()
                ),
            )
        )
    return parts


def _join_histories(parts: Sequence[BlockOutcome]) -> Histories | None:
    known = next((o.histories for o in parts if o.histories is not None), None)
    if known is None:
        return None
    longest = max(len(o.histories.time_s) for o in parts if o.histories is not None)
    total = sum(len(o.numbers) for o in parts)
    time = np.full((longest, total), np.nan)
    values = np.full((len(known.names), longest, total), np.nan)
    end, end_values = np.full(total, np.nan), np.full((len(known.names), total), np.nan)
    first = 0
    for outcome in parts:
        last = first + len(outcome.numbers)
        if outcome.histories is not None:
            samples = len(outcome.histories.time_s)
            time[:samples, first:last] = outcome.histories.time_s
            values[:, :samples, first:last] = outcome.histories.values
            if outcome.histories.end_s is not None and outcome.histories.end_values is not None:
                end[first:last] = outcome.histories.end_s
                end_values[:, first:last] = outcome.histories.end_values
        first = last
    if not np.isfinite(end).any():
        return replace(known, time_s=time, values=values, end_s=None, end_values=None)
    return replace(known, time_s=time, values=values, end_s=end, end_values=end_values)


def _format_metrics(outcome: BlockOutcome) -> str:
    return ", ".join(f"{m} ({u})" for m, u in zip(outcome.metrics, outcome.units, strict=True))


def _span(outcome: BlockOutcome) -> str:
    return f"{outcome.numbers.min()} to {outcome.numbers.max()}"
