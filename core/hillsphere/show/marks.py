"""Marks of a flat panel, and the words that they share with those in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from numpy.typing import ArrayLike

from hillsphere.show.colours import ColourScale

__all__ = [
    "Area", "Band", "Bars", "Boxes", "Curve", "Dash", "Direction", "Map", "Mark", "MarkerShape",
    "Note", "Points", "Rows", "Rule", "Segments", "Side", "Span",
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
