"""UT1 and polar motion."""

from __future__ import annotations

from importlib import import_module
from math import nan
from pathlib import Path

import erfa
import numpy as np
import pytest

from hillsphere.base.orientation import (
    UT1_IS_UTC,
    ConstantOrientation,
    EarthOrientationWarning,
    OrientationTable,
    doubts,
)
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch

NOW = np.zeros(1)
DAY = 86400.0


def _utc(text: str) -> Epoch:
    return Epoch.parse(text, "UTC")


def _row(mjd: float, ut1_utc: float | None, x: float = 0.1, y: float = 0.2, flag: str = "I") -> str:
    """Return a line of finals2000A with values of Bulletin A."""
    head = f"17 1 1 {mjd:8.2f}"
    if ut1_utc is None:
        return head.ljust(187)
    pole = f" {flag} {x:9.6f} 0.000100 {y:9.6f} 0.000100"
    return (head + f"{pole}  {flag}{ut1_utc:10.7f} 0.0000100").ljust(187)


def _file(path: Path, rows: list[str]) -> Path:
    path.write_text("\n".join(rows) + "\n", encoding="ascii")
    return path


def test_the_day_of_skyfields_space_station() -> None:
    """UT1 − UTC of 2019-12-09 16:38:29 UTC by IERS Bulletin B; its value there is −0.17244 s."""
    epoch = _utc("2019-12-09T16:38:29")
    found = OrientationTable.installed().at(epoch, NOW)
    assert found.ut1_minus_tai_s + 37.0 == pytest.approx(-0.17245, abs=5e-5)
    assert abs(found.x_pole_rad[0] / erfa.DAS2R) < 0.3


def test_the_table_is_its_rows_and_linear_between() -> None:
    """Bulletin B of 1973-01-02 and 03 in finals2000A: 0.8075, 0.8044 s; TAI − UTC is 12 s."""
    table = OrientationTable.installed()
    epoch = _utc("1973-01-02T00:00:00")
    found = table.at(epoch, np.array([0.0, 0.5 * DAY, DAY]))
    assert np.allclose(
        found.ut1_minus_tai_s, np.array([0.8075, 0.80595, 0.8044]) - 12.0, rtol=0, atol=1e-9
    )
    assert np.allclose(found.x_pole_rad / erfa.DAS2R, [0.143, 0.142, 0.141], rtol=0, atol=1e-9)
    assert np.allclose(found.y_pole_rad / erfa.DAS2R, [0.137, 0.1355, 0.134], rtol=0, atol=1e-9)


def test_ut1_is_smooth_across_a_leap_second() -> None:
    """At the end of 2016 UT1 − UTC jumps from −0.41 to +0.59 s, UT1 itself does not."""
    before = _utc("2016-12-31T00:00:00")
    t = np.linspace(0.0, 2.0 * DAY, 2001)
    ut1 = OrientationTable.installed().at(before, t).ut1_minus_tai_s
    assert np.abs(np.diff(ut1)).max() < 1e-5
    assert ut1[0] + 36.0 == pytest.approx(-0.4075, abs=1e-3)
    assert ut1[-1] + 37.0 == pytest.approx(0.5905, abs=1e-3)


def test_leap_seconds_of_the_time_library_are_those_announced() -> None:
    """ERFA's list against Bulletin C as it stands in Leap_Second.dat of astropy-iers-data."""
    path = import_module("astropy_iers_data").IERS_LEAP_SECOND_FILE
    rows = np.loadtxt(path, comments="#")
    known = erfa.leap_seconds.get()
    known = known[known["year"] >= 1972]
    assert np.array_equal(rows[:, 3], known["year"])
    assert np.array_equal(rows[:, 4], known["tai_utc"])


def test_beyond_its_end_a_table_warns_and_holds(tmp_path: Path) -> None:
    rows = [_row(57754.0, 0.5910), _row(57755.0, 0.5900, flag="P"), _row(57756.0, None)]
    table = OrientationTable.read(_file(tmp_path / "finals.data", rows))
    epoch = _utc("2017-01-01T00:00:00")
    assert table.observed_to_mjd == 57754.0
    assert table.lapse(epoch, np.array([0.0, DAY])) is None
    beyond = np.array([0.0, 3.0 * DAY])
    sentence = table.lapse(epoch, beyond)
    assert sentence is not None
    assert sentence.startswith("Earth orientation (finals.data) ends on 2017-01-02: UT1 and")
    assert doubts(table, epoch, beyond) == (sentence + ".",)
    assert doubts(table, epoch, np.array([0.0, DAY])) == ()
    with pytest.warns(EarthOrientationWarning, match="ends on 2017-01-02"):
        found = table.at(epoch, beyond)
    assert np.allclose(found.ut1_minus_tai_s, [-36.409, -36.41], rtol=0, atol=1e-9)


def test_before_its_beginning_a_table_refuses() -> None:
    with pytest.raises(InputError, match="begins on 1973-01-02, asked for 1969-07-20"):
        OrientationTable.installed().at(_utc("1969-07-20T20:17:00"), NOW)


@pytest.mark.parametrize(
    "rows, says",
    [
        (["hello"], r"finals.data:1: not a line of finals2000A: 'hello'"),
        ([_row(57754.0, 0.59), _row(57755.0, 0.59, x=3.0)], r"finals.data:2: not a line"),
        ([_row(57754.0, 0.59).replace("0.5900000", "0.59OOOOO")], r":1: not a line"),
        ([_row(57754.0, None)], r"no Earth orientation in it"),
        ([_row(57755.0, 0.59), _row(57754.0, 0.59)], r"needs rising dates"),
        ([_row(57754.0, 0.59), _row(57755.0, -0.4)], r"jumps at 2017-01-02: a leap second that"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, rows: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says):
        OrientationTable.read(_file(tmp_path / "finals.data", rows))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read the Earth orientation file .*nowhere"):
        OrientationTable.read(tmp_path / "nowhere")
    binary = tmp_path / "binary"
    binary.write_bytes(bytes([200, 201]))
    with pytest.raises(InputError, match="cannot read the Earth orientation file"):
        OrientationTable.read(binary)


def _ut1_minus_utc(epoch: Epoch, t: Array) -> Array:
    return UT1_IS_UTC.at(epoch, t).ut1_minus_tai_s


def test_constants_follow_utc_at_the_epoch() -> None:
    t = np.array([0.0, 100.0])
    assert np.allclose(_ut1_minus_utc(_utc("2020-01-01"), t), -37.0, rtol=0, atol=1e-9)
    # the second day has the leap second: UT1 runs through
    assert np.allclose(_ut1_minus_utc(_utc("2016-12-31T23:59:00"), t), -36.0, rtol=0, atol=1e-9)
    assert UT1_IS_UTC.lapse(_utc("2500-01-01"), t) is None


def test_a_verdict_says_that_ut1_is_taken_as_utc() -> None:
    (sentence,) = doubts(UT1_IS_UTC, _utc("2020-01-01"), NOW)
    assert sentence.startswith("UT1 is taken as UTC")
    assert doubts(ConstantOrientation(0.1), _utc("2020-01-01"), NOW) == ()


@pytest.mark.parametrize(
    "values", [{"ut1_minus_utc_s": 1.5}, {"x_pole_rad": 1.0}, {"y_pole_rad": nan}]
)
def test_impossible_constants_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(InputError, match="must be within"):
        ConstantOrientation(**values)
