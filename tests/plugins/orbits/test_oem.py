"""Orbit ephemeris messages: what is written is read back, and what cannot be is refused."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from hillsphere.errors import InputError
from hillsphere.formats.oem import OemSegment, read_oem, write_oem
from hillsphere.time import Epoch


def _segment(scale: str = "TDB", states: int = 12) -> OemSegment:
    rng = np.random.default_rng(3)
    return OemSegment(
        object_name="QSO-H",
        object_id="2024-999A",
        center_name="MARS",
        ref_frame="ICRF",
        epoch=Epoch.parse("2027-06-01T06:30:00.5", scale),
        t_s=np.sort(rng.uniform(0.0, 2e5, states)).round(6),
        x=np.concatenate([rng.normal(0, 9e6, (3, states)), rng.normal(0, 2e3, (3, states))]),
        comment="departure",
    )


@pytest.mark.parametrize("scale", ["TDB", "TT", "TAI", "UTC"])
def test_a_message_comes_back(scale: str) -> None:
    first, second = _segment(scale), replace(_segment(scale, 3), object_name="QSO-La")
    read = read_oem(write_oem([first, second]))
    assert [s.object_name for s in read] == ["QSO-H", "QSO-La"]
    for written, got in zip((first, second), read, strict=True):
        np.testing.assert_array_equal(got.x, written.x)
        np.testing.assert_allclose(got.t_s, written.t_s - written.t_s[0], rtol=0, atol=3e-6)
        assert got.epoch.seconds_since(written.epoch) == pytest.approx(written.t_s[0], abs=3e-6)


def test_the_form_is_that_of_the_standard() -> None:
    """CCSDS 502.0-B, section 5: keywords, their order, and units of km and km/s."""
    segment = replace(
        _segment(), t_s=np.array([0.0, 60.0]), x=np.array([[1e6, 0, 0, 0, 1e3, 0]] * 2).T
    )
    text = write_oem([segment], created=datetime(2027, 1, 2, 3, 4, 5, tzinfo=UTC))
    assert text.splitlines() == [
        "CCSDS_OEM_VERS = 2.0",
        "CREATION_DATE = 2027-01-02T03:04:05",
        "ORIGINATOR = HILLSPHERE",
        "",
        "META_START",
        "COMMENT departure",
        "OBJECT_NAME = QSO-H",
        "OBJECT_ID = 2024-999A",
        "CENTER_NAME = MARS",
        "REF_FRAME = ICRF",
        "TIME_SYSTEM = TDB",
        "START_TIME = 2027-06-01T06:30:00.500000",
        "STOP_TIME = 2027-06-01T06:31:00.500000",
        "INTERPOLATION = LAGRANGE",
        "INTERPOLATION_DEGREE = 1",
        "META_STOP",
        "",
        "2027-06-01T06:30:00.500000 1000.0000 0.0000 0.0000 0.0000 1.0000 0.0000",
        "2027-06-01T06:31:00.500000 1000.0000 0.0000 0.0000 0.0000 1.0000 0.0000",
    ]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"ref_frame": "hill:phobos"}, "inertial"),
        ({"object_name": ""}, "object_name"),
        ({"center_name": "a = b"}, "center_name"),
        ({"t_s": np.zeros(12)}, "rise"),
        ({"t_s": 1e-8 * np.arange(12.0)}, "same time to the microsecond"),
        ({"comment": "departure\nMETA_STOP"}, "one line"),
        ({"x": np.full((6, 12), np.nan)}, "finite"),
        ({"x": np.zeros((3, 12))}, r"\(6, 12\)"),
    ],
)
def test_what_cannot_be_written_is_refused(change: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        write_oem([replace(_segment(), **change)])  # type: ignore[arg-type]
    with pytest.raises(InputError, match="segment"):
        write_oem([])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("CCSDS_OEM_VERS = 2.0", "VERS = 2.0", "not an orbit ephemeris"),
        ("TIME_SYSTEM = TDB", "TIME_SYSTEM = SCLK", "SCLK"),
        ("CENTER_NAME = MARS\n", "", "CENTER_NAME"),
        ("OBJECT_NAME = QSO-H", "OBJECT_NAME QSO-H", "OEM:7"),
    ],
)
def test_a_broken_message_is_refused(old: str, new: str, said: str) -> None:
    text = write_oem([_segment()])
    assert old in text
    with pytest.raises(InputError, match=said):
        read_oem(text.replace(old, new))


def test_a_line_of_states_that_is_cut_short_is_named() -> None:
    lines = write_oem([_segment()]).splitlines()
    lines[-1] = lines[-1].rsplit(" ", 1)[0]
    with pytest.raises(InputError, match=f"OEM:{len(lines)}"):
        read_oem("\n".join(lines))


BY_DAY = """CCSDS_OEM_VERS = 2.0
CREATION_DATE = 2028-366
ORIGINATOR = TEST
META_START
OBJECT_NAME = PROBE
OBJECT_ID = 2026-001A
CENTER_NAME = MARS
REF_FRAME = ICRF
TIME_SYSTEM = TDB
START_TIME = 2028-366T00:00:00
STOP_TIME = 2028-366T00:01:00.5
META_STOP
2028-366T00:00:00.5 9376 -1.5 0.25 0.001 2.138 -0.5
2028-366T00:01:00.5Z 9375 128.25 -29.75 -0.041 2.1375 -0.5
"""


def test_times_by_the_day_of_the_year() -> None:
    (segment,) = read_oem(BY_DAY)
    assert segment.epoch.isot(segment.t_s, 1) == ["2028-12-31T00:00:00.5", "2028-12-31T00:01:00.5"]


@pytest.mark.parametrize("day", ["2026-000", "2026-366", "2028-367"])
def test_days_that_the_year_does_not_have(day: str) -> None:
    with pytest.raises(InputError, match=f"OEM:13: EPOCH: the year {day[:4]} has the days 001 to"):
        read_oem(BY_DAY.replace("2028-366T00:00:00.5", f"{day}T00:00:00.5"))


def test_a_byte_order_mark_is_passed_over() -> None:
    assert read_oem("\ufeff" + BY_DAY)[0].object_name == "PROBE"
