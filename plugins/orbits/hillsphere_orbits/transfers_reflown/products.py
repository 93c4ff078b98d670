"""Product of the stage ``transfers_reflown``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from hillsphere.interfaces import Array, Integers
from hillsphere.products import FlightSet
from hillsphere.products.fields import Label, Shape

__all__ = ["TransfersReflown"]


@dataclass(frozen=True)
class TransfersReflown(FlightSet):
    """Plans of transfers on several plants, with their patch points and coasts.

    `flights` are the coasts of the last plant, in its own frame and states, by their nodes; of the
    plans that can be flown there.
    """

    rungs: Annotated[tuple[str, ...], Shape("rungs"), Label("rung")]
    """Names of the plants."""
    rung_plants: Annotated[tuple[str, ...], Shape("rungs"), Label("equations")]
    """What they are."""
    plans: Annotated[tuple[str, ...], Shape("plans"), Label("plan")]
    """Names of the plans."""
    tof_s: Annotated[Array, Shape("plans"), Label("time of flight", 5, "h")]
    """Time from the beginning of the first coast to the end of the last."""
    stay_s: Annotated[Array, Shape("plans"), Label("of it on orbits between", 5, "h")]
    """Part of it that is spent on orbits between coasts."""
    plan_dv_m_s: Annotated[Array, Shape("plans"), Label("Δv as planned", 6)]
    """Sum of the impulses as planned."""
    dv_m_s: Annotated[Array, Shape("plans", "rungs"), Label("Δv", 6)]
    """Sum of the impulses on each plant; NaN where the plan cannot be flown."""
    displacement_m: Annotated[
        Array, Shape("plans", "rungs"), Label("patch points moved by", 4, "km")
    ]
    """Largest distance of a patch point from its place in the plan."""
    closure_m: Annotated[Array, Shape("plans", "rungs"), Label("closure", 2)]
    """Largest miss of the end of a coast when it is flown from its first state alone."""
    closure_m_s: Annotated[Array, Shape("plans", "rungs"), Label("closure, velocity", 2)]
    """The same of the velocity."""
    min_altitude_m: Annotated[Array, Shape("plans", "rungs"), Label("least height", 5, "km")]
    """Least height of the coasts above the surface, that of the first plant where the plant itself
    has none; NaN if that has none either, zero where it is met."""
    gap: Annotated[Array, Shape("plans", "rungs"), Label("largest gap", 2)]
    """Largest gap at a node, natural units."""
    iterations: Annotated[Integers, Shape("plans", "rungs"), Label("steps")]
    """Steps of multiple shooting, summed over the coasts."""
    status: tuple[str, ...]
    """``"reflown"``, or why not; plans run fastest."""
    patch_plan: Annotated[Integers, Shape("patches")]
    """Plan of each patch point."""
    patches: Annotated[tuple[str, ...], Shape("patches"), Label("from, to")]
    """What meets there."""
    patch_held: Annotated[tuple[str, ...], Shape("patches"), Label("stays on")]
    """Orbit on which the patch point stays, or ``"place of the plan"``."""
    patch_plan_dv_m_s: Annotated[Array, Shape("patches"), Label("Δv as planned", 6)]
    """Impulse as planned."""
    patch_dv_m_s: Annotated[Array, Shape("patches", "rungs"), Label("Δv", 6)]
    """Impulse on each plant."""
    coast_plan: Annotated[Integers, Shape("coasts")]
    """Plan of each coast."""
    coast_m: Annotated[Array, Shape(3, "points", "coasts", "rungs")]
    """Positions along the coasts on each plant in the frame hill:BODY; NaN beyond the end, and from
    the first coast on that was not found."""
    start_true_anomaly_rad: float
    """True anomaly at the beginning of each first coast."""
