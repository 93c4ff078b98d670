"""Initial states and covariances from messages, against rotations and differences."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.engine.start_messages import start_of_message
from hillsphere.engine.start_specs import StartSpec
from hillsphere.engine.start_states import with_placed_start
from hillsphere.errors import InputError
from hillsphere.formats.oem import OemCovariance, OemSegment, write_oem
from hillsphere.formats.opm import Opm, write_opm
from hillsphere.model.frame_motion import frame_motion
from hillsphere.plugins import validate
from hillsphere.time import Epoch

POLE = {"pole_right_ascension_deg": 317.67, "pole_declination_deg": 52.88,
        "prime_meridian_deg": 35.18}  # fmt: skip
EPOCH = Epoch.parse("2027-06-01T00:00:00")
X = np.array([3e4, -5e4, 2e4, 3.0, 8.0, -2.0])
SIGMAS = np.array([10.0, 20.0, 30.0, 1e-3, 2e-3, 3e-3])


def plant(**pole: float) -> Any:
    body = create("body", "moon", name="phobos", primary_name="mars", primary_gm_km3_s2=42828.37,
                  semi_major_axis_km=9376, **pole)  # fmt: skip
    return create("plant", "hill", body=body, gravity=create("gravity", "point_mass", gm_m3_s2=7e5))


PLANT = plant(**POLE)
INERTIAL = frame_motion(PLANT, EPOCH, np.zeros(1), {}).to_inertial(X[:, None])[:, 0]


def opm(**keys: Any) -> str:
    given = {"covariance": np.diag(SIGMAS**2), **keys}
    return write_opm(Opm("A", "1", "PHOBOS", "ICRF", EPOCH, INERTIAL, **given))


def test_an_opm_is_a_start(tmp_path: Path) -> None:
    """To the shortest digits of the message, of which rounding in km is 1e-11 m."""
    path = tmp_path / "start.opm"
    path.write_text(opm())
    spec: Any = validate(StartSpec, {"message": {"file": str(path)}}, where="start")
    placed = with_placed_start(spec, PLANT)
    np.testing.assert_allclose(placed.position_m, X[:3], atol=1e-6)
    np.testing.assert_allclose(placed.velocity_m_s, X[3:], atol=1e-9)


@pytest.mark.parametrize("frame", ["", "RTN", "TNW"])
def test_the_covariance_is_that_of_turned_samples(frame: str, tmp_path: Path) -> None:
    """Each standard deviation added along its own axis, turned like any state, and summed up."""
    path = tmp_path / "start.opm"
    path.write_text(opm(covariance_frame=frame))
    got = start_of_message(path, PLANT).covariance
    r, v = INERTIAL[:3], INERTIAL[3:]
    normal = np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    axes = np.eye(3)
    if frame:
        first = (r if frame == "RTN" else v) / np.linalg.norm(r if frame == "RTN" else v)
        axes = np.column_stack([first, np.cross(normal, first), normal])
    motion = frame_motion(PLANT, EPOCH, np.zeros(1), {})
    expected = np.zeros((6, 6))
    for k, sigma in enumerate(SIGMAS):
        step = np.zeros(6)
        step[3 * (k // 3) : 3 * (k // 3) + 3] = axes[:, k % 3] * sigma
        moved = motion.from_inertial((INERTIAL + step)[:, None])[:, 0] - X
        expected += np.outer(moved, moved)
    assert got is not None
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(got / scale, expected / scale, atol=1e-7)


def test_a_state_of_an_ephemeris_is_a_start(tmp_path: Path) -> None:
    t = np.arange(0.0, 601.0, 60.0)
    still = np.repeat(INERTIAL[:, None], t.size, axis=1)
    still[:3] += still[3:] * t
    matrix = OemCovariance(120.0, np.diag(SIGMAS**2))
    segment = OemSegment("A", "1", "PHOBOS", "ICRF", EPOCH, t, still, covariances=(matrix,))
    path = tmp_path / "a.oem"
    path.write_text(write_oem([segment]))
    first = start_of_message(path, PLANT)
    np.testing.assert_allclose(first.x, X, atol=2e-6)
    assert first.covariance is None
    later = start_of_message(path, PLANT, epoch="2027-06-01T00:02:00")
    motion = frame_motion(PLANT, EPOCH.after(120.0), np.zeros(1), {})
    np.testing.assert_allclose(later.x, motion.from_inertial(still[:, 2:3])[:, 0], atol=2e-6)
    assert later.covariance is not None
    two = replace(segment, object_name="B")
    path.write_text(write_oem([segment, two]))
    with pytest.raises(InputError, match=r"a.oem: OBJECT_NAME: expected one object, got A, B"):
        start_of_message(path, PLANT)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    path = tmp_path / "start.opm"
    path.write_text(opm())
    with pytest.raises(InputError, match="pole_right_ascension_deg"):
        start_of_message(path, plant())
    path.write_text(opm().replace("PHOBOS", "EARTH"))
    with pytest.raises(
        InputError, match=r"start.opm: CENTER_NAME: expected PHOBOS or MARS.* got EARTH"
    ):
        start_of_message(path, PLANT)
    with pytest.raises(InputError, match="cannot be read"):
        start_of_message(tmp_path / "none.opm", PLANT)
