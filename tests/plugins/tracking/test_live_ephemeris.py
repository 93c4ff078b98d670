"""``hillsphere track`` along an ephemeris: its span is searched, and its frame is turned."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import ConstantOrientation
from hillsphere.cli.endings import run
from hillsphere.errors import InputError, PropagationError
from hillsphere.formats.oem import OemSegment, write_oem
from hillsphere.model.earth.rotation import to_earth_fixed
from hillsphere.time import Epoch
from hillsphere_tracking.ephemeris_orbit import EphemerisOrbit, ephemeris_orbits_of
from hillsphere_tracking.live.coming_pass import NominalPass, next_pass
from hillsphere_tracking.live.sky import Place
from hillsphere_tracking.passes.masks import HorizonMask
from hillsphere_tracking.satellites import orbits_of

TLE = """ISS (ZARYA)
1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
"""
(SGP4,) = orbits_of(TLE, "tle")
UT1 = ConstantOrientation(-0.17258)
PLACE = Place(Station("station", np.radians(-2.18), np.radians(-44.26), 39.0), HorizonMask())
RISE = Epoch.parse("2019-12-09T23:05:04", "UTC")
ORIGIN = Epoch(SGP4.epoch.day, SGP4.epoch.fraction, "UTC")
AT_RISE_S = RISE.seconds_since(ORIGIN)


def message(begin_s: float, end_s: float, frame: str = "TEME") -> str:
    """Return SGP4's states between two times after the rise, at steps of 30 s."""
    t = AT_RISE_S + np.arange(begin_s, end_s + 1.0, 30.0)
    x = SGP4.states(t)
    if frame == "ITRF":
        x = to_earth_fixed("teme", x, ORIGIN, t, UT1)
    return write_oem([OemSegment("ISS", "1998-067A", "EARTH", frame, ORIGIN, t, x)])


def orbit(begin_s: float, end_s: float, frame: str = "TEME") -> EphemerisOrbit:
    return ephemeris_orbits_of(message(begin_s, end_s, frame), "iss.oem")[0]


def coming(of: object, period_s: float = 1.0, within_s: float = 86400.0) -> NominalPass:
    return next_pass(of, PLACE, RISE, UT1, period_s, within_s)  # type: ignore[arg-type]


WHOLE = coming(SGP4, within_s=3600.0)


@pytest.mark.parametrize("frame", ["TEME", "ITRF"])
def test_a_short_ephemeris_has_the_pass_of_its_elements(frame: str) -> None:
    """ITRF without UT1 - UTC = -0.17 s would be off by 80 m at 7.3e-5 rad/s, 0.01° of the sky."""
    source = orbit(-600.0, 1200.0, frame).turned_by(UT1)
    got = coming(source)
    np.testing.assert_array_equal(got.times_s, WHOLE.times_s)
    assert (got.up, got.cut) == (WHOLE.up, False)
    np.testing.assert_allclose(got.elevation_rad, WHOLE.elevation_rad, atol=1e-7)


def test_an_ephemeris_that_begins_or_ends_within_a_pass_gives_its_part() -> None:
    ending = coming(orbit(-600.0, 180.0))
    assert ending.cut
    assert ending.times_s[-1] == 180.0 < WHOLE.times_s[WHOLE.up.stop - 1]
    assert ending.up.stop == ending.times_s.size
    late = coming(orbit(120.0, 1200.0))
    assert not late.cut
    assert late.times_s[0] >= 120.0
    assert late.times_s[-1] == pytest.approx(WHOLE.times_s[-1], abs=1.0)


def test_no_state_or_no_rise_within_the_search_names_its_option() -> None:
    with pytest.raises(PropagationError, match=r"covers 2019-12-09T20.*within 24 h \(--within\)"):
        coming(orbit(-10800.0, -9000.0))
    message = (
        r"within 24 h \(--within\) of 2019-12-09T23:05:04 UTC, of which its orbit covers "
        "2019-12-09T23:35:04 to .*elements and station$"
    )
    with pytest.raises(InputError, match=message):
        coming(orbit(1800.0, 3600.0))
    with pytest.raises(InputError, match="look further ahead with --within"):
        next_pass(SGP4, PLACE, RISE.after(900.0), UT1, 1.0, 600.0)
    with pytest.raises(InputError, match="7 periods of 10 s, expected 8 at least"):
        coming(orbit(-600.0, 60.0), 10.0)


def test_the_command_takes_an_ephemeris_and_the_age_of_elements(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "iss.oem").write_text(message(-600.0, 180.0))
    (tmp_path / "iss.tle").write_text(TLE)
    t = np.arange(20.0, 40.0)
    angles = np.degrees([np.interp(t, WHOLE.times_s, a)
                         for a in (WHOLE.azimuth_rad, WHOLE.elevation_rad)])  # fmt: skip
    rows = zip(RISE.isot(t, 3), *angles, strict=True)
    (tmp_path / "m.csv").write_text("".join(f"{when},{a:.4f},{h:.4f}\n" for when, a, h in rows))
    place = ["--latitude", "-2.18", "--longitude", "-44.26", "--height", "39"]
    usual = [*place, "--ut1-minus-utc", "-0.17258", "--replay", "--speed", "0", "--period", "4"]
    command = ["track", str(tmp_path / "m.csv"), *usual, "--elements"]
    assert run([*command, str(tmp_path / "iss.oem")]) == 0
    out, err = capsys.readouterr()
    assert "the orbit of ISS ends before the satellite sets" in err
    assert len(out.splitlines()) > 30
    assert run([*command, str(tmp_path / "iss.tle")]) == 0
    assert "elements" not in capsys.readouterr().err
    assert run([*command, str(tmp_path / "iss.tle"), "--oldest", "0.1"]) == 0
    assert "0 days away from the span, more than 0.1" in capsys.readouterr().err
    assert run([*command, str(tmp_path / "iss.tle"), "--oldest", "0"]) == 2
    assert "--oldest must be > 0" in capsys.readouterr().err
