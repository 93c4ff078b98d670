"""Readers of angles: tables and messages, line by line, and what they refuse."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.formats.tdm import TdmMeta, TdmSegment, write_tdm
from hillsphere.time import Epoch
from hillsphere_tracking.live.feed import Arriving, Recorded
from hillsphere_tracking.live.measurements import Measurement, measurements

START = Epoch.parse("2026-11-21T09:00:00", "UTC")


def read(text: str, epoch: Epoch | None = None) -> list[Measurement]:
    return list(measurements(text.splitlines(), "m.csv", epoch))


@pytest.mark.parametrize(
    ("text", "epoch"),
    [
        ("2026-11-21T09:00:01Z, 350.5, 5\n2026-11-21T09:00:02.5, -10.5, 90, 0.05\n", None),
        ("\ufeff# made by hand\r\n\r\n1,350.5,5,0.1\r\n2.5,-10.5,90,0.05\r\n", START),
        (
            "sigma_deg,utc,note,elevation_deg,azimuth_deg\n"
            ",2026-11-21T09:00:01,a,5,350.5\n0.05,2026-11-21T09:00:02.5,b,90,-10.5\n"
            ",2026-11-21T09:00:03,no lock,,\n",
            None,
        ),
        (
            "utc,azimuth_deg,elevation_deg,sigma_deg,locked\n2026-11-21T09:00:00,1,2,0.1,0\n"
            "2026-11-21T09:00:01,350.5,5,0.1,1\n2026-11-21T09:00:02.5,-10.5,90,0.05,1\n",
            None,
        ),
    ],
)
def test_tables(text: str, epoch: Epoch | None) -> None:
    if "# made" not in text and "utc" not in text:
        text = text.replace(" 5\n", " 5, \n")
    found = read(text, epoch)
    assert_allclose([m.epoch.seconds_since(START) for m in found], [1.0, 2.5], rtol=0.0, atol=1e-6)
    assert_allclose(np.degrees([m.azimuth_rad for m in found]), [350.5, -10.5], rtol=1e-14)
    assert_allclose(np.degrees([m.elevation_rad for m in found]), [5.0, 90.0], rtol=1e-14)
    assert_allclose(np.degrees(found[1].sigma_rad or 0.0), 0.05, rtol=1e-14)


def test_messages() -> None:
    angles = np.array([0.1, 0.2])
    segment = TdmSegment(TdmMeta(("A", "B")), START, np.array([0.0, 1.0]), angles, angles / 2.0)
    found = read(write_tdm([segment]))
    assert_allclose([m.azimuth_rad for m in found], angles, rtol=0.0, atol=1e-10)
    assert found[0].place == "m.csv:15"
    with pytest.raises(InputError, match=r"at the same time as that of m\.csv:17"):
        read(write_tdm([segment]) + _again(segment))


def _again(segment: TdmSegment) -> str:
    """Return the metadata and another angle of the last time, without the message's head."""
    last = TdmSegment(segment.meta, START, np.array([1.0]), np.ones(1), np.ones(1))
    return write_tdm([last]).partition("\n\n")[2]


GOOD = "2026-11-21T09:00:01,350.5,5\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD + "2026-11-21T09:00:01,350.5,5\n", "m.csv:2: .*at the same time as that of m.csv:1"),
        (GOOD + "2026-11-21T09:00:00,350.5,5\n", "m.csv:2: .* is 1 s before that of m.csv:1"),
        (GOOD + "2026-11-21T09:00:02,350.5,90.1\n", "m.csv:2: elevation must be .* got 90.1°"),
        (GOOD + "2026-11-21T09:00:02,700,5\n", "m.csv:2: azimuth must be"),
        (GOOD + "2026-11-21T09:00:02,nan,5\n", "m.csv:2: azimuth_deg: expected a finite number"),
        (GOOD + "2026-11-21T09:00:02,x,5\n", "m.csv:2: azimuth_deg: expected a finite number"),
        (GOOD + "2026-11-21T09:00:02,350,\n", "m.csv:2: elevation_deg: expected a finite number"),
        (GOOD + "2026-11-21T09:00:02,350\n", "m.csv:2: expected 3 values, got 2"),
        (GOOD + "yesterday,350,5\n", "m.csv:2: expected a time such as"),
        (GOOD + "inf,350,5\n", "m.csv:2: expected a finite time"),
        (GOOD + "17,350,5\n", "m.csv:2: a time in seconds, 17, needs .* --epoch"),
        ("2026-11-21T09:00:01,350.5,5,0\n", "m.csv:1: sigma_deg must be > 0, got 0"),
        ("a b c\n", "m.csv:1: expected time, azimuth, elevation"),
        ("utc,azimuth_deg\n", "m.csv:1: the names of columns"),
        ("utc,time,azimuth_deg,elevation_deg\n", "m.csv:1: the names of columns"),
        ("CCSDS_TDM_VERS = 2.0\nMETA_STOP\n", "m.csv:2: TIME_SYSTEM"),
    ],
)
def test_refuses(text: str, message: str) -> None:
    with pytest.raises(InputError, match=f"^{message}"):
        read(text)


def test_a_table_goes_on_after_a_bad_line() -> None:
    source = measurements([GOOD, "x,y,z\n", "2026-11-21T09:00:02,1,2\n"], "m.csv")
    next(source)
    with pytest.raises(InputError):
        next(source)
    assert next(source).place == "m.csv:3"
    assert next(source, None) is None


def test_a_replay_gives_what_its_time_has_reached() -> None:
    text = "".join(f"{k},10,20\n" for k in range(5, 15))
    feed = Recorded(measurements(text.splitlines(), "m", START))
    assert feed.first.epoch.seconds_since(START) == pytest.approx(5.0)
    assert [len(feed.until(START, t)) for t in (4.0, 6.5, 6.9, 7.0, 99.0, 100.0)] == [
        0, 2, 0, 1, 7, 0,
    ]  # fmt: skip
    with pytest.raises(InputError, match="no measurements to replay"):
        Recorded(measurements([], "m"))


def _until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + 10.0
    while not done():
        assert time.monotonic() < end, "it did not happen within 10 s"
        time.sleep(0.005)


def test_what_arrives_is_there_at_once_and_bad_lines_are_passed_over() -> None:
    reading, writing = os.pipe()
    said: list[str] = []
    feed = Arriving(reading, "pipe", START, said.append)
    got: list[Measurement] = []

    def arrived(count: int) -> Callable[[], bool]:
        def enough() -> bool:
            got.extend(feed.until(START, 0.0))
            return len(got) >= count

        return enough

    os.write(writing, b"1,10,20\n2,10")
    _until(arrived(1))
    assert len(got) == 1
    os.write(writing, b",21\nrubbish\n3,10,22\n")
    _until(arrived(3))
    assert np.degrees(got[1].elevation_rad) == pytest.approx(21.0)
    assert said == ["passed over: pipe:3: expected 3 values, got 1"]
    os.write(writing, b"4,10,23")
    os.close(writing)
    _until(arrived(4))
    _until(lambda: len(said) == 2)
    assert "no more measurements" in said[1]
    feed.close()
    os.close(reading)


def test_an_open_input_does_not_hold_the_end_up() -> None:
    reading, writing = os.pipe()
    feed = Arriving(reading, "pipe", None, pytest.fail)
    begun = time.monotonic()
    feed.close()
    assert time.monotonic() - begun < 5.0
    os.close(writing)
    os.close(reading)
