"""Stations and geodetic coordinates."""

from __future__ import annotations

from math import inf, nan, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hillsphere.base.geodetic import WGS84, Ellipsoid, Station, ecef, geodetic
from hillsphere.errors import InputError

ALCANTARA = Station("Alcântara", np.radians(-2.18), np.radians(-44.26), 39.0)
CUIABA = Station("Cuiabá", np.radians(-15.53), np.radians(-56.07), 277.0)


def test_stations_of_kuga_and_carrara() -> None:
    """Coordinates of Kuga & Carrara (1990), section 5, on WGS 84.

    The literals follow from the closed formula X = (N + H) cos ψ cos λ …, Z = (N(1−e²) + H) sin ψ.
    """
    km = np.array(
        [
            [4564.6391112847, -4448.2275319037, -240.9964158698],
            [3431.1389246705, -5100.3027078114, -1696.750194376],
        ]
    )
    assert np.allclose(ALCANTARA.ecef_m / 1e3, km[0], rtol=0, atol=1e-10)
    assert np.allclose(CUIABA.ecef_m / 1e3, km[1], rtol=0, atol=1e-10)


def test_the_stations_given_to_the_tracker_lie_kilometres_away() -> None:
    """Kuga & Carrara (1990), section 5: 11.08 km and 8.21 km from the exact ones."""
    told = (
        Station("Alcântara", np.radians(-2.1), np.radians(-44.2), 30.0),
        Station("Cuiabá", np.radians(-15.5), np.radians(-56.0), 270.0),
    )
    away = [
        float(np.linalg.norm(a.ecef_m - b.ecef_m)) / 1e3
        for a, b in zip(told, (ALCANTARA, CUIABA), strict=True)
    ]
    assert away == pytest.approx([11.08, 8.21], abs=0.005)


def test_axes_are_east_north_up() -> None:
    east, north, up = CUIABA.axes
    assert np.allclose(CUIABA.axes @ CUIABA.axes.T, np.eye(3), rtol=0, atol=1e-15)
    assert np.allclose(np.cross(east, north), up, rtol=0, atol=1e-15)
    h = 1e-6
    place = CUIABA.ecef_m
    eastward = Station("", CUIABA.latitude_rad, CUIABA.longitude_rad + h, 277.0).ecef_m - place
    northward = Station("", CUIABA.latitude_rad + h, CUIABA.longitude_rad, 277.0).ecef_m - place
    upward = Station("", CUIABA.latitude_rad, CUIABA.longitude_rad, 278.0).ecef_m - place
    for axis, step in ((east, eastward), (north, northward), (up, upward)):
        assert axis @ step == pytest.approx(float(np.linalg.norm(step)), rel=1e-11)


def test_at_the_pole_and_on_a_sphere() -> None:
    pole = Station("pole", 0.5 * pi, 0.0, 0.0)
    b = WGS84.equatorial_radius_m * (1.0 - WGS84.flattening)
    assert np.allclose(pole.ecef_m, [0.0, 0.0, b], rtol=0, atol=1e-9)
    sphere = Ellipsoid(1e6, inf)
    assert np.allclose(
        ecef(np.array([0.3]), np.array([0.4]), np.array([5.0]), sphere)[:, 0],
        1000005.0 * np.array([np.cos(0.3) * np.cos(0.4), np.cos(0.3) * np.sin(0.4), np.sin(0.3)]),
        rtol=1e-15,
        atol=0,
    )


@given(
    st.floats(-0.5 * pi, 0.5 * pi),
    st.floats(-pi, pi),
    st.floats(-5e3, 4e7),
)
def test_there_and_back(latitude: float, longitude: float, height: float) -> None:
    """ERFA's solution in one step: heights to 1e-7 m, latitudes to 3e-11 rad."""
    place = ecef(np.array([latitude]), np.array([longitude]), np.array([height]))
    found = geodetic(place)
    again = ecef(*found)
    assert found[0] == pytest.approx(latitude, abs=1e-10)
    assert found[2] == pytest.approx(height, abs=5e-7)
    assert np.allclose(again, place, rtol=0, atol=3e-3)


def test_a_station_from_its_position() -> None:
    again = Station.at("Cuiabá", CUIABA.ecef_m)
    assert again.latitude_rad == pytest.approx(CUIABA.latitude_rad, abs=1e-14)
    assert again.longitude_rad == pytest.approx(CUIABA.longitude_rad, abs=1e-14)
    assert again.height_m == pytest.approx(277.0, abs=1e-7)


@pytest.mark.parametrize(
    "make, says",
    [
        (lambda: Station("X", 2.0, 0.0), r"station 'X': geodetic latitudes must be within ±90°"),
        (lambda: Station("X", nan, 0.0), r"station 'X': .* finite"),
        (lambda: Station("X", 0.0, inf), r"station 'X': .* finite"),
        (lambda: Ellipsoid(-1.0, 300.0), r"equatorial radius must be > 0 m, got -1"),
        (lambda: Ellipsoid(6e6, 0.5), r"inverse flattening must be > 1, got 0.5"),
        (lambda: geodetic(np.zeros(3)), r"must be \(3, N\), got \(3,\)"),
        (lambda: geodetic(np.full((3, 1), nan)), r"must be finite"),
    ],
)
def test_what_is_no_place_is_refused(make: object, says: str) -> None:
    assert callable(make)
    with pytest.raises(InputError, match=says):
        make()
