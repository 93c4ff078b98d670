"""Retrograde, halo and Lyapunov orbits of the circular problem against published states.

JPL's values are those of its catalogue of periodic orbits, with its mass ratios, in units of the
distance and of 1/n, from the barycentre [1]_. Its orbits start on either crossing of the plane xz,
so that a state is looked for at both crossings of a member with the printed period.

References
----------
.. [1] NASA/JPL Three-Body Periodic Orbits, https://ssd.jpl.nasa.gov/tools/periodic_orbits.html,
   as public programs quote its orbits by number or by what its API returns.
.. [2] github.com/Yuricst/paladin, tests/test_propagator_cr3bp.py: "ID723 in southern halo", with
   the mass ratio of [1]_.
.. [3] github.com/Omnikar/gravity-sim, src/main.rs (orbits by number, some in its history),
   with the mass ratios of [1]_.
.. [4] github.com/jmripic/orbit-gen, version 0.2.0 on PyPI, orbit_gen/setup/presets.py.
.. [5] github.com/Coorbital-Inc/pumpkyn, src/+pumpkyn/+cr3bp/stabilityIndex.m, with the
   mass ratio of [1]_.
.. [6] github.com/SIOSlab/STMInt, examples/NrhoPropError.py: "Gateway Nrho ics", µ = 1/82.30059.
.. [7] github.com/jared711/nrho-lagrangian-tori, src/cpp/param.cc, in a comment, with the mass
   ratio of [1]_.
.. [8] github.com/arunsuresh990/Spacecraft-Trajectory-Design-using-Space-Manifold-Dynamics,
   MANIFOLDS/PstopGL1toEL2manifoldpi.m, with mass ratios 7.802e-5 and 2.523e-5.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import root

from hillsphere import create
from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array
from hillsphere.testing import RecordingContext
from hillsphere_orbits.correction import correct, fix_component
from hillsphere_orbits.members import members_at
from hillsphere_orbits.qso.families import Family, Qso
from hillsphere_orbits.winding import require_motion, require_smooth, turns

DISTANCE_M, RATE = 1e8, 1e-5
EARTH_MOON = 1.215058560962404e-2
SATURN_TITAN = 2.366393158331484e-4
MARS_PHOBOS = 1.611081404409632e-8
SUN_EARTH = 3.0542e-6
SATURN_ENCELADUS = 1.901109735892602e-7
JUPITER_GANYMEDE, JUPITER_EUROPA = 7.802e-5, 2.523e-5  # not the catalogue's [8]


@cache
def circular(mu: float) -> Any:
    """Return the circular problem of a mass ratio; both bodies are point masses."""
    total = DISTANCE_M**3 * RATE**2
    moon = create("body", "moon", primary_gm_m3_s2=(1.0 - mu) * total, semi_major_axis_m=DISTANCE_M)
    gravity = create("gravity", "point_mass", gm_m3_s2=mu * total)
    return create("plant", "three_body", body=moon, gravity=gravity)


def qso(mu: float) -> Qso:
    return create("orbit_family", "qso", Qso, plant=circular(mu))


def crossings(family: Family, z: Array, mu: float) -> Array:
    """Return x, z and ẏ (3, 2N) at both perpendicular crossings, JPL's units and origin."""
    problem, scales = family.problem, family.plant.scales
    x = problem.state(z)
    end, _ = problem.flow.with_matrix(x, 0.5 * problem.period(z), problem.steps)
    both = np.concatenate([x, end], axis=1)
    length = scales.length_m / DISTANCE_M
    return np.array([both[0] * length + 1.0 - mu, both[2] * length, both[4] * length])


def jacobi(mu: float, x: float, z: float, vy: float) -> float:
    """Return C = x² + 2(1 − µ)/r₁ + 2µ/r₂ − v², as the catalogue defines it."""
    r1, r2 = np.hypot(x + mu, z), np.hypot(x - 1.0 + mu, z)
    return float(x * x + 2.0 * (1.0 - mu) / r1 + 2.0 * mu / r2 - vy * vy)


@cache
def retrograde(mu: float) -> Family:
    """Return retrograde orbits out to where the period of the largest one used is passed."""
    unit = circular(mu).scales.length_m
    low, high = {EARTH_MOON: (0.5, 3.0), SATURN_TITAN: (0.4, 2.0), MARS_PHOBOS: (0.4, 4.0)}[mu]
    return qso(mu).family(low * unit, high * unit, 41)


