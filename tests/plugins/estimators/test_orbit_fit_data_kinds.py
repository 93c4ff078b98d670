"""Which kinds of tracking data the stage ``orbit_fit`` fits, and what it says of the others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.plugins.estimators import tracking_simulation as sim
from tests.plugins.estimators.test_orbit_fit import stage

from hillsphere.formats.tdm import Series, TdmMeta, TdmSegment, write_tdm
from hillsphere.formats.tdm_keywords import DATA
from hillsphere.time import Epoch
from hillsphere_estimators.orbit_fit.data_kinds import FITTED, MODELS, reason_left_out
from hillsphere_estimators.orbit_fit.reading import TrackingData, read_tracking_data

ZERO = Epoch.parse(sim.DATE, "UTC")
T = np.array([600.0, 620.0, 640.0])
STATIONS = [{"name": n, "latitude_deg": a, "longitude_deg": b, "height_m": h}
            for n, (a, b, h) in sim.PLACES.items()]  # fmt: skip


def read(tmp_path: Path, *segments: TdmSegment, **keys: Any) -> TrackingData:
    path = tmp_path / "data.tdm"
    path.write_text(write_tdm(list(segments)), "utf-8")
    one = stage(data=[{"file": str(path)}], stations=STATIONS, spacecraft="SAT", **keys)
    return read_tracking_data(one.spec, ZERO)


def segment(series: dict[str, Series], **keys: Any) -> TdmSegment:
    given: dict[str, Any] = {"path": (1, 2, 1), "mode": "SEQUENTIAL", **keys}
    participants = given.pop("participants", ("A", "SAT"))
    return TdmSegment(TdmMeta(participants, given.pop("path"), "UTC", **given), ZERO, series)


RANGES = segment({"RANGE": Series(T, np.array([2e6, 2.1e6, 2.2e6]))}, range_units="km")
REASONS = {
    "RECEIVE_PHASE_CT_1": "phase counts are not used", "DOR": "differenced data",
    "VLBI_DELAY": "differenced data", "DOPPLER_COUNT": "counts are not used",
    "CLOCK_BIAS": "clocks are not corrected", "CLOCK_DRIFT": "clocks are not corrected",
    "STEC": "atmosphere", "TROPO_DRY": "atmosphere", "TROPO_WET": "atmosphere",
    "PRESSURE": "weather", "RHUMIDITY": "weather", "TEMPERATURE": "weather",
    "CARRIER_POWER": "nothing of the orbit", "MAG": "nothing of the orbit",
    "PC_N0": "nothing of the orbit", "PR_N0": "nothing of the orbit",
    "RCS": "nothing of the orbit",
}  # fmt: skip


def test_every_kind_of_the_standard_is_fitted_or_named() -> None:
    """No keyword of the data is passed over in silence."""
    for keyword in DATA:
        stem = keyword.rstrip("12345").rstrip("_") if keyword[-1].isdigit() else keyword
        used = keyword in FITTED or stem in (*FITTED, *MODELS)
        assert used != bool(reason_left_out(keyword)), keyword
    for keyword, reason in REASONS.items():
        assert reason in reason_left_out(keyword)


@pytest.mark.parametrize("keyword", ["CLOCK_BIAS", "TROPO_DRY", "CARRIER_POWER", "PRESSURE"])
def test_data_that_do_not_enter_are_counted_with_their_reason(keyword: str, tmp_path: Path) -> None:
    """Before, clocks, the atmosphere and the weather were passed over without a word."""
    value = {"CLOCK_BIAS": 1e-6, "TROPO_DRY": 2.3, "CARRIER_POWER": -150.0, "PRESSURE": 1e5}
    own = segment({keyword: Series(T, np.full(3, value[keyword]))})
    data = read(tmp_path, RANGES, own)
    ((what, count),) = data.left_out.items()
    assert (what[0], count) == (keyword, 3)
    assert REASONS[keyword] in what[1]
    assert len(data.records) == 1


def test_differenced_data_are_left_out_by_name(tmp_path: Path) -> None:
    """A mode of single differences, with ranges of two paths, beside ranges that are fitted."""
    series = {"RECEIVE_FREQ": Series(T, np.full(3, 1e3)), "DOR": Series(T, np.full(3, 1e-6))}
    one = segment(series, path=(), path_1=(3, 1), path_2=(3, 2), mode="SINGLE_DIFF",
                  participants=("A", "B", "SAT"))  # fmt: skip
    data = read(tmp_path, RANGES, one)
    assert {what: count for (what, _), count in data.left_out.items()} == {
        "RECEIVE_FREQ": 3, "DOR": 3,
    }  # fmt: skip
    assert all("differenced data" in why for _, why in data.left_out)


def test_three_way_ranges_and_integrated_doppler_are_read(tmp_path: Path) -> None:
    """Station A sends, B receives; the whole way and half of it; the interval begins at the tag.

    What is expected of them is compared with another code in `test_orbit_fit_observables`.
    """
    three = segment({"RANGE": Series(T, np.array([4e6, 4.1e6, 4.2e6])),
                     "DOPPLER_INTEGRATED": Series(T, np.array([-3e3, -2e3, -1e3]))},
                    participants=("A", "SAT", "B"), path=(1, 2, 3), range_units="km",
                    integration_interval_s=10.0, integration_ref="START",
                    timetag_ref="RECEIVE")  # fmt: skip
    data = read(tmp_path, three, two_way_range="whole", two_way_range_rate="half")
    by_kind = {record.observable.kind: record.observable for record in data.records}
    assert by_kind["range"].path == ("A", "SAT", "B")
    assert by_kind["range"].share == 1.0
    rate = by_kind["range_rate"]
    assert (rate.share, rate.interval_s, rate.middle) == (0.5, 10.0, 0.5)
    assert data.left_out == {}
