"""What spacecraft near an asteroid measure: published case Apophis, and geometry by other ways."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.testing import check_sensor
from hillsphere_plants.formation_reference.stage import relative_orbit
from hillsphere_sensors.camera_image import camera_image
from hillsphere_sensors.spacecraft import boresight_components, line_of_sight_frame, rotate

AXES = np.array([191.0, 135.0, 95.0])
DEGREE = np.pi / 180.0
STATE_A = np.array([29.0053037623, -1503.35866206, 407.105801689, 1e-4, -2e-4, 3e-4])
SC2 = relative_orbit(
    np.array([0.08913e-10, 3.828e-9, 5.370e-8, -7.266e-8, 0.0]), np.zeros(1),
    0.9224 * 1.495978707e11, 0.1912, 0.05814, 2.2061, 1.32712440018e20,
)[:, 0]  # fmt: skip
STATES = np.concatenate([STATE_A, SC2])
NOW = np.zeros(1)


def body(**keys: Any) -> Any:
    given: dict[str, Any] = {"semi_axes_m": tuple(AXES), **keys}
    return create(
        "body", "asteroid", semi_major_axis_au=0.9224, rotation_rate_rad_s=5.8177e-5, **given
    )


def sensor(kind: str, **keys: Any) -> Any:
    if kind in ("camera", "lidar"):
        keys = {"body": body(), **keys}
    return create("sensor", kind, **keys)


def about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def scene(
    x: Array = STATES, off: tuple[float, ...] = (20.0, 10.0, -5.0), phase: float = 0.7
) -> dict[str, Array]:
    places = x.reshape(-1, 6)[:, :3]
    return {
        "boresight": -(places + np.array(off))[:, :, None],
        "to_body": about_z(phase)[:, :, None],
        "sun": np.array([[-1.116e11], [0.0], [0.0]]),
    }


def test_published_values() -> None:
    """Camera to the centre, lidar and inter-satellite measurements of the state A."""
    x = STATES[:, None]
    angles = [-1.30428435136740e-2, -1.54166374200145e-3]
    camera = sensor("camera").observe(x, NOW, scene())[:, 0]
    np.testing.assert_allclose(camera, angles, rtol=1e-12)
    lidar = sensor("lidar").observe(x, NOW, scene())[:, 0]
    np.testing.assert_allclose(lidar[0], 1414.268099697, rtol=1e-12)
    np.testing.assert_allclose(lidar[1:], angles, rtol=1e-12)
    mutual = sensor("inter_satellite", partner=2).observe(x, NOW, scene())[:, 0]
    want = [639.824955636143, -1.61930472442267, 0.226081962628774]
    np.testing.assert_allclose(mutual, want, rtol=1e-12)


def test_published_errors() -> None:
    """Two pixels of 3.1714e-7 m and the star tracker; pointing and star tracker."""
    camera, lidar = sensor("camera"), sensor("lidar")
    assert camera.pixel_m == pytest.approx(3.1714e-7, rel=1e-4)
    x = STATES[:, None]
    np.testing.assert_allclose(camera.sigma(x, NOW, scene()), 5.2334e-4, rtol=2e-5)
    np.testing.assert_allclose(
        lidar.sigma(x, NOW, scene())[:, 0], [10.0, 1.754e-5, 1.754e-5], rtol=1e-4
    )
    mutual = sensor("inter_satellite", partner=2)
    np.testing.assert_allclose(
        mutual.sigma(x, NOW, scene())[:, 0], [2.0, 1.745e-6, 1.745e-6], rtol=2e-4
    )


def test_pixels_are_angles() -> None:
    angles = sensor("camera").observe(STATES[:, None], NOW, scene())
    pixels = sensor("camera", output="pixels")
    shown = pixels.observe(STATES[:, None], NOW, scene())
    np.testing.assert_allclose(shown, np.tan(angles) * 1.212e-3 / pixels.pixel_m, rtol=1e-12)
    edge = np.tan(15 * DEGREE) * 1.212e-3 / pixels.pixel_m
    assert edge == pytest.approx(1024.0)


def test_components_are_those_of_the_axes() -> None:
    random = np.random.default_rng(6)
    boresight, way = random.normal(size=(2, 3, 100))
    want = rotate(line_of_sight_frame(boresight), way)
    np.testing.assert_allclose(boresight_components(boresight, way), want, rtol=0, atol=1e-14)
    axes = line_of_sight_frame(boresight)
    np.testing.assert_allclose(np.cross(axes[0], axes[1], axis=0), axes[2], rtol=0, atol=1e-14)


def test_field_of_view() -> None:
    x = np.repeat(STATES[:, None], 4, axis=1)
    r = x[:3, 0]
    side = np.cross(r, [0.0, 0.0, 1.0])
    side *= np.linalg.norm(r) / np.linalg.norm(side)
    tilts = np.tan(np.array([14.9, 15.1, 80.0, 179.0]) * DEGREE)
    looks = -r[:, None] + side[:, None] * tilts
    looks[:, 3] = r
    around = {**scene(), "boresight": np.stack([looks, looks])}
    found = sensor("camera").visible(x, np.zeros(4), around)
    assert found.tolist() == [True, False, False, False]
    behind = sensor("camera", output="pixels").observe(x, np.zeros(4), around)
    assert np.isfinite(behind).all()


def test_centroid_of_a_sphere_is_its_centre() -> None:
    ball = body(semi_axes_m=(150.0, 150.0, 150.0))
    for target, most in (("points", 4e-4), ("disc", 4e-4)):
        camera = sensor("camera", body=ball, target=target, points=4000)
        found = camera.observe(STATES[:, None], NOW, scene())
        centre = sensor("camera").observe(STATES[:, None], NOW, scene())
        np.testing.assert_allclose(found, centre, rtol=0, atol=most)


def test_disc_is_the_middle_of_the_image() -> None:
    """The sunlit disc, against a count of the pixels of an image by rays."""
    around = {**scene(), "sun": np.array([[-1.0], [-0.6], [0.5]]) * 1e11}
    camera = sensor("camera", target="disc", sunlit=True, points=20000, output="pixels")
    image = camera_image(camera, STATES, around, size=1500, ambient=0.0)
    lit = image.brightness > 0.0
    pixels = image.edge_px * (2.0 * (np.arange(1500) + 0.5) / 1500 - 1.0)
    middle = [
        float((lit * pixels[None, :]).sum() / lit.sum()),
        float((lit * pixels[:, None]).sum() / lit.sum()),
    ]
    found = camera.observe(STATES[:, None], NOW, around)[:, 0]
    np.testing.assert_allclose(found, middle, rtol=0, atol=1.5)
    np.testing.assert_array_equal(found, image.found_px)
    # the phase shifts it by far more, towards the Sun
    assert np.linalg.norm(found - image.centre_px) > 20.0


def test_image_of_an_ellipsoid() -> None:
    camera = sensor("camera")
    image = camera_image(camera, STATES, scene(), size=300)
    assert image.brightness.shape == (300, 300)
    assert image.brightness.max() <= 1.0
    assert image.brightness[0, 0] == 0.0
    # size of the disc: between those of the least and the greatest axes
    width = (image.brightness > 0).sum() * (2 * image.edge_px / 300) ** 2
    scale = (camera.pixels_per_slope / np.linalg.norm(STATE_A[:3])) ** 2
    assert np.pi * 95 * 135 * scale < width < 1.02 * np.pi * 191 * 135 * scale
    with pytest.raises(InputError, match="to_body"):
        camera_image(camera, STATES, {"boresight": scene()["boresight"]})


def test_visible_points_jump_where_the_disc_does_not() -> None:
    """The asteroid turns by 3 degrees: points come and go at its limb."""
    count = 1001
    x = np.repeat(STATES[:, None], count, axis=1)
    turns = np.stack([about_z(phase) for phase in np.linspace(0.7, 0.75, count)], axis=2)
    jumps = {}
    for target in ("points", "disc"):
        camera = sensor("camera", target=target)
        found = camera.observe(x, np.zeros(count), {**scene(), "to_body": turns})
        steps = np.abs(np.diff(found, axis=1))
        jumps[target] = steps.max() / np.median(steps)
    assert jumps["points"] > 20.0
    assert jumps["disc"] < 5.0


def test_lidar_along_the_boresight() -> None:
    """Straight at the centre both spots agree; else the spot is on the surface."""
    straight = scene(off=(0.0, 0.0, 0.0))
    below = sensor("lidar").observe(STATES[:, None], NOW, straight)[0]
    beam = sensor("lidar", spot="pointing", angles=False)
    np.testing.assert_allclose(beam.observe(STATES[:, None], NOW, straight)[0], below, rtol=1e-12)
    aside = scene(off=(30.0, 0.0, 40.0))
    distance = float(beam.observe(STATES[:, None], NOW, aside)[0, 0])
    way = aside["boresight"][0, :, 0]
    spot = about_z(0.7) @ (STATE_A[:3] + distance * way / np.linalg.norm(way))
    assert np.sum((spot / AXES) ** 2) == pytest.approx(1.0, abs=1e-12)
    missed = scene(off=(300.0, 0.0, 0.0))
    assert not beam.visible(STATES[:, None], NOW, missed)[0]
    assert np.isfinite(beam.observe(STATES[:, None], NOW, missed)).all()
    assert beam.visible(STATES[:, None], NOW, aside)[0]


def test_lidar_has_a_field_of_view() -> None:
    """Ten degrees off the centre: within a cone of 22, not of 18; a gimballed one finds it."""
    away = np.array([[1000.0, 0.0, 0.0, 0.0, 0.0, 0.0]]).T
    angle = np.radians(10.0)
    aside = {**scene(), "boresight": np.array([[-np.cos(angle)], [np.sin(angle)], [0.0]])[None]}
    seen = [
        bool(sensor("lidar", **keys).visible(away, NOW, aside)[0])
        for keys in ({}, {"field_of_view_deg": 22}, {"field_of_view_deg": 18})
    ]
    assert seen == [True, True, False]
    with pytest.raises(ValueError, match="needs none"):
        sensor("lidar", spot="pointing", angles=False, field_of_view_deg=20)


def test_lidar_has_a_reach() -> None:
    near, far = (
        sensor("lidar", maximum_range_m=reach).visible(STATES[:, None], NOW, scene())[0]
        for reach in (1500.0, 1400.0)
    )
    assert near
    assert not far


def test_radius_of_a_shape() -> None:
    """The same ellipsoid as a shape that is known along rays."""
    shape = create("shape", "ellipsoid", axes_m=tuple(AXES))
    as_shape = body(semi_axes_m=None, shape=shape)
    for kind, keys in (("lidar", {}), ("camera", {"target": "disc"})):
        one, other = (
            sensor(kind, body=of, **keys).observe(STATES[:, None], NOW, scene())
            for of in (body(), as_shape)
        )
        np.testing.assert_allclose(one, other, rtol=1e-12)


def test_sun_blinds_between_spacecraft() -> None:
    """The Sun 4 and 6 degrees off the partner."""
    x = np.zeros((12, 3))
    x[6] = -1000.0
    angles = np.array([4.0, 6.0, 180.0]) * DEGREE
    around = {"sun": 1e11 * np.array([-np.cos(angles), np.sin(angles), 0.0 * angles])}
    mutual = sensor("inter_satellite", partner=2)
    assert mutual.visible(x, np.zeros(3), around).tolist() == [False, True, True]
    other = sensor("inter_satellite", spacecraft=2, partner=1)
    assert other.visible(x, np.zeros(3), around).tolist() == [True, True, False]


def test_asteroid_between_spacecraft() -> None:
    x = np.zeros((12, 3))
    x[0], x[6] = 1000.0, -1000.0
    x[2], x[8] = [0.0, 90.0, 96.0], [0.0, 90.0, 96.0]
    around = {"to_body": np.eye(3)[:, :, None]}
    mutual = sensor("inter_satellite", partner=2, sun_cone_rad=0.0, body=body())
    assert mutual.visible(x, np.zeros(3), around).tolist() == [False, False, True]
    x[6] = 500.0
    assert mutual.visible(x, np.zeros(3), around).all()


def test_times_of_measurements() -> None:
    t = np.array([0.0, 600.0, 900.0, 1200.0, 3.0e6, 1e9 * 600.0])
    x = np.repeat(STATES[:, None], t.size, axis=1)
    mutual = sensor("inter_satellite", partner=2, period_s=600.0, outages_s=[[1000.0, 2000.0]])
    assert mutual.visible(x, t, scene()).tolist() == [True, True, False, False, True, True]


def test_dropouts_outliers_and_biases() -> None:
    count = 20000
    x = np.repeat(STATES[:, None], count, axis=1)
    lossy = sensor(
        "inter_satellite", partner=2, dropout_probability=0.3, outlier_probability=0.02,
        range_bias_m=5.0,
    )  # fmt: skip
    noise = np.random.default_rng(2).normal(size=(lossy.draws[1], count))
    constant = np.zeros((lossy.draws[0], count))
    constant[0] = 2.0
    seen = lossy.measure(x, np.zeros(count), scene(), constant, noise)
    assert np.isnan(seen).any(axis=0).mean() == pytest.approx(0.3, abs=0.02)
    off = (seen - lossy.observe(x, np.zeros(count), scene()))[0]
    off = off[np.isfinite(off)]
    assert np.median(off) == pytest.approx(10.0, abs=0.1)
    assert (np.abs(off - 10.0) > 5 * 2.0).mean() == pytest.approx(0.02 * 0.87, abs=4e-3)


def test_sun_sensor() -> None:
    looks = sensor("sun_sensor")
    x = STATES[:, None]
    toward = scene()["sun"][:, 0] - STATE_A[:3]
    np.testing.assert_allclose(
        looks.observe(x, NOW, scene())[:, 0], toward / np.linalg.norm(toward), rtol=1e-14
    )
    turns = np.array([[3.0], [4.0], [0.0], [0.0]])
    seen = looks.measure(x, NOW, scene(), np.zeros((2, 1)), turns)[:, 0]
    assert np.linalg.norm(seen) == pytest.approx(1.0, abs=1e-15)
    off = np.arccos(seen @ toward / np.linalg.norm(toward))
    assert off == pytest.approx(5 * 0.01 * DEGREE, rel=1e-4)
    narrow = sensor("sun_sensor", field_of_view_rad=np.pi)
    ahead = {**scene(), "boresight": np.stack([-toward, -toward])[:, :, None]}
    behind = {**scene(), "boresight": np.stack([toward, toward])[:, :, None]}
    assert narrow.visible(x, NOW, ahead)[0]
    assert not narrow.visible(x, NOW, behind)[0]


def test_star_tracker() -> None:
    turns = np.array([[1e-3, 2e-3, 3e-3], [4e-3, 5e-3, 6e-3]])[:, :, None]
    tracker = sensor("star_tracker", spacecraft=2, sun_cone_deg=30)
    around = {**scene(), "attitude": turns}
    np.testing.assert_array_equal(
        tracker.observe(STATES[:, None], NOW, around)[:, 0], turns[1, :, 0]
    )
    away = {**around, "boresight": -np.stack([scene()["sun"], scene()["sun"]])}
    assert tracker.visible(STATES[:, None], NOW, around)[0]
    assert not tracker.visible(STATES[:, None], NOW, away)[0]


def test_contract_of_the_second_spacecraft() -> None:
    count = 12
    random = np.random.default_rng(4)
    x = np.repeat(STATES[:, None], count, axis=1) * random.uniform(0.8, 1.2, (1, count))
    around = scene(off=(0.0, 0.0, 0.0))
    for target in ("centre", "points", "disc"):
        camera = sensor("camera", spacecraft=2, target=target, points=60, outlier_probability=0.02)
        check_sensor(camera, x, np.zeros(count), around)


def test_heliocentric_states_with_a_target() -> None:
    """The asteroid's states first, the spacecraft's second: the same sight."""
    away = np.concatenate([[1e11, 2e10, 3e9, 0, 3e4, 0]])
    x = np.concatenate([away, away + STATE_A])[:, None]
    around = {"boresight": np.repeat(scene()["boresight"][:1], 2, axis=0)}
    found = sensor("camera", spacecraft=2, target_rows=1).observe(x, NOW, around)[:, 0]
    np.testing.assert_allclose(found, [-1.304284e-2, -1.541664e-3], rtol=0, atol=2e-8)


def test_refused() -> None:
    with pytest.raises(InputError, match="no surface"):
        sensor("lidar", body=body(semi_axes_m=None))
    with pytest.raises(InputError, match="says nothing"):
        sensor("lidar", spot="pointing")
    with pytest.raises(InputError, match="cannot be its own partner"):
        sensor("inter_satellite", partner=1)
    with pytest.raises(InputError, match="needs rows 13 to 18"):
        sensor("camera", spacecraft=3).observe(
            STATES[:, None], NOW, {"boresight": np.ones((3, 3, 1))}
        )
    with pytest.raises(InputError, match="boresight: a vector of some length is needed"):
        sensor("camera").observe(STATES[:, None], NOW, {"boresight": np.zeros((2, 3, 1))})
    with pytest.raises(InputError, match="must be"):
        sensor("camera").observe(STATES[:, None], NOW, {"boresight": np.ones((2, 3, 5))})


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_boresight_over_a_pole(sign: float) -> None:
    """Along ±z, beside one that is not: the limit of a boresight that comes from +x."""
    way = np.array([[120.0, 1.0], [-50.0, 2.0], [sign * 1500.0, 3.0]])
    along = np.array([[0.0, 3.0], [0.0, 4.0], [sign * 7.0, 5.0]])
    near = along + np.array([[1e-7, 0.0], [0.0, 0.0], [0.0, 0.0]])
    found, want = (
        np.array(boresight_components(along, way)),
        np.array(boresight_components(near, way)),
    )
    np.testing.assert_allclose(found[:, 0], want[:, 0], rtol=0, atol=1e-3)
    np.testing.assert_array_equal(found[:, 1], want[:, 1])
    np.testing.assert_allclose(found, rotate(line_of_sight_frame(along), way), atol=1e-9)
    axes = line_of_sight_frame(along)[:, :, 0]
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
