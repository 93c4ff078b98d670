"""What a summary of campaigns shows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.matching import match_names
from hillsphere.base.problems import did_you_mean
from hillsphere.cases.case_classes import failure_ratio
from hillsphere.errors import InputError
from hillsphere.presentation import Metric, Presentation, Table
from hillsphere.show.reference import ReferenceTable
from hillsphere.show.tables import FilledColumn, column, set_beside, tabulate, text_column
from hillsphere.spec.units import UNITS, unit_text
from hillsphere_campaigns.campaign_summary.products import CampaignSummary
from hillsphere_campaigns.result_tables import gather, gather_intervals, interval_columns

if TYPE_CHECKING:
    from hillsphere_campaigns.campaign_summary.specs import CampaignSummarySpec

__all__ = ["check_columns", "present_summary"]

_RANDOM = "its random cases"
"""What chosen cases stand against if no other campaign is named."""


def present_summary(product: CampaignSummary, spec: CampaignSummarySpec) -> Presentation:
    """Return the tables of a summary.

    Parameters
    ----------
    product : CampaignSummary
        The summary.
    spec : CampaignSummarySpec
        What is shown, in which units, beside what.

    Returns
    -------
    Presentation
        Tables ``campaign_summary`` and, if there are tests, ``campaign_tests``.

    Raises
    ------
    InputError
        If `show`, `units` or the reference name what is not there.
    """
    names = (
        match_names(spec.show, list(product.metrics), "show: what all campaigns have", "metric")
        if spec.show
        else product.metrics
    )
    columns = _columns(product, names, _factors(product, spec.units))
    level = f"{100 * product.level:g} %"
    notes = [
        f"Means and deviations over cases that came to their end, with {level} intervals; failures "
        "in percent of the decided cases."
    ]
    if told := _undecided_notes(product):
        notes.append(told)
    table = tabulate("Campaigns side by side", columns, notes)
    if spec.reference is not None:
        table = _beside(table, product, spec.reference)
    tables = {"campaign_summary": table}
    if product.tests:
        tables["campaign_tests"] = _test_table(product, level)
    return Presentation(
        metrics={
            "summary_campaigns": Metric(len(product.labels)),
            "summary_failures": Metric(int(product.failures.sum())),
        },
        tables=tables,
    )


def _factors(product: CampaignSummary, wanted: dict[str, str]) -> dict[str, tuple[str, float]]:
    """Return the unit and the factor from SI of each metric."""
    made = {}
    for name, unit in zip(product.metrics, product.units, strict=True):
        made[name] = (unit, 1.0)
    for name, suffix in wanted.items():
        if name not in made:
            hint = did_you_mean(name, product.metrics, otherwise="there are")
            raise InputError(f"units: no metric {name!r}{hint}")
        si = made[name][0]
        known = next(
            (of for of in UNITS.values() if suffix in of and _plain(next(iter(of))) == _plain(si)),
            None,
        )
        if known is None:
            raise InputError(f"units: {name} is in {si}, which {suffix!r} does not measure")
        made[name] = (unit_text(suffix), 1.0 / known[suffix])
    return made


def _plain(unit: str) -> str:
    return unit.replace("/", "_").replace("²", "2").replace("³", "3")


def _columns(
    product: CampaignSummary, names: tuple[str, ...], factors: dict[str, tuple[str, float]]
) -> list[FilledColumn]:
    """Return columns with rows for the metrics, failures and chosen cases of each campaign."""
    failures = failure_ratio(product.failures, product.cases, product.undecided, product.level)
    worst = failure_ratio(product.worst_failures, product.worst_cases, product.worst_undecided)
    titles = [*names, "failures", "worst_failures"]
    has_row = np.ones((len(product.labels), len(titles)), dtype=bool)
    has_row[:, -1] = product.worst_cases > 0
    campaign, title = np.nonzero(has_row)
    units, scales = zip(*(factors[name] for name in names), ("%", 100.0), ("%", 100.0), strict=True)
    scale = np.array(scales)[title]
    metrics = [product.metrics.index(name) for name in names]
    blank = np.full(len(product.labels), np.nan)

    def rows(
        of_metrics: NDArray[Any], of_failures: NDArray[Any] = blank, of_worst: NDArray[Any] = blank
    ) -> NDArray[Any]:
        stacked = np.concatenate([of_metrics[metrics], [of_failures], [of_worst]])
        return np.asarray(stacked[title, campaign])

    means = zip(product.mean_interval, failures.interval, strict=True)
    return [
        text_column(
            "name",
            [f"{product.labels[c]}, {titles[k]}" for c, k in zip(campaign, title, strict=True)],
            "campaign and metric",
        ),
        text_column("unit", [units[k] for k in title], "unit"),
        column("cases", rows(product.count, failures.decided, worst.decided), "cases"),
        *interval_columns(
            "mean", "mean", scale * rows(product.mean, failures.value, worst.value),
            [scale * rows(*ends) for ends in means], 8, "", product.level,
        ),
        *interval_columns(
            "deviation", "standard deviation", scale * rows(product.deviation),
            [scale * rows(ends) for ends in product.deviation_interval], 8, "", product.level,
        ),
    ]  # fmt: skip


def _test_table(product: CampaignSummary, level: str) -> Table:
    of, campaign, against, difference, unit, pairs = gather(
        product.tests, "of", "campaign", "against", "difference", "unit", "pairs"
    )
    columns = [
        text_column("of", of, "of"),
        text_column("campaign", campaign, "campaign"),
        text_column("against", [one or _RANDOM for one in against], "against"),
        *interval_columns(
            "difference", "difference", difference, gather_intervals(product.tests, "interval"),
            4, "", product.level,
        ),
        text_column("unit", unit, "unit"),
        column("pairs", pairs, "pairs or cases"),
    ]  # fmt: skip
    note = (
        f"Differences case by case, with {level} intervals. Chosen cases (worst) are no sample: "
        "their ratios are compared as they are. The differences are those of the campaigns as they "
        "were flown: designs that serve the same purpose as well may differ from these by as much."
    )
    return tabulate("Differences of campaigns", columns, [note])


def _undecided_notes(product: CampaignSummary) -> str:
    """Say where cases are undecided, and what they leave open; ``""`` if none is."""
    told = []
    for word, failures, cases, undecided in (
        ("", product.failures, product.cases, product.undecided),
        (" (chosen cases)", product.worst_failures, product.worst_cases, product.worst_undecided),
    ):
        for c in range(len(product.labels)):
            if undecided[c]:
                found = failure_ratio(failures[c], cases[c], undecided[c])
                low, high = 100.0 * found.range
                told.append(
                    f"{product.labels[c]}{word}: {undecided[c]}, with them {low:.3g} to "
                    f"{high:.3g} % of all"
                )
    return f"Undecided cases, which are not counted: {'; '.join(told)}." if told else ""


def check_columns(reference: ReferenceTable, file: str) -> None:
    """Raise `InputError` if a table of published values lacks a column."""
    missing = [key for key in ("campaign", "metric", "mean") if key not in reference.columns]
    if missing:
        raise InputError(
            f"{file}: no column {missing[0]!r}; it needs campaign, metric and mean, and may have "
            "deviation"
        )


def _beside(table: Table, product: CampaignSummary, path: str) -> Table:
    """Return the table with published means and deviations beside the computed ones."""
    reference = ReferenceTable.read(path)
    rows = tuple(
        {
            "name": f"{row['campaign']}, {row['metric']}",
            "mean": row["mean"],
            "deviation": row.get("deviation"),
        }
        for row in reference.rows
    )
    named = replace(reference, columns=("name", "mean", "deviation"), rows=rows)
    wide = set_beside(table, named, on="name")
    if len(wide.columns) == len(table.columns):
        raise InputError(
            f"{Path(path).name}: none of its rows is for a campaign and metric of this table; "
            f"campaigns are called {', '.join(map(repr, sorted(product.labels)))}"
        )
    return wide
