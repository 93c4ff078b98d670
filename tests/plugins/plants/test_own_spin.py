"""A body that turns at a rate of its own: an asteroid, against flights among the stars."""

from __future__ import annotations

from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from hillsphere import create
from hillsphere.dynamics import Derivatives, Taylor, system
from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array
from hillsphere.testing import check_plant
from hillsphere_plants.equilibria.libration_points import libration_points
from hillsphere_plants.equilibria.spinning_body import spin_equilibria

GM_SUN = 1.3271244e20
RATE = 1639.389232 * pi / 180 / 86400
AXES = (17e3, 8e3, 6e3)
GM = 4.46e5


def asteroid(**keys: Any) -> Any:
    given: dict[str, Any] = {
        "name": "eros", "semi_major_axis_m": 2.18e11, "eccentricity": 0.22,
        "rotation_rate_rad_s": RATE, "semi_axes_m": AXES, **keys,
    }  # fmt: skip
    return create("body", "asteroid", **given)


def ellipsoid() -> Any:
    return create("gravity", "ellipsoid", axes_m=AXES, gm_m3_s2=GM)


def plant(of: Any = None, **keys: Any) -> Any:
    return create(
        "plant", "three_body", body=of or asteroid(), gravity=ellipsoid(), orbit="elliptic",
        rotation="spin", **keys,
    )  # fmt: skip


