"""Predictions at 1 Hz filled up to 10 Hz: straight flights past a station as the exact truth."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.interpolation import (
    great_circle,
    great_circle_error_bound,
    linear,
    linear_error_bound,
    smooth,
    smooth_error_bound,
)
from hillsphere_tracking.pointing.sky import angles_of, offset, separation
from hillsphere_tracking.topocentric import direction_cosines

DEGREE = np.pi / 180.0
RATE = 0.34 * DEGREE  # at culmination


def flyby(culmination_deg: float, times_s: Array, heading_deg: float = 20.0) -> tuple[Array, Array]:
    """Return the angles of a straight, even flight past the station."""
    h, course = culmination_deg * DEGREE, heading_deg * DEGREE
    along = np.array([np.sin(course), np.cos(course), 0.0])
    side = np.array([np.cos(course), -np.sin(course), 0.0])
    nearest = np.cos(h) * side + np.sin(h) * np.array([0.0, 0.0, 1.0])
    return angles_of(nearest[:, None] + along[:, None] * RATE * times_s)


COARSE, FINE = np.arange(-200.0, 200.5), np.arange(-200.0, 200.005, 0.05)


def _miss(kind: object, culmination_deg: float, shift_s: float = 0.0) -> Array:
    azimuth, elevation = flyby(culmination_deg, COARSE - shift_s)
    found = kind(COARSE, azimuth, elevation, FINE)  # type: ignore[operator]
    truth = flyby(culmination_deg, FINE - shift_s)
    return separation(direction_cosines(*found), direction_cosines(*truth))


@pytest.mark.parametrize("culmination_deg", [5.0, 30.0, 60.0, 81.3, 88.6])
@pytest.mark.parametrize("shift_s", [0.0, 0.3])
def test_errors_stay_within_their_bounds(culmination_deg: float, shift_s: float) -> None:
    nodes = flyby(culmination_deg, COARSE - shift_s)
    interval = np.clip(np.searchsorted(COARSE, FINE, side="right") - 1, 0, COARSE.size - 2)
    for kind, bound in ((linear, linear_error_bound), (great_circle, great_circle_error_bound)):
        miss = _miss(kind, culmination_deg, shift_s)
        allowed = bound(COARSE, *nodes)
        # differences over 2 s see a peak of the second derivative 10 % lower at most
        assert np.all(miss <= 1.1 * allowed[interval] + 1e-9)
        # and the bound is no empty one: it is reached to a tenth
        assert miss.max() > 0.8 * allowed.max()


@pytest.mark.parametrize("culmination_deg", [5.0, 60.0, 81.3, 89.93, 90.0])
@pytest.mark.parametrize("shift_s", [0.0, 0.3])
def test_cubics_stay_within_their_bound(culmination_deg: float, shift_s: float) -> None:
    nodes = flyby(culmination_deg, COARSE - shift_s)
    interval = np.clip(np.searchsorted(COARSE, FINE, side="right") - 1, 0, COARSE.size - 2)
    miss = _miss(smooth, culmination_deg, shift_s)
    allowed = smooth_error_bound(COARSE, *nodes)
    assert np.all(miss <= allowed[interval] + 1e-12)
    assert miss.max() > 0.25 * allowed.max()


def test_unit_vectors_are_better_near_the_zenith() -> None:
    # degrees, of the same flight: linear angles miss by 200 times as much as great circles
    assert _miss(great_circle, 89.93).max() / DEGREE < 2e-4
    assert _miss(linear, 89.93).max() / DEGREE > 0.05
    assert _miss(smooth, 89.93).max() / DEGREE < 2e-6
    assert _miss(smooth, 60.0).max() < 0.02 * _miss(great_circle, 60.0).max()


def test_cubics_do_not_jerk_the_axes() -> None:
    """At a prediction the rate of linear angles jumps, that of the cubics does not."""
    jumps = []
    for kind in (linear, smooth):
        azimuth, _ = kind(COARSE, *flyby(60.0, COARSE), FINE)
        jumps.append(np.abs(np.diff(np.unwrap(azimuth), 2)).max() / 0.05)
    assert jumps[1] < 0.06 * jumps[0]


def test_two_predictions_are_joined_by_a_line() -> None:
    nodes = flyby(60.0, COARSE[200:202])
    found = [kind(COARSE[200:202], *nodes, np.array([0.3])) for kind in (smooth, great_circle)]
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-6)
    with pytest.raises(InputError, match="at least 4 predictions"):
        smooth_error_bound(COARSE[200:203], *flyby(60.0, COARSE[200:203]))


@given(
    culmination=st.floats(80.0, 90.0),
    heading=st.floats(0.0, 360.0),
    shift=st.floats(0.0, 1.0),
)
@settings(max_examples=30, deadline=None)
def test_unit_vectors_are_continuous_through_the_zenith(
    culmination: float, heading: float, shift: float
) -> None:
    nodes = np.arange(-20.0, 21.0)
    at = np.arange(-20.0, 20.001, 0.01)
    found = smooth(nodes, *flyby(culmination, nodes - shift, heading), at)
    step = separation(
        direction_cosines(found[0][1:], found[1][1:]),
        direction_cosines(found[0][:-1], found[1][:-1]),
    )
    # never faster than the satellite, wherever azimuth jumps
    assert step.max() <= 1.001 * RATE * 0.01
    assert step.min() >= 0.9 * RATE * 0.01


@pytest.mark.parametrize("kind", [linear, great_circle, smooth])
def test_predictions_themselves_are_met(kind: object) -> None:
    azimuth, elevation = flyby(86.0, COARSE)
    found = kind(COARSE, azimuth, elevation, COARSE)  # type: ignore[operator]
    miss = separation(direction_cosines(*found), direction_cosines(azimuth, elevation))
    np.testing.assert_allclose(miss, 0.0, rtol=0, atol=1e-14)
    assert np.all((found[0] >= 0.0) & (found[0] < 2.0 * np.pi))


def test_azimuth_goes_the_short_way_across_north() -> None:
    found, _ = linear(
        np.array([0.0, 1.0]), np.array([359.0, 1.0]) * DEGREE, np.zeros(2), np.array([0.25])
    )
    np.testing.assert_allclose(found / DEGREE, [359.5], rtol=1e-12)


@pytest.mark.parametrize(
    ("times", "azimuth", "at", "message"),
    [
        ([0.0], [0.0], [0.0], "at least 2"),
        ([0.0, 0.0], [0.0, 0.0], [0.0], "order of time"),
        ([0.0, 1.0], [0.0, np.nan], [0.0], "finite"),
        ([0.0, 1.0], [0.0, 0.1], [1.5], "predict further"),
        ([0.0, 1.0], [0.0, np.pi], [0.5], "90°"),
    ],
)
def test_what_cannot_be_interpolated(
    times: list[float], azimuth: list[float], at: list[float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        great_circle(np.array(times), np.array(azimuth), np.zeros(len(times)), np.array(at))


@given(
    azimuth=st.floats(0.0, 6.28),
    elevation=st.floats(-1.5, 1.57),
    right=st.floats(-1.0, 1.0),
    up=st.floats(-1.0, 1.0),
)
@settings(max_examples=50, deadline=None)
def test_offsets_are_arcs(azimuth: float, elevation: float, right: float, up: float) -> None:
    here = direction_cosines(np.array(azimuth), np.array(elevation))
    found = offset(np.array(azimuth), np.array(elevation), np.array(right), np.array(up))
    there = direction_cosines(*found)
    np.testing.assert_allclose(separation(here, there), np.hypot(right, up), rtol=0, atol=1e-12)
