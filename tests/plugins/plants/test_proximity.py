"""Spacecraft near a spinning asteroid: published case Apophis, and flights among the stars."""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from hillsphere import create
from hillsphere.dynamics import Derivatives, StepMap, Taylor, system
from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array
from hillsphere.testing import check_plant, check_stage
from hillsphere_plants.formation_reference.presentation import present_formation
from hillsphere_plants.formation_reference.stage import (
    FormationReference,
    reference_states,
    relative_orbit,
)
from hillsphere_plants.proximity_specs import RelativeElementsSpec

AU = 1.495978707e11
GM_SUN, GM = 1.32712440018e20, 1.801599
A, E = 0.9224 * AU, 0.1912
RATE = 5.8177e-5
AXES = (191.0, 135.0, 95.0)
C20, C22 = -3665.6, 912.8
PUSH = 0.2 * 20.0 / 500.0
STATE_A = np.array([29.0053037623, -1503.35866206, 407.105801689, 1e-4, -2e-4, 3e-4])
TABLE_2 = (
    {"eccentricity": -2.102e-10, "inclination_rad": 3.257e-9, "node_rad": 2.976e-8,
     "periapsis_rad": -4.318e-8},
    {"eccentricity": 0.08913e-10, "inclination_rad": 3.828e-9, "node_rad": 5.370e-8,
     "periapsis_rad": -7.266e-8},
)  # fmt: skip


def apophis(**keys: Any) -> Any:
    given: dict[str, Any] = {
        "name": "apophis", "primary_gm_m3_s2": GM_SUN, "semi_major_axis_m": A, "eccentricity": E,
        "inclination_rad": 0.05814, "periapsis_rad": 2.2061, "rotation_rate_rad_s": RATE,
        "semi_axes_m": AXES, **keys,
    }  # fmt: skip
    return create("body", "asteroid", **given)


def second_degree(c20: float, c22: float, gm: float = GM) -> Any:
    return create(
        "gravity", "harmonics", gm_m3_s2=gm, reference_radius_m=AXES[0], normalisation="none",
        tide_system="none", coefficients=[
            {"n": 2, "m": 0, "c": c20 / AXES[0] ** 2}, {"n": 2, "m": 2, "c": c22 / AXES[0] ** 2}
        ],
    )  # fmt: skip


EXACT = ((2 * AXES[2] ** 2 - AXES[0] ** 2 - AXES[1] ** 2) / 10, (AXES[0] ** 2 - AXES[1] ** 2) / 20)


def plant(count: int = 1, **keys: Any) -> Any:
    craft = {"reflectivity": 0.2, "area_to_mass_m2_kg": 0.04}
    given: dict[str, Any] = {
        "body": apophis(),
        "gravity": second_degree(*EXACT),
        "spacecraft": [craft] * count,
        **keys,
    }
    return create("plant", "proximity", **given)


def test_coefficients_of_the_ellipsoid() -> None:
    assert pytest.approx((C20, C22)) == EXACT


def test_acceleration_at_apophis() -> None:
    """Two spacecraft in the same state, and the asteroid at perihelion; 40 digits elsewhere."""
    found = system(plant(2))
    rates = found.function(*found.rhs)(np.tile(STATE_A, 2))
    want = [5.1677688805264073e-08, 7.1531123767030794e-07, -1.9421041879054527e-07]
    np.testing.assert_allclose(rates[[3, 4, 5]], want, rtol=1e-12)
    np.testing.assert_array_equal(rates[6:], rates[:6])
    np.testing.assert_array_equal(rates[:3], STATE_A[3:])


def direct_accelerations(x: Any, u: Any = None) -> Any:
    """Accelerations at perihelion as the equations are printed, the Sun's difference naive."""
    h, r_sun = np.sqrt(GM_SUN * A * (1 - E * E)), A * (1 - E)
    turn = h / r_sun**2
    px, py, pz, vx, vy, _ = x
    d = np.sqrt(px**2 + py**2 + pz**2)
    from_sun = np.sqrt((r_sun + px) ** 2 + py**2 + pz**2)
    c20, c22 = EXACT
    zonal, sectoral, place = GM * c20, 3 * GM * c22, np.array([px, py, pz])
    s2 = (pz / d) ** 2
    pull = -GM * place / d**3 + zonal / 2 * (3 - 15 * s2) * place / d**5
    pull = pull + np.array([0, 0, 3 * zonal * pz / d**5])
    pull = pull + sectoral * (
        np.array([2 * px, -2 * py, 0 * pz]) / d**5 - 5 * (px**2 - py**2) * place / d**7
    )
    sun = (
        GM_SUN / r_sun**2 * np.array([1, 0, 0])
        - GM_SUN * (place + np.array([r_sun, 0, 0])) / from_sun**3
    )
    seen = np.array([2 * turn * vy + turn**2 * px, -2 * turn * vx + turn**2 * py, 0 * pz])
    return pull + sun + seen


