"""Transformation from the rotating frame of a tidally locked moon to inertial axes.

The x axis of the frame ``hill:BODY`` points away from the primary, and the frame rotates about the
moon's pole with its mean motion. The moon's longitude 0 is at a fixed angle from +x, so that the
IAU rotation angles of the body at an epoch determine the frame's inertial orientation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.model.bodies import OrbitingBody, Orientation
from hillsphere.time import J2000, Epoch

__all__ = ["AboutMoon", "RotatingFrame"]


def _about_x(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def _about_z(angle: Array | float) -> Array:
    """Return the rotations (3, 3, K) by angles (K,) about z."""
    angle = np.atleast_1d(np.asarray(angle, dtype=float))
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]])


@dataclass(frozen=True)
class RotatingFrame:
    """The inertial orientation of the frame ``hill:BODY`` from an epoch on.

    Parameters
    ----------
    orientation : Orientation
        Orientation of the moon.
    epoch : Epoch
        Origin of the times.
    mean_motion_rad_s : float
        Angular velocity of the frame.
    prime_meridian_rad : float
        Angle about +z from +x (away from the primary) to the moon's longitude 0.
    primary_distance_m : float
        Distance of the primary.
    """

    orientation: Orientation
    epoch: Epoch
    mean_motion_rad_s: float
    prime_meridian_rad: float
    primary_distance_m: float

    def axes(self, t_s: Array) -> Array:
        """Return the frame's axes in the ICRF as columns, (3, 3, K), at times (K,) after epoch."""
        body = self.orientation
        since = self.epoch.to("TDB").seconds_since(J2000)
        start = body.prime_meridian_rad + body.rate_rad_s * since - self.prime_meridian_rad
        # angles of many revolutions lose digits: take the remainder before adding
        angle = np.remainder(start, 2.0 * np.pi) + self.mean_motion_rad_s * np.asarray(t_s)
        node = _about_z(body.right_ascension_rad + 0.5 * np.pi)[:, :, 0]
        tilt = node @ _about_x(0.5 * np.pi - body.declination_rad)
        return np.asarray(np.einsum("ij,jkn->ikn", tilt, _about_z(angle)))

    def to_inertial(self, x: Array, t_s: Array, centre: str = "moon") -> Array:
        """Transform states to the ICRF.

        Parameters
        ----------
        x : ndarray, shape (6, K)
            Positions, m, and velocities, m/s, in the rotating frame.
        t_s : ndarray, shape (K,)
            Times after the epoch.
        centre : str
            Origin of the resulting positions and velocities: ``"moon"`` or ``"primary"``.

        Returns
        -------
        ndarray, shape (6, K)
            Positions, m, and velocities, m/s.

        Raises
        ------
        InputError
            If the shapes do not match or the centre is unknown.
        """
        t_s = np.asarray(t_s, dtype=float)
        if x.shape != (6, t_s.size):
            raise InputError(f"states must be (6, {t_s.size}), got {x.shape}")
        if centre not in ("moon", "primary"):
            raise InputError(f"centre must be 'moon' or 'primary', got {centre!r}")
        place, speed, n = x[:3].copy(), x[3:].copy(), self.mean_motion_rad_s
        if centre == "primary":
            place[0] += self.primary_distance_m
        speed[0] -= n * place[1]
        speed[1] += n * place[0]
        axes = self.axes(t_s)
        turned = (np.einsum("ijn,jn->in", axes, part) for part in (place, speed))
        return np.concatenate(list(turned))


@runtime_checkable
class AboutMoon(Contract, Protocol):
    """A plant in the rotating frame of a moon."""

    @property
    def moon(self) -> OrbitingBody:
        """The moon."""
        ...

    @property
    def mean_motion_rad_s(self) -> float:
        """Rate at which the frame turns, which need not be that of a moon without mass."""
        ...

    @property
    def prime_meridian_rad(self) -> float:
        """Angle about +z from +x to its longitude 0."""
        ...
