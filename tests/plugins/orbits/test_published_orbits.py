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
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.errors import ConvergenceError
from hillsphere.interfaces import Array
from hillsphere.testing import RecordingContext
from hillsphere_orbits.correction import correct, fixed
from hillsphere_orbits.members import members_at
from hillsphere_orbits.qso.families import Family, Qso
from hillsphere_orbits.winding import require_motion, require_smooth, turns

DISTANCE_M, RATE = 1e8, 1e-5
EARTH_MOON = 1.215058560962404e-2
SATURN_TITAN = 2.366393158331484e-4
MARS_PHOBOS = 1.611081404409632e-8
SUN_EARTH = 3.0542e-6


@cache
def circular(mu: float) -> Any:
    """Return the circular problem of a mass ratio; both bodies are point masses."""
    total = DISTANCE_M**3 * RATE**2
    moon = create("body", "moon", primary_gm_m3_s2=(1.0 - mu) * total, semi_major_axis_m=DISTANCE_M)
    gravity = create("gravity", "point_mass", gm_m3_s2=mu * total)
    return create("plant", "three_body", body=moon, gravity=gravity)


def qso(mu: float) -> Qso:
    made: Qso = create("orbit_family", "qso", plant=circular(mu))
    return made


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
    ("kind", "mu", "printed", "period", "high"),
    [
        # Earth-Moon, Lyapunov orbits about L2, number 972
        ("lyapunov", EARTH_MOON, (1.1192937490150918, 0.0, 0.18122474967618102),
         3.4181096055680626, 0.1),
        # Sun-Earth, northern halo orbits about L2, number 1197
        ("north", SUN_EARTH, (1.0110059685997803, 4.5638537751076817e-3, -1.1344790710813389e-2),
         3.0803024932763416, 5e-3),
        # Earth-Moon, southern halo orbits about L2, number 723: near-rectilinear [2]
        ("south", EARTH_MOON, (1.0134037728554581, -0.17536227281091840, -8.3688427472776439e-2),
         1.3960732332950263, None),
    ],
)  # fmt: skip
def test_libration_orbits_of_the_catalogue(
    kind: str, mu: float, printed: tuple[float, ...], period: float, high: float | None
) -> None:
    """The state of the member with the printed period [1]_, at one of its two crossings."""
    family = libration(kind, mu, high)
    found = members_at(family.problem, family.branch, family.period, np.array([period]))
    states = crossings(family, found.z, mu)
    misses = np.max(np.abs(states - np.array(printed)[:, None]), axis=0)
    assert misses.min() < 1e-11


@cache
def libration(kind: str, mu: float, high: float | None) -> Family:
    keys = {"plant": circular(mu), "point": "L2"} | ({} if kind == "lyapunov" else {"branch": kind})
    made: Any = create("orbit_family", "lyapunov" if kind == "lyapunov" else "halo", **keys)
    found: Family = made.family(None, None if high is None else high * DISTANCE_M, 61)
    return found


def test_halos_go_on_to_the_last_one_that_is_accurate() -> None:
    """Of the Earth and Moon, through all near-rectilinear ones to inside the Moon's surface.

    The Moon's radius is 1737.1 km, the distance 389 703 km. There errors grow over half a period
    to what Newton's iteration is to meet.
    """
    family = libration("south", EARTH_MOON, None)
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
    about_earth = correct(problem, guess, fixed(0, guess[0, 0])).checked("about the Earth")
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
