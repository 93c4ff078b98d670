"""Products of the stage ``tracking_comparison``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array, Integers
from hillsphere.products.fields import Label, Shape

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
    """Comparison of T trackers over L outages at the P points of a sweep."""

    stage: str
    """Name of the repeated stage."""
    name: str
    """Name of the swept number, such as the age of the elements."""
    unit: str
    """Unit of the swept number."""
    value: Annotated[Array, Shape("points")]
    """Value of the swept number at each point."""
    group: Annotated[tuple[str, ...], Shape("points"), Label("also swept")]
    """Other swept quantities in words; ``""`` if there are none."""
    baseline: str
    """Tracker to which the others are compared."""
    passes: Annotated[tuple[str, ...], Shape("outages")]
    """Pass of each outage."""
    outages: Annotated[tuple[str, ...], Shape("outages")]
    """Name of each outage."""
    trackers: Annotated[tuple[str, ...], Shape("trackers"), Label("tracker")]
    """Names of the trackers."""
    count: Annotated[Integers, Shape("points"), Label("cases")]
    """Number of completed cases at each point."""
    mean_median_rad: Annotated[
        Array, Shape("trackers", "points"), Label("mean of medians", 4, "deg")
    ]
    """Mean over the outages of the median error over the cases; NaN without cases."""
    mean_interval_rad: Annotated[Array, Shape(2, "trackers", "points")]
    """Bootstrap interval of the mean."""
    worst_median_rad: Annotated[Array, Shape("trackers", "points"), Label("worst median", 4, "deg")]
    """Maximum over the outages of the median error; NaN without cases."""
    worst_ratio: Annotated[Array, Shape("trackers", "points")]
    """Largest ratio over the outages of the median error to the median error of the baseline."""
    worst_ratio_outage: Annotated[Integers, Shape("trackers", "points")]
    """Outage of the largest ratio."""
    reacquired: Annotated[Array, Shape(3, "trackers", "points")]
    """Shares found at once, found by a search, and not found; NaN without a search."""
    reacquire_s: Annotated[Array, Shape(2, "trackers", "points")]
    """Median and 95 % quantile of the time to reacquire, of cases that are found."""


@dataclass(frozen=True)
class Consistency:
    """Consistency of trackers: NEES of their predictions, with two degrees of freedom."""

    stage: str
    """Name of the repeated stage."""
    passes: Annotated[tuple[str, ...], Shape("outages"), Label("pass")]
    """Pass of each outage."""
    outages: Annotated[tuple[str, ...], Shape("outages"), Label("outage")]
    """Name of each outage."""
    trackers: Annotated[tuple[str, ...], Shape("trackers"), Label("tracker")]
    """Names of the trackers."""
    consistent: tuple[str, ...]
    """Trackers whose assumed errors equal the true ones."""
    count: Annotated[Integers, Shape("trackers", "outages"), Label("cases")]
    """Number N of cases with a value."""
    mean: Annotated[Array, Shape("trackers", "outages"), Label("mean NEES", 4)]
    """Mean NEES over the cases; its expectation is 2 for a consistent tracker."""
    interval: Annotated[Array, Shape(2, "trackers", "outages")]
    """Band of the mean of a consistent tracker at the confidence level: quantiles of χ² with 2N
    degrees of freedom, divided by N."""
    overall: Annotated[Array, Shape("trackers"), Label("mean NEES", 4)]
    """Mean of `mean` over the outages."""
    overall_interval: Annotated[Array, Shape(2, "trackers")]
    """Bootstrap interval of `overall`."""
    mean_median_rad: Annotated[Array, Shape("trackers"), Label("mean of median errors", 4, "deg")]
    """Mean over the outages of the median error."""
    error_ratio: Annotated[
        Array, Shape("trackers"), Label("over that of the first that is right", 4)
    ]
    """Ratio of `mean_median_rad` to the value of the first tracker of `consistent`."""
    error_ratio_interval: Annotated[Array, Shape(2, "trackers")]
    """Bootstrap interval of `error_ratio`."""


@dataclass(frozen=True)
class TrackingComparison:
    """Comparison of T trackers over L outages in many cases, relative to a baseline."""

    satellite: str
    """Name of the satellite."""
    stage: str
    """Name of the repeated stage."""
    baseline: str
    """Tracker to which the others are compared."""
    measure: str
    """Name of the error that is compared, one of `FRAMES`."""
    level: float
    """Confidence level of all intervals."""
    lock_angle_rad: float
    """Largest error at which the signal is received."""
    cases: int
    """Number of cases."""
    ended: int
    """Number of completed cases."""
    passes: Annotated[tuple[str, ...], Shape("outages"), Label("pass")]
    """Pass of each outage."""
    outages: Annotated[tuple[str, ...], Shape("outages"), Label("outage")]
    """Name of each outage."""
    loss_s: Annotated[Array, Shape("outages"), Label("signal lost after", 5)]
    """Time of the loss after the acquisition."""
    prediction_s: Annotated[Array, Shape("outages"), Label("prediction", 5)]
    """Length of the prediction."""
    trackers: Annotated[tuple[str, ...], Shape("trackers"), Label("tracker")]
    """Names of the trackers."""
    measures: Annotated[tuple[str, ...], Shape("measures")]
    """Names of the measures."""
    units: Annotated[tuple[str, ...], Shape("measures")]
    """Units of the measures."""
    quantiles: Annotated[Array, Shape(3, "measures", "trackers", "outages")]
    """Quantiles over the completed cases at `LEVELS`; NaN without cases."""
    count: Annotated[Integers, Shape("measures", "trackers", "outages")]
    """Number of cases with a value."""
    locked: Annotated[Array, Shape(3, "trackers", "outages")]
    """Share of the cases whose largest error, for each of `FRAMES`, is within the lock angle."""
    pooled: Annotated[Array, Shape(3, "measures", "trackers")]
    """Quantiles over all cases and outages together."""
    mean_median_rad: Annotated[Array, Shape(3, "trackers")]
    """Mean over the outages of the medians, for each of `FRAMES`."""
    mean_interval_rad: Annotated[Array, Shape(2, 3, "trackers")]
    """Bootstrap interval of the mean."""
    worst_median_rad: Annotated[Array, Shape(3, "trackers")]
    """Maximum over the outages of the medians, for each of `FRAMES`."""
    ratio: Annotated[Array, Shape("trackers"), Label("error over the baseline's", 4)]
    """Ratio of the mean of the medians of `measure` to the value of the baseline."""
    ratio_interval: Annotated[Array, Shape(2, "trackers")]
    """Bootstrap interval of `ratio`."""
    reacquired: Annotated[Array, Shape(3, "trackers")]
    """Shares found at once, found by a search, and not found, over all cases and outages; NaN
    without a search."""
    reacquire_s: Annotated[Array, Shape(2, "trackers")]
    """Median and 95 % quantile of the time to reacquire, of cases that are found."""
    nees_limit: float
    """NEES on the ellipse that contains the share `COVERED` of the errors that the covariance
    predicts."""
    uncovered: Annotated[Array, Shape("trackers", "outages")]
    """Share of the cases with a larger NEES."""
    station_error_m: float
    """Largest error of a station's location that the trackers assume."""
    ages: AgeComparison | None
    """Comparison at the points of a sweep."""
    consistency: Consistency | None
    """Consistency of the trackers."""
