"""Axes of scenes in three dimensions, with room for their ticks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from hillsphere.show.charts import Axis, Space
from hillsphere.show.solids import Arrows, Mesh, Solid

__all__ = ["with_room"]

_SHORTEST = 0.5
"""Shortest side of a scene by its longest: the ticks of a shorter one overlap, since renderers
divide every axis of a scene into about five steps."""
_MARGIN = 0.04
"""Part of the longest side that is left free at both ends of each axis."""


def with_room(space: Space) -> Space:
    """Return a scene whose axes are long enough for their ticks; scales stay equal.

    Parameters
    ----------
    space : Space
        Scene. Axes with ends keep them.

    Returns
    -------
    Space
        The scene with ends at all axes, whose sides are at least half as long as the longest. The
        content stays in the middle. A scene without a finite point is returned as it is.
    """
    every = np.concatenate([np.zeros((3, 0)), *map(_points, space.solids)], axis=1)
    every = every[:, np.isfinite(every).all(axis=0)]
    if not every.size or not np.ptp(every, axis=1).any():
        return space
    low, high = every.min(axis=1), every.max(axis=1)
    middle, longest = 0.5 * (low + high), float(np.max(high - low))
    half = 0.5 * np.maximum(high - low, _SHORTEST * longest) + _MARGIN * longest
    axes: dict[str, Axis] = {}
    for name, centre, reach in zip("xyz", middle.tolist(), half.tolist(), strict=True):
        axis: Axis = getattr(space, name)
        if axis.low is None and axis.high is None:
            axis = replace(axis, low=centre - reach, high=centre + reach)
        axes[name] = axis
    return replace(space, x=axes["x"], y=axes["y"], z=axes["z"])


def _points(solid: Solid) -> Any:
    """Return the points (3, K) of a solid."""
    if isinstance(solid, Arrows):
        start, vector = (np.asarray(v, dtype=float) for v in (solid.start, solid.vector))
        return np.concatenate([start, start + vector], axis=1)
    points = solid.vertices if isinstance(solid, Mesh) else solid.points
    return np.asarray(points, dtype=float).reshape(3, -1)
