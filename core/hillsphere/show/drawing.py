"""Drawing of figures to files, in one style, without a display, with reproducible bytes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from typing import TYPE_CHECKING, Any

from hillsphere.show.charts import Chart
from hillsphere.show.presentation import PALETTE, AnyFigure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure
    from matplotlib.transforms import BboxBase

__all__ = ["MAX_SVG_BYTES", "STYLE", "Drawing", "draw", "laid_out"]

MAX_SVG_BYTES = 1 << 20
"""Largest SVG in a report. A larger one, of tens of thousands of points, is shown as PNG, which
keeps the page small."""

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
"""Empty margin around a figure."""


@dataclass(frozen=True)
class Drawing:
    """A figure as SVG, and as PNG if requested or needed by the report."""

    svg: bytes
    png: bytes | None = None

    @property
    def is_large(self) -> bool:
        """Whether the SVG exceeds `MAX_SVG_BYTES`, so that the report shows the PNG."""
        return len(self.svg) > MAX_SVG_BYTES

    def __repr__(self) -> str:
        """Return the size alone: the bytes fill pages."""
        return f"<Drawing: SVG of {len(self.svg)} bytes>"

    def _repr_svg_(self) -> str:
        """Return the SVG, which notebooks show."""
        return self.svg.decode()


def draw(figure: AnyFigure, *, png: bool = False) -> Drawing:
    """Draw a figure.

    Parameters
    ----------
    figure : Figure or Chart
        Figure of a stage.
    png : bool
        Draw it as PNG too. This is always done if the SVG is larger than `MAX_SVG_BYTES`.

    Returns
    -------
    Drawing
        Neither file contains a date, a host or a random identifier. Errors of the figure's own
        ``draw`` are passed on.

    Notes
    -----
    matplotlib's object interface only: pyplot would keep every figure alive and may look for a
    display.
    """
    with laid_out(figure) as (made, whole):
        drawing = Drawing(_save_svg(made, whole))
        if png or drawing.is_large:
            drawing = replace(drawing, png=_save_png(made, whole))
    return drawing


def _save_svg(made: MatplotlibFigure, whole: BboxBase) -> bytes:
    stream = BytesIO()
    metadata: Any = {"Date": None, "Creator": None}
    made.savefig(stream, format="svg", metadata=metadata, bbox_inches=whole)
    return stream.getvalue()


def _save_png(made: MatplotlibFigure, whole: BboxBase) -> bytes:
    stream = BytesIO()
    made.savefig(stream, format="png", metadata={"Software": None}, bbox_inches=whole)
    return stream.getvalue()


@contextmanager
def laid_out(figure: AnyFigure) -> Iterator[tuple[MatplotlibFigure, BboxBase]]:
    """Yield the laid-out figure and its box in inches, within the context of our style."""
    import matplotlib as mpl
    from cycler import cycler
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as MatplotlibFigure

    from hillsphere.show.matplotlib_renderer import draw_chart

    # Defaults first: a user's own matplotlibrc must not change what a mission shows.
    settings: Any = dict(mpl.rcParamsDefault) | STYLE
    # Setting these would start or drop a display backend.
    settings = {k: v for k, v in settings.items() if k not in ("backend", "backend_fallback")}
    settings["axes.prop_cycle"] = cycler(color=list(PALETTE.values())[:-1])
    with mpl.rc_context(settings):
        size = figure.size if isinstance(figure, Chart) else figure.size_in
        canvas = FigureCanvasAgg(MatplotlibFigure(figsize=size, layout="constrained"))
        made = canvas.figure
        if isinstance(figure, Chart):
            draw_chart(made, figure)
        else:
            figure.draw(made)
        # Laid out and measured once, at the resolution of a PNG, whatever is drawn of it: both
        # formats show the same layout, and that takes as long as drawing them.
        made.set_dpi(settings["savefig.dpi"])
        for _ in range(2):  # axes of fixed proportions find their places at the second time
            made.draw_without_rendering()
        made.set_layout_engine("none")
        # Whatever a figure puts outside its axes is in the picture: no label is ever cut off.
        yield made, made.get_tightbbox().padded(_MARGIN_IN)
