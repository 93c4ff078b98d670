"""Tracking data messages: what is read, what is refused and where, and that writing comes back."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.time import Epoch
from hillsphere_tracking.tdm import Series, TdmMeta, TdmSegment, read_tdm, write_tdm
from hillsphere_tracking.tdm_records import PairedAngles, tdm_records

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
ANGLE_TYPE = AZEL
RANGE_UNITS = km
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
<observation><EPOCH>2026-11-21T09:00:00</EPOCH><ANGLE_1 units="deg">359.5</ANGLE_1></observation>
<observation><EPOCH>2026-11-21T09:00:00</EPOCH><ANGLE_2>5.25</ANGLE_2></observation>
<observation><EPOCH>2026-11-21T09:00:00</EPOCH><RANGE>2500.125</RANGE></observation>
<observation><EPOCH>2026-11-21T09:00:01.5</EPOCH><ANGLE_1>-0.25</ANGLE_1></observation>
<observation><EPOCH>2026-11-21T09:00:01.5</EPOCH><ANGLE_2>90</ANGLE_2></observation>
<observation><EPOCH>2026-11-21T09:00:01.5</EPOCH>
<DOPPLER_INSTANTANEOUS>-5.5</DOPPLER_INSTANTANEOUS></observation>
</data></segment></body></ndm:tdm>
"""


def changed(old: str, new: str, text: str = KVN) -> str:
    assert old in text
    return text.replace(old, new, 1)


@pytest.mark.parametrize("text", [KVN, KVN.replace("\n", "\r\n"), "\ufeff" + KVN, XML])
def test_reads(text: str) -> None:
    (segment,) = read_tdm(text)
    assert segment.meta.participants == ("ALCANTARA", "SCD1")
    assert segment.meta.path == (2, 1)
    assert segment.meta.station == "ALCANTARA"
    assert segment.epoch == Epoch.parse("2026-11-21T09:00:00", "UTC")
    assert_allclose(segment.t_s, [0.0, 1.5], rtol=0.0, atol=1e-9)
    assert_allclose(np.degrees(segment.azimuth_rad), [359.5, -0.25], rtol=1e-14)
    assert_allclose(np.degrees(segment.elevation_rad), [5.25, 90.0], rtol=1e-14)
    assert set(segment.series) == {"RANGE", "DOPPLER_INSTANTANEOUS"}
    assert_allclose(segment.series["RANGE"].values, [2500125.0], rtol=1e-14)
    assert_allclose(segment.series["DOPPLER_INSTANTANEOUS"].values, [-5500.0], rtol=1e-14)
    assert_allclose(segment.series["DOPPLER_INSTANTANEOUS"].t_s, [1.5], rtol=0.0, atol=1e-9)


def test_keyword_after_keyword_is_paired_too() -> None:
    lines = KVN.splitlines()
    text = "\n".join([*lines[:16], lines[16], lines[20], lines[17], lines[21], lines[23]])
    assert_allclose(np.degrees(read_tdm(text)[0].elevation_rad), [5.25, 90.0], rtol=1e-14)


def test_corrections_are_added_unless_they_are_already() -> None:
    given = "CORRECTION_ANGLE_2 = -0.25\nCORRECTION_RANGE = 1\nCORRECTIONS_APPLIED = NO\nMETA_STOP"
    (segment,) = read_tdm(changed("META_STOP", given))
    assert_allclose(np.degrees(segment.elevation_rad), [5.0, 89.75], rtol=1e-14)
    assert_allclose(segment.series["RANGE"].values, [2501125.0], rtol=1e-14)
    (segment,) = read_tdm(changed("META_STOP", given.replace("= NO", "= YES")))
    assert_allclose(np.degrees(segment.elevation_rad), [5.25, 90.0], rtol=1e-14)


