"""Figures of step responses stay readable with many measurements."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from hillsphere.interfaces import Array
from hillsphere_controllers.stages.synthesis.step_panels import (
    draw_each_response,
    draw_each_step,
    step_figure_size,
)

TIMES = np.linspace(0.0, 5.0, 30)


def responses(count: int, cross: Array) -> Array:
    """Return first-order responses that go to one, and what they do to the others."""
    rising = 1.0 - np.exp(-TIMES)
    return rising[:, None, None] * (np.eye(count) + cross)


def names(count: int) -> list[str]:
    return [f"y[{i}]" for i in range(count)]


def test_few_measurements_have_a_panel_for_each_response() -> None:
    figure = Figure(figsize=step_figure_size(3))
    cross = np.zeros((3, 3))
    cross[2, 0] = 0.4
    draw_each_response(figure, TIMES, [(responses(3, cross), "k", "")], names(3))
    assert len(figure.axes) == 9
    assert [axes.get_title() for axes in figure.axes[:3]] == [f"step of y[{j}]" for j in range(3)]
    drawn = np.asarray(figure.axes[6].lines[0].get_ydata(), dtype=float)
    np.testing.assert_allclose(drawn, 0.4 * (1.0 - np.exp(-TIMES)))
    assert figure.axes[0].get_legend() is None


def test_many_measurements_have_a_panel_for_each_step() -> None:
    """Nine: nine panels, each with one coloured line and eight grey ones for each model."""
    cross = np.zeros((9, 9))
    cross[7, 2] = -0.5
    figure = Figure(figsize=step_figure_size(9))
    lines = [(responses(9, cross), "#0072B2", "one"), (responses(9, 0.0 * cross), "#D55E00", "two")]
    draw_each_step(figure, TIMES, lines, names(9))
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == 9
    assert {len(axes.lines) for axes in shown} == {2 * 8 + 2 + 1}
    assert shown[2].get_title() == "step of y[2]\nlargest other: y[7], 0.5"
    legend = shown[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["one", "two"]


def test_of_very_many_the_largest_are_shown() -> None:
    cross = np.zeros((20, 20))
    cross[3, 19] = 2.0
    figure = Figure(figsize=step_figure_size(20))
    draw_each_step(figure, TIMES, [(responses(20, cross), "#0072B2", "")], names(20))
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert len(shown) == 15
    assert shown[-1].get_title() == "step of y[19]\nlargest other: y[3], 2"
    assert figure.get_suptitle() == "15 of 20 steps, those with the largest responses"
    assert step_figure_size(20) == step_figure_size(15)
