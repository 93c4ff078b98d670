"""What campaigns show: of every kind of table, small, broken or large."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.cases.case_classes import ratio_interval
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.presentation import Presentation
from hillsphere.products import CaseTable
from hillsphere.products.products import Bands
from hillsphere.testing import check_presentation, check_product
from hillsphere_campaigns.presentation import present_campaign
from hillsphere_campaigns.sweep_figures import layout_points

METRICS = ("dv", "rms_error", "time")
UNITS = ("m/s", "m", "s")


def campaign(n: int = 600, seed: int = 1, inputs: int = 5) -> CaseTable:
    """Return n cases: Δv grows with the first input, failures come with the second."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(inputs, n))
    failed = x[1] + 0.3 * rng.normal(size=n) > 1.8
    status = np.where(failed, "impact", "completed").astype("<U10")
    cause = np.where(failed, "surface", "").astype("<U10")
    said = np.empty(0, dtype=np.int64)
    messages: tuple[str, ...] = ()
    if n > 20:
        failed[[7, 20]], status[[7, 20]], cause[[7, 20]] = True, "error", "ValueError"
        said, messages = np.array([7, 20]), ("ValueError: no root", "ValueError: no root")
    values = np.array(
        [np.exp(0.5 * x[0]) + 0.1 * rng.normal(size=n), 3.0 + x[0] * x[-1], np.full(n, 600.0)]
    )
    return CaseTable(
        stage="hover",
        design="random",
        planned=n,
        stopped="",
        case=np.arange(n),
        draw=np.arange(n),
        point=np.zeros(n, dtype=np.int64),
        inputs=tuple(f"plant.gravity.C{i},0" for i in range(inputs)),
        input_units=("-",) * inputs,
        input_values=x,
        metrics=METRICS,
        units=UNITS,
        values=np.where(failed, np.nan, values),
        status=status,
        cause=cause,
        failed=failed,
        message_case=said,
        messages=messages,
    )


def sweep(axes: dict[str, Array], repetitions: int, design: str = "grid") -> CaseTable:
    """Return a sweep over a grid of these values; the first makes cases fail."""
    points = np.array([a.ravel() for a in np.meshgrid(*axes.values(), indexing="ij")])
    count = points.shape[1]
    base = campaign(repetitions, inputs=2)
    point = np.repeat(np.arange(count), repetitions)
    draw = np.tile(np.arange(repetitions), count)
    level = points[0] / points[0].max()
    x = base.input_values[:, draw]
    failed = x[1] + 2.0 * level[point] > 2.5
    values = np.array([1.0 + level[point] + 0.2 * x[0], 5.0 + x[0] * points[-1, point]])
    n = point.size
    return replace(
        base,
        design=design,
        planned=n,
        case=np.arange(n),
        draw=draw,
        point=point,
        input_values=x,
        metrics=METRICS[:2],
        units=UNITS[:2],
        values=np.where(failed, np.nan, values),
        status=np.where(failed, "impact", "completed"),
        cause=np.where(failed, "surface", ""),
        failed=failed,
        message_case=np.empty(0, dtype=np.int64),
        messages=(),
        swept=tuple(axes),
        swept_units=("s", "-", "m")[: len(axes)],
        points=points,
        point_labels=tuple(
            ", ".join(f"{k} = {v:g}" for k, v in zip(axes, p, strict=True)) for p in points.T
        ),
    )


PERIOD = "stage.hover.period_s"
SIGMA = "dispersions.field.scale"


def shown(table: CaseTable) -> Presentation:
    check_product(table)
    found = present_campaign(table)
    check_presentation(found)
    assert len(found.figures) <= 10
    return found