def test_gravity_gradient_at_apophis() -> None:
    """Exact derivatives against the complex step of the equations as they are printed."""
    exact = Derivatives(system(plant())).both(STATE_A[:, None])[1][:, :, 0]
    assert exact.shape[:2] == (6, 6)
    step = 1e-30
    for column in range(6):
        x = STATE_A.astype(complex)
        x[column] += 1j * step
        want = direct_accelerations(x).imag / step
        size = np.abs(exact[3:, : 3 if column < 3 else 6]).max()
        np.testing.assert_allclose(exact[3:, column], want, rtol=0, atol=1e-9 * size)
    printed = [
        [-4.72929e-10, -2.54276e-11, 6.9121e-12],
        [-2.54276e-11, 8.52088e-10, -3.60970e-10],
        [6.9121e-12, -3.60970e-10, -3.78931e-10],
    ]
    np.testing.assert_allclose(exact[3:, :3], printed, rtol=0, atol=6e-16)


@pytest.mark.parametrize(
    ("field", "hours"),
    [
        (create("gravity", "point_mass", gm_m3_s2=GM), 14.1212),
        (second_degree(*EXACT), 14.0935),
    ],
)
def test_uncontrolled_flight_ends_on_the_asteroid(field: Any, hours: float) -> None:
    made = plant(gravity=field)
    flight = Taylor(system(made), events=["impact"]).fly(STATE_A[:, None], 86400.0)
    assert flight.ended_by == ("impact",)
    assert flight.time[0] / 3600.0 == pytest.approx(hours, abs=5e-5)
    turn = made.scene(flight.time)["to_body"][:, :, 0]
    level = float(np.sum((turn @ flight.x[:3, 0] / np.array(AXES)) ** 2))
    assert level == pytest.approx(1.0, abs=1e-9)
    again = StepMap(system(made)).propagate(STATE_A, flight.time[0], 500)
    np.testing.assert_allclose(again[:3], flight.x[:3, 0], rtol=0, atol=1e-6)


def among_stars(angle: float, v: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]])


