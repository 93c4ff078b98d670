"""Plan of a pass before it begins: turn, flips, rewinds and ramps through keyholes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from hillsphere.errors import ConvergenceError, InputError
from hillsphere.interfaces import Array
from hillsphere_tracking.pointing.keyhole import Ramp, best_ramp
from hillsphere_tracking.pointing.mounts import AxisLimits, Mount
from hillsphere_tracking.pointing.route import coarse_route, on_target_angles
from hillsphere_tracking.topocentric import direction_cosines

__all__ = ["PassPlan", "plan_pass"]

_KEPT = 0.98
"""Fraction of rate and acceleration that a plan uses. The rest lets the axes correct deviations
from it: with 1 a lag would never be made up, with much less the error in the keyhole grows."""
_WORTH = 0.98
"""A ramp of twice the margin is taken if it lowers the largest error at least to this fraction.
Nearer to 1 the ramps get long for nothing; much below, useful lengths are refused."""


@dataclass(frozen=True, eq=False)
class PassPlan:
    """Planned motion of the axes during a pass.

    Parameters
    ----------
    mount : Mount
        Mount of the plan.
    times_s : ndarray, shape (K,)
        Evenly spaced times.
    primary_rad, secondary_rad : ndarray, shape (K,)
        Axis angles within the stops.
    flipped : ndarray of bool, shape (K,)
        Where the mount is flipped (the beam goes over the top).
    ramp : ndarray of bool, shape (K,)
        Where the primary axis follows the plan instead of the target: keyholes and rewinds.
    error_rad : ndarray, shape (K,)
        Expected error of the beam, large during rewinds and beyond stops.
    """

    mount: Mount
    times_s: Array
    primary_rad: Array
    secondary_rad: Array
    flipped: NDArray[np.bool_]
    ramp: NDArray[np.bool_]
    error_rad: Array

    def targets(self, at_s: Array, azimuth_rad: Array, elevation_rad: Array) -> tuple[Array, Array]:
        """Return the axis angles for updated predictions.

        The plan gives the turn, the flip and the primary angle on ramps. Elsewhere the primary
        follows the prediction; the secondary always minimises the error.

        Parameters
        ----------
        at_s : ndarray, shape (N,)
            Times; outside the plan its first and last values hold.
        azimuth_rad, elevation_rad : ndarray, shape (N,)
            Predictions at these times.

        Returns
        -------
        primary_rad, secondary_rad : ndarray, shape (N,)
            Axis angles within the stops.
        """
        direction = direction_cosines(azimuth_rad, elevation_rad)
        planned = np.interp(at_s, self.times_s, self.primary_rad)
        step = self.times_s[1] - self.times_s[0]
        i = np.rint((np.asarray(at_s) - self.times_s[0]) / step).astype(np.int64)
        i = np.clip(i, 0, self.times_s.size - 1)
        plain, _ = self.mount.on_target(direction)
        # on the side of the plan (flipped or not), on the turn nearest to the plan
        turned = plain + np.where(self.flipped[i], pi, 0.0)
        on_target = turned + 2.0 * pi * np.rint((planned - turned) / (2.0 * pi))
        limits = self.mount.primary
        primary = np.clip(
            np.where(self.ramp[i], planned, on_target), limits.lower_rad, limits.upper_rad
        )
        return primary, self.mount.secondary_for(direction, primary)


def plan_pass(
    times_s: Array,
    azimuth_rad: Array,
    elevation_rad: Array,
    mount: Mount,
    start_rad: float | None = None,
) -> PassPlan:
    """Plan a whole pass from its prediction.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Evenly spaced times with the period of the commands (such as 0.1 s), K ≥ 8.
    azimuth_rad, elevation_rad : ndarray, shape (K,)
        Predicted directions of the satellite.
    mount : Mount
        Axes of the mount and their limits.
    start_rad : float, optional
        Primary angle before the pass, which decides between turns of equal error. The axis is
        assumed to reach the beginning of the plan in time.

    Returns
    -------
    PassPlan
        Plan; `error_rad` is the error that the limits cause.

    Raises
    ------
    InputError
        If there are fewer than eight times, they are not evenly spaced, or the shapes differ.
    """
    times = np.asarray(times_s, dtype=float)
    if (
        times.ndim != 1
        or times.size < 8
        or not times.shape == np.shape(azimuth_rad) == np.shape(elevation_rad)
    ):
        raise InputError(
            "a plan needs at least 8 times with an azimuth and an elevation each, got"
            f" {times.shape}, {np.shape(azimuth_rad)} and {np.shape(elevation_rad)}"
        )
    step = np.diff(times)
    if not (step[0] > 0.0 and np.allclose(step, step[0], rtol=1e-4, atol=0.0)):
        raise InputError("a plan needs evenly spaced, rising times; interpolate the prediction")
    direction = direction_cosines(azimuth_rad, elevation_rad)
    if not np.isfinite(direction).all():
        raise InputError("a plan needs finite angles, got nan or inf")
    plan = _make_plan(times, direction, mount, start_rad)
    if plan.flipped.any() and mount.secondary.lower_rad < 0.5 * pi:
        # The loss of the route only approximates the largest error: compare with an upright plan.
        secondary = replace(mount.secondary, upper_rad=0.5 * pi)
        upright = _make_plan(times, direction, replace(mount, secondary=secondary), start_rad)
        if upright.error_rad.max() <= plan.error_rad.max():
            return replace(upright, mount=mount)
    return plan


def _make_plan(times: Array, direction: Array, mount: Mount, start_rad: float | None) -> PassPlan:
    limits = mount.primary
    route = coarse_route(times, direction, mount, start_rad)
    reference, flipped = on_target_angles(direction, mount, route)
    _, secondary = mount.on_target(direction)
    distance = 0.5 * pi - np.abs(secondary)
    primary, ramp = _with_ramps(times, reference, distance, limits)
    primary = np.clip(primary, limits.lower_rad, limits.upper_rad)
    best = mount.secondary_for(direction, primary)
    error = mount.error(direction, primary, best)
    return PassPlan(mount, times, primary, best, flipped, ramp, error)


def _with_ramps(
    times: Array, reference: Array, distance: Array, limits: AxisLimits
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the course of the primary axis, on target except on ramps, and where the ramps are."""
    kept = AxisLimits(
        limits.lower_rad,
        limits.upper_rad,
        _KEPT * limits.rate_rad_s,
        _KEPT * limits.acceleration_rad_s2,
    )
    within = np.clip(reference, limits.lower_rad, limits.upper_rad)
    spans = _fast_stretches(within, times, kept)
    ramps: list[tuple[int, slice, Array]] = []  # with the first index of the excess
    while spans:
        first, last = spans.pop(0)
        part, ramp_found = _extend_ramp(times, reference, distance, kept, first, last)
        # A ramp that overlaps the next stretch, or the previous ramp, is planned anew for both.
        if spans and spans[0][0] < part.stop:
            spans[0] = (first, spans[0][1])
        elif ramps and part.start < ramps[-1][1].stop:
            spans.insert(0, (ramps.pop()[0], last))
        else:
            ramps.append((first, part, ramp_found.primary_rad))
    course, ramp = within, np.zeros(times.size, dtype=bool)
    for _, part, angles in ramps:
        course[part], ramp[part] = angles, True
    return course, ramp


