"""Gravity of a point mass."""

from __future__ import annotations

from hillsphere.interfaces import Parameter
from hillsphere.symbolic import Expr, Params, Vec3, dot, power, sqrt
from hillsphere_gravity.specs import PointMassSpec

__all__ = ["PointMass"]


class PointMass:
    """U = GM/r, the field of a point or of a sphere from outside; singular at the origin.

    Parameters
    ----------
    spec : PointMassSpec
        Its parameter. Run-time parameter: ``gm``.
    """

    frame = "body"

    def __init__(self, spec: PointMassSpec) -> None:
        self.gm_m3_s2 = spec.gm_m3_s2

    def parameters(self) -> tuple[Parameter, ...]:
        """Return ``gm``."""
        return (Parameter("gm", self.gm_m3_s2, "m3/s2", positive=True),)

    def potential(self, r: Vec3, p: Params) -> Expr:
        """Return +U, m²/s², at the body-fixed position r, m."""
        return p["gm"] / sqrt(dot(r, r))

    def acceleration(self, r: Vec3, p: Params) -> Vec3:
        """Return ∇U, m/s², at the body-fixed position r, m."""
        factor = -p["gm"] * power(dot(r, r), -1.5)
        return (factor * r[0], factor * r[1], factor * r[2])
