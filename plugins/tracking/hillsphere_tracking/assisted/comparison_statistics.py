"""Statistics of campaigns of assisted tracking, outage by outage."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from hillsphere.campaign.statistics import ended
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.products import CaseTable
from hillsphere_tracking.assisted.comparison_products import (
    FRAMES,
    LEVELS,
    AgeComparison,
    Consistency,
)
from hillsphere_tracking.assisted.measures import MEASURES, MetricName

__all__ = [
    "Outages",
    "age_comparison",
    "locked_share",
    "medians",
    "nees_consistency",
    "outages_of",
    "ratio_intervals",
]

_ROOM = 1 << 22
"""Numbers that a bootstrap draws at once."""


@dataclass(frozen=True)
class Outages:
    """Metrics of a campaign by measure, tracker and outage.

    Parameters
    ----------
    keys : tuple of (str, str)
        Pass and name of each of the L outages.
    trackers : tuple of str
        Names of the T trackers.
    values : mapping
        Measure → ndarray (T, L, N); NaN where a case did not come to its end or has no value.
    ended : ndarray of bool, shape (N,)
        Cases that came to their end, for at least one tracker.
    """

    keys: tuple[tuple[str, str], ...]
    trackers: tuple[str, ...]
    values: dict[str, Array]
    ended: NDArray[np.bool_]


def outages_of(table: CaseTable, name: str) -> Outages:
    """Sort the metrics of a campaign.

    Parameters
    ----------
    table : CaseTable
        The campaign.
    name : str
        Its name, for messages.

    Returns
    -------
    Outages
        In the order of the metrics.

    Raises
    ------
    InputError
        If it has no metric of assisted tracking, or no case that came to its end.
    """
    parsed = [MetricName.parse(metric) for metric in table.metrics]
    known = [(row, p) for row, p in enumerate(parsed) if p is not None and p.measure in MEASURES]
    # A case is lost as a whole if one tracker diverges; the others' values are as good as any.
    done = np.asarray(ended(table) | (table.status == "diverged"))
    if not np.any(done):
        raise InputError(
            f"campaign {name!r}: none of its {table.case.size} cases came to its end; see its "
            "failures"
        )
    if not known:
        raise InputError(
            f"campaign {name!r} repeated stage {table.stage!r}, none of whose metrics is one of "
            "assisted tracking (PASS.OUTAGE.TRACKER.MEASURE); let it repeat a stage of type "
            "assisted_tracking"
        )
    keys = tuple(dict.fromkeys((p.pass_, p.outage) for _, p in known))
    trackers = tuple(dict.fromkeys(p.tracker for _, p in known))
    values = {
        measure: np.full((len(trackers), len(keys), table.case.size), np.nan)
        for measure in MEASURES
        if any(p.measure == measure for _, p in known)
    }
    for row, p in known:
        place = trackers.index(p.tracker), keys.index((p.pass_, p.outage))
        values[p.measure][place] = np.where(done, table.values[row], np.nan)
    for made in values.values():
        made[~np.isfinite(made)] = np.nan
    return Outages(keys, trackers, values, done)


def medians(values: Array, levels: tuple[float, ...] = LEVELS) -> Array:
    """Return quantiles (l, ...) over the last axis, without what is NaN; NaN where all is."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice", RuntimeWarning)
        return np.asarray(np.nanquantile(values, levels, axis=-1))


