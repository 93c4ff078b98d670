"""Flight about the turning Earth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from math import cos, pi, sin, sqrt
from pathlib import Path
from typing import Any

import erfa
import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from hillsphere.base.geodetic import Station, geodetic
from hillsphere.dynamics import ArrayFunction, Taylor, system
from hillsphere.errors import InputError
from hillsphere.gravity import model_parameters
from hillsphere.interfaces import Array
from hillsphere.model.bodies import Moon, MoonSpec
from hillsphere.model.earth.planet import Planet
from hillsphere.model.earth.rotation import earth_fixed, to_earth_fixed, to_inertial
from hillsphere.model.earth.specs import PlanetSpec
from hillsphere.symbolic import time, variables
from hillsphere_gravity.harmonics import Harmonics
from hillsphere_gravity.point_mass import PointMass
from hillsphere_gravity.specs import HarmonicsSpec, PointMassSpec
from hillsphere_plants.atmosphere import nrlmsise00_density
from hillsphere_plants.earth_orbit import EarthOrbit
from hillsphere_plants.earth_orbit_specs import DragSpec, EarthOrbitSpec
from hillsphere_plants.hill import hill
from hillsphere_plants.specs import HillSpec

FIELD = str(Path(__file__).parents[3] / "missions" / "data" / "earth-gravity-degree6.gfc")
DRAG = DragSpec(
    drag_coefficient=2.2, area_to_mass_m2_kg=0.01, f107=150.0, f107_average=150.0, ap=15.0
)
EARTH = Planet(PlanetSpec(orientation="constant"))
DAY = 86400.0
ALCANTARA = Station("Alcântara", np.radians(-2.18), np.radians(-44.26), 39.0)


def _state(a: float, e: float, i: float, node: float, perigee: float, mean: float) -> Array:
    """Return the state (6,) of osculating elements, degrees and metres, for the field's GM."""
    gm = 398600.4415e9
    i, node, perigee, mean = (q * pi / 180.0 for q in (i, node, perigee, mean))
    anomaly = mean
    for _ in range(50):
        anomaly -= (anomaly - e * sin(anomaly) - mean) / (1.0 - e * cos(anomaly))
    x, y = a * (cos(anomaly) - e), a * sqrt(1.0 - e * e) * sin(anomaly)
    rate = sqrt(gm / a**3) / (1.0 - e * cos(anomaly))
    vx, vy = -a * sin(anomaly) * rate, a * sqrt(1.0 - e * e) * cos(anomaly) * rate

    def turn(angle: float, axis: int) -> Array:
        c, s, k = cos(angle), sin(angle), (axis + 1) % 3
        matrix = np.eye(3)
        matrix[np.ix_([k, (k + 1) % 3], [k, (k + 1) % 3])] = [[c, -s], [s, c]]
        return matrix

    axes = turn(node, 2) @ turn(i, 0) @ turn(perigee, 2)
    return np.concatenate([axes @ [x, y, 0.0], axes @ [vx, vy, 0.0]])


# Osculating elements of the orbit of Kuga & Carrara (1990), whose printed ones are mean elements:
# Brouwer's short-period terms of J2 (with Lyddane's recombination) added.
KUGA = _state(
    7182323.3108286, 0.0448086686, 23.8341480375, 240.1481072389, 15.2048059784, 350.8182568758
)


def _field(degree: int = 6, tesseral: int = 4) -> Harmonics:
    return Harmonics(HarmonicsSpec(file=FIELD, max_degree=degree, max_tesseral_degree=tesseral))


def _spec(**keys: Any) -> EarthOrbitSpec:
    given = {"body": EARTH, "gravity": PointMass(PointMassSpec(gm_m3_s2=3.986e14))}
    return EarthOrbitSpec.model_validate({**given, "epoch": "2020-01-01", **keys})


@lru_cache
def _plant(drag: bool = False, frame: str = "teme", arc_s: float = 0.0) -> EarthOrbit:
    keys: dict[str, Any] = {"frame": frame, "drag": DRAG if drag else None}
    if arc_s:
        keys["arc_s"] = arc_s
    return EarthOrbit(_spec(gravity=_field(), epoch="1989-01-31T09:58:00", **keys))


@lru_cache
def _propagator(
    drag: bool = False, frame: str = "teme", arc_s: float = 0.0
) -> Callable[..., Array]:
    flow = system(_plant(drag, frame, arc_s), normalised=True)
    taylor = Taylor(flow)
    unit = flow.unit[:, None]

    def fly(x: Array, t_s: Array | float, t0: float = 0.0) -> Array:
        times = np.atleast_1d(np.asarray(t_s)) / flow.time_unit_s
        found = taylor.sample(x[:, None] / unit, times, t0=t0 / flow.time_unit_s)[:, :, 0]
        return np.asarray(found * unit)

    return fly


