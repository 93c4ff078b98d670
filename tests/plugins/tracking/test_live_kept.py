"""What ``hillsphere track`` keeps of a pass: station memory, pass log, scores."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import ConstantOrientation
from hillsphere.cli.endings import run
from hillsphere.cli.exit_codes import ExitCode
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_tracking.live.antenna import antenna_of
from hillsphere_tracking.live.calibration import (
    StationMemory,
    begin_with_calibration,
    calibration_after_pass,
)
from hillsphere_tracking.live.logbook import Logbook
from hillsphere_tracking.live.measurements import Measurement
from hillsphere_tracking.live.scoring import losses_of, score_lines
from hillsphere_tracking.live.session import Command
from hillsphere_tracking.memory import Calibration, RandomWalk, read_memory, remember
from hillsphere_tracking.pointing.pass_log import PassLog, read_pass_log
from hillsphere_tracking.satellites import earth_fixed_states, orbits_of
from hillsphere_tracking.topocentric import angles
from hillsphere_tracking.trackers.least_squares import LeastSquares, LeastSquaresState
from hillsphere_tracking.trackers.specs import LeastSquaresSpec

TLE = """ISS (ZARYA)
1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
"""
DEGREE = np.pi / 180.0
STATION = Station("A", np.radians(-2.18), np.radians(-44.26), 39.0)
RISE = Epoch.parse("2019-12-09T23:05:04", "UTC")
NEXT = Epoch.parse("2019-12-11T23:02:30", "UTC")
BIAS_DEG = np.array([[0.35], [-0.25]])
NO_FORGETTING = RandomWalk(0.0, 0.0)


def written(path: Path, start: Epoch, t: Array) -> None:
    """Write what a station with biased encoders measures, noise of 0.03°."""
    orientation = ConstantOrientation(-0.17258)
    states = earth_fixed_states(orbits_of(TLE, "iss.tle")[0], start, t, orientation)
    azimuth, elevation, _ = angles(STATION, states[:3])
    noise = 0.03 * np.random.default_rng(3).standard_normal((2, t.size))
    cells = np.degrees([azimuth, elevation]) + BIAS_DEG + noise
    rows = zip(start.isot(t, 3), *cells, strict=True)
    path.write_text("".join(f"{when},{a:.5f},{h:.5f},0.03\n" for when, a, h in rows))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "iss.tle").write_text(TLE)
    written(tmp_path / "m.csv", RISE, np.concatenate([np.arange(150.0), np.arange(220.0, 450.0)]))
    return tmp_path


def arguments(folder: Path, *more: str, source: str = "m.csv") -> list[str]:
    given = ["track", str(folder / source), "--elements", str(folder / "iss.tle")]
    given += ["--station", "A", "--latitude", "-2.18", "--longitude", "-44.26", "--height", "39"]
    given += ["--ut1-minus-utc", "-0.17258", "--replay", "--azimuth-limits", "-180", "450"]
    return [*given, "--period", "2", *more]


def track(folder: Path, *more: str, source: str = "m.csv") -> int:
    return run(arguments(folder, *more, "--speed", "0", source=source))


def test_a_station_learns_its_biases_and_begins_with_them(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "stations.json"
    memory = ["--memory", str(path), "--no-search"]
    assert track(folder, *memory) == ExitCode.SUCCESS
    err = capsys.readouterr().err
    assert "has no entry for A yet" in err
    assert f"biases of A stored in {path}" in err
    first = read_memory(path)["A"]
    sigma = np.sqrt(np.diag(first.covariance))
    assert first.passes == 1
    assert (np.abs(first.mean[:2] - BIAS_DEG[:, 0] * DEGREE) < 3.0 * sigma[:2]).all()
    assert (sigma[:2] < 0.1 * DEGREE).all()  # of 0.2° before
    assert sigma[2] == pytest.approx(0.1)  # not estimated: as it was
    # two days later, a few measurements: the first pass counts
    written(folder / "next.csv", NEXT, np.arange(0.0, 40.0))
    assert track(folder, *memory, "--within", "1", source="next.csv") == ExitCode.SUCCESS
    err = capsys.readouterr().err
    assert "biases of A from 1 passes: azimuth +0.3" in err
    second = read_memory(path)["A"]
    assert second.passes == 2
    assert second.epoch.seconds_since(NEXT) == pytest.approx(39.0, abs=1e-3)
    assert (np.sqrt(np.diag(second.covariance))[:2] < 0.1 * DEGREE).all()
    # the pass before again: what is known of it already must not count twice
    before = path.read_bytes()
    assert track(folder, *memory) == ExitCode.SUCCESS
    assert "after the beginning of this pass" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_a_memory_is_left_alone(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "stations.json"
    known = Calibration(Epoch.parse("2019-12-01", "UTC"), np.zeros(3), 1e-6 * np.eye(3), 4)
    remember(path, "A", known)
    before = path.read_bytes()
    written(folder / "few.csv", RISE, np.arange(0.0, 15.0))
    assert track(folder, "--memory", str(path), source="few.csv") == ExitCode.SUCCESS
    assert "is not changed: 15 measurements" in capsys.readouterr().err
    assert track(folder, "--memory", str(path), "--tracker", "average") == ExitCode.SUCCESS
    assert capsys.readouterr().err.count("estimates no biases") == 1
    assert path.read_bytes() == before
    path.write_text("{")
    assert track(folder, "--memory", str(path)) == ExitCode.BAD_INPUT
    assert "is damaged" in capsys.readouterr().err
    assert path.read_text() == "{"


def test_an_interrupted_pass_is_kept(folder: Path) -> None:
    path, log = folder / "stations.json", folder / "pass.csv"
    command = [sys.executable, "-m", "hillsphere"]
    command += arguments(folder, "--speed", "50", "--memory", str(path), "--log", str(log))
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL) as process:
        assert process.stderr is not None
        for line in process.stderr:
            counted = re.search(rb" (\d+) measurements", line)
            if counted and int(counted[1]) >= 60:
                process.send_signal(signal.SIGINT)
                break
        rest = process.stderr.read().decode()
        assert process.wait(30) == ExitCode.INTERRUPTED, rest
    assert "Traceback" not in rest
    assert read_memory(path)["A"].passes == 1
    kept = read_pass_log(log)
    assert 60 <= kept.locked.sum() < 380
    assert sorted(entry.name for entry in folder.iterdir()) == [
        "iss.tle", "m.csv", "pass.csv", "stations.json",
    ]  # fmt: skip


def test_a_log_replays_as_the_pass_did_and_is_scored(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert track(folder, "--log", str(folder / "pass.csv"), "--no-search") == ExitCode.SUCCESS
    flown = capsys.readouterr().out
    log = read_pass_log(folder / "pass.csv")
    assert log.locked.sum() == 380
    pointed = np.isfinite(log.commanded_azimuth_rad)
    rows = [row.split(",") for row in flown.splitlines()[1:]]
    assert pointed.sum() == len(rows)
    there = np.degrees([log.predicted_azimuth_rad, log.predicted_elevation_rad])[:, pointed]
    assert_allclose(there.T, [[float(c) for c in row[3:5]] for row in rows], rtol=0.0, atol=1e-4)
    high = pointed & (log.predicted_elevation_rad > 0.02) & (log.times_s > 20.0)
    assert_allclose(
        log.commanded_elevation_rad[high], log.predicted_elevation_rad[high], rtol=0.0, atol=1e-6
    )

    assert track(folder, "--score", "--no-search", source="pass.csv") == ExitCode.SUCCESS
    out, err = capsys.readouterr()
    assert out == flown
    lines = err.splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("prediction from a loss"))
    table = [line.split() for line in lines[head + 2 :]]
    # 60 s, 120 s, the loss that happened after 149 s, and 300 s
    assert [row[0] for row in table[::2]] == ["60", "120", "149", "300"]
    assert [row[2] for row in table[:2]] == ["least_squares", "(table)"]
    for ours, stored in zip(table[::2], table[1::2], strict=True):
        assert ours[3:5] == stored[3:5]
        # rms; the elements are fresh, and a minute does not tell biases from them
        if ours[0] != "60":
            assert float(ours[6][:-1]) < 0.2 * float(stored[6][:-1])
    assert table[4][3:5] == ["150", "230"]


def test_a_log_that_cannot_be_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "log").mkdir()
    assert track(folder, "--log", str(folder / "log")) == ExitCode.BAD_INPUT
    assert "--log: " in capsys.readouterr().err
    memory = ["--memory", str(folder / "log")]
    assert track(folder, *memory) == ExitCode.BAD_INPUT
    assert "--memory: " in capsys.readouterr().err


def begun(**keys: Any) -> tuple[LeastSquares, LeastSquaresState]:
    tracker = LeastSquares(LeastSquaresSpec(**keys))
    elements = np.array([6.8e6, 0.001, 0.9, 1.0, 2.0, 3.0])[:, None]
    return tracker, tracker.initial(elements, np.zeros(1), (STATION,), RISE)


KNOWN = Calibration(
    RISE,
    np.array([1e-3, -2e-3, 0.3]),
    np.array([[4e-6, 1e-6, 1e-5], [1e-6, 9e-6, -2e-5], [1e-5, -2e-5, 1e-2]]),
    2,
)


@pytest.mark.parametrize(
    ("angle_biases", "time_bias", "kept"),
    [(True, True, [0, 1, 2]), (True, False, [0, 1]), (False, True, [2])],
)
def test_from_memory_to_tracker_and_back(
    angle_biases: bool, time_bias: bool, kept: list[int]
) -> None:
    tracker, fresh = begun(angle_biases=angle_biases, time_bias=time_bias)
    state = begin_with_calibration(tracker, fresh, KNOWN)
    if time_bias:  # measured less true is a late tag, whose true time is earlier
        assert state.time_bias_s[0] == pytest.approx(-0.3)
    if angle_biases:
        assert_allclose(state.biases_rad[:, 0], [1e-3, -2e-3], rtol=1e-14)
    back = calibration_after_pass(tracker, state, RISE, KNOWN)
    assert_allclose(back.mean, KNOWN.mean, rtol=1e-14)
    assert back.passes == 3
    expected = np.zeros((3, 3))
    rest = [i for i in range(3) if i not in kept]
    for group in (kept, rest):  # what is estimated is not correlated with what is not
        expected[np.ix_(group, group)] = KNOWN.covariance[np.ix_(group, group)]
    assert_allclose(back.covariance, expected, rtol=1e-14)


def test_a_clock_that_is_remembered_is_part_of_what_is_predicted() -> None:
    tracker, fresh = begun(angle_biases=False, time_bias=True)
    slow = Calibration(RISE, np.array([0.0, 0.0, -0.5]), np.diag([1e-8, 1e-8, 1e-6]), 2)
    state = begin_with_calibration(tracker, fresh, slow)
    t = np.arange(0.0, 300.0, 20.0)
    # a slow clock: when it says t it is half a second later
    shown, later = tracker.predict(state, t)[:2], tracker.predict(fresh, t + 0.5)[:2]
    assert_allclose(shown, later, rtol=0.0, atol=1e-12)
    where = tracker.predict(state, t, biased=False)[:2]
    assert_allclose(where, tracker.predict(fresh, t)[:2], rtol=0.0, atol=1e-12)


def test_a_pass_of_outliers_is_not_learned(tmp_path: Path) -> None:
    said: list[str] = []
    memory = StationMemory(tmp_path / "m.json", "A", NO_FORGETTING, said.append)
    tracker, fresh = begun()
    many = np.full(1, 100.0)
    for outliers, learns in ((10.0, True), (60.0, False)):
        (tmp_path / "m.json").unlink(missing_ok=True)
        kept = vars(fresh) | {"count": many, "outliers": np.full(1, outliers)}
        memory.end(tracker, LeastSquaresState(**kept), RISE, 10.0)
        assert (tmp_path / "m.json").exists() == learns
    assert "60 of them outliers" in said[-1]
    entry = json.dumps({"format": "hillsphere station memory", "version": 1, "stations": 3})
    (tmp_path / "m.json").write_text(entry)
    with pytest.raises(InputError, match="has no stations"):
        memory.begin(tracker, fresh, RISE)


def test_a_memory_ages_until_the_pass(tmp_path: Path) -> None:
    path = tmp_path / "m.json"
    remember(path, "A", KNOWN)
    tracker, fresh = begun()
    later = Epoch(RISE.day + 4, RISE.fraction, "UTC")
    state = StationMemory(path, "A", RandomWalk(0.003, 0.0), print).begin(tracker, fresh, later)
    grown = np.diag(state.covariance[3:5, 3:5, 0]) - np.diag(KNOWN.covariance)[:2]
    assert_allclose(np.sqrt(grown), 0.006, rtol=1e-6)  # four days: twice a day's
    assert_allclose(state.covariance[:3, :3], fresh.covariance[:3, :3], rtol=1e-14)


def test_a_logbook_puts_a_measurement_and_a_command_of_one_time_together() -> None:
    mount = antenna_of("x_y", {}, 10.0, 10.0, 0.0).mount
    book = Logbook(RISE, mount, 0.01)
    assert book.pass_log() is None
    book.note_command(Command(2.0, 0.5, 0.0, 1.5, 1.0, "locked"))
    book.note_measurement(2.0, Measurement("", RISE, 1.4, 0.9, None))
    book.note_measurement(1.5, Measurement("", RISE, 1.3, 0.8, 0.02))
    log = book.pass_log()
    assert log is not None
    assert log.times_s.tolist() == [1.5, 2.0]
    assert log.sigma_rad.tolist() == [0.02, 0.01]
    assert log.locked.all()
    # X leans to the east of an axis that points north
    assert log.commanded_azimuth_rad[1] == pytest.approx(0.5 * np.pi)
    assert log.commanded_elevation_rad[1] == pytest.approx(0.5 * np.pi - 0.5)
    assert np.isnan(log.predicted_azimuth_rad[0])
    assert log.predicted_azimuth_rad[1] == 1.5


def test_losses_to_be_scored() -> None:
    t = np.concatenate([np.arange(40.0), np.arange(100.0, 140.0)])
    one = np.ones_like(t)
    log = PassLog(RISE, t, one, one, one, one > 0.0, one, one, one, one)
    # that after 60 s is the one that happened after 39 s
    assert_allclose(losses_of(log, 3.0), [39.0, 120.0], rtol=0.0, atol=2e-3)
    assert losses_of(log, 100.0) == [60.0, 120.0]
    assert "no score" in score_lines({}, None, 3.0, 0.01)[0]