def rotate_about_z(angle: float, v: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ v


def about_x(angle: float, v: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ v


@pytest.mark.parametrize(
    ("distance", "e", "meridian", "tilt", "equinox"),
    [(2.18e11, 0.22, 180.0, 0.0, 0.0), (3e7, 0.4, 130.0, 1.9, 0.6)],
)
def test_flight_among_the_stars(
    distance: float, e: float, meridian: float, tilt: float, equinox: float
) -> None:
    """Primary, body on its ellipse and particle by SciPy; some so near that the tide tells.

    Axes: z the orbit normal, x from the primary to the body's pericentre. The primary stands at
    ν + 180° in them; at its equinox, on the line of the nodes of the body's equator.
    """
    sun = GM_SUN if distance > 1e9 else 1e14
    of = asteroid(
        semi_major_axis_m=distance, eccentricity=e, primary_gm_m3_s2=sun,
        obliquity_rad=tilt, equinox_anomaly_rad=equinox,
    )  # fmt: skip
    made = system(plant(of, prime_meridian_deg=meridian), normalised=True)
    field, total = GravityField(ellipsoid()), sun + GM
    n, nu0, angle0, duration = sqrt(total / distance**3), 0.9, 0.3, 12000.0

    def eccentric(nu: float) -> float:
        return float(2 * np.arctan2(sqrt(1 - e) * np.sin(nu / 2), sqrt(1 + e) * np.cos(nu / 2)))

    since = (eccentric(nu0) - e * float(np.sin(eccentric(nu0)))) / n  # since the pericentre

    def body(t: float) -> Array:
        m = n * (since + t)
        anomaly = brentq(lambda q: q - e * np.sin(q) - m, m - 1.0, m + 1.0, xtol=1e-15)
        return distance * np.array([np.cos(anomaly) - e, sqrt(1 - e * e) * np.sin(anomaly), 0.0])

    def fixed(t: float, v: Array, back: bool = False) -> Array:
        """From the axes of the orbit to those of the body, or back.

        About the orbit normal to the line of nodes (where the primary stands at the equinox),
        about it by the obliquity, then by the angle of longitude 0.
        """
        nodes = equinox + pi
        spin = angle0 + RATE * t + np.radians(meridian) - pi
        if back:
            return rotate_about_z(nodes, about_x(-tilt, rotate_about_z(spin, v)))
        return rotate_about_z(-spin, about_x(tilt, rotate_about_z(-nodes, v)))

    def motion(t: float, y: Array) -> Array:
        away = body(t)
        pull = fixed(t, field.acceleration(fixed(t, y[:3])), back=True)
        q = away + y[:3]
        tide = -sun * (q / np.linalg.norm(q) ** 3 - away / np.linalg.norm(away) ** 3)
        return np.concatenate([y[3:], pull + tide])

    x0 = np.array([25e3, 18e3, 6e3, 1.0, -7.0, 2.0])
    spin = np.array([0.0, 0.0, RATE])
    start = [fixed(0.0, v, back=True) for v in (x0[:3], x0[3:] + np.cross(spin, x0[:3]))]
    y = solve_ivp(
        motion, (0, duration), np.concatenate(start), method="DOP853", rtol=3e-12, atol=1e-7
    ).y[:, -1]
    place = fixed(duration, y[:3])
    speed = fixed(duration, y[3:]) - np.cross(spin, place)
    state = np.array([*x0, nu0, angle0])
    found = Taylor(made).propagate(state / made.unit, duration / made.time_unit_s) * made.unit
    assert np.linalg.norm(found[:3] - place) < 2e-5
    assert np.linalg.norm(found[3:6] - speed) < 1e-8
    assert found[7] == pytest.approx(state[7] + RATE * duration, rel=1e-13)
    if distance < 1e9:  # the tide is seen: without it the particle ends elsewhere
        alone = system(plant(asteroid(semi_major_axis_m=1e13)))
        other = Taylor(alone).propagate(state, duration)
        assert np.linalg.norm(other[:3] - place) > 10.0


def test_at_the_rate_of_the_orbit_it_is_uniform() -> None:
    moon = {"primary_gm_m3_s2": 4.28e13, "semi_major_axis_m": 9.376e6, "eccentricity": 0.0151}
    n = sqrt((4.28e13 + GM) / 9.376e6**3)
    one = plant(create("body", "moon", rotation_rate_rad_s=n, **moon))
    other = create(
        "plant", "three_body", body=create("body", "moon", **moon), gravity=ellipsoid(),
        orbit="elliptic", rotation="uniform",
    )  # fmt: skip
    x = np.array([[25e3, 8e3, 3e3, 1.0, -2.0, 0.5, 2.3]]).T
    # the angle is then the mean anomaly
    half = np.arctan(np.sqrt((1 - 0.0151) / (1 + 0.0151)) * np.tan(1.15))
    mean = 2 * half - 0.0151 * np.sin(2 * half)
    found = Derivatives(system(one)).rate(np.append(x, [[mean]], axis=0))
    expected = Derivatives(system(other)).rate(x)
    np.testing.assert_allclose(found[:7], expected, rtol=1e-12, atol=1e-16)
    assert found[7, 0] == n


@pytest.mark.parametrize("tilt", [0.0, 0.4])
def test_contract(tilt: float) -> None:
    made = plant(asteroid(obliquity_rad=tilt, semi_major_axis_m=1e9, primary_gm_m3_s2=1e16))
    rng = np.random.default_rng(3)
    x = rng.normal(size=(8, 6)) * made.scales.of(made.states)[:, None]
    x[:3] *= 1.5 * made.scales.length_m / np.linalg.norm(x[:3], axis=0)
    check_plant(made, x)
    assert made.scales.length_m == pytest.approx((GM / RATE**2) ** (1 / 3))


def test_equilibria_of_an_ellipsoid() -> None:
    """On the axes of its equator, each a root of ω²r = −g(r); the long axis's unstable."""
    found = spin_equilibria(ellipsoid(), -RATE)
    field = GravityField(ellipsoid())
    expected = []
    for axis in (0, 1):
        way = np.eye(3)[axis]

        def outward(r: float, way: Array = way) -> float:
            return float(field.acceleration(r * way) @ way + RATE**2 * r)

        root = brentq(outward, AXES[axis] + 100.0, 40e3, xtol=1e-9)
        expected += [root * way, -root * way]
    order = np.argsort([np.mod(np.arctan2(q[1], q[0]) + 1e-9, 2 * pi) for q in expected])
    np.testing.assert_allclose(found.position_m, np.array(expected)[order].T, rtol=0, atol=1e-6)
    unstable = np.max(found.eigenvalues.real, axis=0) > 1e-6
    assert unstable[0]
    assert unstable[2]
    # the equations of the plant at rest there: nothing but the Sun's tide, in every season
    flow = Derivatives(system(plant()))
    x = np.zeros((8, 4))
    x[:3], x[6], x[7] = found.position_m, [0.0, 1.0, 2.0, 3.0], [3.0, 1.0, 0.5, 0.0]
    rate, jacobian = flow.both(x)
    assert np.max(np.abs(rate[3:6])) < 3e-9
    values = np.linalg.eigvals(np.moveaxis(jacobian[:6, :6], 2, 0)).T
    for k in range(4):
        size = np.sort(np.abs(found.eigenvalues[:, k]))
        np.testing.assert_allclose(np.sort(np.abs(values[:, k])), size, rtol=1e-5)


def test_equilibria_of_a_sphere_are_its_synchronous_circle() -> None:
    point = create("gravity", "point_mass", gm_m3_s2=GM)
    found = spin_equilibria(point, RATE)
    radius = (GM / RATE**2) ** (1 / 3)
    np.testing.assert_allclose(np.linalg.norm(found.position_m, axis=0), radius, rtol=1e-12)
    np.testing.assert_allclose(found.potential, 1.5 * GM / radius, rtol=1e-12)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="must not be zero"):
        spin_equilibria(ellipsoid(), 0.0)
    with pytest.raises(InputError, match="vary along the orbit"):
        libration_points(plant())
    still = create("body", "moon", primary_gm_m3_s2=1e13, semi_major_axis_m=1e7)
    with pytest.raises(InputError, match="no rotation_rate"):
        plant(still)
    with pytest.raises(InputError, match="rotation_rate"):
        create("body", "asteroid", semi_major_axis_m=1e11)
    shape = create("shape", "ellipsoid", axes_m=AXES)
    with pytest.raises(InputError, match="keep one"):
        asteroid(shape=shape)
