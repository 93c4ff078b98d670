"""Prediction and correction in one compiled function are those of the separate functions."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from hillsphere.base.geodetic import Station
from hillsphere.time import Epoch
from hillsphere_tracking.trackers.correction import correct_estimate
from hillsphere_tracking.trackers.least_squares import _LEAST_SIGMA, LeastSquares
from hillsphere_tracking.trackers.observation import propagate_and_compare
from hillsphere_tracking.trackers.specs import LeastSquaresSpec

EPOCH = Epoch.parse("1989-01-31T09:58:00", "UTC")
ELEMENTS = np.array([7180e3, 0.0436, *np.radians([23.82, 240.14, 15.47, 350.56])])
PLACES = (Station("Alcântara", np.radians(-2.18), np.radians(-44.26), 39.0),)
OPTIONS: list[dict[str, Any]] = [
    {},
    {"parameters": "node_anomaly", "time_bias": True},
    {"angle_biases": False, "horizon_bias": False, "drift_m": 0.0, "short_period": False},
]


@pytest.mark.parametrize("options", OPTIONS)
def test_one_call_gives_what_the_parts_give(options: dict[str, Any]) -> None:
    """Propagation, random walk, transition and Joseph's form, by the modules that state them."""
    tracker = LeastSquares(LeastSquaresSpec(**options))
    cases = 3
    elements = np.repeat(ELEMENTS[:, None], cases, axis=1)
    elements[3] += [0.0, 1e-3, -2e-3]
    state = tracker.initial(elements, np.full(cases, 38300.0), PLACES, EPOCH)
    t_s, angles = np.full(cases, 38370.0), (np.full(cases, 4.5), np.array([0.1, 0.11, 0.4]))
    noise = np.full((2, cases), 1e-6)
    update = tracker._process(state, t_s, angles, noise)

    chart = tracker._chart
    after, slopes, (off, level2, by) = propagate_and_compare(
        state.elements, t_s - state.t_s, state.time_bias_s, t_s, state.site,
        np.array([*angles, *state.biases_rad, state.horizon_rad]), tracker._field,
        short_period=tracker.short_period,
    )  # fmt: skip
    prior = state.covariance.copy()
    walk = chart.walk(state.elements, tracker.spec.drift_m).T * 70.0
    for k in range(chart.count):
        prior[k, k] += walk[k]
    chart.carry(prior, state.elements, after, slopes, state.sense)
    projected = chart.project_slopes(by, tracker._bias_slopes, after, state.sense)
    variances = np.array([noise[0] * level2, noise[1]]) + _LEAST_SIGMA**2
    parts = correct_estimate(prior, projected, off, variances, tracker.spec.gate)

    def near(one: np.ndarray, other: np.ndarray) -> None:
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12 * np.abs(other).max())

    near(update.at.elements, after)
    near(update.prior, prior)
    for name, value in vars(parts).items():
        near(getattr(update.correction, name), value)


def test_a_pickled_tracker_holds_no_compiled_code() -> None:
    """Workers compile, or read from the cache, what they need: 1 MB less to send."""
    tracker = LeastSquares(LeastSquaresSpec())
    assert tracker._one_call is not None
    content = pickle.dumps(tracker)
    assert len(content) < 20_000
    assert pickle.loads(content)._one_call is not None
