"""Product of the stage ``navigation``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.products.fields import Label, Shape

__all__ = ["NavigationFlight"]


@dataclass(frozen=True)
class NavigationFlight:
    """64 flights with different random numbers, measurement by measurement.

    Quantities of a flight are NaN from the time at which its filter was lost. All units are SI.
    """

    frame: str
    """Frame of the states."""
    spacecraft: Annotated[tuple[str, ...], Shape("spacecraft"), Label("spacecraft")]
    """Names of the spacecraft."""
    states: Annotated[tuple[str, ...], Shape("states")]
    """Names of the states."""
    time_s: Annotated[Array, Shape("times")]
    """Times of the measurements since the start."""
    x: Annotated[Array, Shape("states", "times")]
    """True states of the first flight."""
    estimate: Annotated[Array, Shape("states", "times")]
    """States as the filter of the first flight estimates them."""
    goal: Annotated[Array, Shape("states", "times")]
    """States of the reference."""
    sigma: Annotated[Array, Shape("states", "times")]
    """Standard deviations by the filter of the first flight."""
    position_error_m: Annotated[Array, Shape("spacecraft", "times", "flights")]
    """Length of the error of the estimated position."""
    velocity_error_m_s: Annotated[Array, Shape("spacecraft", "times", "flights")]
    """Length of the error of the estimated velocity."""
    position_sigma_m: Annotated[Array, Shape("spacecraft", "times", "flights")]
    """Root of the summed variances of the three axes, by the filter."""
    control_error_m: Annotated[Array, Shape("spacecraft", "times", "flights")]
    """Distance of the true position from the reference."""
    nees: Annotated[Array, Shape("times", "flights")]
    """Normalised estimation error squared (NEES) of all states."""
    nis: Annotated[Array, Shape("times", "flights")]
    """Normalised innovation squared (NIS) of the rows that were used."""
    used: Annotated[Array, Shape("times", "flights")]
    """Number of measured rows that were used: the degrees of freedom of the NIS."""
    sent: Annotated[Array, Shape("times", "flights")]
    """Number of rows that the sensors sent; a gate may reject some of them."""
    bounds_m: Annotated[Array, Shape("spacecraft", "times", "flights")]
    """Posterior Cramér-Rao bound of the position error, along the planned path of each flight."""
    sensors: Annotated[tuple[str, ...], Shape("sensors"), Label("sensor")]
    """Names of the sensors."""
    seen: Annotated[Array, Shape("sensors", "flights")]
    """Share of the times at which a sensor measured something."""
    matched: bool
    """Whether the filter's model of plant and sensors is the true one."""
    lost: int
    """Number of flights whose filter was lost before the end."""
    endings: Annotated[tuple[str, ...], Shape("flights")]
    """How each flight ended, and why: ``"completed"``, ``"diverged (errors)"``."""
    metrics: Annotated[tuple[str, ...], Shape("metrics")]
    """Names of the metrics."""
    units: Annotated[tuple[str, ...], Shape("metrics")]
    """Their units."""
    values: Annotated[Array, Shape("metrics", "flights")]
    """Their values."""

    @property
    def bound_m(self) -> Array:
        """Bounds (S, K) of the rms position errors."""
        return np.asarray(np.sqrt(np.mean(self.bounds_m**2, axis=2)))
