"""What the comparison of trackers says in words; nothing is said that the numbers do not."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from hillsphere.reference import ReferenceTable
from hillsphere_tracking.assisted.comparison_products import (
    FRAMES,
    AgeComparison,
    Consistency,
    TrackingComparison,
)

__all__ = ["age_verdict", "comparison_verdict", "inside_band", "knowing_verdict"]


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
        said.append(_published_verdict(product, published))
        notes = sum(1 for row in (reference.rows if reference else ()) if row.get("note"))
        if notes:
            said.append(f"{notes} of the published rows come with a note: see the table.")
    return said


def _published_verdict(
    product: TrackingComparison, published: Mapping[tuple[str, str], float]
) -> str:
    keys = list(zip(product.passes, product.outages, strict=True))
    places = [keys.index(key) for key in published]
    values = np.radians(np.array(list(published.values())))
    m = product.measures.index("error_max")
    low, middle, high = product.quantiles[:, m][:, :, places]
    inside = np.sum((low <= values) & (values <= high), axis=1)
    parts = ", ".join(
        f"{name} {np.degrees(np.mean(middle[t])):.3f}° ({inside[t]} inside)"
        for t, name in enumerate(product.trackers)
    )
    return (
        f"Mean of the {values.size} published errors {np.degrees(np.mean(values)):.3f}°; means of "
        f"the medians, and how many published values lie within 5–95 %: {parts}."
    )


def age_verdict(ages: AgeComparison, baseline: str) -> list[str]:
    """Say how each tracker compares with the baseline at best and at worst over the sweep."""
    if baseline not in ages.trackers:
        return []
    ratio = ages.mean_median_rad / ages.mean_median_rad[ages.trackers.index(baseline)]
    said = []
    for t, tracker in enumerate(ages.trackers):
        known = np.flatnonzero(np.isfinite(ratio[t]))
        if tracker == baseline or not known.size:
            continue
        best, worst = known[np.argmin(ratio[t, known])], known[np.argmax(ratio[t, known])]
        said.append(
            f"Over {ages.name.replace('_', ' ')}, {tracker} errs {ratio[t, worst]:.3g} times as "
            f"much as {baseline} at worst ({_point(ages, int(worst))}) and {ratio[t, best]:.3g} "
            f"times at best ({_point(ages, int(best))})."
        )
    return said


def _point(ages: AgeComparison, p: int) -> str:
    unit = "" if ages.unit == "-" else f" {ages.unit}"
    return f"{ages.value[p]:g}{unit}" + (f", {ages.group[p]}" if ages.group[p] else "")


def knowing_verdict(found: Consistency, level: float) -> list[str]:
    """Say in how many outages each tracker knows how good it is."""
    inside = inside_band(found)
    return [
        f"{tracker}, where the truth is what was assumed: the mean NEES is "
        f"{np.mean(found.mean[t]):.3g} (2 expected) and lies within its {100 * level:g} % band in "
        f"{int(inside[t].sum())} of {len(found.outages)} outages."
        for t, tracker in enumerate(found.trackers)
    ]
