"""The body ``planet``."""

from __future__ import annotations

from math import inf
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from hillsphere.base.geodetic import WGS84
from hillsphere.base.orientation import OrientationTable
from hillsphere.errors import InputError
from hillsphere.model.earth.planet import Planet
from hillsphere.model.earth.specs import PlanetSpec
from hillsphere.testing.frames import frame
from hillsphere.time import Epoch

EPOCH = Epoch.parse("2020-01-01", "UTC")
NOW = np.zeros(1)


def test_left_to_itself_it_is_the_earth() -> None:
    earth = Planet(PlanetSpec())
    assert earth.name == "earth"
    assert earth.ellipsoid == WGS84
    assert earth.orientation is OrientationTable.installed()


def test_orientation_by_a_constant_or_a_file(tmp_path: Path) -> None:
    constant = Planet(PlanetSpec(orientation="constant", ut1_minus_utc_s=-0.2))
    assert constant.orientation.at(EPOCH, NOW).ut1_minus_tai_s == pytest.approx(-37.2, abs=1e-12)
    rows = [
        f"20 1 1 {mjd:8.2f} I  0.100000 0.000100  0.200000 0.000100  I 0.3000000 0.0000100"
        for mjd in (58849.0, 58850.0)
    ]
    path = tmp_path / "finals.data"
    path.write_text("\n".join(rows), encoding="ascii")
    given = Planet(PlanetSpec(orientation_file=str(path)))
    assert given.orientation.at(EPOCH, NOW).ut1_minus_tai_s == pytest.approx(-36.7, abs=1e-12)
    with pytest.raises(InputError, match="cannot read the Earth orientation file"):
        Planet(PlanetSpec(orientation_file=str(tmp_path / "absent")))


@pytest.mark.parametrize(
    "keys, says",
    [
        ({"orientation": "constant", "orientation_file": "x"}, "goes with orientation = 'iers'"),
        ({"ut1_minus_utc_s": 0.1}, "goes with orientation = 'constant'"),
        ({"orientation": "constant", "ut1_minus_utc_s": 1.0}, "must be ≤ 0.9"),
        ({"inverse_flattening": 1.0}, "must be > 1"),
        ({"inverse_flattening": inf}, "finite"),
        ({"equatorial_radius_km": 0.0}, "must be > 0"),
    ],
)
def test_keys_that_contradict_each_other(keys: dict[str, object], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        PlanetSpec.model_validate(keys)


def test_frames_of_the_earth() -> None:
    assert frame("teme").inertial
    assert frame("gcrs").inertial
    assert not frame("itrf").inertial
    with pytest.raises(InputError, match=r"no frame 'j2000'; known: .*teme, gcrs, itrf"):
        frame("j2000")
