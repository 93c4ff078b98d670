"""Sensitivities of campaigns against SciPy, the Ishigami function and simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray
from scipy import stats
from scipy.stats import qmc

from hillsphere.interfaces import Array
from hillsphere.products import CaseTable
from hillsphere_campaigns.explanatory import explanatory
from hillsphere_campaigns.sensitivity import (
    SobolIndices,
    holm,
    independent_cases,
    rank_correlations,
    sobol_of,
    too_few_failures,
)


def table_of(
    inputs: Array, values: Array, failed: Array | NDArray[np.bool_] | None = None
) -> CaseTable:
    """Return a campaign with these inputs (k, N) and metrics (m, N)."""
    (k, n), m = inputs.shape, len(values)
    lost = np.zeros(n, dtype=bool) if failed is None else failed.astype(bool)
    return CaseTable(
        stage="hover",
        design="random",
        planned=n,
        stopped="",
        case=np.arange(n),
        draw=np.arange(n),
        point=np.zeros(n, dtype=np.int64),
        inputs=tuple(f"x{i}" for i in range(k)),
        input_units=("m",) * k,
        input_values=inputs,
        metrics=tuple(f"y{j}" for j in range(m)),
        units=("s",) * m,
        values=np.where(lost, np.nan, values),
        status=np.where(lost, "impact", "completed"),
        cause=np.full(n, ""),
        failed=lost,
        message_case=np.empty(0, dtype=np.int64),
        messages=(),
    )


def designed(x: Array, values: Array) -> CaseTable:
    """Return a campaign of samples A, B and others, all with the draws of the first."""
    table, n = table_of(x, values), x.shape[1] // (len(x) + 2)
    return replace(table, design="sobol_indices", draw=np.arange(x.shape[1]) % n)


def saltelli(k: int, n: int, seed: int = 1) -> Array:
    """Return A, B and the k samples of A with one row of B, uniform in (0, 1): (k, n (k + 2))."""
    both = qmc.Sobol(2 * k, rng=seed).random(n).T
    a, b = both[:k], both[k:]
    parts = [a, b]
    for i in range(k):
        ab = a.copy()
        ab[i] = b[i]
        parts.append(ab)
    return np.concatenate(parts, axis=1)


def ishigami(x: Array) -> Array:
    x = 2.0 * np.pi * x - np.pi
    return np.asarray(np.sin(x[0]) + 7.0 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0]))


def test_spearman_is_scipys() -> None:
    rng = np.random.default_rng(1)
    x = rng.normal(size=(3, 200))
    x[2] = np.round(x[2])  # ties
    y = np.array([x[0] ** 3 + rng.normal(size=200), x[2] + rng.normal(size=200)])
    failed = np.arange(200) % 9 == 0
    found = rank_correlations(table_of(x, y, failed))
    assert found.metrics == ("y0", "y1", "failed")
    assert_array_equal(found.count, [177, 177, 200])
    for i in range(3):
        for j in range(2):
            theirs = stats.spearmanr(x[i, ~failed], y[j, ~failed])
            assert_allclose(found.rho[i, j], theirs.statistic, rtol=1e-12, atol=1e-15)
            assert_allclose(found.p[i, j], theirs.pvalue, rtol=1e-9)
    assert found.strongest()[0] in ((0, 0), (2, 1))


def test_failure_is_scipys_mann_whitney() -> None:
    rng = np.random.default_rng(2)
    x = np.array([rng.normal(size=300), np.round(rng.normal(size=300))])
    failed = x[0] + x[1] + rng.normal(size=300) > 1.5
    found = rank_correlations(table_of(x, np.zeros((0, 300)), failed))
    assert found.metrics == ("failed",)
    for i in range(2):
        theirs = stats.mannwhitneyu(x[i, failed], x[i, ~failed], method="asymptotic")
        size = failed.sum() * (~failed).sum()
        assert_allclose(found.rho[i, 0], 2.0 * theirs.statistic / size - 1.0, rtol=1e-12)
        assert_allclose(found.p[i, 0], theirs.pvalue, rtol=1e-9)
    assert np.isnan(found.interval).all()
    separated = rank_correlations(table_of(x, np.zeros((0, 300)), x[0] > 1.0))
    assert separated.rho[0, 0] == 1.0


def test_a_handful_of_failures_is_correlated_with_nothing() -> None:
    # Of nine failures the coefficient by chance has a standard deviation of 1/√27 = 0.19.
    rng = np.random.default_rng(11)
    x = rng.normal(size=(20, 200))
    y = 0.4 * x[3] + rng.normal(size=200)
    for failures in (1, 9, 10, 190, 191):
        failed = np.arange(200) < failures
        table = table_of(x, y[None], failed)
        found = rank_correlations(table)
        enough = min(failures, 200 - failures) >= 10
        assert ("failed" in found.metrics) == enough
        assert bool(too_few_failures(table)) != enough


def test_interval_covers_the_coefficient() -> None:
    """Normal pairs of correlation r have Spearman's coefficient 6/π asin(r/2)."""
    r, runs, inside = 0.7, 500, 0
    truth = 6.0 / np.pi * np.arcsin(r / 2.0)
    rng = np.random.default_rng(3)
    for _ in range(runs):
        x, e = rng.normal(size=(2, 80))
        y = r * x + np.sqrt(1.0 - r**2) * e
        low, high = rank_correlations(table_of(x[None], y[None])).interval[:, 0, 0]
        inside += low <= truth <= high
    assert_allclose(inside / runs, 0.95, rtol=0, atol=0.03)


