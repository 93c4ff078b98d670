"""The plant ``three_body``: circular and elliptic, against published values and other formulas."""

from __future__ import annotations

from math import pi, radians, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hillsphere import create
from hillsphere.dynamics import Derivatives, StepMap, Taylor, system
from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array, Parameter
from hillsphere.testing import check_plant
from hillsphere_plants.equilibria.libration_points import equilibrium_near, libration_points

GM = 7.087546066894452e5
GM_MARS = 4.282837362069909e13
A = 9376e3
DATA = Path(__file__).parents[3] / "missions" / "data"


def body(e: float = 0.0151, **keys: Any) -> Any:
    given = {"primary_gm_m3_s2": GM_MARS, "semi_major_axis_m": A, "eccentricity": e, **keys}
    return create("body", "moon", name="phobos", **given)


def point_mass(gm: float = GM) -> Any:
    return create("gravity", "point_mass", gm_m3_s2=gm)


def degree_four() -> Any:
    return create("gravity", "harmonics", file=str(DATA / "phobos-gravity-degree4.gfc"))


def plant(gravity: Any = None, of: Any = None, **keys: Any) -> Any:
    return create("plant", "three_body", body=of or body(), gravity=gravity or point_mass(), **keys)


def rates(made: Any, x: Array) -> Array:
    return Derivatives(system(made)).rate(x)


def states(count: int = 8, rows: int = 6) -> Array:
    rng = np.random.default_rng(11)
    direction = rng.normal(size=(3, count))
    place = direction / np.linalg.norm(direction, axis=0) * rng.uniform(18e3, 150e3, count)
    return np.concatenate(
        [place, 5.0 * rng.normal(size=(3, count)), rng.uniform(-4, 4, (rows - 6, count))]
    )


class TabulatedHarmonics:
    """Harmonics that hide their formula, as a table would."""

    frame = "body"
    gm_m3_s2 = GM

    def __init__(self) -> None:
        self._field = GravityField(degree_four())

    def parameters(self) -> tuple[Parameter, ...]:
        return ()

    def potential_array(self, r: Array, p: Array) -> Array:
        return self._field.potential(r)

    def acceleration_array(self, r: Array, p: Array) -> Array:
        return self._field.acceleration(r)

    def gradient_array(self, r: Array, p: Array) -> Array:
        return self._field.gradient(r)


@pytest.mark.parametrize(
    ("place", "potential", "pull", "acceleration"),
    [
        (
            (16560.0, 0.0, 0.0),
            44.87443263254497,
            (-2.979191482638818e-3, -7.209567883658134e-5, -5.875740783583535e-5),
            (-3.688869525139456e-4, -1.059486605222333e-4, -5.875740783583535e-5),
        ),
        (
            (12000.0, 5000.0, 3000.0),
            55.09165334602548,
            (-3.781440166916e-3, -1.790287975027e-3, -1.341277116722e-3),
            (-1.920880704956e-3, -1.825183267404e-3, -1.504184114569e-3),
        ),
    ],
)
def test_accelerations_of_an_independent_transcription(
    place: tuple[float, ...], potential: float, pull: Any, acceleration: Any
) -> None:
    """Computed once in plain numpy with another harmonics code; degree 4, ν = 0.5, locked."""
    field = GravityField(degree_four())
    assert float(field.potential(place)) == pytest.approx(potential, rel=1e-13)
    np.testing.assert_allclose(field.acceleration(place), pull, rtol=0, atol=1e-15)
    x = np.array([*place, 0.1, -0.2, 0.3, 0.5])[:, None]
    found = rates(plant(degree_four(), orbit="elliptic"), x)[3:6, 0]
    np.testing.assert_allclose(found, acceleration, rtol=0, atol=1e-15)


