"""The plan of a pass: turn, flips, rewinds and the ramps through keyholes, before it begins."""

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
"""Fraction of rate and acceleration that plans use: the rest is for corrections to them."""
_WORTH = 0.98
"""A longer ramp is taken if it lowers the largest error at least to this part of it."""


@dataclass(frozen=True, eq=False)
class PassPlan:
    """What the axes shall do during a pass.

    Parameters
    ----------
    mount : Mount
        For which it was made.
    times_s : ndarray, shape (K,)
        Evenly spaced.
    primary_rad, secondary_rad : ndarray, shape (K,)
        Axis angles, within the stops.
    flipped : ndarray of bool, shape (K,)
        Where the target is followed over the top.
    ramp : ndarray of bool, shape (K,)
        Where the primary axis keeps to the plan instead of following the target: keyholes, rewinds.
    error_rad : ndarray, shape (K,)
        By how much the beam will miss: large where a stop or a rewind is in the way.
    """

    mount: Mount
    times_s: Array
    primary_rad: Array
    secondary_rad: Array
    flipped: NDArray[np.bool_]
    ramp: NDArray[np.bool_]
    error_rad: Array

    def targets(self, at_s: Array, azimuth_rad: Array, elevation_rad: Array) -> tuple[Array, Array]:
        """Return where the axes should be for newer predictions than those of the plan.

        Turn and flip are the plan's, as is the primary's angle on ramps; the secondary always
        makes the best of where the primary is.

        Parameters
        ----------
        at_s : ndarray, shape (N,)
            Times; before and after the plan its ends hold.
        azimuth_rad, elevation_rad : ndarray, shape (N,)
            Predictions for them.

        Returns
        -------
        primary_rad, secondary_rad : ndarray, shape (N,)
            Axis angles, within the stops.
        """
        direction = direction_cosines(azimuth_rad, elevation_rad)
        planned = np.interp(at_s, self.times_s, self.primary_rad)
        step = self.times_s[1] - self.times_s[0]
        i = np.rint((np.asarray(at_s) - self.times_s[0]) / step).astype(np.int64)
        i = np.clip(i, 0, self.times_s.size - 1)
        plain, _ = self.mount.on_target(direction)
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
        Evenly spaced, as close as the commands (0.1 s, say), K ≥ 8.
    azimuth_rad, elevation_rad : ndarray, shape (K,)
        Where the satellite will be.
    mount : Mount
        Its axes and their limits.
    start_rad : float, optional
        Where the primary axis stands before the pass; it decides between turns that serve the pass
        equally. The axis is taken to be where the plan begins in time.

    Returns
    -------
    PassPlan
        Its `error_rad` says what the limits will cost.

    Raises
    ------
    InputError
        If the times are fewer than eight or not evenly spaced, or the shapes differ.
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
    if plan.flipped.any():
        # the route's loss is nearly, not quite, the largest error: see what going upright costs
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
    """Return the primary's course, on target but for ramps, and where those are."""
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
        part, found = _extend_ramp(times, reference, distance, kept, first, last)
        if spans and spans[0][0] < part.stop:  # too close to the next, or to the one before
            spans[0] = (first, spans[0][1])
        elif ramps and part.start < ramps[-1][1].stop:
            spans.insert(0, (ramps.pop()[0], last))
        else:
            ramps.append((first, part, found.primary_rad))
    course, ramp = within, np.zeros(times.size, dtype=bool)
    for _, part, angles in ramps:
        course[part], ramp[part] = angles, True
    return course, ramp


def _extend_ramp(
    times: Array, reference: Array, distance: Array, limits: AxisLimits, first: int, last: int
) -> tuple[slice, Ramp]:
    """Return the ramp over an excess, begun earlier and ended later as long as that helps."""
    step = float(times[1] - times[0])
    run = limits.rate_rad_s / limits.acceleration_rad_s2
    swing = float(np.ptp(reference[first : last + 1]))
    margin = max(ceil((run + 0.5 * swing / limits.rate_rad_s) / step), 4)
    best: tuple[slice, Ramp] | None = None
    while True:
        part = slice(max(first - margin, 0), min(last + margin + 1, times.size))
        whole = part.start == 0 and part.stop == times.size
        found = best_ramp(
            times[part],
            reference[part],
            distance[part],
            limits,
            (part.start > 0, part.stop < times.size),
        )
        if found is not None:
            if best is not None and found.error_rad > _WORTH * best[1].error_rad:
                return best
            best = part, found
        if whole:
            break
        margin *= 2
    if best is None:
        raise ConvergenceError(
            f"no course of the primary axis was found around {times[first]:g} s; plan with a"
            " shorter period, so that rate and acceleration can be told apart"
        )
    return best


def _fast_stretches(course: Array, times: Array, limits: AxisLimits) -> list[tuple[int, int]]:
    """Return first and last index of each stretch that is too fast for the axis."""
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
    gap = 2 * limits.rate_rad_s / limits.acceleration_rad_s2 / step
    cuts = np.flatnonzero(np.diff(indices) > gap)
    firsts = np.concatenate([indices[:1], indices[cuts + 1]])
    lasts = np.concatenate([indices[cuts], indices[-1:]])
    return [(int(a), int(b)) for a, b in zip(firsts, lasts, strict=True)]
