"""Rotation of a body-fixed frame about the common z axis."""

from __future__ import annotations

from math import cos, pi, remainder, sin
from typing import NamedTuple

from hillsphere.symbolic import Expr, Vec3

__all__ = ["AxialRotation"]

_QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
_SNAP_RAD = 1e-14  # a few units in the last place of π: what 180° leaves after conversion


class AxialRotation(NamedTuple):
    """Constant rotation about z from the frame of the motion to the body-fixed frame.

    Parameters
    ----------
    cos, sin : float
        Of the angle from +x of the motion to longitude 0 of the body.
    """

    cos: float
    sin: float

    @classmethod
    def by(cls, angle_rad: float) -> AxialRotation:
        """Return the rotation by an angle; a multiple of 90° is exact.

        sin π is 1.2e-16 in floating point: a trace of that in the equations would break a mirror
        symmetry that the gravity model has exactly.
        """
        quarter = pi / 2
        if abs(remainder(angle_rad, quarter)) <= _SNAP_RAD * max(1.0, abs(angle_rad)):
            return cls(*_QUARTERS[round(angle_rad / quarter) % 4])
        return cls(cos(angle_rad), sin(angle_rad))

    def to_body(self, r: Vec3) -> Vec3:
        """Return the body-fixed components of a vector."""
        x, y, z = r
        return (self._sum(x, y), self._sum(y, -x), z)

    def from_body(self, r: Vec3) -> Vec3:
        """Return the components in the frame of the motion of a body-fixed vector."""
        x, y, z = r
        return (self._sum(x, -y), self._sum(y, x), z)

    def _sum(self, along: Expr, across: Expr) -> Expr:
        """Return ``cos·along + sin·across`` without the terms that vanish."""
        if self.sin == 0.0:
            return self.cos * along
        if self.cos == 0.0:
            return self.sin * across
        return self.cos * along + self.sin * across
