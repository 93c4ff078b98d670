"""Products of the stage ``tracking_comparison``."""

from __future__ import annotations

from dataclasses import dataclass

from hillsphere.interfaces import Array, Integers

__all__ = ["COVERED", "FRAMES", "LEVELS", "AgeComparison", "Consistency", "TrackingComparison"]

LEVELS = (0.05, 0.5, 0.95)
"""Levels of the quantiles over the cases: the median, and a band that 90 % of the cases are in."""

FRAMES = ("error_max", "sky_error_max", "encoder_error_max")
"""Measures that are errors: of the true direction, on the sky, at the encoders."""

COVERED = 0.999
"""Probability of the ellipse beyond which an error is not covered by the covariance. In a campaign
of some hundred cases a consistent tracker exceeds it at most once or twice."""


@dataclass(frozen=True)
class AgeComparison:
    """Comparison of trackers at the P points of a sweep.

    Parameters
    ----------
    stage : str
        Name of the repeated stage.
    name, unit : str
        Name and unit of the swept number, such as the age of the elements.
    value : ndarray, shape (P,)
        Value of the swept number at each point.
    group : tuple of str, length P
        Other swept quantities in words; ``""`` if there are none.
    baseline : str
        Tracker to which the others are compared.
    passes, outages : tuple of str
        Pass and name of each of the L outages.
    trackers : tuple of str
        Names of the T trackers.
    count : ndarray of int, shape (P,)
        Number of completed cases at each point.
    mean_median_rad, worst_median_rad : ndarray, shape (T, P)
        Mean and maximum over the outages of the median error over the cases; NaN without cases.
    mean_interval_rad : ndarray, shape (2, T, P)
        Bootstrap interval of the mean.
    worst_ratio : ndarray, shape (T, P)
        Largest ratio over the outages of the median error to the median error of the baseline.
    worst_ratio_outage : ndarray of int, shape (T, P)
        Outage of the largest ratio.
    reacquired : ndarray, shape (3, T, P)
        Shares found at once, found by a search, and not found; NaN without a search.
    reacquire_s : ndarray, shape (2, T, P)
        Median and 95 % quantile of the time to reacquire, of cases that are found.
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
    """Consistency of trackers: NEES of their predictions, with two degrees of freedom.

    Parameters
    ----------
    stage : str
        Name of the repeated stage.
    passes, outages : tuple of str
        Pass and name of each of the L outages.
    trackers : tuple of str
        Names of the T trackers.
    consistent : tuple of str
        Trackers whose assumed errors equal the true ones.
    count : ndarray of int, shape (T, L)
        Number N of cases with a value.
    mean : ndarray, shape (T, L)
        Mean NEES over the cases; its expectation is 2 for a consistent tracker.
    interval : ndarray, shape (2, T, L)
        Band of the mean of a consistent tracker at the confidence level: quantiles of χ² with 2N
        degrees of freedom, divided by N.
    overall : ndarray, shape (T,)
        Mean of `mean` over the outages.
    overall_interval : ndarray, shape (2, T)
        Bootstrap interval of `overall`.
    mean_median_rad : ndarray, shape (T,)
        Mean over the outages of the median error.
    error_ratio : ndarray, shape (T,)
        Ratio of `mean_median_rad` to the value of the first tracker of `consistent`.
    error_ratio_interval : ndarray, shape (2, T)
        Bootstrap interval of `error_ratio`.
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
    """Comparison of T trackers over L outages in many cases, relative to a baseline.

    Parameters
    ----------
    satellite : str
        Name of the satellite.
    stage : str
        Name of the repeated stage.
    baseline : str
        Tracker to which the others are compared.
    measure : str
        Name of the error that is compared, one of `FRAMES`.
    level : float
        Confidence level of all intervals.
    lock_angle_rad : float
        Largest error at which the signal is received.
    cases, ended : int
        Number of cases, and number of completed cases.
    passes, outages : tuple of str
        Pass and name of each outage.
    loss_s, prediction_s : ndarray, shape (L,)
        Time of the loss after the acquisition, and length of the prediction.
    trackers : tuple of str
        Names of the trackers.
    measures, units : tuple of str
        Names and units of the M measures.
    quantiles : ndarray, shape (3, M, T, L)
        Quantiles over the completed cases at `LEVELS`; NaN without cases.
    count : ndarray of int, shape (M, T, L)
        Number of cases with a value.
    locked : ndarray, shape (3, T, L)
        Share of the cases whose largest error, for each of `FRAMES`, is within the lock angle.
    pooled : ndarray, shape (3, M, T)
        Quantiles over all cases and outages together.
    mean_median_rad, worst_median_rad : ndarray, shape (3, T)
        Mean and maximum over the outages of the medians, for each of `FRAMES`.
    mean_interval_rad : ndarray, shape (2, 3, T)
        Bootstrap interval of the mean.
    ratio : ndarray, shape (T,)
        Ratio of the mean of the medians of `measure` to the value of the baseline.
    ratio_interval : ndarray, shape (2, T)
        Bootstrap interval of `ratio`.
    reacquired : ndarray, shape (3, T)
        Shares found at once, found by a search, and not found, over all cases and outages; NaN
        without a search.
    reacquire_s : ndarray, shape (2, T)
        Median and 95 % quantile of the time to reacquire, of cases that are found.
    nees_limit : float
        NEES on the ellipse that contains the share `COVERED` of the errors that the covariance
        predicts.
    uncovered : ndarray, shape (T, L)
        Share of the cases with a larger NEES.
    station_error_m : float
        Largest error of a station's location that the trackers assume.
    ages : AgeComparison or None
        Comparison at the points of a sweep.
    consistency : Consistency or None
        Consistency of the trackers.
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
