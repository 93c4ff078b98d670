"""The surface of a body for sensors: ellipsoids, and shapes with a radius in each direction."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.contracts import Contract
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.model.bodies import SurfacedBody
from hillsphere.spec import Ref

__all__ = ["BodySurface"]

_GOLDEN = np.pi * (3.0 - np.sqrt(5.0))
_STEP = 1e-5
"""Step of the central differences of the radius by a direction, rad. They err by its square, 1e-10,
and by rounding over it, 1e-11, both far below what a camera resolves."""


@runtime_checkable
class _Radial(Contract, Protocol):
    def radius_array(self, directions: Array) -> Array:
        """Return the distances (N,), m, of the surface along directions (3, N)."""
        ...


class BodySurface:
    """The surface of a body, in the body's axes.

    Parameters
    ----------
    reference : Ref
        To the body.
    user : str
        Name of the sensor, for messages.

    Raises
    ------
    InputError
        If the body has no surface, or one without a radius in each direction.
    """

    def __init__(self, reference: Ref, user: str) -> None:
        body: object = reference.get()
        if not isinstance(body, SurfacedBody) or body.semi_axes_m is None:
            raise InputError(
                f"{user}: body {reference.name!r} has no surface; give it semi_axes_m or a shape"
            )
        if body.shape is not None and not isinstance(body.shape, _Radial):
            raise InputError(
                f"{user}: the shape of body {reference.name!r}, a {type(body.shape).__name__}, is "
                "not known along rays from the centre; take an ellipsoid, harmonics or a grid"
            )
        self.semi_axes_m = np.array(body.semi_axes_m)
        self._shape: _Radial | None = body.shape

    def radius(self, directions: Array) -> Array:
        """Return the distances (N,), m, of the surface along directions (3, N) of any length."""
        if self._shape is not None:
            return self._shape.radius_array(directions)
        x, y, z = directions * directions
        a, b, c = self.semi_axes_m.tolist()
        return np.asarray(np.sqrt((x + y + z) / (x / (a * a) + y / (b * b) + z / (c * c))))

    def grid(self, points: int) -> tuple[Array, Array, Array]:
        """Return a grid of surface points that cover equal solid angles from the centre.

        Parameters
        ----------
        points : int
            Number M of points, on a spiral of golden angles.

        Returns
        -------
        places : ndarray, shape (3, M)
            Positions, m.
        normals : ndarray, shape (3, M)
            Outward unit normals.
        areas : ndarray, shape (M,)
            Area of the surface that belongs to each, m².
        """
        k = np.arange(points) + 0.5
        z = 1.0 - 2.0 * k / points
        ring, turn = np.sqrt(1.0 - z * z), _GOLDEN * k
        out = np.array([ring * np.cos(turn), ring * np.sin(turn), z])
        radius = self.radius(out)
        normals = self._normals(out, radius)
        facing = np.maximum(np.sum(out * normals, axis=0), 1e-3)
        return out * radius, normals, radius**2 * (4.0 * np.pi / points) / facing

    def ray(self, origin: Array, direction: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return where rays first meet the ellipsoid of the semi-axes.

        Parameters
        ----------
        origin, direction : ndarray, shape (3, N)
            In the body's axes, m; directions of unit length.

        Returns
        -------
        distance : ndarray, shape (N,)
            Along the ray, m. For a ray that misses it is that of its nearest point in coordinates
            in which the ellipsoid is a unit sphere.
        met : ndarray of bool, shape (N,)
            Whether the ray meets the ellipsoid ahead.
        """
        axes = self.semi_axes_m.reshape(3, *(1,) * (direction.ndim - 1))
        o, d = origin / axes, direction / axes
        a, b = np.sum(d * d, axis=0), np.sum(o * d, axis=0)
        c = np.sum(o * o, axis=0) - 1.0
        # a s² + 2 b s + c = 0 in scaled coordinates; the smaller root is the first intersection
        inside = b * b - a * c
        distance = (-b - np.sqrt(np.maximum(inside, 0.0))) / a
        return np.asarray(distance), np.asarray((inside >= 0.0) & (distance > 0.0))

    @property
    def is_ellipsoid(self) -> bool:
        """Whether the surface is the ellipsoid of the semi-axes."""
        return self._shape is None or bool(getattr(self._shape, "is_ellipsoid", False))

    def _normals(self, out: Array, radius: Array) -> Array:
        """Return unit normals (3, N) at directions (3, N) with the radii (N,)."""
        if self.is_ellipsoid:
            normals = out * radius / self.semi_axes_m[:, None] ** 2
        else:  # gradient of the level |p| − R(p/|p|), by central differences
            normals = out.copy()
            for axis in range(3):
                step = np.zeros((3, 1))
                step[axis] = _STEP
                slope = (self.radius(out + step) - self.radius(out - step)) / (2.0 * _STEP)
                normals[axis] -= slope / radius
        return np.asarray(normals / np.linalg.norm(normals, axis=0))
