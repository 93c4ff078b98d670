"""Verdict of the comparison of trackers, in sentences that follow from its numbers."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hillsphere.show.reference import ReferenceTable
from hillsphere_tracking.tracking_comparison.products import (
    COVERED,
    FRAMES,
    AgeComparison,
    Consistency,
    TrackingComparison,
)

__all__ = [
    "age_verdict",
    "comparison_verdict",
    "cover_verdict",
    "inside_band",
    "knowing_verdict",
    "reacquisition_verdict",
]


def inside_band(consistency: Consistency) -> NDArray[np.bool_]:
    """Return whether each mean NEES lies in its band, (T, L)."""
    return np.asarray(
        (consistency.mean >= consistency.interval[0])
        & (consistency.mean <= consistency.interval[1])
    )


def comparison_verdict(
    product: TrackingComparison,
    reference: ReferenceTable | None,
    published: Mapping[tuple[str, str], float],
) -> list[str]:
    """Compare each tracker with the baseline, and with published values."""
    f = FRAMES.index(product.measure)
    mean = np.degrees(product.mean_median_rad[f])
    base = product.trackers.index(product.baseline)
    said = []
    if product.ended < product.cases:
        said.append(
            f"{product.cases - product.ended} of {product.cases} cases were not completed and are "
            "left out."
        )
    for t, tracker in enumerate(product.trackers):
        low, high = product.ratio_interval[:, t]
        if t == base or not np.isfinite(product.ratio[t]):
            continue
        interval = f"{low:.3g} to {high:.3g}, {100 * product.level:g} % interval"
        numbers = f"mean error {mean[t]:.3g}° against {mean[base]:.3g}°, ratio "
        numbers += f"{product.ratio[t]:.3g} ({interval})"
        if high < 1.0:
            said.append(f"{tracker} is better than {product.baseline}: {numbers}.")
        else:
            where = ", under the conditions of the published values" if published else ""
            word = "worse than" if low > 1.0 else "not distinguishable from"
            said.append(f"{tracker} is {word} the baseline {product.baseline}{where}: {numbers}.")
    if published and product.measure == "error_max":
        said.append(_reference_verdict(product, published))
        notes = sum(1 for row in (reference.rows if reference else ()) if row.get("note"))
        if notes:
            said.append(f"{notes} published rows have a note in the table.")
    return said


def _reference_verdict(
    product: TrackingComparison, published: Mapping[tuple[str, str], float]
) -> str:
    keys = list(zip(product.passes, product.outages, strict=True))
    places = [keys.index(key) for key in published]
    values = np.radians(np.array(list(published.values())))
    m = product.measures.index("error_max")
    low, middle, high = product.quantiles[:, m][:, :, places]
    inside = np.sum((low <= values) & (values <= high), axis=1)
    between = [""] * len(product.trackers)
    if len(places) == len(keys):
        # the interval belongs to the mean over all outages
        ends = np.degrees(product.mean_interval_rad[:, FRAMES.index("error_max")])
        between = [f"{low:.3f} to {high:.3f}, " for low, high in ends.T]
    parts = ", ".join(
        f"{name} {np.degrees(np.mean(middle[t])):.3f}° ({between[t]}{inside[t]} inside)"
        for t, name in enumerate(product.trackers)
    )
    interval = f" with their {100 * product.level:g} % intervals" if any(between) else ""
    return (
        f"Mean of the {values.size} published errors: {np.degrees(np.mean(values)):.3f}°. Means of "
        f"the medians{interval}, and numbers of published values within 5–95 %: {parts}."
    )


def age_verdict(ages: AgeComparison) -> list[str]:
    """Compare each tracker with the baseline over the sweep, and in single outages."""
    ratio = ages.mean_median_rad / ages.mean_median_rad[ages.trackers.index(ages.baseline)]
    said = []
    for t, tracker in enumerate(ages.trackers):
        known = np.flatnonzero(np.isfinite(ratio[t]))
        if tracker == ages.baseline or not known.size:
            continue
        best, worst = known[np.argmin(ratio[t, known])], known[np.argmax(ratio[t, known])]
        said.append(
            f"Sweep of {ages.name.replace('_', ' ')}, ratio of the mean error of {tracker} to "
            f"{ages.baseline}: {ratio[t, best]:.3g} at best ({_point(ages, int(best))}), "
            f"{ratio[t, worst]:.3g} at worst ({_point(ages, int(worst))}). Largest ratio in a "
            f"single outage: {_worst_outages(ages, t)}."
        )
    return said


def _worst_outages(ages: AgeComparison, t: int) -> str:
    """Return the largest ratio of a tracker at each point, with its outage."""
    parts = []
    for group in dict.fromkeys(ages.group):
        here = [p for p, one in enumerate(ages.group) if one == group]
        worst = ", ".join(
            f"{_value(ages, p)} {ages.worst_ratio[t, p]:.3g} ({ages.passes[k]} {ages.outages[k]})"
            for p in here
            for k in [int(ages.worst_ratio_outage[t, p])]
            if np.isfinite(ages.worst_ratio[t, p])
        )
        parts.append(f"{group}: {worst}" if group else worst)
    return "; ".join(parts)


def _value(ages: AgeComparison, p: int) -> str:
    return f"{ages.value[p]:g}" + ("" if ages.unit == "-" else f" {ages.unit}")


def _point(ages: AgeComparison, p: int) -> str:
    return _value(ages, p) + (f", {ages.group[p]}" if ages.group[p] else "")


def knowing_verdict(consistency: Consistency, level: float) -> list[str]:
    """State whether each tracker is consistent, and the change of error by wrong assumptions."""
    inside, percent = inside_band(consistency), f"{100 * level:g} %"
    said = []
    for t, tracker in enumerate(consistency.trackers):
        low, high = consistency.overall_interval[:, t]
        right = tracker in consistency.consistent
        expects = f"with {'the true' if right else 'other than the true'} error statistics"
        word = "is consistent" if low <= 2.0 <= high else (
            "is overconfident" if low > 2.0 else "is too cautious"
        )  # fmt: skip
        sentence = (
            f"{tracker}, {expects}, {word}: the mean NEES is {consistency.overall[t]:.3g} "
            f"({low:.3g} to {high:.3g}, {percent} interval; 2 expected), within the {percent} band "
            f"of χ² in {int(inside[t].sum())} of {len(consistency.outages)} outages."
        )
        if not right:
            sentence += _error_change(consistency, t)
        said.append(sentence)
    return said


def _error_change(consistency: Consistency, t: int) -> str:
    low, high = consistency.error_ratio_interval[:, t]
    if not np.isfinite(consistency.error_ratio[t]):
        return ""
    word = "larger" if low > 1.0 else "smaller" if high < 1.0 else "not changed"
    first = consistency.consistent[0]
    return (
        f" Its error is {word}: {consistency.error_ratio[t]:.3g} times the error of {first} "
        f"({low:.3g} to {high:.3g})."
    )


def cover_verdict(product: TrackingComparison) -> list[str]:
    """State which trackers' covariances do not cover their errors."""
    share = np.mean(product.uncovered, axis=-1)
    middle = product.quantiles[1, product.measures.index("nees")]
    outages = np.sum(middle > product.nees_limit, axis=-1)
    expected = 1.0 - COVERED
    # ten times the expected share is not chance in a campaign of some hundred cases
    parts = [
        f"{name} {100 * share[t]:.3g} % (median in {outages[t]}, NEES up to "
        f"{np.max(middle[t]):.3g})"
        for t, name in enumerate(product.trackers)
        if share[t] > 10.0 * expected
    ]
    if not parts:
        return []
    why = ""
    if product.station_error_m > 0.0:
        why = (
            " The trackers assume locations of the stations with errors of up to "
            f"{1e-3 * product.station_error_m:.3g} km, which their covariances do not contain."
        )
    return [
        "The covariances do not cover the errors. Share of cases whose NEES exceeds "
        f"{product.nees_limit:.3g}, the {100 * COVERED:g} % quantile, mean over "
        f"{len(product.outages)} outages: {', '.join(parts)}.{why} A search sized by such a "
        "covariance may be too small."
    ]


def reacquisition_verdict(product: TrackingComparison) -> list[str]:
    """State the share of cases that the search does not find."""
    lost = product.reacquired[2]
    known = np.flatnonzero(np.isfinite(lost))
    if not known.size:
        return []
    parts = ", ".join(f"{product.trackers[t]} {100 * lost[t]:.3g} %" for t in known)
    return [f"Share of cases that the search does not find before the set: {parts}."]