def test_holm() -> None:
    # Holm (1979): the i-th smallest of n times n - i + 1, never less than the one before.
    p = np.array([[0.01, 0.04], [0.03, np.nan]])
    assert_allclose(holm(p), [[0.03, 0.06], [0.06, np.nan]], rtol=1e-12)
    assert_allclose(holm(np.array([0.9, 0.8])), [1.0, 1.0])
    assert holm(np.empty((0, 3))).shape == (0, 3)


def test_holm_keeps_false_alarms_rare() -> None:
    rng = np.random.default_rng(4)
    alarms = 0
    for _ in range(300):
        found = rank_correlations(table_of(rng.normal(size=(5, 60)), rng.normal(size=(4, 60))))
        alarms += bool((found.p_holm < 0.05).any())
    assert alarms / 300 < 0.09


def test_what_is_constant_correlates_with_nothing() -> None:
    rng = np.random.default_rng(5)
    x = rng.normal(size=(3, 50))
    x[1], x[2] = 4.0, x[0]
    table = table_of(x, np.array([np.full(50, 2.0), x[0]]))
    assert explanatory(table).names == ("x0",)  # x1 is constant, x2 the same as x0
    some = np.where(np.arange(50) < 3, np.nan, x[0])  # some variants do not have it
    assert explanatory(replace(table, input_values=np.array([x[0], x[1], some]))).names == ("x0",)
    found = rank_correlations(table)
    assert np.isnan(found.rho[0, 0])
    assert_allclose(found.rho[0, 1], 1.0, rtol=1e-15)
    assert_allclose(found.p[0, 1], 0.0, rtol=0, atol=1e-300)
    assert found.strongest() == [(0, 1)]


@pytest.mark.parametrize("n", [0, 1, 2, 3])
def test_few_cases(n: int) -> None:
    x = np.arange(float(n))[None]
    found = rank_correlations(table_of(x, x))
    assert found.rho.shape == ((1, 1) if n > 1 else (0, 1))
    assert np.isnan(found.interval).all()
    everything = rank_correlations(table_of(x, x, np.ones(n)))
    assert np.isnan(everything.rho).all()


def test_points_of_a_sweep() -> None:
    """Swept quantities explain too; where points share their draws there are no p values."""
    rng = np.random.default_rng(6)
    draws, points = np.tile(np.arange(40), 3), np.repeat(np.arange(3), 40)
    noise = rng.normal(size=40)[draws]
    table = table_of(noise[None], (2.0 * points + noise)[None])
    table = replace(
        table, draw=draws, point=points, swept=("gain",), swept_units=("-",),
        points=np.array([[1.0, 2.0, 3.0]]), point_labels=("a", "b", "c"),
    )  # fmt: skip
    found = rank_correlations(table)
    assert found.inputs == ("gain", "x0")
    assert found.rho[0, 0] > found.rho[1, 0] > 0.0
    assert found.dependent
    assert np.isnan(found.p).all()
    single = replace(table, draw=np.zeros(120, dtype=np.int64))
    assert not rank_correlations(single).dependent


