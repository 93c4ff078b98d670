"""Table, figure and verdict of the stage ``initialisation``."""

from __future__ import annotations

import numpy as np
from scipy.stats import chi2, kstest

from hillsphere.presentation import Axis, Chart, Curve, Metric, Panel, Presentation
from hillsphere.show.tables import column, tabulate
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.initialisation.products import StartingBelief

__all__ = ["judge_consistency", "present_beginning"]

_DOUBTFUL = 0.01
"""Probability of the Kolmogorov-Smirnov test below which the NEES do not count as χ² distributed:
one consistent stage in a hundred falls below it."""


def present_beginning(product: StartingBelief) -> Presentation:
    """Show how well the states are known at first.

    Parameters
    ----------
    product : StartingBelief
        Beliefs and true states.

    Returns
    -------
    Presentation
        Errors of each spacecraft beside their standard deviations, and the distribution of the
        NEES.
    """
    n, cases = product.means.shape
    off = product.means - product.truths
    variances = np.diagonal(product.covariances, axis1=1, axis2=2).T
    places = [slice(first, first + 3) for first in range(0, n, 6)]
    speeds = [slice(first + 3, first + 6) for first in range(0, n, 6)]
    columns = [
        column("spacecraft", range(1, n // 6 + 1), "spacecraft"),
        column("position_rms_m", [_root(off[own] ** 2) for own in places], "position, rms", 4),
        column("position_sigma_m", [_root(variances[own]) for own in places], "σ", 4),
        column("velocity_rms_mm_s", [_root(off[own] ** 2) for own in speeds], "velocity, rms", 4),
        column("velocity_sigma_mm_s", [_root(variances[own]) for own in speeds], "σ", 4),
    ]
    nees = product.nees
    low, high = chi_square_band(n, cases)
    mean, fits = float(nees.mean()), float(kstest(nees, chi2(n).cdf).pvalue)
    answer = judge_consistency(mean, low, high, fits)
    inside = "lies" if low <= mean <= high else "does not lie"
    verdict = (
        f"From sensors alone, over {product.t_s / 3600:.3g} h: first beliefs are "
        f"{answer}. The mean NEES of {n} states, {mean:.4g}, {inside} in "
        f"the 99.9 % band {low:.4g} … {high:.4g}; probability of the distribution under χ²: "
        f"{fits:.2g} (Kolmogorov and Smirnov; below {_DOUBTFUL:g} it counts as inconsistent)."
    )
    missed = int((product.settled == 0).sum())
    lines = [verdict]
    if missed:
        lines.append(f"{missed} of {cases} fits did not converge; the statistics include them.")
    return Presentation(
        metrics={
            "initialisation_mean_nees": Metric(mean),
            "initialisation_chi_square_probability": Metric(fits),
            "initialisation_settled": Metric(float(product.settled.mean())),
        },
        tables={"initialisation": tabulate("First beliefs, from sensors alone", columns)},
        figures={"initialisation": _chart(product)},
        verdict=lines,
    )


def judge_consistency(mean: float, low: float, high: float, probability: float) -> str:
    """Return the verdict on beliefs by their mean NEES.

    Parameters
    ----------
    mean, low, high : float
        Mean NEES and its band.
    probability : float
        That of the distribution of the NEES, see `_DOUBTFUL`.
    """
    if low <= mean <= high:
        return "consistent" if probability >= _DOUBTFUL else "not consistent"
    return "cautious: errors are smaller than stated" if mean < low else "overconfident"


def _chart(product: StartingBelief) -> Chart:
    n, cases = product.means.shape
    share = (np.arange(cases) + 0.5) / cases
    marks = [
        Curve(np.sort(product.nees), share + 0.5 / cases, "cases", "blue", steps=True),
        Curve(chi2(n).ppf(share), share, f"χ², {n} states", "vermillion", "dashed"),
    ]
    return Chart(
        "Consistency of the first beliefs",
        [Panel(Axis("normalised error squared"), Axis("share of cases below"), marks)],
        "Normalised errors squared of all cases, sorted, beside the χ² distribution.",
        size_in=(6.5, 4.0),
    )


def _root(squares: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> float:
    return float(np.sqrt(np.mean(np.sum(squares, axis=0))))
