"""Statistics of campaigns of assisted tracking, outage by outage."""

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
    "locked_share",
    "measured",
    "medians",
    "outages_of",
    "reacquisitions",
    "resampled_means",
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
    done = np.asarray(has_ended(table) | (table.status == "diverged"))
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


def resampled_means(
    values: Array,
    resamples: int,
    rng: np.random.Generator,
    statistic: Callable[..., Any] = np.nanmedian,
) -> Array:
    """Return means over the outages of a statistic over the cases, of cases drawn anew.

    Parameters
    ----------
    values : ndarray, shape (T, L, N)
        Of T trackers in L outages and N cases; NaN where there is none.
    resamples : int
        How often the cases are drawn anew, with the same cases for all trackers and outages.
    rng : numpy.random.Generator
        Draws them.
    statistic : callable
        Numpy's ``nanmedian`` or ``nanmean``.

    Returns
    -------
    ndarray, shape (T, R)
        Their quantiles, and those of ratios of two trackers, are percentile intervals [1]_.

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


def measured(found: Outages, measure: str, name: str) -> Array:
    """Return the values (T, L, N) of a measure; refuse a campaign that has none."""
    if measure not in found.values:
        raise InputError(f"campaign {name!r} has no metric {measure!r}; it has {[*found.values]}")
    return found.values[measure]


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


def reacquisitions(found: Outages, cases: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return what came of the searches of some cases, all outages together.

    Parameters
    ----------
    found : Outages
        The campaign.
    cases : ndarray of bool, shape (N,)
        Which cases.

    Returns
    -------
    shares : ndarray, shape (3, T)
        Shares that are found at once, found by a search, and not found before the set; NaN without
        a search.
    times_s : ndarray, shape (2, T)
        Median and 95 % of the time to reacquire of those that are found; NaN if none is.
    """
    shares = np.full((3, len(found.trackers)), np.nan)
    times = np.full((2, len(found.trackers)), np.nan)
    if "found" not in found.values:
        return shares, times
    for t in range(len(found.trackers)):
        again, at_once, time = (
            found.values[name][t][:, cases].ravel()
            for name in ("found", "found_at_once", "time_to_reacquire")
        )
        known = np.isfinite(again)
        if known.any():
            total, now = float(np.mean(again[known])), float(np.mean(at_once[known]))
            shares[:, t] = now, total - now, 1.0 - total
        if np.any(again == 1.0):
            times[:, t] = medians(time[again == 1.0], (0.5, 0.95))
    return shares, times


def beyond_covariance(found: Outages, probability: float) -> tuple[float, Array]:
    """Return how often errors are larger than a tracker's covariance lets expect.

    Parameters
    ----------
    found : Outages
        The campaign.
    probability : float
        Of normal errors with that covariance to lie within the ellipse.

    Returns
    -------
    limit : float
        NEES on that ellipse: quantile of χ² with two degrees of freedom.
    share : ndarray, shape (T, L)
        Share of the cases with a larger NEES; NaN without any.
    """
    limit = float(chi2.ppf(probability, 2))
    shape = (len(found.trackers), len(found.keys))
    if "nees" not in found.values:
        return limit, np.full(shape, np.nan)
    values = found.values["nees"]
    count = np.sum(np.isfinite(values), axis=-1)
    share = np.sum(values > limit, axis=-1) / np.maximum(count, 1)
    return limit, np.where(count > 0, share, np.nan)