# -- an independent right-hand side ---------------------------------------------------------------


def _coefficients() -> dict[tuple[int, int], tuple[float, float]]:
    rows = [
        line.split()[1:]
        for line in Path(FIELD).read_text(encoding="ascii").splitlines()
        if line.startswith("gfc ")
    ]
    return {(int(n), int(m)): (float(c), float(s)) for n, m, c, s in rows}


def _potential(r: Array, table: Mapping[tuple[int, int], tuple[float, float]]) -> float:
    """Sum the series by Legendre functions of the latitude, Heiskanen & Moritz (1967), ch. 1."""
    gm, radius = 398600.4415e9, 6378136.3
    distance = float(np.linalg.norm(r))
    t, u = r[2] / distance, float(np.hypot(r[0], r[1])) / distance
    longitude = float(np.arctan2(r[1], r[0]))
    legendre = {(0, 0): 1.0}
    for m in range(5):
        if m:
            factor = sqrt(3.0) if m == 1 else sqrt((2 * m + 1) / (2 * m))
            legendre[m, m] = factor * u * legendre[m - 1, m - 1]
        for n in range(m + 1, 7):
            a = sqrt((2 * n + 1) * (2 * n - 1) / ((n - m) * (n + m)))
            b = (
                sqrt((2 * n + 1) * (n + m - 1) * (n - m - 1) / ((n - m) * (n + m) * (2 * n - 3)))
                if n > m + 1
                else 0.0
            )
            legendre[n, m] = a * t * legendre[n - 1, m] - b * legendre.get((n - 2, m), 0.0)
    total = 0.0
    for (n, m), (c, s) in table.items():
        if n <= 6 and (m == 0 or n <= 4):
            angle = m * longitude
            total += (radius / distance) ** n * legendre[n, m] * (c * cos(angle) + s * sin(angle))
    return gm / distance * total


def _attraction(r: Array, table: Mapping[tuple[int, int], tuple[float, float]]) -> Array:
    """Differentiate it by differences of the sixth order over 20 km."""
    slope = np.zeros(3)
    for axis in range(3):
        for k, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
            step = np.zeros(3)
            step[axis] = k * 20e3
            slope[axis] += weight * (_potential(r + step, table) - _potential(r - step, table))
    return slope / (60.0 * 20e3)


def test_right_hand_side_against_legendre_functions_and_erfa() -> None:
    """Gravity by another formula, drag by ERFA's geodetic coordinates, at points of the orbit."""
    table = _coefficients()
    plant = _plant(drag=True)
    flow = system(plant)
    rhs = flow.function(*flow.rhs)
    height, latitude, longitude, day = variables("h", "lat", "lon", "day")
    rho_of = ArrayFunction(
        [nrlmsise00_density(height, latitude, longitude, day, 150.0, 150.0, 15.0)],
        (height, latitude, longitude, day),
        (),
    )
    omega = np.array([0.0, 0.0, 7.2921158553e-5])
    times = np.array([0.0, 1000.0, 2500.0, 6036.0])
    states = np.column_stack([KUGA, _propagator()(KUGA, times[1:])])
    for t, x in zip(times, states.T, strict=True):
        turn = earth_fixed("teme", plant.epoch, np.array([t]))[:, :, 0]
        place = turn @ x[:3]
        pull = turn.T @ _attraction(place, table)
        found_latitude, found_longitude, found_height = geodetic(place[:, None])
        moment = np.full(1, 30.0 + (9.0 + 58.0 / 60.0) / 24.0 + t / DAY)
        rho = rho_of(np.stack([found_height, found_latitude, found_longitude, moment]))[0, 0]
        wind = x[3:] - np.cross(omega, x[:3])
        drag = -0.5 * 2.2 * 0.01 * rho * np.linalg.norm(wind) * wind
        found = rhs(x[:, None], None, np.array([t]))[:, 0]
        assert np.array_equal(found[:3], x[3:])
        assert np.allclose(found[3:], pull + drag, rtol=0, atol=1e-9)
        without = system(_plant())
        alone = without.function(*without.rhs)(x[:, None], None, np.array([t]))[:, 0]
        assert np.allclose((found - alone)[3:], drag, rtol=1e-3, atol=1e-14)