def test_records_come_as_soon_as_their_line_is_there() -> None:
    read: list[int] = []

    def lines(text: str) -> Iterator[str]:
        for number, line in enumerate(text.splitlines(keepends=True), start=1):
            read.append(number)
            yield line

    for text, first in ((KVN, 17), (XML, 10)):
        read.clear()
        pairing = PairedAngles()
        records = tdm_records(lines(text))
        assert pairing.add(next(records)) is None
        assert read[-1] == first
        pair = pairing.add(next(records))
        assert read[-1] == first + 1
        assert pair is not None
        assert_allclose(np.degrees(pair.azimuth_rad), 359.5, rtol=1e-14)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("AZEL", "RADEC", "f.tdm:17: ANGLE_TYPE = RADEC: only azimuth and elevation, AZEL"),
        ("ANGLE_TYPE = AZEL\n", "", r"f.tdm:16: ANGLE_TYPE = \(missing\)"),
        ("359.5", "360.5", "f.tdm:17: ANGLE_1: azimuth must be from -180° to 360°, got 360.5°"),
        ("5.25", "90.01", "f.tdm:18: ANGLE_2: elevation must be from -90° to 90°, got 90.01°"),
        ("5.25", "NaN", "f.tdm:18: ANGLE_2: expected a finite number, got 'NaN'"),
        ("5.25", "1e999", "f.tdm:18: ANGLE_2: expected a finite number"),
        ("5.25", "", "f.tdm:18: ANGLE_2: expected a time and a number"),
        ("09:00:01.5 -0", "09:00:00 -0", "f.tdm:21: ANGLE_1: same time as the record before"),
        ("09:00:01.5 -0", "08:59:58 -0", "f.tdm:21: ANGLE_1: 2 s earlier than the record before"),
        ("325T09:00:01.5 90", "325T09:00:01.6 90", "f.tdm:21: ANGLE_1 has no ANGLE_2"),
        ("325T09:00:01.5 -0", "325T09:00:01.6 -0", "f.tdm:22: ANGLE_2 has no ANGLE_1"),
        ("ANGLE_2 = 2026-325T09:00:01.5 90\n", "", "f.tdm:21: ANGLE_1 has no ANGLE_2"),
        ("2026-325T", "2026-400T", "f.tdm:21: the year 2026 has the days 001 to 365"),
        ("2026-11-21T09:00:00.000Z 35", "today 35", "f.tdm:17: expected a time"),
        ("RANGE_UNITS = km", "RANGE_UNITS = s", "f.tdm:19: RANGE_UNITS = s cannot be read"),
        ("TIME_SYSTEM = UTC", "TIME_SYSTEM = SCLK", "f.tdm:14: TIME_SYSTEM 'SCLK' cannot be read"),
        ("TIME_SYSTEM = UTC\n", "", "f.tdm:13: TIME_SYSTEM '' cannot be read"),
        ("PARTICIPANT_1", "PARTICIPANT_3", "f.tdm:14: the metadata must name PARTICIPANT_1"),
        ("PATH = 2,1", "PATH = 3,1", "f.tdm:14: PATH must list numbers of participants"),
        ("MODE = SEQUENTIAL", "TIME_SYSTEM = TAI", "f.tdm:10: TIME_SYSTEM occurs twice"),
        ("ANGLE_1 = 2026-3", "ANGEL_1 = 2026-3", "f.tdm:21: no data keyword 'ANGEL_1'.*'ANGLE_1'"),
        ("RANGE = ", "RANGE ", "f.tdm:19: expected KEYWORD = value"),
        ("VERS = 2.0", "VERS = 3.0", "f.tdm:1: version '3.0'"),
        ("CCSDS_TDM_VERS = 2.0\n", "", "f.tdm:2: not a tracking data message"),
        ("META_STOP\n", "META_STOP\nFOO = 1\n", "f.tdm:15: FOO is outside"),
        ("META_START\n", "DATA_START\n", "f.tdm:5: DATA_START without metadata"),
        (
            "META_STOP",
            "CORRECTION_ANGLE_1 = 1\nMETA_STOP",
            "f.tdm:18: CORRECTION_ANGLE_1 needs CORRECTIONS_APPLIED",
        ),
    ],
)  # fmt: skip
def test_refuses(old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        read_tdm(changed(old, new), "f.tdm")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("5.25", "91", "f.xml:11: ANGLE_2: elevation must be"),
        ('units="deg"', 'units="rad"', "f.xml:10: ANGLE_1 must be in deg, got 'rad'"),
        ("</data>", "", "f.xml:17: not well-formed XML: mismatched tag"),
        ("<body>", "<!-- ", "f.xml:[0-9]+: not well-formed XML"),
        ("<header>", "<!DOCTYPE x><header>", "f.xml:3: not well-formed XML"),
        ("<ndm:tdm", "<!DOCTYPE x>\n<ndm:tdm", "f.xml:2: a tracking data message must not contain"),
    ],
)
def test_refuses_xml(old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        read_tdm(changed(old, new, XML), "f.xml")


@pytest.mark.parametrize("text", ["", "\n\n", "CCSDS_TDM_VERS = 2.0\n", "<a/>", "\x00", "time,az"])
def test_refuses_what_is_no_message(text: str) -> None:
    with pytest.raises(InputError):
        read_tdm(text)


def test_a_message_without_what_is_read() -> None:
    text = "\n".join(KVN.splitlines()[:16]) + "\nCARRIER_POWER = 2026-11-21T09:00:00 -100\n"
    with pytest.raises(InputError, match="no angles, ranges or Doppler"):
        read_tdm(text)


def segment(count: int = 3) -> TdmSegment:
    t = np.arange(float(count)) * 0.25
    return TdmSegment(
        TdmMeta(("CUIABA", "SCD1"), (2, 1)),
        Epoch.parse("2016-12-31T23:59:59", "UTC"),
        t,
        np.linspace(-0.5, 3.5, count),
        np.linspace(-0.1, 0.5 * np.pi, count),
        {"RANGE": Series(t[:2], np.array([1e6, 2e6]))},
    )


def test_what_is_written_comes_back() -> None:
    made = segment(9)  # over a leap second
    text = write_tdm([made, made], created=datetime(2026, 1, 2, tzinfo=UTC))
    assert "CREATION_DATE = 2026-01-02T00:00:00" in text
    assert "2016-12-31T23:59:60.000000" in text
    back, again = read_tdm(text)
    assert back.meta.participants == again.meta.participants == made.meta.participants
    assert back.meta.path == made.meta.path
    assert_allclose(back.t_s, made.t_s, rtol=0.0, atol=1e-6)
    turned = np.remainder(made.azimuth_rad, 2.0 * np.pi)
    assert_allclose(back.azimuth_rad, turned, rtol=0.0, atol=1e-11)
    assert_allclose(back.elevation_rad, made.elevation_rad, rtol=0.0, atol=1e-11)
    assert_allclose(back.series["RANGE"].values, [1e6, 2e6], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"t_s": np.array([0.0, 1.0, 1.0 + 1e-9])}, "same time as the record before it"),
        ({"t_s": np.array([0.0, np.nan, 1.0])}, "times must be finite"),
        ({"t_s": np.array([0.0, 1.0])}, "must have the same shape"),
        ({"elevation_rad": np.array([0.0, np.nan, 1.0])}, "expected a finite number"),
        ({"elevation_rad": np.array([0.0, 1.6, 1.0])}, "elevation must be"),
        ({"meta": TdmMeta(("A=B",))}, "participant must be one line"),
        ({"meta": TdmMeta(("A",), (2,))}, "PATH must list"),
        ({"meta": TdmMeta(("A",), (), "TAI")}, "epoch in UTC, time system TAI"),
        ({"series": {"MAG": Series(np.zeros(1), np.zeros(1))}}, "'MAG' cannot be written"),
    ],
)
def test_writes_nothing_that_it_would_not_read(change: dict[str, object], message: str) -> None:
    keys = {name: getattr(segment(), name) for name in TdmSegment.__dataclass_fields__}
    with pytest.raises(InputError, match=message):
        write_tdm([TdmSegment(**(keys | change))])
    with pytest.raises(InputError, match="at least one segment"):
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
            assert np.isfinite(part.azimuth_rad).all()
            assert (np.abs(part.elevation_rad) <= np.pi / 2).all()


@pytest.mark.parametrize("day", ["2026-000", "2026-366", "2028-367"])
def test_days_that_the_year_does_not_have(day: str) -> None:
    with pytest.raises(InputError, match=f"f.tdm:21: the year {day[:4]} has the days 001 to"):
        read_tdm(KVN.replace("2026-325T", f"{day}T"), "f.tdm")


def test_the_last_day_of_a_leap_year() -> None:
    text = KVN.replace("2026-11-21T", "2028-12-31T").replace("2026-325T", "2028-366T")
    assert read_tdm(text, "f.tdm")
