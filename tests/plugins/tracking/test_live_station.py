"""``hillsphere track`` at a station: search after a loss, mounts, masks, refraction."""

from __future__ import annotations

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
from hillsphere_tracking.live.antenna import antenna_of
from hillsphere_tracking.live.atmosphere import Air, ThroughAir
from hillsphere_tracking.live.clock import Replay
from hillsphere_tracking.live.coming_pass import next_pass, plan_of, stream_of
from hillsphere_tracking.live.measurements import Measurement
from hillsphere_tracking.live.session import Command, Outputs, SearchRules, Session, run_session
from hillsphere_tracking.live.sky import Place
from hillsphere_tracking.live.status import Status
from hillsphere_tracking.passes.masks import BlindSector, HorizonMask
from hillsphere_tracking.pointing.sky import angles_of, separation
from hillsphere_tracking.satellites import Sgp4Orbit, earth_fixed_states, orbits_of
from hillsphere_tracking.topocentric import angles, apparent_elevation, direction_cosines
from hillsphere_tracking.trackers.least_squares import LeastSquares
from hillsphere_tracking.trackers.specs import LeastSquaresSpec

TLE = """ISS (ZARYA)
1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
"""
DEGREE = np.pi / 180.0
UT1 = ConstantOrientation(-0.17258)
STATION = Station("A", np.radians(-2.18), np.radians(-44.26), 39.0)
RISE = Epoch.parse("2019-12-09T23:05:04", "UTC")
PLACE = ["--latitude", "-2.18", "--longitude", "-44.26", "--height", "39"]
USUAL = ["--ut1-minus-utc", "-0.17258", "--replay", "--speed", "0", "--period", "1"]
WIDE = ["--azimuth-limits", "-180", "450"]


def iss() -> Sgp4Orbit:
    return orbits_of(TLE, "iss.tle")[0]


def seen(t_s: Array) -> tuple[Array, Array]:
    """Geometric angles, rad, at times after the rise."""
    azimuth, elevation, _ = angles(STATION, earth_fixed_states(iss(), RISE, t_s, UT1)[:3])
    return azimuth, elevation


def written(folder: Path, t: Array, lift: bool = False) -> None:
    """Write measurements of the satellite at times after the rise, with noise of 0.05°."""
    azimuth, elevation = seen(t)
    if lift:
        elevation = apparent_elevation(elevation)
    noise = 0.05 * np.random.default_rng(1).standard_normal((2, t.size))
    cells = np.degrees([azimuth, elevation]) + noise
    rows = zip(RISE.isot(t, 3), *cells, strict=True)
    (folder / "m.csv").write_text("".join(f"{when},{a:.5f},{h:.5f}\n" for when, a, h in rows))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "iss.tle").write_text(TLE)
    written(tmp_path, np.concatenate([np.arange(60.0), np.arange(200.0, 260.0)]))
    return tmp_path


def track(folder: Path, *arguments: str) -> int:
    elements = ["--elements", str(folder / "iss.tle")]
    return run(["track", str(folder / "m.csv"), *elements, *PLACE, *USUAL, *arguments])


class Table:
    """Commands as they were written, angles in degrees, times after the rise."""

    def __init__(self, text: str) -> None:
        header, *rows = text.splitlines()
        self.names = header.split(",")
        cells = [row.split(",") for row in rows]
        self.t = np.array([Epoch.parse(c[0], "UTC").seconds_since(RISE) for c in cells])
        numbers = np.array([[float(value) for value in c[1:5]] for c in cells]).T
        self.axes, self.predicted = numbers[:2], numbers[2:]
        self.state = np.array([c[5] for c in cells])


def miss_deg(a: Array, b: Array) -> Array:
    """Return angles on the sky between directions in degrees."""
    return np.degrees(
        separation(direction_cosines(*np.radians(a)), direction_cosines(*np.radians(b)))
    )


