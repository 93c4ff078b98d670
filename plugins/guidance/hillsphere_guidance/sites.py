"""Landing sites on the surface of the body about which a plant moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.dynamics import ArrayFunction, bracketed_roots
from hillsphere.engine.surroundings import Surroundings
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Plant
from hillsphere.model.shapes.levels import level_of, normals_of
from hillsphere_guidance.motion import motion_of

__all__ = ["Ground", "Site"]

_IMPACT = "impact"
_NEAREST, _FARTHEST = 1e-4, 10.0
"""Range of distances along a ray in which the surface is searched, in the plant's units of
length."""
_SAMPLES = 4000
"""Samples of a ray between these distances, in geometric progression: neighbours differ by 0.3 %.
Parts of a surface that are thinner than that along the ray may be missed."""
_STEP = 1e-4
"""Step of the differences for the gradient, relative to the distance. They are of fourth order and
exact for an ellipsoid; this step stays within one face of a mesh almost everywhere."""
_NEXT = 1e-7
"""Distance on either side of the surface, relative to that from the centre, at which the sign of
the shape's level is checked."""
_STENCIL = ((-2.0, 1.0 / 12.0), (-1.0, -8.0 / 12.0), (1.0, 8.0 / 12.0), (2.0, -1.0 / 12.0))
"""Offsets in steps, and weights, of the central first difference of fourth order."""


@dataclass(frozen=True)
class Site:
    """A place on a surface, in the plant's frame.

    Parameters
    ----------
    position_m : ndarray, shape (3,)
        Where it is.
    up : ndarray, shape (3,)
        Unit outward normal of the surface.
    """

    position_m: Array
    up: Array


class Ground:
    """The surface at which flights of a plant end, that of its event ``impact``.

    Parameters
    ----------
    plant : Plant
        Equations of motion.
    start : ndarray, shape (n,)
        A state of the plant, for states that are neither positions nor velocities.

    Raises
    ------
    InputError
        If the plant has no such event, or not three positions.

    Notes ----- The body is taken to be star-shaped about its centre: a ray meets its surface once.
    Of another body the sites are the outermost points.
    """

    def __init__(self, plant: Plant, start: Array) -> None:
        motion = motion_of(plant)
        events = motion.system.events
        if _IMPACT not in events or motion.axes != 3:
            raise InputError(
                "the plant has no surface to land on; give its body semi_axes, or its gravity a "
                "surface, or say where the flight ends (end_position_m, end_velocity_m_s)"
            )
        self._motion, self._start = motion, start
        self._surface: ArrayFunction = motion.system.function(events[_IMPACT])
        around = Surroundings.of(plant)
        self._meridian = around.prime_meridian_rad
        self._shape = around.shape
        self._controls = np.zeros(len(motion.controls))

    def height(self, r: Array, t: float | Array = 0.0) -> Array:
        """Return the value of the event at positions (3, N): dimensionless, positive outside."""
        x = np.repeat(self._start[:, None], r.shape[1], axis=1)
        x[self._motion.positions] = r
        level: Array = self._surface(x, self._controls, t)[0]
        return level

    def direction(self, latitude_rad: float, longitude_rad: float) -> Array:
        """Return the unit vector (3,) from the centre to planetocentric latitude and longitude."""
        lon = longitude_rad + self._meridian
        cos = np.cos(latitude_rad)
        return np.array([cos * np.cos(lon), cos * np.sin(lon), np.sin(latitude_rad)])

    def site(self, latitude_rad: float, longitude_rad: float) -> Site:
        """Return the outermost point of the surface in a direction.

        Parameters
        ----------
        latitude_rad, longitude_rad : float
            Planetocentric, on the body; longitude to the east.

        Returns
        -------
        Site
            In the plant's frame.

        Raises
        ------
        InputError
            If the ray from the centre meets no surface, or the body is tilted in the frame.
        """
        way = self.direction(latitude_rad, longitude_rad)[:, None]
        length = self._motion.scales.length_m
        reach = np.geomspace(_NEAREST, _FARTHEST, _SAMPLES) * length
        height = self.height(way * reach)
        inside = np.flatnonzero((height[:-1] < 0.0) & (height[1:] >= 0.0))
        if not inside.size:
            raise InputError(
                f"the ray at latitude {np.degrees(latitude_rad):g}°, longitude "
                f"{np.degrees(longitude_rad):g}° meets no surface"
            )
        low, high = (slice(k, k + 1) for k in (inside[-1], inside[-1] + 1))
        distance = bracketed_roots(
            lambda q: self.height(way * q),
            reach[low], reach[high], height[low], height[high],
            np.spacing(reach[high]),
        )  # fmt: skip
        place = way[:, 0] * distance[0]
        return Site(place, self.normal(place))

    def heights(self, r: Array) -> Array:
        """Return the heights of positions (3, N) above the surface along their radii (N,), m."""
        distance = np.linalg.norm(r, axis=0)
        way = r / distance
        above = self.height(r)
        length = self._motion.scales.length_m
        low = np.where(above >= 0.0, _NEAREST * length, distance)
        high = np.where(above >= 0.0, distance, _FARTHEST * length)
        ground = bracketed_roots(
            lambda q: self.height(np.ascontiguousarray(way * q)),
            low, high, self.height(way * low), self.height(way * high),
            4.0 * np.spacing(high),
        )  # fmt: skip
        return np.asarray(distance - ground)

    def mesh(self, rows: int, columns: int) -> Array:
        """Return points of the surface (3, rows, columns) on circles of latitude, closed."""
        lat = np.linspace(-0.5 * np.pi, 0.5 * np.pi, rows)[:, None]
        lon = np.linspace(0.0, 2.0 * np.pi, columns) + self._meridian
        way = np.array(
            [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat) + 0.0 * lon]
        )
        far = _FARTHEST * self._motion.scales.length_m
        points = np.ascontiguousarray(way.reshape(3, -1))
        above = self.heights(far * points)
        return np.asarray(way * (far - above).reshape(rows, columns))

    def normal(self, r: Array) -> Array:
        """Return the unit outward normal (3,) of the surface at a position (3,) on it.

        It is that of the body's shape or, if only the event is known, the direction of its
        gradient.

        Raises
        ------
        InputError
            If the shape's surface is not there: the body is tilted in the plant's frame.
        """
        if self._shape is None:
            slope = self.slopes(r[:, None])[:, 0]
            return np.asarray(slope / np.linalg.norm(slope))
        cos, sin = np.cos(self._meridian), np.sin(self._meridian)
        to_body = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        own = to_body @ r[:, None]
        inside, outside = level_of(self._shape)(own * (1.0 + _NEXT * np.array([-1.0, 1.0])))
        if not inside < 0.0 < outside:
            raise InputError(
                "sites need a body whose axes are those of the plant's frame, turned about z to "
                "the prime meridian; this plant's body is tilted"
            )
        return np.asarray(to_body.T @ normals_of(self._shape)(own)[:, 0])

    def slopes(self, r: Array) -> Array:
        """Return the gradient (3, N) of the event by position, 1/m, at positions (3, N)."""
        step = _STEP * np.linalg.norm(r, axis=0)
        gradient = np.zeros_like(r)
        for row, axis in enumerate(np.eye(3)[:, :, None]):
            for reach, weight in _STENCIL:
                gradient[row] += weight * self.height(r + reach * step * axis)
        return np.asarray(gradient / step)
