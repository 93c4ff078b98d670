"""Figures drawn to files: one style, no display, the same bytes every time."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from typing import Any

from hillsphere.show.presentation import PALETTE, Figure

__all__ = ["STYLE", "Drawing", "draw"]

STYLE: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": "#444444",
    "axes.grid": True,
    "axes.labelsize": 10,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 11,
    "figure.dpi": 100,
    "figure.facecolor": "white",
    "font.family": ["DejaVu Sans"],
    "font.size": 10,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "legend.framealpha": 0.9,
    "lines.linewidth": 1.6,
    "lines.markersize": 5,
    "savefig.dpi": 160,
    # Glyphs as paths: the figure looks the same where the font is missing.
    "svg.fonttype": "path",
    "svg.hashsalt": "hillsphere",
}
"""matplotlib settings of every figure; the colours are those of `presentation.PALETTE`."""


_MARGIN_IN = 0.08
"""Empty margin of a picture."""


@dataclass(frozen=True)
class Drawing:
    """A figure in both file formats."""

    svg: bytes
    png: bytes


def draw(figure: Figure) -> Drawing:
    """Draw a figure.

    Parameters
    ----------
    figure : Figure
        What a stage shows.

    Returns
    -------
    Drawing
        Neither file holds a date, a host or a random identifier. What the figure's own ``draw``
        raises goes through.

    Notes
    -----
    matplotlib's object interface only: pyplot would keep every figure alive and may look for a
    display.
    """
    import matplotlib as mpl
    from cycler import cycler
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as MatplotlibFigure

    # Defaults first: a user's own matplotlibrc must not change what a mission shows.
    settings: Any = dict(mpl.rcParamsDefault) | STYLE
    # Setting these would start or drop a display backend.
    settings = {k: v for k, v in settings.items() if k not in ("backend", "backend_fallback")}
    settings["axes.prop_cycle"] = cycler(color=list(PALETTE.values())[:-1])
    with mpl.rc_context(settings):
        canvas = FigureCanvasAgg(MatplotlibFigure(figsize=figure.size_in, layout="constrained"))
        made = canvas.figure
        figure.draw(made)
        # Laid out and measured once for both files: that takes as long as drawing them.
        made.set_dpi(settings["savefig.dpi"])
        for _ in range(2):  # axes of fixed proportions find their places at the second time
            made.draw_without_rendering()
        made.set_layout_engine("none")
        # Whatever a figure puts outside its axes is in the picture: no label is ever cut off.
        whole = made.get_tightbbox().padded(_MARGIN_IN)
        svg, png = BytesIO(), BytesIO()
        metadata: Any = {"Date": None, "Creator": None}
        made.savefig(svg, format="svg", metadata=metadata, bbox_inches=whole)
        made.savefig(png, format="png", metadata={"Software": None}, bbox_inches=whole)
    return Drawing(svg.getvalue(), png.getvalue())
