"""Figures as objects of a plotting library, for notebooks and scripts."""

from __future__ import annotations

from typing import Any, Literal

from hillsphere.base.errors import InputError
from hillsphere.show.charts import Chart
from hillsphere.show.drawing import laid_out
from hillsphere.show.presentation import AnyFigure

__all__ = ["plot"]


def plot(figure: AnyFigure, renderer: Literal["plotly", "matplotlib"] = "plotly") -> Any:
    """Return a figure as an object that a notebook shows.

    Parameters
    ----------
    figure : Figure or Chart
        Figure of a stage.
    renderer : {"plotly", "matplotlib"}
        Library. A figure that a stage draws itself (`Figure`) is one of matplotlib only.

    Returns
    -------
    plotly.graph_objects.Figure or matplotlib.figure.Figure
        The drawn figure.

    Raises
    ------
    InputError
        If there is no such renderer, or it cannot draw the figure.
    """
    if renderer == "matplotlib":
        with laid_out(figure) as (made, _):
            return made
    if renderer != "plotly":
        raise InputError(f"renderer must be 'plotly' or 'matplotlib', got {renderer!r}")
    if not isinstance(figure, Chart):
        raise InputError(
            f"the stage draws {figure.title!r} itself: plot it with renderer='matplotlib'"
        )
    from plotly.graph_objects import Figure

    from hillsphere.show.plotly_renderer import plotly_figure

    drawn = plotly_figure(figure)
    return Figure(drawn["data"], {**drawn["layout"], "height": drawn["height"]})
