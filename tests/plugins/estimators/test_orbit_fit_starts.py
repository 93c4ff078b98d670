"""Starts of the stage ``orbit_fit``: every form gives the state that another code computes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sgp4.api import Satrec
from skyfield.api import load
from skyfield.sgp4lib import TEME
from tests.plugins.estimators import tracking_simulation as sim
from tests.plugins.estimators.test_orbit_fit import stage

from hillsphere import create
from hillsphere.errors import InputError
from hillsphere.formats.opm import Opm, write_opm
from hillsphere.formats.specs import OrbitMessageSpec
from hillsphere.interfaces import Array
from hillsphere.plugins import validate
from hillsphere.testing import RecordingContext
from hillsphere.time import Epoch
from hillsphere_estimators.orbit_fit.specs import FitStartSpec
from hillsphere_estimators.orbit_fit.starting import first_guess, start_epoch
from hillsphere_tracking.element_formats import OmmFile
from hillsphere_tracking.element_sets import fields_of
from hillsphere_tracking.omm import omm_of_fields
from hillsphere_tracking.tle import read_tles

LINES = (
    "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991",
    "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482",
)
TLE = "ISS (ZARYA)\n" + "\n".join(LINES) + "\n"
OTHER = """VANGUARD 1
1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753
2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667
"""


def plant(frame: str, epoch: str) -> Any:
    return create(
        "plant", "earth_orbit", epoch=epoch, frame=frame,
        body=create("body", "planet", orientation="constant"),
        gravity=create("gravity", "point_mass", gm_m3_s2=sim.GM),
    )  # fmt: skip


def guess(frame: str, **keys: Any) -> tuple[Array, Epoch]:
    """Return the first guess, and its date, about a plant of some frame."""
    spec: Any = validate(FitStartSpec, keys, where="start")
    when, orbit = start_epoch(spec), plant(frame, "2019-12-09T16:00:00")
    return first_guess(spec, orbit, when.seconds_since(orbit.epoch)).x, when


def by_sgp4(t_s: float, frame: str) -> Array:
    """Return the state some seconds after the elements' epoch by SGP4 and skyfield's frames."""
    satellite = Satrec.twoline2rv(*LINES)
    day, fraction = satellite.jdsatepoch, satellite.jdsatepochF + t_s / 86400.0
    _, r, v = satellite.sgp4(day, fraction)
    x = 1e3 * np.array([*r, *v])
    if frame == "teme":
        return x
    tai = Epoch(day, fraction, "UTC").to("TAI")
    turn = TEME.rotation_at(load.timescale(builtin=True).tai_jd(tai.day, tai.fraction)).T
    return np.concatenate([turn @ x[:3], turn @ x[3:]])


@pytest.mark.parametrize("frame", ["teme", "gcrs"])
def test_elements_for_sgp4_are_a_start(frame: str, tmp_path: Path) -> None:
    """TLE and OMM, at their epoch and at another date, in both frames of the plant.

    Skyfield's TEME is by its equation of the equinoxes and nutation of 2000; they differ from
    ERFA's of 2006 by some 1e-9 rad, 1e-2 m.
    """
    (tmp_path / "a.tle").write_text(TLE, "utf-8")
    (tmp_path / "two.tle").write_text(TLE + OTHER, "utf-8")
    (one,) = read_tles(TLE, "a")
    elements = Epoch.parse("2019-12-09T16:38:29.363424", "UTC")
    text = OmmFile(OrbitMessageSpec()).write([omm_of_fields(fields_of(one), "a")])[0]
    (tmp_path / "a.omm").write_text(text, "utf-8")
    for keys in (
        {"file": str(tmp_path / "a.tle")},
        {"file": str(tmp_path / "a.omm")},
        {"message": {"file": str(tmp_path / "two.tle"), "object": "25544"}},
        {"message": {"file": str(tmp_path / "two.tle"), "object": "ISS (ZARYA)"}},
    ):
        x, when = guess(frame, **keys)
        np.testing.assert_allclose(x, by_sgp4(0.0, frame), atol=0.05, rtol=0)
        assert abs(when.seconds_since(elements)) < 1e-5
    later = "2019-12-09T17:00:00"
    x, when = guess(frame, file=str(tmp_path / "a.tle"), epoch=later)
    t = Epoch.parse(later, "UTC").seconds_since(elements)
    np.testing.assert_allclose(x, by_sgp4(t, frame), atol=0.05, rtol=0)
    tdb = when.to("TDB").isot(np.zeros(1), 9)[0]
    x, _ = guess(frame, message={"file": str(tmp_path / "a.tle"), "epoch": tdb})
    np.testing.assert_allclose(x, by_sgp4(t, frame), atol=0.05, rtol=0)


@pytest.mark.parametrize("frame", ["teme", "gcrs"])
@pytest.mark.parametrize("stated", ["TEME", "GCRF", "EME2000"])
def test_a_state_message_is_a_start(frame: str, stated: str, tmp_path: Path) -> None:
    """Whatever its frame and the plant's; as ``file`` and as ``message``."""
    epoch = Epoch.parse("2019-12-09T16:38:29.363424", "UTC")
    x = by_sgp4(0.0, "teme" if stated == "TEME" else "gcrs")
    if stated == "EME2000":
        from skyfield.framelib import ICRS_to_J2000

        x = np.concatenate([ICRS_to_J2000 @ x[:3], ICRS_to_J2000 @ x[3:]])
    path = tmp_path / "a.opm"
    path.write_text(write_opm(Opm("ISS", "1998-067A", "EARTH", stated, epoch, x)), "utf-8")
    for keys in ({"file": str(path)}, {"message": {"file": str(path)}}):
        found, when = guess(frame, **keys)
        np.testing.assert_allclose(found, by_sgp4(0.0, frame), atol=0.05, rtol=0)
        assert abs(when.seconds_since(epoch)) < 1e-6
    sound = path.read_text("utf-8")
    path.write_text(sound.replace("CENTER_NAME", "COLOUR = red\nCENTER_NAME"), "utf-8")
    with pytest.raises(InputError, match=r"start.file: a.opm:\d+: .*COLOUR"):
        guess(frame, file=str(path))
    with pytest.warns(UserWarning, match="COLOUR"):
        guess(frame, file=str(path), lenient=True)
    path.write_text(sound.replace("EARTH", "MARS"), "utf-8")
    with pytest.raises(InputError, match=r"start.file: a.opm: CENTER_NAME: expected EARTH"):
        guess(frame, file=str(path))


