"""Orbits of satellites: against skyfield, other element formats, and flights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sgp4.api import Satrec
from sgp4.exporter import export_omm
from skyfield.api import EarthSatellite, load
from skyfield.sgp4lib import TEME

from hillsphere import create
from hillsphere.dynamics import Taylor, system
from hillsphere.errors import InputError, PropagationError
from hillsphere.interfaces import Array
from hillsphere.plugins import validate
from hillsphere.products import Trajectories
from hillsphere.time import Epoch
from hillsphere_tracking.passes.flights import FlownOrbit
from hillsphere_tracking.passes.sources import orbits_from
from hillsphere_tracking.satellite_specs import SatelliteSpec
from hillsphere_tracking.satellites import (
    MeanElementsOrbit,
    Sgp4Orbit,
    earth_fixed_states,
    last_instant,
    orbits_of,
)

# Element sets of the verification of SGP4 by Vallado, Crawford, Hujsak and Kelso (2006, AIAA
# 2006-6753), and one of the space station.
SETS = {
    "station": (
        "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991",
        "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482",
    ),
    "molniya": (
        "1 08195U 75081A   06176.33215444  .00000099  00000-0  11873-3 0   813",
        "2 08195  64.1586 279.0717 6877146 264.7651  20.2257  2.00491383225656",
    ),
    "geostationary": (
        "1 28626U 05008A   06176.46683397 -.00000205  00000-0  10000-3 0  2190",
        "2 28626   0.0019 286.9433 0000335  13.7918  55.6504  1.00270176  4891",
    ),
    "sun-synchronous": (
        "1 28057U 03049A   06177.78615833  .00000060  00000-0  35940-4 0  1836",
        "2 28057  98.4283 247.6961 0000884  88.1964 271.9322 14.35478080140550",
    ),
    "decaying": (
        "1 29141U 85108AA  06170.26783845  .99999999  00000-0  13519-0 0   718",
        "2 29141  82.4288 273.4882 0015848 277.2124  83.9133 15.93343074  6828",
    ),
}
LASTING = ("station", "molniya", "geostationary", "sun-synchronous")
MU = 398600.4418e9


def orbit(name: str) -> Sgp4Orbit:
    return orbits_of("\n".join(SETS[name]), name)[0]


def kepler(t: float, x: Array) -> Array:
    return np.concatenate([x[3:], -MU * x[:3] / np.linalg.norm(x[:3]) ** 3])


@pytest.mark.parametrize("name", LASTING)
def test_states_are_those_of_skyfield_over_a_day(name: str) -> None:
    ours = orbit(name)
    t_s = np.linspace(-43200.0, 86400.0, 200)
    clock = load.timescale(builtin=True)
    theirs = EarthSatellite(*SETS[name], ts=clock)
    # not from skyfield's own epoch, which holds 0.01 ms
    tai = ours.epoch.to("TAI")
    when = clock.tai_jd(tai.day, tai.fraction + t_s / 86400.0)
    r, v = theirs.at(when).frame_xyz_and_velocity(TEME)
    x = ours.states(t_s)
    np.testing.assert_allclose(x[:3], r.m, rtol=0, atol=1e-5)
    np.testing.assert_allclose(x[3:], v.m_per_s, rtol=0, atol=1e-7)


@pytest.mark.parametrize("form", ["kvn", "xml"])
@pytest.mark.parametrize("name", LASTING)
def test_messages_give_the_states_of_the_element_sets(name: str, form: str) -> None:
    fields = export_omm(Satrec.twoline2rv(*SETS[name]), name.upper())
    header = {"CREATION_DATE": "2026-11-21T10:00:00", "ORIGINATOR": "HILLSPHERE"}
    fields = header | fields
    if form == "kvn":
        text = "CCSDS_OMM_VERS = 2.0\n" + "\n".join(f"{k} = {v}" for k, v in fields.items())
    else:
        leaves = "".join(f"<{k}>{v}</{k}>" for k, v in fields.items())
        text = (
            '<?xml version="1.0"?><ndm><omm version="2.0"><body><segment><metadata/>'
            f"<data>{leaves}</data></segment></body></omm></ndm>"
        )
    (ours,) = orbits_of(text, form)
    assert ours.name == name.upper()
    beside = orbit(name)
    t_s = np.linspace(0.0, 86400.0, 50)
    moved = beside.epoch.seconds_since(ours.epoch)
    assert abs(moved) < 2e-6
    x, y = ours.states(t_s + moved), beside.states(t_s)
    # the message holds microseconds of the epoch, and rounded elements
    np.testing.assert_allclose(x[:3], y[:3], rtol=0, atol=0.02)


def test_a_decayed_satellite_is_named_with_its_day() -> None:
    falling = orbit("decaying")
    t_s = np.arange(0.0, 440.0) * 60.0
    end = last_instant(falling, falling.epoch, t_s)
    assert end is not None
    assert 420.0 * 60.0 < end < 440.0 * 60.0
    # the last state of the verification's output, at 420 minutes
    np.testing.assert_allclose(
        falling.states(np.array([420.0 * 60.0]))[:3, 0],
        [-852939.10071, 192652.32023, -6322470.54784],
        rtol=0,
        atol=0.01,
    )
    assert np.isfinite(falling.states(np.array([end]))).all()
    with pytest.raises(PropagationError, match=r"29141.*has decayed 0\.29 days after"):
        falling.states(np.array([0.0, 440.0 * 60.0]))
    with pytest.raises(PropagationError, match=r"has no orbit .* days before the epoch.*older"):
        falling.states(np.array([-60.0]) * 365.25 * 86400.0)
    # days later the theory gives numbers again
    assert not falling.exists(np.array([48.0, 96.0]) * 3600.0).any()
    with pytest.raises(PropagationError, match=r"has decayed .*newer elements"):
        last_instant(falling, falling.epoch, np.array([440.0, 450.0]) * 60.0)
    assert last_instant(orbit("station"), falling.epoch, np.zeros(1)) is None


def test_elements_without_an_orbit_are_refused() -> None:
    # of the verification set too: error 3 from the beginning
    line1 = "1 33334U 78066F   06174.85818871  .00000620  00000-0  10000-3 0  6806"
    line2 = "2 33334  68.4714 236.1303 5602877 123.7484 302.5767  0.00001000 67521"
    with pytest.raises(InputError, match="define no orbit at their own epoch"):
        orbits_of(f"{line1}\n{line2}", "tle")


def test_times_that_are_no_numbers_are_refused() -> None:
    with pytest.raises(InputError, match="finite"):
        orbit("station").states(np.array([0.0, np.nan]))


def test_mean_elements_without_perturbation_are_keplers_orbit() -> None:
    from hillsphere_tracking.mean_elements import ZonalField

    field = ZonalField(MU, 6378137.0, 0.0, 0.0)
    epoch = Epoch.parse("1989-01-31T09:58:00", "UTC")
    ours = MeanElementsOrbit("one", epoch, np.array([7.2e6, 0.05, 0.4, 1.0, 2.0, 3.0]), field)
    t_s = np.linspace(0.0, 7000.0, 9)
    x = ours.states(t_s)
    flown = solve_ivp(kepler, (0, 7000.0), x[:, 0], "DOP853", t_s, rtol=1e-12, atol=1e-6).y
    np.testing.assert_allclose(x, flown, rtol=0, atol=1e-3)


def test_a_flight_is_interpolated_to_a_billionth() -> None:
    x0 = np.array([6.9e6, 0.0, 0.0, 100.0, 5.5e3, 5.6e3])
    fine = np.linspace(0.0, 6000.0, 6001)
    exact = solve_ivp(kepler, (0, 6000.0), x0, "DOP853", fine, rtol=1e-13, atol=1e-7).y
    epoch = Epoch.parse("2027-06-01", "UTC")
    flight = FlownOrbit("f", epoch, "gcrs", fine[::30], exact[:, ::30])
    x = flight.states(fine)
    assert np.abs(x[:3] - exact[:3]).max() < 1e-9 * 6.9e6 / 2
    assert np.abs(x[3:] - exact[3:]).max() < 1e-9 * 7.8e3
    assert flight.error_m < 1e-9 * 6.9e6
    # the estimate tells of coarse steps, and where they are refused they would be wrong
    coarse = FlownOrbit("f", epoch, "gcrs", fine[::300], exact[:, ::300], tolerance=1e-3)
    missed = np.abs(coarse.states(fine)[:3] - exact[:3]).max()
    assert 0.1 * missed < coarse.error_m < 30.0 * missed
    with pytest.raises(InputError, match="shorter steps"):
        FlownOrbit("f", epoch, "gcrs", fine[::300], exact[:, ::300])


def test_a_flight_of_the_taylor_propagator() -> None:
    """A coast with gravity of the Earth as a point, as a product holds it: an ellipse of Kepler."""
    from hillsphere_tracking.mean_elements import ZonalField

    gravity = create("gravity", "point_mass", gm_m3_s2=MU)
    epoch = Epoch.parse("1989-01-31T09:58:00", "UTC")
    plant = create("plant", "earth_orbit", gravity=gravity, body=create(
        "body", "planet", orientation="constant"), epoch="1989-01-31T09:58:00")  # fmt: skip
    exact = MeanElementsOrbit(
        "one", epoch, np.array([7.18e6, 0.0436, 0.4, 4.0, 0.3, 6.1]),
        ZonalField(MU, 6378137.0, 0.0, 0.0),
    )  # fmt: skip
    t_s = np.arange(0.0, 7000.0, 30.0)
    flow = system(plant)
    x = Taylor(flow).sample(exact.states(np.zeros(1)), t_s)
    names = tuple(v.name for v in plant.states)
    flights = Trajectories(plant.frame, names, ("p",), ("coast",), t_s[:, None], x)
    flown = FlownOrbit.of_coast(flights, 0, epoch)
    when = np.linspace(0.0, 6970.0, 500)
    np.testing.assert_allclose(flown.states(when), exact.states(when), rtol=0, atol=1e-3)
    assert flown.name == "coast"
    hill = Trajectories("hill:moon", names, ("p",), ("coast",), t_s[:, None], x)
    with pytest.raises(InputError, match="in teme or gcrs, got a flight in 'hill:moon'"):
        FlownOrbit.of_coast(hill, 0, epoch)


def test_a_flight_ends_where_its_states_end() -> None:
    t_s = np.arange(8.0) * 10.0
    x = np.concatenate([np.full((3, 8), 7e6) + t_s, np.ones((3, 8))])
    epoch = Epoch.parse("2027-06-01", "UTC")
    flight = FlownOrbit("f", epoch, "teme", t_s, x)
    assert last_instant(flight, epoch, np.linspace(0.0, 100.0, 11)) == pytest.approx(70.0, abs=2e-3)
    with pytest.raises(PropagationError, match="lasts from 0 to 70 s"):
        flight.states(np.array([71.0]))
    with pytest.raises(InputError, match="times must rise"):
        FlownOrbit("f", epoch, "teme", t_s[::-1], x)
    with pytest.raises(InputError, match="at least 5"):
        FlownOrbit("f", epoch, "teme", t_s[:4], x[:, :4])


@pytest.mark.parametrize("name", LASTING)
def test_no_times_give_no_states(name: str) -> None:
    ours = orbit(name)
    assert earth_fixed_states(ours, ours.epoch, np.zeros(0)).shape == (6, 0)


def test_earth_fixed_velocity_is_the_derivative_of_the_position() -> None:
    ours = orbit("station")
    t_s = np.array([-0.5, 0.0, 0.5]) + 1000.0
    x = earth_fixed_states(ours, ours.epoch, t_s)
    np.testing.assert_allclose((x[:3, 2] - x[:3, 0]), x[3:, 1], rtol=0, atol=0.05)


def _satellites(*tables: dict[str, object]) -> tuple[SatelliteSpec, ...]:
    made = [validate(SatelliteSpec, table, where="satellite") for table in tables]
    return tuple(spec for spec in made if isinstance(spec, SatelliteSpec))


def test_satellites_of_a_file_by_name_number_or_all(tmp_path: Path) -> None:
    path = tmp_path / "two.tle"
    path.write_text(
        "0 ISS (ZARYA)\r\n" + "\r\n".join(SETS["station"]) + "\r\n\r\n"
        "MOLNIYA 2-14\r\n" + "\r\n".join(SETS["molniya"]) + "\r\n"
    )  # fmt: skip
    file = str(path)
    both = orbits_from(_satellites({"file": file}))
    assert [one.name for one in both] == ["ISS (ZARYA)", "MOLNIYA 2-14"]
    assert orbits_from(_satellites({"file": file, "name": "8195"}))[0].name == "MOLNIYA 2-14"
    with pytest.raises(InputError, match=r"no satellite 'hubble'.*ISS \(ZARYA\), MOLNIYA"):
        orbits_from(_satellites({"file": file, "name": "hubble"}))
    with pytest.raises(InputError, match="occurs twice; give each satellite its own label"):
        orbits_from(_satellites({"file": file}, {"file": file}))
    twins = _satellites(
        {"file": file, "name": "25544"}, {"file": file, "name": "25544", "label": "ISS again"}
    )
    assert [one.name for one in orbits_from(twins)] == ["ISS (ZARYA)", "ISS again"]
    with pytest.raises(InputError, match=r"two\.tle: the label 'both' would name 2"):
        orbits_from(_satellites({"file": file, "label": "both"}))
    with pytest.raises(InputError, match="cannot be read"):
        orbits_from(_satellites({"file": str(tmp_path / "none.tle")}))
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a text file"):
        orbits_from(_satellites({"file": file}))


def test_wrong_satellites_are_refused() -> None:
    elements = {
        "epoch": "1989-01-31T09:58:00",
        "semi_major_axis_km": 7180,
        "eccentricity": 0.2,
        "inclination_deg": 23.82,
        "node_deg": 240.14,
        "perigee_deg": 15.47,
        "mean_anomaly_deg": 350.56,
    }
    tle = "\n".join(SETS["station"])
    with pytest.raises(InputError, match="exactly one of tle, file and elements, got none"):
        _satellites({"name": "a"})
    with pytest.raises(InputError, match="got tle and elements"):
        _satellites({"name": "a", "tle": tle, "elements": elements})
    with pytest.raises(InputError, match="need the satellite's name"):
        _satellites({"elements": elements})
    with pytest.raises(InputError, match="perigee, 5744 km"):
        orbits_from(_satellites({"name": "a", "elements": elements}))
    bad = {**elements, "epoch": "1989-02-31", "eccentricity": 0.0}
    with pytest.raises(InputError, match="'a': epoch"):
        orbits_from(_satellites({"name": "a", "elements": bad}))
    with pytest.raises(InputError, match="expected one element set, got 2"):
        orbits_from(_satellites({"tle": tle + "\n" + "\n".join(SETS["molniya"])}))
