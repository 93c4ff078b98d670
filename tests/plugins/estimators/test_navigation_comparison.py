"""The stage ``navigation_comparison``: sets of sensors in a campaign, side by side."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere.cases.specs import MonteCarloSpec, SweepSpec
from hillsphere.errors import HillsphereError
from hillsphere.plugins import validate
from hillsphere.products import CaseTable
from hillsphere.testing import RecordingContext
from hillsphere_estimators.navigation_comparison.specs import NavigationComparisonSpec
from hillsphere_estimators.navigation_comparison.stage import (
    NavigationComparisonStage,
    paired_rms_ratio,
)


def test_paired_ratio_of_rms() -> None:
    random = np.random.default_rng(5)
    base = np.abs(random.normal(size=(2, 300)))
    draw = np.arange(300.0)
    half = paired_rms_ratio(np.vstack([0.5 * base, draw]), np.vstack([base, draw]), 0.95)
    np.testing.assert_allclose(half, 0.5, rtol=1e-12)
    other = np.abs(random.normal(size=(2, 300)))
    low, value, high = paired_rms_ratio(np.vstack([other, draw]), np.vstack([base, draw]), 0.95)
    assert low < value < high
    assert low < 1.0 < high
    # only common draws count
    some = paired_rms_ratio(np.vstack([0.5 * base, draw])[:, 100:], np.vstack([base, draw]), 0.95)
    np.testing.assert_allclose(some, 0.5, rtol=1e-12)


def campaign(*sets: tuple[float, int]) -> CaseTable:
    """Return 40 flights of one spacecraft with each set: its error, m, and how many are lost."""
    count = 40 * len(sets)
    error, lost = np.repeat(np.array(sets), 40, axis=0).T
    draw = np.tile(np.arange(40), len(sets))
    gone = draw < lost
    names = ("position_error_1", "velocity_error_1", "position_bound_1", "nees")
    spread = np.tile(np.linspace(0.9, 1.1, 40), len(sets))
    values = np.array([error * spread, spread, error * spread, 6.0 * spread])
    values[:, gone] = np.nan
    numbers = np.arange(count)
    return CaseTable(
        stage="flight", design="grid", planned=count, stopped="",
        case=numbers, draw=draw, point=numbers // 40, inputs=(),
        input_units=(), input_values=np.zeros((0, count)), metrics=names,
        units=("m", "m/s", "m", "-"), values=values,
        status=np.where(gone, "diverged", "completed"), cause=np.where(gone, "filter", ""),
        failed=gone, message_case=numbers[:0], messages=(),
        swept=("stage.flight.sensors",), swept_units=("",),
        points=np.arange(len(sets), dtype=float)[None],
        point_labels=tuple(f"set {i}" for i in range(len(sets))),
    )  # fmt: skip


def comparison(**keys: Any) -> NavigationComparisonSpec:
    table = {"needs": {"campaign": "sweep"}, "labels": ["set a", "set b"], **keys}
    spec = validate(NavigationComparisonSpec, table, where="test")
    assert isinstance(spec, NavigationComparisonSpec)
    return spec


def compare(table: CaseTable, **keys: Any) -> Any:
    one = NavigationComparisonStage(comparison(paired=True, **keys))
    product = one.run(RecordingContext(), campaign=table)
    return product, one.present(product)


def test_a_set_that_loses_flights_meets_no_requirement() -> None:
    keys: dict[str, Any] = {"masses_kg": [1, 2], "required_position_m": 5}
    product, said = compare(campaign((2.0, 35), (1.0, 0)), **keys)
    assert product.lightest == "set b, 2 kg"
    (row,) = said.tables["navigation_ratios"].rows
    assert (row["set"], row["against"]) == ("set b", "set a")
    # statistics over survivors prove nothing
    assert (row["ratio"], row["ratio_low"], row["ratio_high"]) == (0.5, None, None)
    assert product.lost.tolist() == [[35], [0]]
    rows = said.tables["navigation_comparison"].rows
    assert [row["lost"] for row in rows] == [35, 0]
    assert rows[0]["consistent"] == "no"
    assert any("set a 35 of 40" in sentence for sentence in said.verdict)
    assert not any("draw" in column.name for column in said.tables["navigation_comparison"].columns)
    product, said = compare(campaign((2.0, 0), (1.0, 0)), **keys)
    assert product.lightest == "set a, 1 kg"
    (row,) = said.tables["navigation_ratios"].rows
    np.testing.assert_allclose([row["ratio_low"], row["ratio_high"]], 0.5, rtol=1e-12)


def sweep(**keys: Any) -> CaseTable:
    """Return the flights of two sets at two intervals, the sets varying fastest."""
    table = {
        "swept": ("stage.flight.interval_s", "stage.flight.sensors", "stage.flight.count"),
        "swept_units": ("s", "", "-"), "point_labels": ("a", "b", "c", "d"),
        "points": np.array([[600.0, 600.0, 0.5, 0.5], [0.0, 1.0, 0.0, 1.0], [3.0] * 4]),
    }  # fmt: skip
    return replace(campaign((4.0, 0), (3.0, 0), (2.0, 0), (1.0, 0)), **{**table, **keys})


def test_sets_of_a_sweep_and_points_of_its_other_keys() -> None:
    product, said = compare(sweep(), required_position_m=2.5, masses_kg=[2, 1])
    assert product.points == ("10min, count 3", "0p500s, count 3")
    np.testing.assert_allclose(product.position_m[1, :, :, 0], [[4.0, 2.0], [3.0, 1.0]])
    np.testing.assert_allclose(product.ratio[1], [[0.75, 0.5]])
    assert product.lightest == "none"  # light enough, but not at both intervals
    (panel,) = said.figures["navigation_comparison"].panels
    told = {mark.label for mark in panel.marks} - {""}
    # times in a legend are written with a space
    assert told == {"0.500 s, count 3", "10 min, count 3", "rms allowed"}


def test_sets_stand_in_the_order_in_which_they_are_swept() -> None:
    """Also of what is a number: a label is that of the first value, not of the smallest."""
    points = np.array([[600.0, 600.0, 0.5, 0.5], [9.0, 5.0] * 2, [3.0] * 4])
    product, _ = compare(sweep(swept_units=("s", "m", "-"), points=points))
    np.testing.assert_allclose(product.position_m[1, :, :, 0], [[4.0, 2.0], [3.0, 1.0]])


MISFITS: list[tuple[CaseTable, dict[str, Any], str]] = [
    (campaign((1.0, 0)), {}, "labels: 2 for 1 values of 'sensors'"),
    (campaign((1.0, 0), (1.0, 0)), {"sets": "law"}, "'law'; this one is over stage.flight.sensors"),
    (replace(campaign((1.0, 0)), swept=(), points=None), {}, "this one is over nothing"),
    (sweep(swept=("stage.a.sensors", "stage.b.sensors", "c")), {}, "over one key that ends in"),
    (sweep(points=np.array([[1.0, 2.0, 3.0, 4.0], [0.0, 1.0] * 2, [3.0] * 4])), {}, "at others"),
    (replace(campaign((1.0, 0), (1.0, 0)), metrics=("a", "b", "c", "d")), {}, "has no metric"),
]


@pytest.mark.parametrize(("table", "keys", "message"), MISFITS)
def test_a_campaign_that_does_not_fit_is_refused(
    table: CaseTable, keys: dict[str, Any], message: str
) -> None:
    with pytest.raises(HillsphereError, match=message):
        compare(table, **keys)


def test_a_mission_tells_before_it_runs_that_its_campaign_does_not_fit() -> None:
    def told(table: dict[str, Any], **keys: Any) -> list[str]:
        kind = SweepSpec if "over" in table else MonteCarloSpec
        stage = validate(kind, {"repeat": "flight", **table}, where="sweep")
        spec = comparison(**keys)
        return [message for _, message in spec.misfits({"stage": {"sweep": stage}})]

    sets = [["camera"], ["lidar"]]
    over = {"repeat.sensors": sets, "repeat.interval_s": [60, 600, 3600]}
    assert told({"over": over}) == []
    assert told({"over": over}, labels=["a", "b", "c"], sets="interval_s") == []
    assert told({"over": {"repeat.sensors": [*sets, ["link"]]}}) == [
        "2 for 3 values of 'sensors'; name each of them"
    ]
    for table in ({"over": {"repeat.interval_s": [60]}}, {"cases": 64}):
        (message,) = told(table)
        assert "over one key that ends in 'sensors'" in message
    assert not list(comparison().misfits({}))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"labels": []}, "name each set"),
        ({"masses_kg": [1]}, "1 for 2"),
        ({"needs": {"campaign": "sweep", "flights": ["one"]}}, "2 for 1"),
        ({"required_position_m": 1}, "needs masses_kg"),
        ({"needs": {"flights": ["one", "two"]}, "paired": True}, "about a campaign"),
        ({"needs": {}}, "nothing is compared"),
    ],
)
def test_bad_comparison(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(HillsphereError, match=message):
        comparison(**keys)


def test_the_bound_does_not_know_of_a_gate() -> None:
    _, said = compare(campaign((2.0, 0), (1.0, 0)))
    notes = said.tables["navigation_comparison"].notes
    assert any("that a gate rejects" in note for note in notes)


def test_a_published_row_of_no_set_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "paper.csv"
    columns = "case,spacecraft,position_error_m,velocity_error_mm_s"
    path.write_text(f"# source: a paper\n{columns}\n3,1,1,1\n")
    with pytest.raises(HillsphereError, match="there are 2 sets, counted"):
        compare(campaign((2.0, 0), (1.0, 0)), reference=str(path))
