"""Verdict sentences of a campaign."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from hillsphere.cases.case_classes import ratio_at_points, ratio_of, undecided_sentence
from hillsphere.products import CaseTable
from hillsphere_campaigns.figures import format_name, input_words
from hillsphere_campaigns.sensitivity import RankCorrelations
from hillsphere_campaigns.statistics import classes

__all__ = ["failure_sentences", "strongest_correlations", "worst_points"]

_WORTH_SAYING = 0.1
"""Smallest absolute rank correlation that the verdict names. A smaller one explains less than 1 %
of the variance of the ranks, however many cases make it significant."""


def _percent(value: float) -> str:
    return f"{100.0 * value:.3g} %"


def failure_sentences(table: CaseTable, level: float, drawn: bool) -> list[str]:
    """Return sentences on the failures; with an interval if the cases are independent (`drawn`)."""
    total = table.case.size
    if total == 0:
        return [f"No case of stage {table.stage!r} was computed."]
    count = table.points.shape[1] if table.points is not None else 1
    cases = f"{total} case{'' if total == 1 else 's'} of stage {table.stage!r}"
    cases += f" at {count} points" if count > 1 else ""
    ratio = ratio_of(table, level)
    said = f"{cases} ({table.design.replace('_', ' ')}): "
    if not ratio.decided:
        said += "none is decided"
    else:
        failures, decided = int(ratio.failures), int(ratio.decided)
        said += f"{failures} failed, {_percent(failures / decided)}"
        said += " of the decided ones" if ratio.undecided else ""
        if drawn:
            low, high = ratio.interval
            said += f" ({100 * level:g} % interval {100 * low:.3g} to {_percent(high)})"
    sentences = [said + "."]
    if undecided := undecided_sentence(table):
        sentences.append(undecided)
    found = classes(table, level=level)
    for question, some in (
        ("Failures", [one for one in found if one.failed]),
        ("Undecided", [one for one in found if one.undecided]),
    ):
        if not some:
            continue
        words = [
            f"{one.count} {one.status}{f' ({one.cause})' if one.cause else ''}, first case "
            f"{one.first_case}"
            for one in some[:4]
        ]
        more = sum(one.count for one in some[4:])
        words += [f"{more} in {len(some) - 4} further classes"] if more else []
        sentences.append(f"{question}: {'; '.join(words)}.")
    if table.stopped:
        sentences.append(
            f"The campaign ended after {total} of {table.planned} cases: {table.stopped}."
        )
    elif total < table.planned:
        sentences.append(f"{table.planned - total} of {table.planned} planned cases are missing.")
    sentences += [f"Warning of the nominal flight: {warning}" for warning in table.warnings]
    return sentences


def worst_points(table: CaseTable, level: float) -> list[str]:
    """Name the points of a sweep with the most and the fewest failures."""
    assert table.points is not None
    count = table.points.shape[1]
    found = ratio_at_points(table, table.point, count, level)
    if not found.failures.any():
        return []
    ratio, there = found.value, found.decided > 0
    # A point of which no case is decided is neither the best nor the worst.
    ends = (
        int(np.argmax(np.where(there, ratio, -1.0))),
        int(np.argmin(np.where(there, ratio, 2.0))),
    )
    words = []
    for word, p in zip(("most", "fewest"), ends, strict=True):
        low, high = found.interval[:, p]
        left = f", {found.undecided[p]} undecided" if found.undecided[p] else ""
        words.append(
            f"{word} at {_point_in_words(table, p)}: {_percent(ratio[p])} of {found.decided[p]} "
            f"({100 * low:.3g} to {_percent(high)}{left})"
        )
    return [f"Failures are {'; '.join(words)}."]


def _point_in_words(table: CaseTable, p: int) -> str:
    """Return the name of a point with labels in place of the swept keys."""
    text = table.point_labels[p]
    for name, label in input_words(table).items():
        text = text.replace(f"{name} = ", f"{label} = ")
    return text


def strongest_correlations(
    found: RankCorrelations, level: float, labels: Mapping[str, str]
) -> list[str]:
    """Name the strongest rank correlations with failure and with the first metrics.

    `labels` are those of inputs by their names, see `input_words`.
    """
    said: dict[int, str] = {}
    for i, j in found.strongest():
        sure = found.p_holm[i, j] < 1.0 - level
        if j not in said and sure and abs(found.rho[i, j]) >= _WORTH_SAYING:
            metric, given = format_name(found.metrics[j]), labels[found.inputs[i]]
            said[j] = f"{metric} with {given} (ρ = {found.rho[i, j]:+.2f})"
    words = [said[j] for j in sorted(said)[:4]]
    return [f"Strongest rank correlations: {', '.join(words)}."] if words else []
