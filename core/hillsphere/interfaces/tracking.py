"""Trackers, which point a ground antenna at a satellite."""

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
"""State of a tracker between its calls: any type that the tracker chooses, treated as frozen."""


class Tracker(Protocol[State]):
    """Predicts pointing angles of an antenna from a nominal orbit and measured angles.

    Pure functions of frozen states, N cases at once, independent of each other. Times are SI
    seconds after the epoch given to `initial`; angles are radians, azimuth from north over east.
    """

    @property
    def short_period(self) -> bool:
        """Whether it adds the short-period terms of J2 to its mean elements."""
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
        the frame ``teme``, at times t_s (N,) or (1,). `stations` holds one station for all cases,
        or one per case.
        """
        ...

    def update(
        self, state: State, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array
    ) -> State:
        """Return the state after one measurement per case.

        t_s, az_rad, el_rad are (N,); a case whose angles are not finite has no measurement.
        sigma_rad, shape (), (N,) or (2, N), is the standard deviation of both angles, or of each.
        """
        ...

    def predict(
        self, state: State, times_s: Array, biased: bool = True
    ) -> tuple[Array, Array, Array]:
        """Return azimuth, elevation and their covariance at times (K,) or (K, N).

        With `biased`, azimuth in [0, 2π) and elevation up to π/2, (K, N), contain the estimated
        biases of the angles, and the times those of the clock, as measurements do. Otherwise they
        are the estimated true angles at true times. The covariance (2, 2, K, N), rad², is of
        cross-elevation (azimuth times cos h) and elevation, which stays finite at the zenith.
        """
        ...
