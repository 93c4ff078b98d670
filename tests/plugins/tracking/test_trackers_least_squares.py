"""Recursive least squares: consistency, convergence, outliers, biases, and the edges."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.base.geodetic import Station
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.time import Epoch
from hillsphere_tracking.kepler import wrap_angle
from hillsphere_tracking.mean_elements import EARTH_FIELD, equinoctial, propagate_secular, states
from hillsphere_tracking.trackers.charts import Chart, EquinoctialElements, SelectedElements
from hillsphere_tracking.trackers.least_squares import LeastSquares, LeastSquaresState
from hillsphere_tracking.trackers.observation import Site, angles, directions
from hillsphere_tracking.trackers.specs import LeastSquaresSpec, TableSpec
from hillsphere_tracking.trackers.table import Table

DEGREE = np.pi / 180.0
EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
ALCANTARA = Station("Alcântara", -2.18 * DEGREE, -44.26 * DEGREE, 39.0)
PAPER = np.array([7180e3, 0.0436, *(np.array([23.82, 240.14, 15.47, 350.56]) * DEGREE)])
RISE = 6036.0
"""Pass 2 of Kuga and Carrara (1990) begins."""
SIGMA = 0.1 * DEGREE
Parameters = Literal["node_anomaly", "size_node_anomaly", "all"]
PARAMETERS: tuple[Parameters, ...] = ("node_anomaly", "size_node_anomaly", "all")


def at_rise(cases: int) -> Array:
    return np.repeat(propagate_secular(PAPER[:, None], np.array([RISE])), cases, axis=1)


def true_angles(
    elements: Array, since: float | Array, t_s: float | Array, site: Site
) -> tuple[Array, Array]:
    """Angles of mean elements (6, N), a time before, with short-period terms."""
    cases = elements.shape[1]
    now = propagate_secular(elements, np.full(cases, since))
    zero = np.zeros(cases)
    return angles(directions(now, zero, np.full(cases, t_s), site, EARTH_FIELD, short_period=True))


def chart_of(parameters: Parameters) -> Chart:
    rows = {"node_anomaly": (3, 5), "size_node_anomaly": (0, 3, 5)}
    return EquinoctialElements() if parameters == "all" else SelectedElements(rows[parameters])


@pytest.mark.parametrize(
    ("parameters", "time_bias"), [*((p, False) for p in PARAMETERS), ("size_node_anomaly", True)]
)
def test_errors_are_those_that_the_covariance_says(parameters: Parameters, time_bias: bool) -> None:
    # Truth drawn from the prior: the normalised estimation error squared is χ² with m degrees of
    # freedom, its mean over 300 cases m ± √(2m/300).
    cases = 300
    spec = LeastSquaresSpec(
        parameters=parameters, time_bias=time_bias, time_bias_sigma_s=1.0, drift_m=0.0,
        mean_anomaly_sigma_rad=0.5 * DEGREE,
    )  # fmt: skip
    tracker, chart = LeastSquares(spec), chart_of(parameters)
    random = np.random.default_rng(11)
    state = tracker.initial(at_rise(cases), np.array([RISE]), (ALCANTARA,), EPOCH)
    root = np.linalg.cholesky(state.covariance.transpose(2, 0, 1))
    drawn = (root @ random.standard_normal((cases, tracker.size, 1)))[:, :, 0]
    truth = chart.apply_step(at_rise(cases), drawn[:, : chart.count].T, state.sense)
    bias = drawn[:, chart.count :].T
    clock = bias[2] if time_bias else np.zeros(cases)
    for k in range(60):
        since = 3.0 * k + clock
        azimuth, elevation = true_angles(truth, since, RISE + since, state.site)
        noise = SIGMA * random.standard_normal((2, cases))
        lifted = elevation + bias[1] + bias[-1] / np.tan(elevation)
        state = tracker.update(
            state, np.array([RISE + 3.0 * k]), azimuth + bias[0] + noise[0],
            lifted + noise[1], np.array(SIGMA),
        )  # fmt: skip
        if k not in (0, 9, 59):
            continue
        now = propagate_secular(truth, np.full(cases, 3.0 * k))
        if parameters == "all":
            off = equinoctial(now, state.sense) - equinoctial(state.elements, state.sense)
            off[5] = wrap_angle(off[5])
        else:
            off = now - state.elements
            off[3:] = wrap_angle(off[3:])
            off = off[list(getattr(chart, "rows"))]  # noqa: B009 - of one kind of chart only
        biases = np.array([*state.biases_rad, *[state.time_bias_s] * time_bias, state.horizon_rad])
        off = np.concatenate([off, bias - biases]).T[:, :, None]
        covariance = state.covariance.transpose(2, 0, 1)
        nees = (off * np.linalg.solve(covariance, off)).sum(axis=(1, 2))
        size = tracker.size
        assert abs(nees.mean() - size) < 3.5 * np.sqrt(2.0 * size / cases), (k, nees.mean())
        assert (np.linalg.eigvalsh(covariance) > 0.0).all()

    # what is predicted is as sure as it says: two degrees of freedom on the sky
    later = RISE + 177.0 + np.array([30.0, 120.0])
    azimuth, elevation, covariance = tracker.predict(state, later)
    for k in range(2):
        true_az, true_el = true_angles(truth, later[k] + clock - RISE, later[k] + clock, state.site)
        off = np.array(
            [wrap_angle(azimuth[k] - true_az - bias[0]) * np.cos(true_el),
             elevation[k] - true_el - bias[1] - bias[-1] / np.tan(true_el)]
        )  # fmt: skip
        spread = covariance[:, :, k].transpose(2, 0, 1)
        nees = (off.T * np.linalg.solve(spread, off.T[:, :, None])[:, :, 0]).sum(axis=1)
        assert abs(nees.mean() - 2.0) < 3.5 * np.sqrt(4.0 / cases)


@pytest.mark.parametrize("age", [1.0, 3.0, 10.0, 30.0, 120.0])
def test_beats_the_table_from_one_second_of_age(age: float) -> None:
    # A satellite early by `age` on its track; biases of 0.06° and 0.17°, noise of 0.08°, as in
    # Kuga and Carrara (1990). A minute of measurements, then five minutes of prediction.
    cases = 40
    random = np.random.default_rng(int(age))
    nominal = at_rise(cases)
    truth = propagate_secular(nominal, np.full(cases, age))
    truth[3] = nominal[3]
    best, table = LeastSquares(LeastSquaresSpec()), Table(TableSpec())
    state = best.initial(nominal, np.array([RISE]), (ALCANTARA,), EPOCH)
    stored = table.initial(nominal, np.array([RISE]), (ALCANTARA,), EPOCH)
    bias = np.array([0.06, 0.17])[:, None] * DEGREE * random.choice([-1.0, 1.0], (2, cases))
    for k in range(60):
        azimuth, elevation = true_angles(truth, float(k), RISE + k, state.site)
        noise = 0.08 * DEGREE * random.standard_normal((2, cases))
        state = best.update(
            state, np.array([RISE + k]), azimuth + bias[0] + noise[0],
            elevation + bias[1] + noise[1], np.array(0.08 * DEGREE),
        )  # fmt: skip
    later = RISE + np.arange(60.0, 380.0, 20.0)

    def worst(found: tuple[Array, Array, Array], shown: Array) -> float:
        errors = []
        for k, t in enumerate(later):
            az, el = true_angles(truth, t - RISE, t, state.site)
            off_az = wrap_angle(found[0][k] - az - shown[0])
            errors.append(np.hypot(off_az * np.cos(el), found[1][k] - el - shown[1]))
        return float(np.median(np.max(errors, axis=0))) / DEGREE

    # the encoder's frame, which reacquisition needs; the table knows of no bias
    best_error = worst(best.predict(state, later), bias)
    table_error = worst(table.predict(stored, later), bias)
    assert best_error < 0.7 * table_error
    assert best_error < 0.25


def test_error_free_measurements_lead_to_the_truth() -> None:
    for parameters in PARAMETERS:
        spec = LeastSquaresSpec(parameters=parameters, angle_biases=False, drift_m=0.0)
        tracker = LeastSquares(spec)
        truth = at_rise(1)
        nominal = truth.copy()
        nominal[[3, 5]] += np.array([[0.3], [-1.5]]) * DEGREE  # 25 s along the track
        state = tracker.initial(nominal, np.array([RISE]), (ALCANTARA,), EPOCH)
        for k in range(120):
            azimuth, elevation = true_angles(truth, 2.0 * k, RISE + 2.0 * k, state.site)
            state = tracker.update(
                state, np.array([RISE + 2.0 * k]), azimuth, elevation, np.array(1e-5)
            )
        azimuth, elevation, _ = tracker.predict(state, np.array([RISE + 300.0]))
        true_az, true_el = true_angles(truth, 300.0, RISE + 300.0, state.site)
        assert_allclose(wrap_angle(azimuth[0] - true_az), 0.0, rtol=0, atol=2e-5)
        assert_allclose(elevation[0], true_el, rtol=0, atol=2e-5)


def run(
    tracker: LeastSquares,
    nominal: Array,
    truth: Array,
    station: Station,
    times: Array,
    spoil: Array | None = None,
) -> LeastSquaresState:
    """Track truth by mean elements (6, N) of t = 0; `spoil` (2, K) is added to the angles."""
    state = tracker.initial(nominal, times[:1], (station,), EPOCH)
    for k, t in enumerate(times):
        azimuth, elevation = true_angles(truth, t, t, state.site)
        if spoil is not None:
            azimuth, elevation = azimuth + spoil[0, k], elevation + spoil[1, k]
        state = tracker.update(state, np.array([t]), azimuth, elevation, np.array(SIGMA))
    return state


def test_outliers_cost_little() -> None:
    random = np.random.default_rng(8)
    times = RISE + np.arange(0.0, 200.0, 2.0)
    noise = SIGMA * random.standard_normal((2, 100))
    spoilt = noise.copy()
    wrong = random.random(100) < 0.15
    spoilt[:, wrong] += random.uniform(-10.0, 10.0, (2, wrong.sum())) * DEGREE
    truth = PAPER[:, None]
    nominal = propagate_secular(truth, np.array([RISE + 3.0]))
    later = RISE + np.array([300.0])

    def error(spec: LeastSquaresSpec, spoil: Array) -> tuple[float, float]:
        tracker = LeastSquares(spec)
        state = run(tracker, nominal, truth, ALCANTARA, times, spoil)
        azimuth, elevation, _ = tracker.predict(state, later)
        az, el = true_angles(truth, later[0], later[0], state.site)
        found = np.hypot(wrap_angle(azimuth[0] - az) * np.cos(el), elevation[0] - el) / DEGREE
        return float(found[0]), float(state.outliers[0])

    clean, none = error(LeastSquaresSpec(), noise)
    robust, many = error(LeastSquaresSpec(), spoilt)
    naive, _ = error(LeastSquaresSpec(gate=1e6), spoilt)
    assert none <= 1.0
    assert many >= 0.8 * wrong.sum()
    assert robust < clean + 0.15
    assert naive > 3.0 * robust


def test_an_orbit_that_only_an_outlier_speaks_for_is_given_up() -> None:
    random, times = np.random.default_rng(4), RISE + np.arange(0.0, 60.0, 2.0)
    truth, nominal = PAPER[:, None], propagate_secular(PAPER[:, None], np.array([RISE + 3.0]))
    noise = SIGMA * random.standard_normal((2, times.size))
    spoilt = noise.copy()
    spoilt[0, 0] += 4.0 * DEGREE
    tracker = LeastSquares(LeastSquaresSpec())
    state = run(tracker, nominal, truth, ALCANTARA, times, spoilt)
    assert state.restarts[0] == 1.0
    assert state.outliers[0] == 1.0
    # as if it had begun with the second measurement
    without = spoilt.copy()
    without[:, 0] = np.nan
    clean = run(tracker, nominal, truth, ALCANTARA, times, without)
    assert_allclose(state.elements, clean.elements, rtol=1e-12)
    assert_allclose(state.covariance, clean.covariance, rtol=1e-9)
    # 29 measurements, of which the first agrees with none before it
    assert (state.agreed[0], clean.agreed[0]) == (28.0, 28.0)
    # an orbit that many measurements agree on is not given up for a few that do not
    spoilt = noise.copy()
    spoilt[:, 15:19] += 4.0 * DEGREE
    state = run(tracker, nominal, truth, ALCANTARA, times, spoilt)
    assert (state.restarts[0], state.outliers[0]) == (0.0, 4.0)


def test_a_burst_of_outliers_does_not_undo_a_pass() -> None:
    # A side lobe, 3° off: the last eleven of a hundred measurements before the loss, or the first
    # twenty, on which an orbit settles that all others contradict.
    random, times = np.random.default_rng(4), RISE + np.arange(0.0, 200.0, 2.0)
    truth, nominal = PAPER[:, None], propagate_secular(PAPER[:, None], np.array([RISE + 3.0]))
    noise = SIGMA * random.standard_normal((2, times.size))
    tracker, later = LeastSquares(LeastSquaresSpec()), times[-1] + np.array([60.0, 240.0])

    def error(state: LeastSquaresState) -> Array:
        azimuth, elevation, _ = tracker.predict(state, later)
        true = np.array([true_angles(truth, t, t, state.site) for t in later])[:, :, 0].T
        off = wrap_angle(azimuth[:, 0] - true[0]) * np.cos(true[1])
        return np.asarray(np.hypot(off, elevation[:, 0] - true[1]) / DEGREE)

    clean = error(run(tracker, nominal, truth, ALCANTARA, times, noise))
    for wrong, restarts, most in ((slice(-11, None), 0.0, 0.4), (slice(20), 1.0, 0.2)):
        spoilt = noise.copy()
        spoilt[:, wrong] += 2.1 * DEGREE
        state = run(tracker, nominal, truth, ALCANTARA, times, spoilt)
        assert state.restarts[0] == restarts
        assert (error(state) < clean + most).all()
        if not restarts:
            assert state.outliers[0] == 11.0


def test_restarts_end_where_all_is_an_outlier() -> None:
    random, times = np.random.default_rng(4), RISE + np.arange(0.0, 200.0, 2.0)
    spoil = 30.0 * SIGMA * random.standard_normal((2, times.size))
    tracker, truth = LeastSquares(LeastSquaresSpec()), PAPER[:, None]
    nominal = propagate_secular(truth, np.array([RISE]))
    state = run(tracker, nominal, truth, ALCANTARA, times, spoil)
    assert state.restarts[0] == 5.0
    assert state.outliers[0] > 60.0
    azimuth, elevation, _ = tracker.predict(state, times[-1:])
    az, el = true_angles(truth, times[-1], times[-1], state.site)
    assert np.hypot(wrap_angle(azimuth[0] - az) * np.cos(el), elevation[0] - el)[0] < 3.0 * DEGREE


def below(elements: Array, offset_rad: float = 0.0) -> Station:
    """Return the station below the satellite at t = 0, moved in latitude."""
    x = states(elements[:, None], np.zeros(1))
    fixed = earth_fixed("teme", EPOCH, np.zeros(1))[:, :, 0] @ x[:3, 0]
    found = Station.at("below", fixed)
    return Station("below", found.latitude_rad + offset_rad, found.longitude_rad)


@pytest.mark.parametrize("parameters", PARAMETERS)
@pytest.mark.parametrize("i", [0.0, 1e-9, 0.4, 1.75, np.pi - 1e-9, np.pi])
@pytest.mark.parametrize("e", [0.0, 1e-12, 0.05])
def test_tracks_at_the_extremes_and_through_the_zenith(
    parameters: Parameters, i: float, e: float
) -> None:
    # through the zenith, a quarter of a revolution from the node: circular, equatorial,
    # retrograde, at the extreme of latitude
    truth = np.array([7.4e6, e, i, 1.0, 0.2, 1.3])
    station = below(truth)
    times = np.arange(-150.0, 151.0, 5.0)
    tracker = LeastSquares(LeastSquaresSpec(parameters=parameters, drift_m=0.0))
    nominal = propagate_secular(truth[:, None], np.array([times[0] + 2.0]))
    state = run(tracker, nominal, truth[:, None], station, times)
    assert np.isfinite(state.covariance).all()
    assert np.linalg.eigvalsh(state.covariance[:, :, 0]).min() > 0.0
    later = np.array([0.0, 180.0, 250.0])
    azimuth, elevation, covariance = tracker.predict(state, later)
    for k, t in enumerate(later):
        az, el = true_angles(truth[:, None], t, t, state.site)
        off = np.hypot(wrap_angle(azimuth[k] - az) * np.cos(el), elevation[k] - el)
        assert off[0] < 0.1 * DEGREE
        # a nominal orbit that is 2 s wrong is far within the prior; no noise was added
        assert off[0] < 3.0 * np.sqrt(np.trace(covariance[:, :, k, 0])) + 1e-4


def test_biases_are_found_and_kept_for_the_next_pass() -> None:
    truth, times = PAPER[:, None], RISE + np.arange(0.0, 440.0, 2.0)
    bias = np.array([0.15, -0.2]) * DEGREE
    tracker = LeastSquares(LeastSquaresSpec(drift_m=0.0))
    nominal = propagate_secular(truth, np.array([RISE]))
    spoil = bias[:, None] * np.ones((2, times.size))
    state = run(tracker, nominal, truth, ALCANTARA, times, spoil)
    sigma = np.sqrt(state.covariance[[3, 4], [3, 4], 0])
    assert (np.abs(state.biases_rad[:, 0] - bias) < 2.0 * sigma).all()
    # of 0.2° before; a part of the elevation's cannot be told from the horizon bias
    assert (sigma < np.array([0.05, 0.15]) * DEGREE).all()

    fresh = tracker.initial(nominal, np.array([RISE]), (ALCANTARA,), EPOCH)
    again = tracker.with_biases(fresh, state.biases_rad, state.covariance[3:5, 3:5, 0])
    assert_allclose(again.biases_rad, state.biases_rad, rtol=0)
    assert_allclose(again.covariance[3:5, 3:5], state.covariance[3:5, 3:5], rtol=1e-14)
    # all else is as it was, the horizon bias too: it is that of the day
    assert_allclose(again.covariance[:3, 3:], 0.0, atol=0)
    assert_allclose(again.covariance[5, :5], 0.0, atol=0)
    others = np.ix_([0, 1, 2, 5], [0, 1, 2, 5])
    assert_allclose(again.covariance[others], fresh.covariance[others], rtol=0)
    without = LeastSquares(LeastSquaresSpec(angle_biases=False))
    with pytest.raises(InputError, match="angle_biases = true"):
        without.with_biases(fresh, bias, np.eye(2))


def test_a_horizon_bias_is_found_and_predicted() -> None:
    # Clean measurements of a pass from 5° to 16° and down again; the last minute is predicted.
    truth, times = PAPER[:, None], RISE + np.arange(0.0, 400.0, 2.0)
    azimuth_bias, elevation_bias, horizon = np.array([0.05, -0.1, 0.03]) * DEGREE
    site = LeastSquares(LeastSquaresSpec()).initial(truth, np.zeros(1), (ALCANTARA,), EPOCH).site
    high = np.array([true_angles(truth, t, t, site)[1][0] for t in times])
    spoil = np.array([azimuth_bias + 0.0 * high, elevation_bias + horizon / np.tan(high)])
    nominal = propagate_secular(truth, np.array([RISE + 1.0]))

    def tracked(horizon_bias: bool) -> tuple[LeastSquares, LeastSquaresState]:
        spec = LeastSquaresSpec(horizon_bias=horizon_bias, drift_m=0.0)
        tracker = LeastSquares(spec)
        state = tracker.initial(nominal, times[:1], (ALCANTARA,), EPOCH)
        for k, t in enumerate(times):
            azimuth, elevation = true_angles(truth, t, t, state.site)
            state = tracker.update(
                state, np.array([t]), azimuth + spoil[0, k], elevation + spoil[1, k],
                np.array(1e-4),
            )  # fmt: skip
        return tracker, state

    tracker, state = tracked(True)
    sigma = np.sqrt(state.covariance[[3, 4, 5], [3, 4, 5], 0])
    assert (sigma < np.array([0.002, 0.02, 0.001]) * DEGREE).all()  # of 0.2°, 0.2° and 0.01°
    off = state.biases_rad[:, 0] - [azimuth_bias, elevation_bias]
    assert (np.abs([*off, state.horizon_rad[0] - horizon]) < 1.5 * sigma).all()
    later = RISE + np.array([430.0, 450.0, 470.0])
    true = np.array([true_angles(truth, t, t, state.site)[1][0] for t in later])
    assert true[-1] < 6.0 * DEGREE
    errors = []
    for horizon_bias in (True, False):
        found = tracked(horizon_bias)
        low = found[0].predict(found[1], later)[1][:, 0]
        errors.append(np.abs(low - true - elevation_bias - horizon / np.tan(true)).max())
    assert errors[0] < 0.02 * DEGREE
    assert errors[1] > 10.0 * errors[0]
    # without the biases it is where the satellite is
    plain = tracker.predict(state, later, biased=False)[1][:, 0]
    assert_allclose(plain, true, rtol=0, atol=0.03 * DEGREE)


@pytest.mark.parametrize("time_bias", [False, True])
def test_the_spread_of_predictions_low_down(time_bias: bool) -> None:
    # Estimates drawn from a state's covariance scatter as the prediction says, near the horizon,
    # where the horizon bias counts most and goes with the elements and the elevation's bias.
    cases = 4000
    spec = LeastSquaresSpec(time_bias=time_bias, time_bias_sigma_s=2.0, drift_m=0.0)
    tracker = LeastSquares(spec)
    truth = PAPER[:, None]
    nominal = propagate_secular(truth, np.array([RISE]))
    known = run(tracker, nominal, truth, ALCANTARA, RISE + np.arange(0.0, 200.0, 2.0))
    root = np.linalg.cholesky(known.covariance[:, :, 0])
    drawn = root @ np.random.default_rng(5).standard_normal((tracker.size, cases))
    state = tracker.initial(
        np.repeat(known.elements, cases, axis=1), known.t_s, (ALCANTARA,), EPOCH
    )
    elements = state.elements.copy()
    elements[[0, 3, 5]] += drawn[:3]
    scattered = replace(
        state, elements=elements, biases_rad=known.biases_rad + drawn[3:5],
        horizon_rad=known.horizon_rad + drawn[-1],
        time_bias_s=known.time_bias_s + (drawn[5] if time_bias else 0.0),
    )  # fmt: skip
    later = RISE + np.array([500.0, 580.0, 640.0])
    for biased in (True, False):
        azimuth, elevation, _ = tracker.predict(scattered, later, biased)
        middle_az, middle_el, covariance = tracker.predict(known, later, biased)
        assert (middle_el[-1] < 5.0 * DEGREE).all()
        for k in range(later.size):
            off = np.array(
                [wrap_angle(azimuth[k] - middle_az[k]) * np.cos(middle_el[k]),
                 elevation[k] - middle_el[k]]
            )  # fmt: skip
            spread = np.sqrt(np.diag(covariance[:, :, k, 0]))
            expected = covariance[:, :, k, 0] / np.outer(spread, spread)
            found = np.cov(off) / np.outer(spread, spread)
            assert_allclose(found, expected, rtol=0, atol=0.08)


def test_a_time_bias_is_found_where_the_orbit_is_known() -> None:
    truth, times = PAPER[:, None], RISE + np.arange(0.0, 440.0, 2.0)
    spec = LeastSquaresSpec(
        angle_biases=False, time_bias=True, time_bias_sigma_s=1.0, drift_m=0.0,
        semi_major_axis_sigma_m=1.0, node_sigma_rad=1e-6, mean_anomaly_sigma_rad=1e-6,
    )  # fmt: skip
    tracker = LeastSquares(spec)
    state = tracker.initial(propagate_secular(truth, np.array([RISE])), np.array([RISE]),
                            (ALCANTARA,), EPOCH)  # fmt: skip
    for t in times:  # tags are early by 0.4 s
        azimuth, elevation = true_angles(truth, t + 0.4, t + 0.4, state.site)
        state = tracker.update(state, np.array([t]), azimuth, elevation, np.array(SIGMA))
    assert_allclose(state.time_bias_s, 0.4, rtol=0, atol=2e-3)
    assert np.sqrt(state.covariance[3, 3, 0]) < 0.05
    # what the antenna will show when the station's clock says so, and where the satellite then is
    later = times[-1] + np.array([20.0, 100.0, 200.0])
    for biased, late in ((True, 0.4), (False, 0.0)):
        azimuth, elevation, _ = tracker.predict(state, later, biased)
        true = np.array([true_angles(truth, t + late, t + late, state.site) for t in later])
        off = np.hypot(wrap_angle(azimuth - true[:, 0]) * np.cos(elevation), elevation - true[:, 1])
        assert off.max() < 2e-3 * DEGREE


def test_a_bias_carries_a_prediction_over_the_zenith_to_the_other_side() -> None:
    truth = np.array([7.4e6, 0.001, 1.0, 1.0, 0.2, 1.3])
    tracker = LeastSquares(LeastSquaresSpec(short_period=False))
    state = tracker.initial(truth[:, None], np.zeros(1), (below(truth),), EPOCH)
    biases = np.array([0.1, 0.3]) * DEGREE
    told = tracker.with_biases(state, biases, (0.2 * DEGREE) ** 2 * np.eye(2))
    times = np.array([-60.0, -0.5, 0.0, 0.5, 60.0])
    azimuth, elevation, covariance = (q[..., 0] for q in tracker.predict(told, times))
    plain_az, plain_el, _ = (q[..., 0] for q in tracker.predict(state, times, biased=False))
    raised = plain_el + biases[1]
    assert (raised > 0.5 * np.pi).tolist() == [False, True, True, True, False]
    assert (elevation <= 0.5 * np.pi).all()
    assert ((azimuth >= 0.0) & (azimuth < 2.0 * np.pi)).all()
    over = np.where(raised > 0.5 * np.pi, np.pi, 0.0)
    assert_allclose(wrap_angle(azimuth - plain_az - biases[0] - over), 0.0, rtol=0, atol=1e-12)
    assert_allclose(direction(azimuth, elevation), direction(plain_az + biases[0], raised),
                    rtol=0, atol=1e-12)  # fmt: skip
    # the same spread on the sky as without the fold, in axes that both turned over
    unbiased = tracker.predict(state, times)[2][..., 0]
    assert_allclose(covariance, unbiased, rtol=1e-12, atol=1e-20)


def direction(azimuth: Array, elevation: Array) -> Array:
    level = np.cos(elevation)
    return np.array([level * np.sin(azimuth), level * np.cos(azimuth), np.sin(elevation)])


def test_cases_do_not_touch_each_other() -> None:
    tracker = LeastSquares(LeastSquaresSpec())
    random = np.random.default_rng(1)
    nominal = at_rise(6)
    nominal[5] += random.normal(0.0, 0.02, 6)
    truth = at_rise(6)

    # the third case has a measurement only now and then, the fifth an outlier
    def spoilt(k: int, az: Array) -> Array:
        made = az.copy()
        made[2] = np.nan if k % 3 else made[2]
        made[4] += 0.3 if k == 7 else 0.0
        return made

    def played(chosen: slice) -> LeastSquaresState:
        state = tracker.initial(nominal[:, chosen], np.array([RISE]), (ALCANTARA,), EPOCH)
        for k in range(20):
            azimuth, elevation = true_angles(truth, float(k), RISE + k, state.site)
            state = tracker.update(
                state, np.array([RISE + k]), spoilt(k, azimuth)[chosen], elevation[chosen],
                np.array(SIGMA),
            )  # fmt: skip
        return state

    together = played(slice(None))
    assert_allclose(together.count, [20, 20, 7, 20, 20, 20], atol=0)
    for case in range(6):
        alone = played(slice(case, case + 1))
        assert_allclose(together.elements[:, case], alone.elements[:, 0], rtol=1e-12)
        assert_allclose(
            together.covariance[:, :, case], alone.covariance[:, :, 0], rtol=1e-6, atol=1e-16
        )


@pytest.mark.parametrize("gate", [LeastSquaresSpec().gate, 1e6])
def test_a_missing_measurement_moves_only_the_time(gate: float) -> None:
    # however far a measurement that stands for the missing one would move the state
    tracker = LeastSquares(LeastSquaresSpec(drift_m=0.0, gate=gate))
    state = tracker.initial(at_rise(1), np.array([RISE]), (ALCANTARA,), EPOCH)
    later = tracker.update(
        state, np.array([RISE + 50.0]), np.array([np.nan]), np.array([0.1]), np.array(SIGMA)
    )
    assert_allclose(later.elements, propagate_secular(state.elements, np.array([50.0])), rtol=1e-15)
    assert later.count[0] == 0.0
    here = tracker.predict(state, np.array([RISE + 100.0]))
    there = tracker.predict(later, np.array([RISE + 100.0]))
    assert_allclose(here[:2], there[:2], rtol=1e-12)
    # what the size changes in the rate of the perigee, which is held, is not carried on
    assert_allclose(here[2], there[2], rtol=1e-5)


def test_prediction_grows_unsure_with_time_where_the_orbit_drifts() -> None:
    quiet = LeastSquares(LeastSquaresSpec(drift_m=0.0))
    drifting = LeastSquares(LeastSquaresSpec(drift_m=1e4))
    state = quiet.initial(at_rise(1), np.array([RISE]), (ALCANTARA,), EPOCH)
    later = RISE + np.array([0.0, 300.0])
    calm = quiet.predict(state, later)[2]
    wild = drifting.predict(state, later)[2]
    assert_allclose(wild[:, :, 0], calm[:, :, 0], rtol=1e-12)
    grown = np.trace(wild[:, :, 1, 0] - calm[:, :, 1, 0])
    assert 1e-6 < grown < 1e-3


def test_sigmas_of_each_angle_and_case() -> None:
    tracker = LeastSquares(LeastSquaresSpec())
    state = tracker.initial(at_rise(3), np.array([RISE]), (ALCANTARA,), EPOCH)
    azimuth, elevation = true_angles(at_rise(3), 0.0, RISE, state.site)
    t = np.array([RISE])
    one = tracker.update(state, t, azimuth, elevation, np.array(SIGMA))
    for sigma in (np.full(3, SIGMA), np.full((2, 1), SIGMA), np.full((2, 3), SIGMA)):
        other = tracker.update(state, t, azimuth, elevation, sigma)
        assert_allclose(other.covariance, one.covariance, rtol=1e-14)
    blunt = tracker.update(state, t, azimuth, elevation, np.array([[SIGMA], [100.0]]))
    assert np.trace(blunt.covariance[:, :, 0]) > np.trace(one.covariance[:, :, 0])
    for bad in (np.array(0.0), np.full(2, SIGMA), np.array(np.nan)):
        with pytest.raises(InputError, match="sigma_rad must be > 0"):
            tracker.update(state, t, azimuth, elevation, bad)


def test_states_are_not_changed() -> None:
    tracker = LeastSquares(LeastSquaresSpec(parameters="all"))
    state = tracker.initial(at_rise(2), np.array([RISE]), (ALCANTARA,), EPOCH)
    kept = replace(state, elements=state.elements.copy(), covariance=state.covariance.copy())
    azimuth, elevation = true_angles(at_rise(2), 0.0, RISE, state.site)
    t = np.full(2, RISE)
    after = tracker.update(state, t, azimuth + 0.01, elevation, np.array(SIGMA))
    t += 1.0  # a caller may use its arrays again
    assert_allclose(after.t_s, RISE, atol=0)
    tracker.predict(state, np.array([RISE]))
    assert_allclose(state.elements, kept.elements, atol=0, rtol=0)
    assert_allclose(state.covariance, kept.covariance, atol=0, rtol=0)


@pytest.mark.parametrize("dt", [900.0, -900.0])
def test_a_drifting_orbit_grows_unsure_between_measurements(dt: float) -> None:
    """A displacement of 200 m in an hour: the variance of a grows by 200² |dt|/3600 s, m².

    That of the node grows by the same over a², but for what the size changes in its rate. Biases
    do not drift.
    """
    found = []
    for drift in (0.0, 200.0):
        tracker = LeastSquares(
            LeastSquaresSpec(parameters="size_node_anomaly", angle_biases=True, drift_m=drift)
        )
        state = tracker.initial(at_rise(1), np.array([RISE]), (ALCANTARA,), EPOCH)
        later = tracker.update(
            state, np.array([RISE + dt]), np.array([np.nan]), np.array([0.1]), np.array(SIGMA)
        )
        found.append(later.covariance[:, :, 0])
    grown = found[1] - found[0]
    assert_allclose(grown[0, 0], 200.0**2 * 0.25, rtol=1e-9)
    assert_allclose(grown[1, 1], 200.0**2 * 0.25 / PAPER[0] ** 2, rtol=1e-2)
    assert_allclose(grown[3:, 3:], 0.0, atol=1e-18)


def test_each_angle_has_its_own_sigma() -> None:
    """An angle known to 100 rad says nothing, however far off; the other one does."""
    tracker = LeastSquares(LeastSquaresSpec())
    state = tracker.initial(at_rise(1), np.array([RISE]), (ALCANTARA,), EPOCH)
    azimuth, elevation = true_angles(at_rise(1), 0.0, RISE, state.site)
    t, sharp, blunt = np.array([RISE]), SIGMA, 100.0
    for sigma, dull in ((np.array([[blunt], [sharp]]), 0), (np.array([[sharp], [blunt]]), 1)):
        moved = []
        for k in range(2):
            shift = 2e-3 * np.eye(2)[k]
            after = tracker.update(state, t, azimuth + shift[0], elevation + shift[1], sigma)
            here = tracker.update(state, t, azimuth, elevation, sigma)
            moved.append(float(np.abs(after.elements - here.elements)[3:].max()))
        assert moved[dull] < 1e-6
        assert moved[1 - dull] > 1e-4