@pytest.mark.parametrize("frame", ["teme", "gcrs"])
def test_sun_and_moon_against_erfa(frame: Any) -> None:
    """Third-body acceleration of a geostationary satellite with ERFA's Sun and Moon."""
    keys = {"gravity": _field(), "epoch": "1989-01-31T09:58:00", "frame": frame}
    rates, times = [], np.array([0.0, 3.0 * DAY])
    x = np.tile([[3e7], [2.9e7], [1e6], [-2e3], [2e3], [10.0]], 2)
    for bodies in ([], ["sun"], ["moon"], ["sun", "moon"]):
        plant = EarthOrbit(_spec(third_bodies=bodies, **keys))
        flow = system(plant)
        rates.append(flow.function(*flow.rhs)(x, None, times)[3:])
    tt = plant.epoch.to("TT")
    day = tt.fraction + times / DAY
    sun = -erfa.epv00(tt.day, day)[0]["p"].T * 1.495978707e11
    moon = erfa.moon98(tt.day, day)["p"].T * 1.495978707e11
    now = np.zeros(1)
    turn = np.eye(3)
    if frame == "teme":
        turn = (
            earth_fixed("teme", plant.epoch, now)[..., 0].T
            @ earth_fixed("gcrs", plant.epoch, now)[..., 0]
        )
    expected = []
    for gm, place in ((1.32712440041e20, turn @ sun), (4.9028001e12, turn @ moon)):
        towards = place - x[:3]
        expected.append(
            gm * (towards / np.linalg.norm(towards, axis=0) ** 3
                  - place / np.linalg.norm(place, axis=0) ** 3)
        )  # fmt: skip
    size = float(np.abs(expected).max())
    for found, wanted in zip(rates[1:], (*expected, expected[0] + expected[1]), strict=True):
        assert np.allclose(found - rates[0], wanted, rtol=0, atol=3e-3 * size)


def test_a_day_against_scipy() -> None:
    """DOP853 of SciPy on the compiled right-hand side, with drag."""
    flow = system(_plant(drag=True))
    rhs = flow.function(*flow.rhs)
    end = solve_ivp(
        lambda t, y: rhs(y[:, None], None, np.array([t]))[:, 0],
        (0.0, DAY), KUGA, method="DOP853", rtol=1e-13, atol=1e-6,
    ).y[:, -1]  # fmt: skip
    ours = _propagator(drag=True)(KUGA, DAY)[:, -1]
    assert np.allclose(ours[:3], end[:3], rtol=0, atol=1e-4)
    assert np.allclose(ours[3:], end[3:], rtol=0, atol=1e-7)


@pytest.mark.parametrize("frame, arc_s", [("teme", 0.0), ("gcrs", DAY)])
def test_energy_in_the_turning_frame_is_conserved(frame: str, arc_s: float) -> None:
    """½v² − U − ω·(r × v), with zonal and tesseral terms, over a day; drag takes some away."""
    ends = {}
    for drag in (False, True):
        plant = _plant(drag, frame, arc_s)
        flow = system(plant)
        energy = flow.function(plant.energy(flow.x, time, model_parameters(plant.parameters())))
        times = np.linspace(0.0, DAY, 25)[1:]
        path = _propagator(drag, frame, arc_s)(KUGA, times)
        ends[drag] = (
            energy(path, None, times)[0] / energy(KUGA[:, None], None, np.zeros(1))[0] - 1.0
        )
    assert np.abs(ends[False]).max() < 1e-14
    assert (np.diff(ends[True]) > 0.0).all()
    assert 1e-7 < ends[True][-1] < 1e-5


def _angles(frame: Any, plant: EarthOrbit, x: Array, t: Array) -> Array:
    place = np.einsum("ijn,jn->in", earth_fixed(frame, plant.epoch, t), x[:3])
    east, north, up = ALCANTARA.axes @ (place - ALCANTARA.ecef_m[:, None])
    return np.degrees([np.arctan2(east, north) % (2 * pi), np.arctan2(up, np.hypot(east, north))])


def test_passes_of_kuga_and_carrara() -> None:
    """Alcântara passes 2 and 7 of Kuga & Carrara (1990), as they rise above 5°.

    Angles of an independent integration with an atmosphere of its own, whose drag and constants
    move them by up to 1e-2°; the second pass comes 10 h after the elements, with 1e-2° for 1 km.
    """
    t = np.array([6036.0, 38370.0])
    expected = np.array([[284.031369, 316.156110], [5.048786, 5.044038]])
    for drag in (False, True):
        x = _propagator(drag)(KUGA, t)
        assert np.allclose(_angles("teme", _plant(), x, t), expected, rtol=0, atol=3e-3)


def test_drag_over_one_pass_moves_the_satellite_by_centimetres() -> None:
    """At 500 to 1100 km: below 0.13 m in a pass of 7½ minutes (Alcântara 2), yet not zero."""
    start = _propagator()(KUGA, 6036.0)[:, -1]
    with_drag = _propagator(drag=True)(start, 6486.0, t0=6036.0)[:3, -1]
    without = _propagator()(start, 6486.0, t0=6036.0)[:3, -1]
    moved = float(np.linalg.norm(with_drag - without))
    assert 0.005 < moved < 0.13


