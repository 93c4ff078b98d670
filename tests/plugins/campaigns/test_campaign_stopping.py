"""Rules that end a campaign: where they cut, and what looking after every block costs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from scipy.stats import binom

from hillsphere.cases.case_classes import ratio_interval
from hillsphere.errors import StageError
from hillsphere.interfaces import Array
from hillsphere_campaigns.statistics import mean_interval
from hillsphere_campaigns.stopping import StopCriteria


@dataclass(frozen=True)
class Toy:
    """A finished block."""

    failed: NDArray[np.bool_]
    values: Array = field(default_factory=lambda: np.zeros((0, 64)))
    metrics: tuple[str, ...] = ()

    @property
    def status(self) -> NDArray[np.str_]:
        return np.where(self.failed, "impact", "completed")


def blocks(failed: NDArray[np.bool_], values: Array | None = None) -> list[Toy]:
    if values is None:
        return [Toy(f) for f in failed.reshape(-1, 64)]
    parts = zip(failed.reshape(-1, 64), values.reshape(-1, 1, 64), strict=True)
    return [Toy(f, np.where(f, np.nan, v), ("dv",)) for f, v in parts]


def ends_after(criteria: StopCriteria, done: list[Toy]) -> tuple[int, str]:
    """Ask after every block; return the number of blocks at the end, and why."""
    rule = criteria.rule()
    for n in range(1, len(done) + 1):
        if why := rule(done[:n]):
            return n, why
    return len(done), ""


def test_failure_ratio_is_narrow() -> None:
    failed = np.random.default_rng(1).random(64 * 40) < 0.05
    n, why = ends_after(StopCriteria(failure_half_width=0.02, least_cases=64), blocks(failed))
    reach = []
    for k in range(1, 41):
        count = np.count_nonzero(failed[: 64 * k])
        low, high = ratio_interval(count, 64 * k)
        reach.append(max(high - count / (64 * k), count / (64 * k) - low))
    assert n == 1 + int(np.argmax(np.array(reach) <= 0.02))
    assert 1 < n < 40
    assert "failure ratio" in why
    assert f"of {64 * n} cases failed" in why


def test_mean_is_narrow_over_the_cases_that_did_not_fail() -> None:
    rng = np.random.default_rng(2)
    values, failed = 1e7 + rng.exponential(size=64 * 40), rng.random(64 * 40) < 0.1
    criteria = StopCriteria(mean_half_widths={"dv": 0.1}, least_cases=64)
    n, why = ends_after(criteria, blocks(failed, values))
    half = []
    for k in range(1, 41):
        low, high = mean_interval(values[: 64 * k][~failed[: 64 * k]])
        half.append(0.5 * (high - low))
    assert n == 1 + int(np.argmax(np.array(half) <= 0.1))
    assert 1 < n < 40
    assert "mean dv" in why


def test_both_must_be_narrow() -> None:
    rng = np.random.default_rng(3)
    done = blocks(rng.random(64 * 60) < 0.05, rng.normal(size=64 * 60))
    first = ends_after(StopCriteria(failure_half_width=0.02, least_cases=64), done)[0]
    second = ends_after(StopCriteria(mean_half_widths={"dv": 0.06}, least_cases=64), done)[0]
    both = StopCriteria(failure_half_width=0.02, mean_half_widths={"dv": 0.06}, least_cases=64)
    n, why = ends_after(both, done)
    assert n == max(first, second)
    assert min(first, second) < n
    assert "failure ratio" in why
    assert "mean dv" in why


def test_too_many_failures() -> None:
    failed = np.random.default_rng(4).random(64 * 40) < 0.3
    n, why = ends_after(StopCriteria(failures_above=0.2, least_cases=64), blocks(failed))
    lows = [ratio_interval(np.count_nonzero(failed[: 64 * k]), 64 * k)[0] for k in range(1, 41)]
    assert n == 1 + int(np.argmax(np.array(lows) > 0.2))
    assert "above the limit of 0.2" in why
    assert ends_after(StopCriteria(failures_above=0.5), blocks(failed)) == (40, "")


def test_not_before_so_many_cases() -> None:
    done = blocks(np.ones(64 * 10, dtype=bool))
    assert ends_after(StopCriteria(failures_above=0.1, least_cases=300), done)[0] == 5
    assert ends_after(StopCriteria(failures_above=0.1, least_cases=64), done)[0] == 1


def test_the_confidence_level_counts() -> None:
    done = blocks(np.random.default_rng(5).random(64 * 80) < 0.1)
    n = [
        ends_after(StopCriteria(failure_half_width=0.03, least_cases=64, level=p), done)[0]
        for p in (0.8, 0.95, 0.99)
    ]
    assert n[0] < n[1] < n[2] < 80


def test_a_rule_begins_anew_with_a_shorter_prefix() -> None:
    done = blocks(np.random.default_rng(6).random(64 * 20) < 0.1)
    rule = StopCriteria(failure_half_width=0.03, least_cases=64).rule()
    ask = [rule(done[:n]) for n in range(1, 21)]
    assert [rule(done[:n]) for n in range(1, 21)] == ask
    assert any(ask)


def test_what_is_not_known_ends_nothing() -> None:
    """Every case of the first block raised: its metrics are unknown."""
    rng = np.random.default_rng(7)
    lost = Toy(np.ones(64, dtype=bool))
    done = [lost, *blocks(np.zeros(64 * 9, dtype=bool), rng.normal(size=64 * 9))]
    criteria = StopCriteria(mean_half_widths={"dv": 0.2}, least_cases=64)
    n, why = ends_after(criteria, done)
    assert 1 < n < 10
    assert why
    assert ends_after(criteria, [lost] * 5) == (5, "")
    with pytest.raises(StageError, match=r"mean of 'dw'.*metrics: dv"):
        ends_after(StopCriteria(mean_half_widths={"dw": 0.2}), done)


def exact(p: float, criteria: StopCriteria, most: int) -> tuple[float, float]:
    """Return with what probability a campaign ends within so many blocks, and covers p then.

    The distribution of the number of failures among the campaigns that still go on is carried from
    block to block; those that a rule would end there leave it.
    """
    of_block = binom.pmf(np.arange(65), 64, p)
    going, ended, covered = np.ones(1), 0.0, 0.0
    for block in range(1, most + 1):
        n = 64 * block
        going = np.convolve(going, of_block)
        if n < criteria.least_cases:
            continue
        count = np.arange(n + 1)
        low, high = ratio_interval(count, n, criteria.level)
        if criteria.failures_above is not None:
            out = low > criteria.failures_above
        else:
            out = np.maximum(count / n - low, high - count / n) <= criteria.failure_half_width
        ended += going[out].sum()
        covered += going[out & (low <= p) & (p <= high)].sum()
        going = np.where(out, 0.0, going)
    return ended, covered


def test_price_of_looking_after_every_block() -> None:
    """The numbers in the docstring of `StopCriteria`: repeated looks promise too much."""
    single = exact(0.1, StopCriteria(failures_above=0.1, least_cases=2048), 32)[0]
    every = exact(0.1, StopCriteria(failures_above=0.1), 32)[0]
    assert_allclose(single, 0.02215, rtol=0, atol=5e-5)
    assert_allclose(every, 0.1031, rtol=0, atol=5e-5)


def test_coverage_of_the_interval_at_the_end() -> None:
    ended, covered = exact(0.05, StopCriteria(failure_half_width=0.02), 100)
    assert_allclose(ended, 1.0, rtol=1e-12)
    assert_allclose(covered, 0.9662, rtol=0, atol=5e-5)


def test_the_exact_numbers_are_those_of_the_rule() -> None:
    """The rule itself, in simulated campaigns."""
    criteria = StopCriteria(failures_above=0.1)
    failed = np.random.default_rng(8).random((300, 64 * 20)) < 0.12
    ended = [bool(ends_after(criteria, blocks(f))[1]) for f in failed]
    assert_allclose(np.mean(ended), exact(0.12, criteria, 20)[0], rtol=0, atol=0.09)


def test_coverage_of_the_mean_at_the_end() -> None:
    runs, covered = 400, 0
    rng = np.random.default_rng(10)
    criteria = StopCriteria(mean_half_widths={"dv": 0.1})
    for _ in range(runs):
        values = rng.exponential(size=64 * 16)
        n, why = ends_after(criteria, blocks(np.zeros(64 * 16, dtype=bool), values))
        low, high = mean_interval(values[: 64 * n])
        covered += bool(why) and low <= 1.0 <= high
    assert_allclose(covered / runs, 0.945, rtol=0, atol=0.035)
