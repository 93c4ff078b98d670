"""The centroid of a sunlit disc: closed forms of a distant sphere, own error, smoothness."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_sensors.camera_image import camera_image
from hillsphere_sensors.lit_disc import Law, disc_centroid

LAWS: tuple[Law, ...] = ("uniform", "lambert", "lommel_seeliger")
PIXELS = 1024.0 / np.tan(np.radians(15.0))
"""Pixels per slope of the default camera."""
NOISE_PX = 2.0
"""Noise of the default camera, whose attitude's noise is 0.007 px."""
AXES = np.array([191.0, 135.0, 95.0])


def towards_sun(alpha: Array, direction: Array, away_m: float) -> tuple[Array, Array, Array]:
    """Return place, axes and light (…, N) at phase angles; x of the image is towards the Sun."""
    one = direction / np.linalg.norm(direction)
    side = np.cross(one, [0.3, -0.2, 0.9])
    side /= np.linalg.norm(side)
    light = one[:, None] * np.cos(alpha) + side[:, None] * np.sin(alpha)
    frame = np.array([side, np.cross(-one, side), -one])
    place = np.repeat(away_m * one[:, None], alpha.size, axis=1)
    return place, np.repeat(frame[:, :, None], alpha.size, axis=2), light


def offset(law: Law, alpha: float) -> float:
    """Return the offset of the centroid of a distant unit sphere towards the Sun.

    Longitude χ from the observer, latitude φ: μ = cos φ cos χ, μ0 = cos φ cos(χ − α), x = cos φ
    sin χ, from χ = α − π/2 to π/2.
    """
    if law == "uniform":  # x from −cos α √(1 − y²) to √(1 − y²)
        return float(4.0 * (1.0 - np.cos(alpha)) / (3.0 * np.pi))
    if law == "lambert":
        # ∫cos³φ = 4/3 and ∫cos⁴φ = 3π/8; ∫cos χ cos(χ − α) dχ = ((π − α) cos α + sin α)/2, and
        # with sin χ it is sin α (1 + cos α)/3
        light = (np.pi - alpha) * np.cos(alpha) + np.sin(alpha)
        return float(3.0 * np.pi / 16.0 * np.sin(alpha) * (1.0 + np.cos(alpha)) / light)

    def shown(chi: float) -> float:
        both = np.cos(chi) * np.cos(chi - alpha)
        return float(both / (np.cos(chi) + np.cos(chi - alpha)))

    ends = alpha - 0.5 * np.pi, 0.5 * np.pi
    moment = quad(lambda chi: np.sin(chi) * shown(chi), *ends, epsabs=1e-12)[0]
    # ∫cos³φ = 4/3 for the moment, ∫cos²φ = π/2 for the light
    return float(4.0 / 3.0 * moment / (0.5 * np.pi * quad(shown, *ends, epsabs=1e-12)[0]))


@pytest.mark.parametrize("law", LAWS)
def test_distant_sphere(law: Law) -> None:
    degrees = np.array([5.0, 30.0, 60.0, 90.0, 120.0, 150.0, 170.0])
    place, frame, light = towards_sun(np.radians(degrees), np.array([0.2, -0.7, 0.4]), 1e8)
    slopes, there = disc_centroid(place, frame, np.full(3, 100.0), light, law)
    want = [offset(law, alpha) for alpha in np.radians(degrees)]
    assert there.all()
    np.testing.assert_allclose(slopes[0] * 1e6, want, rtol=0, atol=5e-5)
    np.testing.assert_allclose(slopes[1] * 1e6, 0.0, rtol=0, atol=5e-5)


@pytest.mark.parametrize("law", LAWS)
def test_own_error_is_small_beside_the_noise(law: Law) -> None:
    """Against 40 by 40 nodes, at all phases, where the missions at Apophis and Bennu fly."""
    alpha = np.radians(np.concatenate([np.arange(0.5, 20.0, 0.25), np.arange(20.0, 171.0, 2.0)]))
    for axes, away in ((AXES, 1500.0), (np.array([252.8, 246.2, 228.7]), 2570.0)):
        place, frame, light = towards_sun(alpha, np.array([0.2, -0.7, 0.4]), away)
        few, there = disc_centroid(place, frame, axes, light, law)
        many, _ = disc_centroid(place, frame, axes, light, law, (40, 40))
        assert there.all()
        error = PIXELS * np.linalg.norm(few - many, axis=0)
        assert error.max() < 0.05 * NOISE_PX


