"""Flights whose filter has diverged: told by innovations, by errors, and never of a sound one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.plugins.estimators.test_navigation import joint, stage

from hillsphere.interfaces.cases import LANES, CaseBatch
from hillsphere_estimators.navigation.divergence import (
    DIVERGED_WITH_ALARM,
    DIVERGED_WITHOUT_ALARM,
    detect_divergence,
)


def test_alarm_is_given_set_after_set() -> None:
    full = np.full((9, 6), 13.0)
    nis = full.copy()
    nis[4:, 0] = 300.0  # each of the last five
    nis[5:, 1] = 300.0  # of one of them not
    nis[0, 2] = 1e12  # the prior's
    nis[4:, 3] = np.nan
    used = full.copy()
    used[4:, 4], used[4:, 5] = 3.0, 7.0  # a gate that is shut, and one that is half so
    found = detect_divergence(nis, used, full, 10.0)
    np.testing.assert_array_equal(found, [True, False, False, False, True, False])
    sent = full.copy()
    sent[8] = 0.0  # silence says nothing: the five before it count
    nis[8, 0], nis[4:8, 1], nis[3, 1] = 0.0, 300.0, 300.0
    np.testing.assert_array_equal(detect_divergence(nis, sent, sent, 10.0)[:2], [False, True])
    assert not detect_divergence(full[:1], full[:1], full[:1], 10.0).any()


@pytest.mark.parametrize("dof", [1.0, 2.0, 3.0, 5.0, 13.0])
def test_a_consistent_filter_gives_no_alarm(dof: float) -> None:
    """Of a million of one set each, fewer than ten for χ² of whatever degree: one is expected."""
    nis = np.random.default_rng(3).chisquare(dof, size=(2, 1_000_000))
    rows = np.full(nis.shape, dof)
    assert detect_divergence(nis, rows, rows, 10.0).sum() < 10


def test_a_filter_that_has_diverged_is_a_failed_row() -> None:
    """One linear update of a wide prior: completed flights with a NEES of 1e4, so far."""
    numbers = np.arange(LANES)
    batch = CaseBatch(numbers, numbers, np.zeros(LANES, bool), (), np.zeros((0, LANES)), 5, "x")
    plain = stage(estimator="plain", duration_h=2)
    result = plain.run_cases(batch)
    wrong = result.values[result.metrics.index("nees")] > 120.0
    assert wrong.sum() > 10
    np.testing.assert_array_equal(np.array(result.status) == "diverged", wrong)
    np.testing.assert_array_equal(result.failed, wrong)
    assert set(np.array(result.cause)[wrong]) == {"innovations", "errors"}
    sound = stage(duration_h=1).run_cases(batch)
    assert set(sound.status) == {"completed"}
    assert not sound.failed.any()
    lenient = stage(estimator="plain", duration_h=2, diverged_beyond=1e6).run_cases(batch)
    assert lenient.failed.sum() < wrong.sum()


def test_report_says_how_many_have_diverged_and_how_many_alarms_there_are() -> None:
    flight = joint()
    said = stage().present(flight)
    assert said.metrics["navigation_diverged"].value == 0
    assert said.metrics["navigation_alarms"].value == 0
    assert not any("diverged" in sentence for sentence in said.verdict)
    nis, ends = flight.nis.copy(), list(flight.endings)
    nis[1:, :5] = 1e4
    ends[:3] = [DIVERGED_WITH_ALARM, DIVERGED_WITH_ALARM, DIVERGED_WITHOUT_ALARM]
    said = stage().present(replace(flight, nis=nis, endings=tuple(ends)))
    assert said.metrics["navigation_diverged"].value == 3
    assert said.metrics["navigation_alarms"].value == 5
    assert said.metrics["navigation_consistent"].value is False
    told = " ".join(said.verdict)
    assert "3 of 64 flights have diverged; the innovations show it in 2 of them" in told
    assert "the innovations of 3 of 64 flights raise an alarm although" in told
