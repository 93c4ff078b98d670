"""Product of the stage ``navigation_comparison``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array
from hillsphere.products.fields import Label, Shape

__all__ = ["NavigationComparison"]


@dataclass(frozen=True)
class NavigationComparison:
    """Sets of sensors side by side, from a campaign, from single stages, or from both.

    The sets are those of the campaign or, without one, the stages. The points are those of the
    other swept keys. A value that does not exist is NaN.
    """

    labels: Annotated[tuple[str, ...], Shape("sets"), Label("sensors")]
    """Names of the sets of sensors."""
    spacecraft: Annotated[tuple[str, ...], Shape("spacecraft"), Label("spacecraft")]
    """Names of the spacecraft."""
    points: Annotated[tuple[str, ...], Shape("points"), Label("at")]
    """Names of the points."""
    cases: Annotated[Array, Shape("sets", "points")]
    """Number of flights of the campaign."""
    lost: Annotated[Array, Shape("sets", "points")]
    """Number of these that failed; the statistics below are over the others."""
    position_m: Annotated[Array, Shape(3, "sets", "points", "spacecraft")]
    """5 %, 50 % and 95 % quantile of the position error at the end."""
    velocity_m_s: Annotated[
        Array, Shape("sets", "points", "spacecraft"), Label("median velocity error", 4, "mm_s")
    ]
    """Median of the velocity error at the end."""
    rms_m: Annotated[Array, Shape("sets", "points", "spacecraft"), Label("rms", 4)]
    """Root mean square of the position error at the end."""
    bound_m: Annotated[Array, Shape("sets", "points", "spacecraft"), Label("bound", 4)]
    """Root mean square of its Cramér-Rao bounds, each flight's own."""
    bound_ratio: Annotated[Array, Shape(2, "sets", "points", "spacecraft")]
    """Rms error over bound, and the standard error of this ratio."""
    nees: Annotated[Array, Shape("sets", "points"), Label("mean NEES", 4)]
    """Mean normalised estimation error squared at the end."""
    nees_low: Annotated[Array, Shape("sets", "points")]
    """Lower limit of the 99.9 % band of this mean for a consistent filter."""
    nees_high: Annotated[Array, Shape("sets", "points")]
    """Upper limit of this band."""
    paper_position_m: Annotated[Array, Shape("sets", "spacecraft")]
    """Published position error of one flight."""
    paper_velocity_m_s: Annotated[Array, Shape("sets", "spacecraft")]
    """Published velocity error of one flight."""
    ratio: Annotated[Array, Shape(3, "neighbours", "points")]
    """Rms position error of all spacecraft with a set over that with the set before: lower limit,
    value, upper limit. The limits are NaN where a flight was lost: statistics over survivors prove
    nothing. There are no neighbours unless they are asked for."""
    lightest: str
    """Lightest set that meets the requirement at every point without a lost flight, with its mass;
    ``""`` without a requirement."""
    time_s: Annotated[Array, Shape("sets", "times")]
    """Times of the measurements of the single stages."""
    error_m: Annotated[Array, Shape("sets", "spacecraft", "times")]
    """Position error of the first flight of each stage."""
    sigma_m: Annotated[Array, Shape("sets", "spacecraft", "times")]
    """Standard deviation of this error by its filter."""
    mean_nees: Annotated[Array, Shape("sets", "times")]
    """Mean NEES over the flights of the stage that were not lost."""
    flight_rms_m: Annotated[Array, Shape("sets", "spacecraft"), Label("rms error at the end", 4)]
    """Root mean square of their position errors at the end."""
    flight_states: Annotated[Array, Shape("sets")]
    """Number of states: degrees of freedom of the NEES."""
    flight_runs: Annotated[Array, Shape("sets")]
    """Number of flights of the stage."""
    flight_lost: Annotated[Array, Shape("sets")]
    """Number of these that were lost."""
