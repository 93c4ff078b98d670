"""Start states in inertial axes and by Keplerian elements, against closed forms."""

from __future__ import annotations

from math import cos, degrees, pi, radians, sin, sqrt
from typing import Any, Literal

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from hillsphere import create
from hillsphere.dynamics import StepMap, system
from hillsphere.engine.start_specs import StartSpec
from hillsphere.engine.start_states import place_start, with_placed_start
from hillsphere.errors import HillsphereError, InputError
from hillsphere.interfaces import Array
from hillsphere.model.ephemeris import anomaly_from_mean, mean_from_true
from hillsphere.model.inertial import RotatingFrame
from hillsphere.time import Epoch

GM = 7.11e5
MARS = 4.282837e13
DISTANCE = 9.377e6
RATE = sqrt(MARS / DISTANCE**3)


def body(**keys: Any) -> Any:
    return create(
        "body", "moon",
        **{"name": "phobos", "primary_name": "mars", "primary_gm_m3_s2": MARS,
           "semi_major_axis_m": DISTANCE, **keys},
    )  # fmt: skip


def plant(kind: str = "hill", moon: Any = None, **keys: Any) -> Any:
    gravity = create("gravity", "point_mass", gm_m3_s2=GM)
    return create("plant", kind, body=moon or body(), gravity=gravity, **keys)


def place(where: Any, others: dict[str, float] | None = None, **form: Any) -> tuple[Array, Array]:
    start = StartSpec.model_validate(form)
    found = place_start(start, where, others or {}, "start")
    assert found is not None
    return found


@pytest.mark.parametrize("inclination", [0.0, 180.0])
def test_a_circular_orbit_in_the_rotating_frame(inclination: float) -> None:
    """At (a, 0, 0) with ±√(GM/a) - n a along y: prograde and retrograde."""
    a = 60e3
    r, v = place(
        plant(),
        elements={"semi_major_axis_km": 60, "inclination_deg": inclination, "true_anomaly_deg": 0},
    )
    np.testing.assert_allclose(r, [a, 0.0, 0.0], rtol=1e-14, atol=1e-9)
    speed = sqrt(GM / a) * cos(radians(inclination)) - RATE * a
    np.testing.assert_allclose(v, [0.0, speed, 0.0], rtol=1e-13, atol=1e-12)


def test_periapsis_and_apoapsis_of_a_polar_ellipse() -> None:
    """At periapsis over the pole r = a (1 - e), v = √(GM (1 + e)/(a (1 - e))), along -x."""
    a, e = 80e3, 0.3
    keys = {
        "semi_major_axis_km": 80, "eccentricity": e, "inclination_deg": 90, "periapsis_deg": 90,
    }  # fmt: skip
    r, v = place(plant(), elements={**keys, "true_anomaly_deg": 0})
    near = a * (1 - e)
    np.testing.assert_allclose(r, [0.0, 0.0, near], rtol=1e-13, atol=1e-8)
    speed = sqrt(GM * (1 + e) / near)
    # on the axis of the turning frame its rate changes nothing
    np.testing.assert_allclose(v, [-speed, 0.0, 0.0], rtol=1e-13, atol=1e-12)
    far, _ = place(plant(), elements={**keys, "mean_anomaly_deg": 180})
    np.testing.assert_allclose(far, [0.0, 0.0, -a * (1 + e)], rtol=1e-12, atol=1e-8)


def test_true_and_mean_anomaly_are_inverse() -> None:
    true = np.linspace(-7.0, 7.0, 41)
    for e in (0.0, 0.3, 0.95):
        mean = mean_from_true(true, e)
        np.testing.assert_allclose(anomaly_from_mean(mean, e), true, rtol=0, atol=1e-12)


def test_inertial_and_rotating_are_one_start() -> None:
    """The inertial velocity is v + n z × r, as the frames say."""
    r, v = np.array([30e3, -20e3, 10e3]), np.array([1.0, 2.0, -3.0])
    there = v + np.cross([0.0, 0.0, RATE], r)
    found = place(plant(), inertial={"position_m": r.tolist(), "velocity_m_s": there.tolist()})
    np.testing.assert_allclose(found[0], r, rtol=1e-15)
    np.testing.assert_allclose(found[1], v, rtol=1e-13)