@pytest.mark.parametrize("frame", ["teme", "gcrs"])
def test_an_inertial_start_is_turned_to_the_frame(frame: str) -> None:
    """Axes of the stars about a plant in TEME, at a date that stands once."""
    x, when = by_sgp4(0.0, "gcrs"), Epoch.parse("2019-12-09T16:38:29.363424", "UTC")
    inertial = {"position_m": x[:3].tolist(), "velocity_m_s": x[3:].tolist(), "axes": "icrf",
                "epoch": when.to("TDB").isot(np.zeros(1), 9)[0]}  # fmt: skip
    found, said = guess(frame, inertial=inertial)
    np.testing.assert_allclose(found, by_sgp4(0.0, frame), atol=0.05, rtol=0)
    assert abs(said.seconds_since(when)) < 1e-5
    with pytest.raises(InputError, match=r"start.epoch: expected the instant of start.inertial"):
        guess(frame, inertial=inertial, epoch="2019-12-09T17:00:00")


def test_a_start_is_given_once(tmp_path: Path) -> None:
    path = tmp_path / "two.tle"
    path.write_text(TLE + OTHER, "utf-8")
    with pytest.raises(InputError, match=r"expected one satellite, got ISS .ZARYA., VANGUARD 1"):
        guess("teme", file=str(path))
    with pytest.raises(InputError, match="no satellite 'ISS'"):
        guess("teme", message={"file": str(path), "object": "ISS"})
    with pytest.raises(InputError, match=r"message\.epoch"):
        guess("teme", message={"file": str(path)}, epoch="2019-12-09T17:00:00")
    with pytest.raises(InputError, match="give the start once"):
        guess("teme", message={"file": str(path)}, file=str(path))


def test_the_covariance_of_a_message_is_the_prior_of_a_fit(tmp_path: Path) -> None:
    """In RTN, so strong that coarse data change nothing; a message without one is refused."""
    x, sigma = sim.START, np.array([300.0, 200.0, 100.0, 0.3, 0.2, 0.1])
    radial, normal = x[:3] / np.linalg.norm(x[:3]), np.cross(x[:3], x[3:])
    normal /= np.linalg.norm(normal)
    axes = np.column_stack([radial, np.cross(normal, radial), normal])
    turn = np.kron(np.eye(2), axes)
    expected = turn @ np.diag(sigma**2) @ turn.T
    path = tmp_path / "a.opm"
    keys: dict[str, Any] = {
        "start": {"file": str(path)}, "prior": "message",
        "noise": [{"range_km": 1e5, "range_rate_km_s": 1e3}],
    }  # fmt: skip
    epoch = Epoch.parse(sim.DATE, "UTC")
    stated = Opm("SAT", "1", "EARTH", "TEME", epoch, x, covariance=np.diag(sigma**2),
                 covariance_frame="RTN")  # fmt: skip
    path.write_text(write_opm(stated), "utf-8")
    product = stage(**keys).run(RecordingContext())
    size = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    np.testing.assert_allclose(product.covariance / size, expected / size, atol=1e-3)
    path.write_text(write_opm(Opm("SAT", "1", "EARTH", "TEME", epoch, x)), "utf-8")
    with pytest.raises(InputError, match=r"^prior: start.file states no covariance"):
        stage(**keys).run(RecordingContext())
    with pytest.raises(InputError, match=r"'message' needs start.message"):
        stage(prior="message")
