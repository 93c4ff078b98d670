"""What the refinement of an asteroid's orbit answers, in sentences."""

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

_CLAIMED = 2.0
"""What is called a considerable gain."""
_PEAK = 1.1
"""Growth of a standard deviation that is seen in a figure."""


def judge_consistency(product: OrbitRefinement, arm: int) -> str:
    """Return how errors of all states at the end compare with what the filter says of them.

    Over all geometries in which tracking held: in a single one, of a few cases, no mean is far out
    of its wide band. ``diverged`` if there is none.
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
    """Return the sentences.

    Parameters
    ----------
    product : OrbitRefinement
        Of the stage.
    spec : OrbitRefinementSpec
        Says when it is reported and which claim is answered.

    Returns
    -------
    list of str
        Errors, gains of each set of sensors, consistency, convergence, silences.
    """
    optical, seen = product.optical, geometries_with_observations(product)
    found = _describe_omissions(product)
    if seen.size:
        position = rms(optical.position_m[-1])[seen] / 1e3
        velocity = rms(optical.velocity_m_s[-1])[seen]
        found.append(
            f"Optical angles alone: rms errors of {position.min():.3g} to {position.max():.3g} km "
            f"and {velocity.min():.2g} to {velocity.max():.2g} m/s, by geometry."
        )
    for a, arm in enumerate(product.arms):
        for since, k in (
            report_times(spec, product.tracked[a])
            if geometries_with_tracking(product, a).size
            else ()
        ):
            found.append(f"{arm}, after {since / DAY_S:.3g} d: {_describe_gains(product, a, k)}.")
    first = geometries_with_tracking(product, 0)
    if spec.claims_velocity_kept and first.size:
        v = gains(product, 0)[1][first]
        answer = (
            "refuted" if v.min() > _CLAIMED else "confirmed" if v.max() < _CLAIMED else "undecided"
        )
        found.append(
            "The statement that velocity is not considerably improved by tracking (read as: by "
            f"less than a factor of {_CLAIMED:g}) is {answer} here: its rms error falls "
            f"{v.min():.3g} to {v.max():.3g} times with {product.arms[0]!r}."
        )
    found.append(_consistency(product))
    tracked = [
        one[geometries_with_tracking(product, a)] for a, one in enumerate(product.tracked_settled)
    ]
    unsettled = sum(int((one == 0).sum()) for one in tracked)
    if not product.settled.all() or unsettled:
        found.append(
            f"Not converged, and counted all the same: {int((product.settled == 0).sum())} of "
            f"{product.settled.size} optical fits, {unsettled} of "
            f"{sum(one.size for one in tracked)} during tracking."
        )
    return [*found, *_describe_silences(product)]


def _describe_omissions(product: OrbitRefinement) -> list[str]:
    """Return which geometries nothing is said of, and why."""
    names, found = np.array(product.geometries), []
    if unseen := sorted(set(range(len(names))) - set(geometries_with_observations(product))):
        found.append(
            f"No telescope sees the asteroid in {', '.join(map(repr, names[unseen].tolist()))}: "
            "there only what was known before stands in the table."
        )
    lost = [
        f"{', '.join(map(repr, names[own].tolist()))} with {arm!r}"
        for a, arm in enumerate(product.arms)
        if (own := sorted(set(range(len(names))) - set(geometries_with_tracking(product, a))))
    ]
    if lost:
        found.append(
            f"Tracking diverged, converging in no case, in {'; '.join(lost)}: left out of what is "
            "said over geometries."
        )
    return found


def _describe_gains(product: OrbitRefinement, arm: int, at: int) -> str:
    """Return by what errors fell, in words."""
    parts, some = [], geometries_with_tracking(product, arm)
    ranges = median_gain_range(product, arm, at)
    for name, every, (low, high) in zip(
        ("position", "velocity"), gains(product, arm, at), ranges, strict=True
    ):
        gain = every[some]
        parts.append(
            f"{name} better {gain.min():.3g} to {gain.max():.3g} times by geometry, median "
            f"{np.median(gain):.3g} ({low:.3g} … {high:.3g}, 90 %)"
        )
    return "; ".join(parts)


def _joint_band(product: OrbitRefinement, arm: int) -> Array:
    return chi_square_band(product.states, _cases(product, arm))


def _cases(product: OrbitRefinement, arm: int) -> int:
    return int(product.joint_nees[arm][geometries_with_tracking(product, arm)].size)


def _consistency(product: OrbitRefinement) -> str:
    kept = [a for a in range(len(product.arms)) if geometries_with_tracking(product, a).size]
    if not kept:
        return "Of consistency nothing can be said: tracking diverged in all geometries."
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
        "Errors are as large as the filter says"
        if not bad
        else f"Errors are not as large as the filter says with {', '.join(map(repr, bad))}"
    )
    return (
        f"{answer}: mean NEES of all {product.states} states at the end over "
        f"{' or '.join(map(str, bands))} cases {each}; 99.9 % band {', '.join(limits)}."
    )


def silences(rows: Array) -> list[tuple[int, int]]:
    """Return stretches in which less is measured than at most: last index before, last within.

    Parameters
    ----------
    rows : ndarray, shape (K,)
        How many values are measured at each time.
    """
    missing: NDArray[np.bool_] = rows < rows[1:].max() - 0.5
    missing[0] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(int), [0]])))
    return [(int(i) - 1, int(j) - 1) for i, j in zip(edges[::2], edges[1::2], strict=True)]


def _peaks(grown: Array) -> str:
    count = int((grown > _PEAK).sum())
    return str(count) if count else "no"


def _describe_silences(product: OrbitRefinement) -> list[str]:
    """Return what happens to velocities while the first set's sensors are partly silent."""
    known, craft = product.tracked[0], product.craft_velocity_sigma_m_s[0]
    if not craft.any():
        return []
    grown: list[tuple[float, float]] = []
    for g in geometries_with_tracking(product, 0).tolist():
        own = [rms(sigma[:, g]) for sigma in (craft, known.velocity_sigma_m_s)]
        # what comes before the first measurements are in is no silence
        grown += [
            (float(own[0][j] / own[0][i]), float(own[1][j] / own[1][i]))
            for i, j in silences(known.rows[:, g])
            if i > 0
        ]
    if not grown:
        return []
    spacecraft, asteroid = np.array(grown).T
    return [
        f"While {product.arms[0]!r} is partly silent (outages, stations below the horizon; "
        f"{len(grown)} times), the standard deviation of a spacecraft's velocity changes by a "
        f"factor of {np.median(spacecraft):.3g} (median; greatest {spacecraft.max():.3g}), that of "
        f"the asteroid's by {np.median(asteroid):.3g} ({asteroid.max():.3g}). A peak, of more than "
        f"{100.0 * (_PEAK - 1.0):.0f} %, has the spacecraft's {_peaks(spacecraft)} times, the "
        f"asteroid's {_peaks(asteroid)} times."
    ]
