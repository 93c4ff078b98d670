"""Specs of guidance: the keys of ``[guidance.NAME]`` in a mission."""

from __future__ import annotations

from math import pi
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec import Spec, option, quantity, rule

__all__ = ["ConvexSpec", "MinimumEnergySpec", "MinimumFuelSpec"]


class MinimumEnergySpec(Spec):
    """Path of the least ∫|a|², a quintic B-spline in the full field of the plant."""

    examples = ({}, {"control_points": 16})

    control_points: int = option(
        "control points of each axis, the two at either end fixed by the states there",
        default=12,
        ge=7,
        le=200,
    )


class _HeldSpec(Spec):
    """What flights under held commands share."""

    hold_s: float = quantity("time", "how long each command is held", default=60.0, gt=0)
    maximum_m_s2: float | None = quantity(
        "acceleration", "largest command; left out: unbounded", default=None, gt=0
    )


class MinimumFuelSpec(_HeldSpec):
    """Flight of the least ∫|a| under held commands, by successive convex programming."""

    examples = ({"hold_s": 300}, {"hold_s": 300, "maximum_mm_s2": 20})


class ConvexSpec(_HeldSpec):
    """Flight under held commands that meets requirements, by successive convex programming."""

    examples = (
        {"hold_s": 300, "maximum_mm_s2": 20},
        {"hold_s": 300, "objective": "energy", "minimum_mm_s2": 0.1, "maximum_mm_s2": 20},
    )

    objective: Literal["fuel", "energy"] = option(
        "what is least: ∫|a| ('fuel') or ∫|a|² ('energy')", default="fuel"
    )
    minimum_m_s2: float | None = quantity(
        "acceleration", "smallest command, for engines that cannot be off", default=None, gt=0
    )
    glide_slope_rad: float | None = quantity(
        "angle",
        "least elevation over the horizon of the landing site",
        default=None,
        gt=0,
        lt=pi / 2,
    )
    glide_slope_time_s: float | None = quantity(
        "time",
        "for how long before the end the glide slope is kept; left out: from the start on",
        default=None,
        gt=0,
    )
    touchdown_tilt_rad: float | None = quantity(
        "angle",
        "largest angle between the last command and the outward normal of the site",
        default=None,
        gt=0,
        lt=pi / 2,
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        least, most = self.minimum_m_s2, self.maximum_m_s2
        if least is not None and most is not None and least > most:
            text = "must not be above the maximum"
            raise rule("minimum_m_s2", text)
        if self.glide_slope_time_s is not None and self.glide_slope_rad is None:
            text = "it belongs to glide_slope_deg (or _rad)"
            raise rule("glide_slope_time_s", text)
        return self
