"""Epochs: calendar, leap seconds, scales."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hillsphere.base.orientation import OrientationTable
from hillsphere.errors import InputError
from hillsphere.time import J2000, SCALES, Epoch

UNIFORM = ("TDB", "TT", "TAI", "GPS", "TCB", "TCG")


def test_j2000_is_noon_of_the_first_of_january() -> None:
    assert J2000.isot(np.array([0.0]), 3) == ["2000-01-01T12:00:00.000"]
    assert Epoch.parse("2000-01-01T12:00:00").seconds_since(J2000) == 0.0


def test_the_leap_second_at_the_end_of_2016() -> None:
    """IERS Bulletin C 52: 2016 December 31 ended with 23:59:60 UTC."""
    epoch = Epoch.parse("2016-12-31T23:59:59", "UTC")
    assert epoch.isot(np.array([0.0, 1.0, 2.0]), 0) == [
        "2016-12-31T23:59:59",
        "2016-12-31T23:59:60",
        "2017-01-01T00:00:00",
    ]
    after = Epoch.parse("2017-01-01T00:00:00", "UTC")
    assert after.seconds_since(epoch) == pytest.approx(2.0, abs=1e-9)
    assert Epoch.parse("2016-12-31T23:59:60.5", "UTC").seconds_since(epoch) == pytest.approx(
        1.5, abs=1e-9
    )


def test_offsets_between_scales() -> None:
    """TT − TAI = 32.184 s by definition; TAI − UTC = 37 s since 2017; |TDB − TT| < 2 ms."""
    utc = Epoch.parse("2020-03-01", "UTC")
    as_utc = {scale: utc.to(scale).isot(np.array([0.0]), 3)[0] for scale in SCALES}
    assert as_utc["TAI"] == "2020-03-01T00:00:37.000"
    assert as_utc["TT"] == "2020-03-01T00:01:09.184"
    tt, tdb = utc.to("TT"), utc.to("TDB")
    difference = ((tdb.day - tt.day) + (tdb.fraction - tt.fraction)) * 86400.0
    assert 1e-4 < abs(difference) < 2e-3


def test_gps_time_is_19_s_behind_tai() -> None:
    """IS-GPS-200: no leap seconds since 1980, so that GPS − UTC is 18 s since 2017."""
    utc = Epoch.parse("2016-12-31T23:59:60.5", "UTC")
    gps = utc.to("GPS")
    assert gps.isot(np.zeros(1), 3) == ["2017-01-01T00:00:17.500"]
    assert Epoch.parse("1980-01-06", "GPS").to("UTC").isot(np.zeros(1), 3) == [
        "1980-01-06T00:00:00.000"
    ]
    assert gps.to("TAI").seconds_since(utc.to("TAI")) == 0.0


def test_coordinate_times_by_their_definitions() -> None:
    """TCG: IAU 2000 B1.9, L_G = 6.969290134e-10; TCB: IAU 2006 B3, L_B = 1.550519768e-8."""
    tt = Epoch.parse("2027-06-01", "TT")
    days = tt.day + tt.fraction - 2443144.5003725
    tcg = tt.to("TCG")
    ahead = ((tcg.day - tt.day) + (tcg.fraction - tt.fraction)) * 86400.0
    # exact: TT = TCG − L_G (TCG − T0)
    assert ahead == pytest.approx(6.969290134e-10 / (1 - 6.969290134e-10) * days * 86400, abs=1e-9)
    tdb, tcb = tt.to("TDB"), tt.to("TCB")
    ahead = ((tcb.day - tdb.day) + (tcb.fraction - tdb.fraction)) * 86400.0
    rate = 1.550519768e-8
    assert ahead == pytest.approx((rate * days * 86400 + 6.55e-5) / (1 - rate), abs=1e-7)


def test_ut1_follows_the_table_and_ends_with_it() -> None:
    utc = Epoch.parse("2020-05-01T12:00:00", "UTC")
    ut1 = utc.to("UT1")
    table = OrientationTable.installed()
    expected = float(table.at(utc, np.zeros(1)).ut1_minus_tai_s[0]) + 37.0
    difference = ((ut1.day - utc.day) + (ut1.fraction - utc.fraction)) * 86400.0
    assert difference == pytest.approx(expected, abs=1e-9)
    assert abs(difference + 0.24) < 0.01  # IERS Bulletin A, May 2020
    assert abs(ut1.to("UTC").seconds_since(utc)) < 1e-10
    # a day of UT1 is as long as the table's UT1 − TAI changes
    later = Epoch.parse(ut1.isot(np.array([86400.0]), 9)[0], "UT1")
    assert later.seconds_since(ut1) == pytest.approx(86400.0, abs=2e-9)
    for text in ("1960-01-01", "2090-01-01"):
        with pytest.raises(InputError, match="UT1 is known from 1973-01-02 to"):
            Epoch.parse(text, "UT1").to("UTC")
        with pytest.raises(InputError, match="use another time scale"):
            Epoch.parse(text, "UTC").to("UT1")


@given(
    st.floats(-1e9, 2e9, allow_nan=False),
    st.sampled_from(UNIFORM),
    st.sampled_from(UNIFORM),
)
def test_a_journey_through_another_scale_returns(seconds: float, first: str, second: str) -> None:
    days = 0.5 + seconds / 86400.0
    epoch = Epoch(2451544.5 + np.floor(days), days - float(np.floor(days)), first)
    back = epoch.to(second).to(first)
    assert abs(back.seconds_since(epoch)) < 1e-8


@pytest.mark.parametrize(
    "text",
    ["", "2027", "2027-13-01", "2027-02-30", "2027-06-01T24:00:00", "2027-06-01T12:60",
     "2027-06-01T23:59:60", "2027-06-01T12:00:00Z", "1 June 2027"],
)  # fmt: skip
def test_what_is_no_date_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        Epoch.parse(text)


@pytest.mark.parametrize(
    "text",
    ["2027-06-01T23:59:60", "2016-12-31T12:30:60", "2016-12-31T23:59:61", "2027-06-01T12:30:99"],
)
def test_a_second_60_is_one_of_a_leap_second_only(text: str) -> None:
    """UTC had one at the end of 2016; no other of these minutes has more than 60 seconds."""
    with pytest.raises(InputError, match="no time of day"):
        Epoch.parse(text, "UTC")
    assert Epoch.parse("2016-12-31T23:59:60.5", "UTC").isot(np.zeros(1), 1)[0].endswith(":60.5")


def test_an_unknown_scale_is_refused() -> None:
    with pytest.raises(InputError, match="SCLK"):
        Epoch.parse("2027-06-01", "SCLK")
    with pytest.raises(InputError, match="SCLK"):
        J2000.to("SCLK")
