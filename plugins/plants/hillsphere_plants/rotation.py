"""Rotation of a body-fixed frame about the common z axis: constant, or along an ellipse."""

from __future__ import annotations

from math import cos, pi, remainder, sin
from typing import NamedTuple

from hillsphere.symbolic import Expr, Vec3, atan2, constant, sqrt
from hillsphere.symbolic import cos as symbolic_cos
from hillsphere.symbolic import sin as symbolic_sin

__all__ = [
    "AxialRotation",
    "Spin",
    "anomaly_rates",
    "librating_spin",
    "locked_spin",
    "mean_anomaly",
]

_QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))
"""Cosine and sine of 0°, 90°, 180° and 270°, exact: cos(π/2) of the library is 6e-17, which would
add terms to every equation."""
_SNAP_RAD = 1e-14  # a few units in the last place of π: what 180° leaves after conversion


class AxialRotation(NamedTuple):
    """Constant rotation about z from the frame of the motion to the body-fixed frame.

    Parameters
    ----------
    cos, sin : float
        Cosine and sine of the angle from +x of the motion to longitude 0 of the body.
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


class Spin(NamedTuple):
    """Rotation of a moon relative to the line to its primary, as expressions.

    Parameters
    ----------
    angle : Expr
        ψ from the moon's mean direction to the primary to the true one, about +z, rad.
    rate, acceleration : Expr
        Inertial angular velocity ω of the moon, rad/s, and its derivative, rad/s².
    """

    angle: Expr
    rate: Expr
    acceleration: Expr


def anomaly_rates(anomaly: Expr, eccentricity: Expr, mean_motion: Expr) -> tuple[Expr, Expr]:
    """Return ν̇, rad/s, and ν̈, rad/s², of Keplerian motion at the true anomaly ν.

    ν̇ = n (1 + e cos ν)²/(1−e²)^(3/2) and ν̈ = −2 n² e sin ν (1 + e cos ν)³/(1−e²)³.
    """
    shape = 1.0 - eccentricity * eccentricity
    ratio = (1.0 + eccentricity * symbolic_cos(anomaly)) / shape
    n, e = mean_motion, eccentricity
    first = n * ratio * ratio * sqrt(shape)
    second = -2.0 * n * n * e * symbolic_sin(anomaly) * ratio * ratio * ratio
    return first, second


def mean_anomaly(anomaly: Expr, eccentricity: Expr) -> tuple[Expr, Expr]:
    """Return the mean anomaly M and ν − M, rad, at the true anomaly ν, of any revolution.

    With β = e/(1 + √(1−e²)) the eccentric anomaly is E = ν − 2 atan(β sin ν/(1 + β cos ν)), and
    M = E − e sin E: no quadrant to choose, no cancellation for a small eccentricity.
    """
    e, root = eccentricity, sqrt(1.0 - eccentricity * eccentricity)
    c, s = symbolic_cos(anomaly), symbolic_sin(anomaly)
    beta = e / (1.0 + root)
    sin_eccentric = root * s / (1.0 + e * c)
    centre = 2.0 * atan2(beta * s, 1.0 + beta * c) + e * sin_eccentric
    return anomaly - centre, centre


def locked_spin(anomaly: Expr, eccentricity: Expr, mean_motion: Expr) -> Spin:
    """Return the spin of a moon that always turns the same side to its primary (ψ = 0, ω = ν̇)."""
    return Spin(constant(0.0), *anomaly_rates(anomaly, eccentricity, mean_motion))


def librating_spin(
    anomaly: Expr, eccentricity: Expr, mean_motion: Expr, amplitude: Expr | None
) -> Spin:
    """Return the spin θ = M + A sin M; None for the amplitude A: uniform, θ = M.

    ψ = ν − θ, ω = n (1 + A cos M), ω̇ = −n² A sin M.
    """
    mean, centre = mean_anomaly(anomaly, eccentricity)
    n = mean_motion
    if amplitude is None:
        return Spin(centre, n, constant(0.0))
    swing = amplitude * symbolic_sin(mean)
    return Spin(centre - swing, n * (1.0 + amplitude * symbolic_cos(mean)), -n * n * swing)
