"""Tracking data messages as they arrive, what the writer refuses, and damage at random places."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.formats.tdm import Series, TdmMeta, TdmSegment, angle_series, read_tdm, write_tdm
from hillsphere.formats.tdm_reading import records_and_faults
from hillsphere.time import Epoch
from hillsphere_tracking.live.angle_pairs import PairedAngles

KVN = """CCSDS_TDM_VERS = 2.0
COMMENT by hand
CREATION_DATE = 2026-11-21T10:00:00
ORIGINATOR = TEST
META_START
COMMENT a pass
TIME_SYSTEM = UTC
PARTICIPANT_1 = ALCANTARA
PARTICIPANT_2 = SCD1
MODE = SEQUENTIAL
PATH = 2,1
RANGE_UNITS = km
ANGLE_TYPE = AZEL
META_STOP

DATA_START
ANGLE_1 = 2026-11-21T09:00:00.000Z 359.5
ANGLE_2 = 2026-11-21T09:00:00.000Z 5.25
RANGE = 2026-11-21T09:00:00.000Z 2500.125
TRANSMIT_FREQ_1 = 2026-11-21T09:00:00.000Z 2.1e9
ANGLE_1 = 2026-325T09:00:01.5 -0.25
ANGLE_2 = 2026-325T09:00:01.5 90
DOPPLER_INSTANTANEOUS = 2026-11-21T09:00:01.5 -5.5
DATA_STOP
"""
XML = """<?xml version="1.0" encoding="UTF-8"?>
<ndm:tdm xmlns:ndm="urn:ccsds:schema:ndmxml" id="CCSDS_TDM_VERS" version="2.0">
<header><COMMENT>by hand</COMMENT><CREATION_DATE>2026-11-21T10:00:00</CREATION_DATE>
<ORIGINATOR>TEST</ORIGINATOR></header>
<body><segment>
<metadata><TIME_SYSTEM>UTC</TIME_SYSTEM>
<PARTICIPANT_1>ALCANTARA</PARTICIPANT_1><PARTICIPANT_2>SCD1</PARTICIPANT_2>
<MODE>SEQUENTIAL</MODE><PATH>2,1</PATH><ANGLE_TYPE>AZEL</ANGLE_TYPE></metadata>
<data>
<observation><EPOCH>2026-11-21T09:00:00</EPOCH><ANGLE_1>359.5</ANGLE_1></observation>
<observation><EPOCH>2026-11-21T09:00:00</EPOCH><ANGLE_2>5.25</ANGLE_2></observation>
<observation><EPOCH>2026-11-21T09:00:00</EPOCH><RANGE>2500.125</RANGE></observation>
<observation><EPOCH>2026-11-21T09:00:01.5</EPOCH><ANGLE_1>-0.25</ANGLE_1></observation>
<observation><EPOCH>2026-11-21T09:00:01.5</EPOCH><ANGLE_2>90</ANGLE_2></observation>
<observation><EPOCH>2026-11-21T09:00:01.5</EPOCH>
<DOPPLER_INSTANTANEOUS>-5.5</DOPPLER_INSTANTANEOUS></observation>
</data></segment></body></ndm:tdm>
"""


def test_records_come_as_soon_as_their_line_is_there() -> None:
    read: list[int] = []

    def lines(text: str) -> Iterator[str]:
        for number, line in enumerate(text.splitlines(keepends=True), start=1):
            read.append(number)
            yield line

    for text, first in ((KVN, 17), (XML, 10)):
        read.clear()
        pairing = PairedAngles()
        records = records_and_faults(lines(text))
        one, other = next(records), next(records)
        assert not isinstance(one, InputError)
        assert not isinstance(other, InputError)
        assert read[-1] == first + 1
        assert pairing.add(one) is None
        pair = pairing.add(other)
        assert pair is not None
        assert_allclose(np.degrees(pair.azimuth_rad), 359.5, rtol=1e-14)


def test_keyword_after_keyword_is_paired_too() -> None:
    lines = KVN.splitlines()
    order = [*lines[:16], lines[16], lines[20], lines[17], lines[21], "DATA_STOP"]
    (segment,) = read_tdm("\n".join(order))
    assert_allclose(np.degrees(segment.azimuth_rad), [359.5, -0.25], rtol=1e-14)
    assert_allclose(np.degrees(segment.elevation_rad), [5.25, 90.0], rtol=1e-14)


def test_corrections_are_added_to_what_is_corrected_only() -> None:
    given = "CORRECTION_ANGLE_2 = -0.25\nCORRECTION_RANGE = 1\nCORRECTIONS_APPLIED = NO\nMETA_STOP"
    (segment,) = read_tdm(KVN.replace("META_STOP", given))
    assert_allclose(segment.series["RANGE"].values, [2500125.0], rtol=1e-14)
    assert_allclose(segment.corrected("RANGE").values, [2501125.0], rtol=1e-14)
    assert_allclose(np.degrees(segment.elevation_rad), [5.0, 89.75], rtol=1e-14)
    (segment,) = read_tdm(KVN.replace("META_STOP", given.replace("= NO", "= YES")))
    assert_allclose(segment.corrected("RANGE").values, [2500125.0], rtol=1e-14)
    assert_allclose(np.degrees(segment.elevation_rad), [5.25, 90.0], rtol=1e-14)


META = TdmMeta(("CUIABA", "SCD1"), (2, 1), mode="SEQUENTIAL", angle_type="AZEL")


def made(count: int = 3, meta: TdmMeta = META, **series: Series) -> TdmSegment:
    t = np.arange(float(count)) * 0.25
    azimuth, elevation = np.linspace(0.0, 3.5, count), np.linspace(-0.1, 0.5 * np.pi, count)
    given = {
        **angle_series(t, azimuth, elevation), "RANGE": Series(t[:2], np.array([1e6, 2e6])),
        **series,
    }  # fmt: skip
    return TdmSegment(meta, Epoch.parse("2016-12-31T23:59:59", "UTC"), given)


@pytest.mark.parametrize("encoding", ["kvn", "xml"])
def test_a_pass_over_a_leap_second_comes_back(encoding: str) -> None:
    segment = made(9)
    when = datetime(2026, 1, 2, tzinfo=UTC)
    text = write_tdm([segment, segment], created=when, encoding=encoding)
    assert "2026-01-02T00:00:00" in text
    assert "2016-12-31T23:59:60" in text
    back, again = read_tdm(text)
    assert back.meta.participants == again.meta.participants == META.participants
    for name, one in segment.series.items():
        assert_allclose(back.series[name].t_s, one.t_s, rtol=0.0, atol=1e-6)
        assert_allclose(back.series[name].values, one.values, rtol=1e-15, atol=0.0)


@pytest.mark.parametrize(
    ("segment", "message"),
    [
        (made(ANGLE_2=Series(np.array([0.0, 1.0, 1.0 + 1e-12]), np.zeros(3))), "time"),
        (made(ANGLE_2=Series(np.array([0.0, np.nan, 1.0]), np.zeros(3))), "finite"),
        (made(ANGLE_2=Series(np.zeros(2), np.zeros(3))), "shape"),
        (made(ANGLE_2=Series(np.arange(3.0), np.array([0.0, np.nan, 1.0]))), "finite"),
        (made(meta=TdmMeta(("A=B\nC",), mode="SEQUENTIAL", angle_type="AZEL")), "line"),
        (made(meta=TdmMeta(("A",), (2,), mode="SEQUENTIAL", angle_type="AZEL")), "PATH"),
        (made(meta=TdmMeta(("A",), (), "TAI", mode="SEQUENTIAL", angle_type="AZEL")), "TAI"),
        (made(WEIGHT=Series(np.zeros(1), np.zeros(1))), "WEIGHT"),
    ],
)
def test_writes_nothing_that_it_would_not_read(segment: TdmSegment, message: str) -> None:
    with pytest.raises(InputError, match=message):
        write_tdm([segment])


def test_a_message_has_a_segment() -> None:
    with pytest.raises(InputError, match="segment"):
        write_tdm([])


@settings(max_examples=60, deadline=None)
@given(st.integers(0, len(KVN)), st.integers(0, 40), st.text(max_size=8), st.booleans())
def test_damage_is_told_or_harmless(start: int, length: int, put: str, xml: bool) -> None:
    whole = XML if xml else KVN
    text = whole[:start] + put + whole[start + length :]
    try:
        found = read_tdm(text, "f")
    except InputError as error:
        assert str(error).startswith("f:")  # noqa: PT017 - either outcome is right
    else:
        for part in found:
            assert all(np.isfinite(one.values).all() for one in part.series.values())


def test_an_elevation_beyond_the_zenith_is_turned_by_lenient_reading_only() -> None:
    """A mount that went over the top has the opposite azimuth and 180° minus the elevation."""
    text = KVN.replace("00.000Z 5.25", "00.000Z 120.5")
    with pytest.raises(InputError, match=r"ANGLE_2 must be from -90 to 90°, got 120.5, as a mount"):
        read_tdm(text)
    with pytest.warns(UserWarning, match="are turned, with the opposite azimuth"):
        (segment,) = read_tdm(text, lenient=True)
    assert_allclose(np.degrees(segment.elevation_rad), [59.5, 90.0])
    assert_allclose(np.degrees(segment.azimuth_rad), [179.5, -0.25])
    assert_allclose(np.degrees(segment.series["ANGLE_2"].values), [120.5, 90.0])  # as it stands
    for encoding in ("kvn", "xml"):  # written as strict reading allows
        (again,) = read_tdm(write_tdm([segment], encoding=encoding))
        assert_allclose(np.degrees(again.series["ANGLE_2"].values), [59.5, 90.0])
        assert_allclose(again.azimuth_rad, segment.azimuth_rad)
    corrected = replace(
        segment,
        meta=replace(
            segment.meta, corrections={"CORRECTION_ANGLE_2": 1e-3}, corrections_applied=False
        ),
    )
    with pytest.raises(InputError, match="CORRECTION_ANGLE_2 that is not applied"):
        write_tdm([corrected])
    with pytest.raises(InputError, match="from -90 to 90°, got 200"):
        read_tdm(KVN.replace("00.000Z 5.25", "00.000Z 200"), lenient=True)


def test_gps_is_the_scale_of_the_time_module() -> None:
    """One instant in GPS and in TAI, 19 s ahead by definition (IS-GPS-200, section 3.3.4)."""
    of_system = {}
    for system, second in (("GPS", "00"), ("TAI", "19")):
        text = KVN.replace("UTC", system).replace(".000Z", "")
        text = text.replace("T09:00:00", f"T09:00:{second}").replace("09:00:01.5", "09:01:01.5")
        (of_system[system],) = read_tdm(text)
    assert of_system["GPS"].epoch.scale == "GPS"
    assert abs(of_system["GPS"].epoch.seconds_since(of_system["TAI"].epoch)) < 1e-9
    assert "2026-11-21T09:00:00.000000" in write_tdm([of_system["GPS"]])
