"""What the stage ``tracking_comparison`` yields."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array, Integers

__all__ = ["FRAMES", "LEVELS", "AgeComparison", "Consistency", "TrackingComparison"]

LEVELS = (0.05, 0.5, 0.95)
"""Levels of the quantiles over the cases."""

FRAMES = ("error_max", "sky_error_max", "encoder_error_max")
"""Measures that are errors: against the true place, on the sky, at the encoders."""


@dataclass(frozen=True)
class AgeComparison:
    """Trackers at the points of a sweep.

    Parameters
    ----------
    stage : str
        Name of the stage that was repeated.
    name, unit : str
        The number that was swept, such as the age of the elements.
    value : ndarray, shape (P,)
        Its value at each point.
    group : tuple of str, length P
        What else was swept, in words; ``""`` if nothing was.
    trackers : tuple of str
        Names of the T trackers.
    count : ndarray of int, shape (P,)
        Cases at each point that came to their end.
    mean_median_rad, worst_median_rad : ndarray, shape (T, P)
        Mean and largest over the outages of the medians over the cases; NaN without any.
    """

    stage: str
    name: str
    unit: str
    value: Array
    group: tuple[str, ...]
    trackers: tuple[str, ...]
    count: Integers
    mean_median_rad: Array
    worst_median_rad: Array


@dataclass(frozen=True)
class Consistency:
    """Normalised errors squared (NEES) of predictions, two degrees of freedom each.

    Parameters
    ----------
    stage : str
        Name of the stage that was repeated.
    passes, outages : tuple of str
        Pass and name of each of the L outages.
    trackers : tuple of str
        Names of the T trackers.
    count : ndarray of int, shape (T, L)
        Cases N that have a value.
    mean : ndarray, shape (T, L)
        Mean over the cases: 2 if the tracker knows how good it is.
    interval : ndarray, shape (2, T, L)
        In which the mean lies at the confidence level if it does: quantiles of χ² with 2N degrees
        of freedom, over N.
    """

    stage: str
    passes: tuple[str, ...]
    outages: tuple[str, ...]
    trackers: tuple[str, ...]
    count: Integers
    mean: Array
    interval: Array


@dataclass(frozen=True)
class TrackingComparison:
    """T trackers over L outages in many cases, compared with one of them.

    Parameters
    ----------
    satellite : str
        Its name.
    stage : str
        Name of the stage that was repeated.
    baseline : str
        Tracker that the others are compared with.
    measure : str
        Error that is compared, one of `FRAMES`.
    level : float
        Confidence level of all intervals.
    lock_angle_rad : float
        Error up to which the signal is received.
    cases, ended : int
        How many cases there were, and how many of them came to their end.
    passes, outages : tuple of str
        Pass and name of each outage.
    loss_s, prediction_s : ndarray, shape (L,)
        When the signal is lost after the acquisition, and how long the prediction is.
    trackers : tuple of str
        Names of the trackers.
    measures, units : tuple of str
        Names and units of the M measures.
    quantiles : ndarray, shape (3, M, T, L)
        Over the cases that came to their end, at `LEVELS`; NaN without any.
    count : ndarray of int, shape (M, T, L)
        Cases that have a value.
    locked : ndarray, shape (3, T, L)
        Share of the cases whose largest error, in each of `FRAMES`, is within the lock angle.
    pooled : ndarray, shape (3, M, T)
        Quantiles over cases and outages together.
    mean_median_rad, worst_median_rad : ndarray, shape (3, T)
        Mean and largest over the outages of the medians, in each of `FRAMES`.
    ratio : ndarray, shape (T,)
        Mean of the medians of `measure` over that of the baseline.
    ratio_interval : ndarray, shape (2, T)
        Its interval by bootstrap over the cases.
    ages : AgeComparison or None
        Trackers at the points of a sweep.
    consistency : Consistency or None
        Whether they know how good they are.
    """

    satellite: str
    stage: str
    baseline: str
    measure: str
    level: float
    lock_angle_rad: float
    cases: int
    ended: int
    passes: tuple[str, ...]
    outages: tuple[str, ...]
    loss_s: Array
    prediction_s: Array
    trackers: tuple[str, ...]
    measures: tuple[str, ...]
    units: tuple[str, ...]
    quantiles: Array
    count: Integers
    locked: Array
    pooled: Array
    mean_median_rad: Array
    worst_median_rad: Array
    ratio: Array
    ratio_interval: Array
    ages: AgeComparison | None
    consistency: Consistency | None
