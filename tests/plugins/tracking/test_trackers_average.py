"""The averager against Kuga's and Carrara's passes, and where it is at its limits."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from hillsphere import symbolic as sy
from hillsphere.base.geodetic import Station
from hillsphere.dynamics import ArrayFunction
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import earth_angle, earth_fixed
from hillsphere.time import Epoch
from hillsphere_gravity.icgem import read_icgem
from hillsphere_tracking.kepler import elements_from_states, wrap_angle
from hillsphere_tracking.mean_elements import ZonalField, propagate_secular, states
from hillsphere_tracking.trackers.average import Average, AverageState, Circular
from hillsphere_tracking.trackers.observation import angles
from hillsphere_tracking.trackers.specs import AverageSpec

DEGREE = np.pi / 180.0
EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
ALCANTARA = Station("Alcântara", -2.18 * DEGREE, -44.26 * DEGREE, 39.0)
# Kuga and Carrara (1990), section 5, as Brouwer's mean elements
PAPER = np.array([7180e3, 0.0436, *(np.array([23.82, 240.14, 15.47, 350.56]) * DEGREE)])
FIELD = Path(__file__).parents[3] / "missions" / "data" / "earth-gravity-degree6.gfc"
NO_FIELD = ZonalField(j2=0.0, j4=0.0)


def seen(station: Station, x: Array, t: Array) -> tuple[Array, Array]:
    fixed = np.einsum("ijn,jn->in", earth_fixed("teme", EPOCH, t), x[:3])
    away = station.axes @ (fixed - station.ecef_m[:, None])
    return angles(away / np.sqrt((away * away).sum(axis=0)))


class Pass(NamedTuple):
    t: Array
    x: Array
    azimuth: Array
    elevation: Array


@pytest.fixture(scope="module")
def passes() -> tuple[Pass, Pass]:
    """Fly passes 2 and 7 over Alcântara: zonals to degree 6, tesserals 4 × 4, no drag."""
    table = read_icgem(FIELD)
    rows = [(r.c, r.s) if r.m == 0 or r.n <= 4 else (0.0, 0.0) for r in table.rows]
    place = sy.variables("x", "y", "z")
    potential = sy.spherical_harmonics_potential(
        (place[0], place[1], place[2]), rows, table.gm_m3_s2, table.reference_radius_m
    )
    pull = ArrayFunction(sy.gradient(potential, place), place)
    angle = float(earth_angle("teme", EPOCH, np.zeros(1))[0])

    def slope(t: float, x: Array) -> Array:
        turn = angle + 7.2921158553e-5 * t
        c, s = np.cos(turn), np.sin(turn)
        a = pull(np.array([c * x[0] + s * x[1], c * x[1] - s * x[0], x[2]]))
        return np.array([*x[3:], c * a[0] - s * a[1], s * a[0] + c * a[1], a[2]])

    t = np.concatenate([6036.0 + np.arange(453.0), 38370.0 + np.arange(926.0)])
    start = states(PAPER[:, None], np.zeros(1))[:, 0]
    flown = solve_ivp(
        slope, (0.0, t[-1]), start, method="DOP853", rtol=1e-10, atol=1e-3, t_eval=t
    ).y
    azimuth, elevation = seen(ALCANTARA, flown, t)
    return (
        Pass(t[:453], flown[:, :453], azimuth[:453], elevation[:453]),
        Pass(t[453:], flown[:, 453:], azimuth[453:], elevation[453:]),
    )


def tracked(tracker: Average, flown: Pass, nominal: Array, count: int) -> AverageState:
    state = tracker.initial(nominal, flown.t[:1], (ALCANTARA,), EPOCH)
    for k in range(count):
        state = tracker.update(
            state, flown.t[k : k + 1], flown.azimuth[k : k + 1], flown.elevation[k : k + 1],
            np.array([1e-3]),
        )  # fmt: skip
    return state


# Constants and the rest of the field move the values by up to 1e-2°.
@pytest.mark.parametrize(
    ("number", "count", "first", "node", "mean"),
    [
        (0, 60, (284.031369, 5.048786), 239.724871, 353.588970),
        (1, 300, (316.156110, 5.044038), 237.400213, 130.749915),
    ],
)
def test_error_free_passes_of_kuga_carrara_1990(
    passes: tuple[Pass, Pass],
    number: int,
    count: int,
    first: tuple[float, float],
    node: float,
    mean: float,
) -> None:
    flown = passes[number]
    assert_allclose(np.degrees([flown.azimuth[0], flown.elevation[0]]), first, rtol=0, atol=1e-2)
    osculating = elements_from_states(flown.x[:, :1], 398600.4418e9)
    state = tracked(Average(AverageSpec()), flown, osculating, count)
    assert state.count[0] == count
    found = np.degrees(np.remainder(state.elements[[3, 5], 0], 2.0 * np.pi))
    assert_allclose(found, [node, mean], rtol=0, atol=1e-2)


def test_largest_error_of_pass_2(passes: tuple[Pass, Pass]) -> None:
    flown = passes[0]
    osculating = elements_from_states(flown.x[:, :1], 398600.4418e9)
    tracker = Average(AverageSpec())
    state = tracked(tracker, flown, osculating, 60)
    azimuth, elevation, covariance = tracker.predict(state, flown.t[60:])
    off_azimuth = np.degrees(wrap_angle(azimuth[:, 0] - flown.azimuth[60:]))
    off_elevation = np.degrees(elevation[:, 0] - flown.elevation[60:])
    assert_allclose(np.hypot(off_azimuth, off_elevation).max(), 0.1266, rtol=0, atol=2e-3)
    off_sky = off_azimuth * np.cos(elevation[:, 0])
    assert_allclose(np.hypot(off_sky, off_elevation).max(), 0.1226, rtol=0, atol=2e-3)
    assert covariance.shape == (2, 2, 393, 1)
    assert (np.linalg.eigvalsh(covariance[..., 0].T) > 0.0).all()


# Elements whose two-body motion the averager knows exactly: a planet without J2.
SPEC = AverageSpec(j2=0.0, j4=0.0)


def two_body(elements: Array, station: Station, t: Array) -> tuple[Array, Array]:
    return seen(station, states(elements[:, None], t, NO_FIELD, short_period=False), t)


def overhead(elements: Array, latitude_rad: float = 0.0) -> Station:
    """Return the station below the satellite at t = 0, moved in latitude."""
    x = states(elements[:, None], np.zeros(1), NO_FIELD, short_period=False)
    fixed = earth_fixed("teme", EPOCH, np.zeros(1))[:, :, 0] @ x[:3, 0]
    below = Station.at("below", fixed)
    return Station("below", below.latitude_rad + latitude_rad, below.longitude_rad)


@pytest.mark.parametrize(
    ("e", "i", "perigee", "mean"),
    [
        (0.0436, 0.4, 0.3, 0.2),  # ascending
        (0.0436, 0.4, 0.3, 3.0),  # descending
        (0.0, 0.9, 0.0, 0.3),  # circular
        (0.1, 1.7, 2.0, 0.1),  # retrograde
        (0.01, 2.8, 1.0, -0.6),  # strongly retrograde
        (0.6, 1.1, 4.7, 0.9),  # high
    ],
)
def test_one_measurement_gives_back_node_and_anomaly(
    e: float, i: float, perigee: float, mean: float
) -> None:
    truth = np.array([7.4e6 / (1.0 - e), e, i, 6.2, perigee, mean])
    station = overhead(truth, 0.1)
    t = np.array([20.0])
    azimuth, elevation = two_body(truth, station, t)
    assert elevation[0] > 0.0
    nominal = truth + np.array([0.0, 0.0, 0.0, 0.05, 0.0, -0.03])
    tracker = Average(SPEC)
    state = tracker.update(
        tracker.initial(nominal, np.zeros(1), (station,), EPOCH), t, azimuth, elevation,
        np.ones(1),
    )  # fmt: skip
    now = propagate_secular(truth[:, None], t, NO_FIELD)
    assert_allclose(wrap_angle(state.elements - now), 0.0, rtol=0, atol=1e-10)
    assert state.count[0] == 1.0


def test_means_wrap() -> None:
    truth = np.array([7.4e6, 0.02, 0.9, 1e-4, 0.0, 2.0 * np.pi - 1e-4])
    station = overhead(truth, 0.05)
    t = np.arange(0.0, 60.0, 1.0)
    azimuth, elevation = two_body(truth, station, t)
    random = np.random.default_rng(2)
    tracker = Average(SPEC)
    state = tracker.initial(truth, np.zeros(1), (station,), EPOCH)
    for k in range(t.size):
        noise = 1e-3 * random.standard_normal(2)
        state = tracker.update(
            state, t[k : k + 1], azimuth[k] + noise[:1], elevation[k] + noise[1:], np.ones(1)
        )
    now = propagate_secular(truth[:, None], t[-1:], NO_FIELD)
    assert_allclose(wrap_angle(state.elements - now)[[3, 5]], 0.0, rtol=0, atol=2e-4)


def test_scatter_gives_the_covariance_of_the_means() -> None:
    truth = np.array([7.4e6, 0.02, 0.9, 1.0, 0.0, 0.6])
    station, cases = overhead(truth, 0.05), 400
    t = np.arange(0.0, 30.0, 1.0)
    azimuth, elevation = two_body(truth, station, t)
    random = np.random.default_rng(5)
    tracker = Average(SPEC)
    state = tracker.initial(np.repeat(truth[:, None], cases, 1), np.zeros(1), (station,), EPOCH)
    for k in range(t.size):
        noise = 1e-3 * random.standard_normal((2, cases))
        state = tracker.update(
            state, t[k : k + 1], azimuth[k] + noise[0], elevation[k] + noise[1], np.ones(1)
        )
    later = np.array([60.0])
    az, el, covariance = tracker.predict(state, later)
    true_az, true_el = two_body(truth, station, later)
    off = np.array([wrap_angle(az - true_az) * np.cos(el), el - true_el])[:, 0]
    assert_allclose(np.cov(off), covariance[:, :, 0].mean(axis=-1), rtol=0.2, atol=2e-8)


@pytest.mark.parametrize("tracker", [Average(AverageSpec()), Circular(AverageSpec())])
@pytest.mark.parametrize("i", [0.0, 1e-6, 0.4, np.pi - 1e-6, np.pi])
@pytest.mark.parametrize("e", [0.0, 0.05])
def test_stays_finite_at_the_extremes(tracker: Average, e: float, i: float) -> None:
    # from a quarter of a revolution to a half: through the extreme of latitude
    truth = np.array([7.4e6, e, i, 1.0, 0.2, 1.3])
    station = overhead(truth)
    t = np.arange(-60.0, 60.0, 2.0)
    azimuth, elevation = seen(station, states(truth[:, None], t), t)
    random = np.random.default_rng(2)
    state = tracker.initial(truth, np.zeros(1), (station,), EPOCH)
    for k in range(t.size):
        noise = 2e-3 * random.standard_normal(2)
        state = tracker.update(
            state, t[k : k + 1], azimuth[k] + noise[:1], elevation[k] + noise[1:], np.ones(1)
        )
    assert np.isfinite(state.elements).all()
    for part in tracker.predict(state, t):
        assert np.isfinite(part).all()


def test_circular_orbit_is_tracked_by_its_argument_of_latitude() -> None:
    truth = np.array([7.4e6, 0.0, 0.9, 1.0, 0.7, 0.1])
    station = overhead(truth, 0.05)
    t = np.arange(0.0, 60.0, 1.0)
    azimuth, elevation = two_body(truth, station, t)
    tracker = Circular(SPEC)
    nominal = truth + np.array([0.0, 0.0, 0.0, 0.02, 0.0, 0.02])
    state = tracker.initial(nominal, np.zeros(1), (station,), EPOCH)
    for k in range(t.size):
        state = tracker.update(
            state, t[k : k + 1], azimuth[k : k + 1], elevation[k : k + 1], np.ones(1)
        )
    later = np.arange(60.0, 200.0, 10.0)
    az, el, _ = tracker.predict(state, later)
    true_az, true_el = two_body(truth, station, later)
    assert_allclose(wrap_angle(az[:, 0] - true_az), 0.0, rtol=0, atol=1e-8)
    assert_allclose(el[:, 0], true_el, rtol=0, atol=1e-8)


def test_measurements_that_meet_no_orbit_are_left_out() -> None:
    truth = np.array([7.4e6, 0.02, 0.9, 1.0, 0.0, 0.6])
    station = overhead(truth, 0.05)
    tracker = Average(SPEC)
    start = tracker.initial(np.repeat(truth[:, None], 3, 1), np.zeros(1), (station,), EPOCH)
    azimuth, elevation = two_body(truth, station, np.zeros(1))
    az = np.array([azimuth[0], np.nan, azimuth[0]])
    el = np.array([elevation[0], elevation[0], np.inf])
    state = tracker.update(start, np.zeros(1), az, el, np.ones(1))
    assert_allclose(state.count, [1.0, 0.0, 0.0], atol=0)
    assert_allclose(state.elements[:, 1:], start.elements[:, 1:], rtol=0, atol=1e-9)
    assert_allclose(state.elements[:, 0], start.elements[:, 0], rtol=1e-12)


def start_of(tracker: Average, elements: Array, station: Station, cases: int = 1) -> AverageState:
    return tracker.initial(
        np.repeat(elements[:, None], cases, axis=1), np.zeros(1), (station,), EPOCH
    )


@pytest.mark.parametrize(("e", "i"), [(0.0, 0.3), (0.25, 0.9), (0.3, 1.3)])
def test_mean_anomaly_drifts_at_the_rate_of_kozai(e: float, i: float) -> None:
    """N (1 + 3/2 J2 (R/a)² (1 − 3/2 sin² i)/(1 − e²)^1.5), Kuga and Carrara (1990), eq. 20.

    A measurement that is no number leaves the prediction as it is. The node rests: between the
    measurements of a pass it is a mean.
    """
    j2, radius, gm = 1e-3, 6.4e6, 4e14
    tracker = Average(AverageSpec(j2=j2, j4=0.0, equatorial_radius_m=radius, gm_m3_s2=gm))
    a = 7.6e6 / (1.0 - e)
    nominal = np.array([a, e, i, 1.0, 0.4, 0.3])
    station = overhead(nominal, 0.05)
    azimuth, elevation = two_body(nominal, station, np.zeros(1))
    first = tracker.update(
        start_of(tracker, nominal, station), np.zeros(1), azimuth, elevation, np.ones(1)
    )
    n = np.sqrt(gm / a**3)
    flat = 1.5 * j2 * (radius / a) ** 2 * (1.0 - 1.5 * np.sin(i) ** 2)
    rate = n * (1.0 + flat / (1.0 - e**2) ** 1.5)
    for dt in (100.0, 40_000.0):
        later = tracker.update(first, np.array([dt]), azimuth * np.nan, elevation, np.ones(1))
        assert_allclose(later.elements[5] - first.elements[5], rate * dt, rtol=1e-12)
        assert_allclose(np.delete(later.elements - first.elements, 5, 0), 0.0, atol=0)
        assert later.count[0] == 1.0
        assert later.t_s[0] == dt


def solved_alone(
    tracker: Average, nominal: Array, station: Station, t: Array, az: Array, el: Array
) -> Array:
    """Return Ω and M (2, K) of each measurement by itself, M at its own time."""
    found = []
    for k in range(t.size):
        state = tracker.update(
            start_of(tracker, nominal, station), t[k : k + 1], az[k : k + 1], el[k : k + 1],
            np.ones(1),
        )  # fmt: skip
        found.append(state.elements[[3, 5], 0])
    return np.array(found).T


def test_means_weigh_every_measurement_alike() -> None:
    """Ω, M carried to one time: arithmetic means, and the sums of squares about them.

    The first of them replaces the nominal values: a nominal orbit far off leaves no trace.
    """
    truth = np.array([7.4e6, 0.02, 0.9, 1.0, 0.3, 0.6])
    nominal = truth + np.array([0.0, 0.0, 0.0, 0.04, 0.0, -0.03])
    station, count = overhead(truth, 0.05), 7
    t = np.array([0.0, 1.0, 4.0, 5.0, 11.0, 12.0, 20.0])
    azimuth, elevation = two_body(truth, station, t)
    noise = 2e-3 * np.random.default_rng(8).standard_normal((2, count))
    azimuth, elevation = azimuth + noise[0], elevation + noise[1]
    tracker = Average(SPEC)
    alone = solved_alone(tracker, nominal, station, t, azimuth, elevation)
    n = np.sqrt(SPEC.gm_m3_s2 / truth[0] ** 3)
    at_zero = alone - np.outer([0.0, 1.0], n * t)
    state = start_of(tracker, nominal, station)
    for k in range(count):
        state = tracker.update(
            state, t[k : k + 1], azimuth[k : k + 1], elevation[k : k + 1], np.ones(1)
        )
        done = at_zero[:, : k + 1]
        mean = done.mean(axis=1)
        found = state.elements[[3, 5], 0] - np.array([0.0, n * t[k]])
        # each measurement's anomaly is told from the radius that the iteration ends at, 1e-9 of it
        assert_allclose(found, mean, rtol=0, atol=1e-8)
        off = done - mean[:, None]
        sums = off @ off.T
        scatter = state.scatter[:, 0]
        assert_allclose(scatter, [sums[0, 0], sums[0, 1], sums[1, 1]], rtol=1e-3, atol=1e-11)
        assert state.count[0] == k + 1.0


def test_covariance_of_the_sky_is_that_of_the_means() -> None:
    """J C Jᵀ by differences of the angles; C = scatter/(n (n − 1)), of one measurement as given."""
    truth = np.array([7.4e6, 0.02, 0.9, 1.0, 0.3, 0.6])
    station = overhead(truth, 0.05)
    spec = AverageSpec(j2=0.0, j4=0.0, node_sigma_rad=3e-3, mean_anomaly_sigma_rad=1e-3)
    tracker = Average(spec)
    state = start_of(tracker, truth, station, 3)
    scatter = 1e-6 * np.array([[5.0, 5.0, 40.0], [-2.0, -2.0, 9.0], [3.0, 3.0, 7.0]])
    state = AverageState(**(vars(state) | {"scatter": scatter, "count": np.array([1.0, 2.0, 5.0])}))
    times = np.array([30.0, 90.0])
    _, elevation, covariance = tracker.predict(state, times)
    columns = []
    for k in (3, 5):
        step = 1e-6 * np.eye(6)[k]
        ahead, behind = (np.array(two_body(truth + s, station, times)) for s in (step, -step))
        columns.append(wrap_angle(ahead - behind) / 2e-6)
    slopes = np.array(columns)  # Ω, M by azimuth, elevation by time
    slopes[:, 0] *= np.cos(elevation[:, 0])
    expected = [
        np.diag([9e-6, 1e-6]),
        1e-6 * np.array([[5.0, -2.0], [-2.0, 3.0]]) / 2.0,
        1e-6 * np.array([[40.0, 9.0], [9.0, 7.0]]) / 20.0,
    ]
    for case, means in enumerate(expected):
        for k in range(2):
            wanted = slopes[:, :, k].T @ means @ slopes[:, :, k]
            assert_allclose(covariance[:, :, k, case], wanted, rtol=1e-6, atol=1e-14)


@pytest.mark.parametrize(
    ("sine", "trust"),
    [(1e-3, 0.0), (3.4e-3, 0.0), (0.01925, 0.5), (0.027125, 0.75), (0.0351, 1.0)],
)
def test_near_the_equator_the_argument_is_predicted(sine: float, trust: float) -> None:
    """Of a circular orbit u is told by the latitude as far as it is trusted, evenly with sin i.

    From none at 0.2° to all at 2°; the node makes up for the rest, so that the longitude fits.
    """
    i = float(np.arcsin(sine))
    truth = np.array([7.4e6, 0.0, i, 1.0, 0.0, 0.5])
    station = overhead(truth)
    azimuth, elevation = two_body(truth, station, np.zeros(1))
    nominal = truth + np.array([0.0, 0.0, 0.0, 0.01, 0.0, -0.02])
    tracker = Average(SPEC)
    state = tracker.update(
        start_of(tracker, nominal, station), np.zeros(1), azimuth, elevation, np.ones(1)
    )
    u = 0.48 + trust * 0.02

    def longitude(u: float) -> float:
        return float(np.arctan2(np.cos(i) * np.sin(u), np.cos(u)))

    assert_allclose(state.elements[5], u, rtol=0, atol=1e-7)
    assert_allclose(state.elements[3], 1.0 + longitude(0.5) - longitude(u), rtol=0, atol=1e-7)


def test_circular_start_is_at_the_same_argument_of_latitude() -> None:
    """Kepler's equation by fixed-point iteration and f = 2 atan(√((1+e)/(1−e)) tan(E/2))."""
    e, mean, perigee = 0.05, 0.8, 0.7
    anomaly = mean
    for _ in range(60):
        anomaly = mean + e * np.sin(anomaly)
    f = 2.0 * np.arctan(np.sqrt((1.0 + e) / (1.0 - e)) * np.tan(anomaly / 2.0))
    nominal = np.array([7.4e6, e, 0.9, 1.0, perigee, mean])
    state = start_of(Circular(SPEC), nominal, overhead(nominal))
    assert_allclose(state.elements[:, 0], [7.4e6, 0.0, 0.9, 1.0, 0.0, perigee + f], rtol=1e-12)


