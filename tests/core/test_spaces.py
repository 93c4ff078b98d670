"""Axes of scenes have room for their ticks, and the content stays in the middle."""

from __future__ import annotations

import numpy as np
import pytest

from hillsphere.show.charts import Axis, Space
from hillsphere.show.solids import Arrows, Cloud, Mesh, Path, Solid
from hillsphere.show.spaces import with_room


def ends(space: Space) -> list[tuple[float, float]]:
    return [(axis.low, axis.high) for axis in (space.x, space.y, space.z)]  # type: ignore[misc]


def test_a_flat_scene_is_half_as_high_as_wide() -> None:
    points = np.array([[0.0, 100.0], [-5.0, 5.0], [7.0, 7.0]])
    made = with_room(Space([Path(points)]))
    x, y, z = ends(made)
    assert x == pytest.approx((-4.0, 104.0))
    assert y == pytest.approx((-29.0, 29.0))
    assert z == pytest.approx((-22.0, 36.0))


def test_long_sides_keep_their_lengths() -> None:
    points = np.array([[0.0, 100.0], [0.0, 80.0], [0.0, 60.0]])
    sizes = [high - low for low, high in ends(with_room(Space([Path(points)])))]
    assert sizes == pytest.approx([108.0, 88.0, 68.0])


def test_all_kinds_of_solids_count_and_gaps_do_not() -> None:
    solids: list[Solid] = [
        Path(np.array([[0.0, np.nan], [0.0, 50.0], [0.0, 0.0]])),
        Cloud(np.array([[10.0], [0.0], [0.0]])),
        Arrows(np.zeros((3, 1)), np.array([[0.0], [20.0], [0.0]])),
        Mesh(np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 15.0]]), np.zeros((1, 3), dtype=int)),
    ]
    middles = [0.5 * (low + high) for low, high in ends(with_room(Space(solids)))]
    assert middles == pytest.approx([5.0, 10.0, 7.5])


def test_given_ends_are_kept() -> None:
    points = np.array([[0.0, 100.0], [0.0, 1.0], [0.0, 1.0]])
    made = with_room(Space([Path(points)], Axis("x", "m", low=-1.0, high=200.0)))
    assert ends(made)[0] == (-1.0, 200.0)


@pytest.mark.parametrize("points", [np.zeros((3, 0)), np.full((3, 2), np.nan), np.ones((3, 2))])
def test_a_scene_without_extent_stays(points: np.ndarray) -> None:
    space = Space([Path(points)])
    assert with_room(space) is space
