"""Tracker without updates, a stored table of pointing angles: the baseline of comparisons."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_tracking.trackers.specs import TableSpec
from hillsphere_tracking.trackers.state import (
    JointCases,
    OrbitState,
    field_of,
    point_antenna,
    predict_angles,
    start,
    validate_measurement,
)

__all__ = ["Table"]


class Table(JointCases):
    """Tracker that predicts from the nominal orbit alone and ignores all measurements.

    Parameters
    ----------
    spec : TableSpec
        Parameters from the mission.
    """

    def __init__(self, spec: TableSpec) -> None:
        self.spec = spec
        self._field = field_of(spec)
        self.short_period: bool = spec.short_period

    def initial(
        self,
        elements: Array,
        t_s: Array,
        stations: Sequence[Station],
        epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> OrbitState:
        """Return the nominal orbit; see `hillsphere.interfaces.Tracker`."""
        return start(elements, t_s, stations, epoch, orientation)

    def update(
        self, state: OrbitState, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array
    ) -> OrbitState:
        """Count the measurement without using it."""
        _, azimuth, elevation = validate_measurement(state, t_s, az_rad, el_rad)
        return replace(state, count=state.count + np.isfinite(azimuth + elevation))

    def point(self, state: OrbitState, times_s: Array) -> tuple[Array, Array]:
        """Return azimuth and elevation (2, K, N) as `predict` does, with and without biases."""
        return point_antenna(state, times_s, self._field, short_period=self.short_period)

    def predict(
        self, state: OrbitState, times_s: Array, biased: bool = True
    ) -> tuple[Array, Array, Array]:
        """Return azimuth, elevation (K, N) and sky covariance (2, 2, K, N)."""
        cases = state.t_s.size
        columns = np.zeros((cases, 6, 2))
        columns[:, 3, 0] = columns[:, 5, 1] = 1.0
        variances = [self.spec.node_sigma_rad**2, self.spec.mean_anomaly_sigma_rad**2]
        covariance = np.broadcast_to(np.diag(variances), (cases, 2, 2))
        return predict_angles(
            state, times_s, self._field, columns, covariance, np.zeros((cases, 2)),
            short_period=self.short_period, biased=biased,
        )  # fmt: skip
