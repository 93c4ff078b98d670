"""Campaigns compared case by case, against SciPy, closed forms and coverage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats
from scipy.optimize import minimize_scalar

from hillsphere.errors import InputError
from hillsphere.products import CaseTable
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_campaigns.campaign_comparison.presentation import present_comparison
from hillsphere_campaigns.campaign_comparison.specs import CampaignComparisonSpec
from hillsphere_campaigns.campaign_comparison.stage import (
    CampaignComparisonStage,
    compare,
    mcnemar,
    paired_ratio_interval,
    signed_rank,
)
from hillsphere_campaigns.pairing import pair_cases
from hillsphere_campaigns.statistics import mean_interval


def campaign(shift: float, limit: float, n: int = 400, stage: str = "hover") -> CaseTable:
    """Return n cases of common draws; shift moves the metric, limit decides who fails."""
    rng = np.random.default_rng(1)
    x, e = rng.normal(size=(2, n))
    own = np.random.default_rng(abs(hash((shift, limit))) % 2**32).normal(size=n)
    failed = x > limit
    return CaseTable(
        stage=stage,
        design="random",
        planned=n,
        stopped="",
        case=np.arange(n),
        draw=np.arange(n),
        point=np.zeros(n, dtype=np.int64),
        inputs=("gain", "other"),
        input_units=("-", "m"),
        input_values=np.array([x, e]),
        metrics=("dv", "constant"),
        units=("m/s", "s"),
        values=np.where(failed, np.nan, [5.0 + x + shift + 0.1 * own, np.full(n, 2.0)]),
        status=np.where(failed, "impact", "completed"),
        cause=np.full(n, ""),
        failed=failed,
        message_case=np.empty(0, dtype=np.int64),
        messages=(),
    )


def some_of(table: CaseTable, rows: np.ndarray[tuple[int], np.dtype[np.int64]]) -> CaseTable:
    columns = ("case", "draw", "point", "status", "cause", "failed")
    return replace(
        table,
        **{name: getattr(table, name)[rows] for name in columns},
        input_values=table.input_values[:, rows],
        values=table.values[:, rows],
    )


def test_paired_differences() -> None:
    a, b = campaign(0.0, 1.6), campaign(-0.2, 1.9)
    product = compare((a, b), ("pid", "lqr"))
    check_product(product)
    check_presentation(present_comparison(product))
    (dv, constant) = product.metrics
    kept = ~a.failed & ~b.failed
    d = (b.values - a.values)[0, kept]
    assert dv.pairs == kept.sum()
    assert_allclose(dv.mean, d.mean(), rtol=1e-12)
    assert_allclose(dv.mean_interval, mean_interval(d), rtol=1e-12)
    assert -0.23 < dv.mean_interval[0] < dv.mean_interval[1] < -0.17
    assert (dv.less, dv.more) == ((d < 0).sum(), (d > 0).sum())
    assert dv.p < 1e-20
    # On common draws the interval is far narrower than that of two separate campaigns.
    apart = np.std(a.values[0, kept]) * np.sqrt(2.0 / d.size)
    assert dv.mean_interval[1] - dv.mean_interval[0] < 0.3 * 2.0 * apart
    assert (constant.mean, constant.less, constant.more, constant.p) == (0.0, 0, 0, 1.0)
    only_a = int((a.failed & ~b.failed).sum())
    assert product.only_baseline_failed.tolist() == [only_a]
    assert product.only_other_failed.tolist() == [0]
    assert_allclose(product.difference, [-only_a / 400], rtol=1e-12)
    assert product.difference_interval[1, 0] < 0.0
    said = present_comparison(product).verdict[0]
    assert f"{b.failed.sum()} failures instead of {a.failed.sum()} in 400 pairs" in said


def test_a_campaign_against_itself() -> None:
    table = campaign(0.0, 1.6)
    product = compare((table, table), ("a", "b"))
    assert product.metrics[0].mean == 0.0
    assert_array_equal(product.difference, [0.0])
    assert_array_equal(product.mcnemar_p, [1.0])
    low, high = product.difference_interval[:, 0]
    z2 = stats.norm.ppf(0.975) ** 2
    assert_allclose([low, high], [-z2 / (400 + z2), z2 / (400 + z2)], rtol=1e-9)  # Tango, b = c = 0


def test_only_cases_of_the_same_draw_are_compared() -> None:
    a, b = campaign(0.0, 1.6), campaign(-0.2, 1.9)
    part = some_of(b, np.arange(256))
    product = compare((a, part), ("all", "stopped"))
    assert product.pairs.tolist() == [256]
    assert product.unpaired.tolist() == [144]
    order = np.random.default_rng(3).permutation(400)
    shuffled = some_of(b, order)
    rows_a, rows_b = pair_cases(a, shuffled, "a", "b")
    assert_array_equal(a.draw[rows_a], shuffled.draw[rows_b])
    assert_allclose(compare((a, shuffled), ("a", "b")).metrics[0].mean,
                    compare((a, b), ("a", "b")).metrics[0].mean, rtol=1e-12)  # fmt: skip


def test_points_of_sweeps_are_compared_one_by_one() -> None:
    def swept(table: CaseTable) -> CaseTable:
        return replace(
            table, draw=np.tile(np.arange(200), 2), point=np.repeat([0, 1], 200),
            swept=("period",), swept_units=("s",), points=np.array([[1.0, 2.0]]),
            point_labels=("period = 1 s", "period = 2 s"),
        )  # fmt: skip

    a, b = swept(campaign(0.0, 1.6)), swept(campaign(-0.2, 1.9))
    product = compare((a, b, a), ("a", "b", "c"))
    assert product.campaign == ("b", "b", "c", "c")
    assert product.point[:2] == ("period = 1 s", "period = 2 s")
    check_presentation(present_comparison(product))
    one = compare((some_of(a, np.arange(200)), some_of(b, np.arange(200))), ("a", "b"))
    assert_allclose(product.metrics[0].mean, one.metrics[0].mean, rtol=1e-14)
    with pytest.raises(InputError, match="different points"):
        compare((a, replace(b, point_labels=("x", "y"))), ("a", "b"))


def test_campaigns_that_cannot_be_compared() -> None:
    a, b = campaign(0.0, 1.6), campaign(-0.2, 1.9)
    other = b.input_values.copy()
    other[1, 17] += 1e-12
    with pytest.raises(InputError, match=r"did not see the same draws: other is .* in case 17"):
        compare((a, replace(b, input_values=other)), ("a", "b"))
    compare((a, replace(b, input_values=other, inputs=("gain", "third"))), ("a", "b"))
    with pytest.raises(InputError, match="no case in common"):
        compare((a, replace(b, draw=b.draw + 400)), ("a", "b"))
    with pytest.raises(InputError, match="different designs"):
        compare((a, replace(b, design="sobol")), ("a", "b"))
    with pytest.raises(InputError, match="metric 'dv' is in 'm/s'"):
        compare((a, replace(b, units=("km/s", "s"))), ("a", "b"))


def test_all_cases_failed() -> None:
    a = campaign(0.0, 1.6)
    b = replace(a, failed=np.ones(400, dtype=bool), values=np.full((2, 400), np.nan))
    product = compare((a, b), ("a", "b"))
    assert product.metrics[0].pairs == 0
    assert np.isnan(product.metrics[0].p)
    check_presentation(present_comparison(product))


@pytest.mark.parametrize("n", [1, 6, 49, 300])
def test_signed_rank_is_scipys(n: int) -> None:
    d = np.random.default_rng(n).normal(0.1, 1.0, size=n)
    method = "exact" if n <= 50 else "asymptotic"
    theirs = stats.wilcoxon(d, method=method, correction=n > 50).pvalue
    assert_allclose(signed_rank(d), theirs, rtol=1e-12)
    assert_allclose(signed_rank(np.append(d, 0.0)), theirs, rtol=1e-12)
    assert 0.0 <= signed_rank(np.round(d)) <= 1.0


def test_signed_rank_of_next_to_nothing() -> None:
    assert signed_rank(np.zeros(5)) == 1.0
    assert signed_rank(np.array([1.0, 1.0])) <= 1.0
    # All of 10 different differences positive: 2 / 2^10.
    assert_allclose(signed_rank(np.arange(1.0, 11.0)), 2.0**-9, rtol=1e-12)


def test_mcnemar() -> None:
    # 1 of 10 discordant pairs: 2 (1 + 10) / 2^10.
    assert_allclose(mcnemar(9, 1), 22.0 / 1024.0, rtol=1e-12)
    assert mcnemar(0, 0) == 1.0


@pytest.mark.parametrize(("b", "c", "n"), [(9, 2, 60), (0, 5, 40), (30, 30, 200), (3, 0, 2000)])
def test_interval_ends_where_the_score_test_does(b: int, c: int, n: int) -> None:
    """Tango (1998): restricted maximum likelihood found numerically instead of in closed form."""
    for end in paired_ratio_interval(b, c, n):

        def loss(q: float, delta: float = end) -> float:
            # q: only a fails, q + delta: only b fails.
            p = np.maximum(np.array([q + delta, q, 1.0 - 2.0 * q - delta]), 1e-300)
            return -float(np.dot([b, c, n - b - c], np.log(p)))

        room = (max(0.0, -end), 0.5 * (1.0 - end))
        q = minimize_scalar(loss, bounds=room, method="bounded", options={"xatol": 1e-12}).x
        score = (b - c - n * end) / np.sqrt(n * (2.0 * q + end * (1.0 - end)))
        assert_allclose(abs(score), stats.norm.ppf(0.975), rtol=1e-4)


def test_interval_at_the_borders() -> None:
    assert_array_equal(paired_ratio_interval(0, 0, 0), [-1.0, 1.0])
    low, high = paired_ratio_interval(20, 0, 20)
    assert 0.5 < low < 1.0
    assert high == 1.0
    assert_allclose(paired_ratio_interval(0, 20, 20), [-1.0, -low], rtol=1e-9)
    assert_allclose(paired_ratio_interval(3, 7, 90), -paired_ratio_interval(7, 3, 90)[::-1])


def test_interval_covers_the_difference() -> None:
    p_b, p_a, n, runs = 0.08, 0.03, 150, 1500
    counts = np.random.default_rng(4).multinomial(n, [p_b, p_a, 1.0 - p_b - p_a], size=runs)
    inside = 0
    for b, c, _ in counts.tolist():
        low, high = paired_ratio_interval(b, c, n)
        inside += low <= p_b - p_a <= high
    assert_allclose(inside / runs, 0.95, rtol=0, atol=0.02)


def test_the_stage_names_its_campaigns() -> None:
    spec = CampaignComparisonSpec.model_validate(
        {"needs": {"campaigns": ["pid", "lqr"]}, "confidence": 0.9}
    )
    stage = CampaignComparisonStage(spec)
    product = stage.run(RecordingContext(), (campaign(0.0, 1.6), campaign(-0.2, 1.9)))
    assert (product.baseline, product.campaign, product.level) == ("pid", ("lqr",), 0.9)
    assert stage.present(product).tables["comparison_metrics"].rows[0]["campaign"] == "lqr"


def test_a_choice_of_metrics() -> None:
    tables = campaign(0.0, 1.6), campaign(-0.2, 1.9)
    product = compare(tables, ("pid", "lqr"))
    found = present_comparison(product, show=("d*",))
    check_presentation(found)
    assert [row["metric"] for row in found.tables["comparison_metrics"].rows] == ["dv"]
    assert len(found.verdict) == 2
    needs = {"campaigns": ["pid", "lqr"]}
    spec = CampaignComparisonSpec.model_validate({"needs": needs, "show": ["vd"]})
    stage = CampaignComparisonStage(spec)
    with pytest.raises(
        InputError, match="show: what is compared has no metric 'vd'; there are: dv"
    ):
        stage.run(RecordingContext(), campaigns=tables)
    spec = CampaignComparisonSpec.model_validate({"needs": needs, "show": ["const*"]})
    stage = CampaignComparisonStage(spec)
    whole = stage.run(RecordingContext(), campaigns=tables)
    assert [one.metric for one in whole.metrics] == ["dv", "constant"]
    (row,) = stage.present(whole).tables["comparison_metrics"].rows
    assert row["metric"] == "constant"
