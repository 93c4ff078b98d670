"""``hillsphere track`` when something is unusual: flipped passes, noise, wrong clocks, a kill."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.plugins.tracking.test_live_track import (
    PLACE,
    RISE,
    STATION,
    UT1,
    folder,
    iss,
    seen,
    track,
)

from hillsphere.base.geodetic import Station
from hillsphere.cli.exit_codes import ExitCode
from hillsphere.errors import InputError
from hillsphere.time import Epoch
from hillsphere_tracking.live.antenna import antenna_of
from hillsphere_tracking.live.clock import Replay
from hillsphere_tracking.live.coming_pass import next_pass, plan_of, stream_of
from hillsphere_tracking.live.feed import LiveFeed
from hillsphere_tracking.live.gate import Gate
from hillsphere_tracking.live.measurements import Measurement, measurements
from hillsphere_tracking.live.offsets import offsets_of
from hillsphere_tracking.live.rotctl import RotatorLostError, Rotctl
from hillsphere_tracking.live.session import Command, Outputs, Session, run_session
from hillsphere_tracking.live.sky import Place
from hillsphere_tracking.passes.masks import HorizonMask
from hillsphere_tracking.pointing.commands import command_pass
from hillsphere_tracking.pointing.pass_log import read_pass_log
from hillsphere_tracking.trackers.least_squares import LeastSquares
from hillsphere_tracking.trackers.specs import LeastSquaresSpec, TableSpec
from hillsphere_tracking.trackers.table import Table

__all__ = ["folder"]

DEGREE = np.pi / 180.0
EARLIER = Epoch.parse("2019-12-09T20:00:00", "UTC")
"""Within a day of it the ISS passes over every station below, four times across north."""


@pytest.mark.parametrize(
    ("elevation", "mask_deg"), [((0.0, 180.0), 0.0), ((-5.0, 180.0), 0.0), ((0.0, 180.0), 10.0)]
)
def test_a_mount_that_flips_follows_passes_across_its_stop(
    elevation: tuple[float, float], mask_deg: float
) -> None:
    mount = antenna_of("az_el", {"azimuth": (0.0, 360.0), "elevation": elevation}, 6.0, 6.0, None)
    flipped = 0
    for latitude in (-40.0, -30.0, 0.0, 30.0):
        station = Station("s", latitude * DEGREE, -44.26 * DEGREE, 39.0)
        place = Place(station, HorizonMask((mask_deg * DEGREE,)))
        view = next_pass(iss(), place, EARLIER, UT1, 2.0, 86400.0)
        plan = plan_of(view, mount.mount, None)
        flown = command_pass(plan, (view.times_s, view.azimuth_rad, view.elevation_rad), 2.0)
        # stops at north without a flip would cost 4 to 57 degrees of these passes
        assert np.degrees(plan.error_rad[view.up].max()) < 1e-6
        assert np.degrees(flown.error_rad[view.up].max()) < 0.01
        flipped += int(plan.flipped.any())
    assert flipped >= 2


def test_limits_are_blamed_only_where_they_cost(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fast = ["--replay", "--speed", "0", "--period", "2"]
    assert track(folder, *fast) == ExitCode.SUCCESS
    # before the rise and after the set the lower stop of the elevation is no loss
    assert "limits of the mount" not in capsys.readouterr().err
    assert track(folder, *fast, "--elevation-limits", "0", "10") == ExitCode.SUCCESS
    assert "the limits of the mount will cause errors of up to" in capsys.readouterr().err


class _Silence:
    def until(self, start: Epoch, t_s: float) -> list[Measurement]:
        return []

    def close(self) -> None:
        """Do nothing."""


def test_the_antenna_waits_at_the_rise() -> None:
    early = Epoch(RISE.day, RISE.fraction - 600.0 / 86400.0, "UTC")
    place = Place(STATION, HorizonMask((5.0 * DEGREE,)))
    view = next_pass(iss(), place, early, UT1, 1.0, 3600.0)
    stream = stream_of(Table(TableSpec()), iss(), place, view, early, UT1, 0.1 * DEGREE)
    mount = antenna_of("az_el", {"azimuth": (-180.0, 450.0)}, 10.0, 10.0, None).mount
    session = Session(stream, plan_of(view, mount, None), place, view.rise_s, 1.0, 3.0, None)
    commands: list[Command] = []
    outputs = Outputs(commands.append, lambda t, m: None, lambda status: None, lambda line: None)
    run_session(session, Replay(early, 0.0), _Silence(), None, outputs)
    assert view.rise_s > 600.0
    rise = [float(angle[0]) for angle in stream.predict(np.array([view.rise_s]))[:2]]
    waiting = [c for c in commands if 10.0 < c.t_s < view.rise_s - 1.0]
    assert len(waiting) > 500
    for command in (waiting[0], waiting[-1]):
        assert_allclose(np.cos(command.primary_rad - rise[0]), 1.0, rtol=0.0, atol=1e-14)
        assert_allclose(command.secondary_rad, rise[1], rtol=0.0, atol=1e-9)
        # what is predicted is the satellite, below the horizon
        assert command.elevation_rad < 5.0 * DEGREE
    up = [c for c in commands if view.rise_s + 10.0 < c.t_s < view.times_s[view.up.stop - 1]]
    assert max(abs(c.secondary_rad - c.elevation_rad) for c in up) < 1e-3 * DEGREE


def _until(done: Callable[[], bool], within_s: float = 10.0) -> None:
    end = time.monotonic() + within_s
    while not done():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.01)


def test_noise_without_a_line_end_costs_a_line() -> None:
    reading, writing = os.pipe()
    said: list[str] = []
    feed = LiveFeed(reading, "m", RISE, said.append)
    got: list[Measurement] = []

    def arrived(count: int) -> bool:
        got.extend(feed.until(RISE, 0.0))
        return len(got) == count

    os.write(writing, b"1,10,20\n")
    _until(lambda: arrived(1))
    for _ in range(50):
        os.write(writing, b"\xff" * 4000)
    os.write(writing, b"\n2,10,20\n3,10,20\n")
    _until(lambda: arrived(3))
    assert [m.epoch.seconds_since(RISE) for m in got] == pytest.approx([1.0, 2.0, 3.0], abs=1e-6)
    assert [line for line in said if "without a line end" in line] == said
    assert len(said) == 1
    feed.close()
    os.close(writing)
    os.close(reading)


@pytest.mark.parametrize("noise", ["<x@!", "a,b,c,d", "CCSDSxx", "1,2", "7,8,nan"])
def test_noise_before_the_first_measurement(noise: str) -> None:
    source = measurements([noise, "1,10,20", "2,10,20"], "m", RISE)
    with pytest.raises(InputError, match="m:1: "):
        next(source)
    assert [m.place for m in source] == ["m:2", "m:3"]


def test_a_stamp_from_the_future_costs_that_measurement() -> None:
    said: list[str] = []
    gate = Gate(RISE, said.append)

    def admitted(t_s: float, now_s: float) -> list[float]:
        made = list(measurements([f"{t_s},10,20"], "m", RISE))
        return [round(t, 6) for t, _ in gate.admit(made, now_s)]

    assert admitted(1.0, 1.1) == [1.0]
    assert admitted(40.0, 2.1) == []
    assert admitted(41.0, 3.1) == []
    assert admitted(4.0, 4.1) == [4.0]
    assert admitted(5.0, 5.1) == [5.0]
    assert "37.9 s after now, and the next measurements are not; 1 more" in said[0]
    # a clock that is ahead is used once five measurements agree, and told
    for k in range(6, 10):
        assert admitted(k + 20.0, float(k)) == []
    assert admitted(30.0, 10.0) == [26.0, 27.0, 28.0, 29.0, 30.0]
    assert admitted(31.0, 11.0) == [31.0]
    assert said[1:] == ["measurements are dated 20 s ahead of this clock, and are used"]


def test_the_time_offset_shown_is_that_of_the_orbit() -> None:
    place = Place(STATION, HorizonMask())
    view = next_pass(iss(), place, RISE, UT1, 1.0, 3600.0)
    method = LeastSquares(LeastSquaresSpec())
    stream = stream_of(method, iss(), place, view, RISE, UT1, 0.02 * DEGREE)
    elements = stream.nominal_orbit()
    t = np.arange(0.0, 300.0)
    azimuth, elevation = seen(t, 5.0)
    for k in range(t.size):
        stream.update(t[k], azimuth[k] + 0.5 * DEGREE, elevation[k])
    shown = offsets_of(elements, stream.true_direction(300.0), 300.0)
    # 0.5° are about 4 s of this pass near its beginning and end
    assert abs(shown.early_s - 5.0) < 0.3
    assert abs(np.degrees(shown.left_rad)) < 0.1


def test_a_log_survives_a_kill(folder: Path) -> None:
    log = folder / "pass.csv"
    command = [sys.executable, "-m", "hillsphere", "track", str(folder / "m.csv"), *PLACE]
    command += ["--elements", str(folder / "iss.tle"), "--replay", "--speed", "50"]
    command += ["--ut1-minus-utc", "-0.17258", "--log", str(log)]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:
        # 30 measurements, and 5 commands with which a measurement may share its time
        _until(lambda: log.exists() and log.read_text().count(",1,,,,\n") > 30, 60.0)
        _until(lambda: log.read_text().count(",,,,0,") > 5, 60.0)
        process.kill()
    kept = read_pass_log(log)
    assert kept.locked.sum() > 30
    assert np.isfinite(kept.commanded_azimuth_rad).sum() > 5
    # a part of a line, as a loss of power leaves it
    log.write_text(log.read_text() + "2019-12-09T23:0")
    assert_allclose(read_pass_log(log).times_s, kept.times_s, rtol=0.0, atol=0.0)


def test_a_log_is_not_the_file_of_the_measurements(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = (folder / "m.csv").read_text()
    assert track(folder, "--replay", "--log", str(folder / "m.csv")) == ExitCode.BAD_INPUT
    assert "is the file of the measurements" in capsys.readouterr().err
    assert (folder / "m.csv").read_text() == before


def test_the_wait_for_a_rotator_is_set() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as server,  # accepts, and never answers
        Rotctl("127.0.0.1", server.getsockname()[1], timeout_s=0.2) as client,
    ):
        begun = time.monotonic()
        with pytest.raises(RotatorLostError, match="no answer in time"):
            client.position()
        assert time.monotonic() - begun < 1.5


def test_the_wait_is_an_option(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert track(folder, "--replay", "--rotator-timeout", "0") == ExitCode.BAD_INPUT
    assert "--rotator-timeout must be > 0" in capsys.readouterr().err
