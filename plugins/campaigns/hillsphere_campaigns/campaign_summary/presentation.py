"""What a summary of campaigns shows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from hillsphere.base.matching import match_names
from hillsphere.base.problems import did_you_mean
from hillsphere.cases.case_classes import FailureRatio, failure_ratio
from hillsphere.errors import InputError
from hillsphere.presentation import Cell, Column, Metric, Presentation, Printed, Table
from hillsphere.show.reference import PAPER_SUFFIX, ReferenceTable, difference_notes, with_paper
from hillsphere.spec.units import UNITS, unit_text
from hillsphere_campaigns.campaign_summary.products import CampaignSummary
from hillsphere_campaigns.result_tables import number

if TYPE_CHECKING:
    from hillsphere_campaigns.campaign_summary.specs import CampaignSummarySpec

__all__ = ["check_columns", "present_summary"]

_COLUMNS = (
    Column("name", "", "campaign and metric"),
    Column("unit", "", "unit"),
    Column("cases", "-", "cases"),
    Column("mean", "-", "mean"),
    Column("mean_low", "-", "at least"),
    Column("mean_high", "-", "at most"),
    Column("deviation", "-", "standard deviation"),
    Column("deviation_low", "-", "at least"),
    Column("deviation_high", "-", "at most"),
)
_CLAIMS = (
    Column("claim", "", "statement"),
    Column("answer", "", "answer"),
    Column("difference", "-", "difference", 4),
    Column("low", "-", "at least", 4),
    Column("high", "-", "at most", 4),
    Column("unit", "", "unit"),
    Column("cases", "-", "pairs or cases"),
)


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
        Its verdict answers the claims.

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
    rows = _rows(product, names, _factors(product, spec.units))
    level = f"{100 * product.level:g} %"
    notes = [
        f"Means and deviations over cases that came to their end, with {level} intervals; failures "
        "in percent of the decided cases."
    ]
    if told := _undecided_notes(product):
        notes.append(told)
    columns: list[Column] = list(_COLUMNS)
    if spec.reference is not None:
        reference = ReferenceTable.read(spec.reference)
        rows = _beside(rows, reference, Path(spec.reference).name)
        columns = with_paper(_COLUMNS, rows)
        notes += difference_notes(rows, reference)
    tables = {"campaign_summary": Table("Campaigns side by side", columns, rows, notes)}
    if product.claims:
        tables["campaign_claims"] = Table(
            "Statements and answers", _CLAIMS, [
                {
                    "claim": one.text, "answer": one.answer, "difference": number(one.difference),
                    "low": number(float(one.interval[0])),
                    "high": number(float(one.interval[1])), "unit": one.unit, "cases": one.pairs,
                }
                for one in product.claims
            ],
            [
                f"Differences case by case, with {level} intervals; below zero they speak for the "
                "statement. Chosen cases are no sample: their ratios are compared as they are. "
                "The answers are about the campaigns as they were flown: designs that serve the "
                "same purpose as well may differ from these by as much."
            ],
        )  # fmt: skip
    return Presentation(
        metrics={
            "summary_campaigns": Metric(len(product.labels)),
            "summary_failures": Metric(int(product.failures.sum())),
        },
        tables=tables,
        figures={},
        verdict=[f"“{one.text}”: {one.answer}; {one.reason}." for one in product.claims],
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


def _rows(
    product: CampaignSummary, names: tuple[str, ...], factors: dict[str, tuple[str, float]]
) -> list[dict[str, Cell]]:
    rows: list[dict[str, Cell]] = []
    for c, label in enumerate(product.labels):
        for name in names:
            m = product.metrics.index(name)
            unit, factor = factors[name]
            low, high = factor * product.mean_interval[:, m, c]
            least, most = factor * product.deviation_interval[:, m, c]
            rows.append(
                {
                    "name": f"{label}, {name}",
                    "unit": unit,
                    "cases": int(product.count[m, c]),
                    "mean": number(factor * float(product.mean[m, c])),
                    "mean_low": number(float(low)),
                    "mean_high": number(float(high)),
                    "deviation": number(factor * float(product.deviation[m, c])),
                    "deviation_low": number(float(least)),
                    "deviation_high": number(float(most)),
                }
            )
        found = failure_ratio(
            product.failures[c], product.cases[c], product.undecided[c], product.level
        )
        low, high = 100.0 * found.interval
        rows.append(
            _ratio(f"{label}, failures", found) | {"mean_low": float(low), "mean_high": float(high)}
        )
        if product.worst_cases[c]:
            worst = failure_ratio(
                product.worst_failures[c], product.worst_cases[c], product.worst_undecided[c]
            )
            rows.append(_ratio(f"{label}, worst_failures", worst))
    return rows


def _ratio(name: str, found: FailureRatio) -> dict[str, Cell]:
    return {
        "name": name, "unit": "%", "cases": int(found.decided),
        "mean": number(100.0 * float(found.value)), "mean_low": None, "mean_high": None,
        "deviation": None, "deviation_low": None, "deviation_high": None,
    }  # fmt: skip


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


def _beside(
    rows: list[dict[str, Cell]], reference: ReferenceTable, file: str
) -> list[dict[str, Cell]]:
    known = {f"{row['campaign']}, {row['metric']}": row for row in reference.rows}
    made = []
    for row in rows:
        twin = known.get(str(row["name"]), {})
        wide: dict[str, Cell] = {}
        for key, cell in row.items():
            wide[key] = cell
            printed = twin.get(key) if key in ("mean", "deviation") else None
            if isinstance(printed, Printed):
                wide[key + PAPER_SUFFIX] = printed
        made.append(wide)
    if not any(key.endswith(PAPER_SUFFIX) for row in made for key in row):
        raise InputError(
            f"{file}: none of its rows is for a campaign and metric of this table; campaigns are "
            f"called {', '.join(sorted({str(r['name']).partition(',')[0] for r in rows}))}"
        )
    return made