def test_propagation_of_an_independent_transcription() -> None:
    """8000 s in the degree-4 field, locked; computed once by SciPy from other code."""
    made = system(plant(degree_four(), orbit="elliptic"), normalised=True)
    x0 = np.array([25000.0, 8000, 6000, 1, -9, 2, 0.3])
    found = Taylor(made).propagate(x0 / made.unit, 8000 / made.time_unit_s) * made.unit
    expected = [18854.025108, -42230.729105, 1510.0963172, 1.4621978376, -3.3795625002,
                -2.2296356383, 2.1403581477]  # fmt: skip
    np.testing.assert_allclose(found[:3], expected[:3], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found[3:], expected[3:], rtol=0, atol=2e-9)


def test_jacobian_of_an_independent_transcription() -> None:
    """On a descent from above longitude 0 to 12° N 25° E, 6384 s after the pericentre.

    Differentiated symbolically from other code, where a path of the same data is to 0.3 m; the
    place is that of three of its numbers, the others follow. Its part that is not symmetric is ω̇.
    """
    made = plant(degree_four(), orbit="elliptic")
    anomaly = made.true_anomaly_after(0.0, np.array([6384.0]))[0]
    x = np.zeros((7, 1))
    x[:, 0] = [12974.047691, 3224.276671, 1556.481310, -1.531217, 2.090798, 1.346383, anomaly]
    _, jacobian = Derivatives(system(made)).both(x)
    expected = [
        [7.8331598351e-7, 3.1448222033e-7, 2.2684629864e-7],
        [3.1762346939e-7, -2.3883253369e-7, 8.9190900984e-8],
        [2.2684629864e-7, 8.9190900984e-8, -4.3995256504e-7],
    ]
    found = jacobian[3:6, :3, 0]
    size = float(np.linalg.norm(expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * size)


def inertial_flight(x0: Array, e: float, mode: str, amplitude: float, duration: float) -> Array:
    """Fly Mars, moon (point masses) and particle among the stars; return the moon-fixed state.

    The moon's own orbit is Keplerian; its rotation is θ = ν, M or M + A sin M, with the primary
    over longitude 0 in the mean.
    """
    total = GM_MARS + GM
    n = sqrt(total / A**3)

    def kepler(nu: float) -> tuple[Array, Array]:
        r = A * (1 - e**2) / (1 + e * np.cos(nu))
        factor = sqrt(total / (A * (1 - e**2)))
        return (
            r * np.array([np.cos(nu), np.sin(nu), 0]),
            factor * np.array([-np.sin(nu), e + np.cos(nu), 0]),
        )

    def eccentric(nu: float) -> float:
        return float(2 * np.arctan2(sqrt(1 - e) * np.sin(nu / 2), sqrt(1 + e) * np.cos(nu / 2)))

    def mean(nu: float) -> float:
        return eccentric(nu) - e * float(np.sin(eccentric(nu)))

    def attitude(nu: float) -> tuple[float, float]:
        """Angle of longitude 0 among the stars (it faces Mars: + π) and its rate."""
        m = mean(nu)
        if mode == "locked":
            return nu + pi, n * (1 + e * np.cos(nu)) ** 2 / (1 - e**2) ** 1.5
        swing = amplitude if mode == "libration" else 0.0
        return float(m + swing * np.sin(m)) + pi, n * (1 + swing * np.cos(m))

    def to_stars(x: Array, nu: float) -> tuple[Array, Array]:
        angle, rate = attitude(nu)
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        spin = np.array([0, 0, rate])
        return turn @ x[:3], turn @ (x[3:6] + np.cross(spin, x[:3]))

    def motion(t: float, y: Array) -> Array:
        particle, moon = y[0:3], y[6:9]
        pull = -GM_MARS * (moon + particle) / np.linalg.norm(moon + particle) ** 3
        frame = -GM_MARS * moon / np.linalg.norm(moon) ** 3
        own = -GM * particle / np.linalg.norm(particle) ** 3
        two_body = -total * moon / np.linalg.norm(moon) ** 3
        return np.concatenate([y[3:6], pull - frame + own, y[9:12], two_body])

    r, v = to_stars(x0, x0[6])
    moon, moon_v = kepler(x0[6])
    start = np.concatenate([r, v, moon, moon_v])
    y = solve_ivp(motion, (0, duration), start, method="DOP853", rtol=1e-13, atol=1e-9).y[:, -1]
    # osculating true anomaly at the end, by the eccentricity vector, which is +x
    nu = float(np.arctan2(y[7], y[6]))
    angle, rate = attitude(nu)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    r = turn @ y[0:3]
    return np.concatenate([r, turn @ y[3:6] - np.cross([0, 0, rate], r), [nu]])


@pytest.mark.parametrize("mode", ["locked", "uniform", "libration"])
@pytest.mark.parametrize("e", [0.0151, 0.3])
def test_flight_among_the_stars(mode: str, e: float) -> None:
    amplitude = radians(-1.09)
    made = system(
        plant(of=body(e, libration_amplitude_rad=amplitude), orbit="elliptic", rotation=mode),
        normalised=True,
    )
    x0 = np.array([60e3, 80e3, 20e3, 3.0, 12.0, -2.0, 0.4])
    expected = inertial_flight(x0, e, mode, amplitude, 20000.0)
    found = Taylor(made).propagate(x0 / made.unit, 20000.0 / made.time_unit_s) * made.unit
    found[6] = (found[6] + pi) % (2 * pi) - pi
    size = np.linalg.norm(expected[:3]), np.linalg.norm(expected[3:6])
    assert np.max(np.abs(found[:3] - expected[:3])) < 1e-10 * size[0]
    assert np.max(np.abs(found[3:6] - expected[3:6])) < 1e-10 * size[1]
    assert found[6] == pytest.approx(expected[6], abs=1e-11)


def test_elliptic_goes_over_into_circular() -> None:
    """At e = 0: the same equations; the frames differ by half a turn, which is exact."""
    circular = plant(degree_four(), of=body(0.0))
    x = states()
    half_turn = np.array([-1, -1, 1, -1, -1, 1.0])[:, None]
    expected = half_turn * rates(circular, x)
    for mode in ("locked", "uniform"):
        elliptic = plant(degree_four(), of=body(0.0), orbit="elliptic", rotation=mode)
        y = np.concatenate([half_turn * x, np.linspace(-9, 9, x.shape[1])[None]])
        found = rates(elliptic, y)
        size = np.max(np.abs(expected[3:]), axis=0)
        assert np.all(np.abs(found[3:6] - expected[3:]) <= 1e-13 * size)
        np.testing.assert_allclose(found[6], circular.mean_motion_rad_s, rtol=1e-15)
        np.testing.assert_allclose(elliptic.in_hill_frame(y), x, rtol=1e-12, atol=1e-8)
    # and towards it: the difference is of first order in e
    near = [
        np.max(np.abs(rates(plant(of=body(e), orbit="elliptic"), y) - rates(
            plant(of=body(0.0), orbit="elliptic"), y))[3:6])
        for e in (1e-4, 1e-5)
    ]  # fmt: skip
    assert near[0] / near[1] == pytest.approx(10.0, rel=1e-2)


def test_circular_goes_over_into_hill() -> None:
    """The difference is that of the next term of the tide, of order r/a."""
    x = states()
    errors = []
    for factor in (1.0, 10.0, 1e4):
        # the same mean motion of a massless moon, farther out
        far = body(0.0, semi_major_axis_m=A * factor, primary_gm_m3_s2=GM_MARS * factor**3)
        hill = create("plant", "hill", body=far, gravity=point_mass())
        made = plant(of=far)
        difference = np.abs(rates(made, x) - rates(hill, x))[3:]
        errors.append(float(np.max(difference)) / (made.mean_motion_rad_s**2 * 150e3))
        integral = [system(q) for q in (made, hill)]
        c = [s.function(s.integral)(x)[0] for s in integral if s.integral is not None]
        assert np.all(np.abs(c[0] - c[1]) <= 0.2 / factor * np.abs(c[1]))
    assert 1e-3 < errors[0] < 0.2
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.05)
    assert errors[2] < 2e-5


