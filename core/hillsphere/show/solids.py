"""Marks of a panel in three dimensions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

from numpy.typing import ArrayLike

from hillsphere.show.colours import ColourScale
from hillsphere.show.marks import Dash, MarkerShape, Rows

__all__ = ["Arrows", "Cloud", "Mesh", "Path", "Solid", "Surface"]


@dataclass(frozen=True)
class Path:
    """A line in space.

    Parameters
    ----------
    points : array_like, shape (3, K)
        Points.
    label, colour, dash, width, opacity, rows
        As for `Curve`.
    times : array_like, shape (K,), optional
        Times of the points on the axis `Space.time`; a slider then shows a marker there.
    """

    points: ArrayLike
    label: str = ""
    colour: str = ""
    dash: Dash = "solid"
    width: float = 1.2
    opacity: float = 1.0
    times: ArrayLike | None = None
    rows: Rows = None


@dataclass(frozen=True)
class Cloud:
    """Points in space, such as sites or a dispersion.

    Parameters
    ----------
    points : array_like, shape (3, K)
        Points.
    label, colour, marker, size, opacity, values, scale, names, rows
        As for `Points`.
    """

    points: ArrayLike
    label: str = ""
    colour: str = ""
    marker: MarkerShape = "circle"
    size: float = 4.0
    opacity: float = 1.0
    values: ArrayLike | None = None
    scale: ColourScale | None = None
    names: Sequence[str] = ()
    rows: Rows = None


@dataclass(frozen=True)
class Surface:
    """A surface over a grid, such as an ellipsoid or a harmonic shape.

    Parameters
    ----------
    points : array_like, shape (3, a, b)
        Points of the grid.
    label, colour, opacity
        As for `Curve`.
    values : array_like, shape (a, b), optional
        Values that colour it by `scale`, such as slopes.
    scale : ColourScale, optional
        Their scale.
    """

    points: ArrayLike
    label: str = ""
    colour: str = "body"
    opacity: float = 1.0
    values: ArrayLike | None = None
    scale: ColourScale | None = None


@dataclass(frozen=True)
class Mesh:
    """A surface of triangles.

    Parameters
    ----------
    vertices : array_like, shape (3, V)
        Vertices.
    facets : array_like of int, shape (F, 3)
        Indices of the vertices of each facet.
    label, colour, opacity
        As for `Curve`.
    values : array_like, shape (F,), optional
        Values that colour the facets by `scale`.
    scale : ColourScale, optional
        Their scale.
    """

    vertices: ArrayLike
    facets: ArrayLike
    label: str = ""
    colour: str = "body"
    opacity: float = 1.0
    values: ArrayLike | None = None
    scale: ColourScale | None = None


@dataclass(frozen=True)
class Arrows:
    """Vectors in space.

    Parameters
    ----------
    start, vector : array_like, shape (3, K)
        Beginnings and vectors, in the unit of the axes.
    label, colour, width
        As for `Curve`.
    """

    start: ArrayLike
    vector: ArrayLike
    label: str = ""
    colour: str = ""
    width: float = 1.2


Solid: TypeAlias = Path | Cloud | Surface | Mesh | Arrows
"""What a panel in three dimensions shows."""