@pytest.mark.parametrize(("tilt", "equinox", "angle"), [(0.0, 0.7, 1.1), (1.9, 0.6, 0.4)])
def test_flight_among_the_stars(tilt: float, equinox: float, angle: float) -> None:
    """Sun, asteroid on its ellipse and spacecraft by SciPy, so near the Sun that the tide tells.

    Axes: z the orbit normal, x from the Sun to the perihelion. The spin axis leans by the obliquity
    towards where the Sun goes at the equinox.
    """
    sun, a, e, start, duration = 1e14, 3e7, 0.4, 0.9, 12000.0
    rate, pressure = 3.3e-4, 1e-11
    field = create("gravity", "ellipsoid", axes_m=(17e3, 8e3, 6e3), gm_m3_s2=4.46e5)
    of = apophis(
        primary_gm_m3_s2=sun, semi_major_axis_m=a, eccentricity=e, rotation_rate_rad_s=rate,
        obliquity_rad=tilt, equinox_anomaly_rad=equinox, semi_axes_m=(17e3, 8e3, 6e3),
    )  # fmt: skip
    made = plant(
        body=of, gravity=field, true_anomaly_rad=start, rotation_angle_rad=angle,
        radiation_pressure_n_m2=pressure,
    )  # fmt: skip
    n, push = sqrt(sun / a**3), PUSH * pressure * AU**2
    pull = GravityField(field)

    def anomaly(t: float) -> tuple[float, float]:
        def mean(f: float) -> float:
            big = 2 * np.arctan(np.sqrt((1 - e) / (1 + e)) * np.tan(f / 2))
            return float(big - e * np.sin(big))

        f = float(brentq(lambda q: mean(q) - mean(start) - n * t, start - 0.1, 3.1, xtol=1e-15))
        return f, sqrt(sun * a * (1 - e * e)) / (a * (1 - e * e) / (1 + e * np.cos(f))) ** 2

    def out(f: float) -> Array:
        return np.array([np.cos(f), np.sin(f), 0.0])

    ahead = np.array([-np.sin(equinox), np.cos(equinox), 0.0])
    spin = np.cos(tilt) * np.array([0, 0, 1.0]) - np.sin(tilt) * ahead

    def axes(t: float) -> Array:
        turned = angle + start - equinox + rate * t
        first = out(equinox) * np.cos(turned) + np.cross(spin, out(equinox)) * np.sin(turned)
        return np.array([first, np.cross(spin, first), spin])

    def motion(t: float, y: Array) -> Array:
        f, _ = anomaly(t)
        sun_to = a * (1 - e * e) / (1 + e * np.cos(f)) * out(f)
        body = axes(t)
        total = body.T @ pull.acceleration(body @ y[:3])
        craft = sun_to + y[:3]
        total = total - sun * (
            craft / np.linalg.norm(craft) ** 3 - sun_to / np.linalg.norm(sun_to) ** 3
        )
        return np.concatenate([y[3:], total + push / (sun_to @ sun_to) * out(f)])

    x = np.array([25e3, -18e3, 9e3, 1.0, 2.0, -0.5])
    f0, turn0 = anomaly(0.0)
    y0 = np.concatenate(
        [among_stars(f0, x[:3]), among_stars(f0, x[3:] + turn0 * np.array([-x[1], x[0], 0]))]
    )
    y1 = solve_ivp(motion, (0, duration), y0, method="DOP853", rtol=1e-11, atol=1e-8).y[:, -1]
    f1, turn1 = anomaly(duration)
    place = among_stars(-f1, y1[:3])
    speed = among_stars(-f1, y1[3:]) - turn1 * np.array([-place[1], place[0], 0])
    found = StepMap(system(made)).propagate(x, duration, 200)
    np.testing.assert_allclose(found[:3], place, rtol=0, atol=2e-4)
    np.testing.assert_allclose(found[3:], speed, rtol=0, atol=1e-7)
    assert np.linalg.norm(place - x[:3]) > 1e3


def test_terms_of_time_stand_apart() -> None:
    """Kepler's equation once for all lanes, or in each: the same flight."""
    two = plant(2)
    whole = StepMap(system(two, controls=True), "rk6")
    equations = system(two, controls=True, apart=True)
    names = {"orbit.distance", "orbit.rate", "orbit.acceleration", "orbit.travelled"}
    assert set(equations.time_terms) == names
    apart = StepMap(equations, "rk6")
    random = np.random.default_rng(4)
    x = np.tile(STATE_A, 2)[:, None] * random.uniform(0.9, 1.1, size=(12, 5))
    u = 1e-6 * random.normal(size=(6, 5))
    many, same = np.linspace(-1e7, 2e7, 5), np.full(5, 3e6)
    for t0, duration in ((many, 0.1 * same), (same, many), (same, 0.001 * same)):
        want = whole.propagate(x, duration, 3, u, t0, strict=False)
        found = apart.propagate(x, duration, 3, u, t0, strict=False)
        np.testing.assert_allclose(found, want, rtol=1e-12)


def test_scene_is_that_of_the_equations() -> None:
    made = plant(true_anomaly_rad=0.3, rotation_angle_rad=0.2)
    t = np.array([0.0, 3600.0, 1e6])
    scene, f = made.scene(t), made.anomaly(t)
    distance = A * (1 - E * E) / (1 + E * np.cos(f))
    np.testing.assert_allclose(scene["sun"][0], -distance, rtol=1e-14)
    phase = 0.2 + RATE * t - (f - f[0])
    np.testing.assert_allclose(scene["to_body"][0, 0], np.cos(phase), rtol=0, atol=1e-12)
    np.testing.assert_allclose(scene["to_body"][0, 1], np.sin(phase), rtol=0, atol=1e-12)
    mean = [brentq(lambda m, g=g: g - _true(m), -1, 7, xtol=1e-15) for g in f]
    np.testing.assert_allclose(np.diff(mean), np.diff(t) * sqrt(GM_SUN / A**3), rtol=1e-9)


