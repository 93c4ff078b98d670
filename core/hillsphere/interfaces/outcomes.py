"""Requirements and claims of a mission: how each is judged from the results of its stages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

from hillsphere.base.contracts import Contract

if TYPE_CHECKING:
    from hillsphere.show.presentation import Metric, Table

__all__ = [
    "CLAIM_STATES", "FAILING_STATES", "REQUIREMENT_STATES", "Evidence", "Judge", "Judgement",
    "MissingResultError", "State",
]  # fmt: skip

State: TypeAlias = Literal[
    "met", "not met", "confirmed", "refuted", "undecided", "not derivable", "not evaluated"
]
REQUIREMENT_STATES: tuple[State, ...] = ("not met", "undecided", "met", "not evaluated")
"""States of a requirement, in the order in which rows are shown."""
FAILING_STATES: tuple[State, ...] = ("not met", "undecided")
"""States of a requirement with which a run does not fulfil its mission."""
CLAIM_STATES: tuple[State, ...] = (
    "refuted", "undecided", "confirmed", "not derivable", "not evaluated"
)  # fmt: skip
"""States of a claim, in the order in which rows are shown."""


class MissingResultError(LookupError):
    """A metric, table, row or column that a requirement or claim names does not exist."""


@dataclass(frozen=True)
class Judgement:
    """The outcome of a requirement or a claim.

    Parameters
    ----------
    state : str
        One of `REQUIREMENT_STATES` or `CLAIM_STATES`. It is ``"not evaluated"`` only if the stage
        is no part of the run or has not finished.
    text : str
        The requirement or the statement, in words.
    asked, got : str
        Requested and computed value with unit, as shown.
    value, limit : float, int, bool, str or None
        Computed and requested value, both in `unit`.
    unit : str
        Unit of the values, ``""`` for none.
    margin : float or None
        Distance of the value from the limit in `unit`, positive if the limit is kept.
    interval : tuple of float or None
        Confidence interval of the value, in `unit`.
    confidence : float or None
        Requested probability that the interval holds the true value.
    reason : str
        Reason for a state that the values alone do not explain; ``""`` otherwise.
    source : str
        Source of the statement, such as a table of a paper.
    """

    state: State
    text: str = ""
    asked: str = ""
    got: str = ""
    value: float | int | bool | str | None = None
    limit: float | int | bool | str | None = None
    unit: str = ""
    margin: float | None = None
    interval: tuple[float, float] | None = None
    confidence: float | None = None
    reason: str = ""
    source: str = ""


class Evidence(Protocol):
    """The results of the stages of a run, as a requirement or claim reads them."""

    def metric(self, stage: str, name: str) -> Metric:
        """Return a metric of a stage; `MissingResultError` says what the stage has instead."""
        ...

    def table(self, stage: str, name: str) -> Table:
        """Return a table of a stage; `MissingResultError` says what the stage has instead."""
        ...


class Judge(Contract, Protocol):
    """A requirement or a claim: a component that is judged when all stages have ended."""

    def judge(self, evidence: Evidence) -> Judgement:
        """Return the outcome.

        `MissingResultError` may be raised: the row is then undecided, and the message its reason.
        It is not called if a stage that its Spec refers to has not finished.
        """
        ...
