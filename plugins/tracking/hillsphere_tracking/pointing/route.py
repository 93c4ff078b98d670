"""Route of the primary axis over a whole pass: turn, flip and rewind, by dynamic programming [1]_.

A direction has several primary angles: full turns apart, and half a turn apart if the mount is
flipped. Dynamic programming over a grid of primary angles finds the route of least loss within the
stops and the rate limit. It starts on the turn that lasts for the whole pass if there is one, else
it rewinds where that costs least. At a keyhole it passes on either side or flips.

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
"""Error (rad) at which the loss saturates: the satellite is outside any beam, however far it is."""
_MOST_STEPS = 4000
"""Steps of the dynamic programme at most: with the thousand angles of a mount with overlap its
table of losses takes 35 MB."""
_CELLS_PER_STEP = 4.0
"""Cells that the axis can cross in a step, at least: with fewer, rounding down to whole cells would
slow it down by more than a fifth."""
_SLACK = 2.0 * _CELL
"""Error (rad) beyond the stops of a flipped angle that is no reason to leave it. The route weighs
such errors, but not below its own resolution of about a degree. At the horizon a mount from 0° to
180° has no angles left in flipped operation, and half a turn would cost minutes of the pass."""
_PREFERENCE = 1e-7
"""Weight (per radian, or per second) of the preferences that decide between routes of equal loss.
All turns share the error of the grid, so that a small weight decides; it never outweighs an error
of 0.3°."""


def coarse_route(
    times_s: Array, direction: Array, mount: Mount, start_rad: float | None = None
) -> Array:
    """Return the route of the primary axis with the least loss, to about a degree.

    The loss is the time integral of min(ε/10°, 1)⁴, where ε is the error with the best secondary
    angle. It measures the time off target, and near a keyhole approximately the largest error.
    Among routes of equal loss, the one that begins near `start_rad` (by default far from the stops)
    and that does not flip is preferred.

    Parameters
    ----------
    times_s : ndarray, shape (K,)
        Times in increasing order.
    direction : ndarray, shape (3, K)
        Unit vectors east, north, up of the target.
    mount : Mount
        The mount; its accelerations are neglected.
    start_rad : float, optional
        Primary angle before the pass.

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
    # preference among routes of equal loss: distance from the start, or from the middle
    towards = np.array([np.cos(grid), np.sin(grid)])
    centre = 0.5 * (limits.lower_rad + limits.upper_rad)
    away = np.abs(grid - (centre if start_rad is None else start_rad))
    value = np.empty((nodes.size, grid.size))
    duration = np.gradient(times_s[nodes]) if nodes.size > 1 else np.ones(1)
    value[0] = (
        _loss(mount, direction[:, nodes[0]], grid, towards) * duration[0] + _PREFERENCE * away
    )
    # Bellman's recursion: the least loss to reach each cell from the cells within the axis's rate.
    for k in range(1, nodes.size):
        reach = _reachable_cells(limits.rate_rad_s, times_s[nodes[k]] - times_s[nodes[k - 1]])
        best = minimum_filter1d(value[k - 1], 2 * reach + 1, mode="nearest")
        value[k] = best + _loss(mount, direction[:, nodes[k]], grid, towards) * duration[k]
    if start_rad is None:  # the end of the pass matters as much as its beginning
        value[-1] += _PREFERENCE * away
    # backwards along the best predecessors
    course = np.empty(nodes.size)
    here = int(np.argmin(value[-1]))
    course[-1] = grid[here]
    for k in range(nodes.size - 2, -1, -1):
        reach = _reachable_cells(limits.rate_rad_s, times_s[nodes[k + 1]] - times_s[nodes[k]])
        low = max(here - reach, 0)
        window = value[k, low : here + reach + 1]
        # The shortest motion among equal losses, which occur where the loss is saturated.
        motion = np.abs(np.arange(window.size) + (low - here))
        here = low + int(np.lexsort((motion, window))[0])
        course[k] = grid[here]
    return np.interp(times_s, times_s[nodes], course)


def on_target_angles(
    direction: Array, mount: Mount, near_rad: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the primary angles on target that are nearest to given angles.

    Parameters
    ----------
    direction : ndarray, shape (3, K)
        Unit vectors east, north, up.
    mount : Mount
        The mount; a flip is used only within the range of its secondary axis.
    near_rad : ndarray, shape (K,)
        Primary angles.

    Returns
    -------
    primary_rad : ndarray, shape (K,)
        Nearest angles on target, without regard to the stops.
    flipped : ndarray of bool, shape (K,)
        Where the nearest angle is a flipped one.
    """
    plain, secondary = mount.on_target(direction)
    upright = plain + 2.0 * pi * np.rint((near_rad - plain) / (2.0 * pi))
    over = plain + pi + 2.0 * pi * np.rint((near_rad - plain - pi) / (2.0 * pi))
    # beyond the stops both sides may miss the target: below the horizon by the same angle
    beyond = pi - secondary - mount.secondary.upper_rad
    below = np.maximum(mount.secondary.lower_rad - secondary, 0.0)
    reachable = mount.plunges & (beyond <= below + _SLACK)
    flipped = reachable & (np.abs(over - near_rad) < np.abs(upright - near_rad))
    return np.where(flipped, over, upright), flipped


def _loss(mount: Mount, direction: Array, grid: Array, towards: Array) -> Array:
    """Return the loss per second at every angle of the grid; `towards` is their (cos, sin)."""
    place = mount.axes @ direction
    secondary = mount.secondary_for(direction[:, None], grid)
    # cos ε; the arc cosine is inaccurate below 1e-8 rad, where the loss is negligible
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
