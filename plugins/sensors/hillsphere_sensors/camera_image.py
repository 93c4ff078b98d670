"""The image of an ellipsoid by a camera, for figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Scene
from hillsphere_sensors.camera import Camera
from hillsphere_sensors.lit_disc import Law, radiance
from hillsphere_sensors.spacecraft import rotate

__all__ = ["CameraImage", "camera_image"]


@dataclass(frozen=True)
class CameraImage:
    """An image, with the position that the camera measures in it.

    Parameters
    ----------
    brightness : ndarray, shape (K, K)
        0 (sky) to 1 (the greatest radiance of the photometric function); without the Sun 1 on the
        body. Rows from the bottom to the top of the image, as v rises.
    edge_px : float
        The image reaches from −edge_px to edge_px in both directions, pixels of the camera.
    centre_px, found_px : ndarray, shape (2,)
        Centre of mass, and measured position of the target: u and v in pixels from the middle.
    """

    brightness: Array
    edge_px: float
    centre_px: Array
    found_px: Array


def camera_image(
    camera: Camera, x: Array, scene: Scene, *, size: int = 256, ambient: float = 0.05
) -> CameraImage:
    """Return the image of one state.

    Parameters
    ----------
    camera : Camera
        The camera; its body must be an ellipsoid.
    x : ndarray, shape (n,)
        State.
    scene : Scene
        As for the camera, with arrays (…, 1) and ``"to_body"``; with ``"sun"`` the surface is
        shaded by the camera's photometric function, that of a camera that measures no sunlit disc
        by Lambert's law.
    size : int
        Rays in each direction.
    ambient : float
        Brightness of what the Sun does not reach.

    Returns
    -------
    CameraImage
        Brightness of every ray, and the place of the target in the image.

    Raises
    ------
    InputError
        If the surface is no ellipsoid or the scene lacks something.
    """
    if not camera.surface.is_ellipsoid:
        raise InputError("an image is made of an ellipsoid only; give the body semi-axes")
    if "to_body" not in scene:
        raise InputError("the scene lacks 'to_body', the matrix (3, 3, 1) to the body's axes")
    time = np.zeros(1)
    state = np.asarray(x, dtype=float)[:, None]
    turn = np.asarray(scene["to_body"], dtype=float)
    spec = camera.spec
    r, frame = camera.pose(state, time, scene)
    edge = np.tan(0.5 * spec.field_of_view_rad)
    slopes = edge * (2.0 * (np.arange(size) + 0.5) / size - 1.0)
    u, v = (grid.ravel() for grid in np.meshgrid(slopes, slopes))
    rays = np.array([u, v, np.ones_like(u)])
    rays = rotate(turn, rotate(frame.transpose(1, 0, 2), rays / np.linalg.norm(rays, axis=0)))
    place = rotate(turn, r)
    distance, met = camera.surface.ray(place, rays)
    normals = (place + distance * rays) / camera.surface.semi_axes_m[:, None] ** 2
    bright = np.ones_like(u)
    if "sun" in scene:
        sun = rotate(turn, np.asarray(scene["sun"], dtype=float))
        normals /= np.linalg.norm(normals, axis=0)
        law: Law = spec.photometry if spec.target == "disc" and spec.sunlit else "lambert"
        shade = radiance(
            law,
            np.sum(normals * sun, axis=0) / np.linalg.norm(sun),
            -np.sum(normals * rays, axis=0),
        )
        bright = ambient + (1.0 - ambient) * shade
    centre = rotate(frame, -r)[:, 0]
    centroid = camera.observe(state, time, scene)[:, 0]
    if spec.output == "angles":
        centroid = camera.pixels_per_slope * np.tan(centroid)
    return CameraImage(
        np.where(met, bright, 0.0).reshape(size, size),
        0.5 * spec.resolution,
        camera.pixels_per_slope * centre[:2] / centre[2],
        centroid,
    )
