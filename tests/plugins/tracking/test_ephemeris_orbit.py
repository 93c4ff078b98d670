"""Passes of an orbit ephemeris message, against those of the elements that it was made from."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.cli.endings import run
from hillsphere.errors import InputError
from hillsphere.formats.oem import OemSegment, write_oem
from hillsphere.model.earth.rotation import to_earth_fixed
from hillsphere.testing import RecordingContext
from hillsphere.time import Epoch
from hillsphere_tracking.passes.products import PassList
from hillsphere_tracking.passes.sources import orbits_of_file
from hillsphere_tracking.satellites import orbits_of

TLE = """ISS (ZARYA)
1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
"""
PLACE = {"name": "x", "latitude_deg": 48.08, "longitude_deg": 11.28, "height_m": 580}
(SGP4,) = orbits_of(TLE, "tle")
EARTH = create("body", "planet")
STEP_S = 60.0


def segment(begin_s: float, end_s: float, frame: str = "TEME") -> OemSegment:
    """Return SGP4's states of a span in a frame, by the Earth's rotation where it needs one."""
    start = Epoch(SGP4.epoch.day, SGP4.epoch.fraction, "UTC")
    t = np.arange(begin_s, end_s + 1.0, STEP_S)
    x = SGP4.states(t)
    if frame == "ITRF":
        x = to_earth_fixed("teme", x, start, t, EARTH.orientation)
    return OemSegment("ISS", "1998-067A", "EARTH", frame, start, t, x)


def passes(source: dict[str, Any], **keys: Any) -> PassList:
    stage = create("stage", "passes", satellites=[source], stations=[PLACE],
                   **{"duration_d": 1, **keys})  # fmt: skip
    product: PassList = stage.run(RecordingContext())
    return product


def written(path: Path, *segments: OemSegment) -> dict[str, Any]:
    path.write_text(write_oem(segments))
    return {"file": str(path)}


@pytest.mark.parametrize("frame", ["TEME", "ITRF"])
def test_passes_are_those_of_the_elements(frame: str, tmp_path: Path) -> None:
    """Lagrange's polynomials of degree 7 at 60 s are off by 0.3 mm, 40 ns of the motion."""
    expected = passes({"tle": TLE})
    got = passes(written(tmp_path / "iss.oem", segment(0.0, 86400.0, frame)))
    assert expected.rise_s.size > 4
    # ITRF is given by the mean sidereal time of 1982 and read by the model of 2006/2000A; both
    # are the one rotation from there on, and cancel but for the curvature between two states
    for key in ("rise_s", "culmination_s", "set_s"):
        np.testing.assert_allclose(getattr(got, key), getattr(expected, key), atol=2e-5)
    np.testing.assert_allclose(got.elevation_max_rad, expected.elevation_max_rad, atol=1e-8)
    assert any("Lagrange interpolation of degree 7" in told for told in got.warnings)


def test_eme2000_is_turned_by_the_frame_bias(tmp_path: Path) -> None:
    """23 mas, up to 0.8 m in this orbit."""
    source = tmp_path / "eme.oem"
    x = {}
    for frame in ("EME2000", "GCRF"):
        written(source, segment(0.0, 3600.0, frame))
        (orbit,) = orbits_of_file(source)
        assert orbit.frame == "gcrs"
        x[frame] = orbit.states(np.array([0.0]))[:3, 0]
    # IERS Conventions (2010), equations 5.19 and 5.21 to first order: ξ0, η0 and dα0
    xi, eta, alpha = np.radians(np.array([-0.016617, -0.0068192, -0.0146]) / 3600.0)
    to_j2000 = np.array([[0.0, alpha, -xi], [-alpha, 0.0, -eta], [xi, eta, 0.0]])
    off = x["EME2000"] - x["GCRF"]
    assert 0.1 < np.linalg.norm(off) < 1.0
    np.testing.assert_allclose(off, to_j2000.T @ x["GCRF"], atol=2e-4)


def test_no_pass_outside_the_span_and_it_is_told(tmp_path: Path) -> None:
    source = written(tmp_path / "iss.oem", segment(50000.0, 80000.0))
    start = SGP4.epoch.isot(np.zeros(1), 6)[0]
    whole = passes({"tle": TLE}, start=start)
    part = passes(source, start=start)
    inner = (whole.rise_s > 50000.0) & (whole.set_s < 80000.0)
    assert inner.any()
    assert not inner.all()
    complete = ~(part.begun | part.unfinished)
    np.testing.assert_allclose(part.rise_s[complete], whole.rise_s[inner], atol=2e-5)
    assert part.rise_s.min() >= 50000.0 - 1e-5
    assert part.set_s.max() <= 80000.0 + 1e-5
    assert any("no pass outside this span" in told for told in part.warnings)
    with pytest.raises(InputError, match=r"start: expected a search within .* covers .* got 2021"):
        passes(source, start="2021-01-01")


def test_nothing_is_interpolated_across_segments_or_gaps(tmp_path: Path) -> None:
    """Two segments that meet, with a manoeuvre there, and a third after a gap."""
    after = segment(30000.0, 50040.0)
    after.x[3:] += 5.0
    pieces = segment(0.0, 30000.0), after, segment(60000.0, 80040.0)
    path = tmp_path / "iss.oem"
    written(path, *pieces)
    first, second = orbits_of_file(path)
    x = first.states(np.array([29999.999, 30000.0]))
    np.testing.assert_allclose(x[3:, 1] - SGP4.states(np.array([30000.0]))[3:, 0], 5.0, atol=1e-6)
    np.testing.assert_allclose(x[:, 0], SGP4.states(np.array([29999.999]))[:, 0], atol=2e-3)
    assert second.name == "ISS #2"
    assert not second.exists(np.array([-10.0]))[0]
    assert any("no states between" in told for told in second.warnings)
    useable = replace(pieces[0], useable_start_s=600.0, useable_stop_s=1200.0)
    written(path, useable)
    (only,) = orbits_of_file(path)
    assert only.exists(np.array([-1.0, 0.0, 600.0, 601.0])).tolist() == [False, True, True, False]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ref_frame": "TOD_EARTH"}, r"iss.oem: segment 1 \(ISS\): REF_FRAME: expected EME2000.*"
                                     "got TOD_EARTH"),
        ({"center_name": "MARS"}, r"segment 1 \(ISS\): CENTER_NAME: expected EARTH.* got MARS"),
        ({"interpolation": "PROPAGATE"}, r"segment 1 \(ISS\): .*propagated"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_named(change: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = tmp_path / "iss.oem"
    written(path, replace(segment(0.0, 3600.0), **change))
    with pytest.raises(InputError, match=message):
        orbits_of_file(path)


def test_velocities_in_other_units_are_noticed(tmp_path: Path) -> None:
    one = segment(0.0, 3600.0)
    fast = replace(one, x=one.x * np.array([1.0, 1.0, 1.0, 1e3, 1e3, 1e3])[:, None])
    with pytest.raises(InputError, match=r"speeds of 7.* km/s about the Earth, which nothing has"):
        passes(written(tmp_path / "fast.oem", fast))


def test_the_command_takes_an_ephemeris(tmp_path: Path, capsys: Any) -> None:
    path = tmp_path / "iss.oem"
    written(path, segment(0.0, 43200.0))
    assert run(["passes", str(path), "--station", "48.08,11.28,580", "--days", "1"]) == 0
    shown = capsys.readouterr()
    assert "ISS" in shown.out
    assert "no pass outside this span" in shown.err
