"""Trackers against truths of their own model, over seeds and at the edges of geometry.

The truths are states of Brouwer's mean elements turned to the Earth and seen by the topocentric
angles that skyfield confirms; nothing of what trackers compute with is used. The orbit and the
errors are those of Kuga and Carrara (1990).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import chi2

from hillsphere import create
from hillsphere.base.geodetic import Station
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.time import Epoch
from hillsphere_tracking.mean_elements import propagate_secular, states
from hillsphere_tracking.topocentric import angles
from hillsphere_tracking.trackers.streaming import StreamingTracker

DEGREE = np.pi / 180.0
EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
ALCANTARA = Station("Alcântara", -2.18 * DEGREE, -44.26 * DEGREE, 39.0)
PAPER = np.array([7180e3, 0.0436, *np.radians([23.82, 240.14, 15.47, 350.56])])
RISE = 6036.0
SEEDS = 200
TYPES = ("table", "circular", "average", "least_squares")


def wrapped(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def look(station: Station, elements: Array, t_s: Array) -> Array:
    """Return the angles (2, N) at which mean elements of those times (6, N) are seen."""
    x = states(elements, np.zeros(t_s.size))
    fixed = np.einsum("ijn,jn->in", earth_fixed("teme", EPOCH, t_s), x[:3])
    return np.array(angles(station, fixed)[:2])


class Prior(NamedTuple):
    """Standard deviations from which truth is drawn; by default those of the tracker's Spec."""

    size_m: float = 5e3
    node_deg: float = 0.5
    mean_deg: float = 2.0
    bias_deg: float = 0.2
    horizon_deg: float = 0.01
    time_s: float = 0.0
    drift_m: float = 30.0


def nees(prior: Prior, outliers_from: int | None = None, **keys: Any) -> Array:
    """Return normalised errors squared of all estimated quantities, (3, seeds).

    After 10, 40 and 100 measurements of 0.1°, one each 3 s. From a given one on each is, with 5 %
    probability, an outlier of 5°.
    """
    tracker = create("tracker", "least_squares", **keys)
    random = np.random.default_rng(1990)
    normal, sigma, step = random.standard_normal, 0.1 * DEGREE, 3.0
    nominal = np.repeat(propagate_secular(PAPER[:, None], np.array([RISE])), SEEDS, axis=1)
    truth = nominal.copy()
    truth[0] += prior.size_m * normal(SEEDS)
    truth[3] += prior.node_deg * DEGREE * normal(SEEDS)
    truth[5] += prior.mean_deg * DEGREE * normal(SEEDS)
    bias = prior.bias_deg * DEGREE * normal((2, SEEDS))
    horizon = prior.horizon_deg * DEGREE * normal(SEEDS)
    late = prior.time_s * normal(SEEDS)
    state = tracker.initial(nominal, np.array([RISE]), (ALCANTARA,), EPOCH)
    found = []
    for k in range(100):
        t = RISE + step * k
        if k:
            truth = propagate_secular(truth, np.full(SEEDS, step))
            moved = prior.drift_m * np.sqrt(step / 3600.0) * normal((3, SEEDS))
            truth[[0, 3, 5]] += moved / np.array([np.ones(SEEDS), truth[0], truth[0]])
        shown = look(ALCANTARA, propagate_secular(truth, late), t + late)
        shown[1] += horizon / np.tan(np.maximum(shown[1], 2.0 * DEGREE))  # less is not tracked
        shown += bias + sigma * normal((2, SEEDS))
        wrong = random.random(SEEDS) < 0.05
        if outliers_from is not None and k >= outliers_from:
            shown[:, wrong] += 5.0 * DEGREE * normal((2, int(wrong.sum())))
        state = tracker.update(state, np.array([t]), shown[0], shown[1], np.array(sigma))
        if k + 1 in (10, 40, 100):
            off = truth - state.elements
            rows = [off[0], wrapped(off[3]), wrapped(off[5]), *(bias - state.biases_rad)]
            if prior.time_s:
                rows.append(late - state.time_bias_s)
            rows.append(horizon - state.horizon_rad)
            errors = np.array(rows).T[:, :, None]
            covariance = state.covariance.transpose(2, 0, 1)
            found.append((errors * np.linalg.solve(covariance, errors)).sum(axis=(1, 2)))
    return np.array(found)