def test_scene_of_another_spin() -> None:
    made, t = plant(), np.array([0.0, 8e4])
    scene = made.scene(t, rotation_rate=np.array([RATE, 1.01 * RATE]), rotation_angle=0.3)
    f = made.anomaly(t)
    phase = 0.3 + 1.01 * RATE * t[1] - (f[1] - f[0])
    np.testing.assert_allclose(scene["to_body"][0, :, 1], [np.cos(phase), np.sin(phase), 0.0])
    with pytest.raises(InputError, match="no parameter spin; it has primary_gm"):
        made.scene(t, spin=1.0)


def _true(mean: float) -> float:
    big = brentq(lambda q: q - E * np.sin(q) - mean, mean - 1, mean + 1, xtol=1e-15)
    half = np.sqrt((1 + E) / (1 - E)) * np.tan(big / 2)
    return float(2 * np.arctan(half) + 2 * pi * np.round(big / (2 * pi)))


def test_mean_anomaly_of_the_body_gives_the_start() -> None:
    made = plant(body=apophis(mean_anomaly_rad=0.5))
    assert made.true_anomaly_rad == pytest.approx(_true(0.5), abs=1e-14)
    assert plant(body=apophis(mean_anomaly_rad=0.5), true_anomaly_rad=0.1).true_anomaly_rad == 0.1


def test_random_accelerations() -> None:
    made = plant(2, acceleration_noise_m_s2=1e-9, radiation_noise=0.2)
    sigma = made.noise_sigma(np.zeros(1))[:, 0]
    pressure = 0.2 * PUSH * 4.56e-6 / (0.9224 * (1 - E)) ** 2
    want = [np.hypot(1e-9, pressure), 1e-9, 1e-9]
    np.testing.assert_allclose(sigma, [*want, *want], rtol=1e-12)


def test_reference_of_table_2() -> None:
    made = plant(2)
    relative = [RelativeElementsSpec(**keys) for keys in TABLE_2]
    found = reference_states(made, relative, np.zeros(1))[:, 0]
    np.testing.assert_allclose(
        found[:3], [29.00530376, -1503.35866206, 407.10580169], rtol=0, atol=1e-6
    )
    np.testing.assert_allclose(
        found[6:9], [-1.22989663, -2126.16796984, 550.52955375], rtol=0, atol=1e-6
    )


def test_relative_orbit_is_a_flight_without_the_asteroid() -> None:
    """Five differences at once, against the plant with next to no gravity of the asteroid."""
    made = plant(gravity=second_degree(0.0, 0.0, 1e-20), radiation_pressure_n_m2=0.0)
    d = np.array([2e-10, 3e-9, 3e-8, -4e-8, 1e-8])
    t = np.array([0.0, 120.0 * 86400.0])
    orbit = (A, E, 0.05814, 2.2061, GM_SUN)
    start, end = relative_orbit(d, made.anomaly(t), *orbit).T
    found = StepMap(system(made)).propagate(start, t[1], 400)
    # what is left out is of second order: 3 km squared over the distance of the Sun
    np.testing.assert_allclose(found[:3], end[:3], rtol=0, atol=3e-3)
    np.testing.assert_allclose(found[3:], end[3:], rtol=0, atol=1e-9)
    assert np.linalg.norm(end[:3] - start[:3]) > 1e3


def test_reference_stage() -> None:
    """A year of the formation: the distances of the published figure."""
    product = check_stage(
        "formation_reference",
        {"plant": plant(2), "relative": list(TABLE_2), "duration_d": 323.6, "interval_d": 1},
    )
    assert isinstance(product, FormationReference)
    assert product.flights.states[:2] == ("x1", "y1")
    x = product.flights.x[:, :, 0]
    first, second = np.linalg.norm(x[:3], axis=0), np.linalg.norm(x[6:9], axis=0)
    apart = np.linalg.norm(x[6:9] - x[:3], axis=0)
    np.testing.assert_allclose([first.min(), first.max()], [1.55e3, 2.30e3], rtol=5e-3)
    np.testing.assert_allclose([second.min(), second.max()], [2.20e3, 3.24e3], rtol=5e-3)
    np.testing.assert_allclose([apart.min(), apart.max()], [0.63e3, 0.96e3], rtol=1e-2)
    figures: Any = present_formation(product.flights, product.spacecraft, None).figures
    (chart,) = figures.values()
    paths = chart.panels[0].solids[::2]
    np.testing.assert_array_equal([path.points for path in paths], [x[:3] / 1e3, x[6:9] / 1e3])
    # the velocities are the rates of the positions
    t = product.flights.t_s[:, 0]
    middle = (x[:3, 2:] - x[:3, :-2]) / (t[2:] - t[:-2])
    np.testing.assert_allclose(middle, x[3:6, 1:-1], rtol=0, atol=3e-7)