def test_random_cases() -> None:
    table = campaign()
    found = shown(table)
    # Two cases could not be computed: the ratio is over the 598 others.
    failures = int(table.failed.sum()) - 2
    low, high = 100.0 * ratio_interval(failures, 598)
    assert found.verdict[0] == (
        f"600 cases of stage 'hover' (random): {failures} failed, {100 * failures / 598:.3g} % of "
        f"the decided ones (95 % interval {low:.3g} to {high:.3g} %)."
    )
    assert found.verdict[1] == (
        "2 of 600 cases are undecided (2 by computation), neither success nor failure: over all "
        f"cases the failure ratio is {failures / 6:.3g} % if none of them had failed, "
        f"{(failures + 2) / 6:.3g} % if all had."
    )
    assert "impact (surface)" in found.verdict[2]
    assert found.metrics["campaign_undecided"].value == 2
    assert "Δv with gravity C0,0" in found.verdict[-1]
    assert "failed with gravity C1,0" in found.verdict[-1]
    assert found.metrics["campaign_failures"].value == failures
    assert found.metrics["campaign_not_computed"].value == 2
    kept = table.values[0][~table.failed]
    assert_allclose(float(found.metrics["campaign_dv_mean"].value), kept.mean(), rtol=1e-14)
    p95 = float(found.metrics["campaign_dv_p95"].value)
    assert_allclose(p95, np.quantile(kept, 0.95), rtol=1e-14)
    assert set(found.tables) == {
        "campaign_classes", "campaign_failed", "campaign_undecided", "campaign_statistics",
        "campaign_extremes", "campaign_correlations",
    }  # fmt: skip
    assert set(found.figures) == {
        "campaign_histograms", "campaign_distributions", "campaign_convergence",
        "campaign_correlations", "campaign_scatter",
    }  # fmt: skip
    errors = found.tables["campaign_classes"].rows[2]
    assert errors["first_case"] == 7
    assert errors["message"] == "ValueError: no root"
    row = found.tables["campaign_statistics"].rows[0]
    assert (row["metric"], row["unit"], row["cases"]) == ("dv", "m/s", 598 - failures)
    assert row["p95_low"] < row["p95"] < row["p95_high"]  # type: ignore[operator]
    extreme = next(r for r in found.tables["campaign_extremes"].rows if r["end"] == "largest")
    assert extreme["value"] == np.nanmax(table.values[0])
    assert extreme["case"] == np.nanargmax(table.values[0])


def test_a_campaign_that_was_stopped() -> None:
    found = present_campaign(replace(campaign(64), planned=2000, stopped="failures above 0.2"))
    assert any("after 64 of 2000 cases: failures above 0.2" in s for s in found.verdict)
    found = present_campaign(replace(campaign(64), planned=2000))
    assert any("1936 of 2000" in s for s in found.verdict)


@pytest.mark.parametrize("n", [0, 1, 2, 5])
def test_few_cases(n: int) -> None:
    assert shown(campaign(n)).metrics["campaign_cases"].value == n


def test_no_case_could_be_computed() -> None:
    table = campaign(100)
    table = replace(
        table,
        failed=np.ones(100, dtype=bool),
        values=np.full((3, 100), np.nan),
        status=np.full(100, "error"),
    )
    found = shown(table)
    assert np.isnan(found.metrics["campaign_failure_ratio"].value)
    assert found.metrics["campaign_failures"].value == 0
    assert found.metrics["campaign_failure_ratio_least"].value == 0.0
    assert found.metrics["campaign_failure_ratio_most"].value == 1.0
    assert "none is decided" in found.verdict[0]
    assert found.tables["campaign_statistics"].rows[0]["note"] == "no case came to its end"
    unknown = replace(table, metrics=(), units=(), values=np.empty((0, 100)))
    assert shown(unknown).tables["campaign_statistics"].rows == []


def test_sweep_over_one_quantity() -> None:
    found = shown(sweep({PERIOD: np.array([30.0, 60.0, 120.0, 240.0])}, 150))
    rows = found.tables["sweep_failures"].rows
    assert [row[PERIOD] for row in rows] == [30.0, 60.0, 120.0, 240.0]
    assert rows[0]["ratio"] < rows[-1]["ratio"]  # type: ignore[operator]
    assert any("most at hover period = 240" in s for s in found.verdict)
    # The points share their draws: 600 cases are not 600 independent ones.
    assert "interval" not in found.verdict[0]
    assert "campaign_failure_ratio_low" not in found.metrics
    assert {"sweep_failures", "sweep_metrics"} <= set(found.figures)
    assert "campaign_statistics" not in found.tables
    assert [r["metric"] for r in found.tables["sweep_statistics"].rows[:2]] == ["dv", "rms_error"]


