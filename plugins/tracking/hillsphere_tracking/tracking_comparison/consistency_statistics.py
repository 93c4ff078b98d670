"""Consistency of trackers: normalised estimation errors squared (NEES) of a campaign."""

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
    """Test whether the covariances of trackers are consistent with their errors, by the NEES.

    For a consistent tracker the sum of N independent values of the NEES, with two degrees of
    freedom each, follows χ² with 2N degrees of freedom.

    Parameters
    ----------
    table : CaseTable
        A campaign of assisted tracking.
    name : str
        Name of the campaign, used in messages.
    consistent : tuple of str
        Trackers whose assumed errors equal the true ones; ``()`` for all.
    measure : str
        Name of the error that is compared.
    resamples : int
        Number of bootstrap resamples for the intervals.
    level : float
        Confidence level of all intervals.
    rng : numpy.random.Generator
        Random generator that draws the resamples.

    Returns
    -------
    Consistency
        Mean NEES of each outage and tracker, with the band from χ².

    Raises
    ------
    InputError
        If the campaign has no NEES, or no such tracker.
    """
    outages = outages_of(table, name)
    for tracker in consistent:
        if tracker not in outages.trackers:
            hint = did_you_mean(tracker, outages.trackers, otherwise="there are")
            raise InputError(f"consistent: campaign {name!r} has no tracker {tracker!r}{hint}")
    values = values_of(outages, "nees", name)
    errors = values_of(outages, measure, name)[:, :, outages.ended]
    count = np.sum(np.isfinite(values), axis=-1)
    some = np.maximum(count, 1)
    mean = np.where(count > 0, np.nansum(values, axis=-1) / some, np.nan)
    tail = 0.5 * (1.0 - level)
    interval = np.array([chi2.ppf(q, 2 * some) / some for q in (tail, 1.0 - tail)])
    # The outages of a case have common errors: the bootstrap draws whole cases.
    cases = np.mean(values[:, :, outages.ended], axis=1, keepdims=True)
    overall = bootstrap_means(cases, resamples, rng, np.nanmean)
    right = consistent or outages.trackers
    first = outages.trackers.index(right[0])
    middle = np.mean(medians(errors, (0.5,))[0], axis=-1)
    drawn = bootstrap_means(errors, resamples, rng)
    return Consistency(
        stage=table.stage,
        passes=tuple(key[0] for key in outages.keys),
        outages=tuple(key[1] for key in outages.keys),
        trackers=outages.trackers,
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
