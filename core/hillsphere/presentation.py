"""Presentation of a stage's result: metrics, tables and figures, which are drawn later.

The public names of `hillsphere.show.presentation`, `hillsphere.show.charts` with its marks and
solids, and `hillsphere.show.colours`.
"""

from hillsphere.show.charts import Axis, Chart, Panel, Sky, Space
from hillsphere.show.colours import LINE_COLOURS, PALETTE, ColourScale
from hillsphere.show.marks import (
    Area,
    Band,
    Bars,
    Boxes,
    Curve,
    Dash,
    Map,
    Mark,
    MarkerShape,
    Note,
    Points,
    Rule,
    Segments,
    Side,
    Span,
)
from hillsphere.show.presentation import (
    Cell,
    Column,
    Figure,
    Metric,
    Presentation,
    Printed,
    Table,
    check_presentation,
    presentation_faults,
)
from hillsphere.show.solids import Arrows, Cloud, Mesh, Path, Solid, Surface

__all__ = [
    "LINE_COLOURS", "PALETTE", "Area", "Arrows", "Axis", "Band", "Bars", "Boxes", "Cell", "Chart",
    "Cloud", "ColourScale", "Column", "Curve", "Dash", "Figure", "Map", "Mark", "MarkerShape",
    "Mesh", "Metric", "Note", "Panel", "Path", "Points", "Presentation", "Printed", "Rule",
    "Segments", "Side", "Sky", "Solid", "Space", "Span", "Surface", "Table", "check_presentation",
    "presentation_faults",
]  # fmt: skip
