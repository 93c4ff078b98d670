"""Statistics of campaigns against closed forms, SciPy and the coverage of their intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

from hillsphere.interfaces import Array
from hillsphere.products import CaseTable
from hillsphere_campaigns.statistics import (
    classes,
    describe,
    deviation_interval,
    mean_interval,
    metric_statistics,
    quantile_interval,
    ratio_interval,
)


def table_of(values: Array, failed: list[int] | None = None) -> CaseTable:
    """Return a campaign of one metric; some of its cases failed by impact."""
    n = values.size
    lost = np.isin(np.arange(n), failed or [])
    return CaseTable(
        stage="hover",
        design="random",
        planned=n,
        stopped="",
        case=np.arange(n),
        draw=np.arange(n),
        point=np.zeros(n, dtype=np.int64),
        inputs=(),
        input_units=(),
        input_values=np.empty((0, n)),
        metrics=("dv",),
        units=("m/s",),
        values=np.where(lost, np.nan, values)[None],
        status=np.where(lost, "impact", "completed"),
        cause=np.where(lost, "surface", ""),
        failed=lost,
        message_case=np.empty(0, dtype=np.int64),
        messages=(),
    )


@pytest.mark.parametrize(("count", "total"), [(0, 10), (1, 10), (7, 2000), (10, 10), (500, 1000)])
@pytest.mark.parametrize("level", [0.9, 0.95, 0.99])
def test_ratio_is_scipys_clopper_pearson(count: int, total: int, level: float) -> None:
    exact = stats.binomtest(count, total).proportion_ci(level, method="exact")
    assert_allclose(ratio_interval(count, total, level), [exact.low, exact.high], rtol=1e-9)


def test_ratio_closed_forms() -> None:
    # No failure in n: upper end 1 - (alpha/2)^(1/n); no trial: nothing is known.
    assert_allclose(ratio_interval(0, 100), [0.0, 1.0 - 0.025**0.01], rtol=1e-12)
    assert_array_equal(ratio_interval(0, 0), [0.0, 1.0])
    assert ratio_interval(np.arange(3), np.full(3, 5)).shape == (2, 3)


@pytest.mark.parametrize("p", [0.01, 0.2, 0.5])
def test_ratio_covers_at_least_its_level(p: float) -> None:
    n = 60
    low, high = ratio_interval(np.arange(n + 1), np.full(n + 1, n), 0.9)
    covered = stats.binom.pmf(np.arange(n + 1), n, p)[(low <= p) & (p <= high)].sum()
    assert covered >= 0.9


def test_mean_is_scipys_students_interval() -> None:
    values = np.random.default_rng(1).gamma(2.0, size=37)
    expected = stats.ttest_1samp(values, 0.0).confidence_interval(0.99)
    assert_allclose(mean_interval(values, 0.99), expected, rtol=1e-12)
    assert np.isnan(mean_interval(values[:1])).all()


@pytest.mark.parametrize(
    ("name", "sigma", "least"),
    [("norm", 1.0, 0.93), ("uniform", 12**-0.5, 0.93), ("expon", 1.0, 0.9)],
)
def test_deviation_covers_the_truth(name: str, sigma: float, least: float) -> None:
    runs = 1500
    sample = getattr(stats, name).rvs(size=(runs, 200), random_state=3)
    inside = [low <= sigma <= high for low, high in map(deviation_interval, sample)]
    assert least <= np.mean(inside) <= 0.975


def test_chi_square_would_not_cover_exponential_values() -> None:
    """The number in the docstring of `deviation_interval`."""
    n, runs = 200, 4000
    s2 = np.var(stats.expon.rvs(size=(runs, n), random_state=4), axis=1, ddof=1)
    low, high = ((n - 1) * s2 / stats.chi2.ppf(q, n - 1) for q in (0.975, 0.025))
    assert 0.62 < np.mean((low <= 1.0) & (high >= 1.0)) < 0.74


def test_deviation_of_equal_and_of_few_values() -> None:
    assert_array_equal(deviation_interval(np.full(20, 0.1)), [0.0, 0.0])
    assert np.isnan(deviation_interval(np.arange(9.0))).all()
    tiny = deviation_interval(1e-170 * np.arange(20.0))
    assert_allclose(tiny / 1e-170, deviation_interval(np.arange(20.0)), rtol=1e-9)


@pytest.mark.parametrize("q", [0.01, 0.5, 0.95, 0.9973])
@pytest.mark.parametrize("n", [3, 60, 2000])
def test_quantile_interval_is_exact_binomial(q: float, n: int) -> None:
    """Ranks, and the probability with which two order statistics hold the quantile."""
    low, high = quantile_interval(np.arange(1.0, n + 1.0), q)
    below = stats.binom.cdf(low - 1, n, q) if np.isfinite(low) else 0.0
    above = stats.binom.sf(high - 1, n, q) if np.isfinite(high) else 0.0
    assert below <= 0.025
    assert above <= 0.025
    # The next ranks inwards would be too narrow.
    assert stats.binom.cdf((low if np.isfinite(low) else 0.0), n, q) >= 0.025
    assert stats.binom.sf((high if np.isfinite(high) else n + 1) - 2, n, q) >= 0.025


def test_quantile_interval_is_scipys() -> None:
    ordered = np.sort(np.random.default_rng(5).normal(size=500))
    for q in (0.05, 0.5, 0.95):
        theirs = stats.quantile_test(ordered, p=q).confidence_interval(0.95)
        assert_allclose(quantile_interval(ordered, q), theirs, rtol=0, atol=0.05)


def test_statistics_of_the_cases_that_did_not_fail() -> None:
    values = np.random.default_rng(6).normal(5.0, 2.0, size=300)
    (one,) = metric_statistics(table_of(values, [0, 17, 299]))
    kept = np.delete(values, [0, 17, 299])
    assert one.count == 297
    assert_allclose([one.mean, one.deviation], [kept.mean(), kept.std(ddof=1)], rtol=1e-14)
    assert_allclose(one.quantiles, np.quantile(kept, one.levels), rtol=1e-14)
    assert values[one.least_case] == kept.min()
    assert values[one.largest_case] == kept.max()
    assert one.note == ""


@pytest.mark.parametrize("n", [0, 1, 2, 9])
def test_few_cases_give_nan_and_a_note(n: int) -> None:
    one = describe("dv", "m/s", np.arange(float(n)), np.arange(n))
    assert one.count == n
    assert one.note
    assert np.isnan(one.deviation_interval).all()
    assert np.isnan(one.mean) == (n == 0)
    assert np.isnan(one.deviation) == (n < 2)


def test_all_cases_failed() -> None:
    (one,) = metric_statistics(table_of(np.zeros(5), list(range(5))))
    assert one.count == 0
    assert (one.least_case, one.largest_case) == (-1, -1)


def test_classes_of_failures() -> None:
    table = table_of(np.arange(10.0), [3, 4])
    status, failed = table.status.astype("<U12"), table.failed.copy()
    status[8], failed[8] = "error", True
    table = replace(
        table,
        status=status,
        failed=failed,
        message_case=np.array([4, 8]),
        messages=("hit", "ValueError: no"),
    )
    done, hit, broke = classes(table)
    assert (done.status, done.failed, done.count, done.first_case) == ("completed", False, 7, 0)
    assert (hit.status, hit.cause, hit.failed, hit.count) == ("impact", "surface", True, 2)
    assert (hit.first_case, hit.message) == (3, "hit")
    assert (broke.status, broke.first_case, broke.message) == ("error", 8, "ValueError: no")
    # Nine cases are decided; the tenth raised, which is no failure of the flight.
    assert (broke.failed, broke.undecided) == (False, True)
    assert_allclose(hit.interval, ratio_interval(2, 9))
    some = classes(table, np.arange(10) >= 8)
    assert [(c.status, c.count, c.message) for c in some] == [
        ("error", 1, "ValueError: no"),
        ("completed", 1, ""),
    ]
    assert classes(table, np.zeros(10, dtype=bool)) == ()


def test_a_requirement_does_not_cut_the_distribution() -> None:
    """Cases short of a requirement count; cases lost on the way do not, whatever they measured."""
    table = table_of(np.arange(10.0))
    status = np.array(["completed"] * 6 + ["requirement"] * 3 + ["impact"])
    (found,) = metric_statistics(replace(table, status=status, failed=status != "completed"))
    assert (found.count, found.largest, found.mean) == (9, 8.0, 4.0)
