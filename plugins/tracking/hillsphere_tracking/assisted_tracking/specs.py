"""Spec of the stage ``assisted_tracking``."""

from __future__ import annotations

from math import pi, radians
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec import (
    DataPath,
    Ref,
    ResultNames,
    Spec,
    StageSpec,
    data_path,
    option,
    quantity,
    reference,
    rule,
)
from hillsphere_tracking.satellite_specs import SatelliteSpec

__all__ = ["AssistedTrackingSpec", "NominalErrorSpec", "SearchSpec", "TrackedPassSpec"]

_DEGREE = radians(1.0)


class TrackedPassSpec(Spec):
    """One pass, with the times of its losses of signal."""

    examples = (
        {"name": "ALC2", "sensor": "antenna", "revolution": 2, "outages_min": [1, 3.5]},
        {
            "name": "ALC7",
            "sensor": "antenna",
            "revolution": 7,
            "elevation_max_deg": 36.8,
            "outages_min": [5],
        },
    )

    name: str = option(
        "name of the pass, part of the names of the metrics",
        pattern=r"^[A-Za-z][A-Za-z0-9_-]*$",
        max_length=30,
    )
    sensor: Ref = reference("sensor", "the station's antenna")
    revolution: int = option(
        "revolution in which the pass culminates; the first lasts from the epoch of the elements "
        "to the first ascending node",
        ge=1,
    )
    elevation_max_rad: float | None = quantity(
        "angle",
        "requested highest elevation of the pass: the Earth is turned by the least angle that "
        "gives it; default: the Earth is not turned",
        default=None, gt=0, le=pi / 2,
    )  # fmt: skip
    turn: Literal["least", "east", "west"] = option(
        "direction in which the Earth is turned for elevation_max: the least angle in either "
        "direction, or the least one to the east or west",
        default="least",
    )
    outages_s: tuple[float, ...] = quantity(
        "time",
        "times of the losses of signal after the acquisition; each is evaluated separately and "
        "lasts until the set",
        min_length=1, max_length=20, gt=0,
    )  # fmt: skip


class NominalErrorSpec(Spec):
    """Errors of the nominal orbit at the acquisition of the satellite."""

    examples = (
        {"position_km": 3, "velocity_m_s": 3},
        {"semi_major_axis_sigma_km": 5, "node_sigma_deg": 0.5, "mean_anomaly_sigma_deg": 2},
    )

    position_m: float = quantity(
        "length", "error of the position along each inertial axis", default=0.0, ge=0
    )
    velocity_m_s: float = quantity(
        "speed", "error of the velocity along each inertial axis", default=0.0, ge=0
    )
    distribution: Literal["signs", "normal"] = option(
        "'signs': this size with a random sign on each axis; 'normal': standard deviations",
        default="signs",
    )
    along_track_age_s: float = quantity(
        "time",
        "along-track error as a time (early or late at random), such as from old elements",
        default=0.0, ge=0,
    )  # fmt: skip
    semi_major_axis_sigma_m: float = quantity(
        "length", "standard deviation of the mean semi-major axis", default=0.0, ge=0
    )
    node_sigma_rad: float = quantity(
        "angle", "standard deviation of the mean node", default=0.0, ge=0
    )
    mean_anomaly_sigma_rad: float = quantity(
        "angle", "standard deviation of the mean anomaly", default=0.0, ge=0
    )


class SearchSpec(Spec):
    """Spiral search about the prediction; begins one dwell time after the signal returns."""

    examples = ({"signal_back_s": 60, "speed_deg_s": 2, "dwell_s": 0.5},)

    signal_back_s: float = quantity(
        "time", "time from the loss to the return of the signal, at which the search begins",
        default=60.0, gt=0,
    )  # fmt: skip
    speed_rad_s: float = quantity(
        "angular_rate", "largest speed of the search on the sky", default=2.0 * _DEGREE, gt=0
    )
    dwell_s: float = quantity(
        "time", "time for which the satellite must be in the beam to be found", default=0.5, ge=0
    )
    sigmas: float = option(
        "size of the searched ellipse in standard deviations", default=3.0, gt=0, le=10
    )


class AssistedTrackingSpec(StageSpec):
    """Passes in which trackers use measurements of an antenna, and predict after a loss of signal.

    A case is one draw of all errors, common to all trackers. Its metrics are named
    ``PASS.OUTAGE.TRACKER.MEASURE``, such as ``ALC2.60s.average.error_max``.
    """

    results = ResultNames(
        metrics=(
            "tracking_*_error_max",
            "tracking_*_encoder_error_max",
        ),
        tables={
            "tracked_passes": (),
            "antenna_errors": (),
            "tracking": (),
        },
    )
    produces = "hillsphere_tracking.assisted_tracking.products:AssistedTracking"
    examples = (
        {
            "satellite": SatelliteSpec.examples[0],
            "passes": [TrackedPassSpec.examples[0]],
            "trackers": ["average"],
            "nominal_error": NominalErrorSpec.examples[0],
            "osculating_as_mean": True,
        },
        {
            "satellite": SatelliteSpec.examples[0],
            "plant": "earth_orbit",
            "body": "planet",
            "passes": [TrackedPassSpec.examples[1]],
            "trackers": ["least_squares"],
            "nominal_error": NominalErrorSpec.examples[1],
            "search": SearchSpec.examples[0],
        },
    )

    satellite: SatelliteSpec = option("tracked satellite")
    plant: Ref | None = reference(
        "plant",
        "plant of the true motion, from the elements; default: the theory of the elements",
        default=None,
    )
    body: Ref | None = reference(
        "body",
        "the Earth, a body of type planet; default: WGS 84 and the tables of the IERS",
        default=None,
    )
    passes: tuple[TrackedPassSpec, ...] = option("tracked passes", min_length=1, max_length=60)
    trackers: tuple[Ref, ...] = reference("tracker", "trackers that are compared")
    nominal_error: NominalErrorSpec = option(
        "error of the nominal orbit", default=NominalErrorSpec()
    )
    osculating_as_mean: bool = option(
        "whether trackers without short-period terms use osculating elements as mean elements",
        default=False,
    )
    believed_stations: bool = option(
        "whether trackers use the believed locations of the stations instead of the true ones",
        default=True,
    )
    period_s: float = quantity(
        "time", "interval between measurements and between predictions", default=1.0, gt=0, le=60
    )
    lock_angle_rad: float = quantity(
        "angle",
        "largest pointing error at which the signal is received",
        default=1.0 * _DEGREE,
        gt=0,
        le=0.5,
    )
    search: SearchSpec | None = option("search after a loss; default: none", default=None)
    reference: DataPath | None = data_path(
        "published values of the passes and of the antennas' errors, shown beside ours",
        default=None,
    )
    label: str = option(
        "suffix of the names of tables and figures, which distinguishes two such stages",
        default="",
        pattern=r"^([a-z0-9][a-z0-9_]*)?$",
        max_length=40,
    )

    @model_validator(mode="after")
    def _names(self) -> Self:
        for key, names in (
            ("passes", [p.name for p in self.passes]),
            ("trackers", [ref.name for ref in self.trackers if ref.target is None]),
        ):
            if len(set(names)) < len(names):
                raise rule(key, "a name occurs twice")
        if not self.trackers:
            raise rule("trackers", "name at least one")
        for p in self.passes:
            if list(p.outages_s) != sorted(set(p.outages_s)):
                raise rule("passes", f"{p.name}: the outages must rise")
        return self