def test_the_moons_own_orbit_about_its_primary_is_at_rest() -> None:
    """Its elements about Mars are the origin without velocity, on the circle and the ellipse."""
    r, v = place(
        plant("three_body"),
        elements={"semi_major_axis_m": DISTANCE, "true_anomaly_deg": 0, "about": "mars"},
    )
    np.testing.assert_allclose(r, 0.0, rtol=0, atol=1e-8)
    # the moon itself has a mass: it moves faster than the massless body of these elements
    slower = sqrt(MARS / DISTANCE) - sqrt((MARS + GM) / DISTANCE)
    np.testing.assert_allclose(v, [0.0, slower, 0.0], rtol=0, atol=1e-10)
    e, anomaly = 0.2, 1.1
    for rotation in ("locked", "uniform"):
        elliptic = plant("three_body", body(eccentricity=e), orbit="elliptic", rotation=rotation)
        others = {"true_anomaly": anomaly}
        mars = elliptic.centres(others)["mars"].position_m
        assert np.linalg.norm(mars) == pytest.approx(DISTANCE * (1 - e**2) / (1 + e * cos(anomaly)))
        longitude = degrees(np.arctan2(-mars[1], -mars[0]) - anomaly)
        r, v = place(
            elliptic,
            others,
            elements={
                "semi_major_axis_m": DISTANCE, "eccentricity": e, "periapsis_deg": longitude,
                "true_anomaly_rad": anomaly, "about": "mars",
            },
        )  # fmt: skip
        np.testing.assert_allclose(r, 0.0, rtol=0, atol=1e-7)
        # for the same reason at most GM/(2 GM of Mars) of 2.6 km/s
        np.testing.assert_allclose(v, 0.0, rtol=0, atol=2.6e3 * GM / (2 * MARS))


def test_two_body_motion_returns_after_one_period() -> None:
    """About a turning body whose primary is far: the same inertial state, turned by -ω T."""
    rate_deg_d = 1639.389232
    asteroid = create(
        "body", "asteroid", name="eros", semi_major_axis_m=1e15, rotation_rate_deg_d=rate_deg_d
    )
    spinning = plant("three_body", asteroid, orbit="elliptic", rotation="spin")
    others = {"true_anomaly": 0.0, "rotation_angle": 0.0}
    a = 40e3
    r, v = place(
        spinning,
        others,
        elements={
            "semi_major_axis_m": a, "eccentricity": 0.2, "inclination_deg": 50, "node_deg": 20,
            "periapsis_deg": 70, "mean_anomaly_deg": 30,
        },
    )  # fmt: skip
    period = 2 * pi * sqrt(a**3 / GM)
    start = np.array([*r, *v, 0.0, 0.0])
    end = StepMap(system(spinning)).propagate(start, period, 400)
    angle = -radians(rate_deg_d) / 86400.0 * period
    turn = np.array(
        [[cos(angle), -sin(angle), 0.0], [sin(angle), cos(angle), 0.0], [0.0, 0.0, 1.0]]
    )
    np.testing.assert_allclose(end[:3], turn @ r, rtol=0, atol=1e-4)
    np.testing.assert_allclose(end[3:6], turn @ v, rtol=0, atol=1e-8)


def test_icrf_states_against_the_ephemeris_frame() -> None:
    """The inverse of `RotatingFrame.to_inertial`, which ephemerides are written with."""
    moon = body(
        pole_right_ascension_deg=317.67, pole_declination_deg=52.89, prime_meridian_deg=35.19
    )
    hill = plant(moon=moon)
    epoch = "2027-06-01T00:00:00"
    frame = RotatingFrame(
        moon.orientation, Epoch.parse(epoch, "TDB"), RATE, hill.prime_meridian_rad, DISTANCE
    )
    x = np.array([30e3, -20e3, 10e3, 1.0, 2.0, -3.0])
    for centre, about in (("moon", "phobos"), ("primary", "mars")):
        there = frame.to_inertial(x[:, None], np.zeros(1), centre)[:, 0]
        r, v = place(
            hill,
            inertial={
                "position_m": there[:3].tolist(), "velocity_m_s": there[3:].tolist(),
                "about": about, "axes": "icrf", "epoch": epoch,
            },
        )  # fmt: skip
        np.testing.assert_allclose(r, x[:3], rtol=0, atol=1e-7)
        np.testing.assert_allclose(v, x[3:], rtol=0, atol=1e-10)


