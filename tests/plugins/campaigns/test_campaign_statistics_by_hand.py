"""Statistics of a campaign of mixed endings, number by number against NumPy and SciPy."""

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

N = 400
STATUS = np.array(["completed", "requirement", "impact", "completed", "error"] * (N // 5))
CAUSE = np.where(STATUS == "impact", np.where(np.arange(N) % 2, "near", "far"), "")


def mixed() -> CaseTable:
    """Return 400 cases, two of five lost on the way with values that are far off."""
    random = np.random.default_rng(12)
    values = random.gamma(3.0, size=(2, N))
    lost = (STATUS == "impact") | (STATUS == "error")
    values[:, lost] += 1e3
    values[1, [0, 5, 8]] = np.nan  # came to their end, but have no second metric
    return CaseTable(
        stage="hover",
        design="random",
        planned=N,
        stopped="",
        case=100 + 3 * np.arange(N),
        draw=np.arange(N),
        point=np.zeros(N, dtype=np.int64),
        inputs=(),
        input_units=(),
        input_values=np.empty((0, N)),
        metrics=("dv", "error"),
        units=("m/s", "m"),
        values=values,
        status=STATUS,
        cause=CAUSE,
        failed=STATUS != "completed",
        message_case=np.array([100 + 3 * 7, 100 + 3 * 12, 100 + 3 * 394]),
        messages=("seven", "twelve", "late"),
    )


def order_statistics(ordered: Array, q: float, level: float) -> Array:
    """Return the values of ranks by search: the highest l with P(B < l) ≤ α/2, the lowest h."""
    n, tail = ordered.size, 0.5 * (1.0 - level)
    below = [rank for rank in range(1, n + 1) if stats.binom.cdf(rank - 1, n, q) <= tail]
    above = [rank for rank in range(1, n + 1) if stats.binom.sf(rank - 1, n, q) <= tail]
    return np.array(
        [
            ordered[max(below) - 1] if below else -np.inf,
            ordered[min(above) - 1] if above else np.inf,
        ]
    )


@pytest.mark.parametrize("some", [False, True])
def test_all_numbers_are_over_the_cases_that_came_to_their_end(some: bool) -> None:
    """The three-sigma quantile too: two of five cases are lost a thousand units away."""
    table = mixed()
    rows = np.arange(N) < 300 if some else None
    levels, level = (0.05, 0.5, 0.9973), 0.8
    found = metric_statistics(table, rows, level=level, levels=levels)
    assert [(one.name, one.unit) for one in found] == [("dv", "m/s"), ("error", "m")]
    end = (STATUS == "completed") | (STATUS == "requirement")
    if some:
        end &= np.arange(N) < 300
    for k, one in enumerate(found):
        which = np.flatnonzero(end & ~np.isnan(table.values[k]))
        values = table.values[k, which]
        assert one.count == which.size == (180 if some else 240) - 3 * k
        assert_allclose(one.mean, values.mean(), rtol=1e-13)
        assert_allclose(one.deviation, values.std(ddof=1), rtol=1e-13)
        student = stats.ttest_1samp(values, 0.0).confidence_interval(level)
        assert_allclose(one.mean_interval, student, rtol=1e-12)
        assert_array_equal(one.deviation_interval, deviation_interval(values, level))
        assert (one.least, one.largest) == (values.min(), values.max())
        assert one.least_case == 100 + 3 * which[values.argmin()]
        assert one.largest_case == 100 + 3 * which[values.argmax()]
        assert one.levels == levels
        assert_allclose(one.quantiles, np.quantile(values, levels), rtol=1e-13)
        assert one.quantiles[2] < 100.0
        for j, q in enumerate(levels):
            expected = order_statistics(np.sort(values), q, level)
            assert_array_equal(one.quantile_intervals[:, j], expected)
        assert one.note == ""


@pytest.mark.parametrize("n", [10, 11, 40, 333])
@pytest.mark.parametrize("level", [0.9, 0.99])
def test_deviation_is_bonetts_interval(n: int, level: float) -> None:
    """Bonett (2006): exp(ln(c s²) ∓ z c √((γ − (n − 3)/n)/(n − 1))), c = n/(n − z).

    γ = n Σ(x − m)⁴/(Σ(x − x̄)²)², m the mean without the share 1/(2 √(n − 4)) at either end.
    """
    x = np.sort(np.random.default_rng(n).exponential(size=n) * 7.0 - 3.0)
    z = stats.norm.ppf(0.5 + 0.5 * level)
    cut = int(n * 0.5 / np.sqrt(n - 4.0))
    m = x[cut : n - cut].mean()
    gamma = n * ((x - m) ** 4).sum() / ((x - x.mean()) ** 2).sum() ** 2
    c = n / (n - z)
    error = c * np.sqrt((gamma - (n - 3.0) / n) / (n - 1.0))
    square = c * x.var(ddof=1) * np.exp([-z * error, z * error])
    assert_allclose(deviation_interval(x, level), np.sqrt(square), rtol=1e-12)


def test_kurtosis_below_what_is_possible_leaves_no_negative_root() -> None:
    """Of two values in equal numbers γ is 1: (γ − (n − 3)/n) is 3/n, still positive; c s² it is."""
    x = np.tile([0.0, 1.0], 20)
    low, high = deviation_interval(x)
    z = stats.norm.ppf(0.975)
    c = 40.0 / (40.0 - z)
    error = c * np.sqrt((3.0 / 40.0) / 39.0)
    assert_allclose([low, high], np.sqrt(c * x.var(ddof=1) * np.exp([-z * error, z * error])))


def test_moments_keep_the_digits_of_a_small_spread() -> None:
    values = 1e9 + np.array([0.0, 1e-3, 3e-3, 4e-3])
    about = values - 1e9  # exact, by Sterbenz
    one = describe("x", "m", values, np.arange(4))
    assert_allclose(one.mean - 1e9, about.mean(), rtol=0, atol=2e-7)
    assert_allclose(one.deviation, about.std(ddof=1), rtol=1e-12)
    low, high = mean_interval(values)
    half = stats.t.ppf(0.975, 3) * about.std(ddof=1) / 2.0
    assert_allclose([low, high], [one.mean - half, one.mean + half], rtol=0, atol=3e-7)


def test_borders_of_what_can_be_told() -> None:
    notes = {
        0: "no case came to its end",
        1: "one case only: no spread",
        2: "fewer than 10 cases: no interval of the standard deviation",
        9: "fewer than 10 cases: no interval of the standard deviation",
        10: "",
    }
    for n, note in notes.items():
        one = describe("x", "m", np.arange(float(n)), 5 + np.arange(n), levels=(0.5, 0.9))
        assert one.note == note
        assert np.isfinite(one.deviation_interval).all() == (n == 10)
        assert np.isfinite(one.mean_interval).all() == (n >= 2)
        assert np.isfinite([one.least, one.largest]).all() == (n >= 1)
        assert one.quantiles.shape == (2,)
        assert one.quantile_intervals.shape == (2, 2)
        assert (one.least_case, one.largest_case) == ((5, 4 + n) if n else (-1, -1))
        if n == 1:
            assert one.mean == one.least == one.largest == 0.0
    assert np.isnan(quantile_interval(np.empty(0), 0.5)).all()
    # of several that are least, or largest, the first
    one = describe("x", "m", np.array([2.0, 1.0, 1.0, 2.0]), np.array([7, 9, 11, 13]))
    assert (one.least_case, one.largest_case) == (9, 7)


def test_ranks_begin_and_end_within_the_values() -> None:
    """Of n values the median lies within the extremes with 1 − 2^(1−n): n = 6 for 95 %, not 5."""
    for n, known in ((5, False), (6, True)):
        interval = quantile_interval(np.arange(1.0, n + 1.0), 0.5)
        assert_array_equal(interval, [1.0, n] if known else [-np.inf, np.inf])


@pytest.mark.parametrize("some", [False, True])
def test_classes_count_shares_and_messages(some: bool) -> None:
    table = mixed()
    rows = np.arange(N) >= 10 if some else None
    total = N - 10 if some else N
    found = {(one.status, one.cause): one for one in classes(table, rows, 0.9)}
    first = {
        ("completed", ""): (160, False, 0, ""),
        ("requirement", ""): (80, True, 1, ""),
        ("impact", "far"): (40, True, 2, "twelve"),
        ("impact", "near"): (40, True, 7, "seven"),
        ("error", ""): (80, False, 4, "late"),
    }
    if some:
        first = {
            ("completed", ""): (156, False, 10, ""),
            ("requirement", ""): (78, True, 11, ""),
            ("impact", "far"): (39, True, 12, "twelve"),
            ("impact", "near"): (39, True, 17, ""),
            ("error", ""): (78, False, 14, "late"),
        }
    assert found.keys() == first.keys()
    for key, (count, failed, row, message) in first.items():
        one = found[key]
        assert (one.count, one.failed, one.first_case) == (count, failed, 100 + 3 * row)
        assert one.message == message
        # Cases that raised decide nothing: they are a part of all, the others of those decided.
        among = total if key[0] == "error" else total - first["error", ""][0]
        assert one.undecided == (key[0] == "error")
        exact = stats.binomtest(count, among).proportion_ci(0.9, method="exact")
        assert_allclose(one.interval, [exact.low, exact.high], rtol=1e-9)
    # the largest first, of those alike the one that began first
    order = [(one.status, one.cause) for one in classes(table, rows)]
    assert order == sorted(first, key=lambda key: (-first[key][0], first[key][2]))


def test_cases_of_a_status_that_failed_and_others_that_did_not() -> None:
    table = mixed()
    failed = table.failed.copy()
    failed[3] = True  # completed, and yet a failure
    found = classes(replace(table, failed=failed))
    of_status = {(one.failed, one.count) for one in found if one.status == "completed"}
    assert of_status == {(False, 159), (True, 1)}


def test_a_message_of_a_case_beyond_the_rows() -> None:
    """Messages of cases after the last that is looked at belong to none of them."""
    found = classes(mixed(), np.arange(N) < 5)
    assert [one.message for one in found] == [""] * len(found)
    assert sum(one.count for one in found) == 5


def test_ratio_of_arrays() -> None:
    count, total = np.array([[0, 1], [4, 5]]), 5
    found = ratio_interval(count, total, 0.9)
    assert found.shape == (2, 2, 2)
    for k in np.ndindex(2, 2):
        exact = stats.binomtest(int(count[k]), total).proportion_ci(0.9, method="exact")
        assert_allclose(found[(slice(None), *k)], [exact.low, exact.high], rtol=1e-9)
    assert found[0, 0, 0] == 0.0
    assert found[1, 1, 1] == 1.0
