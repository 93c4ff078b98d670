"""Figures of step responses stay readable with many measurements."""

from __future__ import annotations

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import Chart, Curve, Panel
from hillsphere_controllers.stages.synthesis.step_panels import step_chart

TIMES = np.linspace(0.0, 5.0, 30)


def chart(*crosses: Array) -> Chart:
    """Return the chart of loops whose responses go to one, and of what they do to the others."""
    count = len(crosses[0])
    rising = 1.0 - np.exp(-TIMES)
    lines = [
        (rising[:, None, None] * (np.eye(count) + cross), "blue", label, row)
        for row, (cross, label) in enumerate(zip(crosses, ("one", "two"), strict=False))
    ]
    return step_chart(TIMES, lines, [f"y[{i}]" for i in range(count)], "loops")


def panels(made: Chart) -> list[Panel]:
    return [panel for panel in made.panels if isinstance(panel, Panel)]


def curves(panel: Panel) -> list[Curve]:
    return [mark for mark in panel.marks if isinstance(mark, Curve)]


def test_few_measurements_have_a_panel_for_each_response() -> None:
    cross = np.zeros((3, 3))
    cross[2, 0] = 0.4
    shown = panels(chart(cross))
    assert [panel.title for panel in shown[:3]] == [f"step of y[{j}]" for j in range(3)]
    assert len(shown) == 9
    (curve,) = curves(shown[6])
    np.testing.assert_allclose(np.asarray(curve.y), 0.4 * (1.0 - np.exp(-TIMES)))


def test_many_measurements_have_a_panel_for_each_step() -> None:
    """Nine: nine panels, each with a coloured and a grey curve for each model."""
    cross = np.zeros((9, 9))
    cross[7, 2] = -0.5
    made = chart(cross, 0.0 * cross)
    shown = panels(made)
    assert len(shown) == 9
    assert made.table == "loops"
    grey, _, one, two = curves(shown[2])
    assert shown[2].title == "step of y[2]\nlargest other: y[7], 0.5"
    assert (one.label, one.rows, two.label, two.rows) == ("one", 0, "two", 1)
    # Eight others, a gap behind each; the seventh of them is y[7].
    others = np.reshape(grey.y, (8, TIMES.size + 1))
    assert np.isnan(others[:, -1]).all()
    np.testing.assert_allclose(others[6, :-1], -0.5 * (1.0 - np.exp(-TIMES)))


def test_of_very_many_the_largest_are_shown() -> None:
    cross = np.zeros((20, 20))
    cross[3, 19] = 2.0
    made = chart(cross)
    shown = panels(made)
    assert len(shown) == 15
    assert shown[-1].title == "step of y[19]\nlargest other: y[3], 2"
    assert made.caption.endswith(" 15 of 20 steps, those with the largest responses.")
    assert made.size == chart(np.zeros((15, 15))).size
