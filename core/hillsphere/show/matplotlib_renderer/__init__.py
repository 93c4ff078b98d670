"""Drawing of charts with matplotlib, for SVG and PNG."""

from hillsphere.show.matplotlib_renderer.figure import draw_chart

__all__ = ["draw_chart"]
