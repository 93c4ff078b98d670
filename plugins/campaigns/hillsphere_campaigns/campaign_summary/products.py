"""What a summary of campaigns yields."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.base.arrays import Array, Integers

__all__ = ["CampaignSummary", "Claim"]


@dataclass(frozen=True)
class Claim:
    """The answer to a statement.

    Parameters
    ----------
    text : str
        The statement.
    answer : str
        ``"confirmed"``, ``"refuted"`` or ``"undecidable"``.
    difference : float
        What the answer rests on: of a metric the mean difference over pairs, of failures the
        difference of their ratios; below zero speaks for the statement.
    interval : ndarray, shape (2,)
        Of it, as wide as undecided cases leave it; both ends equal where nothing is random.
    unit : str
        Its unit.
    pairs : int
        Number of pairs, or of chosen cases.
    reason : str
        In words.
    """

    text: str
    answer: str
    difference: float
    interval: Array
    unit: str
    pairs: int
    reason: str


@dataclass(frozen=True)
class CampaignSummary:
    """C campaigns side by side.

    Parameters
    ----------
    labels : tuple of str
        One per campaign.
    level : float
        Confidence level of all intervals.
    metrics, units : tuple of str
        The m metrics that all campaigns have; SI.
    count : ndarray of int, shape (m, C)
        Cases that came to their end with a value.
    mean, deviation : ndarray, shape (m, C)
        Over them.
    mean_interval, deviation_interval : ndarray, shape (2, m, C)
        Of both.
    cases, failures, undecided : ndarray of int, shape (C,)
        Decided random cases, failures among them, and undecided cases beside them.
    worst_cases, worst_failures, worst_undecided : ndarray of int, shape (C,)
        The same of chosen cases; zero if there are none.
    claims : tuple of Claim
        The statements, answered.
    """

    labels: tuple[str, ...]
    level: float
    metrics: tuple[str, ...]
    units: tuple[str, ...]
    count: Integers
    mean: Array
    deviation: Array
    mean_interval: Array
    deviation_interval: Array
    cases: Integers
    failures: Integers
    undecided: Integers
    worst_cases: Integers
    worst_failures: Integers
    worst_undecided: Integers
    claims: tuple[Claim, ...]