def band(quantities: int) -> Array:
    """Return the band in which, with 95 %, the means over all seeds lie at all three times."""
    tail = 0.025 / 3.0
    return np.asarray(chi2.ppf([tail, 1.0 - tail], quantities * SEEDS) / SEEDS)


def test_the_default_trackers_errors_are_as_large_as_it_says() -> None:
    """Semi-major axis, node, anomaly and three biases; truth drifts as the tracker assumes."""
    low, high = band(6)
    mean = nees(Prior()).mean(axis=1)
    assert (mean > low).all()
    assert (mean < high).all()


def test_a_time_bias_is_estimated_as_well_as_it_says() -> None:
    """Along-track error and time bias look the same; the orbit must be known to tell them."""
    prior = Prior(size_m=1.0, node_deg=1e-4, mean_deg=1e-4, time_s=1.0, drift_m=0.0)
    found = nees(
        prior, time_bias=True, time_bias_sigma_s=1.0, semi_major_axis_sigma_m=1.0,
        node_sigma_deg=1e-4, mean_anomaly_sigma_deg=1e-4, drift_m=0.0,
    ).mean(axis=1)  # fmt: skip
    low, high = band(7)
    assert (found > low).all()
    assert (found < high).all()


def test_the_gate_holds_against_outliers() -> None:
    """With the orbit settled, one in twenty measurements wrong by 5° changes nothing."""
    low, high = band(6)
    mean = nees(Prior(), outliers_from=10).mean(axis=1)
    assert (mean > low).all()
    assert (mean < high).all()
    assert nees(Prior(), outliers_from=10, gate=1e6).mean(axis=1)[-1] > 50.0 * high


def test_outliers_among_the_first_measurements_are_outlived() -> None:
    """One in twenty from the very first on, with an anomaly that is known to 2° only."""
    low, high = band(6)
    found = nees(Prior(), outliers_from=0)
    assert (found.mean(axis=1) > low).all()
    assert (found.mean(axis=1) < high).all()
    assert (found[-1] > chi2.ppf(0.999, 6)).mean() < 0.01


# -- streaming ------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", TYPES)
def test_eight_streams_are_the_batch_of_eight(kind: str) -> None:
    """Each antenna with noise of its own; the signal is lost for ten seconds."""
    tracker, cases = create("tracker", kind), 8
    orbit = PAPER * np.array([1.0, 0.0 if kind == "circular" else 1.0, 1.0, 1.0, 1.0, 1.0])
    random = np.random.default_rng(7)
    nominal = np.repeat(orbit[:, None], cases, axis=1)
    nominal[5] += random.normal(0.0, 0.01, cases)
    streams = [StreamingTracker(tracker, nominal[:, k], 0.0, ALCANTARA, EPOCH, sigma_rad=1e-3)
               for k in range(cases)]  # fmt: skip
    state = tracker.initial(nominal, np.zeros(1), (ALCANTARA,), EPOCH)
    t = RISE + np.arange(40.0)
    seen = look(ALCANTARA, propagate_secular(orbit[:, None], t), t)
    for k in range(t.size):
        shown = seen[:, k : k + 1] + 1e-3 * random.standard_normal((2, cases))
        lost = 10 <= k < 20
        for case, stream in enumerate(streams):
            (stream.mark_lost if lost else stream.mark_locked)()
            assert stream.is_locked is not lost
            assert stream.update(t[k], *shown[:, case]) is not lost
        if not lost:
            state = tracker.update(state, t[k : k + 1], shown[0], shown[1], np.array(1e-3))
    later = t[-1] + np.array([1.0, 30.0, 200.0])
    batch = tracker.predict(state, later)
    for case, stream in enumerate(streams):
        alone = stream.predict(later)
        assert_allclose(alone[0], batch[0][:, case], rtol=0, atol=1e-12)
        assert_allclose(alone[1], batch[1][:, case], rtol=0, atol=1e-12)
        scale = float(np.abs(batch[2][..., case]).max())
        assert_allclose(alone[2], batch[2][..., case], rtol=0, atol=1e-9 * scale)


# -- edges ----------------------------------------------------------------------------------------


