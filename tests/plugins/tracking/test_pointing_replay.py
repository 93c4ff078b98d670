"""Pass logs, and trackers scored on them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere.base.geodetic import Station
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Tracker
from hillsphere.time import Epoch
from hillsphere_tracking.pointing.pass_log import PassLog, read_pass_log, write_pass_log
from hillsphere_tracking.pointing.replay import prediction_errors, score
from hillsphere_tracking.trackers.average import Average
from hillsphere_tracking.trackers.least_squares import LeastSquares
from hillsphere_tracking.trackers.specs import AverageSpec, LeastSquaresSpec, TableSpec
from hillsphere_tracking.trackers.table import Table

DEGREE = np.pi / 180.0
EPOCH = Epoch.parse("2027-06-01T12:30:00", "UTC")


def _log(count: int = 20, lost: slice = slice(0, 0)) -> PassLog:
    """Return a target that climbs a meridian at 1°/s from 10°, seen at 1 Hz."""
    times = np.arange(float(count))
    locked = np.ones(count, dtype=bool)
    locked[lost] = False
    seen = np.where(locked, 1.0, np.nan)
    return PassLog(
        EPOCH,
        times,
        123.456789012 * DEGREE * seen,
        (10.0 + times) * DEGREE * seen,
        0.05 * DEGREE * seen,
        locked,
        np.full(count, np.nan),
        (10.0 + times) * DEGREE,
        np.full(count, 2.0),
        (10.5 + times) * DEGREE,
    )


@dataclass(frozen=True)
class _Line:
    """The last two measurements prolonged, with what the tracker makes of the rate."""

    stretch: float
    short_period: bool = False

    def initial(self, *_: Any, **__: Any) -> tuple[tuple[float, float, float], ...]:
        return ()

    def update(self, state: Any, t_s: Array, az_rad: Array, el_rad: Array, sigma_rad: Array) -> Any:
        assert sigma_rad.shape == t_s.shape == (1,)
        return (*state, (float(t_s[0]), float(az_rad[0]), float(el_rad[0])))[-2:]

    def predict(
        self, state: Any, times_s: Array, biased: bool = True
    ) -> tuple[Array, Array, Array]:
        (t0, _, h0), (t1, a1, h1) = state
        ahead = times_s - t1
        elevation = h1 + self.stretch * (h1 - h0) / (t1 - t0) * ahead
        return (
            np.full((times_s.size, 1), a1),
            elevation[:, None],
            np.zeros((2, 2, times_s.size, 1)),
        )


def test_prediction_errors_after_a_loss() -> None:
    times, error = prediction_errors(_Line(1.1), (), _log(), 5.0)
    # measurements at 0…4 s; 0.1°/s of error from then on
    np.testing.assert_allclose(times, np.arange(5.0, 20.0))
    np.testing.assert_allclose(error / DEGREE, 0.1 * (times - 4.0), rtol=1e-9)


def test_scores_by_loss_and_tracker() -> None:
    trackers = {"exact": (_Line(1.0), ()), "hasty": (_Line(1.1), ())}
    exact, hasty, _, late = score(trackers, _log(), [5.0, 10.0], 0.8 * DEGREE)
    assert [exact.tracker, hasty.tracker] == ["exact", "hasty"]
    assert exact.largest_rad < 1e-12
    assert exact.outside_s == 0.0
    assert (hasty.measurements, hasty.predictions) == (5, 15)
    assert hasty.largest_rad == pytest.approx(1.5 * DEGREE)
    assert hasty.rms_rad == pytest.approx(0.1 * DEGREE * np.sqrt(np.mean(np.arange(1, 16) ** 2.0)))
    # out of the beam from 12 s, 0.8°, to 19 s
    assert hasty.outside_s == pytest.approx(7.0)
    assert (late.locked_s, late.measurements) == (10.0, 10)
    assert late.largest_rad == pytest.approx(1.0 * DEGREE)


def test_lines_without_lock_do_not_count() -> None:
    gap = _log(lost=slice(6, 9))
    times, error = prediction_errors(_Line(1.0), (), gap, 5.0)
    assert times.tolist() == [5.0, *np.arange(9.0, 20.0)]
    assert error.max() < 1e-12


@pytest.mark.parametrize("locked_s", [0.0, 20.0])
def test_a_loss_needs_both_sides(locked_s: float) -> None:
    with pytest.raises(InputError, match="on both sides"):
        prediction_errors(_Line(1.0), (), _log(), locked_s)


def test_a_log_comes_back(tmp_path: Path) -> None:
    log = _log(lost=slice(6, 9))
    write_pass_log(tmp_path / "pass.csv", log)
    back = read_pass_log(tmp_path / "pass.csv")
    assert back.epoch.seconds_since(log.epoch) == pytest.approx(0.0, abs=1e-6)
    angles = ("azimuth_rad", "elevation_rad", "sigma_rad", "commanded_azimuth_rad")
    for name in (*angles, "predicted_azimuth_rad", "predicted_elevation_rad"):
        np.testing.assert_allclose(
            getattr(back, name), getattr(log, name), rtol=0, atol=1e-9 * DEGREE
        )
    np.testing.assert_allclose(back.times_s, log.times_s, rtol=0, atol=1e-6)
    assert back.locked.tolist() == log.locked.tolist()
    first = (tmp_path / "pass.csv").read_text().splitlines()[1]
    assert first == (
        "2027-06-01T12:30:00.000000,123.456789012,10.000000000,0.050000000,1,,10.000000000,"
        "114.591559026,10.500000000"
    )


def test_the_trackers_of_this_package_on_a_late_satellite() -> None:
    """Pass 2 over Alcântara, 10 s late, with biased encoders: what each is worth after 1 minute."""
    station = Station("Alcântara", -2.18 * DEGREE, -44.26 * DEGREE, 39.0)
    epoch = Epoch.parse("1989-01-31T09:58:00", "UTC")
    nominal = np.array([7180e3, 0.0436, *(np.array([23.82, 240.14, 15.47, 350.56]) * DEGREE)])
    late = nominal + np.array([0.0, 0.0, 0.0, 0.0, 0.0, -10.0 * 0.0595 * DEGREE])  # 0.0595°/s
    times = 6050.0 + np.arange(420.0)
    table = Table(TableSpec())

    def begun(tracker: Tracker[Any], elements: Array) -> tuple[Tracker[Any], Any]:
        return tracker, tracker.initial(elements[:, None], np.zeros(1), [station], epoch)

    azimuth, elevation, _ = table.predict(begun(table, late)[1], times)
    noise = np.random.default_rng(7).normal(0.0, 0.05 * DEGREE, (2, times.size))
    nothing = np.full(times.size, np.nan)
    log = PassLog(
        epoch,
        times,
        azimuth[:, 0] + 0.1 * DEGREE + noise[0],
        elevation[:, 0] - 0.1 * DEGREE + noise[1],
        np.full(times.size, 0.05 * DEGREE),
        np.ones(times.size, dtype=bool),
        nothing,
        nothing,
        nothing,
        nothing,
    )
    trackers = {
        "table": begun(table, nominal),
        "average": begun(Average(AverageSpec()), nominal),
        "least squares": begun(LeastSquares(LeastSquaresSpec()), nominal),
    }
    scores = {found.tracker: found for found in score(trackers, log, [60.0], 0.5 * DEGREE)}
    assert scores["table"].largest_rad > 1.0 * DEGREE
    assert scores["table"].outside_s > 60.0
    assert scores["least squares"].rms_rad < scores["average"].rms_rad < scores["table"].rms_rad
    assert scores["least squares"].outside_s == 0.0


HEAD = (
    "utc,azimuth_deg,elevation_deg,sigma_deg,locked,commanded_azimuth_deg,commanded_elevation_deg,"
    "predicted_azimuth_deg,predicted_elevation_deg\n"
)
GOOD = "2027-06-01T12:30:00.0,1.0,2.0,0.1,1,,,,\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ":1: a pass log begins with"),
        ("time,az\n", ":1: a pass log begins with"),
        (HEAD, "no measurements"),
        (HEAD + GOOD + GOOD, ":3: .*not after"),
        (HEAD + GOOD.replace("1.0,2", "x,2"), ":2: azimuth_deg must be a number"),
        (HEAD + GOOD.replace("1.0,2", "nan,2"), ":2: azimuth_deg must be finite"),
        (HEAD + GOOD.replace("1.0,2", ",2"), ":2: locked, but"),
        (HEAD + GOOD.replace("0.1,1", "0,1"), ":2: sigma_deg must be > 0"),
        (HEAD + GOOD.replace("0.1,1", "0.1,yes"), ":2: locked must be 0 or 1"),
        (HEAD + GOOD.replace(",,,,", ",,,"), ":2: expected 9 values, got 8"),
        (HEAD + GOOD.replace("2027-06-01", "yesterday"), ":2: expected a time"),
    ],
)
def test_damaged_logs_name_the_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "pass.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_pass_log(path)
    assert "pass.csv" in str(caught.value)


def test_a_missing_log(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read"):
        read_pass_log(tmp_path / "none.csv")


def test_a_log_checks_itself() -> None:
    log = _log()
    columns = {name: getattr(log, name) for name in log.__dataclass_fields__}
    for keys, message in (
        ({"times_s": log.times_s[::-1]}, "rise"),
        ({"times_s": log.times_s[1:]}, "alike"),
        ({"azimuth_rad": np.full(20, np.nan)}, "wherever it was locked"),
    ):
        with pytest.raises(InputError, match=message):
            PassLog(**{**columns, **keys})