def test_the_distant_retrograde_orbit_of_the_moon() -> None:
    """At x = 70 000 km, by SciPy's DOP853 and a shooting of its own from the Kepler circle.

    vy 496.3272715 m/s, T 318.7120031 h, largest y 88 504.526 km, planar index −1.3603576, vertical
    0.1760139; the indices are λ + 1/λ, from the traces of the blocks of the monodromy matrix.
    """
    body = create(
        "body", "moon", name="moon", primary_gm_m3_s2=398600.22211e9, semi_major_axis_m=389703e3
    )
    gravity = create("gravity", "point_mass", gm_m3_s2=4902.79799e9)
    plant = create("plant", "three_body", body=body, gravity=gravity)
    made = create(
        "stage", "qso_family", plant=plant, x_amplitudes_km=[70000], periods_h=[900],
        x_min_km=20000, x_max_km=150000, curve_members=41, drift_revolutions=2,
    )  # fmt: skip
    product = made.run(RecordingContext())
    assert product.members.labels == ("x = 70000 km",)
    assert -product.members.x0[4, 0] == pytest.approx(496.3272715, rel=1e-9)
    assert product.members.period_s[0] / 3600 == pytest.approx(318.7120031, rel=1e-9)
    # SciPy's is the largest of 20 000 samples of a dense output
    assert product.y_max_m[0] == pytest.approx(88504.5261e3, rel=1e-8)
    assert product.member_indices[:, 0] == pytest.approx([-1.3603576, 0.1760139], abs=1e-7)
    # no orbit takes longer than the Moon's own, 2π · 382 981 s = 668 h
    (fault,) = product.missing
    assert "no member with T = 900 h (it has " in fault
    assert any(fault in sentence for sentence in made.present(product).verdict)


WHOLE_FAMILY = pytest.mark.slow
"""Families that one test alone computes to their last orbit; the Lyapunov orbits of Earth and Moon
and the halos of the Sun and Earth, both at L2, are always tested."""


@pytest.mark.parametrize(
    ("mu", "period", "constant"),
    [
        (SATURN_TITAN, 2.2365274428311821, 2.99991417019945),
        (MARS_PHOBOS, 4.7406333626886079, 2.99999004459787),
    ],
)
def test_retrograde_orbits_of_the_catalogue(mu: float, period: float, constant: float) -> None:
    """The Jacobi constant of the member with the printed period [1]_."""
    family = retrograde(mu)
    found = members_at(family.problem, family.branch, family.period, np.array([period]))
    assert found.z.shape[1] == 1
    x, z, vy = crossings(family, found.z, mu)[:, 0]
    assert jacobi(mu, x, z, vy) == pytest.approx(constant, abs=1e-12)


def test_retrograde_orbit_840_of_the_earth_and_moon() -> None:
    """X and ẏ at the crossing between Earth and Moon, rounded as they were printed [1]_."""
    family = retrograde(EARTH_MOON)
    states = crossings(family, family.branch.z, EARTH_MOON)[:, family.branch.size :]
    place = float(np.interp(0.7842146212260807, states[0], np.arange(family.branch.size)))

    def beside(u: float) -> Array:
        z = family.branch.at(family.problem, np.array([u]))
        return np.asarray(crossings(family, z, EARTH_MOON)[:, 1])

    for _ in range(6):  # secant, on x of the second crossing
        here, there = beside(place), beside(place + 1e-4)
        place -= (here[0] - 0.7842146212260807) * 1e-4 / (there[0] - here[0])
    assert beside(place)[2] == pytest.approx(0.5473049267844822, abs=1e-11)


@pytest.mark.parametrize(
    ("kind", "point", "mu", "printed", "period"),
    [
        # number 972
        ("lyapunov", "L2", EARTH_MOON, (1.1192937490150918, 0.0, 0.18122474967618102),
         3.4181096055680626),
        # number 468 [3]
        pytest.param(
         "lyapunov", "L1", EARTH_MOON, (6.819333350640226e-1, 0.0, 6.785699388026654e-1),
         6.111556928682104,
         marks=WHOLE_FAMILY),
        # "SE_L2_Small_Lyapunov" [4]
        pytest.param(
         "lyapunov", "L2", SUN_EARTH, (1.0173058431158761, 0.0, -3.5071329991448227e-2),
         5.5314456810353905,
         marks=WHOLE_FAMILY),
        # number 1197
        ("north", "L2", SUN_EARTH,
         (1.0110059685997803, 4.5638537751076817e-3, -1.1344790710813389e-2), 3.0803024932763416),
        # "SE_L2_Northern_Halo" [4]
        ("north", "L2", SUN_EARTH,
         (1.0082893998277027, 0.011434182696839030, -0.015179690420484332), 2.7047531095113841),
        # number 723, near-rectilinear [2]
        pytest.param(
         "south", "L2", EARTH_MOON,
         (1.0134037728554581, -0.17536227281091840, -8.3688427472776439e-2), 1.3960732332950263,
         marks=WHOLE_FAMILY),
        # number 1147, beside the Lyapunov orbits [5]
        pytest.param(
         "north", "L1", EARTH_MOON,
         (8.2339081983651485e-1, 9.8941366235910004e-4, 1.2634272983881797e-1),
         2.7430007981241529,
         marks=WHOLE_FAMILY),
        # number 928 [3], of the southern branch: z has the other sign
        pytest.param(
         "north", "L1", EARTH_MOON,
         (8.60129407766971e-1, 1.841529273318465e-1, 2.5380541457638645e-1), 2.3976941611197926,
         marks=WHOLE_FAMILY),
        # Gateway's near-rectilinear orbit, of 6.56 days or two of nine in a lunar month [6]
        pytest.param(
         "north", "L2", 1.0 / (81.30059 + 1.0),
         (1.022021512735817408, 0.182096761524240501, -0.103256341062793816), 1.511111111111111111,
         marks=WHOLE_FAMILY),
    ],
)  # fmt: skip
def test_libration_orbits_with_a_printed_period(
    kind: str, point: str, mu: float, printed: tuple[float, ...], period: float
) -> None:
    """The state of the member with that period, at one of its two crossings [1]_."""
    family = libration(kind, point, mu)
    found = members_at(family.problem, family.branch, family.period, np.array([period]))
    states = crossings(family, found.z, mu)
    misses = np.max(np.abs(states - np.array(printed)[:, None]), axis=0)
    assert misses.min() < 1e-11


