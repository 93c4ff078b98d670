"""Search after a loss: what it covers, how long it takes; probabilities against Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import erf

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.mounts import AxisLimits, azimuth_elevation, x_y
from hillsphere_tracking.pointing.reacquisition import (
    expected_time_outside,
    lock_probability,
    reacquisition,
    time_outside,
)
from hillsphere_tracking.pointing.search import Search, plan_search, search_now, search_speed
from hillsphere_tracking.pointing.sky import angles_of, parallel_transport

DEGREE = np.pi / 180.0
BEAM = 0.5 * DEGREE
SPEED = 1.0 * DEGREE


def test_a_search_is_not_renewed_by_the_turn_of_the_azimuth() -> None:
    """Past the zenith at 88°: azimuth swings by half a turn, the ellipse stays along the track."""
    along = np.linspace(-30.0, 30.0, 601) * DEGREE
    aside = 2.0 * DEGREE
    place = np.array([np.cos(aside) * np.sin(along), np.full(601, np.sin(aside)),
                      np.cos(aside) * np.cos(along)])  # fmt: skip
    azimuth, elevation = angles_of(place)
    track = np.gradient(place, axis=1) / np.gradient(along)
    right = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0 * azimuth])
    up = np.cross(right, place, axis=0)
    major = np.array([np.sum(right * track, axis=0), np.sum(up * track, axis=0)])
    covariance = DEGREE**2 * (
        np.einsum("ik,jk->ijk", major, major) + 0.01 * np.eye(2)[:, :, np.newaxis]
    )
    turned = parallel_transport(azimuth, elevation)
    assert np.ptp(turned) > 2.0  # rad
    first = search_now(None, covariance[:, :, 0], BEAM, SPEED, 0.0)
    assert first is not None
    kept = [
        search_now(first, covariance[:, :, k], BEAM, SPEED, 1.0 * k, turned_rad=turned[k]) is first
        for k in range(601)
    ]
    assert all(kept)
    # without the turn it would begin again
    assert search_now(first, covariance[:, :, 300], BEAM, SPEED, 300.0) is not first
    # and its path stays along the track
    arcs = np.array(first.at(np.full(601, 2.0), turned))
    across = arcs[0] * major[1] - arcs[1] * major[0]
    assert np.hypot(*arcs).min() > 0.5 * DEGREE
    np.testing.assert_allclose(across, 0.0, rtol=0, atol=0.05 * np.hypot(*arcs).max())


def _covariance(major_deg: float, minor_deg: float, turn: float) -> Array:
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, -s], [s, c]])
    return np.asarray(axes @ np.diag([major_deg**2, minor_deg**2]) @ axes.T * DEGREE**2)


@given(
    major=st.floats(0.01, 1.5),
    ratio=st.floats(0.0, 1.0),
    turn=st.floats(0.0, 3.2),
    overlap=st.sampled_from([0.15, 0.293, 0.6]),
)
@settings(max_examples=20, deadline=None)
def test_the_search_covers_three_sigmas(
    major: float, ratio: float, turn: float, overlap: float
) -> None:
    covariance = _covariance(major, ratio * major, turn)
    search = plan_search(covariance, BEAM, SPEED, overlap=overlap)
    radius = np.sqrt(np.linspace(0.0, 9.0, 20))
    angle = np.linspace(0.0, 2.0 * np.pi, 40)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    ring = np.array([np.cos(angle), np.sin(angle)])
    points = (root @ ring)[:, None, :] * radius[None, :, None]
    away = np.linalg.norm(points[..., None] - search.path_rad[:, None, None, ::6], axis=0)
    # within half a pitch, which is less than the beam; five points of the path left out are 0.125
    assert away.min(axis=-1).max() <= BEAM * (1.0 - overlap + 0.13)
    # path and speed
    step = np.hypot(*np.diff(search.path_rad, axis=1))
    np.testing.assert_allclose(np.diff(search.along_rad), step, rtol=0, atol=1e-12)
    assert np.all(search.path_rad[:, 0] == 0.0)
    assert np.all(step <= 0.1 * BEAM)


def test_the_search_wastes_little() -> None:
    """Length against the area of the ellipse over the pitch: what any search must at least do."""
    for major, minor in ((1.0, 1.0), (2.0, 0.5), (3.0, 1.0)):
        search = plan_search(_covariance(major, minor, 0.3), BEAM, SPEED)
        area = np.pi * 9.0 * major * minor * DEGREE**2
        length = search.along_rad[-1]
        assert 0.8 * area / (np.sqrt(2.0) * BEAM) < length < 2.0 * area / (np.sqrt(2.0) * BEAM)


def test_no_search_where_the_beam_holds_all() -> None:
    search = plan_search(_covariance(0.1, 0.1, 0.0), BEAM, SPEED)
    assert search.duration_s == 0.0
    assert np.array(search.at(np.array([0.0, 5.0]))).tolist() == [[0.0, 0.0], [0.0, 0.0]]


def test_the_search_goes_along_the_major_axis() -> None:
    search = plan_search(_covariance(2.0, 0.05, 0.5 * np.pi), BEAM, SPEED, begin_s=10.0)
    right, up = search.at(np.array([5.0, 10.0, 12.0, 10.0 + search.duration_s]))
    np.testing.assert_allclose(right, 0.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        np.abs(up[:3]), np.array([0.0, 0.0, 2.0]) * DEGREE, rtol=1e-6, atol=0
    )
    # to the other end, and back the same way
    assert np.sign(up[3]) == -np.sign(up[2])
    later = search.at(np.array([10.0 + 2.0 * search.duration_s - 2.0]))[1]
    np.testing.assert_allclose(later, up[2], rtol=1e-6)


def test_a_search_is_renewed_as_the_error_grows() -> None:
    small = _covariance(0.1, 0.05, 0.3)
    assert search_now(None, small, BEAM, SPEED, 5.0) is None  # 3σ within the beam
    covariance = _covariance(1.0, 0.1, 0.3)
    first = search_now(None, covariance, BEAM, SPEED, 5.0, dwell_s=1.0)
    assert first is not None
    assert (first.begin_s, first.dwell_s) == (5.0, 1.0)

    def later(covariance_rad2: Array) -> Search | None:
        return search_now(first, covariance_rad2, BEAM, SPEED, 60.0, dwell_s=1.0)

    assert later(1.4**2 * covariance) is first
    assert later(0.5 * covariance) is first
    # what stays far within the beam does not count
    assert later(_covariance(1.0, 0.15, 0.3)) is first
    assert later(small) is None
    for grown in (1.7**2 * covariance, _covariance(1.0, 0.1, 1.0), _covariance(1.0, 0.6, 0.3)):
        new = later(grown)
        assert new is not None
        assert new is not first
        assert new.begin_s == 60.0
        assert reacquisition(new, grown).found > 0.98


@pytest.mark.parametrize(("major", "minor"), [(30.0, 10.0), (10.0, 0.0), (3.0, 3.0), (1.0, 0.2)])
def test_a_search_keeps_to_the_time_left(major: float, minor: float) -> None:
    covariance = _covariance(major, minor, 0.3)
    whole = plan_search(covariance, BEAM, SPEED, dwell_s=1.0)
    short = search_now(None, covariance, BEAM, SPEED, 0.0, within_s=60.0, dwell_s=1.0)
    assert short is not None
    if whole.duration_s < 60.0:
        assert short.duration_s == whole.duration_s
        return
    assert 30.0 < short.duration_s < 75.0
    assert short.sigmas < 3.0


def test_search_speed_leaves_half_of_the_axes() -> None:
    fast = AxisLimits(-1.5, 1.5, 8.0 * DEGREE, 100.0)
    level = search_speed(azimuth_elevation(fast, fast), 0.0, BEAM)
    assert level == pytest.approx(4.0 * DEGREE)
    # the azimuth axis moves the beam by the cosine of the elevation
    high = search_speed(azimuth_elevation(fast, fast), 60.0 * DEGREE, BEAM)
    assert high == pytest.approx(2.0 * DEGREE)
    assert search_speed(x_y(fast, fast), 0.5 * np.pi, BEAM) > 0.0
    # in a bend of half a beam's radius a quarter of the acceleration
    weak = AxisLimits(-1.5, 1.5, 8.0 * DEGREE, 1.0 * DEGREE)
    speed = search_speed(azimuth_elevation(weak, weak), 0.0, BEAM)
    assert speed**2 / (0.5 * BEAM) == pytest.approx(0.25 * DEGREE)


def test_speed_is_held_down_for_the_dwell() -> None:
    covariance = _covariance(1.0, 0.5, 0.0)
    fast = plan_search(covariance, BEAM, SPEED)
    slow = plan_search(covariance, BEAM, SPEED, dwell_s=2.0)
    assert fast.speed_rad_s == SPEED
    # half-way between tracks, √2 b apart, the chord is √2 b
    assert slow.speed_rad_s == pytest.approx(np.sqrt(2.0) * BEAM / 2.0, rel=1e-12)
    times = np.linspace(0.0, slow.duration_s, 4000)
    speed = np.hypot(*np.diff(slow.at(times), axis=1)) / np.diff(times)
    assert speed.max() <= slow.speed_rad_s * (1.0 + 1e-9)
    found = reacquisition(slow, covariance).found
    # what lies within 3σ, and what beyond is in the beam for less than the dwell
    within = -np.expm1(-4.5)
    assert found == pytest.approx(within, abs=0.003)
    assert reacquisition(fast, covariance).found > within


@pytest.mark.parametrize(
    ("major", "minor", "dwell"), [(0.5, 0.5, 0.0), (1.0, 0.2, 0.0), (0.8, 0.3, 0.3)]
)
def test_time_to_reacquire_against_monte_carlo(major: float, minor: float, dwell: float) -> None:
    """Errors drawn at random, and the search flown in time steps past each of them."""
    covariance = _covariance(major, minor, 0.7)
    search = plan_search(covariance, BEAM, SPEED, dwell_s=dwell)
    found = reacquisition(search, covariance)
    random = np.random.default_rng(11)
    errors = random.multivariate_normal([0.0, 0.0], covariance, 3000).T
    step = 0.02
    times = np.arange(0.0, search.duration_s + dwell + step, step)
    right, up = search.at(np.minimum(times, search.duration_s))
    inside = np.hypot(errors[0] - right[:, None], errors[1] - up[:, None]) <= BEAM
    held = np.zeros(3000)
    when = np.full(3000, np.inf)
    for k, time in enumerate(times):
        held = np.where(inside[k], held + step, 0.0)
        when = np.where((held > dwell) & np.isinf(when), time, when)
    for within in np.linspace(0.0, search.duration_s, 9):
        expected = np.mean(when <= within + 0.5 * step)
        assert float(found.probability(within)) == pytest.approx(expected, abs=0.03)
    for probability in (0.5, 0.8, 0.95):
        by_then = np.mean(when <= found.quantile(probability) + 0.5 * step)
        assert by_then == pytest.approx(probability, abs=0.03)
    assert found.mean_s == pytest.approx(when[np.isfinite(when)].mean(), rel=0.07)


def test_what_is_found_at_once_is_the_probability_of_lock() -> None:
    covariance = _covariance(0.8, 0.3, 0.7)
    search = plan_search(covariance, BEAM, SPEED)
    mean = np.array([0.2, -0.1]) * DEGREE
    at_once = reacquisition(search, covariance, mean).probability(0.0)
    expected = lock_probability(covariance, BEAM, mean)
    np.testing.assert_allclose(at_once, expected, rtol=0, atol=0.003)


def test_lock_probability_of_exact_cases() -> None:
    # round: Rayleigh; a line: the error function
    sigma = np.array([0.05, 0.3, 1.0, 20.0])
    rounds = np.eye(2)[:, :, None] * (sigma * DEGREE) ** 2
    np.testing.assert_allclose(
        lock_probability(rounds, BEAM), -np.expm1(-0.5 * (0.5 / sigma) ** 2), rtol=1e-9, atol=1e-12
    )
    lines = np.diag([1.0, 0.0])[:, :, None] * (sigma * DEGREE) ** 2
    np.testing.assert_allclose(
        lock_probability(lines, BEAM), erf(0.5 / sigma / np.sqrt(2.0)), rtol=1e-9
    )


@pytest.mark.parametrize(
    ("major", "minor", "mean_deg"),
    [(1.0, 0.3, (0.0, 0.0)), (0.4, 0.1, (0.3, 0.2)), (0.05, 0.04, (0.35, 0.33))],
)
def test_lock_probability_against_monte_carlo(
    major: float, minor: float, mean_deg: tuple[float, float]
) -> None:
    covariance, mean = _covariance(major, minor, 2.0), np.array(mean_deg) * DEGREE
    errors = np.random.default_rng(2).multivariate_normal(mean, covariance, 200_000)
    inside = np.mean(np.hypot(*errors.T) < BEAM)
    # four standard deviations of the sample
    np.testing.assert_allclose(
        lock_probability(covariance, BEAM, mean), inside, rtol=0, atol=4.0 * 0.5 / np.sqrt(200_000)
    )


def test_time_outside() -> None:
    times = np.array([0.0, 1.0, 2.0, 4.0])
    errors = np.array([[0.0, 2.0, 2.0, 0.0], [1.0, 1.0, 1.0, 1.0], [3.0, 3.0, 3.0, 3.0]]).T
    found = time_outside(times, errors, 1.0)
    # the last interval, 2 s long, is outside for the half of it
    np.testing.assert_allclose(found, [0.5 + 1.0 + 1.0, 0.0, 4.0], rtol=1e-12)
    probability = np.array([1.0, 0.5, 0.5, 0.0])
    assert float(expected_time_outside(times, probability)) == pytest.approx(0.25 + 0.5 + 1.5)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"beam_rad": 0.0}, "beam"),
        ({"speed_rad_s": np.inf}, "speed"),
        ({"covariance_rad2": np.array([[1.0, 2.0], [2.0, 1.0]])}, "positive"),
        ({"covariance_rad2": np.full((2, 2), np.nan)}, "finite"),
        ({"overlap": 1.0}, "overlap"),
    ],
)
def test_searches_that_cannot_be(keys: dict[str, object], message: str) -> None:
    good: dict[str, object] = {
        "covariance_rad2": np.eye(2) * BEAM**2, "beam_rad": BEAM, "speed_rad_s": SPEED,
    }  # fmt: skip
    with pytest.raises(InputError, match=message):
        plan_search(**{**good, **keys})  # type: ignore[arg-type]
