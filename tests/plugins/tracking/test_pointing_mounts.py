"""Axis angles of azimuth-elevation, tilted and X/Y mounts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hillsphere.errors import InputError
from hillsphere.plugins import validate
from hillsphere_tracking.pointing.mounts import AxisLimits, Mount, azimuth_elevation, x_y
from hillsphere_tracking.pointing.specs import AxisSpec, MountSpec
from hillsphere_tracking.topocentric import direction_cosines

DEGREE = np.pi / 180.0
ROUND = AxisLimits(-270.0 * DEGREE, 270.0 * DEGREE, 0.1, 0.1)
HALF = AxisLimits(0.0, 90.0 * DEGREE, 0.1, 0.1)
OVER = AxisLimits(0.0, 180.0 * DEGREE, 0.1, 0.1)
LEVEL = AxisLimits(-90.0 * DEGREE, 90.0 * DEGREE, 0.1, 0.1)


def test_azimuth_elevation_angles_are_azimuth_and_elevation() -> None:
    azimuth, elevation = np.array([0.0, 1.0, 3.0, -2.0]), np.array([0.1, 0.8, 1.2, 1.5])
    found = azimuth_elevation(ROUND, HALF).on_target(direction_cosines(azimuth, elevation))
    np.testing.assert_allclose(found, [azimuth, elevation], rtol=0, atol=1e-13)


def test_x_y_angles() -> None:
    mount = x_y(LEVEL, LEVEL)  # X axis northwards
    # zenith; 30° towards the east; 30° towards the north; the same two leans one after the other
    azimuth = np.array([0.0, 90.0, 0.0]) * DEGREE
    elevation = np.array([90.0, 60.0, 60.0]) * DEGREE
    found = mount.on_target(direction_cosines(azimuth, elevation))
    np.testing.assert_allclose(
        np.degrees(found), [[0.0, 30.0, 0.0], [0.0, 0.0, 30.0]], rtol=0, atol=1e-12
    )
    eastwards = x_y(LEVEL, LEVEL, axis_azimuth_rad=90.0 * DEGREE)
    _, y = eastwards.on_target(direction_cosines(np.array([90.0]) * DEGREE, np.array([0.0])))
    np.testing.assert_allclose(np.degrees(y), [90.0], rtol=1e-12)


def test_a_tilted_mount_has_its_keyhole_where_it_leans() -> None:
    mount = azimuth_elevation(ROUND, HALF, tilt_rad=7.0 * DEGREE, tilt_towards_rad=110.0 * DEGREE)
    _, secondary = mount.on_target(
        direction_cosines(np.array([110.0, 20.0]) * DEGREE, np.array([83.0, 0.0]) * DEGREE)
    )
    np.testing.assert_allclose(np.degrees(secondary), [90.0, 0.0], rtol=0, atol=1e-5)
    # the level axis at a right angle to the lean keeps its azimuth
    primary, _ = mount.on_target(direction_cosines(np.array([20.0 * DEGREE]), np.array([0.0])))
    np.testing.assert_allclose(np.degrees(primary), [20.0], rtol=1e-12)


MOUNTS = [
    azimuth_elevation(ROUND, OVER),
    azimuth_elevation(ROUND, OVER, 0.2, 1.0),
    x_y(ROUND, OVER, 0.4),
]


@given(
    which=st.sampled_from(range(3)),
    azimuth=st.floats(0.0, 6.28),
    elevation=st.floats(0.0, 1.57),
    primary=st.floats(-4.7, 4.7),
)
@settings(max_examples=100, deadline=None)
def test_the_secondary_makes_the_best_of_the_primary(
    which: int, azimuth: float, elevation: float, primary: float
) -> None:
    mount = MOUNTS[which]
    direction = direction_cosines(np.array(azimuth), np.array(elevation))
    angle = np.array(primary)
    best = mount.secondary_for(direction, angle)
    assert OVER.lower_rad <= best <= OVER.upper_rad
    others = np.linspace(OVER.lower_rad, OVER.upper_rad, 721)
    errors = mount.error(
        np.repeat(direction[:, None], others.size, axis=1), np.full(others.size, primary), others
    )
    assert mount.error(direction, angle, best) <= errors.min() + 1e-9


@pytest.mark.parametrize("mount", MOUNTS)
def test_both_ways_round(mount: Mount) -> None:
    random = np.random.default_rng(5)
    direction = random.normal(size=(3, 100))
    direction /= np.linalg.norm(direction, axis=0)
    primary, secondary = mount.on_target(direction)
    np.testing.assert_allclose(mount.direction(primary, secondary), direction, rtol=0, atol=1e-14)
    flipped = mount.direction(primary + np.pi, np.pi - secondary)
    np.testing.assert_allclose(flipped, direction, rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ((1.0, 1.0, 0.1, 0.1), "below"),
        ((0.0, 1.0, 0.0, 0.1), "> 0"),
        ((0.0, np.inf, 0.1, 0.1), "finite"),
    ],
)
def test_axis_limits_that_cannot_be(
    numbers: tuple[float, float, float, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        AxisLimits(*numbers)


def test_axes_that_are_none() -> None:
    with pytest.raises(InputError, match="right angles"):
        Mount(np.ones((3, 3)), ROUND, HALF)


@pytest.mark.parametrize(("kind", "axis"), [("azimuth_elevation", "elevation"), ("x_y", "Y")])
def test_a_mount_of_a_mission_says_which_axis_reaches_too_far(kind: str, axis: str) -> None:
    primary, secondary = AxisSpec.examples
    with pytest.raises(InputError, match=rf"\({axis}\): expected stops from -90° to 180°, got 0° "
                       "and 200°"):  # fmt: skip
        validate(
            MountSpec,
            {"name": "dish", "kind": kind, "primary": primary,
             "secondary": {**secondary, "upper_deg": 200}},
            where="mounts[0]",
        )  # fmt: skip