ASTEROID: dict[str, Any] = {
    "name": "ryugu", "primary_gm_m3_s2": 1.32712440018e20, "semi_major_axis_m": 1.78e11,
    "eccentricity": 0.19, "rotation_rate_rad_s": 2.287e-4, "semi_axes_m": (502.0, 502.0, 438.0),
}  # fmt: skip
ANGLES = {"inclination_rad": 0.103, "node_rad": 4.39, "periapsis_rad": 3.69}
SUN = 1.32712440018e20
TILT = radians(84381.448 / 3600.0)
"""Obliquity of the ecliptic J2000, IAU 1976."""


def proximity(asteroid: dict[str, Any] | None = None, **keys: Any) -> Any:
    gravity = create("gravity", "point_mass", gm_m3_s2=30.0)
    moon = create("body", "asteroid", **ASTEROID, **(ANGLES if asteroid is None else asteroid))
    return create("plant", "proximity", body=moon, gravity=gravity, **keys)


def turned(*angles: tuple[int, float]) -> Array:
    """Return the product of rotations about the axes with these numbers, (3, 3)."""
    whole = np.eye(3)
    for axis, angle in angles:
        c, s = cos(angle), sin(angle)
        turn = np.eye(3)
        i, j = ((1, 2), (2, 0), (0, 1))[axis]
        turn[[i, i, j, j], [i, j, i, j]] = c, -s, s, c
        whole = whole @ turn
    return whole


def anomaly_later(start: float, time_s: float) -> tuple[float, float, float]:
    """Return f, R and ḟ after a time on the asteroid's orbit, by quadrature of dt = R² df/h."""
    a, e = ASTEROID["semi_major_axis_m"], ASTEROID["eccentricity"]
    h = sqrt(SUN * a * (1 - e * e))

    def distance(f: float) -> float:
        return float(a * (1 - e * e) / (1 + e * cos(f)))

    def excess(f: float) -> float:
        return float(quad(lambda q: distance(q) ** 2 / h, start, f, epsrel=1e-13)[0]) - time_s

    f = brentq(excess, start - 1.0, start + 6.0, xtol=1e-14) if time_s else start
    return f, distance(f), h / distance(f) ** 2


@pytest.mark.parametrize("time_s", [0.0, 4e6])
def test_an_orbit_about_an_asteroid_in_its_hill_frame(time_s: float) -> None:
    """The polar circle at its highest point; the frame turns by ḟ of the time of the start."""
    _, _, rate = anomaly_later(0.7, time_s)
    keys = {"semi_major_axis_km": 2, "inclination_deg": 60, "true_anomaly_deg": 0}
    r, v = place(proximity(true_anomaly_rad=0.7), elements=keys, time_s=time_s)
    np.testing.assert_allclose(r, [2000.0, 0.0, 0.0], rtol=1e-13, atol=1e-9)
    speed = sqrt(30.0 / 2000.0)
    expected = [0.0, speed * cos(radians(60)) - rate * 2000.0, speed * sin(radians(60))]
    np.testing.assert_allclose(v, expected, rtol=1e-11, atol=1e-15)


@pytest.mark.parametrize("time_s", [0.0, 4e6])
def test_a_heliocentric_start_in_the_hill_frame(time_s: float) -> None:
    """Of a spacecraft at rest relative to the asteroid and 1 km ahead, as the Sun sees it."""
    f, distance, rate = anomaly_later(0.7, time_s)
    a, e = ASTEROID["semi_major_axis_m"], ASTEROID["eccentricity"]
    away = sqrt(SUN / (a * (1 - e * e))) * e * sin(f)
    r, v = place(
        proximity(true_anomaly_rad=0.7),
        inertial={
            "position_m": [distance, 1000.0, 0.0], "velocity_m_s": [away, rate * distance, 0.0],
            "about": "sun",
        },
        time_s=time_s,
    )  # fmt: skip
    # rounding of 1.8e11 m and 30 km/s, and of the anomaly
    np.testing.assert_allclose(r, [0.0, 1000.0, 0.0], rtol=0, atol=2e-3)
    np.testing.assert_allclose(v, [rate * 1000.0, 0.0, 0.0], rtol=0, atol=1e-9)


