"""Statistics of campaigns of assisted tracking, by outage and tracker."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from hillsphere.cases.case_classes import has_ended
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.products import CaseTable
from hillsphere_tracking.assisted_tracking.measures import MEASURES, MetricName
from hillsphere_tracking.tracking_comparison.products import FRAMES, LEVELS

__all__ = [
    "Outages",
    "beyond_covariance",
    "bootstrap_means",
    "lock_share",
    "medians",
    "outages_of",
    "reacquisitions",
    "values_of",
]

_ROOM = 1 << 22
"""Numbers that a bootstrap draws at once: 32 MB. Fewer cost time in the loop, more cost memory."""


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
        Arrays (T, L, N) by measure; NaN if a case was not completed or has no value.
    ended : ndarray of bool, shape (N,)
        Cases that were completed for at least one tracker.
    """

    keys: tuple[tuple[str, str], ...]
    trackers: tuple[str, ...]
    values: dict[str, Array]
    ended: NDArray[np.bool_]


def outages_of(table: CaseTable, name: str) -> Outages:
    """Sort the metrics of a campaign by measure, tracker and outage.

    Parameters
    ----------
    table : CaseTable
        The campaign.
    name : str
        Name of the campaign, used in messages.

    Returns
    -------
    Outages
        Values in the order of the metrics.

    Raises
    ------
    InputError
        If the campaign has no metric of assisted tracking, or no completed case.
    """
    parsed = [MetricName.parse(metric) for metric in table.metrics]
    known = [(row, p) for row, p in enumerate(parsed) if p is not None and p.measure in MEASURES]
    # A case counts as diverged if one tracker diverges; the values of the others remain valid.
    done = np.asarray(has_ended(table) | (table.status == "diverged"))
    if not np.any(done):
        raise InputError(
            f"campaign {name!r}: none of its {table.case.size} cases was completed; see its "
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
    for column in values.values():
        column[~np.isfinite(column)] = np.nan
    return Outages(keys, trackers, values, done)


def medians(values: Array, levels: tuple[float, ...] = LEVELS) -> Array:
    """Return quantiles (l, ...) over the last axis that ignore NaN; NaN if all values are NaN."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice", RuntimeWarning)
        return np.asarray(np.nanquantile(values, levels, axis=-1))


def bootstrap_means(
    values: Array,
    resamples: int,
    rng: np.random.Generator,
    statistic: Callable[..., Any] = np.nanmedian,
) -> Array:
    """Bootstrap the mean over the outages of a statistic over the cases [1]_.

    Parameters
    ----------
    values : ndarray, shape (T, L, N)
        Values of T trackers in L outages and N cases; NaN for missing values.
    resamples : int
        Number of bootstrap resamples; each uses the same cases for all trackers and outages.
    rng : numpy.random.Generator
        Random generator that draws the resamples.
    statistic : callable
        ``numpy.nanmedian`` or ``numpy.nanmean``.

    Returns
    -------
    ndarray, shape (T, R)
        Means of R resamples. Their quantiles are percentile intervals, also of ratios of two
        trackers, which use the same cases.

    References
    ----------
    .. [1] B. Efron, R. J. Tibshirani (1993), An Introduction to the Bootstrap, chapter 13.
    """
    trackers, outages, cases = values.shape
    if statistic is np.nanmedian and np.isfinite(values).all():
        statistic = np.median  # the same, and faster
    means = np.empty((trackers, resamples))
    step = max(1, _ROOM // (outages * cases))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "All-NaN slice|Mean of empty slice", RuntimeWarning)
        for begin in range(0, resamples, step):
            chosen = rng.integers(cases, size=(min(step, resamples - begin), cases))
            for t in range(trackers):
                drawn = statistic(values[t][:, chosen], axis=-1)
                means[t, begin : begin + chosen.shape[0]] = np.mean(drawn, axis=0)
    return means


def values_of(outages: Outages, measure: str, name: str) -> Array:
    """Return the values (T, L, N) of a measure; raise `InputError` if the campaign lacks it."""
    if measure not in outages.values:
        raise InputError(f"campaign {name!r} has no metric {measure!r}; it has {[*outages.values]}")
    return outages.values[measure]


def lock_share(outages: Outages, lock_angle_rad: float) -> Array:
    """Return the share (3, T, L) of the cases with a value whose error is within the lock angle."""
    shape = (len(FRAMES), len(outages.trackers), len(outages.keys))
    share = np.full(shape, np.nan)
    for f, frame in enumerate(FRAMES):
        if frame in outages.values:
            values = outages.values[frame]
            count = np.sum(np.isfinite(values), axis=-1)
            within = np.sum(values <= lock_angle_rad, axis=-1)
            share[f] = np.where(count > 0, within / np.maximum(count, 1), np.nan)
    return share


def reacquisitions(outages: Outages, cases: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the results of the searches in selected cases, over all outages together.

    Parameters
    ----------
    outages : Outages
        The campaign.
    cases : ndarray of bool, shape (N,)
        Selected cases.

    Returns
    -------
    shares : ndarray, shape (3, T)
        Shares found at once, found by a search, and not found before the set; NaN without a search.
    times_s : ndarray, shape (2, T)
        Median and 95 % quantile of the time to reacquire, of cases that are found; NaN if none is.
    """
    shares = np.full((3, len(outages.trackers)), np.nan)
    times = np.full((2, len(outages.trackers)), np.nan)
    if "found" not in outages.values:
        return shares, times
    for t in range(len(outages.trackers)):
        again, at_once, time = (
            outages.values[name][t][:, cases].ravel()
            for name in ("found", "found_at_once", "time_to_reacquire")
        )
        known = np.isfinite(again)
        if known.any():
            total, now = float(np.mean(again[known])), float(np.mean(at_once[known]))
            shares[:, t] = now, total - now, 1.0 - total
        if np.any(again == 1.0):
            times[:, t] = medians(time[again == 1.0], (0.5, 0.95))
    return shares, times


def beyond_covariance(outages: Outages, probability: float) -> tuple[float, Array]:
    """Return the share of errors beyond the covariance of a tracker.

    Parameters
    ----------
    outages : Outages
        The campaign.
    probability : float
        Probability of normal errors with this covariance to lie within the ellipse.

    Returns
    -------
    limit : float
        NEES on the ellipse: quantile of χ² with two degrees of freedom.
    share : ndarray, shape (T, L)
        Share of the cases with a larger NEES; NaN without cases.
    """
    limit = float(chi2.ppf(probability, 2))
    shape = (len(outages.trackers), len(outages.keys))
    if "nees" not in outages.values:
        return limit, np.full(shape, np.nan)
    values = outages.values["nees"]
    count = np.sum(np.isfinite(values), axis=-1)
    share = np.sum(values > limit, axis=-1) / np.maximum(count, 1)
    return limit, np.where(count > 0, share, np.nan)
