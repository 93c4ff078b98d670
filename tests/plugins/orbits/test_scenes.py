"""Panels of orbits with their body."""

from dataclasses import dataclass

import numpy as np
import pytest

from hillsphere.presentation import Area, Cloud, Curve, Panel, Path, Space, Surface
from hillsphere_orbits.scenes import (
    cylinder_solids,
    family_colours,
    moon_outline,
    moon_solid,
    orbit_paths,
    scene_chart,
)

ANGLE = np.linspace(0.0, 2.0 * np.pi, 41)


@dataclass(frozen=True)
class Ellipsoid:
    body: str = "phobos"
    semi_axes_m: tuple[float, ...] = (13e3, 11e3, 9e3)
    prime_meridian_rad: float = 0.25 * np.pi


def tracks(z_m: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    one = np.array([30e3 * np.cos(ANGLE), 60e3 * np.sin(ANGLE), z_m * np.cos(ANGLE)])
    return np.stack([one, 2.0 * one], axis=2)


def test_the_body_is_turned_to_its_prime_meridian() -> None:
    solid, outline = moon_solid(Ellipsoid()), moon_outline(Ellipsoid())
    assert isinstance(solid, Surface)
    assert isinstance(outline, Area)
    x, y, z = np.asarray(solid.points)
    along, across = (x + y) / np.sqrt(2.0), (y - x) / np.sqrt(2.0)
    np.testing.assert_allclose((along / 13) ** 2 + (across / 11) ** 2 + (z / 9) ** 2, 1.0)
    assert np.hypot(outline.x, outline.y).max() == pytest.approx(13.0)
    farthest = np.argmax(outline.x + np.asarray(outline.y))
    assert np.asarray(outline.x)[farthest] == pytest.approx(
        np.asarray(outline.y)[farthest], rel=0.1
    )
    assert isinstance(moon_solid(Ellipsoid(semi_axes_m=())), Cloud)


@pytest.mark.parametrize("z_m, kind", [(1e3, Panel), (10e3, Space)])
def test_orbits_near_the_plane_are_seen_from_above(z_m: float, kind: type) -> None:
    paths = orbit_paths(tracks(z_m), ["a", "b"], [1])
    chart = scene_chart("Orbits", paths, Ellipsoid(), "Caption", table="orbits")
    (panel,) = chart.panels
    assert type(panel) is kind
    orbit = panel.solids[0] if isinstance(panel, Space) else panel.marks[0]
    assert isinstance(orbit, Path | Curve)
    assert (orbit.label, orbit.rows) == ("b", 1)
    if isinstance(orbit, Path) and orbit.times is not None:
        np.testing.assert_allclose(np.asarray(orbit.points)[1, [0, 10]], [0.0, 120.0], atol=1e-9)
        assert np.asarray(orbit.times)[10] == 0.25


def test_a_cylinder_has_walls_over_its_curve() -> None:
    ring = np.array([np.cos(ANGLE), np.sin(ANGLE)])
    walls, middle = cylinder_solids(ring, 5.0, "green", "cylinder")
    np.testing.assert_array_equal(np.asarray(walls.points)[2, :, 0], [-5.0, 5.0])
    np.testing.assert_array_equal(np.asarray(middle.points)[:2], ring)


def test_families_go_from_dark_to_less_than_the_lightest() -> None:
    assert len(set(family_colours(5))) == 5
    assert family_colours(1) == [family_colours(5)[0]] == ["#3B528B"]
