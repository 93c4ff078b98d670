"""A camera that measures the direction of an asteroid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array, Channel, Scene
from hillsphere_sensors.body_surface import BodySurface
from hillsphere_sensors.lit_disc import disc_centroid, radiance
from hillsphere_sensors.spacecraft import SpacecraftSensor, rotate
from hillsphere_sensors.spacecraft_specs import CameraSpec

__all__ = ["Camera"]

_AT_ONCE = 1_000_000
"""Points of the grid times lanes that are computed at once, which bounds the memory (8 MB an
array)."""


class Camera(SpacecraftSensor):
    """Position of an asteroid in the image of a camera.

    The axes of the camera are z along the boresight, x level (z of the states' frame × boresight),
    and y completing them. A point at (x, y, z) in these axes has the angles atan(x/z) and
    atan(y/z), and the pixels f x/(z p) and f y/(z p) from the middle of the image, with the focal
    length f and the width p of a pixel, which follows from field of view and resolution.

    From the scene it takes ``"boresight"``, shape (S, 3, N), the commanded boresights of S
    spacecraft in the states' frame; for more than the centre ``"to_body"``, (3, 3, N), the matrices
    from that frame to the body's; and ``"sun"``, (3, N), the Sun's position, m, if only the sunlit
    part is seen.

    With the target ``points`` the measurement is not differentiable, since points of the grid
    appear and vanish at the limb. With ``disc`` a point is weighted by its solid angle as seen by
    the camera, which is zero at the limb, and its radiance by the photometric function. On an
    ellipsoid this centroid is an integral between limb and terminator, smooth in the state
    (`hillsphere_sensors.lit_disc`); on another shape it is a sum over the grid, in which points
    appear and vanish at the terminator.

    Parameters
    ----------
    spec : CameraSpec
        With its references bound.

    Raises
    ------
    InputError
        If the body has no surface.
    """

    def __init__(self, spec: CameraSpec) -> None:
        names = ("azimuth", "elevation") if spec.output == "angles" else ("u", "v")
        angles = spec.output == "angles"
        super().__init__(
            spec,
            tuple(
                Channel(name, "rad" if angles else "px", "angle" if angles else "linear")
                for name in names
            ),
        )
        self.spec = spec
        self.surface = BodySurface(spec.body, "camera")
        self._grid = self.surface.grid(spec.points)
        half = np.tan(0.5 * spec.field_of_view_rad)
        self.pixel_m = 2.0 * spec.focal_length_m * float(half) / spec.resolution
        """Width of a pixel, m."""
        self.pixels_per_slope = spec.focal_length_m / self.pixel_m
        """Pixels from the middle of the image to where x/z is one."""

    def pose(self, x: Array, t_s: Array, scene: Scene) -> tuple[Array, Array]:
        """Return the position (3, N) from the target's centre, m, and the axes (3, 3, N) as rows.

        Both are in the states' frame; the axes are the true ones.
        """
        return self._place(x), self._axes(t_s, scene)

    def _place(self, x: Array) -> Array:
        """Return the camera's position (3, N) from its target's centre, m."""
        r = self._states(x, self.spec.spacecraft)[:3]
        if self.spec.target_rows:
            r = r - self._states(x, self.spec.target_rows)[:3]
        return r

    def _true(self, x: Array, t_s: Array, scene: Scene) -> Array:
        spec = self.spec
        if (spec.target, spec.output, spec.target_rows) == ("centre", "angles", 0):
            return self._angles_of_centre(self._states(x, spec.spacecraft)[:3], t_s, scene)
        u, v, ahead, _ = self._target(x, t_s, scene)
        if spec.output == "angles":
            return np.array([np.arctan2(u, ahead), np.arctan2(v, ahead)])
        return self.pixels_per_slope * np.array([u, v]) / _forward(u, v, ahead)

    def _sees(self, x: Array, t_s: Array, scene: Scene) -> NDArray[np.bool_]:
        u, v, ahead, there = self._target(x, t_s, scene)
        half = np.tan(0.5 * self.spec.field_of_view_rad)
        return np.asarray(there & (np.maximum(np.abs(u), np.abs(v)) <= half * ahead))

    def _sigmas(self, true: Array) -> Array:
        of_pixels, attitude = self.spec.noise_px, self.spec.attitude_sigma_rad
        if self.spec.output == "angles":
            return np.full((2, 1), np.hypot(of_pixels / self.pixels_per_slope, attitude))
        return np.full((2, 1), np.hypot(of_pixels, attitude * self.pixels_per_slope))

    def _bias_sigmas(self, true: Array) -> Array:
        scale = self.pixels_per_slope if self.spec.output == "angles" else 1.0
        return np.full((2, 1), self.spec.bias_px / scale)

    def _target(
        self, x: Array, t_s: Array, scene: Scene
    ) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
        """Return the target in the camera's axes (each (N,)), and whether it is visible."""
        spec = self.spec
        r = self._place(x)
        u, v, ahead = self._components(-r, t_s, scene)
        there = np.ones(t_s.shape, dtype=bool)
        if spec.target == "centre":
            return u, v, ahead, there
        turn = self._from(scene, "to_body", (3, 3), t_s)
        sun = self._from(scene, "sun", (3,), t_s) if spec.sunlit else None
        frame = self._axes(t_s, scene)
        # the camera's axes in those of the body
        inside = np.einsum("ikn,jkn->ijn", *np.broadcast_arrays(frame, turn))
        place = rotate(turn, r)
        light = None if sun is None else np.broadcast_to(rotate(turn, sun), place.shape)
        inside = np.broadcast_to(inside, (3, 3, t_s.size))
        if spec.target == "disc" and self.surface.is_ellipsoid:
            slopes, there = disc_centroid(
                place, inside, self.surface.semi_axes_m, light, spec.photometry
            )
        else:
            slopes, there = self._grid_centroid(place, inside, light)
        # without a visible point the values are those of the centre, and the mask says so
        u, v = (np.where(there, s * ahead, c) for s, c in zip(slopes, (u, v), strict=True))
        return u, v, ahead, there

    def _grid_centroid(
        self, place: Array, frame: Array, light: Array | None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return x/z and y/z (2, N) of the grid's centroid, and whether anything is visible."""
        count = place.shape[1]
        size = max(1, _AT_ONCE // self._grid[0].shape[1])
        slopes, there = np.empty((2, count)), np.empty(count, dtype=bool)
        for first in range(0, count, size):
            some = slice(first, first + size)
            slopes[:, some], there[some] = self._middle(
                place[:, some], frame[:, :, some], None if light is None else light[:, some]
            )
        return slopes, there

    def _middle(
        self, place: Array, frame: Array, light: Array | None
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return x/z and y/z (2, N) of the centroid of what is visible, and whether anything is.

        `place` (3, N), `frame` (3, 3, N, axes as rows) and `light` (3, N) are in the axes of the
        body.
        """
        points, normals, areas = self._grid
        away = points[:, :, None] - place[:, None, :]
        # a point is visible if its normal points towards the camera (the body is convex)
        facing = -np.einsum("im,imn->mn", normals, away)
        weight = np.maximum(facing, 0.0)
        if self.spec.target == "points":
            weight = (facing > 0.0).astype(float)
        else:
            # solid angle: area times cos(angle of incidence) / distance²; facing has one distance
            square = np.sum(away * away, axis=0)
            weight *= areas[:, None] / square**1.5
        if light is not None:
            shone = normals.T @ light
            if self.spec.target == "points" or self.spec.photometry == "uniform":
                weight *= shone > 0.0
            else:
                shone /= np.sqrt(np.sum(light * light, axis=0))
                weight *= radiance(self.spec.photometry, shone, facing / np.sqrt(square))
        u, v, ahead = np.einsum("ijn,jmn->imn", frame, away)
        weight *= ahead > 0.0
        total = np.sum(weight, axis=0)
        there = total > 0.0
        # the centroid in the image is the weighted mean of x/z and y/z
        over = weight / (np.where(there, total, 1.0) * np.where(ahead > 0.0, ahead, 1.0))
        return np.array([np.sum(over * u, axis=0), np.sum(over * v, axis=0)]), there


def _forward(u: Array, v: Array, ahead: Array) -> Array:
    """Return the distance ahead of the camera, kept off zero to the side and behind."""
    return np.asarray(np.maximum(ahead, 1e-6 * np.sqrt(u * u + v * v + ahead * ahead)))