def test_search_after_a_loss(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert track(folder, *WIDE, "--lock-angle", "0.1") == ExitCode.SUCCESS
    out, err = capsys.readouterr()
    found = Table(out)
    beside = miss_deg(found.axes, found.predicted)
    lost = (found.t > 64.0) & (found.t < 199.0)
    searching = found.state == "searching"
    assert set(found.state[lost]) <= {"predicting", "searching"}
    assert searching[(found.t > 150.0) & lost].all()
    # it goes around the prediction, farther than the beam reaches, and comes back
    assert beside[searching & lost].max() > 0.3
    assert beside[searching & lost].min() < 0.05
    assert (beside[found.state == "locked"][20:] < 0.3).all()
    assert beside[(found.t > 205.0) & (found.t < 260.0)].max() < 1e-3
    assert set(found.state[(found.t > 201.0) & (found.t < 260.0)]) == {"locked"}
    # nothing is searched for below the horizon
    below = found.predicted[1] < -0.1
    assert below.any()
    assert not searching[below].any()
    assert err.count("searching up to") >= 2  # renewed as the error grows
    line = next(line for line in err.splitlines() if "T23:07:50 " in line)
    assert "NO SIGNAL, SEARCHING" in line
    assert "across" in line


def test_no_search(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert track(folder, *WIDE, "--lock-angle", "0.1", "--no-search") == ExitCode.SUCCESS
    found = Table(capsys.readouterr().out)
    assert set(found.state) == {"locked", "predicting"}
    up = (found.t > 20.0) & (found.predicted[1] > 0.5)
    assert miss_deg(found.axes, found.predicted)[up].max() < 1e-3


class Receiver:
    """A station in a loop: nothing is measured unless the beam is on the satellite.

    For two minutes nothing is measured at all, then the satellite comes back a degree off.
    """

    def __init__(self, beam_rad: float) -> None:
        self.beam_rad = beam_rad
        self.beam = direction_cosines(*seen(np.zeros(1)))
        self.heard: list[float] = []
        self._next = 0.0

    def point(self, command: Command) -> None:
        angle = np.array([command.primary_rad]), np.array([command.secondary_rad])
        self.beam = ANTENNA.mount.direction(*angle)

    def until(self, start: Epoch, t_s: float) -> list[Measurement]:
        made = []
        while self._next <= t_s:
            t = self._next
            self._next += 1.0
            azimuth, elevation = seen(np.array([t]))
            if t > 20.0:  # nobody foresaw this manoeuvre
                elevation = elevation + 0.5 * DEGREE
            apart = separation(direction_cosines(azimuth, elevation), self.beam)[0]
            up = elevation[0] > 2.0 * DEGREE
            if t <= 20.0 or (t > 140.0 and up and apart < self.beam_rad):
                self.heard.append(t)
                when = Epoch(RISE.day, RISE.fraction + t / 86400.0, "UTC")
                made.append(Measurement("", when, float(azimuth[0]), float(elevation[0]), None))
        return made

    def close(self) -> None:
        """Do nothing."""


ANTENNA = antenna_of(
    "az_el", {"azimuth": (-180.0, 450.0), "elevation": (0.0, 90.0)}, 10.0, 10.0, None,
)  # fmt: skip


@pytest.mark.parametrize("searches", [True, False])
def test_the_search_finds_a_satellite_that_the_prediction_misses(searches: bool) -> None:
    beam = 0.25 * DEGREE
    place = Place(STATION, HorizonMask())
    view = next_pass(iss(), place, RISE, UT1, 1.0, 3600.0)
    method = LeastSquares(LeastSquaresSpec())
    stream = stream_of(method, iss(), place, view, RISE, UT1, 0.1 * DEGREE)
    receiver = Receiver(beam)
    rules = SearchRules(beam, 1.0) if searches else None
    session = Session(stream, plan_of(view, ANTENNA.mount, None), place, 0.0, 1.0, 3.0, rules)
    states: list[str] = []

    def show(status: Status) -> None:
        states.append(status.state)

    outputs = Outputs(receiver.point, lambda t_s, found: None, show, lambda line: None)
    run_session(session, Replay(RISE, 0.0), receiver, None, outputs)
    again = [t for t in receiver.heard if t > 20.0]
    assert ("searching" in states) == searches
    if not searches:
        assert not again
        return
    # within two minutes of its return, and from then on it is kept
    assert 140.0 < again[0] < 260.0
    assert len(again) > 200
    assert states[-1] == "predicting"


def test_an_x_y_mount(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        track(folder, "--mount", "x_y", "--axis-azimuth", "90", "--no-search") == ExitCode.SUCCESS
    )
    found = Table(capsys.readouterr().out)
    assert found.names[1:3] == ["x_deg", "y_deg"]
    mount = antenna_of("x_y", {}, 10.0, 10.0, 90.0).mount
    beam = np.degrees(angles_of(mount.direction(*np.radians(found.axes))))
    up = (found.t > 20.0) & (found.predicted[1] > 1.0)
    assert miss_deg(beam, found.predicted)[up].max() < 1e-3
    # Y leans towards the X axis's azimuth, east: nearly all of a direction on that horizon
    highest = np.argmax(found.predicted[1])
    assert found.axes[1][highest] * np.sin(np.radians(found.predicted[0][highest])) > 0.0


MISSION = """format = 1
name = "m"
title = "t"
seed = 1
[stage.all]
type = "passes"
satellites = [{ file = "iss.tle" }]

[[stage.all.stations]]
name = "A"
latitude_deg = -2.18
longitude_deg = -44.26
height_m = 39
mask_azimuth_deg = [0, 60, 90, 200]
mask_elevation_deg = [0, 0, 12, 0]
blind_sectors = [{ azimuth_deg = [20, 30], reason = "tower" }]
"""


def test_the_horizon_and_the_blind_sectors_of_a_mission(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "m.toml").write_text(MISSION)
    command = ["track", str(folder / "m.csv"), "--mission", str(folder / "m.toml")]
    assert run([*command, *USUAL, *WIDE, "--lock-angle", "0.05"]) == ExitCode.SUCCESS
    out, err = capsys.readouterr()
    found = Table(out)
    behind_tower = [line for line in err.splitlines() if line.endswith("BEHIND: tower")]
    azimuth = [float(line.split("az ")[1].split("°")[0]) for line in behind_tower]
    assert azimuth
    assert min(azimuth) >= 20.0
    assert max(azimuth) <= 30.0
    tower = (found.predicted[0] > 20.3) & (found.predicted[0] < 29.7)
    assert "searching" not in found.state[tower]
    # the pass ends at the mask, not at 0°
    low = found.predicted[1][(found.t > 200.0) & (found.predicted[0] < 180.0)].min()
    assert run([*command, *USUAL, *WIDE, "--mask", "0"]) == ExitCode.SUCCESS
    flat = Table(capsys.readouterr().out)
    assert flat.t[-1] > found.t[-1] + 20.0
    assert flat.predicted[1].min() < low


def test_a_place_says_what_hides_a_direction() -> None:
    sector = BlindSector((0.0, 0.5), (0.0, 0.3), "mast")
    place = Place(STATION, HorizonMask((0.1,)), (sector,))
    assert place.hidden_by(0.2, 0.2) == "mast"
    assert place.hidden_by(0.2, 0.4) == ""
    assert place.hidden_by(1.0, 0.05) == "horizon"


def test_refraction_on_and_off(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written(folder, np.arange(200.0), lift=True)
    missed = {}
    for given in ("on", "off"):
        switch = ["--refraction"] if given == "on" else []
        assert track(folder, *WIDE, "--tracker", "least_squares", *switch) == ExitCode.SUCCESS
        found = Table(capsys.readouterr().out)
        azimuth, elevation = seen(found.t)
        true = np.degrees([azimuth, apparent_elevation(elevation)])
        low = (found.t > 400.0) & (true[1] > 1.0) & (true[1] < 5.0)
        assert low.any()
        missed[given] = miss_deg(found.predicted, true)[low].max()
        assert miss_deg(found.axes, found.predicted)[low].max() < 1e-3  # commands are apparent
    assert missed["on"] < 0.05
    # 0.2° to 0.4° of refraction, of which the horizon bias takes the most on itself
    assert missed["off"] > 2.0 * missed["on"]


def test_a_tracker_behind_the_air() -> None:
    air = Air(900.0, 30.0)
    plain = LeastSquares(LeastSquaresSpec())
    behind = ThroughAir(plain, air)
    place = Place(STATION, HorizonMask())
    view = next_pass(iss(), place, RISE, UT1, 1.0, 3600.0, air)
    one, two = (stream_of(m, iss(), place, view, RISE, UT1, 1e-3) for m in (plain, behind))
    t = np.arange(0.0, 60.0)
    for when, azimuth, elevation in zip(t, *seen(t), strict=True):
        one.update(when, azimuth, elevation)
        two.update(when, azimuth, float(air.apparent(np.array([elevation]))[0]))
    geometric, apparent = one.predict(t + 60.0), two.predict(t + 60.0)
    assert_allclose(apparent[0], geometric[0], rtol=0.0, atol=1e-9)
    assert_allclose(apparent[1], air.apparent(geometric[1]), rtol=0.0, atol=1e-9)
    assert (apparent[1] - geometric[1]).max() > 0.02 * DEGREE


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--mount", "pole"], "--mount must be one of az_el, x_y, got 'pole'"),
        (["--mount", "x_y", *WIDE], "--azimuth-limits: a mount x_y has the axes x and y"),
        (["--x-limits", "-80", "80"], "--x-limits: a mount az_el has the axes"),
        (["--axis-azimuth", "20"], "--axis-azimuth is the azimuth of the X axis"),
        (["--mount", "x_y", "--axis-azimuth", "nan"], "--axis-azimuth must be finite"),
        (["--elevation-limits", "90", "0"], "--elevation-limits: the lower stop must be below"),
        (["--elevation-limits", "0", "200"], "(elevation) from -90° to 180°, got 0° and 200°"),
        (["--elevation-limits", "nan", "90"], "(elevation) from -90° to 180°, got nan° and 90°"),
        (["--azimuth-limits", "0", "9000"], "(azimuth) from -1080° to 1080°, got 0° and 9000°"),
        (["--latitude", "95"], "--latitude must be from -90° to 90°, got 95°"),
        (["--height", "1e9"], "--height must be from -500 to 9000 m, got 1e+09 m"),
        (["--lock-angle", "0"], "--lock-angle must be > 0"),
        (["--lock-angle", "nan"], "--lock-angle must be > 0"),
        (["--dwell", "-1"], "--dwell must be ≥ 0"),
        (["--pressure", "900"], "need --refraction"),
        (["--refraction", "--pressure", "-3"], "--pressure must be from 0 to 2000 hPa"),
        (["--refraction", "--temperature", "300"], "--temperature must be from -100"),
        (["--mask", "95"], "--mask must lie between -90° and 90°, got 95°"),
        (["--mask", "nan"], "--mask must lie between -90° and 90°"),
        (["--rate", "inf"], "--rate must be > 0, got inf"),
        (["--memory", "/nowhere/at/all/memory.json"], "--memory: the directory /nowhere/at/all"),
        (["--log", "/nowhere/at/all/log.csv"], "--log: the directory /nowhere/at/all"),
        (["--memory", "m.json"], "give --station NAME"),
        (
            ["--memory", "m.json", "--station", "A", "--forget", "-1", "0"],
            "--forget must be two numbers ≥ 0 and finite, degrees and s, got -1 and 0",
        ),
    ],
)
def test_refuses(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert track(folder, *arguments) == ExitCode.BAD_INPUT
    assert message in capsys.readouterr().err


def test_places_off_the_earth_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["track", str(folder / "m.csv"), "--elements", str(folder / "iss.tle"), *USUAL]
    for latitude, longitude, message in (
        ("95", "0", "latitude"),
        ("5", "900", "--longitude must be from -360° to 360°, got 900°"),
        ("5", "nan", "--longitude must be from -360° to 360°, got nan°"),
    ):
        place = ["--latitude", latitude, "--longitude", longitude]
        assert run([*command, *place]) == ExitCode.BAD_INPUT
        assert message in capsys.readouterr().err


def test_what_cannot_be_written_is_told_before_the_pass(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert track(folder, *WIDE, "--log", str(folder)) == ExitCode.BAD_INPUT
    out, err = capsys.readouterr()
    assert not out
    assert f"--log: {folder} is a directory; name a file in it" in err

    def refused(**keys: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", refused)
    memory = ["--memory", str(folder / "m.json"), "--station", "A"]
    assert track(folder, *WIDE, *memory) == ExitCode.BAD_INPUT
    out, err = capsys.readouterr()
    assert not out
    assert f"--memory: nothing can be written in {folder}: Permission denied" in err


def test_the_lock_angle_is_the_half_width(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert track(folder, *WIDE, "--no-search", "--lock-angle", "0.2", "--score") == 0
    assert "(beam ±0.2°)" in capsys.readouterr().err


def test_a_pass_under_way_at_the_end_goes_on_to_its_set() -> None:
    place = Place(STATION, HorizonMask())
    whole = next_pass(iss(), place, RISE, UT1, 1.0, 3600.0)
    short = next_pass(iss(), place, RISE, UT1, 1.0, 60.0)
    assert short.times_s[-1] == whole.times_s[-1] > 500.0


def test_a_replay_begins_at_the_rise(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = folder / "m.csv"
    early = RISE.isot(np.array([-7200.0, -7199.0, -7198.0]), 3)
    path.write_text("".join(f"{when},10,20\n" for when in early) + path.read_text())
    assert track(folder, *WIDE) == ExitCode.SUCCESS
    out, err = capsys.readouterr()
    found = Table(out)
    assert -120.0 < found.t[0] < 0.0
    assert "passed over: 2 more such measurements" in err
    assert "locked" in found.state


def test_elements_that_end_before_the_day_are_bad_input(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "m.csv"
    path.write_text(path.read_text().replace("2019-", "1959-"))
    assert track(folder, *WIDE) == ExitCode.BAD_INPUT
    err = capsys.readouterr().err
    assert "days before the epoch of its elements" in err
    assert "decayed" not in err


def test_help_tells_the_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["track", "--help"]) == ExitCode.SUCCESS
    text = " ".join(capsys.readouterr().out.split())
    assert "Exit codes: 0 the pass is over; 1 no connection to the rotator; 2" in text
    assert "the half-width of the beam" in text


def test_help_is_in_groups(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["track", "--help"]) == ExitCode.SUCCESS
    text = capsys.readouterr().out
    groups = ["Arguments:", "Satellite and station:", "Measurements:", "Prediction:", "Antenna:",
              "Search after a loss:", "What is kept:", "Options:"]  # fmt: skip
    places = [text.index(f"\n{group}") for group in groups]
    assert places == sorted(places)
    assert places[4] < text.index("--mount az_el|x_y") < places[5]
