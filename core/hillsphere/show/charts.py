"""Figures as data: axes, marks and panels, which the renderers draw.

A stage declares what a figure shows; `hillsphere.show.matplotlib_renderer` draws it to SVG and PNG,
`hillsphere.show.plotly_renderer` on the page of a run. Values are in the unit of their axis, NaN
is a gap, and nothing is copied or converted before a figure is drawn::

    Chart(
        "Period of the family",
        [Panel(
            Axis("amplitude", "km"), Axis("period", "h"),
            [Curve(x_km, period_h, "family"), Points(x0_km, member_h, "members", rows=range(5))],
        )],
        table="orbits",
    )
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hillsphere.base.arrays import Integers
from hillsphere.show.colours import ColourScale

__all__ = [
    "Area", "Arrows", "Axis", "Band", "Bars", "Boxes", "Chart", "Cloud", "Curve", "Dash",
    "Direction", "Map", "Mark", "MarkerShape", "Mesh", "Note", "Panel", "Path", "Points", "Rows",
    "Rule", "Segments", "Side", "Sky", "Solid", "Space", "Span", "Surface", "even_indices",
    "scales_of",
]  # fmt: skip

Direction: TypeAlias = Literal["x", "y"]
Dash: TypeAlias = Literal["solid", "dashed", "dotted", "dashdot"]
"""Kind of line."""
MarkerShape: TypeAlias = Literal[
    "dot",
    "circle",
    "square",
    "diamond",
    "triangle",
    "triangle-down",
    "cross",
    "plus",
    "star",
    "bar",
]
"""Shape of a marker."""
Side: TypeAlias = Literal["top right", "top left", "bottom right", "bottom left", "centre"]
"""Corner of a panel, or the side of a point on which its text stands."""
Rows: TypeAlias = int | Sequence[int] | None
"""Row of the figure's table that a mark stands for, or one row per point."""


@dataclass(frozen=True)
class Axis:
    """An axis of a panel.

    Parameters
    ----------
    label : str
        Quantity in words.
    unit : str
        Unit of the values, ``""`` for none.
    scale : str
        ``"linear"`` or ``"log"``.
    low, high : float, optional
        Ends of the axis; by default those of the values.
    ticks : sequence of (float, str), optional
        Places and texts of the ticks, such as names of categories.
    step : float, optional
        Distance of the ticks, such as 30 degrees.
    is_reversed : bool
        Let the values grow to the left, or downwards.
    """

    label: str = ""
    unit: str = ""
    scale: Literal["linear", "log"] = "linear"
    low: float | None = None
    high: float | None = None
    ticks: Sequence[tuple[float, str]] = ()
    step: float | None = None
    is_reversed: bool = False

    @property
    def text(self) -> str:
        """Label with its unit: ``"period (h)"``."""
        return f"{self.label} ({self.unit})" if self.unit not in ("", "-") else self.label


@dataclass(frozen=True)
class Curve:
    """A line through points; NaN interrupts it.

    Parameters
    ----------
    x, y : array_like, shape (K,)
        Points.
    label : str
        Entry of the legend; curves with the same label share one.
    colour : str
        Name in `hillsphere.show.colours` or ``"#rrggbb"``; by default the next of the palette.
    dash : str
        Kind of line.
    width : float
        Width in points.
    opacity : float
        From 0 to 1.
    steps : bool
        Hold each value to the next point.
    marker : str
        Shape of a marker at each point; ``""`` for none.
    rows : int or sequence of int, optional
        Rows of the figure's table.
    """

    x: ArrayLike
    y: ArrayLike
    label: str = ""
    colour: str = ""
    dash: Dash = "solid"
    width: float = 1.6
    opacity: float = 1.0
    steps: bool = False
    marker: MarkerShape | Literal[""] = ""
    rows: Rows = None


@dataclass(frozen=True)
class Points:
    """Separate points.

    Parameters
    ----------
    x, y : array_like, shape (K,)
        Points.
    label, colour, opacity, rows
        As for `Curve`.
    marker : str
        Shape.
    size : float
        Size in points.
    is_filled : bool
        Whether the marker is filled.
    values : array_like, shape (K,), optional
        Values that colour the points by `scale`.
    scale : ColourScale, optional
        Their scale.
    names : sequence of str
        One text per point, shown under the pointer.
    """

    x: ArrayLike
    y: ArrayLike
    label: str = ""
    colour: str = ""
    marker: MarkerShape = "circle"
    size: float = 5.0
    is_filled: bool = True
    opacity: float = 1.0
    values: ArrayLike | None = None
    scale: ColourScale | None = None
    names: Sequence[str] = ()
    rows: Rows = None


