"""What an antenna without a plan does, and the smooth course of a satellite through samples."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.following import Course, follow_courses, naive_course
from hillsphere_tracking.pointing.mounts import AxisLimits, Mount, azimuth_elevation
from hillsphere_tracking.pointing.sight import LineOfSight
from hillsphere_tracking.pointing.sky import angles_of, separation
from hillsphere_tracking.topocentric import direction_cosines

DEGREE = np.pi / 180.0


def dish(low: float, high: float) -> Mount:
    quick = AxisLimits(low * DEGREE, high * DEGREE, 5.0 * DEGREE, 5.0 * DEGREE)
    return azimuth_elevation(quick, AxisLimits(0.0, 0.5 * np.pi, 0.1, 0.1))


def turning(first_deg: float, last_deg: float, count: int = 201) -> Array:
    azimuth = np.linspace(first_deg, last_deg, count) * DEGREE
    return direction_cosines(azimuth, np.full(count, 0.5))


def test_naive_begins_near_the_middle_and_goes_on() -> None:
    course = naive_course(turning(170.0, 250.0), dish(-270.0, 270.0))
    np.testing.assert_allclose(np.degrees(course.primary_rad[[0, -1]]), [170.0, 250.0], rtol=1e-12)
    np.testing.assert_allclose(course.secondary_rad, 0.5, rtol=1e-12)
    west = naive_course(turning(200.0, 250.0), dish(-270.0, 270.0))
    np.testing.assert_allclose(np.degrees(west.primary_rad[[0, -1]]), [-160.0, -110.0], rtol=1e-12)
    planned = naive_course(turning(200.0, 250.0), dish(-270.0, 270.0), 230.0 * DEGREE)
    np.testing.assert_allclose(np.degrees(planned.primary_rad[0]), 200.0, rtol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_naive_rewinds_at_a_stop(sign: float) -> None:
    course = np.degrees(naive_course(turning(sign * 170.0, sign * 300.0), dish(-270.0, 270.0))
                        .primary_rad) * sign  # fmt: skip
    rewind = np.flatnonzero(np.abs(np.diff(course)) > 180.0)
    assert rewind.size == 1
    assert course[rewind[0]] == pytest.approx(270.0, abs=1.0)
    assert course[-1] == pytest.approx(-60.0)


def test_naive_waits_at_a_stop_where_nothing_leads_on() -> None:
    mount = dish(-90.0, 90.0)
    course = naive_course(turning(45.0, 135.0), mount)
    assert course.primary_rad.max() > mount.primary.upper_rad
    (followed,) = follow_courses([course], mount, 0.1)
    assert followed.primary_rad[-1] == pytest.approx(0.5 * np.pi)


def test_courses_of_different_lengths_are_followed_as_if_alone() -> None:
    mount = dish(-270.0, 270.0)
    long, brief = (naive_course(turning(0.0, 60.0, n), mount) for n in (301, 90))
    together = follow_courses([long, brief], mount, 0.1)
    for course, found in zip((long, brief), together, strict=True):
        (alone,) = follow_courses([course], mount, 0.1)
        assert found.primary_rad.size == course.primary_rad.size
        np.testing.assert_array_equal(found.primary_rad, alone.primary_rad)
        np.testing.assert_array_equal(found.secondary_rad, alone.secondary_rad)
    still = follow_courses([Course(np.full(5, 1.0), np.full(5, 0.5))], mount, 0.1)[0]
    np.testing.assert_array_equal(still.primary_rad, 1.0)


def orbit(t_s: Array) -> tuple[Array, Array, Array]:
    """Return where a circular orbit of 7000 km passes 0.1° beside the zenith of a still Earth."""
    along, aside, radius = 1.078e-3 * t_s, 1.0e-4, 7.0e6
    place = radius * np.array(
        [np.sin(along) * np.cos(aside), np.full(t_s.shape, np.sin(aside)),
         np.cos(along) * np.cos(aside)]
    ) - np.array([[0.0], [0.0], [6.378e6]])  # fmt: skip
    return (*angles_of(place), np.linalg.norm(place, axis=0))


@pytest.mark.parametrize(("samples", "error_rad"), [(121, 1e-9), (41, 1e-6), (21, 1e-4)])
def test_the_stated_error_of_a_course_is_kept(samples: int, error_rad: float) -> None:
    times = np.linspace(-400.0, 400.0, samples)
    sight = LineOfSight(times, *orbit(times))
    dense = np.arange(-400.0, 400.0, 0.1)
    azimuth, elevation, _ = orbit(dense)
    missed = separation(sight.direction(dense), direction_cosines(azimuth, elevation)).max()
    assert missed < 0.3 * sight.sampling_error_rad
    assert missed < error_rad


def test_the_peak_rate_at_a_keyhole_is_found_between_coarse_times() -> None:
    times = np.linspace(-400.0, 400.0, 121)
    sight = LineOfSight(times, *orbit(times))
    # at the culmination: speed over distance to the side
    expected = 1.078e-3 / np.tan(1.0e-4)
    coarse = np.arange(-400.0, 400.0, 7.0)
    peak = sight.peak_primary_rate(dish(-270.0, 270.0), coarse)
    assert peak == pytest.approx(expected, rel=1e-3)


def test_too_few_samples_make_no_course() -> None:
    times = np.linspace(-400.0, 400.0, 11)
    with pytest.raises(InputError, match="at least 12 finite samples in order of time, got 11"):
        LineOfSight(times, *orbit(times))
    with pytest.raises(InputError, match="in order of time"):
        LineOfSight(np.linspace(400.0, -400.0, 21), *orbit(np.linspace(-400.0, 400.0, 21)))
