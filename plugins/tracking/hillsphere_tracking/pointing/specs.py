"""Specs of antenna mounts and of the stage ``pointing``."""

from __future__ import annotations

from math import degrees, pi, radians
from typing import Literal, Self

from pydantic import model_validator

from hillsphere.spec import Ref, ResultNames, Spec, StageSpec, need, option, quantity, rule

__all__ = ["AxisSpec", "MountSpec", "PointingNeeds", "PointingSpec"]

_DEGREE = radians(1.0)
_ROUNDING = 1e-9
"""Angle (rad) that limits given in degrees may miss ±90° and 180° by: rounding of the conversion,
and no angle that an axis could resolve."""


class AxisSpec(Spec):
    """Stops, largest rate and largest acceleration of an axis of a mount."""

    examples = (
        {"lower_deg": -270, "upper_deg": 270, "rate_deg_s": 5, "acceleration_deg_s2": 5},
        {"lower_deg": 0, "upper_deg": 90, "rate_deg_s": 5, "acceleration_deg_s2": 5},
    )

    lower_rad: float = quantity("angle", "lower stop", ge=-6.0 * pi, le=6.0 * pi)
    upper_rad: float = quantity(
        "angle",
        "upper stop; more than a turn above the lower one, the same direction has two angles",
        ge=-6.0 * pi,
        le=6.0 * pi,
    )
    rate_rad_s: float = quantity("angular_rate", "largest rate, either way", gt=0)
    acceleration_rad_s2: float = quantity(
        "angular_acceleration", "largest acceleration, either way", gt=0
    )

    @model_validator(mode="after")
    def _lower_first(self) -> Self:
        if not self.lower_rad < self.upper_rad:
            raise rule(
                "lower_rad",
                f"the lower stop must be below the upper one, got {degrees(self.lower_rad):g}° and "
                f"{degrees(self.upper_rad):g}°",
            )
        return self


class MountSpec(Spec):
    """A two-axis antenna mount; the primary axis, fixed to the ground, carries the secondary."""

    examples = (
        {"name": "dish", "primary": AxisSpec.examples[0], "secondary": AxisSpec.examples[1]},
        {
            "name": "yagi",
            "kind": "x_y",
            "primary": {**AxisSpec.examples[1], "lower_deg": -90},
            "secondary": {**AxisSpec.examples[1], "lower_deg": -90},
            "axis_azimuth_deg": 90,
        },
    )

    name: str = option("name of the mount in tables and figures", pattern=r"^[a-z][a-z0-9_]{0,29}$")
    kind: Literal["azimuth_elevation", "x_y"] = option(
        "azimuth over an upright axis and elevation, or X about a level axis and Y",
        default="azimuth_elevation",
    )
    primary: AxisSpec = option("azimuth from north eastwards; or X, 0 at the zenith")
    secondary: AxisSpec = option(
        "elevation, or Y, 0 at the zenith; beyond 90° the beam goes over the top"
    )
    tilt_rad: float = quantity(
        "angle",
        "tilt of the azimuth axis, which moves its keyhole away from the zenith",
        default=0.0,
        ge=0,
        lt=pi / 2,
    )
    tilt_towards_rad: float = quantity("angle", "azimuth of the tilt", default=0.0)
    axis_azimuth_rad: float = quantity(
        "angle", "azimuth of the X axis; the keyholes are at its ends", default=0.0
    )

    @model_validator(mode="after")
    def _of_its_kind(self) -> Self:
        foreign = (
            ("axis_azimuth_rad",)
            if self.kind == "azimuth_elevation"
            else ("tilt_rad", "tilt_towards_rad")
        )
        for key in foreign:
            if key in self.model_fields_set:
                raise rule(key, f"does not belong to a mount of kind {self.kind!r}; leave it out")
        low, high = self.secondary.lower_rad, self.secondary.upper_rad
        if low < -0.5 * pi - _ROUNDING or high > pi + _ROUNDING:
            axis = "elevation" if self.kind == "azimuth_elevation" else "Y"
            raise rule(
                "secondary",
                f"the secondary axis ({axis}): expected stops from -90° to 180°, got "
                f"{degrees(low):g}° and {degrees(high):g}°",
            )
        return self


class PointingNeeds(Spec):
    """Products of earlier stages that ``pointing`` takes."""

    passes: Ref = need("hillsphere_tracking.passes.products:PassList", "the passes to be followed")


class PointingSpec(StageSpec):
    """Antenna mounts that follow passes, with a plan of each pass and without."""

    results = ResultNames(
        metrics=(
            "pointing_passes",
            "*_error_max",
            "*_outside_max",
            "*_followed",
            "*_error_max_naive",
            "*_outside_max_naive",
            "*_followed_naive",
        ),
        tables={
            "pointing_mounts": (),
            "pointing_errors": (),
            "pointing_axes": (),
            "pointing_predictions": (),
        },
    )
    produces = "hillsphere_tracking.pointing.products:Pointing"
    examples = (
        {"needs": {"passes": "passes"}, "mounts": [MountSpec.examples[0]]},
        {
            "needs": {"passes": "passes"},
            "mounts": list(MountSpec.examples),
            "culmination_min_deg": 10,
            "lock_angle_deg": 0.5,
        },
    )

    needs: PointingNeeds = option("products of earlier stages")
    mounts: tuple[MountSpec, ...] = option(
        "mounts, all of which follow every pass", min_length=1, max_length=6
    )
    stations: tuple[str, ...] = option(
        "stations whose passes are followed; default: all", default=(), max_length=100
    )
    revolutions: tuple[int, ...] = option(
        "revolutions whose passes are followed; default: all", default=(), max_length=400, ge=1
    )
    culmination_min_rad: float = quantity(
        "angle", "least culmination of the passes that are followed", default=0.0, ge=0, lt=pi / 2
    )
    lock_angle_rad: float = quantity(
        "angle",
        "largest pointing error at which the receiver keeps lock: the half-width of the beam",
        default=_DEGREE,
        gt=0,
        lt=pi / 2,
    )
    prediction_period_s: float = quantity(
        "time", "interval between predictions for the antenna", default=1.0, gt=0, le=60
    )
    command_period_s: float = quantity(
        "time", "interval between commands to the axes", default=0.1, ge=0.01, le=10
    )

    @model_validator(mode="after")
    def _rules(self) -> Self:
        if self.command_period_s > self.prediction_period_s:
            raise rule(
                "command_period_s",
                "must not be longer than the period of the predictions, "
                f"{self.prediction_period_s:g} s",
            )
        names = [mount.name for mount in self.mounts]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise rule("mounts", f"the name {twice[0]!r} is listed twice; give each mount its own")
        return self
