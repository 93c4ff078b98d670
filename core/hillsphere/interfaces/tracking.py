"""Trackers of a target from the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, TypeVar

from hillsphere.base.arrays import Array

if TYPE_CHECKING:
    from hillsphere.base.geodetic import Station
    from hillsphere.base.orientation import EarthOrientation
    from hillsphere.base.time import Epoch

__all__ = ["State", "Tracker"]


State = TypeVar("State")


class Tracker(Protocol[State]):
    """From a nominal orbit and measured angles to where an antenna must point.

    Pure functions of frozen states, N cases at once, independent of each other. Times are SI
    seconds after the epoch given to `initial`; angles are radians, azimuth from north over east.
    """

    @property
    def short_period(self) -> bool:
        """Whether its elements are mean ones to which it adds the short-period terms of J2."""
        ...

    def initial(
        self,
        elements: Array,
        t_s: Array,
        stations: Sequence[Station],
        epoch: Epoch,
        orientation: EarthOrientation = ...,
    ) -> State:
        """Return the state before the first measurement.

        elements (6, N) are nominal mean elements a, e, i, Ω, ω, M (m, rad) of Brouwer's theory in
        the frame ``teme``, at times t_s (N,) or (1,); the stations one, or one a case.
        """
        ...

    def update(
        self, state: State, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array
    ) -> State:
        """Return the state after one measurement a case.

        t_s, az_rad, el_rad are (N,); where an angle is not finite, the case has no measurement.
        sigma_rad, (), (N,) or (2, N), are the standard deviations of both angles or of each.
        """
        ...

    def predict(
        self, state: State, times_s: Array, biased: bool = True
    ) -> tuple[Array, Array, Array]:
        """Return what the antenna will show at times (K,) or (K, N), and how surely.

        Azimuth in [0, 2π) and elevation up to π/2, (K, N), contain the angle biases that the state
        knows of, and the times are those by which the measurements are dated, with the clock's bias
        that it knows of. Without `biased` all that is taken off: it is where the satellite is at
        the true times. The covariance (2, 2, K, N), rad², is that of the answer on the sky, finite
        at the zenith: of cross-elevation (azimuth times cos h) and elevation.
        """
        ...
