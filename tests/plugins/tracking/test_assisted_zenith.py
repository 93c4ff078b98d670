"""Errors of the encoder's frame where a bias carries the angles over the zenith."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.time import Epoch
from hillsphere_tracking.assisted_tracking.following import AntennaRecord, FollowedPass, follow
from hillsphere_tracking.assisted_tracking.truth import PassTruth
from hillsphere_tracking.mean_elements import EARTH_FIELD, propagate_secular, states
from hillsphere_tracking.trackers.least_squares import LeastSquares, LeastSquaresState
from hillsphere_tracking.trackers.observation import angles, directions, fold_over_zenith, site_of
from hillsphere_tracking.trackers.specs import LeastSquaresSpec

EPOCH = Epoch.parse("2027-06-01T12:00:00", "UTC")
ELEMENTS = np.array([7.4e6, 0.001, 1.0, 1.0, 0.2, 1.3])[:, None]
BIAS = np.radians([0.1, 0.3])


class Knowing(LeastSquares):
    """A tracker that is told the biases."""

    def initial(
        self,
        elements: Array,
        t_s: Array,
        stations: Sequence[Station],
        epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> LeastSquaresState:
        begun = super().initial(elements, t_s, stations, epoch, orientation)
        return self.with_biases(begun, BIAS, 1e-8 * np.eye(2))


def test_a_known_bias_is_no_error_beyond_the_zenith() -> None:
    x = states(ELEMENTS, np.zeros(1))
    below = Station.at("below", earth_fixed("teme", EPOCH, np.zeros(1))[:, :, 0] @ x[:3, 0])
    station = Station("below", below.latitude_rad, below.longitude_rad)
    t = np.arange(-60.0, 60.5, 0.5)
    columns = np.repeat(ELEMENTS, t.size, axis=1)
    site = site_of((station,), EPOCH, UT1_IS_UTC)
    true = np.array(angles(directions(columns, t, t, site, EARTH_FIELD, short_period=False)))
    assert (true[1] + BIAS[1]).max() > 0.5 * np.pi
    truth = PassTruth(
        name="over", sensor=cast(Any, None), orientation=UT1_IS_UTC, shift_rad=0.0,
        plain=None, tracked=cast(Any, None), direction="ascending", t_s=t, x=np.empty((6, 0)),
        scene={}, start_teme=x[:, 0], angles_rad=true, sigma_rad=np.full((2, t.size), 1e-3),
        begins=np.array([4]),
    )  # fmt: skip
    shown = np.array(fold_over_zenith(*(true + BIAS[:, None])))[:, :, None]
    seen = AntennaRecord(shown, np.broadcast_to(BIAS[:, None, None], shown.shape), (station,))
    tracker = Knowing(LeastSquaresSpec(short_period=False))
    (found,) = follow(
        tracker, [FollowedPass(truth, seen)], [propagate_secular(ELEMENTS, t[:1])], EPOCH, 0.02,
        None, keep=[("encoder_error",)],
    )  # fmt: skip
    assert found.measures[0]["encoder_error_max"][0] < 1e-3
    assert found.over_time[0]["encoder_error"].max() < 1e-3
