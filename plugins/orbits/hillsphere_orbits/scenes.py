"""Panels of orbits with their body, flat or in space."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from hillsphere.interfaces import Array
from hillsphere.presentation import (
    LINE_COLOURS,
    Area,
    Axis,
    Chart,
    Cloud,
    ColourScale,
    Curve,
    Mark,
    MarkerShape,
    Panel,
    Path,
    Points,
    Space,
    Surface,
)
from hillsphere.show.bodies import ellipsoid_points
from hillsphere.show.spaces import with_room
from hillsphere_orbits.survey import NEARLY_PLANAR

__all__ = [
    "AXES", "DIRECTIONS", "MARKERS", "SPACE_AXES", "Moon", "about_moon", "cylinder_solids",
    "family_colours", "moon_outline", "moon_solid", "name_axis", "orbit_paths", "scene_chart",
]  # fmt: skip

MARKERS: tuple[MarkerShape, ...] = (
    "circle", "square", "triangle", "diamond", "triangle-down", "star", "plus",
)  # fmt: skip
"""Shapes of markers that a figure distinguishes."""
AXES = (
    Axis("x, away from the primary", "km"), Axis("y, along the orbital velocity", "km"),
    Axis("z, north", "km"),
)  # fmt: skip
SPACE_AXES = Axis("x", "km"), Axis("y", "km"), Axis("z", "km")
"""Axes of a scene, whose ticks leave no room for longer labels; `DIRECTIONS` describes them."""
DIRECTIONS = "x points away from the primary, y along the orbital velocity, z north."
_DARKEST, _LIGHTEST = 0.25, 0.9
"""Places of the first and the last family on the scale of colours: before and beyond them viridis
is too dark for a line on a dark page and too light for one on a light page."""
_PHASE = Axis("part of the period")


class Moon(Protocol):
    """Fields of a product that say where the surface of its moon is."""

    @property
    def body(self) -> str:
        """Name of the moon; empty if the plant does not say."""

    @property
    def semi_axes_m(self) -> tuple[float, ...]:
        """Semi-axes of its surface along its own axes; empty if it has none."""

    @property
    def prime_meridian_rad(self) -> float:
        """Angle from +x to its longitude 0."""


def family_colours(families: int) -> list[str]:
    """Return one colour per family, from dark to light (they are ordered by n)."""
    scale = ColourScale("")
    return [scale.colour(place) for place in np.linspace(_DARKEST, _LIGHTEST, families).tolist()]


def name_axis(names: Sequence[str], margin: float = 0.6) -> Axis:
    """Return an axis with a row per name, downwards."""
    return Axis(ticks=list(enumerate(names)), low=-margin, high=len(names) - 1 + margin,
                is_reversed=True)  # fmt: skip


def about_moon(name: str, preposition: str = "around") -> str:
    """Return ``" around Phobos"``, or an empty text if the body has no name of its own."""
    return f" {preposition} {name.capitalize()}" if name not in ("", "body") else ""


def moon_solid(moon: Moon | None) -> Surface | Cloud:
    """Return the ellipsoid of the moon to scale, or its centre if it has no surface."""
    if moon is None or not moon.semi_axes_m:
        return Cloud(np.zeros((3, 1)), "centre of the body", "black", "plus")
    a, b, c = (axis / 1e3 for axis in moon.semi_axes_m)
    return Surface(
        np.tensordot(_turn(moon), ellipsoid_points(a, b, c), 1), moon.body.capitalize() or "Body"
    )


def moon_outline(moon: Moon | None) -> Area | Points:
    """Return the equator of the moon to scale, or its centre if it has no surface."""
    if moon is None or not moon.semi_axes_m:
        return Points([0.0], [0.0], "centre of the body", "black", "plus")
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    a, b, _ = np.array(moon.semi_axes_m) / 1e3
    x, y = _turn(moon)[:2, :2] @ np.array([a * np.cos(angle), b * np.sin(angle)])
    return Area(x, y, moon.body.capitalize() or "Body")


def _turn(moon: Moon) -> Array:
    """Return the rotation (3, 3) from the axes of the moon to those of its orbit."""
    c, s = np.cos(moon.prime_meridian_rad), np.sin(moon.prime_meridian_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def orbit_paths(tracks_m: Array, labels: Sequence[str], members: Sequence[int]) -> list[Path]:
    """Return closed orbits as paths over their period.

    Parameters
    ----------
    tracks_m : ndarray, shape (3, P, N)
        Positions along one period, equally spaced in time.
    labels : sequence of str
        Names of all N orbits.
    members : sequence of int
        Orbits that are drawn; they are the rows of the figure's table.
    """
    phase = np.linspace(0.0, 1.0, tracks_m.shape[1]).round(5)
    return [
        Path(
            tracks_m[:, :, i] / 1e3,
            labels[i],
            LINE_COLOURS[k % len(LINE_COLOURS)],
            times=phase,
            rows=i,
        )
        for k, i in enumerate(members)
    ]


def scene_chart(
    title: str, solids: Sequence[Path | Cloud], moon: Moon | None, caption: str, *,
    table: str = "", time: Axis = _PHASE,
) -> Chart:  # fmt: skip
    """Return orbits and the body to scale: in space, or from above if all are in its plane.

    Parameters
    ----------
    title, caption, table : str
        As for `Chart`.
    solids : sequence of Path or Cloud
        Orbits, km.
    moon : Moon or None
        The body; None draws its centre.
    time : Axis
        Axis of the times of the paths.
    """
    sizes = [np.nanmax(np.abs(np.asarray(s.points)), axis=1, initial=0.0) for s in solids]
    x, y, z = np.max(sizes, axis=0)
    if z < NEARLY_PLANAR * max(x, y):
        flat = [*map(_top_view, solids), moon_outline(moon)]
        panel = Panel(*AXES[:2], flat, is_equal=True, legend="right")
        return Chart(title, [panel], caption, size_in=(6.0, 8.0), table=table)
    space = with_room(Space([*solids, moon_solid(moon)], *SPACE_AXES, time=time))
    return Chart(
        title, [space], f"{caption} {DIRECTIONS}", shared_legend=True, size_in=(8.0, 7.5),
        table=table,
    )  # fmt: skip


def _top_view(solid: Path | Cloud) -> Mark:
    x, y, _ = np.asarray(solid.points)
    if isinstance(solid, Path):
        return Curve(x, y, solid.label, solid.colour, solid.dash, solid.width, solid.opacity,
                     rows=solid.rows)  # fmt: skip
    return Points(x, y, solid.label, solid.colour, solid.marker, solid.size, rows=solid.rows)


def cylinder_solids(
    ring_km: Array, height_km: float, colour: str, label: str
) -> tuple[Surface, Path]:
    """Return a transparent cylinder over a closed curve (2, K), km, and that curve."""
    walls = np.empty((3, 2, ring_km.shape[1]))
    walls[:2] = ring_km[:, None]
    walls[2] = np.array([[-height_km], [height_km]])
    middle = np.vstack([ring_km, np.zeros(ring_km.shape[1])])
    return Surface(walls, "", colour, opacity=0.1), Path(middle, label, colour, width=1.6)
