"""Orientation of an Earth that is turned by an angle, realised as a change of UT1."""

from __future__ import annotations

from dataclasses import dataclass, replace

from hillsphere.base.orientation import EarthOrientation, OrientationAngles
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import ROTATION_RATES_RAD_S
from hillsphere.time import Epoch

__all__ = ["TurnedEarth"]


@dataclass(frozen=True)
class TurnedEarth:
    """Orientation of an Earth that is turned eastwards by a constant angle.

    Parameters
    ----------
    base : EarthOrientation
        True orientation.
    angle_rad : float or ndarray, shape (N,)
        Additional rotation, eastwards; an array has the angle of each of the times asked for.
    """

    base: EarthOrientation
    angle_rad: float | Array

    def at(self, epoch: Epoch, t_s: Array) -> OrientationAngles:
        """Return the orientation at times (N,), SI seconds after an epoch."""
        true = self.base.at(epoch, t_s)
        # time in which the Earth turns by the angle
        later = self.angle_rad / ROTATION_RATES_RAD_S["teme"]
        return replace(true, ut1_minus_tai_s=true.ut1_minus_tai_s + later)

    def lapse(self, epoch: Epoch, t_s: Array) -> str | None:
        """Return the warning of the true orientation for these times, or None."""
        return self.base.lapse(epoch, t_s)