def test_sweep_over_more_points_than_the_table_lists() -> None:
    found = shown(sweep({PERIOD: np.linspace(30.0, 240.0, 600)}, 3))
    assert len(found.tables["sweep_failures"].rows) < 600 == found.tables["sweep_failures"].total
    assert {"sweep_failures", "sweep_metrics"} <= set(found.figures)


def test_sweep_over_two_quantities() -> None:
    axes = {PERIOD: np.array([30.0, 60.0, 120.0]), SIGMA: np.array([1.0, 2.0, 4.0, 8.0])}
    assert {"sweep_failures", "sweep_metrics"} <= set(shown(sweep(axes, 60)).figures)


def test_sweep_over_three_quantities() -> None:
    axes = {
        PERIOD: np.array([30.0, 60.0, 120.0]),
        SIGMA: np.array([1.0, 2.0, 3.0]),
        "stage.hover.height_m": np.arange(9.0),
    }
    table = sweep(axes, 20)
    assert table.points is not None
    assert table.points.shape[1] > 60
    assert "sweep_failures" in shown(table).figures


def test_sweep_with_one_case_at_each_point() -> None:
    axes = {PERIOD: np.geomspace(1.0, 500.0, 40)}
    found = shown(sweep(axes, 1))
    assert "sweep_metrics" in found.figures
    assert "campaign_statistics" in found.tables
    names = sweep({PERIOD: np.arange(3.0)}, 20)
    laws = replace(names, swept_units=("",), point_labels=("law = pid", "law = lqr", "none"))
    assert layout_points(laws).ticks == (("pid", "lqr", "none"),)
    assert "sweep_metrics" in shown(laws).figures


def test_map_over_what_is_no_number() -> None:
    table = sweep({PERIOD: np.array([30.0, 60.0]), "law": np.arange(3.0)}, 20)
    names = tuple(f"{PERIOD} = {p} s, law = {w}" for p in (30, 60) for w in ("pid", "lqr", "lti"))
    table = replace(table, swept_units=("s", ""), point_labels=names)
    points = layout_points(table)
    assert points.is_map
    assert points.ticks == (("30", "60"), ("pid", "lqr", "lti"))
    assert "sweep_failures" in shown(table).figures


def test_sweep_whose_last_points_were_not_reached() -> None:
    table = sweep({PERIOD: np.array([30.0, 60.0, 120.0])}, 50)
    some = np.arange(100)
    table = replace(
        table,
        **{
            k: getattr(table, k)[some]
            for k in ("case", "draw", "point", "status", "cause", "failed")
        },
        values=table.values[:, some],
        input_values=table.input_values[:, some],
        stopped="enough",
    )
    assert shown(table).tables["sweep_failures"].rows[2]["cases"] == 0


def test_sobol_design() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(2, 3, 128))
    parts = [a, b]
    for i in range(3):
        ab = a.copy()
        ab[i] = b[i]
        parts.append(ab)
    x = np.concatenate(parts, axis=1)
    table = replace(
        campaign(640, inputs=3), design="sobol_indices", input_values=x, draw=np.arange(640) % 128,
        values=np.array([x[0] + 0.2 * x[1], x[0] * x[2], x[1]]), failed=np.zeros(640, dtype=bool),
        status=np.full(640, "completed"),
    )  # fmt: skip
    found = shown(table)
    assert "campaign_sobol" in found.figures
    assert len(found.tables["campaign_sobol"].rows) == 9
    assert found.tables["campaign_statistics"].rows[0]["cases"] == 128
    failed = np.arange(640) == 3
    assert any(
        "1 of 640 did not come to their end" in s
        for s in present_campaign(replace(table, failed=failed)).verdict
    )


