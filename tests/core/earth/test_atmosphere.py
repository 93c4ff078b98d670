"""Density of the upper atmosphere."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest

from hillsphere.base.geodetic import WGS84, ecef, geodetic
from hillsphere.dynamics import ArrayFunction
from hillsphere.interfaces import Array
from hillsphere.symbolic import Vec3, jacobian, variable, variables
from hillsphere_plants.atmosphere import density, geodetic_expressions

PLACE: Vec3 = (variable("x"), variable("y"), variable("z"))


@pytest.mark.parametrize("height", [2e5, 1e6, 2e6, 3.6e7])
def test_geodetic_expressions_against_erfa(height: float) -> None:
    random = np.random.default_rng(0)
    places = ecef(
        random.uniform(-1.55, 1.55, 500), random.uniform(-3.1, 3.1, 500), np.full(500, height)
    )
    found = ArrayFunction(geodetic_expressions(PLACE, WGS84), PLACE, ())(places)
    latitude, longitude, heights = geodetic(places)
    assert np.allclose(found[0], latitude, rtol=0, atol=2e-8)
    assert np.allclose(found[2], heights, rtol=0, atol=1e-6)
    # a metre on the parallel, for the blunted axis
    assert np.allclose((found[1] - longitude) * np.cos(latitude) * 6.4e6, 0.0, rtol=0, atol=1.0)


def test_geodetic_expressions_are_smooth_at_the_poles() -> None:
    slopes = [e for row in jacobian(geodetic_expressions(PLACE, WGS84), PLACE) for e in row]
    above = np.array([[0.0, 0.0], [0.0, 0.0], [7e6, -7e6]])
    latitude, _, height = ArrayFunction(geodetic_expressions(PLACE, WGS84), PLACE, ())(above)
    b = WGS84.equatorial_radius_m * (1.0 - WGS84.flattening)
    assert np.allclose(latitude, [pi / 2, -pi / 2], rtol=0, atol=1e-6)
    assert np.allclose(height, 7e6 - b, rtol=0, atol=1e-6)
    table = ArrayFunction(slopes, PLACE, ())(above)
    assert np.isfinite(table).all()
    assert np.allclose(table[8], [1.0, -1.0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("day, published", [(172.0, 4.074714e-12), (81.0, 5.001846e-12)])
def test_nrlmsise00_standard_cases(day: float, published: float) -> None:
    """Cases 1 and 2 of the model's own test driver, kg/m³; the network is good to a few percent.

    Picone et al., J. Geophys. Res. 107(A12), 1468, 2002: 400 km, 60°N 70°W, 16 h local solar time
    (of which Universal time and longitude here make one), F10.7 150, its mean 150, Ap 4.
    """
    hour = (16.0 + 70.0 / 15.0) % 24.0
    place = ecef(np.array([radians(60.0)]), np.array([radians(-70.0)]), np.array([400e3]))
    rho = density(PLACE, variables("day")[0], WGS84, 150.0, 150.0, 4.0)
    x = np.concatenate([place, [[day - 1.0 + hour / 24.0]]])
    found = ArrayFunction([rho], (*PLACE, variable("day")), ())(x)
    assert found[0, 0] == pytest.approx(published, rel=0.05)


def test_density_falls_with_height_and_rises_with_the_sun() -> None:
    heights = np.linspace(180e3, 1500e3, 50)
    places = ecef(np.full(50, 0.2), np.full(50, 1.0), heights)

    def at(flux: float) -> Array:
        rho = density(PLACE, 30.0, WGS84, flux, flux, 15.0)
        return np.asarray(ArrayFunction([rho], PLACE, ())(places)[0])

    assert (np.diff(at(150.0)) < 0.0).all()
    assert (at(200.0)[5:30] > at(80.0)[5:30]).all()