def ratio_intervals(
    values: Array, baseline: int, resamples: int, level: float, rng: np.random.Generator
) -> Array:
    """Return intervals of ratios of means of medians, by bootstrap over the cases.

    Parameters
    ----------
    values : ndarray, shape (T, L, N)
        An error of T trackers in L outages and N cases; NaN where there is none.
    baseline : int
        Tracker that the others are divided by.
    resamples : int
        How often the cases are drawn anew, with the same cases for all trackers and outages.
    level : float
        Confidence level, reached approximately.
    rng : numpy.random.Generator
        Draws them.

    Returns
    -------
    ndarray, shape (2, T)
        Percentile intervals [1]_.

    References
    ----------
    .. [1] B. Efron, R. J. Tibshirani (1993), An Introduction to the Bootstrap, chapter 13.
    """
    trackers, _, cases = values.shape
    whole = bool(np.isfinite(values).all())
    ratios = np.empty((trackers, resamples))
    step = max(1, _ROOM // (values.shape[1] * cases))
    for begin in range(0, resamples, step):
        chosen = rng.integers(cases, size=(min(step, resamples - begin), cases))
        means = np.empty((trackers, chosen.shape[0]))
        for t in range(trackers):
            drawn = values[t][:, chosen]
            middle = np.median(drawn, axis=-1) if whole else medians(drawn, (0.5,))[0]
            means[t] = np.mean(middle, axis=0)
        ratios[:, begin : begin + chosen.shape[0]] = means / means[baseline]
    tail = 0.5 * (1.0 - level)
    return medians(ratios, (tail, 1.0 - tail))


def age_comparison(table: CaseTable, name: str, measure: str) -> AgeComparison:
    """Compare trackers at the points of a sweep.

    Parameters
    ----------
    table : CaseTable
        The sweep.
    name : str
        Its name, for messages.
    measure : str
        Error that is compared.

    Returns
    -------
    AgeComparison
        Over the first swept quantity that is a number with a unit, or else a number.

    Raises
    ------
    InputError
        If it is no sweep over a number, or no sweep of assisted tracking.
    """
    found = outages_of(table, name)
    numbers = [d for d, unit in enumerate(table.swept_units) if unit]
    if table.points is None or not numbers:
        raise InputError(
            f"campaign {name!r} is no sweep over a number; name one that is, or leave needs.ages "
            "out"
        )
    x = next((d for d in numbers if table.swept_units[d] != "-"), numbers[0])
    points = table.points.shape[1]
    values = _measured(found, measure, name)
    middle = np.full((len(found.trackers), len(found.keys), points), np.nan)
    count = np.zeros(points, dtype=np.int64)
    for p in range(points):
        here = table.point == p
        count[p] = np.count_nonzero(found.ended[here])
        middle[:, :, p] = medians(values[:, :, here], (0.5,))[0] if here.any() else np.nan
    return AgeComparison(
        stage=table.stage,
        name=table.swept[x].rpartition(".")[2],
        unit=table.swept_units[x],
        value=np.array(table.points[x]),
        group=_groups(table, x),
        trackers=found.trackers,
        count=count,
        mean_median_rad=np.mean(middle, axis=1),
        worst_median_rad=np.max(middle, axis=1),
    )


def _measured(found: Outages, measure: str, name: str) -> Array:
    if measure not in found.values:
        raise InputError(f"campaign {name!r} has no metric {measure!r}; it has {[*found.values]}")
    return found.values[measure]


def _groups(table: CaseTable, x: int) -> tuple[str, ...]:
    """Return what stands in each point's label beside the quantity x, without its path."""
    if len(table.swept) == 1:
        return ("",) * len(table.point_labels)
    parts = [label.split(", ") for label in table.point_labels]
    if any(len(p) != len(table.swept) for p in parts):
        return table.point_labels
    short = [[_without_path(one) for one in p[:x] + p[x + 1 :]] for p in parts]
    return tuple(", ".join(p) for p in short)


def _without_path(label: str) -> str:
    """Return ``"period = 3 s"`` of ``"stage.hover.period = 3 s"``."""
    name, equals, value = label.partition(" = ")
    return name.rpartition(".")[2].replace("_", " ") + equals + value


def nees_consistency(table: CaseTable, name: str, level: float) -> Consistency:
    """Judge whether trackers know how good they are.

    Parameters
    ----------
    table : CaseTable
        A campaign of assisted tracking.
    name : str
        Its name, for messages.
    level : float
        Confidence level of the band of the mean.

    Returns
    -------
    Consistency
        Mean NEES of each outage and tracker, with the band of χ².

    Raises
    ------
    InputError
        If it has no NEES.
    """
    found = outages_of(table, name)
    values = _measured(found, "nees", name)
    count = np.sum(np.isfinite(values), axis=-1)
    some = np.maximum(count, 1)
    mean = np.where(count > 0, np.nansum(values, axis=-1) / some, np.nan)
    tail = 0.5 * (1.0 - level)
    interval = np.array([chi2.ppf(q, 2 * some) / some for q in (tail, 1.0 - tail)])
    return Consistency(
        stage=table.stage,
        passes=tuple(key[0] for key in found.keys),
        outages=tuple(key[1] for key in found.keys),
        trackers=found.trackers,
        count=count,
        mean=mean,
        interval=interval,
    )


def locked_share(found: Outages, lock_angle_rad: float) -> Array:
    """Return the share (3, T, L) of cases within the lock angle, of those that have a value."""
    shape = (len(FRAMES), len(found.trackers), len(found.keys))
    share = np.full(shape, np.nan)
    for f, frame in enumerate(FRAMES):
        if frame in found.values:
            values = found.values[frame]
            count = np.sum(np.isfinite(values), axis=-1)
            within = np.sum(values <= lock_angle_rad, axis=-1)
            share[f] = np.where(count > 0, within / np.maximum(count, 1), np.nan)
    return share
