"""``hillsphere track``: whole passes, replayed and live, to a table and to a rotator."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.base.geodetic import Station
from hillsphere.base.orientation import ConstantOrientation
from hillsphere.cli.endings import run
from hillsphere.cli.exit_codes import ExitCode
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_tracking.live.offsets import offsets_of
from hillsphere_tracking.satellites import Sgp4Orbit, earth_fixed_states, orbits_of
from hillsphere_tracking.topocentric import angles, direction_cosines
from hillsphere_tracking.trackers.nominal import nominal_elements
from hillsphere_tracking.trackers.specs import TableSpec
from hillsphere_tracking.trackers.streaming import StreamingTracker
from hillsphere_tracking.trackers.table import Table

TLE = """ISS (ZARYA)
1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
"""
UT1 = ConstantOrientation(-0.17258)
STATION = Station("station", np.radians(-2.18), np.radians(-44.26), 39.0)
RISE = Epoch.parse("2019-12-09T23:05:04", "UTC")
EARLY_S = 2.0
PLACE = ["--latitude", "-2.18", "--longitude", "-44.26", "--height", "39"]
USUAL = [*PLACE, "--ut1-minus-utc", "-0.17258", "--azimuth-limits", "-180", "450"]


def iss() -> Sgp4Orbit:
    return orbits_of(TLE, "iss.tle")[0]


def seen(t_s: Array, early_s: float = EARLY_S) -> tuple[Array, Array]:
    """Angles of a satellite ahead of its elements, which is what the station measures."""
    states = earth_fixed_states(iss(), RISE, t_s + early_s, UT1)
    # the station has not turned on in the meantime
    turn = 7.2921158553e-5 * early_s
    c, s = np.cos(turn), np.sin(turn)
    r = np.array([c * states[0] - s * states[1], s * states[0] + c * states[1], states[2]])
    return angles(STATION, r)[:2]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "iss.tle").write_text(TLE)
    t = np.arange(0.0, 200.0)
    azimuth, elevation = np.degrees(seen(t))
    noise = 0.05 * np.random.default_rng(1).standard_normal((2, t.size))
    rows = zip(RISE.isot(t, 3), azimuth + noise[0], elevation + noise[1], strict=True)
    (tmp_path / "m.csv").write_text("".join(f"{when},{a:.4f},{h:.4f}\n" for when, a, h in rows))
    return tmp_path


def track(folder: Path, *arguments: str, source: str = "m.csv") -> int:
    elements = ["--elements", str(folder / "iss.tle")]
    return run(["track", str(folder / source), *elements, *USUAL, *arguments])


def table(text: str, axes: str = "azimuth_deg,elevation_deg") -> tuple[Array, Array, list[str]]:
    """Return times after the rise, the angles, and the states, of the commands written."""
    header, *rows = text.splitlines()
    assert header == f"utc,{axes},predicted_azimuth_deg,predicted_elevation_deg,state"
    cells = [row.split(",") for row in rows]
    times = np.array([Epoch.parse(c[0], "UTC").seconds_since(RISE) for c in cells])
    numbers = np.array([[float(value) for value in c[1:5]] for c in cells]).T
    return times, numbers, [c[5] for c in cells]


def miss_deg(a: Array, b: Array) -> Array:
    apart = direction_cosines(*np.radians(a)) - direction_cosines(*np.radians(b))
    return np.asarray(np.degrees(np.linalg.norm(apart, axis=0)))


def test_a_pass_replayed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert track(folder, "--replay", "--speed", "0", "--period", "0.25") == ExitCode.SUCCESS
    out, err = capsys.readouterr()
    t, columns, states = table(out)
    assert_allclose(np.diff(t), 0.25, rtol=0.0, atol=1.1e-3)
    pointed = t > 20.0
    up = pointed & (columns[3] > 0.0)
    true = np.degrees(np.array(seen(t)))
    assert miss_deg(columns[2:4], true)[up].max() < 0.25
    during = pointed & (t < 200.0)
    assert miss_deg(columns[2:4], true)[during].max() < 0.06
    assert miss_deg(columns[:2], columns[2:4])[up].max() < 1e-3
    late = miss_deg(np.degrees(np.array(seen(t, 0.0))), true)
    assert late[up].max() > 0.5  # what the elements alone would miss by
    assert {state for state, when in zip(states, t, strict=True) if 1.0 < when < 202.0} == {
        "locked"
    }
    assert {state for state, when in zip(states, t, strict=True) if when > 204.0} == {"predicting"}
    assert "no measurement for 3 s: the prediction goes on" in err
    assert "OUTLIERS" not in err
    line = next(line for line in err.splitlines() if "T23:08:20 " in line)
    early = re.search(r"([\d.]+) s early +([\d.]+)° (left|right)", line)
    assert early is not None
    assert abs(float(early.group(1)) - EARLY_S) < 0.15
    assert float(early.group(2)) < 0.1


def test_a_sigma_that_does_not_fit_is_told(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # noise of 0.05°
    assert track(folder, "--replay", "--speed", "0", "--period", "2", "--sigma", "0.005") == 0
    assert "OUTLIERS: side lobe, or sigma too small" in capsys.readouterr().err


def test_offsets_along_and_across() -> None:
    # due east at the horizon, climbing 0.1°/s: left is north, early is higher
    def climbing(t_s: Array) -> tuple[Array, Array]:
        return np.full(t_s.shape, 0.5 * np.pi), np.radians(0.1 * t_s)

    ahead = offsets_of(climbing, (0.5 * np.pi, np.radians(0.3)), 0.0)
    assert_allclose(ahead, (3.0, 0.0), rtol=0.0, atol=1e-3)
    north = offsets_of(climbing, (np.radians(89.0), 0.0), 0.0)
    assert_allclose(north, (0.0, np.radians(1.0)), rtol=0.0, atol=1e-9)
    # far ahead the tangent of the track would say 573 s (sin 90° over the rate)
    far = offsets_of(climbing, (0.5 * np.pi, np.radians(89.0)), 100.0)
    assert_allclose(far, (790.0, 0.0), rtol=0.0, atol=1e-3)


def test_mean_elements_of_a_tle_hold_for_the_pass() -> None:
    t = np.arange(0.0, 560.0, 10.0)
    orbit, at = iss(), 220.0
    elements = nominal_elements(orbit, np.array([at + RISE.seconds_since(orbit.epoch)]))[:, 0]
    stream = StreamingTracker(Table(TableSpec()), elements, at, STATION, RISE, UT1)
    azimuth, elevation, _ = stream.predict(t)
    off = miss_deg(np.degrees([azimuth, elevation]), np.degrees(np.array(seen(t, 0.0))))
    assert off.max() < 0.1
    assert off[22] < 1e-3


@pytest.mark.slow
def test_a_rotator_that_goes_away_during_the_pass(folder: Path) -> None:
    fake = _Fake()
    command = [sys.executable, "-m", "hillsphere", "track", str(folder / "m.csv"), *USUAL]
    command += ["--elements", str(folder / "iss.tle"), "--replay", "--speed", "150"]
    command += ["--rotator", f"127.0.0.1:{fake.port}", "--period", "0.5"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        while len(fake.commands) < 30:
            assert process.poll() is None
            time.sleep(0.01)
        fake.hang_up()
        out, err = process.communicate(timeout=60)
    commands = fake.commands
    assert process.returncode == 0, err.decode()
    assert out == b""
    assert b"trying again" in err
    assert b"the rotator is connected again" in err
    assert commands[0] == "p"
    assert commands[-2:] == ["S", "(ended)"]
    fake.close()
    sent = np.array([[float(v) for v in c.split()[1:]] for c in commands if c[0] == "P"])
    again = commands.index("(ended)")
    assert sum(c[0] == "P" for c in commands[again:]) > 50
    # the tracker went on meanwhile: what is sent last is the end of the pass
    t_end = 560.0
    assert miss_deg(sent[-1][:, None], np.degrees(np.array(seen(np.array([t_end])))))[0] < 25.0


class _Fake:
    """A rotctld that can hang up once."""

    def __init__(self) -> None:
        self.commands: list[str] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._server.getsockname()[1])
        self._connection: socket.socket | None = None
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        for _ in range(2):
            try:
                self._connection, _ = self._server.accept()
            except OSError:
                return
            try:
                with self._connection, self._connection.makefile("rw", newline="\n") as stream:
                    for line in stream:
                        self.commands.append(line.strip())
                        stream.write("100.00\n0.00\n" if line[0] == "p" else "RPRT 0\n")
                        stream.flush()
            except (OSError, ValueError):
                pass
            self.commands.append("(ended)")

    def close(self) -> None:
        """Listen no more."""
        with suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()

    def hang_up(self) -> None:
        assert self._connection is not None
        self._connection.shutdown(socket.SHUT_RDWR)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT for other processes")
def test_live_until_interrupted(folder: Path) -> None:
    """Real time on elements of today, measurements over a pipe; Ctrl-C stops the rotator."""
    fake = _Fake()
    (folder / "now.xml").write_text(_geostationary(datetime.now(UTC)))
    command = [sys.executable, "-m", "hillsphere", "track", *USUAL[:6], "--within", "0.1"]
    command += ["--elements", str(folder / "now.xml"), "--ut1-minus-utc", "0"]
    command += ["--rotator", f"127.0.0.1:{fake.port}"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdin is not None
        while sum(c[0] == "P" for c in fake.commands) < 5:
            assert process.poll() is None, process.stderr.read() if process.stderr else ""
            time.sleep(0.01)
        process.stdin.write(b"not a measurement\n2019-12-09T00:00:00,1,2\n")
        process.stdin.flush()
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
    assert process.returncode == ExitCode.INTERRUPTED, err.decode()
    assert fake.commands[-2:] == ["S", "(ended)"]
    fake.close()
    assert b"passed over: stdin:1: expected time, azimuth" in err
    assert b"Traceback" not in err


def _geostationary(when: datetime) -> str:
    """Elements of a satellite that stands high over the station, as an OMM in KVN."""
    days = (when - datetime(2000, 1, 1, 12, tzinfo=UTC)) / timedelta(days=1)
    sidereal = (280.46062 + 360.98564736629 * days) % 360.0
    keys = {
        "CCSDS_OMM_VERS": "2.0", "CREATION_DATE": f"{when:%Y-%m-%dT%H:%M:%S}",
        "ORIGINATOR": "TEST", "OBJECT_NAME": "GEO", "OBJECT_ID": "2020-001A",
        "CENTER_NAME": "EARTH", "REF_FRAME": "TEME", "TIME_SYSTEM": "UTC",
        "MEAN_ELEMENT_THEORY": "SGP4", "EPOCH": f"{when:%Y-%m-%dT%H:%M:%S.%f}",
        "MEAN_MOTION": "1.0027", "ECCENTRICITY": "0.0001", "INCLINATION": "0.05",
        "RA_OF_ASC_NODE": "0.0", "ARG_OF_PERICENTER": "0.0",
        "MEAN_ANOMALY": f"{(sidereal - 30.0) % 360.0:.4f}", "EPHEMERIS_TYPE": "0",
        "CLASSIFICATION_TYPE": "U", "NORAD_CAT_ID": "99999", "ELEMENT_SET_NO": "1",
        "REV_AT_EPOCH": "1", "BSTAR": "0.0", "MEAN_MOTION_DOT": "0.0", "MEAN_MOTION_DDOT": "0.0",
    }  # fmt: skip
    return "".join(f"{key} = {value}\n" for key, value in keys.items())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--replay", "--speed", "-1"], "--speed must be ≥ 0"),
        (["--speed", "5"], "--speed must be ≥ 0, and is for --replay only"),
        (["--replay", "--sigma", "0"], "--sigma must be > 0"),
        (["--replay", "--period", "60"], "--period must be from 0.01 to 10 s"),
        (["--replay", "--satellite", "HUBBLE"], "no satellite 'HUBBLE'"),
        (["--replay", "--tracker", "averag"], "did you mean 'average'"),
        (["--replay", "--rotator", "here:x"], "--rotator must be HOST or HOST:PORT"),
        (["--replay", "--within", "0.01", "--mask", "30"], "does not rise above 30°"),
        (["--replay", "--azimuth-limits", "90", "0"], "the lower stop must be below"),
        (["--replay", "--epoch", "noon"], "expected a time such as"),
    ],
)
def test_refuses(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert track(folder, *arguments) == ExitCode.BAD_INPUT
    assert message in capsys.readouterr().err


def test_refuses_bad_measurements(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "bad.csv").write_text("2019-12-09T23:05:04,350,91\n2019-12-09T23:05:05,350,92\n")
    assert track(folder, "--replay", "--speed", "0", source="bad.csv") == ExitCode.BAD_INPUT
    said = "no measurements to replay: bad.csv:1: elevation must be from -90° to 90°"
    assert said in " ".join(capsys.readouterr().err.replace(str(folder) + os.sep, "").split())
    assert track(folder, "--replay", source="none.csv") == ExitCode.BAD_INPUT
    assert "none.csv: cannot be read: No such file" in capsys.readouterr().err


def test_a_replay_passes_over_bad_lines(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = (folder / "m.csv").read_text().splitlines()
    far = (*rows[50].partition(",")[1:],)
    rows[50] = "2021-01-13T23:05:54.000" + "".join(far)
    rows[100] = "rubbish"
    (folder / "m.csv").write_text("\n".join(rows))
    assert track(folder, "--replay", "--speed", "0", "--period", "0.5") == ExitCode.SUCCESS
    out, err = capsys.readouterr()
    assert "m.csv:51: its time 2021-01-13T23:05:54 is far from the times" in err
    assert "m.csv:101: expected 3 values, got 1" in err
    t, _, states = table(out)
    assert {state for state, when in zip(states, t, strict=True) if 1.0 < when < 202.0} == {
        "locked"
    }


def test_nobody_at_the_rotator(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound, but nobody listens
        port = taken.getsockname()[1]
        assert track(folder, "--replay", "--rotator", f"127.0.0.1:{port}") == ExitCode.FAILED
    assert "no rotctld at 127.0.0.1" in capsys.readouterr().err


def test_satellite_station_and_tracker_of_a_mission(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "m.toml").write_text(
        'format = 1\nname = "m"\ntitle = "t"\nseed = 1\n[tracker.stored]\ntype = "table"\n'
        '[stage.all]\ntype = "passes"\nsatellites = [{ file = "iss.tle" }]\n'
        'stations = [{ name = "A", latitude_deg = -2.18, longitude_deg = -44.26, height_m = 39 },'
        '{ name = "B", latitude_deg = 50, longitude_deg = 10 }]\n'
    )
    command = ["track", str(folder / "m.csv"), "--mission", str(folder / "m.toml"), "--replay"]
    command += ["--speed", "0", "--period", "1", "--ut1-minus-utc", "-0.17258"]
    command += ["--azimuth-limits", "-180", "450"]
    assert run([*command, "--station", "A", "--tracker", "stored"]) == ExitCode.SUCCESS
    out, err = capsys.readouterr()
    assert "ISS (ZARYA) over A" in err
    t, columns, _ = table(out)
    nominal = np.degrees(np.array(seen(t, 0.0)))
    assert miss_deg(columns[2:4], nominal).max() < 0.1
    assert run([*command, "--station", "C"]) == ExitCode.BAD_INPUT
    assert "--station: no 'C'" in capsys.readouterr().err
