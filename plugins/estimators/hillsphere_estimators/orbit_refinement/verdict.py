"""Verdict of the refinement of an asteroid's orbit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.orbit_refinement.gains import (
    gains,
    geometries_with_observations,
    geometries_with_tracking,
    median_gain_range,
    report_times,
    rms,
)
from hillsphere_estimators.orbit_refinement.products import OrbitRefinement
from hillsphere_estimators.orbit_refinement.specs import OrbitRefinementSpec

__all__ = ["judge_consistency", "refinement_verdict", "silences"]

_PEAK = 1.1
"""Growth of a standard deviation that counts as a peak: 10 % is visible in a figure of one page."""


def judge_consistency(product: OrbitRefinement, arm: int) -> str:
    """Return the verdict on an arm by the mean NEES of all states at the end.

    The mean is over all geometries in which tracking did not diverge: in a single geometry, of a
    few cases, the band is so wide that no mean leaves it.

    Returns
    -------
    str
        ``consistent``, ``overconfident``, ``cautious``, or ``diverged`` if no geometry is left.
    """
    some = geometries_with_tracking(product, arm)
    if not some.size:
        return "diverged"
    low, high = _joint_band(product, arm)
    mean = float(product.joint_nees[arm][some].mean())
    if not mean <= high:
        return "overconfident"
    return "cautious" if mean < low else "consistent"


def refinement_verdict(product: OrbitRefinement, spec: OrbitRefinementSpec) -> list[str]:
    """Return the sentences of the verdict.

    Parameters
    ----------
    product : OrbitRefinement
        Product of the stage.
    spec : OrbitRefinementSpec
        Reported times.

    Returns
    -------
    list of str
        Errors, gains of each arm, consistency, convergence, and outages.
    """
    optical, seen = product.optical, geometries_with_observations(product)
    sentences = _describe_omissions(product)
    if seen.size:
        position = rms(optical.position_m[-1])[seen] / 1e3
        velocity = rms(optical.velocity_m_s[-1])[seen]
        sentences.append(
            f"Optical angles alone: rms errors {position.min():.3g} to {position.max():.3g} km and "
            f"{velocity.min():.2g} to {velocity.max():.2g} m/s, depending on the geometry."
        )
    for a, arm in enumerate(product.arms):
        for since, k in (
            report_times(spec, product.tracked[a])
            if geometries_with_tracking(product, a).size
            else ()
        ):
            sentences.append(
                f"{arm}, after {since / DAY_S:.3g} d: {_describe_gains(product, a, k)}."
            )
    sentences.append(_consistency(product))
    tracked = [
        one[geometries_with_tracking(product, a)] for a, one in enumerate(product.tracked_settled)
    ]
    unsettled = sum(int((one == 0).sum()) for one in tracked)
    if not product.settled.all() or unsettled:
        sentences.append(
            f"{int((product.settled == 0).sum())} of {product.settled.size} optical fits and "
            f"{unsettled} of {sum(one.size for one in tracked)} during tracking did not converge; "
            "the statistics include them."
        )
    return [*sentences, *_describe_silences(product)]


def _describe_omissions(product: OrbitRefinement) -> list[str]:
    """Return sentences on geometries that the statistics leave out, and why."""
    names, sentences = np.array(product.geometries), []
    if unseen := sorted(set(range(len(names))) - set(geometries_with_observations(product))):
        sentences.append(
            f"No telescope sees the asteroid in {', '.join(map(repr, names[unseen].tolist()))}; "
            "the table shows the first belief there."
        )
    lost = [
        f"{', '.join(map(repr, names[own].tolist()))} with {arm!r}"
        for a, arm in enumerate(product.arms)
        if (own := sorted(set(range(len(names))) - set(geometries_with_tracking(product, a))))
    ]
    if lost:
        sentences.append(
            f"Tracking diverged, converging in no case, in {'; '.join(lost)}. Statistics over "
            "geometries leave these out."
        )
    return sentences


def _describe_gains(product: OrbitRefinement, arm: int, at: int) -> str:
    """Return the gains of one arm at one time, in words."""
    parts, some = [], geometries_with_tracking(product, arm)
    ranges = median_gain_range(product, arm, at)
    for name, every, (low, high) in zip(
        ("position", "velocity"), gains(product, arm, at), ranges, strict=True
    ):
        gain = every[some]
        parts.append(
            f"{name} error smaller by a factor of {np.median(gain):.3g} in the median over "
            f"geometries (90 %: {low:.3g} to {high:.3g}), {gain.min():.3g} to {gain.max():.3g} in "
            "single ones"
        )
    return "; ".join(parts)


def _joint_band(product: OrbitRefinement, arm: int) -> Array:
    """Return the 99.9 % band of the mean NEES of all states of an arm."""
    return chi_square_band(product.states, _cases(product, arm))


def _cases(product: OrbitRefinement, arm: int) -> int:
    """Return the number of cases in the mean NEES of an arm."""
    return int(product.joint_nees[arm][geometries_with_tracking(product, arm)].size)


def _consistency(product: OrbitRefinement) -> str:
    """Return the sentence on the consistency of all arms."""
    kept = [a for a in range(len(product.arms)) if geometries_with_tracking(product, a).size]
    if not kept:
        return "Consistency cannot be judged: tracking diverged in all geometries."
    means = {a: product.joint_nees[a][geometries_with_tracking(product, a)].mean() for a in kept}
    each = ", ".join(
        f"{product.arms[a]!r} {mean:.4g} ({judge_consistency(product, a)})"
        for a, mean in means.items()
    )
    bad = [product.arms[a] for a in kept if judge_consistency(product, a) != "consistent"]
    bands: dict[int, list[str]] = {}
    for a in kept:
        bands.setdefault(_cases(product, a), []).append(product.arms[a])
    limits = [
        "{:.4g} … {:.4g}".format(*chi_square_band(product.states, cases))
        + (f" ({', '.join(map(repr, arms))})" if len(bands) > 1 else "")
        for cases, arms in bands.items()
    ]
    answer = (
        "The filter is consistent"
        if not bad
        else f"The filter is not consistent with {', '.join(map(repr, bad))}"
    )
    return (
        f"{answer}: mean NEES of all {product.states} states at the end over "
        f"{' or '.join(map(str, bands))} cases {each}; 99.9 % band {', '.join(limits)}."
    )


def silences(rows: Array) -> list[tuple[int, int]]:
    """Return the intervals in which fewer values are measured than at most.

    Parameters
    ----------
    rows : ndarray, shape (K,)
        Number of values measured at each time.

    Returns
    -------
    list of (int, int)
        Index of the last time before each interval, and of the last time in it.
    """
    missing: NDArray[np.bool_] = rows < rows[1:].max() - 0.5
    missing[0] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(int), [0]])))
    return [(int(i) - 1, int(j) - 1) for i, j in zip(edges[::2], edges[1::2], strict=True)]


def _peaks(grown: Array) -> str:
    """Return the number of peaks as a word of a sentence."""
    count = int((grown > _PEAK).sum())
    return str(count) if count else "no"


def _describe_silences(product: OrbitRefinement) -> list[str]:
    """Return the growth of the velocities' standard deviations during outages of the first arm."""
    known, craft = product.tracked[0], product.craft_velocity_sigma_m_s[0]
    if not craft.any():
        return []
    grown: list[tuple[float, float]] = []
    for g in geometries_with_tracking(product, 0).tolist():
        own = [rms(sigma[:, g]) for sigma in (craft, known.velocity_sigma_m_s)]
        # times before the first measurements are no outage
        grown += [
            (float(own[0][j] / own[0][i]), float(own[1][j] / own[1][i]))
            for i, j in silences(known.rows[:, g])
            if i > 0
        ]
    if not grown:
        return []
    spacecraft, asteroid = np.array(grown).T
    return [
        f"While sensors of {product.arms[0]!r} are silent (outages, stations below the horizon; "
        f"{len(grown)} times), the standard deviation of a spacecraft's velocity changes by a "
        f"factor of {np.median(spacecraft):.3g} (median; largest {spacecraft.max():.3g}), that of "
        f"the asteroid's by {np.median(asteroid):.3g} ({asteroid.max():.3g}). A peak, of more than "
        f"{100.0 * (_PEAK - 1.0):.0f} %, has the spacecraft's {_peaks(spacecraft)} times, the "
        f"asteroid's {_peaks(asteroid)} times."
    ]
