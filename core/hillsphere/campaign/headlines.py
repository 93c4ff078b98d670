"""The sentences at the head of a campaign's report."""

from __future__ import annotations

import numpy as np

from hillsphere.campaign.sensitivity import RankCorrelations
from hillsphere.campaign.statistics import classes, ratio_interval
from hillsphere.products import CaseTable

__all__ = ["NOT_COMPUTED", "clearest", "outcome", "worst_points"]

_WORTH_SAYING = 0.1
"""A smaller rank correlation is no headline, however many cases make it sure."""

NOT_COMPUTED = ("error", "memory", "not_finite", "killed", "time_limit")
"""Statuses of cases that could not be computed, see `BlockOutcome`."""


def _percent(value: float) -> str:
    return f"{100.0 * value:.3g} %"


def outcome(table: CaseTable, level: float, drawn: bool) -> list[str]:
    """Say how many cases failed and how; `drawn` says whether they are independent."""
    total, failures = table.case.size, int(np.count_nonzero(table.failed))
    if total == 0:
        return [f"No case of stage {table.stage!r} was computed."]
    count = table.points.shape[1] if table.points is not None else 1
    cases = f"{total} case{'' if total == 1 else 's'} of stage {table.stage!r}"
    cases += f" at {count} points" if count > 1 else ""
    said = f"{cases} ({table.design.replace('_', ' ')}): {failures} failed, "
    said += _percent(failures / total)
    if drawn:
        low, high = ratio_interval(failures, total, level)
        said += f" ({100 * level:g} % interval {100 * low:.3g} to {_percent(high)})"
    sentences = [said + "."]
    bad = [one for one in classes(table, level=level) if one.failed]
    if bad:
        words = [
            f"{one.count} {one.status}{f' ({one.cause})' if one.cause else ''}, first case "
            f"{one.first_case}"
            for one in bad[:4]
        ]
        more = sum(one.count for one in bad[4:])
        words += [f"{more} in {len(bad) - 4} further classes"] if more else []
        sentences.append(f"How they failed: {'; '.join(words)}.")
    lost = sum(one.count for one in bad if one.status in NOT_COMPUTED)
    if lost:
        sentences.append(
            f"{lost} of them could not be computed, which says nothing of the flight itself: see "
            "the messages in table campaign_failed."
        )
    if table.stopped:
        sentences.append(f"It ended after {total} of {table.planned} cases: {table.stopped}.")
    elif total < table.planned:
        sentences.append(f"{table.planned - total} of {table.planned} planned cases are missing.")
    return sentences


def worst_points(table: CaseTable, level: float) -> list[str]:
    """Name the points of a sweep with the most and the fewest failures."""
    assert table.points is not None
    count = table.points.shape[1]
    cases = np.bincount(table.point, minlength=count)
    failures = np.bincount(table.point, weights=table.failed, minlength=count)
    if not failures.any():
        return []
    ratio = failures / np.maximum(cases, 1)
    # A point that was never reached is neither the best nor the worst.
    ends = (
        int(np.argmax(np.where(cases > 0, ratio, -1.0))),
        int(np.argmin(np.where(cases > 0, ratio, 2.0))),
    )
    words = []
    for word, p in zip(("most", "fewest"), ends, strict=True):
        low, high = ratio_interval(failures[p], cases[p], level)
        words.append(
            f"{word} at {table.point_labels[p]}: {_percent(ratio[p])} of {cases[p]} "
            f"({100 * low:.3g} to {_percent(high)})"
        )
    return [f"Failures are {'; '.join(words)}."]


def clearest(found: RankCorrelations, level: float) -> list[str]:
    """Name the input that goes most with failure and with each of the first metrics."""
    said: dict[int, str] = {}
    for i, j in found.strongest():
        sure = found.p_holm[i, j] < 1.0 - level
        if j not in said and sure and abs(found.rho[i, j]) >= _WORTH_SAYING:
            said[j] = f"{found.metrics[j]} with {found.inputs[i]} ({found.rho[i, j]:+.2f})"
    words = [said[j] for j in sorted(said)[:4]]
    return [f"Clearest rank correlations: {', '.join(words)}."] if words else []
