"""The Hill frame of the plant ``proximity`` at the start of a flight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hillsphere.engine.start_states import Centre
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.ephemeris import from_equator
from hillsphere.time import Epoch

__all__ = ["HillFrame"]

_SAME_S = 1.0
"""Two dates of one start may differ by this, s: the frame turns by 2e-7 rad at 1 au meanwhile."""


@dataclass(frozen=True, eq=False)
class HillFrame:
    """The Hill frame of an asteroid at one time, for `hillsphere.engine.start_states.place_start`.

    Parameters
    ----------
    names : tuple of str
        Names of the asteroid and its primary.
    gms_m3_s2 : tuple of float
        Their gravitational parameters.
    origin : ndarray, shape (6,)
        Heliocentric state of the asteroid, m and m/s.
    axes : ndarray, shape (3, 3)
        Axes of the frame as columns, in the axes of `origin`.
    rate : ndarray, shape (3,)
        Angular velocity in the frame's own axes, rad/s.
    oriented : bool
        Whether the axes of `origin` are those of ecliptic and equinox J2000.
    zero : Epoch or None
        Date of time 0 of the plant's clock, where the body's mean anomaly says it.
    time_s : float
        Time on that clock.
    """

    names: tuple[str, str]
    gms_m3_s2: tuple[float, float]
    origin: Array
    axes: Array
    rate: Array
    oriented: bool
    zero: Epoch | None
    time_s: float

    def frame_rate(self, others: Mapping[str, float]) -> Array:
        """Return the angular velocity (3,), rad/s: that of the true anomaly about z."""
        return self.rate

    def centres(self, others: Mapping[str, float]) -> Mapping[str, Centre]:
        """Return the asteroid at the origin, and its primary where it is then."""
        away = self.axes.T @ self.origin[:3], self.axes.T @ self.origin[3:]
        return {
            self.names[0]: Centre(self.gms_m3_s2[0], np.zeros(3), np.zeros(3)),
            self.names[1]: Centre(self.gms_m3_s2[1], -away[0], -away[1]),
        }

    def icrf_axes(self, epoch: Epoch) -> Array:
        """Return the axes in the ICRF as columns (3, 3).

        The frame's place follows from the orbit and the plant's clock. The epoch is only compared.

        Raises
        ------
        InputError
            If the body gives no angles of its orbit, or the epoch is not that of the start.
        """
        if not self.oriented:
            raise InputError(
                f"body {self.names[0]!r} does not say how its orbit stands among the stars: give "
                "it inclination, node and periapsis, or axes = 'plant'"
            )
        if self.zero is not None and abs(epoch.seconds_since(self.zero) - self.time_s) > _SAME_S:
            date = self.zero.isot(np.array([self.time_s]), 0)[0]
            raise InputError(
                "epoch: by the body's mean anomaly and the plant's clock the flight begins at "
                f"{date} TDB; give that date, or another start.time"
            )
        return np.asarray(from_equator(np.eye(3)[:, :, None])[:, :, 0] @ self.axes)
