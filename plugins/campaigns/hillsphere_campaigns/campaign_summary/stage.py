"""Campaigns side by side, as publications show them, and tests of their differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.matching import match_names
from hillsphere.base.problems import did_you_mean
from hillsphere.cases.case_classes import (
    FailureRatio,
    failure_ratio,
    has_ended,
    is_undecided,
    ratio_of,
)
from hillsphere.errors import InputError
from hillsphere.interfaces.stages import Context
from hillsphere.presentation import Presentation
from hillsphere.products import CaseTable
from hillsphere.show.reference import ReferenceTable
from hillsphere_campaigns.campaign_comparison.stage import paired_failures, planned_draws
from hillsphere_campaigns.campaign_summary.presentation import check_columns, present_summary
from hillsphere_campaigns.campaign_summary.products import CampaignSummary, PairedTest
from hillsphere_campaigns.campaign_summary.specs import (
    WITHOUT_WORST,
    CampaignSummarySpec,
    PairedTestSpec,
)
from hillsphere_campaigns.pairing import PlannedDraws, pair_cases
from hillsphere_campaigns.statistics import mean_interval, metric_statistics

__all__ = ["CampaignSummaryStage", "paired_test", "summary"]


class CampaignSummaryStage:
    """Campaigns side by side.

    Parameters
    ----------
    spec : CampaignSummarySpec
        With its references bound.
    """

    def __init__(self, spec: CampaignSummarySpec) -> None:
        self.spec = spec
        if spec.reference is not None:
            check_columns(ReferenceTable.read(spec.reference), Path(spec.reference).name)

    def check_needs(self, campaigns: Sequence[object], worst: Sequence[object] = ()) -> None:
        """Refuse tests of campaigns that are not there, or will not see the same draws."""
        labels = self.spec.labels or tuple(ref.name for ref in self.spec.needs.campaigns)
        planned = [planned_draws(campaign) for campaign in campaigns]
        if any(draws is None for draws in planned):
            return
        rows, names = _plan_by_point([draws for draws in planned if draws], labels)
        if worst and len(worst) != len(rows):
            raise InputError(_format_miscount(len(worst), len(rows)))
        for test in self.spec.tests:
            if test.of == "worst":
                for label in filter(None, (test.campaign, test.against)):
                    _place(label, names)
                continue
            for one in _pairs(test, names):
                i, j = _place(one.campaign, names), _place(one.against, names)
                try:
                    pair_cases(rows[i], rows[j], one.campaign, one.against)
                except InputError as error:
                    raise InputError(f"tests: {error}") from error

    def run(
        self, ctx: Context, campaigns: tuple[CaseTable, ...], worst: tuple[CaseTable, ...] = ()
    ) -> CampaignSummary:
        """Sum them up.

        Parameters
        ----------
        ctx : Context
            Not used: it takes no time.
        campaigns : tuple of CaseTable
            With random cases.
        worst : tuple of CaseTable
            With chosen ones, as many or none.

        Returns
        -------
        CampaignSummary
            In their order.

        Raises
        ------
        InputError
            If a test names a campaign or metric that is not there, or compares campaigns that did
            not see the same draws.
        """
        spec = self.spec
        labels = spec.labels or tuple(ref.name for ref in spec.needs.campaigns)
        found = summary(campaigns, worst, labels, spec.tests, spec.confidence)
        present_summary(found, spec)
        return found

    def present(
        self,
        product: CampaignSummary,
        campaigns: tuple[CaseTable, ...] = (),
        worst: tuple[CaseTable, ...] = (),
    ) -> Presentation:
        """Show them."""
        return present_summary(product, self.spec)


def summary(
    tables: Sequence[CaseTable],
    worst: Sequence[CaseTable],
    labels: Sequence[str],
    tests: Sequence[PairedTestSpec],
    level: float,
) -> CampaignSummary:
    """Sum up campaigns.

    Parameters
    ----------
    tables : sequence of CaseTable
        With random cases.
    worst : sequence of CaseTable
        With chosen ones, as many or none.
    labels : sequence of str
        Their names.
    tests : sequence of PairedTestSpec
        Differences that are tested.
    level : float
        Confidence level.

    Returns
    -------
    CampaignSummary
        Of the metrics that all have.
    """
    tables, labels = _by_point(tables, labels)
    if worst and len(worst) != len(tables):
        raise InputError(_format_miscount(len(worst), len(tables)))
    names = [m for m in tables[0].metrics if all(m in table.metrics for table in tables)]
    units = tuple(tables[0].units[tables[0].metrics.index(m)] for m in names)
    found = [{one.name: one for one in metric_statistics(table, level=level)} for table in tables]
    by = [[one[name] for one in found] for name in names]
    shape = (len(names), len(tables))
    ratios = [ratio_of(table, level) for table in tables]
    of_worst = [ratio_of(table, level) for table in worst]
    of_worst = of_worst or [failure_ratio(0, 0, 0) for _ in tables]
    return CampaignSummary(
        labels=tuple(labels),
        level=level,
        metrics=tuple(names),
        units=units,
        count=np.array([[s.count for s in row] for row in by], dtype=np.int64).reshape(shape),
        mean=np.array([[s.mean for s in row] for row in by]).reshape(shape),
        deviation=np.array([[s.deviation for s in row] for row in by]).reshape(shape),
        mean_interval=np.array(
            [[[s.mean_interval[k] for s in row] for row in by] for k in (0, 1)]
        ).reshape(2, *shape),
        deviation_interval=np.array(
            [[[s.deviation_interval[k] for s in row] for row in by] for k in (0, 1)]
        ).reshape(2, *shape),
        cases=_number(ratios, "decided"),
        failures=_number(ratios, "failures"),
        undecided=_number(ratios, "undecided"),
        worst_cases=_number(of_worst, "decided"),
        worst_failures=_number(of_worst, "failures"),
        worst_undecided=_number(of_worst, "undecided"),
        tests=tuple(paired_test(one, tables, worst, labels, level) for one in tests),
    )


def _number(ratios: Sequence[FailureRatio], which: str) -> Integers:
    return np.array([int(getattr(one, which)) for one in ratios], dtype=np.int64)


def _format_miscount(worst: int, rows: int) -> str:
    return (
        f"needs.worst: {worst} campaigns of chosen cases for {rows} rows; a sweep has one row per "
        "point"
    )


def _plan_by_point(
    planned: Sequence[PlannedDraws], labels: Sequence[str]
) -> tuple[list[PlannedDraws], list[str]]:
    """Return the same as `_by_point` before anything ran: all points see the same draws."""
    rows: list[PlannedDraws] = []
    names: list[str] = []
    for draws, label in zip(planned, labels, strict=True):
        points = [f"{label} {_values_of(point)}" for point in draws.point_labels]
        names += points if len(points) > 1 else [label]
        same = replace(draws, point_labels=()) if len(points) > 1 else draws
        rows += [same] * max(len(points), 1)
    return rows, names


def _values_of(point: str) -> str:
    """Return the values alone of a point that is called by names and values."""
    return ", ".join(part.rpartition(" = ")[2] for part in point.split(", "))


def _by_point(
    tables: Sequence[CaseTable], labels: Sequence[str]
) -> tuple[list[CaseTable], list[str]]:
    """Return every campaign, and every point of a sweep for itself, called by its values."""
    found: list[CaseTable] = []
    names: list[str] = []
    for table, label in zip(tables, labels, strict=True):
        if len(table.point_labels) < 2:
            found.append(table)
            names.append(label)
            continue
        for p, point in enumerate(table.point_labels):
            here = table.point == p
            columns = ("case", "draw", "status", "cause", "failed")
            found.append(
                replace(
                    table,
                    **{key: getattr(table, key)[here] for key in columns},
                    input_values=table.input_values[:, here],
                    values=table.values[:, here],
                    point=np.zeros(np.count_nonzero(here), dtype=np.int64),
                    point_labels=(),
                    step_error=None if table.step_error is None else table.step_error[here],
                )
            )
            names.append(f"{label} {_values_of(point)}")
    return found, names


def paired_test(
    spec: PairedTestSpec,
    tables: Sequence[CaseTable],
    worst: Sequence[CaseTable],
    labels: Sequence[str],
    level: float,
) -> PairedTest:
    """Return the difference of two campaigns, case by case where cases are random.

    Parameters
    ----------
    spec : PairedTestSpec
        What is tested.
    tables, worst, labels, level
        As for `summary`.

    Returns
    -------
    PairedTest
        Chosen cases are no sample: their ratios are compared as they are. Of several pairs of
        campaigns, which patterns name, the interval holds those of all.

    Raises
    ------
    InputError
        See `CampaignSummaryStage.run`.
    """
    if spec.of == "worst":
        return _test_worst(spec, tables, worst, labels, level)
    found = [_test_pair(one, tables, labels, level) for one in _pairs(spec, labels)]
    ends = np.array([one.interval for one in found])
    return _paired_test(
        spec,
        float(np.median([one.difference for one in found])),
        np.array([ends[:, 0].min(), ends[:, 1].max()]),
        found[0].unit,
        min(one.pairs for one in found),
    )


def _pairs(spec: PairedTestSpec, labels: Sequence[str]) -> list[PairedTestSpec]:
    """Return the test of each pair of campaigns that a test names, one or more."""
    pairs = [
        spec.model_copy(update={"campaign": campaign, "against": against})
        for campaign in _matching_labels(spec.campaign, labels)
        for against in _matching_labels(spec.against, labels)
        if campaign != against
    ]
    if not pairs:
        raise InputError(
            f"tests: {spec.campaign!r} and {spec.against!r} name the same campaign; name two"
        )
    return pairs


def _test_pair(
    spec: PairedTestSpec, tables: Sequence[CaseTable], labels: Sequence[str], level: float
) -> PairedTest:
    """Test two campaigns, case by case."""
    i, j = _place(spec.campaign, labels), _place(spec.against, labels)
    a, b = pair_cases(tables[i], tables[j], spec.campaign, spec.against)
    if spec.of == "failures":
        of = paired_failures(tables[j], b, tables[i], a, level)
        interval = of.sure if of.undecided else of.interval
        return _paired_test(spec, 100.0 * of.difference, 100.0 * interval, "%", of.pairs)
    for table, label in ((tables[i], spec.campaign), (tables[j], spec.against)):
        if spec.of not in table.metrics:
            hint = did_you_mean(spec.of, [*table.metrics, "failures", "worst"], otherwise="it has")
            raise InputError(f"tests: campaign {label!r} has no metric {spec.of!r}{hint}")
    x = tables[i].values[tables[i].metrics.index(spec.of), a]
    y = tables[j].values[tables[j].metrics.index(spec.of), b]
    unit = tables[i].units[tables[i].metrics.index(spec.of)]
    kept = has_ended(tables[i])[a] & has_ended(tables[j])[b] & np.isfinite(x) & np.isfinite(y)
    d = x[kept] - y[kept]
    if d.size < 2:  # one difference has no deviation, and thus no interval
        return _paired_test(spec, np.nan, np.full(2, np.nan), unit, d.size)
    interval = mean_interval(d, level)
    undecided = int((is_undecided(tables[i].status[a]) | is_undecided(tables[j].status[b])).sum())
    if undecided:
        # What the undecided pairs would add is not known; none is taken to lie farther out than
        # the farthest of the decided ones.
        interval = np.array(
            [
                mean_interval(np.append(d, np.full(undecided, d.min())), level)[0],
                mean_interval(np.append(d, np.full(undecided, d.max())), level)[1],
            ]
        )
    return _paired_test(spec, d.mean(), interval, unit, d.size)


def _test_worst(
    spec: PairedTestSpec,
    tables: Sequence[CaseTable],
    worst: Sequence[CaseTable],
    labels: Sequence[str],
    level: float,
) -> PairedTest:
    """Compare chosen cases with those of another campaign, or with the random ones of theirs."""
    if not worst:
        raise InputError(WITHOUT_WORST)
    i = _place(spec.campaign, labels)
    a = ratio_of(worst[i], level)
    if spec.against:
        b = ratio_of(worst[_place(spec.against, labels)], level)
        low, high = b.range
    else:
        b = ratio_of(tables[i], level)
        low, high = b.sure
    if not (a.decided and b.decided):
        return _paired_test(spec, np.nan, np.full(2, np.nan), "%", 0)
    interval = 100.0 * np.array([a.range[0] - high, a.range[1] - low])
    return _paired_test(spec, 100.0 * float(a.value - b.value), interval, "%", int(a.decided))


def _paired_test(
    spec: PairedTestSpec, difference: float, interval: Array, unit: str, pairs: int
) -> PairedTest:
    return PairedTest(
        spec.of, spec.campaign, spec.against, float(difference), interval, unit, int(pairs)
    )


def _matching_labels(pattern: str, labels: Sequence[str]) -> list[str]:
    """Return the labels that a pattern, or a label, names."""
    if "*" not in pattern:
        return [labels[_place(pattern, labels)]]
    return list(match_names((pattern,), labels, "tests", "campaign"))


def _place(label: str, labels: Sequence[str]) -> int:
    if label not in labels:
        hint = did_you_mean(label, labels, otherwise="there are")
        raise InputError(f"tests: no campaign is called {label!r}{hint}")
    return list(labels).index(label)