@dataclass(frozen=True)
class Band:
    """The area between two curves over x.

    Parameters
    ----------
    x, low, high : array_like, shape (K,)
        Places and both ends.
    label, colour, opacity, steps
        As for `Curve`.
    """

    x: ArrayLike
    low: ArrayLike
    high: ArrayLike
    label: str = ""
    colour: str = "sky"
    opacity: float = 0.35
    steps: bool = False


@dataclass(frozen=True)
class Area:
    """A filled polygon, such as the outline of a body.

    Parameters
    ----------
    x, y : array_like, shape (K,)
        Corners.
    label, colour, opacity
        As for `Curve`.
    """

    x: ArrayLike
    y: ArrayLike
    label: str = ""
    colour: str = "grey"
    opacity: float = 1.0


@dataclass(frozen=True)
class Rule:
    """A straight line across the panel at one value, such as a limit.

    Parameters
    ----------
    direction : str
        Axis that the value belongs to: ``"y"`` makes a horizontal line.
    value : float
        Place.
    label, colour, dash, width
        As for `Curve`.
    """

    direction: Direction
    value: float
    label: str = ""
    colour: str = "grey"
    dash: Dash = "dotted"
    width: float = 1.2


@dataclass(frozen=True)
class Span:
    """A stripe across the panel between two values.

    Parameters
    ----------
    direction : str
        Axis that the values belong to: ``"y"`` makes a horizontal stripe.
    low, high : float
        Ends.
    label, colour, opacity
        As for `Curve`.
    """

    direction: Direction
    low: float
    high: float
    label: str = ""
    colour: str = "light"
    opacity: float = 0.4


@dataclass(frozen=True)
class Bars:
    """Bars from a base to a value.

    Parameters
    ----------
    at : array_like, shape (K,)
        Centres across the bars.
    values : array_like, shape (K,)
        Ends of the bars.
    direction : str
        Axis that the values belong to: ``"x"`` makes horizontal bars.
    base : array_like, shape (K,) or ()
        Beginnings.
    width : array_like, shape (K,) or ()
        Widths across; histograms have that of their bins.
    label, colour, opacity, rows
        As for `Curve`.
    """

    at: ArrayLike
    values: ArrayLike
    direction: Direction = "y"
    base: ArrayLike = 0.0
    width: ArrayLike = 0.7
    label: str = ""
    colour: str = ""
    opacity: float = 1.0
    rows: Rows = None


@dataclass(frozen=True)
class Segments:
    """Straight segments parallel to an axis, such as confidence intervals.

    Parameters
    ----------
    at : array_like, shape (K,)
        Places across the segments.
    low, high : array_like, shape (K,)
        Ends.
    direction : str
        Axis that the ends belong to: ``"x"`` makes horizontal segments.
    label, colour, width, opacity, rows
        As for `Curve`.
    has_caps : bool
        Mark the ends by short strokes.
    """

    at: ArrayLike
    low: ArrayLike
    high: ArrayLike
    direction: Direction = "y"
    label: str = ""
    colour: str = "black"
    width: float = 1.4
    opacity: float = 1.0
    has_caps: bool = False
    rows: Rows = None


@dataclass(frozen=True)
class Boxes:
    """Boxes from quartile to quartile with the median and whiskers.

    Parameters
    ----------
    at : array_like, shape (K,)
        Centres.
    quantiles : array_like, shape (5, K)
        Lower whisker, quartile, median, quartile, upper whisker.
    direction : str
        Axis that the values belong to.
    width, label, colour, rows
        As for `Bars`.
    """

    at: ArrayLike
    quantiles: ArrayLike
    direction: Direction = "y"
    width: float = 0.6
    label: str = ""
    colour: str = ""
    rows: Rows = None


@dataclass(frozen=True)
class Map:
    """Values on a grid of cells, coloured.

    Parameters
    ----------
    x : array_like, shape (nx + 1,)
        Edges of the cells.
    y : array_like, shape (ny + 1,)
        Edges of the cells.
    values : array_like, shape (ny, nx)
        Values; NaN leaves a cell empty.
    scale : ColourScale
        Their colours.
    has_numbers : bool
        Write each value into its cell.
    """

    x: ArrayLike
    y: ArrayLike
    values: ArrayLike
    scale: ColourScale
    has_numbers: bool = False


@dataclass(frozen=True)
class Note:
    """A short text in a panel.

    Parameters
    ----------
    text : str
        The text.
    x, y : float, optional
        Point that it belongs to; by default it is written into a corner of the panel.
    corner : str
        The corner, or ``"centre"``; with a point the side of it on which the text stands, or
        ``"centre"`` for on it.
    colour : str
        As for `Curve`.
    """

    text: str
    x: float | None = None
    y: float | None = None
    corner: Side = "top right"
    colour: str = "ink"