def _extend_ramp(
    times: Array, reference: Array, distance: Array, limits: AxisLimits, first: int, last: int
) -> tuple[slice, Ramp]:
    """Return the ramp over a fast stretch, its margins doubled while that lowers the error.

    The first margin is the time to accelerate plus half the time for the swing of the angle.
    """
    step = float(times[1] - times[0])
    run = limits.rate_rad_s / limits.acceleration_rad_s2
    swing = float(np.ptp(reference[first : last + 1]))
    margin = max(ceil((run + 0.5 * swing / limits.rate_rad_s) / step), 4)
    best: tuple[slice, Ramp] | None = None
    while True:
        part = slice(max(first - margin, 0), min(last + margin + 1, times.size))
        whole = part.start == 0 and part.stop == times.size
        candidate = best_ramp(
            times[part],
            reference[part],
            distance[part],
            limits,
            (part.start > 0, part.stop < times.size),
        )
        if candidate is not None:
            if best is not None and candidate.error_rad > _WORTH * best[1].error_rad:
                return best
            best = part, candidate
        if whole:
            break
        margin *= 2
    if best is None:
        raise ConvergenceError(
            f"no course of the primary axis exists around {times[first]:g} s; plan with a shorter"
            " period, which resolves the limits of rate and acceleration"
        )
    return best


def _fast_stretches(course: Array, times: Array, limits: AxisLimits) -> list[tuple[int, int]]:
    """Return the first and last index of each stretch that exceeds rate or acceleration."""
    step = float(times[1] - times[0])
    move = np.diff(course)
    fast = np.abs(move) > limits.rate_rad_s * step
    jerky = np.abs(np.diff(move)) > limits.acceleration_rad_s2 * step**2
    bad = np.zeros(course.size, dtype=bool)
    bad[:-1] |= fast
    bad[1:] |= fast
    bad[1:-1] |= jerky
    indices = np.flatnonzero(bad)
    if indices.size == 0:
        return []
    # stretches closer than twice the time to reach full rate are one
    gap = 2 * limits.rate_rad_s / limits.acceleration_rad_s2 / step
    cuts = np.flatnonzero(np.diff(indices) > gap)
    firsts = np.concatenate([indices[:1], indices[cuts + 1]])
    lasts = np.concatenate([indices[cuts], indices[-1:]])
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True)]
