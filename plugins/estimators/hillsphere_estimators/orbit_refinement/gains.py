"""Gains of the tracking part: ratios of rms errors before and after."""

from __future__ import annotations

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.interfaces import Array, Integers
from hillsphere_estimators.orbit_refinement.products import Knowledge, OrbitRefinement
from hillsphere_estimators.orbit_refinement.specs import OrbitRefinementSpec

__all__ = [
    "gain_ranges",
    "gains",
    "geometries_with_observations",
    "geometries_with_tracking",
    "median_gain_range",
    "report_times",
    "rms",
]

_AGAIN = 400
"""Bootstrap samples. Twenty of them lie beyond each of the 5 % and 95 % limits, which determines
these probabilities to about one percentage point."""


def report_times(spec: OrbitRefinementSpec, known: Knowledge) -> list[tuple[float, int]]:
    """Return the times of the table, s after tracking began, each with its index."""
    since = known.t_s - known.t_s[0]
    wanted = list(spec.reported_s) or [DAY_S * k for k in range(1, int(since[-1] // DAY_S) + 1)]
    indices = sorted({int(np.argmin(np.abs(since - t))) for t in wanted} | {len(since) - 1})
    return [(float(since[k]), k) for k in indices]


def geometries_with_observations(product: OrbitRefinement) -> Integers:
    """Return the geometries in which a telescope observed the asteroid; the others have no fit."""
    return np.flatnonzero(product.optical.rows.sum(axis=0) > 0.0)


def geometries_with_tracking(product: OrbitRefinement, arm: int) -> Integers:
    """Return the geometries in which tracking did not diverge.

    It diverged where it converged in no case, or where an error is not finite. The rows of such a
    geometry show its numbers, but statistics over geometries leave it out.
    """
    known = product.tracked[arm]
    errors = known.position_m + known.velocity_m_s + known.nees
    finite = np.isfinite(errors).all(axis=(0, 2)) & np.isfinite(product.joint_nees[arm]).all(axis=1)
    return np.flatnonzero(finite & (product.tracked_settled[arm] > 0.0).any(axis=1))


def rms(values: Array) -> Array:
    """Return the root mean square over the last axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=-1)))


def gains(product: OrbitRefinement, arm: int, at: int = -1) -> tuple[Array, Array]:
    """Return the gains of position and velocity (G,): rms error before over that at `at`."""
    known = product.tracked[arm]
    return (
        rms(known.position_m[0]) / rms(known.position_m[at]),
        rms(known.velocity_m_s[0]) / rms(known.velocity_m_s[at]),
    )


def gain_ranges(product: OrbitRefinement, arm: int, at: int = -1) -> tuple[Array, Array]:
    """Return the 5 % and 95 % quantiles (2, G) of both gains over bootstrap samples."""
    position, velocity = (
        np.percentile(anew, [5.0, 95.0], axis=-1) for anew in _bootstrap_gains(product, arm, at)
    )
    return position, velocity


def median_gain_range(product: OrbitRefinement, arm: int, at: int) -> tuple[Array, Array]:
    """Return the 5 % and 95 % quantiles (2,) of the median gains over geometries, likewise.

    Over those of `geometries_with_tracking`, of which there must be one.
    """
    some = geometries_with_tracking(product, arm)
    position, velocity = (
        np.percentile(np.median(anew[some], axis=0), [5.0, 95.0])
        for anew in _bootstrap_gains(product, arm, at)
    )
    return position, velocity


def _bootstrap_gains(product: OrbitRefinement, arm: int, at: int) -> list[Array]:
    """Return the gains (G, B) of position and velocity for B bootstrap samples of the cases."""
    known = product.tracked[arm]
    cases = known.position_m.shape[-1]
    # the same samples for all arms and times, so that these can be compared
    some = np.random.default_rng(0).integers(cases, size=(_AGAIN, cases))
    return [
        rms(errors[0][:, some]) / rms(errors[at][:, some])
        for errors in (known.position_m, known.velocity_m_s)
    ]
