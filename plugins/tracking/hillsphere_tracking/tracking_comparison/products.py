"""What the stage ``tracking_comparison`` yields."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array, Integers

__all__ = ["COVERED", "FRAMES", "LEVELS", "AgeComparison", "Consistency", "TrackingComparison"]

LEVELS = (0.05, 0.5, 0.95)
"""Levels of the quantiles over the cases."""

FRAMES = ("error_max", "sky_error_max", "encoder_error_max")
"""Measures that are errors: against the true place, on the sky, at the encoders."""

COVERED = 0.999
"""Probability of the ellipse beyond which an error counts as not covered by the covariance."""


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
    baseline : str
        Tracker that the others are compared with.
    passes, outages : tuple of str
        Pass and name of each of the L outages.
    trackers : tuple of str
        Names of the T trackers.
    count : ndarray of int, shape (P,)
        Cases at each point that came to their end.
    mean_median_rad, worst_median_rad : ndarray, shape (T, P)
        Mean and largest over the outages of the medians over the cases; NaN without any.
    mean_interval_rad : ndarray, shape (2, T, P)
        Interval of the mean by bootstrap over the cases.
    worst_ratio : ndarray, shape (T, P)
        Largest over the outages of the median over that of the baseline.
    worst_ratio_outage : ndarray of int, shape (T, P)
        In which outage.
    reacquired : ndarray, shape (3, T, P)
        Shares found at once, found by a search, and not found; NaN without a search.
    reacquire_s : ndarray, shape (2, T, P)
        Median and 95 % of the time to reacquire of those that are found.
    """

    stage: str
    name: str
    unit: str
    value: Array
    group: tuple[str, ...]
    baseline: str
    passes: tuple[str, ...]
    outages: tuple[str, ...]
    trackers: tuple[str, ...]
    count: Integers
    mean_median_rad: Array
    mean_interval_rad: Array
    worst_median_rad: Array
    worst_ratio: Array
    worst_ratio_outage: Integers
    reacquired: Array
    reacquire_s: Array


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
    consistent : tuple of str
        Those that expect errors as they truly are.
    count : ndarray of int, shape (T, L)
        Cases N that have a value.
    mean : ndarray, shape (T, L)
        Mean over the cases: 2 if the tracker knows how good it is.
    interval : ndarray, shape (2, T, L)
        In which the mean lies at the confidence level if it does: quantiles of χ² with 2N degrees
        of freedom, over N.
    overall : ndarray, shape (T,)
        Mean of `mean` over the outages.
    overall_interval : ndarray, shape (2, T)
        Its interval by bootstrap over the cases.
    mean_median_rad : ndarray, shape (T,)
        Mean over the outages of the median error.
    error_ratio : ndarray, shape (T,)
        The same over that of the first of `consistent`.
    error_ratio_interval : ndarray, shape (2, T)
        Its interval by bootstrap over the cases.
    """

    stage: str
    passes: tuple[str, ...]
    outages: tuple[str, ...]
    trackers: tuple[str, ...]
    consistent: tuple[str, ...]
    count: Integers
    mean: Array
    interval: Array
    overall: Array
    overall_interval: Array
    mean_median_rad: Array
    error_ratio: Array
    error_ratio_interval: Array


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
    mean_interval_rad : ndarray, shape (2, 3, T)
        Interval of the mean by bootstrap over the cases.
    ratio : ndarray, shape (T,)
        Mean of the medians of `measure` over that of the baseline.
    ratio_interval : ndarray, shape (2, T)
        Its interval by bootstrap over the cases.
    reacquired : ndarray, shape (3, T)
        Shares found at once, found by a search, and not found, over cases and outages together; NaN
        without a search.
    reacquire_s : ndarray, shape (2, T)
        Median and 95 % of the time to reacquire of those that are found.
    nees_limit : float
        NEES on the ellipse that holds `COVERED` of what the covariance lets expect.
    uncovered : ndarray, shape (T, L)
        Share of the cases whose NEES is larger.
    station_error_m : float
        How far from its place the trackers are told that a station is, at most.
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
    mean_interval_rad: Array
    worst_median_rad: Array
    ratio: Array
    ratio_interval: Array
    reacquired: Array
    reacquire_s: Array
    nees_limit: float
    uncovered: Array
    station_error_m: float
    ages: AgeComparison | None
    consistency: Consistency | None