def test_up_to_the_first_measurement_everything_moves() -> None:
    """The node and the perigee drift by J2; from the first measurement on they rest."""
    nominal = np.array([7.4e6, 0.02, 0.9, 1.0, 0.3, 0.6])
    spec = AverageSpec()
    tracker = Average(spec)
    dt = 2000.0
    field = ZonalField(
        j2=spec.j2, j4=spec.j4, radius_m=spec.equatorial_radius_m, gm_m3_s2=spec.gm_m3_s2
    )
    there = propagate_secular(nominal[:, None], np.array([dt]), field)[:, 0]
    station = overhead(there, 0.05)
    nan, t = np.full(2, np.nan), np.array([dt])
    state = start_of(tracker, nominal, station, 2)
    # one case has a measurement already
    begun = AverageState(**(vars(state) | {"count": np.array([0.0, 1.0])}))
    later = tracker.update(begun, t, nan, nan, np.ones(1))
    assert_allclose(later.elements[:, 0], there, rtol=1e-12)
    assert_allclose(later.elements[:5, 1], nominal[:5], rtol=0, atol=0)
    # the drift of the mean anomaly to the first order in J2, n (1 + 3/2 J2 (R/a)² …)
    assert_allclose(later.elements[5, 1], there[5], rtol=0, atol=1e-4)
