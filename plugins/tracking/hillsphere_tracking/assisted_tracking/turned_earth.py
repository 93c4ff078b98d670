"""The Earth turned by an angle: as if UT1 were another, for all that asks how it is turned."""

from __future__ import annotations

from dataclasses import dataclass, replace

from hillsphere.base.orientation import EarthOrientation, OrientationAngles
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import ROTATION_RATES_RAD_S
from hillsphere.time import Epoch

__all__ = ["TurnedEarth"]


@dataclass(frozen=True)
class TurnedEarth:
    """An `EarthOrientation` in which the Earth has turned further.

    Parameters
    ----------
    base : EarthOrientation
        The true one.
    angle_rad : float
        By how much further, eastwards.
    """

    base: EarthOrientation
    angle_rad: float

    def at(self, epoch: Epoch, t_s: Array) -> OrientationAngles:
        """Return the orientation at times (N,), SI seconds after an epoch."""
        true = self.base.at(epoch, t_s)
        later = self.angle_rad / ROTATION_RATES_RAD_S["teme"]
        return replace(true, ut1_minus_tai_s=true.ut1_minus_tai_s + later)

    def lapse(self, epoch: Epoch, t_s: Array) -> str | None:
        """Return what the true one says of the times."""
        return self.base.lapse(epoch, t_s)