def test_contract_with_harmonics_and_three_spacecraft() -> None:
    made = plant(3, body=apophis(obliquity_rad=0.4, equinox_anomaly_rad=0.2))
    random = np.random.default_rng(3)
    x = random.normal(size=(18, 12)) * made.scales.of(made.states)[:, None] * 0.3
    x[[0, 6, 12]] += 900.0
    check_plant(made, x)


def octahedron() -> Any:
    corners = [[150.0, 0, 0], [-150, 0, 0], [0, 120, 0], [0, -120, 0], [0, 0, 90], [0, 0, -90]]
    faces = [[1, 3, 5], [3, 2, 5], [2, 4, 5], [4, 1, 5], [3, 1, 6], [2, 3, 6], [4, 2, 6], [1, 4, 6]]
    return create("shape", "polyhedron", length_unit="m", vertices=corners, faces=faces)


def test_polyhedron() -> None:
    """Gravity and surface of arrays: derivatives by differences, and the contact."""
    shape = octahedron()
    field = create("gravity", "polyhedron", shape=shape, density_kg_m3=2600.0)
    of = apophis(semi_axes_m=None, shape=shape, obliquity_rad=0.3)
    made = plant(2, body=of, gravity=field, rotation_angle_rad=0.4)
    equations = system(made, run_time=["rotation_rate"])
    # steps stage by stage know no terms of time
    assert not system(made, apart=True).time_terms
    x = np.tile(STATE_A, 2)[:, None].repeat(2, axis=1)
    x[:3] *= 0.2
    x[6:9] *= [[0.3], [0.15], [-0.6]]
    p, t = np.array([[RATE, 1.3 * RATE]]), np.array([5000.0, 5000.0])
    exact = Derivatives(equations).both(x, p, t)[1]
    rate = Derivatives(equations).rate
    for column in (0, 1, 2, 6, 7, 8):
        step = np.zeros((12, 1))
        step[column] = 0.02
        slope = (rate(x + step, p, t) - rate(x - step, p, t)) / 0.04
        np.testing.assert_allclose(
            exact[:, column], slope, rtol=0, atol=1e-6 * np.abs(exact[3:6, :3]).max()
        )
    # the turned body pulls the turned way
    turn = made.scene(t[:1])["to_body"][:, :, 0]
    place = x[:3, 0] + 0.0
    alone = plant(body=of, gravity=create("gravity", "point_mass", gm_m3_s2=1e-20))
    rest = Derivatives(system(alone)).rate(x[:6, :1], None, t[:1])[3:6, 0]
    pull = turn.T @ GravityField(field).acceleration(turn @ place)
    found = rate(x, p, t)[3:6, 0]
    # (the pressure, rate and orbit of both plants are the same)
    np.testing.assert_allclose(found - rest, pull, rtol=1e-9)

    stepper = StepMap(system(plant(body=of, gravity=field)), "rk6")
    met = stepper.locate("impact", 0.3 * STATE_A[:, None], 86400.0, 300)
    assert met.found.all()
    turn = plant(body=of, gravity=field).scene(met.time)["to_body"][:, :, 0]
    assert np.abs(shape.surface_array(turn @ met.x[:3])).max() < 1e-8


def test_body_without_rotation_is_refused() -> None:
    moon = create("body", "moon", primary_gm_m3_s2=1e14, semi_major_axis_m=1e7)
    with pytest.raises(InputError, match="has no rotation_rate"):
        plant(body=moon)


def test_reference_refused() -> None:
    relative = [RelativeElementsSpec(**TABLE_2[0])]
    with pytest.raises(InputError, match="2 spacecraft"):
        reference_states(plant(2), relative, np.zeros(1))
    bare = apophis(inclination_rad=None, periapsis_rad=None)
    with pytest.raises(InputError, match="lacks inclination_deg, periapsis_deg"):
        reference_states(plant(body=bare), relative, np.zeros(1))
