"""The mission ``apophis-formation``: what the formation navigation paper claims of its sensors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from tests.missions.pages import check_page

from hillsphere.mission import load_mission
from hillsphere.products import CaseTable, load_product
from hillsphere.runs.assembly import Assembly
from hillsphere.testing import RecordingContext
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.navigation.metrics import ratio_to_bound

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.missions.conftest import Run

CASES = ("case_1", "case_2", "case_3", "case_4")


@pytest.fixture(scope="module")
def fast(tmp_path_factory: pytest.TempPathFactory, mission_run: Callable[..., Run]) -> Run:
    out = tmp_path_factory.mktemp("missions") / "formation"
    return mission_run(out, "apophis-formation", "--profile", "fast", "--no-cache")


def test_all_flights_come_to_their_end(fast: Run) -> None:
    metrics = fast.summary["metrics"]
    assert [metrics[f"navigation_lost_{case}"]["value"] for case in CASES] == [0] * 4


def test_more_sensors_more_precise(fast: Run) -> None:
    """Case 4 is surely better than case 1; medians fall from case to case, as in Table 4."""
    rows = fast.rows("navigation_comparison")
    median = np.array([row["median_m"] for row in rows]).reshape(4, -1).mean(axis=1)
    assert (np.diff(median) < 0).all()
    assert all(row["ratio_low"] < 1.0 for row in fast.rows("navigation_ratios"))
    assert {row["draw_m"] for row in rows} >= {11.028, 1.699}


def test_iterated_update_is_consistent_and_the_plain_one_is_not(fast: Run) -> None:
    low, high = chi_square_band(12, 64)
    for case in CASES:
        value = fast.summary["metrics"][f"navigation_nees_{case}"]["value"]
        assert low <= value <= high, case
    assert fast.summary["metrics"]["navigation_nees_plain"]["value"] > 100 * high


def test_errors_are_about_as_large_as_their_bound(fast: Run) -> None:
    """As near 0.85 to 1.2 as 64 flights can tell: within two standard errors, of all cases."""
    rows = fast.rows("navigation_comparison")
    assert len(rows) == 8
    for row in rows:
        slack = 2.0 * row["ratio_se"]
        assert row["ratio_se"] < 0.2, row
        assert 0.85 - slack < row["ratio"] < 1.2 + slack, row


def test_every_sensor_sees_the_asteroid_in_every_flight(fast: Run) -> None:
    """Starts 10 % off lie outside some images: those spacecraft search."""
    for case in CASES:
        rows = fast.rows(f"navigation_sensors_{case}")
        assert rows
        assert all(row["blind"] == 0 for row in rows), case
        assert all(row["seen"] == 1.0 for row in rows if "camera" in row["sensor"]), case


def test_verdict_has_the_criteria(fast: Run) -> None:
    said = " ".join(fast.summary["verdict"]["notes"])
    assert "times their Cramér-Rao bound" in said
    assert "In 4 of 4 sets" in said
    assert "never measure" not in said


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Fly the day of each case at 10 min, 1 h and 4 h, 200 draws each."""
    from hillsphere.interfaces.cases import LANES, CaseBatch

    assembly = Assembly(load_mission("apophis-formation"))
    reference = assembly.get("stage", "reference").run(RecordingContext())
    found: dict[str, Any] = {}
    for case in CASES:
        for hours in (1 / 6, 1, 4):
            stage = assembly.get("stage", case)
            if hours != 1:
                spec = stage.spec.model_copy(update={"interval_s": 3600.0 * hours})
                stage = type(stage)(spec)
            blocks = []
            for first in range(0, 200, LANES):
                numbers = np.minimum(np.arange(first, first + LANES), 199)
                filler = np.arange(first, first + LANES) > 199
                batch = CaseBatch(
                    numbers, numbers, filler, (), np.zeros((0, LANES)), 1, "formation"
                )
                result = stage.run_cases(batch, reference=reference)
                blocks.append(result.values[:, ~filler])
            found[f"{case} {hours}"] = dict(
                zip(result.metrics, np.concatenate(blocks, axis=1), strict=True)
            )
    return found


@pytest.mark.slow
def test_two_hundred_draws_are_consistent_and_near_their_bound(full: dict[str, Any]) -> None:
    low, high = chi_square_band(12, 200)
    for name, value in full.items():
        assert low <= value["nees"].mean() <= high, name
        for s in (1, 2):
            ratio, _ = ratio_to_bound(value[f"position_error_{s}"], value[f"position_bound_{s}"])
            assert 0.85 < ratio < 1.2, name


@pytest.mark.slow
def test_errors_fall_from_case_to_case(full: dict[str, Any]) -> None:
    for hours in (1 / 6, 1, 4):
        rms = [
            np.sqrt(np.mean([full[f"{case} {hours}"][f"position_error_{s}"] ** 2 for s in (1, 2)]))
            for case in CASES
        ]
        assert (np.diff(rms) < 0).all(), hours


@pytest.mark.slow
def test_a_filter_that_reckons_with_a_wrong_world_is_consistent() -> None:
    """Ellipsoid, spin + 1 %, lit discs, pressure + 20 %, thrust + 2 %, cases 1 and 2."""
    assembly = Assembly(load_mission("apophis-formation"))
    reference = assembly.get("stage", "reference").run(RecordingContext())
    low, high = chi_square_band(12, 64)
    for case in (1, 2):
        unaware = assembly.get("stage", f"wrong_{case}").run(
            RecordingContext(), reference=reference
        )
        aware = assembly.get("stage", f"reckoned_{case}").run(
            RecordingContext(), reference=reference
        )
        assert unaware.nees[-1].mean() > 10 * high
        assert low < aware.nees[-1].mean() < high
        rms = [np.sqrt(np.mean(one.position_error_m[:, -1] ** 2)) for one in (unaware, aware)]
        assert rms[1] < rms[0]


def test_saved_campaign_is_of_the_stage(fast: Run) -> None:
    table = load_product(fast.directory / "cases.npz")
    assert isinstance(table, CaseTable)
    assert table.case.size == 4 * 64
    assert {"position_error_1", "position_bound_2", "nees"} <= set(table.metrics)
    assert not table.failed.any()


def test_the_lightest_set_of_the_trade_is_as_precise_as_required(fast: Run) -> None:
    """And case 1 flies in it as it does beside the others, on the same draws."""
    rows = fast.rows("navigation_comparison_choice")
    rms: dict[str, list[float]] = {}
    for row in rows:
        rms.setdefault(row["set"], []).append(row["rms_m"])
    spec = Assembly(load_mission("apophis-formation", profile="fast")).get("stage", "choice").spec
    meeting = [
        (mass, name)
        for mass, name in zip(spec.masses_kg, spec.labels, strict=True)
        if max(rms[name]) <= spec.required_position_m
    ]
    said = fast.summary["metrics"]["navigation_lightest_choice"]["value"]
    assert said == "{1}, {0:g} kg".format(*min(meeting))
    first = [row["rms_m"] for row in fast.rows("navigation_comparison") if row["set"] == "case 1"]
    assert rms["cameras, ranges"] == first


@pytest.mark.slow
def test_its_page_works_in_a_browser(fast: Run) -> None:
    check_page(fast.directory)
