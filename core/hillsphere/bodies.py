"""Bodies: what orbits what, and how fast."""

from __future__ import annotations

from math import sqrt

from hillsphere.spec import Spec, Vector3, option, quantity

__all__ = ["Moon", "MoonSpec"]


class MoonSpec(Spec):
    """A small moon on a Keplerian orbit around its primary."""

    examples = ({"primary_gm_km3_s2": 42828.37, "semi_major_axis_km": 9377.0},)

    name: str = option("name used in frames and figures", default="body", min_length=1)
    primary_gm_m3_s2: float = quantity(
        "gravitational_parameter", "gravitational parameter of the primary", gt=0
    )
    semi_major_axis_m: float = quantity("length", "semi-major axis of the orbit", gt=0)
    semi_axes_m: Vector3 | None = quantity(
        "length",
        "semi-axes of the body's surface along x, y, z, for impacts; left out: the surface of the "
        "gravity model, if it has one",
        default=None,
        gt=0,
    )


class Moon:
    """A small moon on a Keplerian orbit around its primary.

    Parameters
    ----------
    spec : MoonSpec
        Its parameters.
    """

    def __init__(self, spec: MoonSpec) -> None:
        self.name = spec.name
        self.primary_gm_m3_s2 = spec.primary_gm_m3_s2
        self.semi_major_axis_m = spec.semi_major_axis_m
        self.semi_axes_m = spec.semi_axes_m

    @property
    def mean_motion_rad_s(self) -> float:
        """Mean motion √(GM/a³) of a body of negligible mass, rad/s."""
        return sqrt(self.primary_gm_m3_s2 / self.semi_major_axis_m**3)
