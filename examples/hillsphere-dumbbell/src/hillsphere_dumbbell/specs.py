"""Parameters of the components, as a mission file writes them."""

from __future__ import annotations

from math import pi
from typing import ClassVar

from hillsphere.spec import Ref, Spec, StageSpec, option, quantity, reference

__all__ = ["DumbbellSpec", "LimbRangerSpec", "ZeroVelocitySpec"]


class DumbbellSpec(Spec):
    """Two spheres joined by a homogeneous rod along x, centre of mass at the origin."""

    examples = (
        {"gm_km3_s2": 7.0875e-4, "length_km": 12.0, "rod_fraction": 0.2, "first_share": 0.6},
        {"gm_m3_s2": 30.0, "length_m": 500.0},
    )

    gm_m3_s2: float = quantity(
        "gravitational_parameter", "gravitational parameter of the whole", gt=0
    )
    length_m: float = quantity(
        "length", "length of the rod: distance between the centres of the spheres", gt=0
    )
    rod_fraction: float = option("fraction of the mass in the rod", default=0.0, ge=0, le=1)
    first_share: float = option(
        "share of the first sphere (towards +x) in the mass of both", default=0.5, ge=0, le=1
    )


class LimbRangerSpec(Spec):
    """How large a round body looks in a thermal camera."""

    examples = ({"radius_m": 160.0, "sigma_rad": 5e-4}, {"radius_km": 5.0, "bias_rad": 1e-4})

    radius_m: float = quantity("length", "mean radius of the body", gt=0)
    spacecraft: int = option("on which spacecraft it flies: number of its six states", default=1,
                             ge=1)  # fmt: skip
    sigma_rad: float = quantity(
        "angle", "standard deviation of the angular radius's noise", default=5e-4, gt=0
    )
    bias_rad: float = quantity(
        "angle", "standard deviation of a bias, constant within a case", default=0.0, ge=0
    )
    resolution_rad: float = quantity(
        "angle", "least angular radius that it resolves", default=1e-4, gt=0
    )
    field_of_view_rad: float = quantity(
        "angle", "full field of view, into which the body must fit", default=pi, gt=0, le=pi
    )


class ZeroVelocitySpec(StageSpec):
    """Where a particle at rest can go, and where it can stay, in the plane z = 0."""

    produces: ClassVar[str] = "hillsphere_dumbbell.zero_velocity:ZeroVelocity"
    examples = ({"plant": "hill", "half_width_km": 40.0, "inner_radius_km": 10.0},)

    plant: Ref = reference("plant", "equations of motion with an integral of motion")
    half_width_m: float = quantity("length", "half the width of the square map", gt=0)
    inner_radius_m: float = quantity(
        "length", "equilibrium points nearer to the origin are left out", default=0.0, ge=0
    )
    points: int = option("points of the map along each side", default=161, ge=11, le=1001)