def seven_hundred(table: CaseTable) -> CaseTable:
    """Return a campaign with 700 metrics, of 100 passes."""
    names = tuple(f"{what}_{i:02d}" for i in range(100) for what in (*"abcdef", "error"))
    values = np.random.default_rng(8).normal(size=(700, table.case.size))
    return replace(table, metrics=names, units=("m",) * 700, values=values)


def metrics_in(found: Presentation, table: str) -> list[object]:
    return list(dict.fromkeys(row["metric"] for row in found.tables[table].rows))


def test_a_choice_of_many_metrics() -> None:
    table = seven_hundred(campaign(200))
    found = present_campaign(table, show=("error_07", "a_1*"))
    check_presentation(found)
    names = ["error_07", *(f"a_1{i}" for i in range(10))]
    assert metrics_in(found, "campaign_statistics") == names
    assert metrics_in(found, "campaign_extremes") == names
    assert set(metrics_in(found, "campaign_correlations")) == set(names)
    assert "campaign_error_07_mean" in found.metrics
    assert not any("b_" in name for name in found.metrics)
    row = found.tables["campaign_statistics"].rows[1]
    kept = table.values[table.metrics.index("a_10"), ~table.failed]
    assert row["mean"] == pytest.approx(kept.mean(), rel=1e-12)
    with pytest.raises(InputError, match="stage 'hover' has no metric 'erorr_07'; did you mean"):
        present_campaign(table, show=("erorr_07",))
    # Where every case raised there is nothing to choose from.
    unknown = replace(table, metrics=(), units=(), values=np.empty((0, 200)))
    assert present_campaign(unknown, show=("error_07",)).tables["campaign_statistics"].rows == []


def test_tables_of_very_many_metrics_end_somewhere() -> None:
    found = shown(seven_hundred(campaign(60)))
    assert len(found.tables["campaign_statistics"].rows) == 500
    assert "first 500 of 700 metrics" in found.tables["campaign_statistics"].notes[0]
    assert "first 500 of 4200 rows" in found.tables["campaign_extremes"].notes[0]
    assert len(found.figures) == 5
    table = seven_hundred(sweep({PERIOD: np.array([30.0, 60.0])}, 20))
    found = present_campaign(table)
    assert len(found.tables["sweep_statistics"].rows) == 500
    found = present_campaign(table, show=("error_9*",))
    rows = found.tables["sweep_statistics"].rows
    assert [row["metric"] for row in rows] == [f"error_9{i}" for i in range(10)] * 2


def test_bands_are_a_figure() -> None:
    values = np.zeros((3, 1, 4))
    bands = Bands(("x",), ("m",), (0.05, 0.5, 0.95), np.arange(4.0), values, np.full((1, 4), 9))
    assert "campaign_bands" not in present_campaign(campaign(60)).figures
    assert "campaign_bands" in shown(replace(campaign(60), bands=bands)).figures


def test_many_metrics_and_inputs_make_no_more_figures() -> None:
    rng = np.random.default_rng(6)
    table = campaign(300, inputs=60)
    values = rng.normal(size=(40, 300)) + table.input_values[:40]
    table = replace(
        table, metrics=tuple(f"Metric {i}!" for i in range(40)), units=("m",) * 40, values=values
    )
    found = shown(table)
    assert len(found.figures) == 5
    charts: Any = found.figures.values()
    assert all(chart.size[1] < 9.0 for chart in charts)
    assert len(found.tables["campaign_correlations"].rows) == 500
    assert len(found.metrics) < 50


def test_chosen_cases_have_no_correlations() -> None:
    """What grew together among cases that somebody chose was chosen."""
    random = present_campaign(campaign(64), level=0.95)
    listed = present_campaign(replace(campaign(64), design="list"), level=0.95)
    assert "campaign_correlations" in random.tables
    assert "campaign_correlations" not in {*listed.tables, *listed.figures}
    assert not any("correlation" in sentence for sentence in listed.verdict)
