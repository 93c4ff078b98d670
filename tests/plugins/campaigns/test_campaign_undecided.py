"""Undecided cases are neither failures nor successes, and no claim rests on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.cases.case_classes import (
    UNDECIDED,
    case_class,
    failure_ratio,
    ratio_of,
    what_left_it_undecided,
)
from hillsphere.interfaces import Array
from hillsphere.products import CaseTable
from hillsphere_campaigns.campaign_comparison.stage import paired_failures
from hillsphere_campaigns.result_tables import undecided_table
from hillsphere_campaigns.stopping import StopCriteria


def table_of(values: Array, failed: list[int]) -> CaseTable:
    n = values.size
    flags = np.isin(np.arange(n), failed)
    numbers = np.arange(n, dtype=np.int64)
    return CaseTable(
        stage="hover",
        design="random",
        planned=n,
        stopped="",
        case=numbers,
        draw=numbers,
        point=np.zeros(n, dtype=np.int64),
        inputs=(),
        input_units=(),
        input_values=np.zeros((0, n)),
        metrics=("dv",),
        units=("m/s",),
        values=values[None],
        status=np.where(flags, "impact", "completed"),
        cause=np.where(flags, "surface", ""),
        failed=flags,
        message_case=np.empty(0, dtype=np.int64),
        messages=(),
    )


def with_statuses(failed: list[int], undecided: list[int], status: str = "unresolved") -> CaseTable:
    table = table_of(np.arange(20.0), failed)
    words = table.status.astype("<U12")
    words[undecided] = status
    # Whoever wrote the table may have called them failed: the class says what counts.
    flags = table.failed.copy()
    flags[undecided] = True
    return replace(table, status=words, failed=flags)


@pytest.mark.parametrize("status", ["unresolved", "step_size", "step_error", "input", "error"])
def test_ratio_is_over_decided_cases_and_beside_it_stands_the_range(status: str) -> None:
    # 3 of 16 decided cases fail; 4 of 20 are open: 3/20 if none of them had failed, 7/20 if all.
    found = ratio_of(with_statuses([0, 1, 2], [5, 6, 7, 8], status))
    assert (int(found.failures), int(found.decided), int(found.undecided)) == (3, 16, 4)
    assert_allclose(found.value, 3 / 16)
    assert_allclose(found.range, [3 / 20, 7 / 20])
    assert case_class(status, True).startswith("undecided (")


@pytest.mark.parametrize("status", list(UNDECIDED))
def test_every_status_of_an_undecided_case_is_explained(status: str) -> None:
    (_, _, explained) = undecided_table(with_statuses([0], [5, 6], status)).notes
    assert explained.startswith(f"What the statuses mean: {status}: ")
    assert "; completed" not in explained


def test_statuses_of_decided_cases_need_no_explanation() -> None:
    assert what_left_it_undecided(["completed", "impact"]) == ""


def test_decided_cases_alone_have_one_interval() -> None:
    found = failure_ratio(3, 20, 0)
    assert_allclose(found.sure, found.interval, rtol=1e-15)


def test_a_campaign_does_not_stop_for_what_undecided_cases_could_turn() -> None:
    # 12 of 20 fail: at 95 % more than 0.36. With 8 of these undecided it is 4 of 20: above 0.058.
    rule = StopCriteria(failures_above=0.3, least_cases=20).rule()
    assert rule([with_statuses(list(range(12)), [])])
    rule = StopCriteria(failures_above=0.3, least_cases=20).rule()
    assert rule([with_statuses([0, 1, 2, 3], list(range(4, 12)))]) == ""


def test_pairs_with_an_undecided_case_are_left_out_and_could_turn_the_answer() -> None:
    rows = np.arange(20)
    worse = with_statuses(list(range(10)), [])
    better = with_statuses([], [])
    sure = paired_failures(better, rows, worse, rows)
    assert (sure.pairs, sure.undecided, sure.only_b) == (20, 0, 10)
    assert sure.sure[0] == sure.interval[0] > 0.0
    # The better one did not finish eight of the cases in which the other failed not: all of them
    # may have failed, 10 against 8.
    doubtful = with_statuses([], list(range(10, 18)))
    found = paired_failures(doubtful, rows, worse, rows)
    assert (found.pairs, found.undecided, found.only_b, found.only_a) == (12, 8, 10, 0)
    assert found.interval[0] > 0.0
    assert found.sure[0] < 0.0
