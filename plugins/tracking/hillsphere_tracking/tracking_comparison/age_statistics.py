"""Comparison of trackers at the points of a sweep, such as over the age of the elements."""

from __future__ import annotations

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Integers
from hillsphere.products import CaseTable
from hillsphere_tracking.tracking_comparison.products import AgeComparison
from hillsphere_tracking.tracking_comparison.statistics import (
    bootstrap_means,
    medians,
    outages_of,
    reacquisitions,
    values_of,
)

__all__ = ["age_comparison", "no_sweep"]

_IN_WORDS = {
    "believed_stations = False": "stations at their true places",
    "believed_stations = True": "stations where they are believed",
}


def no_sweep(campaign: str) -> str:
    """Return the message that a campaign is not a sweep over a number."""
    return (
        f"campaign {campaign!r} is not a sweep over a number; name such a sweep, or leave "
        "needs.ages out"
    )


def age_comparison(
    table: CaseTable,
    name: str,
    measure: str,
    baseline: str,
    resamples: int,
    level: float,
    rng: np.random.Generator,
) -> AgeComparison:
    """Compare trackers at the points of a sweep.

    Parameters
    ----------
    table : CaseTable
        The sweep.
    name : str
        Name of the campaign, used in messages.
    measure : str
        Name of the error that is compared.
    baseline : str
        Tracker to which the others are compared.
    resamples : int
        Number of bootstrap resamples for the intervals.
    level : float
        Confidence level of the intervals.
    rng : numpy.random.Generator
        Random generator that draws the resamples.

    Returns
    -------
    AgeComparison
        Comparison over the first swept number with a unit, or else over the first swept number.

    Raises
    ------
    InputError
        If the campaign is not a sweep over a number, is not of assisted tracking, or has no such
        baseline.
    """
    outages = outages_of(table, name)
    numbers = [d for d, unit in enumerate(table.swept_units) if unit]
    if table.points is None or not numbers:
        raise InputError(no_sweep(name))
    if baseline not in outages.trackers:
        raise InputError(
            f"campaign {name!r} has no tracker {baseline!r}, the baseline; give it the trackers "
            f"{', '.join(outages.trackers)} and {baseline}"
        )
    x = next((d for d in numbers if table.swept_units[d] != "-"), numbers[0])
    points = table.points.shape[1]
    values = values_of(outages, measure, name)
    first, trackers = outages.trackers.index(baseline), len(outages.trackers)
    middle = np.full((trackers, len(outages.keys), points), np.nan)
    interval = np.full((2, trackers, points), np.nan)
    shares = np.full((3, trackers, points), np.nan)
    times = np.full((2, trackers, points), np.nan)
    count = np.zeros(points, dtype=np.int64)
    tail = 0.5 * (1.0 - level)
    for p in range(points):
        here = (table.point == p) & outages.ended
        count[p] = np.count_nonzero(here)
        if not here.any():
            continue
        middle[:, :, p] = medians(values[:, :, here], (0.5,))[0]
        means = bootstrap_means(values[:, :, here], resamples, rng)
        interval[:, :, p] = medians(means, (tail, 1.0 - tail))
        shares[:, :, p], times[:, :, p] = reacquisitions(outages, here)
    ratio, where = _worst_ratios(middle, first)
    return AgeComparison(
        stage=table.stage,
        name=table.swept[x].rpartition(".")[2],
        unit=table.swept_units[x],
        value=np.array(table.points[x]),
        group=_groups(table, x),
        baseline=baseline,
        passes=tuple(key[0] for key in outages.keys),
        outages=tuple(key[1] for key in outages.keys),
        trackers=outages.trackers,
        count=count,
        mean_median_rad=np.mean(middle, axis=1),
        mean_interval_rad=interval,
        worst_median_rad=np.max(middle, axis=1),
        worst_ratio=ratio,
        worst_ratio_outage=where,
        reacquired=shares,
        reacquire_s=times,
    )


def _worst_ratios(middle: Array, first: int) -> tuple[Array, Integers]:
    """Return the largest ratio (T, P) of medians (T, L, P) to the baseline, and its outage."""
    ratio = middle / middle[first]
    where = np.argmax(np.where(np.isfinite(ratio), ratio, -np.inf), axis=1)
    return np.take_along_axis(ratio, where[:, None], axis=1)[:, 0], where


def _groups(table: CaseTable, x: int) -> tuple[str, ...]:
    """Return the swept quantities of each point other than number x, in words."""
    if len(table.swept) == 1:
        return ("",) * len(table.point_labels)
    parts = [label.split(", ") for label in table.point_labels]
    if any(len(p) != len(table.swept) for p in parts):
        return table.point_labels
    return tuple(", ".join(_in_words(one) for one in p[:x] + p[x + 1 :]) for p in parts)


def _in_words(label: str) -> str:
    """Shorten ``"stage.hover.period = 3 s"`` to ``"period = 3 s"``."""
    name, equals, value = label.partition(" = ")
    short = name.rpartition(".")[2] + equals + value
    return _IN_WORDS.get(short, short.replace("_", " "))
