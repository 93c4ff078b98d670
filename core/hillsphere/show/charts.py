"""Figures as data: axes and panels with their marks, which the renderers draw.

A stage declares what a figure shows, with the marks of `hillsphere.show.marks` and
`hillsphere.show.solids`; `hillsphere.show.matplotlib_renderer` draws it to SVG and PNG,
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
from typing import Literal

import numpy as np

from hillsphere.base.arrays import Integers
from hillsphere.show.colours import ColourScale
from hillsphere.show.marks import Band, Curve, Mark, Points
from hillsphere.show.solids import Solid

__all__ = ["Axis", "Chart", "Panel", "Sky", "Space", "even_indices", "scales_of"]


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