@pytest.mark.parametrize(
    ("kind", "point", "mu", "printed", "closed"),
    [
        # quoted without number or period [7]
        pytest.param(
         "north", "L2", SATURN_ENCELADUS,
         (1.0025904252283664, 4.8802791235671040e-3, -5.4593457318909567e-3), 1e-11,
         marks=WHOLE_FAMILY),
        # quoted without number or period [3]
        pytest.param(
         "south", "L2", SATURN_TITAN,
         (1.0146402930203535, -5.197874717887378e-2, -3.743802561661956e-2), 1e-11,
         marks=WHOLE_FAMILY),
        # a state that misses the perpendicular crossing by 1e-8, after its own period [8]
        ("lyapunov", "L1", JUPITER_GANYMEDE, (0.965251234321497, 0.0, 0.046053059097282), 2e-9),
        # by 4.5e-6, and its period is 2.9e-4 too long: SciPy's correction moves ẏ by 3.7e-8 [8]
        ("lyapunov", "L2", JUPITER_EUROPA, (1.014011458923152, 0.0, 0.035771034698967), 5e-8),
    ],
)  # fmt: skip
def test_libration_orbits_with_a_printed_state(
    kind: str, point: str, mu: float, printed: tuple[float, ...], closed: float
) -> None:
    """Z and ẏ of the member that crosses at the printed x, as well as the printed state closes.

    Beside it ẏ of SciPy's DOP853 with a shooting of its own from the printed state, at its x.
    """
    family = libration(kind, point, mu)
    n = family.branch.size
    states = crossings(family, family.branch.z, mu).reshape(3, 2, n)
    half = int(
        np.min(np.max(np.abs(states - np.array(printed)[:, None, None]), axis=0), 1).argmin()
    )
    place = float(np.max(np.abs(states[:, half] - np.array(printed)[:, None]), axis=0).argmin())

    def beside(u: float) -> Array:
        z = family.branch.at(family.problem, np.array([u]))
        return np.asarray(crossings(family, z, mu)[:, half])

    # the secant looks towards the inside of the chain
    near = 1e-4 if place < n - 1 else -1e-4
    for _ in range(6):
        here, there = beside(place), beside(place + near)
        place -= (here[0] - printed[0]) * near / (there[0] - here[0])
    found = beside(place)
    assert found[0] == pytest.approx(printed[0], abs=1e-13)
    assert found[1:] == pytest.approx(printed[1:], abs=closed)
    z = family.branch.at(family.problem, np.array([place]))
    own = by_dop853(
        mu, printed, float(family.problem.period(z)[0]) * family.plant.scales.time_s * RATE
    )
    assert found[1:] == pytest.approx(own[1:], abs=1e-11)


