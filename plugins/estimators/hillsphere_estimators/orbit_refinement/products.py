"""Product of the stage ``orbit_refinement``: errors of an asteroid's orbit over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array
from hillsphere.products.fields import Label, Shape

__all__ = ["Knowledge", "OrbitRefinement"]


@dataclass(frozen=True)
class Knowledge:
    """Errors of the asteroid's estimated state over time, and their standard deviations.

    A geometry is one relative position of Earth and asteroid; each has the same number of random
    cases.
    """

    t_s: Annotated[Array, Shape("times")]
    """Times since the first observation."""
    position_m: Annotated[Array, Shape("times", "geometries", "cases")]
    """Length of the position error."""
    velocity_m_s: Annotated[Array, Shape("times", "geometries", "cases")]
    """Length of the velocity error."""
    position_sigma_m: Annotated[Array, Shape("times", "geometries", "cases")]
    """Root of the trace of the covariance of the position."""
    velocity_sigma_m_s: Annotated[Array, Shape("times", "geometries", "cases")]
    """Root of the trace of the covariance of the velocity."""
    nees: Annotated[Array, Shape("times", "geometries", "cases")]
    """Normalised estimation error squared of the asteroid's six states."""
    rows: Annotated[Array, Shape("times", "geometries")]
    """Mean number of values measured at that time."""


@dataclass(frozen=True)
class OrbitRefinement:
    """The orbit of an asteroid from telescopes, and with spacecraft near it.

    An arm is one set of sensors, tried on the same flights and the same noise as the others.
    """

    geometries: Annotated[tuple[str, ...], Shape("geometries"), Label("geometry")]
    """Names of the geometries."""
    arms: Annotated[tuple[str, ...], Shape("arms"), Label("sensors")]
    """Names of the sets of sensors."""
    earth_distance_m: Annotated[
        Array, Shape("geometries"), Label("least distance of the Earth", 3, "au")
    ]
    """Least distance of Earth and asteroid during the optical part."""
    optical: Knowledge
    """The optical part, by telescopes on the Earth."""
    settled: Annotated[Array, Shape("geometries", "cases")]
    """1 where the least squares of the optical part converged, else 0."""
    tracked: Annotated[tuple[Knowledge, ...], Shape("arms")]
    """The tracking part, one for each arm; the first time is before any measurement."""
    joint_nees: Annotated[Array, Shape("arms", "geometries", "cases")]
    """NEES of all states, asteroid and spacecraft, at the end of tracking."""
    states: int
    """Number of these states."""
    tracked_settled: Annotated[Array, Shape("arms", "geometries", "cases")]
    """1 where the tracking part converged, else 0."""
    craft_velocity_sigma_m_s: Annotated[Array, Shape("arms", "times", "geometries", "cases")]
    """Root of the trace of the covariance of the velocity of the spacecraft that is known worst;
    zero without spacecraft."""
