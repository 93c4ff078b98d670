"""Plans of whole passes: turns, flips, rewinds, keyholes; and the commands that follow them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.axis_motion import follow
from hillsphere_tracking.pointing.commands import advance_pointing, begin, command_pass
from hillsphere_tracking.pointing.keyhole import best_ramp, corridor, least_error_by_rate
from hillsphere_tracking.pointing.mounts import AxisLimits, Mount, azimuth_elevation, x_y
from hillsphere_tracking.pointing.pass_plan import PassPlan, plan_pass
from hillsphere_tracking.pointing.search import plan_search
from hillsphere_tracking.pointing.sky import angles_of, separation
from hillsphere_tracking.topocentric import direction_cosines

DEGREE = np.pi / 180.0
TIMES: Array = 0.1 * np.arange(-1200.0, 1201.0)


def flyby(
    culmination_deg: float, times_s: Array, heading_deg: float = 20.0, rate_deg_s: float = 0.34
) -> tuple[Array, Array]:
    """Return the angles of a straight, even flight past the station, on its right."""
    h, course = culmination_deg * DEGREE, heading_deg * DEGREE
    along = np.array([np.sin(course), np.cos(course), 0.0])
    side = np.array([np.cos(course), -np.sin(course), 0.0])
    nearest = np.cos(h) * side + np.sin(h) * np.array([0.0, 0.0, 1.0])
    return angles_of(nearest[:, None] + along[:, None] * rate_deg_s * DEGREE * times_s)


def limits(low: float, high: float, rate: float = 5.0, acceleration: float = 2.0) -> AxisLimits:
    return AxisLimits(low * DEGREE, high * DEGREE, rate * DEGREE, acceleration * DEGREE)


def dish(rate: float, top: float = 90.0, low: float = -90.0, high: float = 450.0) -> Mount:
    return azimuth_elevation(limits(low, high, rate), limits(0.0, top))


def _keeps(angle: Array, axis: AxisLimits, period: float = 0.1) -> None:
    move = np.diff(angle)
    assert angle.min() >= axis.lower_rad - 1e-12
    assert angle.max() <= axis.upper_rad + 1e-12
    assert np.abs(move).max() <= axis.rate_rad_s * period * (1.0 + 1e-9)
    assert np.abs(np.diff(move)).max() <= axis.acceleration_rad_s2 * period**2 * (1.0 + 1e-6)


def _reactive(mount: Mount, azimuth: Array, elevation: Array) -> float:
    """Return the largest error of a mount that follows both angles until it cannot."""
    primary, _ = follow(np.unwrap(azimuth), 0.1, mount.primary)
    secondary, _ = follow(elevation, 0.1, mount.secondary)
    error = mount.error(direction_cosines(azimuth, elevation), primary, secondary)
    return float(error.max())


@pytest.mark.parametrize(
    ("culmination_deg", "peak_deg_s"), [(81.3, 2.3), (88.6, 14.0), (89.93, 264.0)]
)
def test_peak_azimuth_rates(culmination_deg: float, peak_deg_s: float) -> None:
    """The flights of these tests are as hard as those of a satellite at 1000 km."""
    times = np.arange(-5.0, 5.0, 1e-3)
    azimuth, _ = flyby(culmination_deg, times)
    rate = np.abs(np.diff(np.unwrap(azimuth))).max() / 1e-3 / DEGREE
    assert rate == pytest.approx(peak_deg_s, rel=0.06)


@pytest.mark.parametrize(
    ("culmination_deg", "rate_deg_s", "planned_deg", "ratio"),
    [
        (81.3, 2.0, 0.30, 0.67),  # both are small
        (86.0, 2.0, 2.73, 0.50),
        (88.6, 5.0, 1.23, 0.50),
        (88.6, 10.0, 0.20, 0.55),
        (89.93, 5.0, 2.17, 0.33),
    ],
)
def test_a_pre_slewed_ramp_halves_the_peak_error(
    culmination_deg: float, rate_deg_s: float, planned_deg: float, ratio: float
) -> None:
    mount = dish(rate_deg_s)
    azimuth, elevation = flyby(culmination_deg, TIMES)
    plan = plan_pass(TIMES, azimuth, elevation, mount)
    _keeps(plan.primary_rad, mount.primary)
    assert plan.error_rad.max() / DEGREE == pytest.approx(planned_deg, rel=0.05)
    assert plan.error_rad.max() <= ratio * _reactive(mount, azimuth, elevation)
    # on target wherever there is no ramp
    assert plan.error_rad[~plan.ramp].max() < 1e-12


def test_the_ramp_is_the_best_there_is() -> None:
    """With rate limits only, no course does better: shown by the gates of its corridor."""
    mount = dish(5.0)
    azimuth, elevation = flyby(88.6, TIMES)
    reference, secondary = np.unwrap(azimuth), elevation
    distance = 0.5 * np.pi - secondary
    bound = least_error_by_rate(TIMES, reference, distance, mount.primary)
    # just below the bound two gates are too far apart for the rate
    low, high = corridor(reference, distance, 0.97 * bound)
    gap = low[None, :] - high[:, None]
    time = TIMES[None, :] - TIMES[:, None]
    assert np.any(np.abs(time) * mount.primary.rate_rad_s < gap)
    # and acceleration costs little more
    middle = slice(700, 1701)
    ramp = best_ramp(TIMES[middle], reference[middle], distance[middle], mount.primary)
    assert ramp is not None
    assert 0.99 * bound <= ramp.error_rad <= 1.2 * bound
    # random other ramps of constant rate never beat it
    for start in np.linspace(-30.0, 0.0, 21):
        rate = mount.primary.rate_rad_s * np.sign(reference[-1] - reference[0])
        course = np.interp(start, TIMES, reference) + rate * np.clip(TIMES - start, 0.0, None)
        towards = np.minimum if rate > 0.0 else np.maximum
        course = np.where(start > TIMES, reference, towards(course, reference[-1]))
        direction = direction_cosines(azimuth, elevation)
        error = mount.error(direction, course, mount.secondary_for(direction, course))
        near = np.abs(TIMES) < 18.0  # by then the satellite is past, wherever the ramp ends
        assert error[near].max() >= 0.99 * bound


def test_a_plunging_mount_goes_over_the_top() -> None:
    azimuth, elevation = flyby(89.93, TIMES)
    over = plan_pass(TIMES, azimuth, elevation, dish(5.0, top=180.0))
    assert over.error_rad.max() / DEGREE < 0.071
    assert over.secondary_rad.max() > 0.6 * np.pi
    assert np.ptp(over.primary_rad) < 15.0 * DEGREE
    _keeps(over.primary_rad, over.mount.primary)
    _keeps(over.secondary_rad, over.mount.secondary)
    # the very zenith costs nothing
    through = plan_pass(TIMES, *flyby(90.0, TIMES), dish(5.0, top=180.0))
    assert through.error_rad.max() < 1e-6


def test_a_mount_that_reaches_beyond_the_zenith_only_is_flipped_always() -> None:
    azimuth, elevation = flyby(40.0, TIMES)
    beyond = azimuth_elevation(limits(-270.0, 270.0), limits(90.0, 180.0))
    plan = plan_pass(TIMES, azimuth, elevation, beyond)
    assert plan.flipped.all()
    assert plan.error_rad.max() < 1e-9
    np.testing.assert_allclose(plan.secondary_rad, np.pi - elevation, atol=1e-9)


def test_an_x_y_mount_has_its_keyhole_on_the_horizon() -> None:
    mount = x_y(limits(-90.0, 90.0, 3.0), limits(-88.0, 88.0, 3.0))
    for culmination in (90.0, 60.0, 20.0):
        for heading in (0.0, 90.0):
            plan = plan_pass(TIMES, *flyby(culmination, TIMES, heading), mount)
            assert plan.error_rad.max() < 1e-10
    # past the end of the X axis, 3° high: X turns by 180° there
    low = plan_pass(TIMES, *flyby(3.0, TIMES, 90.0), mount)
    assert 0.5 * DEGREE < low.error_rad.max() < 2.5 * DEGREE
    _keeps(low.primary_rad, mount.primary)


def test_a_tilt_takes_a_zenith_pass_out_of_the_keyhole() -> None:
    slow = limits(-90.0, 450.0, 3.0)
    azimuth, elevation = flyby(89.93, TIMES)
    upright = plan_pass(TIMES, azimuth, elevation, azimuth_elevation(slow, limits(0.0, 90.0)))
    tilted = azimuth_elevation(slow, limits(0.0, 90.0), 10.0 * DEGREE, 110.0 * DEGREE)
    plan = plan_pass(TIMES, azimuth, elevation, tilted)
    assert upright.error_rad.max() > 3.0 * DEGREE
    assert plan.error_rad.max() < 1e-10


@given(heading=st.floats(0.0, 360.0), culmination=st.floats(10.0, 75.0), left=st.booleans())
@settings(max_examples=8, deadline=None)
def test_with_a_turn_and_a_half_any_pass_fits(
    heading: float, culmination: float, left: bool
) -> None:
    times = TIMES[::10]
    azimuth, elevation = flyby(culmination, times, heading)
    if left:  # the other side of the station: azimuth turns the other way
        azimuth = np.remainder(2.0 * heading * DEGREE - azimuth, 2.0 * np.pi)
    plan = plan_pass(times, azimuth, elevation, dish(5.0, low=-90.0, high=450.0))
    assert plan.error_rad.max() < 1e-10
    assert not plan.ramp.any()
    assert plan.primary_rad.min() / DEGREE >= -90.0
    assert plan.primary_rad.max() / DEGREE <= 450.0


def test_the_turn_near_the_start_is_taken() -> None:
    azimuth, elevation = flyby(60.0, TIMES)
    mount = dish(5.0, low=-400.0, high=800.0)
    turns = [
        plan_pass(TIMES, azimuth, elevation, mount, start * DEGREE).primary_rad[0] / DEGREE
        for start in (-150.0, 200.0, 560.0)
    ]
    first = azimuth[0] / DEGREE
    np.testing.assert_allclose(turns, [first - 360.0, first, first + 360.0], rtol=0, atol=1e-9)


def test_a_stop_in_the_way_costs_one_rewind() -> None:
    azimuth, elevation = flyby(40.0, TIMES, -90.0)  # through north, right at the stops
    mount = dish(5.0, low=0.0, high=360.0)
    plan = plan_pass(TIMES, azimuth, elevation, mount)
    _keeps(plan.primary_rad, mount.primary)
    lost = np.count_nonzero(plan.error_rad > 0.5 * DEGREE) * 0.1
    assert 0.6 * 72.0 < lost < 1.1 * 72.0  # a turn at 5°/s
    assert plan.error_rad[~plan.ramp].max() < 1e-10
    # over the top the same pass needs none
    assert plan_pass(TIMES, azimuth, elevation, dish(5.0, 180.0, 0.0, 360.0)).error_rad.max() < 1e-6


def _stream(plan: PassPlan, prediction: tuple[Array, Array, Array]) -> Array:
    state = begin(
        plan, float(prediction[0][0]), float(plan.primary_rad[0]), float(plan.secondary_rad[0])
    )
    course = [[state.primary.angle_rad[0], state.secondary.angle_rad[0]]]
    last = float(prediction[0][-1])
    while state.time_s < last - 0.05:
        # only what a tracker would have told by now: a few seconds around now
        k = int(np.searchsorted(prediction[0], state.time_s + 1e-6)) - 1
        part = slice(max(k - 1, 0), k + 3)
        near = (prediction[0][part], prediction[1][part], prediction[2][part])
        state = advance_pointing(plan, state, near, 0.1)
        course.append([state.primary.angle_rad[0], state.secondary.angle_rad[0]])
    return np.array(course).T


@pytest.mark.parametrize("top", [90.0, 180.0])
def test_streamed_commands_are_those_of_the_whole_pass(top: float) -> None:
    azimuth, elevation = flyby(88.6, TIMES)
    plan = plan_pass(TIMES, azimuth, elevation, dish(5.0, top))
    prediction = (TIMES[::10], azimuth[::10], elevation[::10])
    commands = command_pass(plan, prediction, 0.1)
    streamed = _stream(plan, prediction)
    whole = np.array([commands.primary_rad, commands.secondary_rad])
    np.testing.assert_allclose(streamed, whole, rtol=0, atol=1e-9)
    for angle, axis in zip(whole, (plan.mount.primary, plan.mount.secondary), strict=True):
        _keeps(angle, axis)
    # 1 Hz predictions at 10 Hz lose nothing of the plan
    error = plan.mount.error(direction_cosines(azimuth, elevation), *whole)
    assert error.max() <= plan.error_rad.max() + 1e-3 * DEGREE


def test_newer_predictions_are_followed_within_the_plan() -> None:
    azimuth, elevation = flyby(70.0, TIMES)
    plan = plan_pass(TIMES, azimuth, elevation, dish(5.0))
    late = flyby(70.0, TIMES - 2.0)  # the satellite is 2 s late
    commands = command_pass(plan, (TIMES, *late), 0.1)
    assert commands.error_rad.max() < 1e-9
    # even with the stored plan's ramp in the way, the error stays near the plan's
    near = plan_pass(TIMES, *flyby(88.6, TIMES), dish(5.0))
    commands = command_pass(near, (TIMES, *flyby(88.6, TIMES - 0.5)), 0.1)
    assert commands.error_rad.max() < near.error_rad.max() + 0.5 * 0.34 * DEGREE
    _keeps(commands.primary_rad, near.mount.primary)


def test_a_search_runs_beside_the_prediction() -> None:
    azimuth, elevation = flyby(50.0, TIMES)
    quick = azimuth_elevation(limits(-90.0, 450.0, 10.0, 20.0), limits(0.0, 90.0, 10.0, 20.0))
    plan = plan_pass(TIMES, azimuth, elevation, quick)
    covariance = np.diag([0.6, 0.2]) ** 2 * DEGREE**2
    search = plan_search(covariance, 0.3 * DEGREE, 0.5 * DEGREE, begin_s=-50.0)
    commands = command_pass(plan, (TIMES, azimuth, elevation), 0.1, search.at)
    pointed = plan.mount.direction(commands.primary_rad, commands.secondary_rad)
    aside = separation(pointed, direction_cosines(azimuth, elevation))
    expected = np.hypot(*search.at(commands.times_s))
    before = commands.times_s < -50.0
    assert aside[before].max() < 1e-9
    # sharp bends of the path take the axes a few samples
    assert np.abs(aside - expected).max() < 0.1 * DEGREE
    assert np.median(np.abs(aside - expected)[~before]) < 1e-6


def test_what_cannot_be_planned() -> None:
    azimuth, elevation = flyby(60.0, TIMES)
    mount = dish(5.0)
    for times, message in (
        (TIMES[:5], "at least 8"),
        (TIMES[::-1], "evenly spaced"),
        (TIMES**3, "evenly spaced"),
    ):
        with pytest.raises(InputError, match=message):
            plan_pass(times, azimuth[: times.size], elevation[: times.size], mount)
    with pytest.raises(InputError, match="finite"):
        plan_pass(TIMES, np.where(TIMES > 0.0, np.nan, azimuth), elevation, mount)


def test_an_antenna_beyond_its_stops_is_not_driven() -> None:
    plan = plan_pass(TIMES, *flyby(60.0, TIMES), dish(5.0))
    with pytest.raises(InputError, match="beyond its stops"):
        begin(plan, 0.0, 500.0 * DEGREE, 0.1)