Mark: TypeAlias = Curve | Points | Band | Area | Rule | Span | Bars | Segments | Boxes | Map | Note
"""What a panel shows."""


@dataclass(frozen=True)
class Panel:
    """One pair of axes with its marks.

    Parameters
    ----------
    x, y : Axis
        The axes.
    marks : sequence of Mark
        In the order of drawing.
    title : str
        Short heading.
    is_equal : bool
        Give both axes the same scale, for geometry.
    legend : str
        Place of the legend: ``"best"``, ``"right"`` or ``"above"`` of the panel, or ``"none"``.
    scale : ColourScale, optional
        Colour bar for marks that are coloured by `ColourScale.colour`.
    """

    x: Axis
    y: Axis
    marks: Sequence[Mark]
    title: str = ""
    is_equal: bool = False
    legend: Literal["best", "right", "above", "none"] = "best"
    scale: ColourScale | None = None


@dataclass(frozen=True)
class Sky:
    """The sky over a station: azimuth from north eastwards, zenith in the centre.

    Parameters
    ----------
    marks : sequence of Curve, Points or Band
        x is the azimuth, y the distance from the zenith, degrees.
    title, note : str
        Lines above and below.
    """

    marks: Sequence[Curve | Points | Band]
    title: str = ""
    note: str = ""


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


@dataclass(frozen=True)
class Space:
    """A panel in three dimensions, with equal scales.

    Parameters
    ----------
    solids : sequence of Solid
        Its content.
    x, y, z : Axis
        The axes.
    title : str
        Short heading.
    azimuth_deg, elevation_deg : float
        Direction from which it is seen at first.
    scale : ColourScale, optional
        As for `Panel`.
    time : Axis, optional
        Axis of the slider, if paths have `times`.
    """

    solids: Sequence[Solid]
    x: Axis = field(default_factory=lambda: Axis("x", "km"))
    y: Axis = field(default_factory=lambda: Axis("y", "km"))
    z: Axis = field(default_factory=lambda: Axis("z", "km"))
    title: str = ""
    azimuth_deg: float = -60.0
    elevation_deg: float = 25.0
    scale: ColourScale | None = None
    time: Axis | None = None


@dataclass(frozen=True)
class Chart:
    """A figure as data.

    Parameters
    ----------
    title : str
        Heading in the report.
    panels : sequence of Panel, Sky or Space
        The panels, row by row.
    caption : str
        Description of the figure's content.
    alt : str
        What is seen, for readers who do not see it; by default the caption.
    columns : int
        Panels side by side.
    share_x, share_y : bool
        Give the panels of a column, or of a row, the same axis.
    shared_legend : bool
        Show one legend below all panels; entries with the same label are one.
    heights, widths : sequence of float
        Relative heights of the rows and widths of the columns; by default equal.
    size_in : tuple of float, optional
        Width and height in inches; by default from the number of panels.
    table : str
        Table of the stage whose rows the marks refer to.
    """

    title: str
    panels: Sequence[Panel | Sky | Space]
    caption: str = ""
    alt: str = ""
    columns: int = 1
    share_x: bool = False
    share_y: bool = False
    shared_legend: bool = False
    heights: Sequence[float] = ()
    widths: Sequence[float] = ()
    size_in: tuple[float, float] | None = None
    table: str = ""

    @property
    def rows(self) -> int:
        """Number of rows of panels."""
        return -(-len(self.panels) // self.columns)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in inches."""
        if self.size_in is not None:
            return self.size_in
        if len(self.panels) == 1:
            return (7.0, 6.0 if isinstance(self.panels[0], Space) else 4.5)
        return (1.0 + 3.4 * self.columns if self.columns > 1 else 7.0, 0.8 + 2.7 * self.rows)


def scales_of(panel: Panel | Sky | Space) -> list[ColourScale]:
    """Return the colour scales of a panel, each once."""
    if isinstance(panel, Sky):
        marks: Sequence[object] = panel.marks
    else:
        marks = panel.marks if isinstance(panel, Panel) else panel.solids
    some = [getattr(panel, "scale", None), *(getattr(mark, "scale", None) for mark in marks)]
    return list(dict.fromkeys(scale for scale in some if scale is not None))


def even_indices(count: int, most: int = 2000) -> Integers:
    """Return at most so many evenly distributed indices of an array, both ends included.

    A panel is some hundred pixels wide, so that more points of a curve would not be seen.
    """
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))
