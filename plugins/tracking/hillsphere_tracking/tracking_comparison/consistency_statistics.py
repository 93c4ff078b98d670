"""Whether trackers know how good they are: normalised errors squared (NEES) of a campaign."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from hillsphere.base.problems import did_you_mean
from hillsphere.errors import InputError
from hillsphere.products import CaseTable
from hillsphere_tracking.tracking_comparison.products import Consistency
from hillsphere_tracking.tracking_comparison.statistics import (
    bootstrap_means,
    medians,
    outages_of,
    values_of,
)

__all__ = ["nees_consistency"]


def nees_consistency(
    table: CaseTable,
    name: str,
    consistent: tuple[str, ...],
    measure: str,
    resamples: int,
    level: float,
    rng: np.random.Generator,
) -> Consistency:
    """Judge whether trackers know how good they are.

    Parameters
    ----------
    table : CaseTable
        A campaign of assisted tracking.
    name : str
        Its name, for messages.
    consistent : tuple of str
        Trackers that expect errors as they truly are; ``()`` for all.
    measure : str
        Error that is compared.
    resamples : int
        How often the cases are drawn anew for the intervals.
    level : float
        Confidence level of all intervals.
    rng : numpy.random.Generator
        Draws the cases.

    Returns
    -------
    Consistency
        Mean NEES of each outage and tracker, with the band of χ².

    Raises
    ------
    InputError
        If it has no NEES, or no such tracker.
    """
    found = outages_of(table, name)
    for tracker in consistent:
        if tracker not in found.trackers:
            hint = did_you_mean(tracker, found.trackers, otherwise="there are")
            raise InputError(f"consistent: campaign {name!r} has no tracker {tracker!r}{hint}")
    values = values_of(found, "nees", name)
    errors = values_of(found, measure, name)[:, :, found.ended]
    count = np.sum(np.isfinite(values), axis=-1)
    some = np.maximum(count, 1)
    mean = np.where(count > 0, np.nansum(values, axis=-1) / some, np.nan)
    tail = 0.5 * (1.0 - level)
    interval = np.array([chi2.ppf(q, 2 * some) / some for q in (tail, 1.0 - tail)])
    # Outages of one case have errors in common: its mean over them is drawn anew, as a whole.
    cases = np.mean(values[:, :, found.ended], axis=1, keepdims=True)
    overall = bootstrap_means(cases, resamples, rng, np.nanmean)
    right = consistent or found.trackers
    first = found.trackers.index(right[0])
    middle = np.mean(medians(errors, (0.5,))[0], axis=-1)
    drawn = bootstrap_means(errors, resamples, rng)
    return Consistency(
        stage=table.stage,
        passes=tuple(key[0] for key in found.keys),
        outages=tuple(key[1] for key in found.keys),
        trackers=found.trackers,
        consistent=right,
        count=count,
        mean=mean,
        interval=interval,
        overall=np.mean(mean, axis=-1),
        overall_interval=medians(overall, (tail, 1.0 - tail)),
        mean_median_rad=middle,
        error_ratio=middle / middle[first],
        error_ratio_interval=medians(drawn / drawn[first], (tail, 1.0 - tail)),
    )
