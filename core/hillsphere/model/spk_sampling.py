"""A trajectory that can only be evaluated, as states through which polynomials pass.

Intervals are halved until the polynomials agree with the trajectory at three places of each, to a
tenth of a millimetre.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.base.time import J2000
from hillsphere.formats.oem_interpolation import OemInterpolant
from hillsphere.formats.oem_segments import OemSegment

__all__ = ["METHODS", "Sampled", "sample", "velocities_are_derivatives"]

METHODS = ("HERMITE", "LAGRANGE")
"""Hermite's polynomials need the fewest states, but also velocities that are the derivatives of the
positions, which not every kernel has; Lagrange's interpolate each by itself."""

DEGREE = 7
"""Degree of the polynomials, through four or eight states: that of most messages."""

_POSITION_M = 1e-4
"""Largest difference of positions, m, a tenth of what is promised of an exchange of states."""
_VELOCITY_M_S = 1e-5
"""Largest difference of velocities, m/s: that of a position by 0.1 mm in the minute or so between
two states."""
_ROUNDING = 16 * np.finfo(float).eps
"""Largest difference of a position relative to its size: far from the Sun rounding is coarser than
the limit above."""
_SHORTEST_S = 1e-3
"""An interval is not halved below this, s: a kernel whose states jump has none that is short
enough."""
_FIRST = 8
"""Intervals at the beginning."""
_PLACES = (0.5, 0.29, 0.71)
"""Places within an interval where the polynomials are compared; the first one becomes a state."""


_STEP_S = 0.5
"""Step of the differences of positions, s: a number that doubles of these times hold exactly."""


class Sampled(NamedTuple):
    """States of a trajectory: times (K,), states (6, K), method, and the largest difference, m."""

    t_s: Array
    x: Array
    method: str
    deviation_m: float


def sample(
    evaluate: Callable[[Array], Array], begin_s: float, end_s: float, method: str, most: int
) -> Sampled | None:
    """Return states through which polynomials of degree 7 follow a trajectory.

    Parameters
    ----------
    evaluate : callable
        States (6, K), m and m/s, at times (K,), s.
    begin_s, end_s : float
        Span.
    method : str
        One of `METHODS`.
    most : int
        Most states.

    Returns
    -------
    Sampled or None
        None if more states are needed. `Sampled.deviation_m` exceeds 0.1 mm (or the rounding of
        the positions) only where the trajectory jumps.
    """
    # The first states are unevenly spaced, so that none of a periodic motion are in step with it.
    even = np.linspace(0.0, 1.0, _FIRST + 1)
    t = np.unique(begin_s + (end_s - begin_s) * (even + 0.1 * even * (1.0 - even)))
    t[0], t[-1] = begin_s, end_s
    x = evaluate(t)
    is_open = np.ones(t.size - 1, dtype=bool)
    is_stuck = np.zeros(t.size - 1, dtype=bool)
    deviation, is_checked = 0.0, False
    while True:
        here = np.flatnonzero(is_open & ~is_stuck)
        if not here.size:
            if is_checked:
                return Sampled(t, x, method, deviation)
            # the windows of closed intervals have changed with those of their neighbours
            is_open[:], is_checked = True, True
            deviation = 0.0
            continue
        width = t[here + 1] - t[here]
        bad = np.zeros(here.size, dtype=bool)
        worst = np.zeros(here.size)
        middle = np.empty(0)
        x_middle = np.empty((6, 0))
        for place in _PLACES:
            test = np.flatnonzero(~bad)
            at = t[here[test]] + place * width[test]
            states = evaluate(at)
            is_off, apart = _differ(t, x, method, at, states, width[test])
            bad[test] = is_off
            worst[test] = np.maximum(worst[test], apart)
            if place == _PLACES[0]:
                middle, x_middle = at, states
        short = width <= max(_SHORTEST_S, 4.0 * float(np.spacing(np.abs(t).max())))
        is_open[here[~bad]] = False
        is_stuck[here[bad & short]] = True
        if (kept := ~bad | short).any():
            deviation = max(deviation, float(worst[kept].max()))
        split = bad & ~short
        if not split.any():
            continue
        is_checked = False
        if t.size + split.sum() > most:
            return None
        after = here[split] + 1
        t = np.insert(t, after, middle[split])
        x = np.insert(x, after, x_middle[:, split], axis=1)
        is_open = np.insert(is_open, after, True)
        is_stuck = np.insert(is_stuck, after, False)


def velocities_are_derivatives(
    evaluate: Callable[[Array], Array], begin_s: float, end_s: float
) -> bool:
    """Return whether velocities are those of the positions, by central differences of fourth order.

    A span of less than a few seconds is taken to be so.

    Parameters
    ----------
    evaluate, begin_s, end_s
        As for `sample`.
    """
    if end_s - begin_s < 10.0 * _STEP_S:
        return True
    places = begin_s + (end_s - begin_s) * np.array([0.0, 0.13, 0.5, 0.77, 1.0])
    places = np.clip(places, begin_s + 3.0 * _STEP_S, end_s - 3.0 * _STEP_S)
    places = np.round(places / _STEP_S) * _STEP_S
    before2, before, here, after, after2 = (evaluate(places + k * _STEP_S) for k in range(-2, 3))
    slope = (before2 - after2 + 8.0 * (after - before))[:3] / (12.0 * _STEP_S)
    off = np.linalg.norm(slope - here[3:], axis=0)
    rounding = 4.0 * _ROUNDING * np.linalg.norm(here[:3], axis=0) / _STEP_S
    return bool(np.all(off <= _VELOCITY_M_S + rounding))


def _differ(
    t: Array, x: Array, method: str, at: Array, states: Array, width: Array
) -> tuple[Array, Array]:
    """Return where the polynomials differ too much, and the distances (K,), m."""
    needed = 4 if method == "HERMITE" else 8
    degree = DEGREE
    if t.size < needed:
        degree = 2 * t.size - 1 if method == "HERMITE" else t.size - 1
    segment = OemSegment("", "", "", "ICRF", J2000, t, x)
    off = OemInterpolant(segment, method, degree, False)(at) - states
    apart = np.linalg.norm(off[:3], axis=0)
    fast = np.linalg.norm(off[3:], axis=0)
    rounding = _ROUNDING * np.linalg.norm(states[:3], axis=0)
    is_off = (apart > np.maximum(_POSITION_M, rounding)) | (
        fast > np.maximum(_VELOCITY_M_S, 8.0 * rounding / width)
    )
    return is_off, apart
