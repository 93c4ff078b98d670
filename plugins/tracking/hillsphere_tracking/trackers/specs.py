"""Specs of the trackers, tables ``[tracker.NAME]`` of a mission."""

from __future__ import annotations

from math import radians
from typing import Literal

from hillsphere.base.ranges import PLANET_GM_M3_S2, PLANET_RADIUS_M
from hillsphere.spec import Spec, option, quantity

__all__ = ["AverageSpec", "LeastSquaresSpec", "TableSpec", "TrackerSpec"]

_DEGREE = radians(1.0)


class TrackerSpec(Spec):
    """Common parameters of all trackers: gravity field, and accuracy of the nominal elements."""

    gm_m3_s2: float = quantity(
        "gravitational_parameter",
        "gravitational parameter of the planet",
        default=398600.4418e9,
        **PLANET_GM_M3_S2,
    )
    equatorial_radius_m: float = quantity(
        "length",
        "equatorial radius to which J2 and J4 refer",
        default=6378137.0,
        **PLANET_RADIUS_M,
    )
    j2: float = option("zonal coefficient J2 = −C20, not normalised", default=1.08262668e-3)
    j4: float = option("zonal coefficient J4 = −C40, not normalised", default=-1.61962159e-6)
    node_sigma_rad: float = quantity(
        "angle", "standard deviation of the nominal node", default=0.5 * _DEGREE, gt=0
    )
    mean_anomaly_sigma_rad: float = quantity(
        "angle",
        "standard deviation of the nominal mean anomaly (along-track error; 1° is 16 s for a "
        "period of 98 minutes)",
        default=2.0 * _DEGREE,
        gt=0,
    )


class TableSpec(TrackerSpec):
    """The nominal orbit as a stored table, never updated."""

    examples = ({}, {"short_period": False, "node_sigma_deg": 0.1, "mean_anomaly_sigma_deg": 0.5})

    short_period: bool = option(
        "whether the nominal elements are mean ones to which the short-period terms of J2 are "
        "added for each prediction",
        default=True,
    )


class AverageSpec(TrackerSpec):
    """Running means of the node and the anomaly that each pair of angles yields."""

    examples = ({}, {"tolerance": 1e-9})

    tolerance: float = option(
        "relative change of the orbit's radius at which the iteration of one measurement ends",
        default=1e-12,
        gt=0,
        le=1e-3,
    )


class LeastSquaresSpec(TrackerSpec):
    """Recursive least squares on some mean elements, angle biases and a time bias."""

    examples = (
        {},
        {
            "parameters": "node_anomaly",
            "angle_biases": False,
            "horizon_bias": False,
            "short_period": False,
        },
        {"parameters": "all", "time_bias": True, "gate": 4.0, "drift_m": 50.0},
    )

    parameters: Literal["node_anomaly", "size_node_anomaly", "all"] = option(
        "which mean elements are estimated: Ω and M; a, Ω and M; or all six",
        default="size_node_anomaly",
    )
    angle_biases: bool = option(
        "whether constant biases of azimuth and elevation are estimated", default=True
    )
    horizon_bias: bool = option(
        "whether an elevation bias proportional to the cotangent of the elevation is estimated, as "
        "caused by residual refraction or a sagging dish",
        default=True,
    )
    time_bias: bool = option(
        "whether a constant offset of the measurements' times is estimated; only the rotation of "
        "the Earth separates it from an along-track error",
        default=False,
    )
    short_period: bool = option(
        "whether the short-period terms of J2 are part of measurement and prediction", default=True
    )
    gate: float = option(
        "number of standard deviations beyond which a measurement is an outlier, whose weight "
        "decreases with the square of its distance",
        default=5.0,
        gt=0,
    )
    drift_m: float = quantity(
        "length",
        "standard deviation of the random walk of each estimated element in one hour, as a "
        "displacement of the satellite",
        default=30.0,
        ge=0,
    )
    relinearisations: int = option(
        "largest number of relinearisations of a measurement with a large correction",
        default=4,
        ge=0,
        le=20,
    )
    semi_major_axis_sigma_m: float = quantity(
        "length", "standard deviation of the nominal semi-major axis", default=5e3, gt=0
    )
    eccentricity_sigma: float = option(
        "standard deviation of both components of the nominal eccentricity vector",
        default=1e-3,
        gt=0,
    )
    inclination_sigma_rad: float = quantity(
        "angle", "standard deviation of the nominal inclination", default=0.05 * _DEGREE, gt=0
    )
    bias_sigma_rad: float = quantity(
        "angle", "standard deviation of each angle's bias", default=0.2 * _DEGREE, gt=0
    )
    horizon_bias_sigma_rad: float = quantity(
        "angle",
        "standard deviation of the horizon bias at 45° elevation; refraction is 0.016° there",
        default=0.01 * _DEGREE,
        gt=0,
    )
    time_bias_sigma_s: float = quantity(
        "time", "standard deviation of the time bias", default=0.1, gt=0
    )
