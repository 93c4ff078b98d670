"""Product of the stage ``orbit_fit``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array
from hillsphere.products.fields import Shape

__all__ = ["FilterRun", "FittedRows", "OrbitFit"]


@dataclass(frozen=True)
class FittedRows:
    """Residuals of each measured row, and of each value."""

    labels: Annotated[tuple[str, ...], Shape("rows")]
    """Path and name of the rows."""
    units: Annotated[tuple[str, ...], Shape("rows")]
    """Units of their values."""
    count: Annotated[Array, Shape("rows")]
    """Number of values."""
    edited: Annotated[Array, Shape("rows")]
    """Number of those left out by editing."""
    mean: Annotated[Array, Shape("rows")]
    """Mean residual of all values, before editing, in the stated standard deviations."""
    rms: Annotated[Array, Shape("rows")]
    """Root mean square of the used residuals over what it should be; NaN without values."""
    bias: Annotated[Array, Shape("rows")]
    """Constant error over its standard deviation; NaN where the states take it up."""
    correlation: Annotated[Array, Shape("rows")]
    """Of neighbours in time, in standard deviations; NaN for few values."""
    t_s: Annotated[Array, Shape("values")]
    """Times of all values, after the plant's epoch."""
    row: Annotated[Array, Shape("values")]
    """Number of the row."""
    residual: Annotated[Array, Shape("values")]
    """Measured less expected, SI."""
    normal: Annotated[Array, Shape("values")]
    """The same over the standard deviation that it should have."""
    used: Annotated[Array, Shape("values")]
    """1 where the fit has used the value, else 0."""


@dataclass(frozen=True)
class FilterRun:
    """A filter over the values that the fit has used; without a filter all is empty."""

    t_s: Annotated[Array, Shape("updates")]
    """Times of the updates."""
    position_off_m: Annotated[Array, Shape("updates")]
    """Distance of the filter's position from that of the fit."""
    position_sigma_m: Annotated[Array, Shape("updates")]
    """Root of the trace of the filter's covariance of the position."""
    answer: str
    """Verdict on the filter from its innovations; empty without a filter."""
    reason: str
    """Why."""
    distance: float
    """Filter's last state less that of the fit, in the filter's standard deviations; NaN without a
    filter."""


@dataclass(frozen=True)
class OrbitFit:
    """An orbit that fits recorded tracking data, with its covariance and a verdict."""

    spacecraft: str
    """Name."""
    states: Annotated[tuple[str, ...], Shape("states")]
    """Names of the six states of the motion, then of the constant errors."""
    epoch: str
    """Date of the fitted state, in the scale below."""
    time_scale: str
    """Of the dates."""
    zero: str
    """Date from which times count."""
    frame: str
    """Frame of the states."""
    mean: Annotated[Array, Shape("states")]
    """Fitted states, SI; considered errors are zero."""
    covariance: Annotated[Array, Shape("states", "states")]
    """Their covariance, SI."""
    start: Annotated[Array, Shape("states")]
    """First guess."""
    considered: Annotated[Array, Shape("states")]
    """1 for errors that are considered and not estimated, else 0."""
    bias_units: Annotated[tuple[str, ...], Shape("errors")]
    """Units of the constant errors."""
    answer: str
    """Verdict: "consistent", "inconsistent", "noise overstated" or "undecided"."""
    reasons: tuple[str, ...]
    """Why, the weightiest first."""
    hints: tuple[str, ...]
    """What would explain it, and which keys of a mission say so."""
    squares: float
    """Sum of the squared residuals a degree of freedom."""
    low: float
    """Lower limit of its band."""
    high: float
    """Upper limit of its band."""
    dof: int
    """Degrees of freedom."""
    rounds: int
    """Number of fits until the editing came to rest."""
    rows: FittedRows
    """Residuals."""
    left_out: tuple[str, ...]
    """Keywords of data that were not used before the fit."""
    left_out_why: tuple[str, ...]
    """Why."""
    left_out_count: Array
    """Their numbers of values."""
    notes: tuple[str, ...]
    """What a reader must know of the treatment of the data."""
    filter: FilterRun
    """The filter."""
    ephemeris_t_s: Annotated[Array, Shape("times")]
    """Times of the ephemeris, after the date `zero`."""
    ephemeris: Annotated[Array, Shape(6, "times")]
    """Inertial states about the plant's centre, m and m/s."""
    ephemeris_covariance: Annotated[Array, Shape(6, 6)]
    """Covariance at the first of these times, in the same axes."""
    ephemeris_frame: str
    """Inertial axes, as messages name them."""
    centre: str
    """Origin of these states."""
    object_id: str
    """Designator of the spacecraft."""
