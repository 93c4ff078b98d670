"""Passes that a tracker follows at once, beside each of them alone, sample by sample."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere import create
from hillsphere.interfaces import Array
from hillsphere.interfaces.cases import CaseBatch
from hillsphere.spec import Ref
from hillsphere_tracking.assisted_tracking.errors import (
    arc,
    larger_sigma,
    nees,
    on_the_sky,
    root_sum_square,
)
from hillsphere_tracking.assisted_tracking.following import FollowedPass, follow
from hillsphere_tracking.assisted_tracking.nominal_orbits import nominal_orbits
from hillsphere_tracking.assisted_tracking.specs import AssistedTrackingSpec
from hillsphere_tracking.assisted_tracking.stage import AssistedTrackingStage
from hillsphere_tracking.trackers.observation import fold_over_zenith
from hillsphere_tracking.trackers.state import JointTracker

TRACKERS: dict[str, Any] = {
    "table": ("table", {}),
    "average": ("average", {}),
    "circular": ("circular", {}),
    "default": ("least_squares", {}),
    "all": ("least_squares", {"parameters": "all", "time_bias": True, "horizon_bias": True}),
}
KEEP = ("error", "sky_error", "encoder_error", "spread")
LANES = 8


class Plain:
    """A tracker with what the interface asks for, and no more."""

    def __init__(self, tracker: Any) -> None:
        self.short_period = tracker.short_period
        self.initial, self.update, self.predict = tracker.initial, tracker.update, tracker.predict


def stage() -> AssistedTrackingStage:
    sensor = create(
        "sensor", "antenna", station="Alcantara", latitude_deg=-2.18, longitude_deg=-44.26,
        height_m=39, believed_latitude_deg=-2.1, believed_longitude_deg=-44.2,
        believed_height_m=30,
    )  # fmt: skip
    satellite = {
        "name": "SCD",
        "elements": {
            "epoch": "1989-01-31T09:58:00", "semi_major_axis_km": 7180, "eccentricity": 0.0436,
            "inclination_deg": 23.82, "node_deg": 240.14, "perigee_deg": 15.47,
            "mean_anomaly_deg": 350.56,
        },
    }  # fmt: skip
    passes = [
        {"name": name, "sensor": sensor, "revolution": revolution, "elevation_max_deg": highest,
         "outages_s": outages}
        for name, revolution, highest, outages in (
            ("a", 2, 15.9, [10, 30]), ("b", 6, 12.3, [10, 30]), ("c", 7, 36.8, [20]),
        )
    ]  # fmt: skip
    return AssistedTrackingStage(
        AssistedTrackingSpec.model_validate(
            {
                "satellite": satellite, "body": create("body", "planet", orientation="constant"),
                "passes": passes, "trackers": [Ref("table", create("tracker", "table"))],
                "nominal_error": {"position_km": 3, "velocity_m_s": 3},
            }
        )
    )  # fmt: skip


@pytest.fixture(scope="module")
def scene() -> tuple[AssistedTrackingStage, list[FollowedPass], list[Array]]:
    """Three passes of the first cases of a campaign, two of them with the same outages."""
    made, lanes = stage(), np.arange(LANES)
    batch = CaseBatch(lanes, lanes, lanes < 0, (), np.zeros((0, LANES)), 1, "verify")
    truths = made._passes(lambda _: None)
    passes = [FollowedPass(t, made._observe(t, batch)) for t in truths]
    lost = passes[0].record.measured_rad.copy()
    lost[:, 5:9, 3] = np.nan  # a gap in the measurements of one case
    passes[0] = FollowedPass(truths[0], replace(passes[0].record, measured_rad=lost))
    error = made.spec.nominal_error
    elements = [nominal_orbits(error, batch, t.name, t.start_teme, made.field).mean for t in truths]
    return made, passes, elements


def follow_alone(
    tracker: Any, p: FollowedPass, elements: Array, made: AssistedTrackingStage
) -> tuple[list[dict[str, Array]], list[dict[str, Array]]]:
    """Follow one pass sample by sample, by what the interface of trackers asks for."""
    truth, record = p.truth, p.record
    true = truth.angles_rad[:, :, None]
    encoder = np.array(fold_over_zenith(*(true + record.bias_rad)))
    state = tracker.initial(
        elements, truth.t_s[:1], record.stations, made.orbit.epoch, truth.orientation
    )
    measures, histories = [], []
    rows: dict[str, list[Array]] = {name: [] for name in KEEP}

    def errors(times: slice) -> dict[str, Array]:
        *shown, covariance = tracker.predict(state, truth.t_s[times])
        plain = np.array(tracker.predict(state, truth.t_s[times], biased=False)[:2])
        return {
            "error": root_sum_square(plain, true[:, times]),
            "sky_error": arc(plain, true[:, times]),
            "encoder_error": root_sum_square(np.array(shown), encoder[:, times]),
            "spread": larger_sigma(covariance),
        }

    for k in range(truth.begins[-1] + 1):
        if k in truth.begins:
            later = errors(slice(k, None))
            middle = (truth.t_s.size - k) // 2
            *shown, covariance = tracker.predict(state, truth.t_s[k:])
            aim = np.array(shown)[:, middle]
            one = {f"{name}_max": later[name].max(axis=0) for name in KEEP[:3]}
            one["nees"] = nees(on_the_sky(encoder[:, k + middle], aim), covariance[:, :, middle])
            measures.append(one)
            histories.append(
                {name: np.concatenate([*(r for r in rows[name]), later[name]]) for name in KEEP}
            )
        sigma = truth.sigma_rad[:, k : k + 1]
        when = np.full(LANES, truth.t_s[k])
        state = tracker.update(state, when, *record.measured_rad[:, k], sigma)
        for name, value in errors(slice(k, k + 1)).items():
            rows[name].append(value)
    return measures, histories


@pytest.mark.parametrize("name", TRACKERS)
def test_passes_at_once_are_each_pass_sample_by_sample(name: str, scene: Any) -> None:
    made, passes, elements = scene
    kind, keys = TRACKERS[name]
    tracker = create("tracker", kind, **keys)
    assert isinstance(tracker, JointTracker)
    given = (tracker, passes, elements, made.orbit.epoch, 0.02, None)
    found = follow(*given, keep=[KEEP, KEEP, KEEP])
    first = follow(*given, keep=[KEEP, KEEP, KEEP], history_cases=2)
    for p, nominal, outcome, two in zip(passes, elements, found, first, strict=True):
        measures, histories = follow_alone(tracker, p, nominal, made)
        for one, other, expected in zip(outcome.measures, two.measures, measures, strict=True):
            for measure, values in expected.items():
                # NEES is a square of an error (1e-3 rad) over that of a deviation: rounding grows
                assert_allclose(one[measure], values, rtol=1e-9, err_msg=measure)
                assert_allclose(other[measure], values, rtol=1e-9, err_msg=measure)
        for one, some, expected in zip(outcome.over_time, two.over_time, histories, strict=True):
            for quantity, values in expected.items():
                assert_allclose(some[quantity], values[:, :2], rtol=1e-9, atol=1e-13)
                assert_allclose(one[quantity], values, rtol=1e-9, atol=1e-13, err_msg=quantity)


def test_a_tracker_of_the_plain_interface_follows_alike(scene: Any) -> None:
    made, passes, elements = scene
    tracker = create("tracker", "least_squares")
    assert not isinstance(Plain(tracker), JointTracker)
    given = (passes, elements, made.orbit.epoch, 0.02, None)
    for one, other in zip(follow(tracker, *given), follow(Plain(tracker), *given), strict=True):
        for a, b in zip(one.measures, other.measures, strict=True):
            assert a.keys() == b.keys()
            for measure, values in a.items():
                assert_allclose(values, b[measure], rtol=1e-9, err_msg=measure)


def test_joined_states_are_updated_as_each_alone(scene: Any) -> None:
    made, passes, elements = scene
    tracker: Any = create("tracker", "least_squares")
    states = [
        tracker.initial(
            nominal, p.truth.t_s[:1], p.record.stations, made.orbit.epoch, p.truth.orientation
        )
        for p, nominal in zip(passes, elements, strict=True)
    ]
    joined = tracker.join(states)
    assert joined.elements.shape == (6, 3 * LANES)
    angles = np.concatenate([p.record.measured_rad[:, 0] for p in passes], axis=1)
    times = np.repeat([p.truth.t_s[0] for p in passes], LANES)
    after = tracker.update(joined, times, *angles, 1e-3)
    for i, (p, state) in enumerate(zip(passes, states, strict=True)):
        alone = tracker.update(state, p.truth.t_s[0], *p.record.measured_rad[:, 0], 1e-3)
        lanes = slice(i * LANES, (i + 1) * LANES)
        assert_allclose(after.elements[:, lanes], alone.elements, rtol=1e-13)
        assert_allclose(after.covariance[..., lanes], alone.covariance, rtol=1e-9)
    # a joined state points each of its cases from its own antenna, on its own Earth
    there = tracker.point(joined, times[None] + 5.0)[0][:, 0].reshape(2, 3, LANES)
    for i, (p, state) in enumerate(zip(passes, states, strict=True)):
        alone = tracker.point(state, p.truth.t_s[:1] + 5.0)[0][:, 0]
        assert_allclose(there[:, i], alone, rtol=1e-12)
