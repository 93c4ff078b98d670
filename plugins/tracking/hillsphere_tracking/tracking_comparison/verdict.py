"""What the comparison of trackers says in words; nothing is said that the numbers do not."""

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


def inside_band(found: Consistency) -> NDArray[np.bool_]:
    """Return whether each mean NEES lies in its band, (T, L)."""
    return np.asarray((found.mean >= found.interval[0]) & (found.mean <= found.interval[1]))


def comparison_verdict(
    product: TrackingComparison,
    reference: ReferenceTable | None,
    published: Mapping[tuple[str, str], float],
) -> list[str]:
    """Say which trackers are better than the baseline, and how published values compare."""
    f = FRAMES.index(product.measure)
    mean = np.degrees(product.mean_median_rad[f])
    base = product.trackers.index(product.baseline)
    said = []
    if product.ended < product.cases:
        said.append(
            f"{product.cases - product.ended} of {product.cases} cases did not come to their end "
            "and are left out."
        )
    for t, tracker in enumerate(product.trackers):
        low, high = product.ratio_interval[:, t]
        if t == base or not np.isfinite(product.ratio[t]):
            continue
        interval = f"{low:.3g} to {high:.3g}, {100 * product.level:g} % interval"
        numbers = f"{mean[t]:.3g}° against {mean[base]:.3g}°, {product.ratio[t]:.3g} times as "
        numbers += f"much ({interval})"
        if high < 1.0:
            said.append(f"{tracker} is better than {product.baseline}: {numbers}.")
        else:
            place = "In the conditions of the published values," if published else "Here"
            word = "better than" if low > 1.0 else "as good as"
            said.append(f"{place} the baseline {product.baseline} is {word} {tracker}: {numbers}.")
    if published and product.measure == "error_max":
        said.append(_reference_verdict(product, published))
        notes = sum(1 for row in (reference.rows if reference else ()) if row.get("note"))
        if notes:
            said.append(f"{notes} of the published rows come with a note: see the table.")
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
        # the interval is that of the mean over all outages
        ends = np.degrees(product.mean_interval_rad[:, FRAMES.index("error_max")])
        between = [f"{low:.3f} to {high:.3f}, " for low, high in ends.T]
    parts = ", ".join(
        f"{name} {np.degrees(np.mean(middle[t])):.3f}° ({between[t]}{inside[t]} inside)"
        for t, name in enumerate(product.trackers)
    )
    interval = f" with their {100 * product.level:g} % intervals" if any(between) else ""
    return (
        f"Mean of the {values.size} published errors {np.degrees(np.mean(values)):.3f}°; means of "
        f"the medians{interval}, and how many published values lie within 5–95 %: {parts}."
    )


def age_verdict(ages: AgeComparison) -> list[str]:
    """Say how each tracker compares with the baseline over the sweep, and in single outages."""
    ratio = ages.mean_median_rad / ages.mean_median_rad[ages.trackers.index(ages.baseline)]
    said = []
    for t, tracker in enumerate(ages.trackers):
        known = np.flatnonzero(np.isfinite(ratio[t]))
        if tracker == ages.baseline or not known.size:
            continue
        best, worst = known[np.argmin(ratio[t, known])], known[np.argmax(ratio[t, known])]
        said.append(
            f"Over {ages.name.replace('_', ' ')}, {tracker} errs {ratio[t, worst]:.3g} times as "
            f"much as {ages.baseline} at worst ({_point(ages, int(worst))}) and "
            f"{ratio[t, best]:.3g} times at best ({_point(ages, int(best))}), as a mean over the "
            f"outages. In the outage where it does worst: {_worst_outages(ages, t)}."
        )
    return said


def _worst_outages(ages: AgeComparison, t: int) -> str:
    """Return the worst ratio of a tracker at each point, and where."""
    parts = []
    for group in dict.fromkeys(ages.group):
        here = [p for p, one in enumerate(ages.group) if one == group]
        found = ", ".join(
            f"{_value(ages, p)} {ages.worst_ratio[t, p]:.3g} ({ages.passes[k]} {ages.outages[k]})"
            for p in here
            for k in [int(ages.worst_ratio_outage[t, p])]
            if np.isfinite(ages.worst_ratio[t, p])
        )
        parts.append(f"{group}: {found}" if group else found)
    return "; ".join(parts)


def _value(ages: AgeComparison, p: int) -> str:
    return f"{ages.value[p]:g}" + ("" if ages.unit == "-" else f" {ages.unit}")


def _point(ages: AgeComparison, p: int) -> str:
    return _value(ages, p) + (f", {ages.group[p]}" if ages.group[p] else "")


def knowing_verdict(found: Consistency, level: float) -> list[str]:
    """Say whether each tracker knows how good it is, and what another prior costs."""
    inside, percent = inside_band(found), f"{100 * level:g} %"
    said = []
    for t, tracker in enumerate(found.trackers):
        low, high = found.overall_interval[:, t]
        right = tracker in found.consistent
        expects = "which expects errors as they truly are" if right else (
            "which expects other errors than there are"
        )  # fmt: skip
        word = "knows how good it is" if low <= 2.0 <= high else (
            "is overconfident" if low > 2.0 else "is too cautious"
        )  # fmt: skip
        sentence = (
            f"{tracker}, {expects}, {word}: the mean NEES is {found.overall[t]:.3g} ({low:.3g} to "
            f"{high:.3g}, {percent} interval; 2 expected), within the {percent} band of χ² in "
            f"{int(inside[t].sum())} of {len(found.outages)} outages."
        )
        if not right:
            sentence += _error_change(found, t)
        said.append(sentence)
    return said


def _error_change(found: Consistency, t: int) -> str:
    low, high = found.error_ratio_interval[:, t]
    if not np.isfinite(found.error_ratio[t]):
        return ""
    word = "larger" if low > 1.0 else "smaller" if high < 1.0 else "not changed"
    return (
        f" Its error is {word}: {found.error_ratio[t]:.3g} times that of {found.consistent[0]} "
        f"({low:.3g} to {high:.3g})."
    )


def cover_verdict(product: TrackingComparison) -> list[str]:
    """Say which trackers' covariances do not cover their errors."""
    share = np.mean(product.uncovered, axis=-1)
    middle = product.quantiles[1, product.measures.index("nees")]
    outages = np.sum(middle > product.nees_limit, axis=-1)
    expected = 1.0 - COVERED
    # ten times what is expected is no accident of some hundred cases
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
            f" Stations are told up to {1e-3 * product.station_error_m:.3g} km off their places, "
            "which no tracker expects."
        )
    return [
        f"The covariances do not cover the errors: their NEES is beyond {product.nees_limit:.3g}, "
        f"the {100 * COVERED:g} % quantile, in this share of cases, mean over "
        f"{len(product.outages)} outages: {', '.join(parts)}.{why} A search is made as large as "
        "the covariance says, so it may be too small."
    ]


def reacquisition_verdict(product: TrackingComparison) -> list[str]:
    """Say what share is not found by the search."""
    lost = product.reacquired[2]
    known = np.flatnonzero(np.isfinite(lost))
    if not known.size:
        return []
    parts = ", ".join(f"{product.trackers[t]} {100 * lost[t]:.3g} %" for t in known)
    return [f"Share that the search does not find before the set: {parts}."]
