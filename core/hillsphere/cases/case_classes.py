"""The class of a case: success, failure, or undecided, and ratios over the decided ones.

A case says something of what is flown only if it could be computed. A step error, an event that
could not be resolved, an impossible draw or a lost process is neither a success nor a failure of
the flight. Such cases are undecided; ratios are taken over the others, and beside them stands the
range that the undecided ones leave open.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaincinv

from hillsphere.base.arrays import Array

__all__ = [
    "LEVEL",
    "UNDECIDED",
    "FailureRatio",
    "case_class",
    "decided_failures",
    "failure_ratio",
    "has_ended",
    "is_undecided",
    "ratio_at_points",
    "ratio_interval",
    "ratio_of",
    "undecided_sentence",
    "what_left_it_undecided",
]

LEVEL = 0.95
"""Confidence level of all intervals where no other is asked for."""

UNDECIDED = {
    "step_size": "numerics",
    "step_error": "numerics",
    "unresolved": "numerics",
    "not_finite": "numerics",
    "input": "input",
    "error": "computation",
    "memory": "computation",
    "killed": "computation",
    "time_limit": "computation",
}
"""Statuses of undecided cases, and what left each undecided.

``numerics``: ``step_size`` (the smallest steps missed the tolerance), ``step_error`` (its estimate
is beyond the limit, or could turn the verdict), ``unresolved`` (an event could not be decided),
``not_finite`` (a metric is no number). ``input``: a draw that means nothing, such as a negative
density. ``computation``: the case raised, or cost its worker.
"""

_MEANINGS = {
    "step_size": "the smallest steps missed the tolerance; allow more steps or a larger tolerance",
    "step_error": "the estimated step error is beyond its limit (largest_step_error), or could "
    "turn what is required; take more steps (substeps, or a tolerance)",
    "unresolved": "it could not be proved whether the event that is named as the cause happened "
    "between two steps; take more steps (substeps)",
    "not_finite": "a metric is no finite number",
    "input": "the values drawn mean nothing, such as a negative density; narrow or truncate the "
    "dispersion (truncate_sigmas)",
    "error": "the computation stopped with an error, which the message names",
    "memory": "the computation ran out of memory",
    "killed": "its process was killed or ended by itself",
    "time_limit": "it took longer than block_limit",
}
"""What each status of `UNDECIDED` says to a reader, and the remedy where the mission has one."""

Flags = NDArray[np.bool_]


class Judged(Protocol):
    """Outcomes of N cases with their statuses: `CaseTable`, `BlockOutcome`, `CaseResults`."""

    @property
    def status(self) -> NDArray[np.str_]:
        """How each case ended."""
        ...

    @property
    def failed(self) -> Flags:
        """Whether that counts as a failure."""
        ...


def is_undecided(status: Iterable[str] | NDArray[np.str_]) -> Flags:
    """Return the mask (N,) of the statuses of undecided cases."""
    words = status if isinstance(status, np.ndarray) else np.array(list(status), dtype=np.str_)
    return np.asarray(np.isin(words, tuple(UNDECIDED)))


def decided_failures(table: Judged) -> Flags:
    """Return the mask (N,) of decided cases that failed."""
    return np.asarray(table.failed & ~is_undecided(table.status))


def has_ended(table: Judged) -> Flags:
    """Return the mask (N,) of cases that ended regularly, whose metrics enter the statistics.

    These are the successes, and the cases that only missed a requirement.
    """
    sound = ~table.failed | (table.status == "requirement")
    return np.asarray(sound & ~is_undecided(table.status))


def case_class(status: str, failed: bool) -> str:
    """Return the class of a case in words, for tables."""
    if status in UNDECIDED:
        return f"undecided ({UNDECIDED[status]})"
    return "failure" if failed else "success"


def what_left_it_undecided(status: Iterable[str] | NDArray[np.str_]) -> str:
    """Say what each status of an undecided case means, once each; ``""`` if none is there."""
    present = {str(word) for word in status}
    return "; ".join(f"{word}: {said}" for word, said in _MEANINGS.items() if word in present)


def ratio_interval(count: ArrayLike, total: ArrayLike, level: float = LEVEL) -> Array:
    """Return the Clopper–Pearson interval of a probability.

    Parameters
    ----------
    count, total : array_like of int
        How often it happened in how many independent trials.
    level : float
        Confidence level; the true coverage is never less.

    Returns
    -------
    ndarray, shape (2, ...)
        Lower and upper end; (0, 1) for no trial.

    References
    ----------
    .. [1] C. J. Clopper, E. S. Pearson (1934), Biometrika 26, 404–413.
    """
    k, n = np.broadcast_arrays(np.asarray(count, dtype=float), np.asarray(total, dtype=float))
    tail = 0.5 * (1.0 - level)
    # The arguments of the inverse must be positive, also where its value is not used.
    low = betaincinv(np.maximum(k, 0.5), n - k + 1.0, tail)
    high = betaincinv(k + 1.0, np.maximum(n - k, 0.5), 1.0 - tail)
    return np.array([np.where(k > 0, low, 0.0), np.where(k < n, high, 1.0)])


@dataclass(frozen=True)
class FailureRatio:
    """Share of failures among decided cases, of one group of cases or of each of P groups.

    Parameters
    ----------
    failures, decided, undecided : ndarray of int, shape (...)
        Numbers of cases.
    value : ndarray, shape (...)
        Failures by decided cases; NaN without any.
    interval : ndarray, shape (2, ...)
        Clopper–Pearson interval over the decided cases.
    range : ndarray, shape (2, ...)
        The ratio over all cases if none of the undecided ones had failed, and if all had.
    sure : ndarray, shape (2, ...)
        Lower end of the interval in the first of these, upper end in the second: equal to
        `interval` if every case is decided.
    """

    failures: NDArray[np.int64]
    decided: NDArray[np.int64]
    undecided: NDArray[np.int64]
    value: Array
    interval: Array
    range: Array
    sure: Array


def failure_ratio(
    failures: ArrayLike, decided: ArrayLike, undecided: ArrayLike, level: float = LEVEL
) -> FailureRatio:
    """Return the failure ratio from numbers of cases, see `FailureRatio`."""
    f, n, u = (np.asarray(k, dtype=np.int64) for k in (failures, decided, undecided))
    total = n + u
    every = np.maximum(total, 1)
    return FailureRatio(
        f,
        n,
        u,
        np.where(n > 0, f / np.maximum(n, 1), np.nan),
        ratio_interval(f, n, level),
        np.array([f / every, (f + u) / every]),
        np.array([ratio_interval(f, total, level)[0], ratio_interval(f + u, total, level)[1]]),
    )


def ratio_of(table: Judged, level: float = LEVEL) -> FailureRatio:
    """Return the failure ratio of all cases of a table."""
    left = int(np.count_nonzero(is_undecided(table.status)))
    failures = int(np.count_nonzero(decided_failures(table)))
    return failure_ratio(failures, len(table.failed) - left, left, level)


def ratio_at_points(
    table: Judged, point: NDArray[np.int64], count: int, level: float = LEVEL
) -> FailureRatio:
    """Return the failure ratio at each of `count` points, to which cases belong by `point` (N,)."""
    left = is_undecided(table.status)

    def number(which: Flags) -> NDArray[np.int64]:
        return np.bincount(point[which], minlength=count)

    return failure_ratio(number(decided_failures(table)), number(~left), number(left), level)


def undecided_sentence(table: Judged) -> str:
    """Say how many cases are undecided and why; ``""`` if none is."""
    left = is_undecided(table.status)
    if not left.any():
        return ""
    reasons: dict[str, int] = {}
    words, counts = np.unique(np.asarray(table.status)[left], return_counts=True)
    for word, count in zip(words.tolist(), counts.tolist(), strict=True):
        reasons[UNDECIDED[word]] = reasons.get(UNDECIDED[word], 0) + count
    total = int(left.sum())
    told = ", ".join(f"{count} by {reason}" for reason, count in reasons.items())
    low, high = 100.0 * ratio_of(table).range
    return (
        f"{total} of {left.size} cases {'is' if total == 1 else 'are'} undecided ({told}), neither "
        f"success nor failure: over all cases the failure ratio is {low:.3g} % if none of them "
        f"had failed, {high:.3g} % if all had."
    )
