"""Drawing of the marks of a panel in three dimensions with matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hillsphere.show.colours import ColourScale
from hillsphere.show.matplotlib_renderer.styles import (
    DASHES,
    MARKERS,
    Colours,
    legend_label,
    named_colour,
)
from hillsphere.show.solids import Arrows, Cloud, Mesh, Path, Surface

__all__ = ["DRAW_SOLID"]


def _path(axes: Any, solid: Path, colours: Colours) -> None:
    axes.plot(*np.asarray(solid.points, dtype=float), color=named_colour(solid.colour, colours),
              linestyle=DASHES[solid.dash], linewidth=solid.width, alpha=solid.opacity,
              label=legend_label(solid.label))  # fmt: skip


def _cloud(axes: Any, solid: Cloud, colours: Colours) -> None:
    points = np.asarray(solid.points, dtype=float)
    if solid.values is not None and solid.scale is not None:
        shades: Any = [solid.scale.colour(v) for v in np.asarray(solid.values, float).tolist()]
    else:
        shades = named_colour(solid.colour, colours)
    axes.scatter(*points, s=solid.size**2, c=shades, marker=MARKERS[solid.marker],
                 alpha=solid.opacity, label=legend_label(solid.label))  # fmt: skip


def _surface(axes: Any, solid: Surface, colours: Colours) -> None:
    points = np.asarray(solid.points, dtype=float)
    options: dict[str, Any] = {"color": named_colour(solid.colour, colours)}
    if solid.values is not None and solid.scale is not None:
        values = np.asarray(solid.values, dtype=float)
        options = {"facecolors": _shades(values, solid.scale), "shade": False}
    axes.plot_surface(*points, alpha=solid.opacity, linewidth=0, antialiased=True,
                      rcount=points.shape[1], ccount=points.shape[2], **options)  # fmt: skip


def _shades(values: Any, scale: ColourScale) -> Any:
    flat = [scale.colour(value) for value in values.ravel().tolist()]
    return np.array(flat, dtype=object).reshape(values.shape)


def _mesh(axes: Any, solid: Mesh, colours: Colours) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    vertices, facets = np.asarray(solid.vertices, dtype=float), np.asarray(solid.facets)
    corners = vertices.T[facets]
    if solid.values is not None and solid.scale is not None:
        shades: Any = [solid.scale.colour(v) for v in np.asarray(solid.values, float).tolist()]
    else:
        shades = named_colour(solid.colour, colours)
    axes.add_collection3d(
        Poly3DCollection(corners, facecolors=shades, alpha=solid.opacity, linewidths=0, shade=True)
    )
    axes.auto_scale_xyz(*vertices)


def _arrows(axes: Any, solid: Arrows, colours: Colours) -> None:
    start, vector = (np.asarray(v, dtype=float) for v in (solid.start, solid.vector))
    axes.quiver(*start, *vector, color=named_colour(solid.colour, colours), linewidth=solid.width,
                arrow_length_ratio=0.15, label=legend_label(solid.label))  # fmt: skip


DRAW_SOLID: dict[type, Callable[..., None]] = {
    Path: _path, Cloud: _cloud, Surface: _surface, Mesh: _mesh, Arrows: _arrows,
}  # fmt: skip
