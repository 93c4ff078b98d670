"""Campaigns side by side, as publications show them, and answers to what these claim."""

from __future__ import annotations

from collections import Counter
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
from hillsphere_campaigns.campaign_summary.products import CampaignSummary, Claim
from hillsphere_campaigns.campaign_summary.specs import (
    WITHOUT_WORST,
    CampaignSummarySpec,
    ClaimSpec,
)
from hillsphere_campaigns.pairing import PlannedDraws, pair_cases
from hillsphere_campaigns.statistics import mean_interval, metric_statistics

__all__ = ["CampaignSummaryStage", "answer_claim", "summary"]


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
        """Refuse claims about campaigns that are not there, or will not see the same draws."""
        labels = self.spec.labels or tuple(ref.name for ref in self.spec.needs.campaigns)
        planned = [planned_draws(campaign) for campaign in campaigns]
        if any(draws is None for draws in planned):
            return
        rows, names = _plan_by_point([draws for draws in planned if draws], labels)
        if worst and len(worst) != len(rows):
            raise InputError(_format_miscount(len(worst), len(rows)))
        for claim in self.spec.claims:
            if claim.of == "worst":
                for label in (claim.above_random, claim.less, claim.than):
                    if label:
                        _place(label, names)
                continue
            for one in _pairs(claim, names):
                i, j = _place(one.less, names), _place(one.than, names)
                try:
                    pair_cases(rows[i], rows[j], one.less, one.than)
                except InputError as error:
                    raise InputError(f"claims: {error}") from error

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
            If a claim names a campaign or metric that is not there, or compares campaigns that did
            not see the same draws.
        """
        spec = self.spec
        labels = spec.labels or tuple(ref.name for ref in spec.needs.campaigns)
        found = summary(campaigns, worst, labels, spec.claims, spec.confidence)
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
    claims: Sequence[ClaimSpec],
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
    claims : sequence of ClaimSpec
        What is to be answered.
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
        claims=tuple(answer_claim(claim, tables, worst, labels, level) for claim in claims),
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


def answer_claim(
    claim: ClaimSpec,
    tables: Sequence[CaseTable],
    worst: Sequence[CaseTable],
    labels: Sequence[str],
    level: float,
) -> Claim:
    """Answer a statement: by the interval of a difference, case by case where cases are random.

    Parameters
    ----------
    claim : ClaimSpec
        The statement.
    tables, worst, labels, level
        As for `summary`.

    Returns
    -------
    Claim
        Confirmed if the interval lies below zero, refuted if above, else undecided. Chosen cases
        are no sample: their ratios are compared as they are. Of several pairs of campaigns, which
        patterns name, all must have the answer; the interval holds those of all.

    Raises
    ------
    InputError
        See `CampaignSummaryStage.run`.
    """
    if claim.of == "worst":
        return _of_worst(claim, tables, worst, labels, level)
    pairs = _pairs(claim, labels)
    if len(pairs) != 1:
        return _of_all(claim, [_of_pair(one, tables, labels, level) for one in pairs])
    return _of_pair(pairs[0], tables, labels, level)


def _pairs(claim: ClaimSpec, labels: Sequence[str]) -> list[ClaimSpec]:
    """Return the claim for each pair of campaigns that it names, one or more."""
    pairs = [
        claim.model_copy(update={"less": less, "than": than})
        for less in _matching_labels(claim.less, labels)
        for than in _matching_labels(claim.than, labels)
        if less != than
    ]
    if not pairs:
        raise InputError(
            f"claims: {claim.less!r} and {claim.than!r} name the same campaign; name two"
        )
    return pairs


def _of_pair(
    claim: ClaimSpec, tables: Sequence[CaseTable], labels: Sequence[str], level: float
) -> Claim:
    """Answer a statement about two campaigns, case by case."""
    i, j = _place(claim.less, labels), _place(claim.than, labels)
    a, b = pair_cases(tables[i], tables[j], claim.less, claim.than)
    if claim.of == "failures":
        of = paired_failures(tables[j], b, tables[i], a, level)
        difference, interval = 100.0 * of.difference, 100.0 * of.interval
        reason = (
            f"{of.both + of.only_b} of {of.pairs} fail instead of {of.both + of.only_a}, "
            f"{difference:+.3g} percentage points ({interval[0]:+.3g} to {interval[1]:+.3g})"
        )
        if of.only_a == of.only_b == 0:
            reason += "; no case fails with only one of the two"
        if of.undecided:
            interval = 100.0 * of.sure
            reason += _format_left_out(of.undecided, interval, "percentage points")
        return _claim(claim, difference, interval, "%", of.pairs, reason)
    for table, label in ((tables[i], claim.less), (tables[j], claim.than)):
        if claim.of not in table.metrics:
            hint = did_you_mean(claim.of, [*table.metrics, "failures", "worst"], otherwise="it has")
            raise InputError(f"claims: campaign {label!r} has no metric {claim.of!r}{hint}")
    x = tables[i].values[tables[i].metrics.index(claim.of), a]
    y = tables[j].values[tables[j].metrics.index(claim.of), b]
    unit = tables[i].units[tables[i].metrics.index(claim.of)]
    kept = has_ended(tables[i])[a] & has_ended(tables[j])[b] & np.isfinite(x) & np.isfinite(y)
    d = x[kept] - y[kept]
    if d.size < 2:
        return _claim(
            claim, np.nan, np.full(2, np.nan), unit, d.size, "too few pairs came to their end"
        )
    interval, mean = mean_interval(d, level), float(d.mean())
    reason = (
        f"{claim.of} differs by {mean:+.4g} {unit} on average over {d.size} pairs "
        f"({interval[0]:+.4g} to {interval[1]:+.4g})"
    )
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
        reason += _format_left_out(undecided, interval, unit)
    return _claim(claim, mean, interval, unit, d.size, reason)


def _format_left_out(undecided: int, interval: Array, unit: str) -> str:
    """Say how many pairs were left out, and how far they could move the difference."""
    return (
        f"; {undecided} pair{'' if undecided == 1 else 's'} with an undecided case left out, which "
        f"could make it {interval[0]:+.4g} to {interval[1]:+.4g} {unit}"
    )


def _of_all(claim: ClaimSpec, found: Sequence[Claim]) -> Claim:
    """Answer a statement about all pairs of two groups of campaigns."""
    count = Counter(one.answer for one in found)
    said = ", ".join(f"{k} {answer}" for answer, k in count.most_common())
    differences = [one.difference for one in found]
    reason = (
        f"of {len(found)} pairs {said}; the differences are {min(differences):+.4g} to "
        f"{max(differences):+.4g} {found[0].unit}"
    )
    ends = np.array([one.interval for one in found])
    middle = float(np.median(differences))
    interval = np.array([ends[:, 0].min(), ends[:, 1].max()])
    return _claim(claim, middle, interval, found[0].unit, min(d.pairs for d in found), reason)


def _of_worst(
    claim: ClaimSpec,
    tables: Sequence[CaseTable],
    worst: Sequence[CaseTable],
    labels: Sequence[str],
    level: float,
) -> Claim:
    if not worst:
        raise InputError(WITHOUT_WORST)
    if claim.above_random:
        i = _place(claim.above_random, labels)
        random, chosen = ratio_of(tables[i], level), ratio_of(worst[i], level)
        if not chosen.decided:
            return _claim(
                claim, np.nan, np.full(2, np.nan), "%", 0, "none of the chosen cases is decided"
            )
        sure = 100.0 * random.sure
        low, high = 100.0 * chosen.range
        reason = (
            f"{int(chosen.failures)} of {int(chosen.decided)} chosen cases fail "
            f"({100.0 * float(chosen.value):.3g} %), {int(random.failures)} of "
            f"{int(random.decided)} random ones ({sure[0]:.3g} to {sure[1]:.3g} %)"
        )
        if chosen.undecided or random.undecided:
            reason += (
                f"; {int(chosen.undecided)} chosen and {int(random.undecided)} random cases are "
                "undecided, and the interval allows for them"
            )
        middle = 100.0 * float(random.value - chosen.value)
        interval = np.array([sure[0] - high, sure[1] - low])
        return _claim(claim, middle, interval, "%", int(chosen.decided), reason)
    i, j = _place(claim.less, labels), _place(claim.than, labels)
    a, b = ratio_of(worst[i], level), ratio_of(worst[j], level)
    if not (a.decided and b.decided):
        return _claim(
            claim, np.nan, np.full(2, np.nan), "%", 0, "none of the chosen cases is decided"
        )
    reason = (
        f"{100.0 * float(a.value):.3g} % of {int(a.decided)} chosen cases fail instead of "
        f"{100.0 * float(b.value):.3g} % of {int(b.decided)}"
    )
    if a.undecided or b.undecided:
        reason += (
            f"; {int(a.undecided)} and {int(b.undecided)} are undecided, and the interval allows "
            "for them"
        )
    interval = 100.0 * np.array([a.range[0] - b.range[1], a.range[1] - b.range[0]])
    return _claim(claim, 100.0 * float(a.value - b.value), interval, "%", int(a.decided), reason)


def _claim(
    claim: ClaimSpec, difference: float, interval: np.ndarray, unit: str, pairs: int, reason: str
) -> Claim:
    low, high = interval
    answer = "confirmed" if high < 0.0 else "refuted" if low > 0.0 else "undecided"
    return Claim(claim.text, answer, float(difference), interval, unit, int(pairs), reason)


def _matching_labels(pattern: str, labels: Sequence[str]) -> list[str]:
    """Return the labels that a pattern, or a label, names."""
    if "*" not in pattern:
        return [labels[_place(pattern, labels)]]
    return list(match_names((pattern,), labels, "claims", "campaign"))


def _place(label: str, labels: Sequence[str]) -> int:
    if label not in labels:
        hint = did_you_mean(label, labels, otherwise="there are")
        raise InputError(f"claims: no campaign is called {label!r}{hint}")
    return list(labels).index(label)