def test_jacobi_constant_is_the_usual_one_but_for_a_constant() -> None:
    """½n²ρ² + GM/r₁ + Gm/r₂ − ½v² about the centre of mass (Szebehely 1967, section 1.4)."""
    made = plant(of=body(0.0))
    x = states()
    n, total = made.mean_motion_rad_s, GM_MARS + GM
    shifted = x[:3] + np.array([A * GM_MARS / total, 0, 0])[:, None]
    usual = (
        0.5 * n**2 * np.sum(shifted[:2] ** 2, axis=0)
        + GM_MARS / np.linalg.norm(x[:3] + np.array([A, 0, 0])[:, None], axis=0)
        + GM / np.linalg.norm(x[:3], axis=0)
        - 0.5 * np.sum(x[3:] ** 2, axis=0)
    )
    equations = system(made)
    assert equations.integral is not None
    ours = equations.function(equations.integral)(x)[0]
    # the usual one has lost seven digits of ours
    np.testing.assert_allclose(ours - usual, np.mean(ours - usual), rtol=0, atol=1e-8)
    assert np.ptp(ours) > 100


@pytest.mark.parametrize("orbit", ["circular", "elliptic"])
@pytest.mark.parametrize("kind", ["point_mass", "ellipsoid", "harmonics"])
def test_contract(orbit: str, kind: str) -> None:
    gravity = {
        "point_mass": point_mass,
        "ellipsoid": lambda: create(
            "gravity", "ellipsoid", axes_km=[13.03, 11.4, 9.14], gm_m3_s2=GM
        ),
        "harmonics": degree_four,
    }[kind]()
    keys = {"rotation": "libration"} if orbit == "elliptic" else {}
    of = body(semi_axes_km=[13.0, 11.4, 9.1], libration_amplitude_deg=-1.09)
    made = plant(gravity, of=of, orbit=orbit, escape_radius_km=500, **keys)
    if kind == "harmonics":
        made.mirrors = {}  # its sine terms keep no mirror
    check_plant(made, states(rows=len(made.states)))