def tracked(
    kind: str, truth: Array, station: Station, begin: float, end: float, late_s: float = 1.0
) -> tuple[Array, Array, Array]:
    """Follow mean elements of t = 0 with noise of 0.06°, from nominal ones that are late.

    Returns errors on the sky (K,), angles predicted and true (2, K), over three minutes more.
    """
    t, later = np.arange(begin, end), np.arange(end, end + 180.0, 5.0)
    seen = look(station, propagate_secular(truth[:, None], t), t)
    seen += 0.06 * DEGREE * np.random.default_rng(2).standard_normal(seen.shape)
    nominal = propagate_secular(truth[:, None], np.array([begin + late_s]))[:, 0]
    stream = StreamingTracker(create("tracker", kind), nominal, begin, station, EPOCH,
                              sigma_rad=0.06 * DEGREE)  # fmt: skip
    for k in range(t.size):
        stream.update(t[k], seen[0, k], seen[1, k])
    predicted = np.array(stream.predict(later)[:2])
    true = look(station, propagate_secular(truth[:, None], later), later)
    off = wrapped(predicted - true)
    off[0] *= np.cos(true[1])
    return np.hypot(*off) / DEGREE, predicted, true


def below(truth: Array) -> Station:
    """Return the station that has the satellite at its zenith when t = 0."""
    fixed = (
        earth_fixed("teme", EPOCH, np.zeros(1))[:, :, 0] @ states(truth[:, None], np.zeros(1))[:3]
    )
    found = Station.at("below", fixed[:, 0])
    return Station("below", found.latitude_rad, found.longitude_rad)


@pytest.mark.parametrize("latitude_deg", [0.0, 90.0, 180.0])
@pytest.mark.parametrize("i_deg", [0.0, 23.82, 90.0, 178.0, 180.0])
@pytest.mark.parametrize("e", [0.0, 0.0436])
def test_sane_through_the_zenith_of_any_orbit(e: float, i_deg: float, latitude_deg: float) -> None:
    """At the nodes and at the extreme of latitude; the nominal orbit is 1 s, 0.5° at best, late.

    The averages stay within 1°, the angle to which the paper's antenna keeps its lock.
    """
    u = latitude_deg * DEGREE
    truth = np.array([7.4e6, e, i_deg * DEGREE, 1.0, 0.2, u - 0.2])
    station = below(truth)
    table = tracked("table", truth, station, -120.0, 121.0)[0].max()
    assert 0.2 < table < 0.3
    best = tracked("least_squares", truth, station, -120.0, 121.0)[0].max()
    assert best < 0.04
    assert tracked("average", truth, station, -120.0, 121.0)[0].max() < 1.0
    if e == 0.0:
        assert tracked("circular", truth, station, -120.0, 121.0)[0].max() < 1.0


@pytest.mark.parametrize("latitude_deg", [0.0, 90.0, 180.0, 270.0])
@pytest.mark.parametrize("i_deg", [0.0, 0.1, 0.2, 0.6, 1.0, 1.9, 2.1, 179.4, 180.0])
def test_the_averager_on_nearly_equatorial_orbits(i_deg: float, latitude_deg: float) -> None:
    """Eccentric, and half a minute late: latitude tells the argument of latitude badly or not."""
    truth = np.array([7.4e6, 0.0436, i_deg * DEGREE, 1.0, 0.2, latitude_deg * DEGREE - 0.2])
    assert tracked("average", truth, below(truth), -120.0, 121.0, 30.0)[0].max() < 0.8


@pytest.mark.parametrize("kind", ["table", "average", "least_squares"])
def test_the_azimuth_wraps_through_north(kind: str) -> None:
    """From a station far south the paper's satellite goes from west over north to east."""
    truth = PAPER.copy()
    under = below(truth)
    station = Station("south", under.latitude_rad - 12.0 * DEGREE, under.longitude_rad)
    error, predicted, true = tracked(kind, truth, station, -120.0, -30.0)
    assert true[0].max() > 350.0 * DEGREE
    assert true[0].min() < 10.0 * DEGREE
    assert ((predicted[0] >= 0.0) & (predicted[0] < 2.0 * np.pi)).all()
    assert error.max() < 0.6
    # north is crossed between the measurements as well
    error, _, true = tracked(kind, truth, station, -100.0, 60.0)
    assert error.max() < 0.6