def test_nothing_is_seen_of_the_dark_side_or_from_within() -> None:
    place, frame, light = towards_sun(
        np.radians(np.array([179.0, 60.0])), np.array([1.0, 0, 0]), 9e2
    )
    place[:, 1] = 10.0
    slopes, there = disc_centroid(place, frame, AXES, light)
    assert not there.any()
    np.testing.assert_array_equal(slopes, 0.0)


def scene(count: int) -> tuple[Array, dict[str, Array]]:
    """Return a state and the scene while the body turns by 3 degrees."""
    x = np.repeat(np.array([[29.0, -1503.0, 407.0, 0.0, 0.0, 0.0]]).T, count, axis=1)
    angle = np.linspace(0.7, 0.75, count)
    c, s, zero = np.cos(angle), np.sin(angle), np.zeros(count)
    turn = np.array([[c, s, zero], [-s, c, zero], [zero, zero, zero + 1.0]])
    sun = np.array([[-1.0], [-0.6], [0.5]]) * 1e11
    return x, {"boresight": -x[None, :3], "to_body": turn, "sun": sun}


def camera(**keys: Any) -> Any:
    body = create(
        "body", "asteroid", semi_major_axis_au=0.92, rotation_rate_rad_s=6e-5,
        semi_axes_m=tuple(AXES),
    )  # fmt: skip
    return create("sensor", "camera", body=body, sunlit=True, **{"target": "disc", **keys})


@pytest.mark.parametrize("law", LAWS)
def test_lit_disc_is_smooth_in_the_state(law: Law) -> None:
    """A grid's points jump at the terminator: by up to 40 times the median step."""
    x, around = scene(501)
    steps = np.diff(camera(photometry=law).observe(x, np.zeros(501), around), axis=1)
    assert np.abs(np.diff(steps, axis=1)).max() < 0.01 * np.abs(steps).max()


@pytest.mark.parametrize("law", LAWS)
def test_centroid_of_the_image(law: Law) -> None:
    """The image by rays weighs pixels; from 1.5 km theirs differ from solid angles by 1e-3."""
    x, around = scene(1)
    image = camera_image(camera(photometry=law), x[:, 0], around, size=1200, ambient=0.0)
    pixels = image.edge_px * (2.0 * (np.arange(1200) + 0.5) / 1200 - 1.0)
    light = image.brightness / image.brightness.sum()
    middle = [float((light.sum(axis=0) * pixels).sum()), float((light.sum(axis=1) * pixels).sum())]
    np.testing.assert_allclose(image.found_px, middle, rtol=0, atol=1.5)
    assert 0.5 < image.brightness.max() <= 1.0


def test_photometry_is_that_of_a_lit_disc() -> None:
    with pytest.raises(InputError, match="sunlit disc"):
        camera(target="points", photometry="lambert")


@pytest.mark.parametrize("law", LAWS)
def test_near_ellipsoid_against_a_sum_over_its_surface(law: Law) -> None:
    """A million points at equal steps of z and by golden angles on the unit sphere, stretched."""
    count = 1_000_000
    z = (np.arange(count) + 0.5) * 2.0 / count - 1.0
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    n = np.array([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z])
    place, frame, light = towards_sun(np.array([1.2]), np.array([0.2, -0.7, 0.4]), 450.0)
    slopes, _ = disc_centroid(place, frame, AXES, light, law)
    area = n / AXES[:, None]  # times det A: the surface's vector element
    normal = area / np.linalg.norm(area, axis=0)
    away = place - AXES[:, None] * n
    distance = np.linalg.norm(away, axis=0)
    emission = np.sum(normal * away, axis=0) / distance
    incidence = light[:, 0] @ normal / np.linalg.norm(light)
    seen = (emission > 0.0) & (incidence > 0.0)
    bright = {
        "uniform": np.ones(count),
        "lambert": incidence,
        "lommel_seeliger": incidence / np.where(seen, incidence + emission, 1.0),
    }
    # solid angle dΩ = dA cos e/d²
    weight = seen * bright[law] * np.linalg.norm(area, axis=0) * emission / distance**2
    u, v, ahead = frame[:, :, 0] @ -away
    want = [np.sum(weight * one / ahead) / np.sum(weight) for one in (u, v)]
    np.testing.assert_allclose(slopes[:, 0], want, rtol=0, atol=2e-5)