@pytest.mark.parametrize("orbit", ["circular", "elliptic"])
def test_array_gravity_gives_the_same_motion(orbit: str) -> None:
    keys = {"rotation": "libration"} if orbit == "elliptic" else {}
    of = body(libration_amplitude_deg=-1.09)
    symbolic = plant(degree_four(), of=of, orbit=orbit, prime_meridian_deg=170, **keys)
    tabulated = plant(TabulatedHarmonics(), of=of, orbit=orbit, prime_meridian_deg=170, **keys)
    x = states(rows=len(symbolic.states))
    one, other = (system(p, normalised=True) for p in (symbolic, tabulated))
    x = x / one.unit[:, None]
    rate, jacobian = Derivatives(one).both(x)
    rate_a, jacobian_a = Derivatives(other).both(x)
    np.testing.assert_allclose(rate_a, rate, rtol=0, atol=1e-13)
    np.testing.assert_allclose(jacobian_a, jacobian, rtol=0, atol=1e-12)
    if orbit == "circular":
        assert one.integral is not None
        value = one.function(one.integral)(x)[0]
        speed = symbolic.scales.length_m / symbolic.scales.time_s
        found = tabulated.integral_array(x * one.unit[:, None]) / speed**2
        np.testing.assert_allclose(found, value, rtol=1e-12)


def test_prime_meridian_turns_moon_and_primary_together() -> None:
    """The body's frame changes, the motion in the Hill frame does not turn with it."""
    x = np.array([[40e3, 20e3, 5e3, 1.0, -4.0, 0.5]]).T
    nu = np.array([0.7])
    ends = []
    for angle in (180.0, 130.0):
        made = plant(orbit="elliptic", rotation="uniform", prime_meridian_deg=angle)
        flow = system(made, normalised=True)
        start = made.from_hill_frame(x, nu)
        np.testing.assert_allclose(made.in_hill_frame(start), x, rtol=1e-13)
        end = StepMap(flow).propagate(start / flow.unit[:, None], 1.0, 60) * flow.unit[:, None]
        ends.append(made.in_hill_frame(end))
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-11)


