"""Which way round: the turn, flip and rewind of the primary axis over a whole pass.

A direction belongs to many angles of the primary axis: whole turns, and half-turns flipped over the
top. Within the stops, with a primary axis of limited rate, dynamic programming over a grid of its
angles finds the course that loses least: it starts on the turn that lasts for the whole pass if
there is one, rewinds where that costs least if there is none, and at a keyhole swings either way
round or goes over the top.

References
----------
.. [1] R. Bellman (1957), Dynamic Programming, Princeton University Press.
"""

from __future__ import annotations

from math import ceil, floor, pi, radians

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from hillsphere.interfaces import Array, Integers
from hillsphere_tracking.pointing.mounts import Mount

__all__ = ["coarse_route", "on_target_angles"]

_CELL = radians(0.5)
"""Distance of two angles of the grid: the route needs only the right turn and side, and angles on
target replace it afterwards. Time and memory grow as its inverse."""
_SATURATION = radians(10.0)
"""Error beyond which nothing more is lost: the satellite is gone from any beam."""
_MOST_STEPS = 4000
"""Steps of the dynamic programme at most: with the thousand angles of a mount with overlap its
table of losses takes 35 MB."""
_CELLS_PER_STEP = 4.0
"""How far the axis goes in a step, at least, so that the grid does not slow it down much."""
_PREFERENCE = 1e-7
"""Weight, per radian or per second, of what decides between courses that lose the same: all turns
share the grid's own error, so that much suffices; it is never worth an error of 0.3°."""


def coarse_route(
    times_s: Array, direction: Array, mount: Mount, start_rad: float | None = None
) -> Array:
    """Return a course of the primary axis that loses least, to about a degree.

    The loss is the integral of min(ε/10°, 1)⁴ over the error ε with the best secondary angle: time
    off target, and near a keyhole nearly the largest error. Among equals the course that begins
    near `start_rad` (else far from the stops) and does without a flip is taken.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Rising.
    direction : ndarray, shape (3, K)
        Unit vectors east, north, up to follow.
    mount : Mount
        With stops and the primary's rate; acceleration is left out.
    start_rad : float, optional
        Where the primary axis stands before the pass.

    Returns
    -------
    ndarray, shape (K,)
        Angles of the primary axis, within the stops, rad.
    """
    limits = mount.primary
    cells = floor((limits.upper_rad - limits.lower_rad) / _CELL)
    grid: Array = limits.lower_rad + _CELL * np.arange(cells + 1, dtype=float)
    step = max(
        _CELLS_PER_STEP * _CELL / limits.rate_rad_s, (times_s[-1] - times_s[0]) / _MOST_STEPS
    )
    nodes = _select_nodes(times_s, step)
    towards = np.array([np.cos(grid), np.sin(grid)])
    centre = 0.5 * (limits.lower_rad + limits.upper_rad)
    away = np.abs(grid - (centre if start_rad is None else start_rad))
    value = np.empty((nodes.size, grid.size))
    duration = np.gradient(times_s[nodes]) if nodes.size > 1 else np.ones(1)
    value[0] = (
        _loss(mount, direction[:, nodes[0]], grid, towards) * duration[0] + _PREFERENCE * away
    )
    for k in range(1, nodes.size):
        reach = _reachable_cells(limits.rate_rad_s, times_s[nodes[k]] - times_s[nodes[k - 1]])
        best = minimum_filter1d(value[k - 1], 2 * reach + 1, mode="nearest")
        value[k] = best + _loss(mount, direction[:, nodes[k]], grid, towards) * duration[k]
    if start_rad is None:  # the end of the pass matters as much as its beginning
        value[-1] += _PREFERENCE * away
    course = np.empty(nodes.size)
    here = int(np.argmin(value[-1]))
    course[-1] = grid[here]
    for k in range(nodes.size - 2, -1, -1):
        reach = _reachable_cells(limits.rate_rad_s, times_s[nodes[k + 1]] - times_s[nodes[k]])
        low = max(here - reach, 0)
        window = value[k, low : here + reach + 1]
        # the shortest motion among equals: ties come from the plateau of the lost
        motion = np.abs(np.arange(window.size) + (low - here))
        here = low + int(np.lexsort((motion, window))[0])
        course[k] = grid[here]
    return np.interp(times_s, times_s[nodes], course)


def on_target_angles(
    direction: Array, mount: Mount, near_rad: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the primary angles on target that are nearest to given ones.

    Parameters
    ----------
    direction : ndarray, shape (3, K)
        Unit vectors east, north, up.
    mount : Mount
        Flips are taken only as far as its secondary axis goes over the top.
    near_rad : ndarray, shape (K,)
        Primary angles to be near to.

    Returns
    -------
    primary_rad : ndarray, shape (K,)
        Nearest angles on target; beyond a stop if only there.
    flipped : ndarray of bool, shape (K,)
        Where the secondary is over the top.
    """
    plain, secondary = mount.on_target(direction)
    upright = plain + 2.0 * pi * np.rint((near_rad - plain) / (2.0 * pi))
    over = plain + pi + 2.0 * pi * np.rint((near_rad - plain - pi) / (2.0 * pi))
    reachable = mount.plunges & (pi - secondary <= mount.secondary.upper_rad)
    flipped = reachable & (np.abs(over - near_rad) < np.abs(upright - near_rad))
    return np.where(flipped, over, upright), flipped


def _loss(mount: Mount, direction: Array, grid: Array, towards: Array) -> Array:
    """Return the loss per second at every angle of the grid; `towards` is their (cos, sin)."""
    place = mount.axes @ direction
    secondary = mount.secondary_for(direction[:, None], grid)
    # along the beam; the arc cosine blurs errors below 1e-8 rad, whose loss is nothing
    cosine = (place[:2] @ towards) * np.cos(secondary) + place[2] * np.sin(secondary)
    share = np.minimum(np.arccos(np.minimum(cosine, 1.0)) / _SATURATION, 1.0) ** 2
    return np.asarray(share * share + _PREFERENCE * (secondary > 0.5 * pi))


def _reachable_cells(rate: float, duration: float) -> int:
    return max(floor(rate * duration / _CELL + 1e-9), 1)


def _select_nodes(times: Array, step: float) -> Integers:
    """Return indices of times about one step apart, the first and the last among them."""
    count = max(ceil((times[-1] - times[0]) / step), 1) if times.size > 1 else 0
    wanted = np.linspace(times[0], times[-1], count + 1)
    return np.unique(np.clip(np.searchsorted(times, wanted - 1e-9), 0, times.size - 1))