def test_stars_seen_from_the_hill_frame() -> None:
    """Its axes are those of the orbit, Rz(Ω) Rx(i) Rz(ω + f), after the ecliptic's tilt Rx(ε)."""
    epoch = "2027-06-01T00:00:00"
    axes = turned(
        (0, TILT), (2, ANGLES["node_rad"]), (0, ANGLES["inclination_rad"]),
        (2, ANGLES["periapsis_rad"] + 0.7),
    )  # fmt: skip
    rate = anomaly_later(0.7, 0.0)[2]
    x, u = np.array([900.0, -400.0, 250.0]), np.array([0.01, 0.02, -0.03])
    form = {
        "position_m": (axes @ x).tolist(), "velocity_m_s": (axes @ u).tolist(), "axes": "icrf",
        "epoch": epoch,
    }  # fmt: skip
    r, v = place(proximity(true_anomaly_rad=0.7), inertial=form)
    np.testing.assert_allclose(r, x, rtol=0, atol=1e-10)
    np.testing.assert_allclose(v, u - np.cross([0, 0, rate], x), rtol=0, atol=1e-14)
    with pytest.raises(InputError, match="'ryugu' does not say how its orbit stands"):
        place(proximity({}, true_anomaly_rad=0.7), inertial=form)
    dated = proximity({**ANGLES, "mean_anomaly_rad": 0.5, "epoch": "2027-05-31T23:00:00"})
    place(dated, inertial=form, time_s=3600.0)
    with pytest.raises(InputError, match="the flight begins at 2027-05-31T23:00:00 TDB"):
        place(dated, inertial=form)


def test_elements_about_the_sun() -> None:
    """Of one body in ecliptic axes: the perihelion of an orbit, Rz(Ω) Rx(i) Rz(ω) x."""
    one = create("plant", "heliocentric", bodies=[{}], primary_gm_m3_s2=SUN)
    a, e = 1.5e11, 0.3
    axes = turned((2, 0.4), (0, 0.2), (2, 1.1))
    keys = {"node_rad": 0.4, "inclination_rad": 0.2, "periapsis_rad": 1.1, "eccentricity": e}
    r, v = place(one, elements={"semi_major_axis_m": a, **keys, "true_anomaly_rad": 0})
    near = a * (1 - e)
    speed = sqrt(SUN * (1 + e) / near)
    np.testing.assert_allclose(r, near * axes[:, 0], rtol=1e-13)
    np.testing.assert_allclose(v, speed * axes[:, 1], rtol=1e-13)
    # the pole of the Earth's equator of J2000 stands at the obliquity from that of the ecliptic
    pole, _ = place(
        one,
        inertial={
            "position_m": [0, 0, a], "velocity_m_s": [0, 0, 0], "axes": "icrf",
            "epoch": "2027-06-01",
        },
    )  # fmt: skip
    np.testing.assert_allclose(pole, [0.0, a * sin(TILT), a * cos(TILT)], rtol=1e-13, atol=1e-3)


def test_a_satellite_of_the_earth() -> None:
    """A frame that does not turn: the start is that of the ellipse, Rz(Ω) Rx(i) Rz(ω) x."""
    planet = create("body", "planet")
    gravity = create("gravity", "point_mass", gm_m3_s2=3.986004418e14)
    orbit = create(
        "plant", "earth_orbit", body=planet, gravity=gravity, epoch="2027-06-01", frame="gcrs"
    )
    keys = {"node_rad": 0.4, "inclination_rad": 0.9, "periapsis_rad": 1.1, "eccentricity": 0.01}
    axes, near = turned((2, 0.4), (0, 0.9), (2, 1.1)), 7e6 * 0.99
    speed = sqrt(3.986004418e14 * 1.01 / near)
    elements = {"semi_major_axis_m": 7e6, **keys, "true_anomaly_rad": 0}
    r, v = place(orbit, elements=elements)
    np.testing.assert_allclose(r, near * axes[:, 0], rtol=1e-13)
    np.testing.assert_allclose(v, speed * axes[:, 1], rtol=1e-13)
    again = place(orbit, inertial={"position_m": r.tolist(), "velocity_m_s": v.tolist()})
    np.testing.assert_allclose(np.concatenate(again), [*r, *v], rtol=1e-15)