def test_both_inertial_frames_fly_the_same_orbit() -> None:
    """A revolution from the same Earth-fixed state.

    The equinox of ``teme`` moves, which is neglected: by 7.1e-12 rad/s GMST runs faster than the
    Earth rotation angle. That is 5e-5 m/s in the velocity at the start, 1 m after a revolution.
    """
    plant, end = _plant(), 5760.0
    fixed = to_earth_fixed("teme", KUGA[:, None], plant.epoch, np.zeros(1))
    start = to_inertial("gcrs", fixed, plant.epoch, np.zeros(1))[:, 0]
    one = _propagator()(KUGA, end)
    two = _propagator(frame="gcrs", arc_s=end)(start, end)
    t = np.array([end])
    one, two = (
        to_earth_fixed("teme", one, plant.epoch, t), to_earth_fixed("gcrs", two, plant.epoch, t),
    )  # fmt: skip
    assert np.linalg.norm((one - two)[:3]) < 4.0


def test_turning_earth_and_orbit_together_changes_nothing() -> None:
    """The angle of the Earth at the epoch is a run-time parameter."""
    plant = _plant()
    flow = system(plant, run_time=["rotation_angle"], normalised=True)
    taylor = Taylor(flow)
    shift, duration = 0.3, 6000.0 / flow.time_unit_s
    c, s = cos(shift), sin(shift)
    turn = np.kron(np.eye(2), [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    starts = np.column_stack([KUGA, turn @ KUGA]) / flow.unit[:, None]
    angles = plant.rotation_angle_rad + np.array([[0.0, shift]])
    ends = taylor.propagate(starts, duration, angles) * flow.unit[:, None]
    assert np.allclose(turn @ ends[:, 0], ends[:, 1], rtol=0, atol=1e-5)


def test_frame_and_axis_of_the_celestial_system() -> None:
    plant = _plant(frame="gcrs", arc_s=2.0 * DAY)
    assert plant.to_equator is not None
    middle = plant.epoch.to("TT")
    pole = erfa.c2i06a(middle.day, middle.fraction + 1.0)[2]
    assert np.allclose(plant.to_equator[2], pole, rtol=0, atol=1e-12)


def test_impact_is_on_the_ellipsoid() -> None:
    plant = _plant()
    flow = system(plant)
    value = flow.function(flow.events["impact"])
    x = np.zeros((6, 3))
    x[0, 0], x[2, 1], x[2, 2] = 6378137.0, 6356752.314245, 6378137.0
    found = value(x, None, np.zeros(3))[0]
    assert np.allclose(found[:2], 0.0, rtol=0, atol=1e-12)
    assert found[2] > 1e-3


@pytest.mark.slow
def test_derivatives_by_the_state_and_by_the_drag() -> None:
    plant = _plant(drag=True)
    flow = system(plant, run_time=["drag.area_to_mass"], normalised=True)
    taylor = Taylor(flow, stm=True, parameters=["drag.area_to_mass"])
    x = KUGA / flow.unit
    duration = 3000.0 / flow.time_unit_s
    _, phi = taylor.propagate(x, duration, np.array([0.01]))
    plain = Taylor(flow)
    h = np.concatenate([np.full(6, 1e-5), [1e-3]])
    for column in range(7):
        ends = []
        for sign in (1.0, -1.0):
            start, p = x.copy(), np.array([0.01])
            if column < 6:
                start[column] += sign * h[column]
            else:
                p += sign * h[column]
            ends.append(plain.propagate(start, duration, p))
        differences = (ends[0] - ends[1]) / (2.0 * h[column])
        scale = np.abs(phi[:, column]).max()
        assert np.allclose(phi[:, column] / scale, differences / scale, rtol=0, atol=1e-6)


# -- what is refused ------------------------------------------------------------------------------


class _Table:
    """Gravity that is a function of arrays."""

    frame = "body"
    gm_m3_s2 = 1.0

    def parameters(self) -> tuple[()]:
        return ()

    def potential_array(self, r: Array, p: Array) -> Array:
        return np.asarray(r[0])

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return r


def test_what_does_not_fit_is_refused() -> None:
    moon = Moon(MoonSpec(primary_gm_m3_s2=4e13, semi_major_axis_m=1e7))
    with pytest.raises(InputError, match="about a body of type 'planet', got a Moon"):
        EarthOrbit(_spec(body=moon))
    with pytest.raises(InputError, match="gravity that is an expression, got a _Table"):
        EarthOrbit(_spec(gravity=_Table()))
    with pytest.raises(InputError, match="expected a time such as"):
        EarthOrbit(_spec(epoch="yesterday"))
    with pytest.raises(ValidationError, match="names a body twice"):
        _spec(third_bodies=["sun", "sun"])
    with pytest.raises(ValidationError, match="goes with frame = 'gcrs'"):
        _spec(arc_d=1)
    with pytest.raises(InputError, match=r"needs a body that orbits another, .* got a Planet"):
        hill(HillSpec.model_validate({"body": EARTH, "gravity": _Table()}))
