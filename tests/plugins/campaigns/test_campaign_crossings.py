"""Where failures exceed a threshold along a sweep."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.products import CaseList, CaseTable
from hillsphere.products.products import Ladder
from hillsphere_campaigns.crossings import crossing_table, crossings
from hillsphere_campaigns.sweep_points import cross_points, grid, points_of_list

SCALES = np.array([1.0, 2.0, 3.0, 4.0])


def swept(shares: list[list[int]], cases: int = 1000) -> CaseTable:
    """Return a sweep over two laws and four scales; so many of the cases of each point fail."""
    laws, scales = len(shares), len(SCALES)
    points = np.array([np.repeat(np.arange(laws), scales), np.tile(SCALES, laws)], dtype=float)
    point = np.repeat(np.arange(laws * scales), cases)
    number = np.tile(np.arange(cases), laws * scales)
    failed = number < np.array(shares).ravel()[point]
    n = point.size
    return CaseTable(
        stage="descent", design="grid", planned=n, stopped="", case=np.arange(n), draw=number,
        point=point, inputs=(), input_units=(), input_values=np.zeros((0, n)), metrics=(),
        units=(), values=np.zeros((0, n)), status=np.where(failed, "impact", "completed"),
        cause=np.full(n, ""), failed=failed, message_case=np.zeros(0, dtype=np.int64), messages=(),
        swept=("stage.d.follow", "dispersions.field.scale"), swept_units=("", "-"), points=points,
        point_labels=tuple(
            f"stage.d.follow = rt{i + 1}, dispersions.field.scale = {s:g}"
            for i in range(laws) for s in SCALES
        ),
    )  # fmt: skip


def test_the_first_crossing_is_between_the_points_beside_it() -> None:
    along, found = crossings(
        swept([[0, 5, 25, 400], [0, 0, 0, 0], [30, 40, 0, 90]]), 0.01, 0.95, chosen=False
    )
    assert along == "dispersions.field.scale"
    assert [one.others for one in found] == [f"stage.d.follow = rt{i}" for i in (1, 2, 3)]
    assert (found[0].low, found[0].high) == (2.0, 3.0)  # .005 at 2, .025 at 3
    assert found[0].surely_below == 1.0  # 5 of 1000 may be more than 1 %
    assert found[0].surely_above == 3.0
    assert (found[1].low, found[1].high) == (4.0, np.inf)
    assert found[1].surely_below == 4.0
    assert np.isnan(found[2].low)
    assert found[2].high == 1.0
    assert np.isnan(found[2].surely_below)


def test_table_says_what_no_number_can() -> None:
    table = crossing_table(swept([[0, 0, 0, 0], [30, 40, 0, 90]]), 0.01, 0.95, chosen=False)
    assert table is not None
    assert [row["said"] for row in table.rows] == [
        "never in this sweep", "from the first point on"
    ]  # fmt: skip


def test_one_case_that_was_drawn_says_little_of_its_point() -> None:
    """One repetition of dispersed flights, or the only one of a point that was flown in time."""
    table = swept([[0, 0, 0, 1]], cases=1)
    _, (one,) = crossings(table, 0.5, 0.95, chosen=False)
    assert np.isnan(one.surely_below)
    assert one.surely_above == np.inf
    assert (one.low, one.high) == (3.0, 4.0)
    _, (chosen,) = crossings(table, 0.5, 0.95, chosen=True)
    assert (chosen.surely_below, chosen.surely_above) == (3.0, 4.0)


def test_too_few_cases_for_a_threshold_are_said_to_be() -> None:
    few = crossing_table(swept([[0, 0, 3, 9]], cases=64), 0.01, 0.95, chosen=False)
    assert few is not None
    assert "none of 64 failed would still allow 5.6 %" in few.notes[-1]
    enough = crossing_table(swept([[0, 0, 30, 90]], cases=1000), 0.01, 0.95, chosen=False)
    assert enough is not None
    assert len(enough.notes) == 1


def test_a_ladder_tells_at_which_size_each_group_fails() -> None:
    """Points of a list whose coordinates all differ, two groups in any order, one case at each."""
    order = np.array([5, 0, 3, 6, 1, 4, 7, 2])
    failed = np.array([0, 0, 1, 1, 0, 0, 0, 0], dtype=bool)[order]
    groups = tuple("first" if k < 4 else "second" for k in order.tolist())
    table = replace(
        swept([[0, 0, 0, 0], [0, 0, 0, 0]], cases=1), design="list", failed=failed,
        points=np.random.default_rng(1).normal(size=(2, 8)),
        point_labels=tuple(f"{g}, {k % 4 + 1} σ" for g, k in zip(groups, order, strict=True)),
        swept_units=("-", "-"), ladder=Ladder("σ", "-", np.tile(SCALES, 2)[order], groups),
    )  # fmt: skip
    along, found = crossings(table, 0.5, 0.95, chosen=True)
    assert along == "σ"
    by_group = {one.others: one for one in found}
    # One passes and the next fails: where in between nobody has looked.
    assert (by_group["first"].low, by_group["first"].high) == (2.0, 3.0)
    assert (by_group["first"].surely_below, by_group["first"].surely_above) == (2.0, 3.0)
    assert (by_group["second"].high, by_group["second"].surely_below) == (np.inf, 4.0)
    shown = crossing_table(table, 0.5, 0.95, chosen=True)
    assert shown is not None
    said = {row["others"]: (row["said"], row["low"], row["high"]) for row in shown.rows}
    assert said == {
        "first": ("between 2 and 3", 2.0, 3.0), "second": ("never in this sweep", 4.0, None)
    }  # fmt: skip
    assert len(shown.notes) == 1


def test_a_ladder_goes_with_its_points() -> None:
    ladder = Ladder("σ", "-", np.array([1.0, 2.0, 3.0]), ("a", "a", "b"))
    cases = CaseList(("x",), ("m",), np.array([[7.0, 8.0, 9.0]]), ("p", "q", "r"), ladder)
    turned = points_of_list(cases).reordered(np.array([2, 0, 1]))
    assert turned.labels == ("r", "p", "q")
    assert turned.units == ("m",)
    assert turned.ladder is not None
    assert turned.ladder.values.tolist() == [3.0, 1.0, 2.0]
    assert turned.ladder.groups == ("b", "a", "a")
    with pytest.raises(InputError, match="3 steps and 2 groups"):
        points_of_list(replace(cases, ladder=replace(ladder, groups=("a", "b"))))


def test_every_row_of_a_list_with_every_point_of_a_grid() -> None:
    ladder = Ladder("σ", "-", np.array([1.0, 2.0]), ("a", "a"))
    rows = points_of_list(CaseList(("x",), ("m",), np.array([[7.0, 8.0]]), ("p", "q"), ladder))
    made = cross_points(rows, grid({"follow": ["rt1", "rt2"], "y": [3.0]}))
    assert (made.design, made.names, made.units) == ("list", ("x", "follow", "y"), ("m", "", ""))
    assert made.points.tolist() == [[7, 7, 8, 8], [0, 1, 0, 1], [3, 3, 3, 3]]
    assert made.labels == tuple(
        f"{row}, follow = {flight}, y = 3" for row in ("p", "q") for flight in ("rt1", "rt2")
    )
    assert made.ladder is not None
    assert made.ladder.values.tolist() == [1.0, 1.0, 2.0, 2.0]
    assert made.ladder.groups == ("a, follow = rt1, y = 3", "a, follow = rt2, y = 3") * 2
    bare = cross_points(replace(rows, labels=(), units=(), ladder=None), grid({"y": [3.0, 4.0]}))
    assert (bare.labels, bare.units, bare.ladder) == ((), (), None)
    assert bare.named(("m", ""))[1] == "x = 7 m, y = 4"
    with pytest.raises(InputError, match="x stands in the rows and in 'over'"):
        cross_points(rows, grid({"x": [1.0]}))
    with pytest.raises(InputError, match="there are 12000000 points"):
        cross_points(rows, grid({"y": np.arange(6e6).tolist()}))