def test_sobol_indices_of_the_ishigami_function() -> None:
    """Ishigami and Homma (1990), a = 7, b = 0.1: closed forms of all indices."""
    x = saltelli(3, 4096)
    table = designed(x, ishigami(x)[None])
    found = sobol_of(table)
    assert isinstance(found, SobolIndices)
    assert found.samples == 4096
    a, b = 7.0, 0.1
    variance = a**2 / 8 + b * np.pi**4 / 5 + b**2 * np.pi**8 / 18 + 0.5
    v1, v2 = 0.5 * (1 + b * np.pi**4 / 5) ** 2, a**2 / 8
    v13 = b**2 * np.pi**8 * 8 / 225
    assert_allclose(found.first[:, 0], np.array([v1, v2, 0.0]) / variance, rtol=0, atol=0.02)
    assert_allclose(found.total[:, 0], np.array([v1 + v13, v2, v13]) / variance, rtol=0, atol=0.02)
    theirs = stats.sobol_indices(
        func={
            "f_A": table.values[:, :4096],
            "f_B": table.values[:, 4096:8192],
            "f_AB": table.values[:, 8192:].reshape(1, 3, 4096).transpose(1, 0, 2),
        },
        n=4096,
    )
    assert_allclose(found.first[:, 0], theirs.first_order, rtol=1e-12)
    wide = theirs.bootstrap(n_resamples=200, confidence_level=0.95)
    for ours, other in (
        (found.first_interval, wide.first_order), (found.total_interval, wide.total_order)
    ):  # fmt: skip
        low, high = other.confidence_interval
        assert_allclose(ours[1, :, 0] - ours[0, :, 0], high - low, rtol=0.3)
        assert (ours[0, :, 0] < ours[1, :, 0]).all()
    assert_allclose(found.total[:, 0], theirs.total_order, rtol=1e-12)
    again = sobol_of(table)
    assert isinstance(again, SobolIndices)
    assert_array_equal(again.first_interval, found.first_interval)


def test_only_the_first_sample_is_independent() -> None:
    x = saltelli(3, 64)
    table = designed(x, ishigami(x)[None])
    assert_array_equal(np.flatnonzero(independent_cases(table)), np.arange(64))
    assert rank_correlations(table).count.tolist() == [64]


@pytest.mark.parametrize("row", [0, 1, 3])
def test_an_input_that_came_out_constant_has_a_sample_too(row: int) -> None:
    """A distribution may be so narrow, or so coarse, that no draw changes its quantity."""
    x = saltelli(4, 256)
    x[row] = 2.5
    table = designed(x, (x[0] + 2.0 * x[1] + 3.0 * x[2] * x[3])[None])
    assert_array_equal(np.flatnonzero(independent_cases(table)), np.arange(256))
    found = sobol_of(table)
    assert isinstance(found, SobolIndices)
    assert found.inputs == tuple(f"x{i}" for i in range(4) if i != row)
    assert found.samples == 256
    samples = np.delete(x.reshape(4, 6, 256), row, axis=0)
    fewer = np.delete(samples, 2 + row, axis=1).reshape(3, -1)
    metric = np.delete(table.values.reshape(6, 256), 2 + row, axis=0).reshape(1, -1)
    without = sobol_of(designed(fewer, metric))
    assert isinstance(without, SobolIndices)
    assert_array_equal(found.first, without.first)
    assert_array_equal(found.total, without.total)


def test_a_constant_metric_has_no_sobol_indices() -> None:
    x = saltelli(2, 16)
    values = np.array([np.full(x.shape[1], 3.0), x[0]])
    found = sobol_of(designed(x, values))
    assert isinstance(found, SobolIndices)
    assert np.isnan(found.first[:, 0]).all()
    assert_allclose(found.total[1, 1], 0.0, rtol=0, atol=1e-12)


def test_why_there_are_no_sobol_indices() -> None:
    x = saltelli(3, 16)
    good = designed(x, x[:1])
    assert isinstance(sobol_of(good), SobolIndices)

    def refused(table: CaseTable) -> str:
        found = sobol_of(table)
        assert isinstance(found, str)
        return found

    assert "'random' does not allow" in refused(replace(good, design="random"))
    assert "need all 100 cases; 80 were computed" in refused(replace(good, planned=100))
    failed = np.zeros(80, dtype=bool)
    failed[[5, 9]] = True
    assert "2 of 80 did not come to their end, the first of them case 5" in refused(
        replace(good, failed=failed)
    )
    short = np.where(failed, "requirement", "completed")
    assert isinstance(sobol_of(replace(good, failed=failed, status=short)), SobolIndices)
    assert "finite" in refused(replace(good, values=np.full((1, 80), np.nan)))
    assert "more than one case" in refused(designed(x[:, ::16], x[:1, ::16]))
    mixed = x + 0.5 * np.roll(x, 1, axis=0)
    assert "does not change alone" in refused(replace(good, input_values=mixed))
