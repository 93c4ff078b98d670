"""Charts as figures of plotly.js, for the page of a run.

The result is JSON: a list of traces and a layout. Arrays are packed in base64, which plotly.js
reads as typed arrays. Colours are those of a light page; the page's script changes ink and grid on
a dark one.
"""

from hillsphere.show.plotly_renderer.figure import plotly_figure

__all__ = ["plotly_figure"]
