"""What all trackers share: their contract, what they see, streaming, and the table."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from sgp4.api import Satrec

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import UT1_IS_UTC, ConstantOrientation
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Tracker
from hillsphere.model.earth.rotation import InertialFrame, earth_fixed, to_earth_fixed, to_inertial
from hillsphere.plugins import load_object
from hillsphere.time import Epoch
from hillsphere_tracking import hillsphere_components
from hillsphere_tracking.kepler import wrap_angle
from hillsphere_tracking.mean_elements import EARTH_FIELD, states
from hillsphere_tracking.satellites import Sgp4Orbit
from hillsphere_tracking.trackers.least_squares import LeastSquares
from hillsphere_tracking.trackers.nominal import nominal_elements
from hillsphere_tracking.trackers.observation import (
    angles,
    compare_directions,
    derivatives,
    directions,
    site_of,
    tangents,
)
from hillsphere_tracking.trackers.specs import LeastSquaresSpec, TableSpec
from hillsphere_tracking.trackers.streaming import StreamingTracker
from hillsphere_tracking.trackers.table import Table

DEGREE = np.pi / 180.0
EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
ALCANTARA = Station("Alcântara", -2.18 * DEGREE, -44.26 * DEGREE, 39.0)
PAPER = np.array([7180e3, 0.0436, *(np.array([23.82, 240.14, 15.47, 350.56]) * DEGREE)])
RISE = 6036.0
SIGMA = 0.1 * DEGREE
SITE = site_of((ALCANTARA,), EPOCH, UT1_IS_UTC)
TRACKERS = [c for c in hillsphere_components() if c.kind == "tracker"]
EXAMPLES = [(c, n) for c in TRACKERS for n in range(len(load_object(c.spec).examples))]


def made(component: Any, number: int) -> Tracker[Any]:
    spec = load_object(component.spec)
    tracker: Tracker[Any] = load_object(component.target)(
        spec.model_validate(spec.examples[number])
    )
    return tracker


def seen(elements: Array, t_s: Array) -> tuple[Array, Array]:
    columns = np.repeat(elements.reshape(6, 1), t_s.size, axis=1)
    return angles(directions(columns, t_s, t_s, SITE, EARTH_FIELD, short_period=True))


def test_all_four_are_registered() -> None:
    assert {c.type for c in TRACKERS} == {"table", "circular", "average", "least_squares"}


@pytest.mark.parametrize(
    ("component", "number"), EXAMPLES, ids=[f"{c.type}-{n}" for c, n in EXAMPLES]
)
def test_contract(component: Any, number: int) -> None:
    # three cases, one of them without measurements, two stations; nearly circular for `circular`
    tracker = made(component, number)
    orbit = PAPER * np.array([1.0, 0.02, 1.0, 1.0, 1.0, 1.0])
    elements = np.repeat(orbit[:, None], 3, axis=1)
    stations = (ALCANTARA, Station("near", -2.1 * DEGREE, -44.2 * DEGREE, 30.0), ALCANTARA)
    state = tracker.initial(elements, np.zeros(1), stations, EPOCH)
    t = RISE + np.arange(0.0, 30.0, 1.0)
    azimuth, elevation = seen(orbit, t)
    for k in range(t.size):
        state = tracker.update(
            state, t[k : k + 1], azimuth[k] + np.array([0.0, 0.0, np.nan]),
            elevation[k] * np.ones(3), np.array(1e-3),
        )  # fmt: skip
    later = RISE + np.array([0.0, 60.0, 120.0, 300.0])
    az, el, covariance = tracker.predict(state, later)
    assert az.shape == el.shape == (4, 3)
    assert covariance.shape == (2, 2, 4, 3)
    assert ((az >= 0.0) & (az < 2.0 * np.pi)).all()
    assert_allclose(covariance, covariance.swapaxes(0, 1), rtol=1e-9, atol=1e-18)
    assert (np.linalg.eigvalsh(covariance.transpose(2, 3, 0, 1)) > 0.0).all()
    true_az, true_el = seen(orbit, later)
    # the case at the right station, with measurements
    off = np.hypot(wrap_angle(az[:, 0] - true_az) * np.cos(true_el), el[:, 0] - true_el)
    assert off.max() < 3.0 * DEGREE
    # one column of times a case is the same thing
    columns = tracker.predict(state, np.repeat(later[:, None], 3, axis=1))
    for a, b in zip(columns, (az, el, covariance), strict=True):
        assert_allclose(a, b, rtol=1e-15)


def test_the_tracker_sees_what_stations_see() -> None:
    t = RISE + np.arange(0.0, 400.0, 50.0)
    orientation = ConstantOrientation(-0.17, 1e-6, 2e-6)
    site = site_of((ALCANTARA,), EPOCH, orientation)
    columns = np.repeat(PAPER[:, None], t.size, axis=1)
    for short_period in (True, False):
        u = directions(columns, t, t, site, EARTH_FIELD, short_period=short_period)
        x = states(PAPER[:, None], t, short_period=short_period)
        fixed = np.einsum("ijn,jn->in", earth_fixed("teme", EPOCH, t, orientation), x[:3])
        away = ALCANTARA.axes @ (fixed - ALCANTARA.ecef_m[:, None])
        assert_allclose(u, away / np.sqrt((away * away).sum(axis=0)), rtol=0, atol=5e-11)


@settings(max_examples=60, deadline=None)
@given(
    e=st.sampled_from([0.0, 1e-9, 0.01, 0.3]),
    i=st.sampled_from([0.0, 1e-6, 0.4, 1.6, 2.5, np.pi]),
    angle=st.floats(0.0, 6.28),
    short_period=st.booleans(),
)
def test_derivatives(e: float, i: float, angle: float, short_period: bool) -> None:
    elements = np.array([9e6, e, i, angle, 2.0, 1.0 + angle])[:, None]
    t = np.array([500.0])

    def look(values: Array) -> Array:
        return directions(
            values[:6], 100.0 + values[6], t + values[6], SITE, EARTH_FIELD,
            short_period=short_period,
        )  # fmt: skip

    at = np.concatenate([elements, np.zeros((1, 1))])
    _, slopes = derivatives(
        elements, np.array([100.0]), t, SITE, EARTH_FIELD, short_period=short_period
    )
    steps = [30.0, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-2]
    for k, step in enumerate(steps):
        if (k == 1 and e < 1e-4) or (k == 2 and not 1e-3 < i < 3.0):
            continue  # e and i have a border there
        shift = np.zeros((7, 1))
        shift[k] = step
        numeric = (look(at + shift) - look(at - shift)) / (2.0 * step)
        assert_allclose(slopes[:, k], numeric, rtol=0, atol=2e-9 / step * 1e-2 + 2e-8)
    # the same, turned to the sky about a measured direction, which biases have moved; that of the
    # elevation is said to be the same wherever the satellite is
    azimuth, elevation, horizon = np.array([1.0 + angle]), np.array([0.7]), 2e-4
    east, north, up = look(at)[:, 0]
    cot = np.hypot(east, north) / max(up, np.sin(np.radians(2.0)))  # of the satellite's elevation
    moved = elevation - 3e-3 + horizon * cot
    shown = np.array([azimuth + 5e-3, moved, [5e-3], [-3e-3], [horizon]])
    off, level2, on_sky = compare_directions(
        elements, np.array([100.0]), t, SITE, shown, EARTH_FIELD, short_period=short_period
    )
    axes = tangents(azimuth, elevation)[:, :, 0]
    assert_allclose(off, axes @ look(at), rtol=0, atol=1e-10)
    rows = [0, 1, 2, 3, 4, 5, 8]
    assert_allclose(on_sky[:, rows, 0], axes @ slopes[:, :, 0], rtol=1e-7, atol=1e-10)
    biases = [[np.cos(0.7), 0.0, 0.0], [0.0, 1.0, cot]]
    assert_allclose(on_sky[:, [6, 7, 9], 0], biases, rtol=1e-6, atol=0)
    assert_allclose(level2, np.cos(0.7) ** 2, rtol=1e-7)


def test_streaming_is_the_batch_of_one() -> None:
    t = RISE + np.arange(0.0, 20.0, 1.0)
    azimuth, elevation = seen(PAPER, t)
    tracker = LeastSquares(LeastSquaresSpec())
    stream = StreamingTracker(tracker, PAPER, 0.0, ALCANTARA, EPOCH, sigma_rad=1e-3)
    state = tracker.initial(PAPER[:, None], np.zeros(1), (ALCANTARA,), EPOCH)
    for k in range(t.size):
        lost = 5 <= k < 10
        if k == 5:
            stream.mark_lost()
        if k == 10:
            stream.mark_locked()
        # while the signal is lost the antenna stands anywhere
        taken = stream.update(t[k], azimuth[k] + lost, elevation[k])
        assert taken is not lost
        assert stream.is_locked is not lost
        if not lost:
            state = tracker.update(
                state, t[k : k + 1], azimuth[k : k + 1], elevation[k : k + 1], np.array(1e-3)
            )
    assert_allclose(stream.state.elements, state.elements, rtol=0, atol=0)
    az, el, covariance = stream.predict(RISE + np.array([30.0, 40.0]))
    batch = tracker.predict(state, RISE + np.array([30.0, 40.0]))
    assert az.shape == el.shape == (2,)
    assert covariance.shape == (2, 2, 2)
    assert_allclose(az, batch[0][:, 0], rtol=0)
    assert_allclose(covariance, batch[2][..., 0], rtol=0)


def test_streaming_takes_a_sigma_for_each_angle() -> None:
    azimuth, elevation = seen(PAPER, np.array([RISE]))
    traces = []
    for sigma in (1e-3, [1e-3, 1e-3], [1e-3, 1.0]):
        stream = StreamingTracker(LeastSquares(LeastSquaresSpec()), PAPER, 0.0, ALCANTARA, EPOCH)
        stream.update(RISE, azimuth[0], elevation[0], sigma)
        traces.append(np.trace(stream.predict(np.array([RISE]))[2][:, :, 0]))
    assert_allclose(traces[0], traces[1], rtol=1e-12)
    assert traces[2] > 2.0 * traces[0]
    with pytest.raises(InputError, match="sigma_rad must be > 0"):
        StreamingTracker(Table(TableSpec()), PAPER, 0.0, ALCANTARA, EPOCH, sigma_rad=0.0)


@pytest.mark.parametrize(("sigma", "most"), [(SIGMA, 0.0), (0.1 * SIGMA, 1.0)])
def test_streaming_tells_of_sigmas_that_do_not_fit(sigma: float, most: float) -> None:
    t = RISE + np.arange(60.0)
    angles_shown = np.array(seen(PAPER, t)) + SIGMA * np.random.default_rng(2).standard_normal(
        (2, t.size)
    )
    stream = StreamingTracker(LeastSquares(LeastSquaresSpec()), PAPER, 0.0, ALCANTARA, EPOCH)
    table = StreamingTracker(Table(TableSpec()), PAPER, 0.0, ALCANTARA, EPOCH)
    shares = []
    for k in range(t.size):
        stream.update(t[k], angles_shown[0, k], angles_shown[1, k], sigma)
        table.update(t[k], angles_shown[0, k], angles_shown[1, k], sigma)
        shares.append(stream.outlier_share)
    assert max(shares[:19]) == 0.0
    assert (0.5 * most) <= shares[-1] <= most
    assert table.outlier_share == 0.0


def test_the_table_learns_nothing() -> None:
    table = Table(TableSpec())
    state = table.initial(PAPER, np.zeros(1), (ALCANTARA,), EPOCH)
    later = table.update(state, np.array([RISE]), np.ones(1), np.ones(1), np.array(1e-3))
    assert later.count[0] == 1.0
    t = np.array([RISE, RISE + 60.0])
    for a, b in zip(table.predict(state, t), table.predict(later, t), strict=True):
        assert_allclose(a, b, rtol=0)
    assert_allclose(table.predict(state, t)[0][:, 0], seen(PAPER, t)[0], rtol=0, atol=1e-12)
    plain = Table(TableSpec(short_period=False)).predict(state, t)
    assert np.abs(plain[1] - table.predict(state, t)[1]).max() > 1e-4


def test_table_covariance_is_that_of_node_and_anomaly() -> None:
    spec = TableSpec(node_sigma_rad=1e-4, mean_anomaly_sigma_rad=2e-4)
    table, cases = Table(spec), 3000
    random = np.random.default_rng(3)
    elements = np.repeat(PAPER[:, None], cases, axis=1)
    elements[3] += 1e-4 * random.standard_normal(cases)
    elements[5] += 2e-4 * random.standard_normal(cases)
    t = np.array([RISE + 200.0])
    state = table.initial(elements, np.zeros(1), (ALCANTARA,), EPOCH)
    azimuth, elevation, covariance = table.predict(state, t)
    sky = np.array([azimuth[0] * np.cos(elevation[0].mean()), elevation[0]])
    assert_allclose(np.cov(sky), covariance[:, :, 0].mean(axis=-1), rtol=0.08)


class Turned:
    """An orbit of the frame ``teme`` as seen from ``gcrs``."""

    name = "turned"
    frame: InertialFrame = "gcrs"

    def __init__(self, orbit: Sgp4Orbit) -> None:
        self.orbit, self.epoch = orbit, orbit.epoch

    def states(self, t_s: Array) -> Array:
        fixed = to_earth_fixed("teme", self.orbit.states(t_s), self.epoch, t_s)
        return to_inertial("gcrs", fixed, self.epoch, t_s)


def test_nominal_elements_follow_a_two_line_element_set() -> None:
    # TLE of the International Space Station, 2019
    satellite = Satrec.twoline2rv(
        "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991",
        "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482",
    )
    orbit = Sgp4Orbit("ISS", Epoch(satellite.jdsatepoch, satellite.jdsatepochF, "UTC"), satellite)
    t = np.array([23400.0])
    elements = nominal_elements(orbit, t)
    since = np.arange(0.0, 901.0, 100.0)
    off = states(elements, since)[:3] - orbit.states(t + since)[:3]
    assert np.abs(off).max() < 40.0
    assert_allclose(states(elements, np.zeros(1)), orbit.states(t), rtol=0, atol=1e-6)
    turned = nominal_elements(Turned(orbit), t)
    here, there = states(turned, np.zeros(1)), states(elements, np.zeros(1))
    assert_allclose(here[:3], there[:3], rtol=0, atol=1e-5)
    # the two frames turn at rates that differ by 7e-12 rad/s
    assert_allclose(here[3:], there[3:], rtol=0, atol=1e-3)


def test_refusals() -> None:
    table = Table(TableSpec())
    two = np.repeat(PAPER[:, None], 2, axis=1)
    with pytest.raises(InputError, match="needs a station"):
        site_of((), EPOCH, UT1_IS_UTC)
    with pytest.raises(InputError, match="one or 2, one a case; got 3"):
        table.initial(two, np.zeros(1), (ALCANTARA,) * 3, EPOCH)
    with pytest.raises(InputError, match="times of the elements"):
        table.initial(two, np.array([np.nan]), (ALCANTARA,), EPOCH)
    with pytest.raises(InputError, match="eccentricities"):
        table.initial(two + np.array([[0], [1], [0], [0], [0], [0]]), np.zeros(1), (ALCANTARA,),
                      EPOCH)  # fmt: skip
    state = table.initial(two, np.zeros(1), (ALCANTARA,), EPOCH)
    one = np.ones(1)
    with pytest.raises(InputError, match=r"az_rad must be one number or \(2,\)"):
        table.update(state, one, np.ones(3), one, one)
    with pytest.raises(InputError, match="times of measurements must be finite"):
        table.update(state, np.array([np.inf]), one, one, one)
    with pytest.raises(InputError, match=r"times must be finite, \(K,\) or \(K, 2\)"):
        table.predict(state, np.ones((3, 5)))


def test_without_its_biases_a_prediction_is_where_the_satellite_is() -> None:
    tracker = LeastSquares(LeastSquaresSpec())
    state = tracker.initial(PAPER.reshape(6, 1), np.zeros(1), (ALCANTARA,), EPOCH)
    biases = np.array([6e-3, -2e-3])
    told = tracker.with_biases(state, biases, 1e-10 * np.eye(2))
    t = RISE + np.array([0.0, 100.0, 300.0])
    shown, true = (np.array(tracker.predict(told, t, biased=b)[:2])[:, :, 0] for b in (True, False))
    assert_allclose(wrap_angle(shown - true), np.repeat(biases[:, None], 3, axis=1), rtol=1e-9)
    nominal = np.array(tracker.predict(state, t)[:2])[:, :, 0]
    assert_allclose(true, nominal, rtol=1e-14)
    # the biases' spread, 0.2° at the start, is that of the angles shown only
    with_them, without = (tracker.predict(state, t, biased=b)[2][1, 1, :, 0] for b in (True, False))
    spread = (0.2 * DEGREE) ** 2 + (0.01 * DEGREE / np.tan(true[1])) ** 2
    assert_allclose(with_them - without, spread, rtol=1e-6)


@pytest.mark.parametrize(
    ("component", "number"), EXAMPLES, ids=[f"{c.type}-{n}" for c, n in EXAMPLES]
)
def test_trackers_say_whether_they_add_short_period_terms(component: Any, number: int) -> None:
    given = load_object(component.spec).examples[number]
    default = component.type in ("table", "least_squares")
    assert made(component, number).short_period is given.get("short_period", default)
