"""What the refinement of an asteroid's orbit answers, in sentences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere_estimators.consistency import chi_square_band
from hillsphere_estimators.refinement.gains import gains, median_gain_range, reported, rms
from hillsphere_estimators.refinement.products import OrbitRefinement
from hillsphere_estimators.refinement.specs import OrbitRefinementSpec

__all__ = ["judged", "refinement_verdict", "silences"]

_DAY = 86400.0
_CLAIMED = 2.0
"""What is called a considerable gain."""


def judged(product: OrbitRefinement, arm: int) -> str:
    """Return how errors of all states at the end compare with what the filter says of them.

    Over all geometries: in a single one, of a few cases, no mean is far out of its wide band.
    """
    low, high = _joint_band(product)
    mean = float(product.joint_nees[arm].mean())
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
    optical = product.optical
    position, velocity = rms(optical.position_m[-1]) / 1e3, rms(optical.velocity_m_s[-1])
    found = [
        f"Optical angles alone: rms errors of {position.min():.3g} to {position.max():.3g} km and "
        f"{velocity.min():.2g} to {velocity.max():.2g} m/s, by geometry."
    ]
    for a, arm in enumerate(product.arms):
        for since, k in reported(spec, product.tracked[a]):
            found.append(f"{arm}, after {since / _DAY:.3g} d: {_gained(product, a, k)}.")
    if spec.claims_velocity_kept:
        v = gains(product, 0)[1]
        answer = (
            "refuted" if v.min() > _CLAIMED else "confirmed" if v.max() < _CLAIMED else "undecided"
        )
        found.append(
            "The statement that velocity is not considerably improved by tracking (read as: by "
            f"less than a factor of {_CLAIMED:g}) is {answer} here: its rms error falls "
            f"{v.min():.3g} to {v.max():.3g} times with {product.arms[0]!r}."
        )
    found.append(_consistency(product))
    if not (product.settled.all() and product.tracked_settled.all()):
        found.append(
            f"Not converged, and counted all the same: {int((product.settled == 0).sum())} of "
            f"{product.settled.size} optical fits, {int((product.tracked_settled == 0).sum())} of "
            f"{product.tracked_settled.size} during tracking."
        )
    return [*found, *_silent(product)]


def _gained(product: OrbitRefinement, arm: int, at: int) -> str:
    """Return by what errors fell, in words."""
    parts = []
    ranges = median_gain_range(product, arm, at)
    for name, gain, (low, high) in zip(
        ("position", "velocity"), gains(product, arm, at), ranges, strict=True
    ):
        parts.append(
            f"{name} better {gain.min():.3g} to {gain.max():.3g} times by geometry, median "
            f"{np.median(gain):.3g} ({low:.3g} … {high:.3g}, 90 %)"
        )
    return "; ".join(parts)


def _joint_band(product: OrbitRefinement) -> Array:
    return chi_square_band(product.states, product.joint_nees[0].size)


def _consistency(product: OrbitRefinement) -> str:
    low, high = _joint_band(product)
    each = ", ".join(
        f"{arm!r} {product.joint_nees[a].mean():.4g} ({judged(product, a)})"
        for a, arm in enumerate(product.arms)
    )
    bad = [arm for a, arm in enumerate(product.arms) if judged(product, a) != "consistent"]
    answer = (
        "Errors are as large as the filter says"
        if not bad
        else f"Errors are not as large as the filter says with {', '.join(map(repr, bad))}"
    )
    return (
        f"{answer}: mean NEES of all {product.states} states at the end over "
        f"{product.joint_nees[0].size} cases {each}; 99.9 % band {low:.4g} … {high:.4g}."
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


def _silent(product: OrbitRefinement) -> list[str]:
    """Return what happens to velocities while the first set's sensors are partly silent."""
    known, craft = product.tracked[0], product.craft_velocity_sigma_m_s[0]
    if not craft.any():
        return []
    grown: list[tuple[float, float]] = []
    for g in range(len(product.geometries)):
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
        f"the asteroid's by {np.median(asteroid):.3g} ({asteroid.max():.3g})."
    ]