def test_true_anomaly_after_a_time_is_that_of_the_equations() -> None:
    made = plant(of=body(0.4), orbit="elliptic", rotation="uniform")
    flow = system(made, normalised=True)
    t = np.linspace(-20.0, 20.0, 9)
    x = np.repeat(np.array([[3.0, 0, 0, 0, -6.0, 0, 1.1]]).T, 9, axis=1)
    flown = Taylor(flow).propagate(x, t)[6]
    found = made.true_anomaly_after(1.1, t * flow.time_unit_s)
    np.testing.assert_allclose(found, flown, rtol=0, atol=2e-12)
    assert made.true_anomaly_after(1.1, np.zeros(1))[0] == pytest.approx(1.1, abs=1e-15)


def test_libration_points_of_phobos() -> None:
    """L1 and L2 3.53 km above the tips (13.03 km): the landing paper's 3.5 km."""
    found = libration_points(plant(of=body(0.0), orbit="elliptic"))
    assert found["L1"][0] == pytest.approx(16556.782282598, abs=1e-6)
    assert found["L2"][0] == pytest.approx(-16576.296666281, abs=1e-6)
    turned = libration_points(plant(of=body(0.0)))
    for name, place in found.items():
        np.testing.assert_allclose(turned[name], place * [-1, -1, 1], rtol=3e-8, atol=1e-6)
    out = libration_points(plant(degree_four(), of=body(0.0)))
    for name in ("L1", "L2"):
        moved = np.linalg.norm(out[name]) - np.linalg.norm(found[name])
        assert 640 < moved < 760  # the field pushes them out
    leading = turned["L4"]
    np.testing.assert_allclose(np.linalg.norm(leading), A, rtol=1e-7)
    assert leading[1] > 0
    hill = libration_points(create("plant", "hill", body=body(), gravity=point_mass()))
    assert set(hill) == {"L1", "L2"}


def test_libration_points_of_earth_and_moon() -> None:
    """Published for µ = 0.012150585: L1 0.836915, L2 1.155682, L3 −1.005063."""
    mu = 0.012150585
    moon = body(0.0, primary_gm_m3_s2=(1 - mu) * 4.0e14, semi_major_axis_m=4e8)
    found = libration_points(plant(point_mass(mu * 4.0e14), of=moon))
    x = [found[name][0] / 4e8 + 1 - mu for name in ("L1", "L2", "L3")]

    def slope(s: float) -> float:
        return s - (1 - mu) * (s + mu) / abs(s + mu) ** 3 - mu * (s - 1 + mu) / abs(s - 1 + mu) ** 3

    assert [abs(slope(s)) < 1e-12 for s in x] == [True] * 3
    np.testing.assert_allclose(x, [0.836915, 1.155682, -1.005063], rtol=0, atol=6e-7)


def test_no_equilibrium_where_the_orbit_is_an_ellipse() -> None:
    with pytest.raises(InputError, match="vary along the orbit"):
        equilibrium_near(plant(orbit="elliptic"), np.array([[16e3], [0.0], [0.0]]))


def test_mass_of_the_moon_follows_its_parameter() -> None:
    """By n = √((GM + Gm)/a³), with the moon's GM set at run time."""
    heavy = plant(point_mass(0.1 * GM_MARS), of=body(0.0))
    light = system(plant(point_mass(), of=body(0.0)), run_time=["gravity.gm"])
    x = states(3)
    found = Derivatives(light).rate(x, [0.1 * GM_MARS])
    np.testing.assert_allclose(found, rates(heavy, x), rtol=1e-13, atol=1e-15)


def test_bad_keys_are_named() -> None:
    with pytest.raises(InputError, match="libration_amplitude_deg of body 'phobos' is 0"):
        plant(orbit="elliptic", rotation="libration")
    with pytest.raises(InputError, match="on a circle the moon is locked"):
        plant(rotation="uniform")
    with pytest.raises(InputError, match="eccentricity"):
        body(1.0)
