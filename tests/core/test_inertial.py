"""From the rotating frame of a moon to inertial axes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hillsphere.errors import InputError
from hillsphere.model.bodies import Moon, MoonSpec
from hillsphere.model.inertial import RotatingFrame
from hillsphere.time import Epoch

PHOBOS = {
    "name": "phobos",
    "primary_gm_km3_s2": 42828.37,
    "semi_major_axis_km": 9377.0,
    # Archinal et al. 2018, table 2, without periodic terms
    "pole_right_ascension_deg": 317.67071657,
    "pole_declination_deg": 52.88627266,
    "prime_meridian_deg": 35.18774440,
    "rotation_rate_deg_d": 1128.84475928,
}


def _frame(epoch: str = "2000-01-01T12:00:00") -> RotatingFrame:
    moon = Moon(MoonSpec.model_validate(PHOBOS))
    assert moon.orientation is not None
    return RotatingFrame(
        moon.orientation,
        Epoch.parse(epoch),
        moon.mean_motion_rad_s,
        np.pi,
        moon.semi_major_axis_m,
    )


def test_longitude_zero_at_the_epoch_is_where_the_iau_puts_it() -> None:
    """Archinal et al. 2018: Rz(−W) Rx(δ−90°) Rz(−α−90°) takes the ICRF to the body's axes."""
    to_body = Rotation.from_euler(
        "ZXZ", [317.67071657 + 90.0, 90.0 - 52.88627266, 35.18774440], degrees=True
    )
    expected = to_body.apply([1.0, 0.0, 0.0])  # of the body's x axis in the ICRF
    axes = _frame().axes(np.zeros(1))[:, :, 0]
    # longitude 0 faces the primary, that is it lies along −x of the rotating frame
    np.testing.assert_allclose(-axes[:, 0], expected, rtol=0, atol=1e-14)
    pole = np.radians([317.67071657, 52.88627266])
    north = [np.cos(pole[1]) * np.cos(pole[0]), np.cos(pole[1]) * np.sin(pole[0]), np.sin(pole[1])]
    np.testing.assert_allclose(axes[:, 2], north, rtol=0, atol=1e-15)


def test_the_meridian_is_carried_to_the_epoch_at_the_published_rate() -> None:
    early, late = _frame(), _frame("2000-01-02T12:00:00")
    turn = late.axes(np.zeros(1))[:, :, 0] @ early.axes(np.zeros(1))[:, :, 0].T
    angle = Rotation.from_matrix(turn).magnitude()
    assert angle == pytest.approx(np.radians(1128.84475928 - 1080.0), abs=1e-12)


@pytest.mark.parametrize("centre", ["moon", "primary"])
def test_velocities_are_the_derivatives_of_positions(centre: str) -> None:
    frame, h = _frame(), 1.0
    t = np.array([-h, 0.0, h]) + 5000.0
    place, speed = np.array([3e4, -5e4, 2e4]), np.array([3.0, 8.0, -2.0])
    x = np.concatenate([place[:, None] + speed[:, None] * (t - 5000.0), np.tile(speed, (3, 1)).T])
    inertial = frame.to_inertial(x, t, centre)
    slope = (inertial[:3, 2] - inertial[:3, 0]) / (2.0 * h)
    # the cubic term n³·a/6 of the difference quotient
    np.testing.assert_allclose(inertial[3:, 1], slope, rtol=0, atol=4e-5)


def test_a_moon_at_rest_in_its_frame_moves_on_its_orbit() -> None:
    frame = _frame()
    t = np.linspace(0.0, 1e5, 7)
    x = frame.to_inertial(np.zeros((6, 7)), t, "primary")
    np.testing.assert_allclose(np.linalg.norm(x[:3], axis=0), 9.377e6, rtol=1e-14)
    speed = np.sqrt(42828.37e9 / 9.377e6)
    np.testing.assert_allclose(np.linalg.norm(x[3:], axis=0), speed, rtol=1e-14)


def test_wrong_use_is_refused() -> None:
    with pytest.raises(InputError, match="centre"):
        _frame().to_inertial(np.zeros((6, 1)), np.zeros(1), "mars")
    with pytest.raises(InputError, match=r"\(6, 2\)"):
        _frame().to_inertial(np.zeros((6, 1)), np.zeros(2))
    with pytest.raises(ValueError, match=r"missing: prime_meridian_deg \(or _rad\)"):
        MoonSpec.model_validate({k: v for k, v in PHOBOS.items() if k != "prime_meridian_deg"})
