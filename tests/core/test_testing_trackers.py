"""The conformance kit finds what is broken in a tracker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import UT1_IS_UTC, EarthOrientation
from hillsphere.interfaces import Array, Tracker
from hillsphere.testing import ContractViolation, check_tracker, example
from hillsphere.time import Epoch


class Sound:
    """A sound tracker; each fault below overrides one thing."""

    short_period: Any = True

    def __init__(self) -> None:
        self.inner: Tracker[Any] = example("tracker", "least_squares")

    def initial(
        self, elements: Array, t_s: Array, stations: Sequence[Station], epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> Any:  # fmt: skip
        return self.inner.initial(elements, t_s, stations, epoch, orientation)

    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        return self.inner.update(state, t_s, az_rad, el_rad, sigma_rad)

    def predict(self, state: Any, times_s: Array, biased: bool = True) -> Any:
        return self.inner.predict(state, times_s, biased)


class SaysNotWhichElements(Sound):
    short_period = None


class ChangesElements(Sound):
    def initial(
        self, elements: Array, t_s: Array, stations: Sequence[Station], epoch: Epoch,
        orientation: EarthOrientation = UT1_IS_UTC,
    ) -> Any:  # fmt: skip
        state = super().initial(elements, t_s, stations, epoch, orientation)
        elements[5] += 0.1
        return state


class ChangesMeasurements(Sound):
    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        state = super().update(state, t_s, az_rad, el_rad, sigma_rad)
        az_rad += 2.0 * np.pi
        return state


class ChangesItsState(Sound):
    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        after = super().update(state, t_s, az_rad, el_rad, sigma_rad)
        state.elements[:] = after.elements
        return after


class Remembers(Sound):
    calls = 0

    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        self.calls += 1
        after = super().update(state, t_s, az_rad, el_rad, sigma_rad)
        moved = after.elements.copy()
        moved[5] += 1e-5 * self.calls
        return replace(after, elements=moved)


class AnglesNotWrapped(Sound):
    def predict(self, state: Any, times_s: Array, biased: bool = True) -> Any:
        azimuth, elevation, covariance = super().predict(state, times_s, biased)
        return azimuth - np.pi, elevation, covariance


class FromTheSouth(Sound):
    def predict(self, state: Any, times_s: Array, biased: bool = True) -> Any:
        azimuth, elevation, covariance = super().predict(state, times_s, biased)
        return np.remainder(azimuth + np.pi, 2.0 * np.pi), elevation, covariance


class WrongShape(Sound):
    def predict(self, state: Any, times_s: Array, biased: bool = True) -> Any:
        azimuth, elevation, covariance = super().predict(state, times_s, biased)
        return azimuth, elevation, covariance.transpose(2, 3, 0, 1)


class NotSymmetric(Sound):
    def predict(self, state: Any, times_s: Array, biased: bool = True) -> Any:
        azimuth, elevation, covariance = super().predict(state, times_s, biased)
        covariance = covariance.copy()
        covariance[0, 1] += 1e-3 * covariance[0, 0]
        return azimuth, elevation, covariance


class Negative(Sound):
    def predict(self, state: Any, times_s: Array, biased: bool = True) -> Any:
        azimuth, elevation, covariance = super().predict(state, times_s, biased)
        return azimuth, elevation, -covariance


class OrderOfTimes(Sound):
    def predict(self, state: Any, times_s: Array, biased: bool = True) -> Any:
        azimuth, elevation, covariance = super().predict(state, times_s, biased)
        return azimuth, elevation + 1e-4 * np.arange(len(times_s))[:, None], covariance


class BiasFromNothing(Sound):
    def predict(self, state: Any, times_s: Array, biased: bool = True) -> Any:
        azimuth, elevation, covariance = super().predict(state, times_s, biased)
        return azimuth, elevation + 1e-4 * biased, covariance


class NoRevolutions(Sound):
    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        return super().update(state, t_s, np.clip(az_rad, 0.0, 6.2831), el_rad, sigma_rad)


class SigmaOfOneForm(Sound):
    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        sigma = np.sqrt(np.sum(np.asarray(sigma_rad) ** 2))
        return super().update(state, t_s, az_rad, el_rad, sigma)


class Neighbours(Sound):
    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        mixed = el_rad + 1e-4 * np.nanmean(el_rad) * (np.arange(el_rad.size) == 0)
        return super().update(state, t_s, az_rad, mixed, sigma_rad)


class NothingIsZero(Sound):
    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        filled = np.nan_to_num(az_rad), np.nan_to_num(el_rad)
        return super().update(state, t_s, *filled, sigma_rad)


class NothingIsNews(Sound):
    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        after = super().update(state, t_s, az_rad, el_rad, sigma_rad)
        return replace(after, covariance=0.9 * after.covariance)


class NothingSpoils(Sound):
    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        after = super().update(state, t_s, az_rad, el_rad, sigma_rad)
        return replace(after, elements=after.elements + 0.0 * (az_rad + el_rad))


class LearnsNothing(Sound):
    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        return state


class WrongWay(Sound):
    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        azimuth, elevation, _ = self.inner.predict(state, t_s[:1])
        mirrored = 2.0 * azimuth[0] - az_rad, 2.0 * elevation[0] - el_rad
        return super().update(state, t_s, *mirrored, sigma_rad)


def test_a_sound_tracker_passes() -> None:
    check_tracker(Sound())


def test_a_table_passes_as_one() -> None:
    check_tracker(example("tracker", "table"), learns=False)
    with pytest.raises(ContractViolation, match=r"off after 30 measurements"):
        check_tracker(example("tracker", "table"))


@pytest.mark.parametrize(
    ("broken", "match"),
    [
        (SaysNotWhichElements, "short_period must be true or false"),
        (ChangesElements, "initial changes the elements"),
        (ChangesMeasurements, "update changes an argument"),
        (ChangesItsState, "changes the first state"),
        (Remembers, "same update of the first state differs"),
        (AnglesNotWrapped, r"azimuths must lie in \[0, 2π\)"),
        (FromTheSouth, "beside the nominal orbit"),
        (WrongShape, r"predict must return \(K, N\)"),
        (NotSymmetric, "not symmetric"),
        (Negative, "negative variance"),
        (OrderOfTimes, "times in another order"),
        (BiasFromNothing, "knows an elevation bias without a measurement"),
        (NoRevolutions, "azimuths a revolution off"),
        (SigmaOfOneForm, r"sigma of shape \(N,\)"),
        (Neighbours, "cases in another order"),
        (NothingIsZero, r"without measurements \(NaN\) the prediction moves"),
        (NothingIsNews, "covariance shrinks"),
        (NothingSpoils, "not finite"),
        (LearnsNothing, "off after 30 measurements"),
        (WrongWay, "off after 30 measurements"),
    ],
)
def test_what_breaks_a_tracker_is_found(broken: type[Sound], match: str) -> None:
    with pytest.raises(ContractViolation, match=match):
        check_tracker(broken())
