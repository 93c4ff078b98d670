"""Product of the stage ``assisted_tracking``: one case, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array, Integers
from hillsphere.products.fields import Label, Shape

__all__ = ["AssistedTracking"]


@dataclass(frozen=True)
class AssistedTracking:
    """One case of P passes with L outages in total, and T trackers.

    Times count from the epoch of the elements; times of a pass count from its acquisition. Errors
    over time are, before the loss, errors of the estimate from the measurements so far, and after
    it errors of the prediction.
    """

    satellite: str
    """Name of the satellite."""
    start: str
    """Epoch of the elements, UTC."""
    trackers: Annotated[tuple[str, ...], Shape("trackers"), Label("tracker")]
    """Names of the trackers."""
    passes: Annotated[tuple[str, ...], Shape("passes"), Label("pass")]
    """Names of the passes."""
    stations: Annotated[tuple[str, ...], Shape("passes"), Label("station")]
    """Station of each pass."""
    revolution: Annotated[Integers, Shape("passes"), Label("revolution")]
    """Revolution in which each pass culminates."""
    directions: Annotated[tuple[str, ...], Shape("passes"), Label("direction")]
    """``"ascending"`` or ``"descending"``, at the culmination."""
    plain_acquisition_s: Annotated[Array, Shape("passes")]
    """Rise above the mask, of the orbit of the elements; NaN if the satellite does not rise in that
    revolution."""
    plain_duration_s: Annotated[
        Array, Shape("passes"), Label("duration, as the elements have it", 5)
    ]
    """Duration, of the orbit of the elements; NaN likewise."""
    plain_elevation_max_rad: Annotated[
        Array, Shape("passes"), Label("highest elevation, as the elements have it", 4, "deg")
    ]
    """Highest elevation, of the orbit of the elements; NaN likewise."""
    earth_shift_rad: Annotated[Array, Shape("passes"), Label("Earth turned eastwards by", 5, "deg")]
    """Angle by which the Earth is turned eastwards to reach the requested elevation."""
    acquisition_s: Annotated[Array, Shape("passes"), Label("acquisition, as tracked", 7)]
    """First measurement above the mask, of the tracked pass."""
    duration_s: Annotated[Array, Shape("passes"), Label("duration, as tracked", 5)]
    """Time from rise to set, of the tracked pass."""
    elevation_max_rad: Annotated[
        Array, Shape("passes"), Label("highest elevation, as tracked", 4, "deg")
    ]
    """Highest elevation, of the tracked pass."""
    station_error_m: Annotated[Array, Shape("passes"), Label("station told off by", 3, "km")]
    """Error of the station's location that the trackers assume."""
    t_s: Annotated[Array, Shape("times", "passes")]
    """Times since the acquisition of each pass; NaN after its end."""
    true_rad: Annotated[Array, Shape(2, "times", "passes")]
    """True azimuth and elevation."""
    measured_rad: Annotated[Array, Shape(2, "times", "passes")]
    """Measured azimuth and elevation."""
    bias_rad: Annotated[Array, Shape(2, "times", "passes")]
    """Systematic part of the antenna's errors."""
    sigma_rad: Annotated[Array, Shape(2, "times", "passes")]
    """Standard deviation of the antenna's noise."""
    outage_pass: Annotated[Integers, Shape("outages")]
    """Pass of each outage."""
    outage_s: Annotated[Array, Shape("outages"), Label("signal lost after", 5)]
    """Beginning of each outage after the acquisition."""
    outage_names: Annotated[tuple[str, ...], Shape("outages")]
    """Names of the outages in the metrics."""
    error_rad: Annotated[Array, Shape("trackers", "outages", "times")]
    """Error of the measure ``error_max`` over time."""
    sky_error_rad: Annotated[Array, Shape("trackers", "outages", "times")]
    """Error of the measure ``sky_error_max`` over time."""
    encoder_error_rad: Annotated[Array, Shape("trackers", "outages", "times")]
    """Error of the measure ``encoder_error_max`` over time."""
    spread_rad: Annotated[Array, Shape("trackers", "outages", "times")]
    """Larger standard deviation on the sky, from the tracker's covariance."""
    metrics: Annotated[tuple[str, ...], Shape("metrics")]
    """Names of the metrics, see `hillsphere_tracking.assisted_tracking.measures`."""
    units: Annotated[tuple[str, ...], Shape("metrics")]
    """Units of the metrics."""
    values: Annotated[Array, Shape("metrics")]
    """Values of the metrics."""
    lock_angle_rad: float
    """Largest error at which the signal is received."""
    warnings: tuple[str, ...]
    """Sentences for the verdict."""
