"""Readers of angles: tables and messages, line by line, and what they refuse."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.formats.tdm import TdmMeta, TdmSegment, angle_series, write_tdm
from hillsphere.time import Epoch
from hillsphere_tracking.live.feed import LiveFeed, ReplayFeed
from hillsphere_tracking.live.gate import Gate
from hillsphere_tracking.live.measurements import Measurement, measurements

START = Epoch.parse("2026-11-21T09:00:00", "UTC")
META = TdmMeta(("A", "B"), (2, 1), mode="SEQUENTIAL", angle_type="AZEL")


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
    segment = TdmSegment(META, START, angle_series(np.array([0.0, 1.0]), angles, angles / 2.0))
    found = read(write_tdm([segment]))
    assert_allclose([m.azimuth_rad for m in found], angles, rtol=0.0, atol=1e-10)
    assert found[0].place == "m.csv:16"


@pytest.mark.parametrize("keyword", ["ANGLE_1", "ANGLE_2"])
def test_a_message_goes_on_after_a_bad_record(keyword: str) -> None:
    angles = 0.1 * np.arange(1.0, 6.0)
    segment = TdmSegment(META, START, angle_series(np.arange(5.0), angles, angles / 2.0))
    lines = write_tdm([segment]).splitlines()
    bad = [k for k, line in enumerate(lines) if line.lstrip().startswith(keyword)][2]
    lines[bad] = lines[bad].rpartition(" ")[0] + " 4000"
    source = measurements(lines, "m.tdm")
    found, faults = [], []
    while True:
        try:
            one = next(source, None)
        except InputError as error:
            faults.append(str(error))
            continue
        if one is None:
            break
        found.append(one.epoch.seconds_since(START))
    assert_allclose(found, [0.0, 1.0, 3.0, 4.0], rtol=0.0, atol=1e-6)
    assert f"m.tdm:{bad + 1}: {keyword} must be" in faults[0]
    assert len(faults) == 2
    assert "of the same time; both are needed" in faults[1]


GOOD = "2026-11-21T09:00:01,350.5,5\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (GOOD + "2026-11-21T09:00:02,350.5,90.1\n", "m.csv:2: elevation must be .* got 90.1°"),
        (GOOD + "2026-11-21T09:00:02,700,5\n", "m.csv:2: azimuth must be"),
        (GOOD + "2026-11-21T09:00:02,nan,5\n", "m.csv:2: azimuth_deg: expected a finite number"),
        (GOOD + "2026-11-21T09:00:02,x,5\n", "m.csv:2: azimuth_deg: expected a finite number"),
        (GOOD + "2026-11-21T09:00:02,350,\n", "m.csv:2: elevation_deg: expected a finite number"),
        (GOOD + "2026-11-21T09:00:02,350\n", "m.csv:2: expected 3 values, got 2"),
        (GOOD + "yesterday,350,5\n", "m.csv:2: expected a time such as"),
        (GOOD + "inf,350,5\n", "m.csv:2: expected a finite time"),
        (GOOD + "17,350,5\n", "m.csv:2: the time 17 is in seconds; .* --epoch"),
        ("2026-11-21T09:00:01,350.5,5,0\n", "m.csv:1: sigma_deg must be > 0, got 0"),
        ("a b c\n", "m.csv:1: expected time, azimuth, elevation"),
        ("utc,azimuth_deg\n", "m.csv:1: the header must have"),
        ("utc,time,azimuth_deg,elevation_deg\n", "m.csv:1: the header must have"),
        ("CCSDS_TDM_VERS = 2.0\nMETA_STOP\n", "m.csv:2: META_STOP cannot stand"),
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
    feed = ReplayFeed(measurements(text.splitlines(), "m", START), pytest.fail)
    assert feed.first.epoch.seconds_since(START) == pytest.approx(5.0)
    assert [len(feed.until(START, t)) for t in (4.0, 6.5, 6.9, 7.0, 99.0, 100.0)] == [
        0, 2, 0, 1, 7, 0,
    ]  # fmt: skip
    with pytest.raises(InputError, match="no measurements to replay"):
        ReplayFeed(measurements([], "m"), pytest.fail)
    with pytest.raises(
        InputError, match="no measurements to replay: m:1: the time 1 is in seconds"
    ):
        ReplayFeed(measurements(["1,2,3", "2,2,3"], "m"), pytest.fail)


@pytest.mark.parametrize("wrong", [0, 3, 9])
def test_a_replay_passes_over_bad_lines_and_wrong_times(wrong: int) -> None:
    rows = [f"{k},10,20" for k in range(10)]
    rows[wrong] = f"{400 * 86400},10,20"
    rows[5] = "5,10,95"
    said: list[str] = []
    feed = ReplayFeed(measurements(rows, "m", START), said.append)
    found = [m.epoch.seconds_since(START) for m in feed.until(START, 20.0)]
    assert_allclose(found, [k for k in range(10) if k not in (wrong, 5)], rtol=0.0, atol=1e-4)
    assert len(said) == 2
    assert any(f"m:{wrong + 1}: its time 2027-12-26T09:00:00 is far from" in s for s in said)
    assert any("m:6: elevation must be" in line for line in said)


def test_of_several_passes_the_first_is_replayed() -> None:
    rows = [f"{k + day * 90000},10,20" for day in range(3) for k in range(5)]
    said: list[str] = []
    feed = ReplayFeed(measurements(rows, "m", START), said.append)
    assert len(feed.until(START, 1e6)) == 5
    assert [line.rpartition("passed over: ")[2][:6] for line in said] == ["m:6: i", "9 more"]


def test_a_wrong_time_does_not_shut_out_the_right_ones() -> None:
    said: list[str] = []
    gate = Gate(START, said.append)
    text = "1,1,2\n34560000,1,2\n2,1,2\n2,1,2\n1.5,1,2\n3,1,2\n"
    times = [(m, m.epoch.seconds_since(START)) for m in read(text, START)]
    assert [gate.lets_in(m, t, 3.0) for m, t in times] == [True, False, True, False, False, True]
    assert "m.csv:2: a measurement of 2027-12-26T09:00:00, 34559997 s after now" in said[0]
    assert "m.csv:4: this measurement is at the same time as that of m.csv:3" in said[1]
    assert "m.csv:5: this measurement is 0.5 s before that of m.csv:3; times must rise" in said[2]


def test_an_earlier_pass_is_told_once() -> None:
    said: list[str] = []
    gate = Gate(START, said.append)
    for m in read("".join(f"{k},1,2\n" for k in range(100)) + "5000,1,2\n", START):
        gate.lets_in(m, m.epoch.seconds_since(START), 5000.0)
    assert len(said) == 2
    assert "m.csv:1: a measurement of 2026-11-21T09:00:00, 5000 s before now" in said[0]
    assert said[1] == "passed over: 99 more such measurements"


def _until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + 10.0
    while not done():
        assert time.monotonic() < end, "it did not happen within 10 s"
        time.sleep(0.005)


def test_what_arrives_is_there_at_once_and_bad_lines_are_passed_over() -> None:
    reading, writing = os.pipe()
    said: list[str] = []
    feed = LiveFeed(reading, "pipe", START, said.append)
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


def test_a_file_is_followed_as_it_grows(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text("1,10,20\n2,1")
    got: list[Measurement] = []
    with path.open("rb") as reading, path.open("a") as writing:
        feed = LiveFeed(reading.fileno(), "m.csv", START, pytest.fail)

        def arrived(count: int) -> bool:
            got.extend(feed.until(START, 0.0))
            return len(got) >= count

        _until(lambda: arrived(1))
        time.sleep(0.3)
        writing.write("0,21\n3,10,22\n")
        writing.flush()
        _until(lambda: arrived(3))
        feed.close()
    assert_allclose(np.degrees([m.elevation_rad for m in got]), [20.0, 21.0, 22.0], rtol=1e-12)


def test_an_open_input_does_not_hold_the_end_up() -> None:
    reading, writing = os.pipe()
    feed = LiveFeed(reading, "pipe", None, pytest.fail)
    begun = time.monotonic()
    feed.close()
    assert time.monotonic() - begun < 5.0
    os.close(writing)
    os.close(reading)