def by_dop853(mu: float, printed: tuple[float, ...], period: float) -> Array:
    """Return x, z and ẏ of the periodic orbit at the printed x, without any code of the families.

    Newton's method on z (of an orbit in space), ẏ and the half-period, by differences.
    """

    def rates(t: float, s: Array) -> list[float]:
        x, y, z, u, v, w = s
        a = (1.0 - mu) * ((x + mu) ** 2 + y * y + z * z) ** -1.5
        b = mu * ((x - 1.0 + mu) ** 2 + y * y + z * z) ** -1.5
        ax = 2.0 * v + x - a * (x + mu) - b * (x - 1.0 + mu)
        return [u, v, w, ax, -2.0 * u + y - (a + b) * y, -(a + b) * z]

    def missed(q: Array) -> Array:
        *z, vy, half = q
        start = [printed[0], 0.0, z[0] if z else 0.0, 0.0, vy, 0.0]
        way = solve_ivp(rates, (0.0, half), start, method="DOP853", rtol=3e-14, atol=1e-16)
        return np.asarray(way.y[[1, 3, 5] if z else [1, 3], -1])

    begin = np.array([*([printed[1]] if printed[1] else []), printed[2], 0.5 * period])
    # `root` reports that rounding ends the iteration, where fsolve warns; what is left is checked
    found = np.asarray(root(missed, begin, options={"xtol": 1e-14}).x)
    assert np.max(np.abs(missed(found))) < 1e-12
    return np.array([printed[0], found[0] if printed[1] else 0.0, found[-2]])


HIGHEST = {
    ("lyapunov", "L2", EARTH_MOON): 0.1,
    ("lyapunov", "L1", EARTH_MOON): 0.17,
    ("lyapunov", "L2", SUN_EARTH): 8e-3,
    ("lyapunov", "L1", JUPITER_GANYMEDE): 6e-3,
    ("lyapunov", "L2", JUPITER_EUROPA): 0.012,
    ("north", "L2", SUN_EARTH): 0.012,
}
"""Amplitudes of families that need not go on to their ends, in distances: the printed ones and a
little more."""


@cache
def libration(kind: str, point: str, mu: float) -> Family:
    keys = {"plant": circular(mu), "point": point} | (
        {} if kind == "lyapunov" else {"branch": kind}
    )
    made: Any = create("orbit_family", "lyapunov" if kind == "lyapunov" else "halo", **keys)
    high = HIGHEST.get((kind, point, mu))
    found: Family = made.family(None, None if high is None else high * DISTANCE_M, 61)
    return found


@pytest.mark.slow  # families to their ends, half a minute
def test_halos_go_on_to_the_last_one_that_is_accurate() -> None:
    """Of the Earth and Moon, through all near-rectilinear ones to inside the Moon's surface.

    The Moon's radius is 1737.1 km, the distance 389 703 km. There errors grow over half a period
    to what Newton's iteration is to meet.
    """
    family = libration("south", "L2", EARTH_MOON)
    z = family.branch.z[:, -1:]
    way = family.problem.flow.trajectory(
        family.problem.state(z), family.problem.period(z), 2 * family.problem.steps
    )
    nearest = np.sqrt(np.min(np.sum(way[:3, :, 0] ** 2, axis=0)))
    assert nearest * family.plant.scales.length_m < 1737.1 / 389703 * DISTANCE_M
    assert family.branch.ends[1] == "the orbit is too sensitive to be computed"


def test_other_orbits_are_refused() -> None:
    """An orbit about the primary, an equilibrium, and a jump of an index are named."""
    made = qso(EARTH_MOON)
    family = retrograde(EARTH_MOON)
    problem, unit = family.problem, family.plant.scales.length_m
    distance = DISTANCE_M / unit
    assert made.winding.body == -1
    assert made.winding.primary == 0
    assert made.winding.distance == pytest.approx(distance)
    made.winding.require(problem, family.branch.z, unit, "orbit", "")
    # retrograde about the Earth, far inside the Moon's orbit: n' = r^(−3/2) + 1 of Earth's GM
    radius = 0.1
    rate = (1.0 - EARTH_MOON) ** 0.5 * radius**-1.5 + 1.0
    guess = np.array([[(radius - 1.0) * distance], [-radius * rate * distance], [np.pi / rate]])
    about_earth = correct(problem, guess, fix_component(0, guess[0, 0])).require_converged(
        "about the Earth"
    )
    with pytest.raises(ConvergenceError, match=r"winds 0\.00 times .* and -1\.00 times"):
        made.winding.require(problem, about_earth, unit, "quasi-satellite orbit", "look elsewhere")
    with pytest.raises(ConvergenceError, match="flight of no duration"):
        require_motion(problem, np.array([[1.0], [-2.0], [0.0]]), unit)
    x = np.linspace(1.0, 2.0, 21)
    require_smooth(np.array([x, x**2]), x, unit)
    with pytest.raises(ConvergenceError, match="second stability index jumps from 0"):
        require_smooth(np.array([x, np.where(x > 1.5, 3.0, 0.0)]), x, unit)
    way = np.array([np.cos(x * 2 * np.pi), np.sin(x * 2 * np.pi)])[:, :, None]
    assert turns(way)[0] == pytest.approx(1.0)
    assert turns(way, 2.0)[0] == pytest.approx(0.0, abs=1e-12)
