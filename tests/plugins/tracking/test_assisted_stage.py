"""The stage `assisted_tracking`: passes of Kuga and Carrara (1990), and its behaviour."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere import create
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere.interfaces.cases import CaseBatch, CaseResults
from hillsphere.spec import Ref
from hillsphere.testing import RecordingContext
from hillsphere_tracking.assisted_tracking.measures import MEASURES, MetricName
from hillsphere_tracking.assisted_tracking.specs import AssistedTrackingSpec
from hillsphere_tracking.assisted_tracking.stage import AssistedTrackingStage

FIELD = str(Path(__file__).parents[3] / "missions" / "data" / "earth-gravity-degree6.gfc")
SATELLITE = {
    "name": "SCD",
    "elements": {
        "epoch": "1989-01-31T09:58:00", "semi_major_axis_km": 7180, "eccentricity": 0.0436,
        "inclination_deg": 23.82, "node_deg": 240.14, "perigee_deg": 15.47,
        "mean_anomaly_deg": 350.56,
    },
}  # fmt: skip
SILENT: dict[str, Any] = {
    f"{angle}_{kind}_deg": [0, 0, 0] for angle in ("azimuth", "elevation")
    for kind in ("noise", "bias")
}  # fmt: skip
UNBIASED: dict[str, Any] = {"azimuth_bias_deg": [0, 0, 0], "elevation_bias_deg": [0, 0, 0]}
SHORT = [{"name": "ALC2", "revolution": 2, "outages_s": [20, 60]}]


def antenna(site: str = "Alcantara", **keys: Any) -> Any:
    places: dict[str, dict[str, Any]] = {
        "Alcantara": {
            "latitude_deg": -2.18, "longitude_deg": -44.26, "height_m": 39,
            "believed_latitude_deg": -2.1, "believed_longitude_deg": -44.2,
            "believed_height_m": 30,
        },
        "Cuiaba": {
            "latitude_deg": -15.53, "longitude_deg": -56.07, "height_m": 277,
            "believed_latitude_deg": -15.5, "believed_longitude_deg": -56,
            "believed_height_m": 270,
        },
    }  # fmt: skip
    return create("sensor", "antenna", station=site, **places[site], **keys)


@cache
def planet() -> Any:
    return create("body", "planet", orientation="constant")


@cache
def plant() -> Any:
    gravity = create("gravity", "harmonics", file=FIELD, max_degree=6, max_tesseral_degree=4)
    return create(
        "plant", "earth_orbit", gravity=gravity, epoch="1989-01-31T09:58:00", body=planet(),
        drag={"drag_coefficient": 2.2, "area_to_mass_m2_kg": 0.01, "f107": 150.0,
              "f107_average": 150.0, "ap": 15.0},
    )  # fmt: skip


def stage(
    passes: list[dict[str, Any]], trackers: dict[str, Any], sensor: Any = None, **keys: Any
) -> AssistedTrackingStage:
    one = antenna() if sensor is None else sensor
    given = {
        "satellite": SATELLITE,
        "body": planet(),
        "passes": [{"sensor": one, **p} for p in passes],
        "trackers": [Ref(name, tracker) for name, tracker in trackers.items()],
    }
    return AssistedTrackingStage(AssistedTrackingSpec.model_validate(given | keys))


def batch(first: int = 0, names: tuple[str, ...] = (), values: Array | None = None) -> CaseBatch:
    numbers = first + np.arange(64)
    given = np.zeros((0, 64)) if values is None else values
    return CaseBatch(numbers, numbers, np.zeros(64, dtype=bool), names, given, 1, "verify")


def value(found: CaseResults, name: str) -> Array:
    return np.asarray(found.values[found.metrics.index(name)])


def mean_of_medians(found: CaseResults, tracker: str, measure: str) -> tuple[float, float]:
    """Mean and largest of the medians of all outages, deg."""
    medians = []
    for name, values in zip(found.metrics, found.values, strict=True):
        parts = MetricName.parse(name)
        assert parts is not None
        if (parts.tracker, parts.measure) == (tracker, measure):
            medians.append(np.degrees(np.median(values)))
    return float(np.mean(medians)), float(np.max(medians))


def test_error_free_pass() -> None:
    # Values of another flight with constants of its own; these and drag move them by 1e-2°.
    silent = antenna(**SILENT)
    passes = [{"name": "ALC2", "revolution": 2, "outages_s": [60]}]
    trackers = {"average": create("tracker", "average"), "best": create("tracker", "least_squares")}
    made = stage(
        passes, trackers, silent, plant=plant(), osculating_as_mean=True, believed_stations=False
    ).run(RecordingContext())
    assert made.acquisition_s[0] == 6036.0
    assert_allclose(np.degrees(made.true_rad[:, 0, 0]), [284.031369, 5.048786], rtol=0, atol=1e-2)
    found = dict(zip(made.metrics, np.degrees(made.values), strict=True))
    assert found["ALC2.60s.average.error_max"] == pytest.approx(0.1266, abs=5e-4)
    assert found["ALC2.60s.average.sky_error_max"] == pytest.approx(0.1226, abs=5e-4)
    # what a first-order theory and the step from a flight to its mean elements leave
    assert found["ALC2.60s.best.error_max"] < 1e-3


PAPER = (
    ("ALC2", "Alcantara", 2, 15.9, (1, 3.5, 6), 0.270),
    ("ALC6", "Alcantara", 6, 12.3, (1, 3.5, 6), -0.213),
    ("ALC7", "Alcantara", 7, 36.8, (5, 10, 15), -0.072),
    ("ALC8", "Alcantara", 8, 46.8, (5, 10, 15), None),
    ("CUI8", "Cuiaba", 8, 41.2, (5, 10, 15), -16.054),
    ("CUI9", "Cuiaba", 9, 60.4, (5, 10, 15), -1.027),
)


@pytest.mark.slow
def test_kuga_carrara_table3() -> None:
    """Errors of ±3 km and ±3 m/s, stations 8 to 11 km off, biases on: 64 cases."""
    sensors = {site: antenna(site) for site in ("Alcantara", "Cuiaba")}
    passes = [
        {"name": name, "sensor": sensors[site], "revolution": revolution,
         "elevation_max_deg": highest, "outages_min": outages}
        for name, site, revolution, highest, outages, _ in PAPER
    ]  # fmt: skip
    two = {"parameters": "node_anomaly", "angle_biases": False}
    trackers = {
        "table": create("tracker", "table", short_period=False),
        "average": create("tracker", "average"),
        "two": create("tracker", "least_squares", **two),
        "default": create("tracker", "least_squares"),
    }
    made = stage(
        passes, trackers, plant=plant(), osculating_as_mean=True,
        nominal_error={"position_km": 3, "velocity_m_s": 3},
    )  # fmt: skip
    found = made.run_cases(batch())
    assert not found.failed.any()
    # the node shifted until the printed elevations are met; pass 8 over Alcântara has two answers
    shifts = made.run(RecordingContext()).earth_shift_rad
    for shift, (*_, node_deg) in zip(np.degrees(shifts), PAPER, strict=True):
        if node_deg is not None:
            assert -shift == pytest.approx(node_deg, abs=2e-3)
    averager, _ = mean_of_medians(found, "average", "error_max")
    table, _ = mean_of_medians(found, "table", "error_max")
    # the paper's 18 draws have the mean 0.412
    assert averager == pytest.approx(0.41, abs=0.04)
    assert table == pytest.approx(0.402, abs=0.03)
    assert mean_of_medians(found, "two", "error_max")[0] == pytest.approx(0.234, abs=0.03)
    mean, worst = mean_of_medians(found, "default", "error_max")
    assert mean < 0.19
    assert worst < 0.37
    assert mean < 0.5 * averager
    encoder, _ = mean_of_medians(found, "default", "encoder_error_max")
    assert encoder < 0.14
    assert encoder < 0.4 * mean_of_medians(found, "average", "encoder_error_max")[0]


def test_consistency_where_truth_is_as_the_tracker_has_it() -> None:
    """Mean of the normalised error squared, two degrees of freedom, 64 cases: 2 ± 0.5."""
    sensor = antenna(**UNBIASED, bias_sigma_deg=[0.2, 0.2])
    prior = {"semi_major_axis_sigma_km": 5, "node_sigma_deg": 0.5, "mean_anomaly_sigma_deg": 2}
    trackers = {
        "default": create("tracker", "least_squares"),
        "narrow": create("tracker", "least_squares", bias_sigma_deg=0.2 / 3),
    }
    passes = [{"name": "ALC2", "revolution": 2, "outages_s": [60, 120]}]
    found = stage(passes, trackers, sensor, nominal_error=prior, believed_stations=False).run_cases(
        batch()
    )
    nees = {
        t: [value(found, f"ALC2.{o}.{t}.nees").mean() for o in ("60s", "120s")] for t in trackers
    }
    # χ² with 128 degrees of freedom over 64, 99.9 %
    assert min(nees["default"]) > 1.29
    assert max(nees["default"]) < 2.93
    assert min(nees["narrow"]) > 3.0


def test_stale_elements_do_not_reach_trackers_that_learn() -> None:
    ages = np.repeat([0.0, 1.0, 10.0, 30.0], 16)[None]
    trackers = {"table": create("tracker", "table"), "best": create("tracker", "least_squares")}
    # the same 16 draws of noise at each age
    same = replace(batch(names=("along_track_age",), values=ages), draws=np.tile(np.arange(16), 4))
    found = stage(SHORT, trackers, antenna(**UNBIASED), believed_stations=False).run_cases(same)
    table, best = (
        np.degrees(np.median(value(found, f"ALC2.60s.{t}.error_max").reshape(4, 16), axis=1))
        for t in trackers
    )
    assert table[0] < 1e-4
    assert_allclose(table[2:] / table[1], [10.0, 30.0], rtol=0.1)
    # 30 s are a whole standard deviation of the prior: that pulls by 4 %
    assert np.ptp(best) < 0.1 * best.max()
    assert best.max() < 0.2


def test_a_case_alone_is_the_same_as_in_a_campaign_and_a_pass_as_without_the_others() -> None:
    trackers = {"table": create("tracker", "table"), "average": create("tracker", "average")}
    keys: dict[str, Any] = {
        "nominal_error": {"position_km": 3, "velocity_m_s": 3}, "search": {"signal_back_s": 10},
    }  # fmt: skip
    other = {"name": "ALC7", "revolution": 7, "outages_s": [30]}
    both = stage([*SHORT, other], trackers, **keys)
    found = both.run_cases(replace(batch(), stream="assisted_tracking"))
    made = both.run(RecordingContext())
    assert made.metrics == found.metrics
    assert_array_equal(made.values[np.isfinite(made.values)], made.values)
    again = stage(SHORT, trackers, **keys).run_cases(replace(batch(), stream="assisted_tracking"))
    assert_array_equal(again.values, found.values[: len(again.metrics)])
    assert {name.split(".")[3] for name in found.metrics} == set(MEASURES)


def test_histories_hold_the_errors_that_the_metrics_are_of() -> None:
    trackers = {"best": create("tracker", "least_squares")}
    made = stage(SHORT, trackers, nominal_error={"position_km": 3})
    found = made.run_cases(batch(), history=True)
    kept = found.histories
    assert kept is not None
    assert kept.names[:3] == (
        "ALC2.20s.best.error", "ALC2.20s.best.sky_error", "ALC2.20s.best.encoder_error",
    )  # fmt: skip
    for row, name in zip(kept.values, kept.names, strict=True):
        begin = 20 if "20s" in name else 60
        assert_array_equal(row[begin:].max(axis=0), value(found, name + "_max"))
    # before the loss both are of the same measurements
    assert_array_equal(kept.values[:3, :20], kept.values[3:, :20])
    product = made.run(RecordingContext())
    assert product.error_rad.shape == (1, 2, product.t_s.shape[0])
    assert np.isfinite(product.spread_rad).all()
    assert np.isfinite(product.measured_rad).all()


class Diverging:
    """A table that knows nothing of some cases."""

    def __init__(self, lanes: list[int]) -> None:
        self.table = create("tracker", "table")
        self.lanes = lanes
        self.short_period = True

    def initial(self, *given: Any) -> Any:
        return self.table.initial(*given)

    def update(self, *given: Any) -> Any:
        return self.table.update(*given)

    def predict(self, *given: Any, **keys: Any) -> Any:
        azimuth, elevation, covariance = self.table.predict(*given, **keys)
        azimuth = azimuth.copy()
        azimuth[-1, self.lanes] = np.nan
        return azimuth, elevation, covariance


def test_a_tracker_that_diverges_fails_its_cases_only() -> None:
    trackers = {"table": create("tracker", "table"), "lost": Diverging([3, 40])}
    found = stage(SHORT, trackers, search={"signal_back_s": 10}).run_cases(batch())
    assert_array_equal(np.flatnonzero(found.failed), [3, 40])
    assert [found.status[k] for k in (2, 3, 40)] == ["completed", "diverged", "diverged"]
    assert [found.cause[k] for k in (2, 3, 40)] == ["", "lost", "lost"]
    assert np.isfinite(found.values[:, ~found.failed]).all()


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"outages_min": [9], "outages_s": None}, r"passes: ALC2: the signal is lost 540 s"),
        ({"revolution": 4}, r"in revolution 4 the satellite does not rise above the mask"),
        ({"elevation_max_deg": 1}, r"does not rise above the mask|cannot be reached"),
        ({"sensor": object()}, r"ALC2: its sensor must be one at a ground station"),
    ],
)
def test_passes_that_are_none(change: dict[str, Any], match: str) -> None:
    one = {k: v for k, v in (SHORT[0] | change).items() if v is not None}
    with pytest.raises(InputError, match=match):
        stage([one], {"table": create("tracker", "table")}).run_cases(batch())


def test_a_flight_that_ends_before_the_pass() -> None:
    low = {**SATELLITE["elements"], "semi_major_axis_km": 6478, "eccentricity": 0.01}  # type: ignore[dict-item]
    with pytest.raises(PropagationError, match="its flight has no revolution 2: it has come down"):
        stage(
            SHORT, {"table": create("tracker", "table")}, plant=plant(),
            satellite={"name": "low", "elements": low},
        ).run_cases(batch())  # fmt: skip


def test_faulty_inputs() -> None:
    table = {"table": create("tracker", "table")}
    with pytest.raises(InputError, match="has no input age; it has along_track_age"):
        stage(SHORT, table).run_cases(batch(names=("age",), values=np.zeros((1, 64))))
    with pytest.raises(InputError, match="body: tracking needs a body of type 'planet'"):
        stage(SHORT, table, body=object())