@pytest.mark.parametrize("kind", ["proximity", "heliocentric"])
def test_one_start_for_several_spacecraft_is_refused(kind: str) -> None:
    several = (
        proximity(spacecraft=[{}, {}])
        if kind == "proximity"
        else create("plant", kind, bodies=[{}, {}])
    )
    form = {"semi_major_axis_km": 2, "true_anomaly_deg": 0}
    with pytest.raises(InputError, match=r"start\.elements: the plant moves 2 bodies \(x1.*three"):
        create(
            "stage", "closed_loop", plant=several, law=Idle(), samples=1, start={"elements": form}
        )


def test_an_ellipse_needs_the_bodys_place() -> None:
    """Without its true anomaly nothing says how fast the frame turns: perihelion is no default."""
    elliptic = plant("three_body", body(eccentricity=0.2), orbit="elliptic", rotation="locked")
    form = {"semi_major_axis_km": 60, "true_anomaly_deg": 0}
    with pytest.raises(InputError, match=r"start\.elements: .* give start\.others\.true_anomaly"):
        place(elliptic, elements=form)


def test_what_cannot_be_placed() -> None:
    class Fixed:
        """A plant that says nothing of its frame."""

    elements = {"semi_major_axis_km": 30, "true_anomaly_deg": 0}
    start = StartSpec.model_validate({"elements": elements})
    with pytest.raises(InputError, match="Fixed does not say how its frame turns"):
        with_placed_start(start, Fixed())
    with pytest.raises(InputError, match=r"elements.about: no body 'deimos'; the plant has phobos"):
        place(plant(), elements={**elements, "about": "deimos"})
    with pytest.raises(InputError, match=r"'phobos' has no orientation"):
        place(plant(), elements={**elements, "axes": "icrf", "epoch": "2027-06-01T00:00:00"})


def test_a_start_in_the_plants_frame_is_left_alone() -> None:
    start = StartSpec(position_m=(1.0, 2.0, 3.0))
    assert with_placed_start(start, plant()) is start


class Idle:
    """No command."""

    actuation: Literal["hold", "impulse"] = "hold"
    period_s = 60.0

    def initial(self, n_cases: int) -> Array:
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        return np.zeros((3, y.shape[1])), xc


def test_a_closed_loop_begins_there() -> None:
    stage: Any = create(
        "stage", "closed_loop", plant=plant(), law=Idle(), samples=1,
        start={"elements": {"semi_major_axis_km": 60, "true_anomaly_deg": 90}},
    )  # fmt: skip
    begin = {q.name: q.value for q in stage.case_inputs() if q.name.startswith("state.")}
    expected = [0.0, 60e3, 0.0, -(sqrt(GM / 60e3) - RATE * 60e3), 0.0, 0.0]
    found = [begin[f"state.{name}"] for name in ("x", "y", "z", "vx", "vy", "vz")]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-8)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ({"position_km": [1, 2, 3], "elements": {"semi_major_axis_km": 30, "true_anomaly_deg": 0}},
         "given by position_m already"),
        ({"inertial": {"position_km": [1, 2, 3], "velocity_m_s": [0, 0, 0]},
          "elements": {"semi_major_axis_km": 30, "true_anomaly_deg": 0}},
         "given by inertial already"),
        ({"elements": {"semi_major_axis_km": 30}}, "where. give true_anomaly or mean_anomaly"),
        ({"elements": {"semi_major_axis_km": 30, "true_anomaly_deg": 0, "mean_anomaly_deg": 0}},
         "true_anomaly says it already"),
        ({"elements": {"semi_major_axis_km": 30, "true_anomaly_deg": 0, "axes": "icrf"}},
         "belong together"),
        ({"elements": {"semi_major_axis_km": 30, "eccentricity": 1.2, "true_anomaly_deg": 0}},
         "< 1"),
    ],
)  # fmt: skip
def test_exactly_one_form(start: dict[str, Any], message: str) -> None:
    with pytest.raises(HillsphereError, match=message):
        create(
            "stage", "closed_loop", plant=plant(), law=Idle(), start=start, samples=1,
        )  # fmt: skip
