"""Ground tracks, altitudes, eclipses and light of orbits around an ellipsoid."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.special import elliprg

from hillsphere import create
from hillsphere.dynamics import Taylor, system
from hillsphere.errors import HillsphereError, InputError, StageError
from hillsphere.interfaces import Array
from hillsphere.testing import RecordingContext, check_presentation, check_product
from hillsphere_orbits.coverage.ellipsoid_geometry import (
    cell_areas,
    is_hidden,
    nearest_point,
    normals,
)
from hillsphere_orbits.coverage.products import Coverage
from hillsphere_orbits.coverage.sunlight import declinations, obscuration, sun_directions
from hillsphere_orbits.qso.products import QsoFamily
from hillsphere_orbits.spatial_qso_families.products import SpatialFamilies

AXES = np.array([13.03, 11.40, 9.14])  # km: the Phobos QSO bifurcation paper
MU = 7.059650784871513e-4  # km³/s² [the same, eq. 1]
MARS_KM = 3396.19  # equatorial radius: IAU Working Group report of 2015
DISTANCE_KM = 9377.0
BODY = {"primary_gm_km3_s2": 42828.37, "semi_major_axis_km": DISTANCE_KM, "name": "phobos"}


def hill(gravity: Any, **body: Any) -> Any:
    return create("plant", "hill", body=create("body", "moon", **BODY, **body), gravity=gravity)


def ellipsoid() -> Any:
    return create("gravity", "ellipsoid", axes_km=AXES.tolist(), gm_km3_s2=MU)


@pytest.fixture(scope="module")
def family(plant: Any) -> QsoFamily:
    stage = create(
        "stage", "qso_family", plant=plant, x_amplitudes_km=[50, 20], x_min_km=19, x_max_km=52,
        curve_members=41, drift_revolutions=1,
    )  # fmt: skip
    found = stage.run(RecordingContext())
    assert isinstance(found, QsoFamily)
    return found


@pytest.fixture(scope="module")
def spatial(plant: Any, family: QsoFamily) -> SpatialFamilies:
    needs = {"family": "family"}
    stage = create("stage", "bifurcations", plant=plant, needs=needs, vertical=["1:17"])
    bifurcations = stage.run(RecordingContext(), family=family)
    stage = create(
        "stage", "spatial_qso_families", plant=plant, needs={"bifurcations": "b"},
        z_amplitudes_km=[70],
    )  # fmt: skip
    found = stage.run(RecordingContext(), bifurcations=bifurcations)
    assert isinstance(found, SpatialFamilies)
    return found


def stage(plant: Any, **keys: Any) -> Any:
    keys = {"needs": {"orbits": ["family", "families"]}, **keys}
    return create("stage", "coverage", plant=plant, **keys)


def run(plant: Any, family: QsoFamily, families: Any = None, **keys: Any) -> Coverage:
    found = stage(plant, **keys).run(
        RecordingContext(), orbits=(family,) if families is None else (family, families)
    )
    assert isinstance(found, Coverage)
    return found


@pytest.fixture(scope="module")
def covered(plant: Any, family: QsoFamily, spatial: SpatialFamilies) -> Coverage:
    return run(
        plant, family, spatial, primary_radius_km=MARS_KM, sun_declination_max_deg=25.19, seasons=9
    )


def on_surface(count: int) -> Array:
    u = np.random.default_rng(4).normal(size=(3, count))
    return np.asarray(u / np.linalg.norm(u / AXES[:, None], axis=0))


@pytest.mark.parametrize("height", [1e-9, 0.1, 5.0, 300.0, 1e6])
def test_nearest_point_along_the_normal(height: float) -> None:
    """A point put above a known one along its normal, also in the planes of the axes."""
    q = np.concatenate(
        [on_surface(200), np.diag(AXES), on_surface(3) * 0.0 - np.diag(AXES)], axis=1
    )
    q = np.concatenate(
        [q, np.array([[5.0], [0.0], [AXES[2] * np.sqrt(1 - (5 / AXES[0]) ** 2)]])], 1
    )
    up = normals(q, AXES)
    found = nearest_point(q + height * up, AXES)
    np.testing.assert_allclose(found, q, rtol=0, atol=1e-13 * (10.0 + height))


def test_nearest_point_is_nearer_than_any_other() -> None:
    r = 3.0 * on_surface(6)
    gap = np.linalg.norm(r - nearest_point(r, AXES), axis=0)
    others = on_surface(20000)
    least = np.min(np.linalg.norm(r[:, :, None] - others[:, None], axis=0), axis=1)
    assert np.all(gap <= least)
    np.testing.assert_allclose(gap, least, rtol=1e-2)
    # the radial altitude is another one
    radial = np.linalg.norm(r, axis=0) * (2.0 / 3.0)
    assert np.max(radial - gap) > 0.1


def test_nearest_point_of_one_inside() -> None:
    with pytest.raises(InputError, match="1 of 2 points are inside the body"):
        nearest_point(np.array([[13.0, 14.0], [0.0, 0.0], [0.0, 0.0]]), AXES)


def test_areas_of_an_ellipsoid() -> None:
    """The whole is 4π R_G(a²b², a²c², b²c²) [DLMF 19.33.1]; a sphere's bands go with sin φ."""
    latitudes, longitudes = np.linspace(-np.pi / 2, np.pi / 2, 19), np.linspace(-np.pi, np.pi, 37)
    a, b, c = AXES**2
    whole = cell_areas(latitudes, longitudes, AXES)
    assert whole.shape == (18, 36)
    assert whole.sum() == pytest.approx(4.0 * np.pi * elliprg(a * b, a * c, b * c), rel=1e-12)
    sphere = cell_areas(latitudes, longitudes, np.full(3, 2.0)).sum(axis=1)
    np.testing.assert_allclose(sphere, 8.0 * np.pi * np.diff(np.sin(latitudes)), rtol=1e-12)
    # the sides of the long axis are nearer to a sphere's poles: cells differ along a band
    assert np.ptp(whole[9]) > 0.1 * whole[9].mean()


def test_shadow_of_an_ellipsoid() -> None:
    """Against points along the ray."""
    rng = np.random.default_rng(6)
    r = on_surface(60) * (1.0 + 3.0 * rng.random(60))
    sun = rng.normal(size=(3, 50))
    sun /= np.linalg.norm(sun, axis=0)
    along = np.linspace(0.0, 150.0, 6001)
    way = r[:, :, None, None] + along * sun[:, None, :, None]
    least = np.min(np.sum((way / AXES[:, None, None, None]) ** 2, axis=0), axis=-1)
    found = is_hidden(r, np.repeat(sun[:, None], 60, axis=1), AXES)
    clear = np.abs(least - 1.0) > 1e-4
    np.testing.assert_array_equal(found[clear], (least < 1.0)[clear])
    assert 0.05 < found.mean() < 0.5


def test_cylinder_of_a_sphere() -> None:
    """At the distance D it takes the part asin(√(R² − D² sin²δ)/(D cos δ))/π."""
    for tilt in (0.0, 0.2, 0.3):
        sun = sun_directions(tilt, 20000, 1)
        found = obscuration(np.array([[-DISTANCE_KM], [0.0], [0.0]]), MARS_KM, sun, 0.0).mean()
        height = MARS_KM**2 - (DISTANCE_KM * np.sin(tilt)) ** 2
        exact = np.arcsin(np.sqrt(height) / (DISTANCE_KM * np.cos(tilt))) / np.pi
        assert found == pytest.approx(exact, abs=1.01e-4)
        same = is_hidden(np.array([[DISTANCE_KM], [0.0], [0.0]]), sun, np.full(3, MARS_KM)).mean()
        assert found == pytest.approx(same, abs=1e-12)


@pytest.mark.parametrize("apart", [0.0, 0.02, 0.0299, 0.0301, 0.05, 0.0699, 0.0701, 0.2, 3.0])
@pytest.mark.parametrize("sphere", [0.05, 0.02, 0.009])
def test_part_of_the_disc_that_is_hidden(apart: float, sphere: float) -> None:
    """Two discs in the sky, counted on a grid of points of the Sun's."""
    a = 0.02
    sun = np.array([np.cos(apart), np.sin(apart), 0.0])[:, None, None]
    found = obscuration(np.array([[1.0], [0.0], [0.0]]), np.sin(sphere), sun, a)[0, 0]
    grid = (np.arange(801) + 0.5) / 801 * 2.0 - 1.0
    p, q = np.meshgrid(a * grid, a * grid)
    disc = p**2 + q**2 <= a * a
    counted = np.count_nonzero(disc & ((p - apart) ** 2 + q**2 <= sphere**2)) / disc.sum()
    assert found == pytest.approx(counted, abs=2e-3)


def test_course_of_the_year() -> None:
    found = declinations(0.4, 25)
    assert np.all(np.diff(found) > 0.0)
    np.testing.assert_allclose(found, -found[::-1], rtol=0, atol=1e-15)
    assert found[12] == pytest.approx(0.0, abs=1e-15)
    assert 0.995 * 0.4 < found[-1] < 0.4
    # the mean square of sin δ = sin ε sin λ is half that of sin ε
    assert np.mean(np.sin(found) ** 2) == pytest.approx(0.5 * np.sin(0.4) ** 2, rel=1e-12)
    np.testing.assert_array_equal(declinations(0.0, 3), 0.0)
    sun = sun_directions(0.3, 7, 40)
    assert sun.shape == (3, 40, 7)
    np.testing.assert_allclose(np.linalg.norm(sun, axis=0), 1.0, rtol=1e-15)
    np.testing.assert_allclose(sun[2], np.sin(0.3), rtol=1e-15)


def test_planar_orbits(covered: Coverage, family: QsoFamily) -> None:
    """Over the equator; altitudes at the crossings of the axes; speeds as in the paper's Table 1.

    QSO-M: 23.41 and 12.04 m/s; QSO-Lc: 12.31 and 8.31 m/s.
    """
    np.testing.assert_array_equal(covered.latitude_rad[:, :2], 0.0)
    np.testing.assert_array_equal(covered.surface_part[:2], 0.0)
    middle = (covered.band_rad.size - 1) // 2
    np.testing.assert_array_equal(covered.band_time[middle, :2], 1.0)
    assert covered.band_rad[middle] < 0.0 < covered.band_rad[middle + 1]
    x, y = np.array([50e3, 20e3]), family.y_max_m
    np.testing.assert_allclose(covered.altitude_m[0, :2], x - 13.03e3, rtol=0, atol=1.0)
    np.testing.assert_allclose(covered.altitude_m[2, :2], y - 11.40e3, rtol=0, atol=1.0)
    np.testing.assert_allclose(covered.distance_m[[0, 2], :2], [x, y], rtol=0, atol=1.0)
    fast, slow = covered.speed_m_s[2, :2], covered.speed_m_s[0, :2]
    np.testing.assert_allclose(fast, [23.41, 12.31], rtol=0, atol=0.006)
    np.testing.assert_allclose(slow, [12.04, 8.31], rtol=0, atol=0.006)
    # all cells about the equator are met
    width = covered.band_rad[middle + 1]
    part = cell_areas(np.linspace(-width, width, 3), np.linspace(-np.pi, np.pi, 37), AXES).sum()
    a, b, c = AXES**2
    whole = 4.0 * np.pi * elliprg(a * b, a * c, b * c)
    np.testing.assert_allclose(covered.cells_part[:2], part / whole, rtol=1e-6)


def test_orbit_in_space(plant: Any, covered: Coverage, spatial: SpatialFamilies) -> None:
    orbit = 2
    assert covered.labels[orbit] == "1:17, 70 km"
    low, high = covered.latitude_rad[:, orbit]
    assert high == pytest.approx(np.radians(48.25), abs=2e-4)  # regression
    assert -high < low < -0.95 * high
    # by Taylor series, ten times as dense; longitude 0 is at −x
    equations = system(plant, normalised=True)
    x = spatial.members.x0[:, 0] / equations.unit
    times = np.linspace(0.0, spatial.members.period_s[0] / equations.time_unit_s, 40000)
    position = Taylor(equations).sample(x, times)[:3] * equations.unit[0]
    body = position * np.array([[-1.0], [-1.0], [1.0]])
    ground = nearest_point(body, AXES * 1e3)
    latitude = np.arctan2(ground[2], np.hypot(ground[0], ground[1]))
    assert latitude.max() == pytest.approx(high, abs=2e-5)
    assert latitude.min() == pytest.approx(low, abs=2e-5)
    gap = np.linalg.norm(body - ground, axis=0)
    found = covered.altitude_m[:, orbit]
    np.testing.assert_allclose(found, [gap.min(), gap.mean(), gap.max()], rtol=0, atol=3.0)
    assert covered.band_time[:, orbit].sum() == pytest.approx(1.0, rel=1e-12)
    met = np.flatnonzero(covered.band_time[:, orbit])
    assert covered.band_rad[met[0]] <= low
    assert high <= covered.band_rad[met[-1] + 1]
    assert 0.79 < covered.surface_part[orbit] < 0.81
    assert 0.5 < covered.cells_part[orbit] < 0.9


def test_prime_meridian(covered: Coverage) -> None:
    """Longitude 0 is under the primary: an orbit that starts at x > 0 starts over 180°."""
    longitude = np.degrees(covered.track_rad[0, 0])
    np.testing.assert_allclose(np.abs(longitude), 180.0, rtol=0, atol=1e-9)


def test_eclipses(covered: Coverage) -> None:
    """By the primary as far as the moon itself, but for the size of the orbit; sums and bounds."""
    equinox = covered.declination_rad.size // 2
    assert covered.declination_rad[equinox] == pytest.approx(0.0, abs=1e-15)
    exact = np.arcsin(MARS_KM / DISTANCE_KM) / np.pi
    np.testing.assert_allclose(covered.primary_shadow[equinox], exact, rtol=0, atol=8e-4)
    # asin(R/D) is 21.2°: at the solstices the moon passes above the shadow
    np.testing.assert_array_equal(covered.primary_shadow[[0, -1]], 0.0)
    both = covered.primary_shadow + covered.body_shadow
    assert np.all(covered.shadow <= both + 1e-12)
    assert np.all(covered.shadow >= np.maximum(covered.primary_shadow, covered.body_shadow) - 1e-12)
    # in the plane, the shadow of the moon is a strip at most 2a and at least 2b wide
    for i, name in enumerate(covered.labels[:2]):
        low = np.arcsin(11.40e3 / covered.distance_m[2, i]) / np.pi
        high = np.arcsin(13.03e3 / covered.distance_m[0, i]) / np.pi
        assert low < covered.body_shadow[equinox, i] < high, name
    np.testing.assert_allclose(covered.shadow, covered.shadow[::-1], rtol=0, atol=2e-3)


def test_lit_ground(plant: Any, family: QsoFamily) -> None:
    """Over the equator at equinox the Sun is higher than h for (180° − 2h)/360°."""
    found = run(plant, family, sun_elevation_min_deg=20, sun_longitudes=720, seasons=1)
    np.testing.assert_allclose(found.lit_ground, 140.0 / 360.0, rtol=0, atol=1e-3)
    assert np.isnan(found.primary_shadow).all()
    np.testing.assert_array_equal(found.shadow, found.body_shadow)


def test_cone_and_cylinder_of_the_primary(plant: Any, family: QsoFamily) -> None:
    """The penumbra takes as much inside the cylinder as it gives outside."""
    keys = {"primary_radius_km": MARS_KM, "seasons": 1, "sun_longitudes": 2000}
    cylinder = run(plant, family, **keys)
    cone = run(plant, family, sun_distance_au=1.523679, **keys)
    np.testing.assert_allclose(cone.primary_shadow, cylinder.primary_shadow, rtol=0, atol=1e-4)
    assert not np.array_equal(cone.primary_shadow, cylinder.primary_shadow)


def test_body_without_surface() -> None:
    point = hill(create("gravity", "point_mass", gm_km3_s2=MU))
    made = create(
        "stage", "qso_family", plant=point, x_amplitudes_km=[50], x_min_km=45, x_max_km=52,
        curve_members=21, drift_revolutions=1,
    )  # fmt: skip
    family = made.run(RecordingContext())
    found = run(point, family, seasons=1)
    assert np.isnan(found.altitude_m).all()
    assert np.isnan(found.body_shadow).all()
    assert found.distance_m[0, 0] == pytest.approx(50e3, abs=1.0)
    shown = stage(point).present(found, orbits=(family,))
    check_presentation(shown)
    row = shown.tables["coverage"].rows[0]
    assert row["min_altitude_km"] is None
    assert row["mean_eclipse"] is None
    assert row["mean_lit"] is None
    found = run(point, family, seasons=1, primary_radius_km=MARS_KM)
    assert stage(point).present(found).tables["coverage"].rows[0]["mean_eclipse"] > 0.1


def test_tables(plant: Any, covered: Coverage) -> None:
    check_product(covered)
    shown = stage(plant, label="again").present(covered)
    check_presentation(shown)
    rows = shown.tables["coverage_again"].rows
    assert rows[2]["max_latitude_deg"] == pytest.approx(48.25, abs=0.01)
    assert rows[0]["min_eclipse"] <= rows[0]["mean_eclipse"] <= rows[0]["max_eclipse"]
    assert len(shown.tables["seasons_again"].rows) == 27
    assert "1:17, 70 km" in shown.verdict[0]
    assert any("cylinder" in note for note in shown.tables["coverage_again"].notes)


def test_orbit_through_the_body(family: QsoFamily) -> None:
    """The surface of a larger body about the same gravity."""
    plump = hill(ellipsoid(), semi_axes_km=[21.0, 11.4, 9.14])
    with pytest.raises(StageError, match="pass through the body have no coverage: 'x = 20 km'"):
        run(plump, family)


def test_primary_that_reaches_the_orbits(plant: Any, family: QsoFamily) -> None:
    with pytest.raises(InputError, match="reaches as far as the orbits"):
        run(plant, family, primary_radius_km=9360)


def test_orbit_longer_than_the_primary_is_far_is_no_obstacle(plant: Any, family: QsoFamily) -> None:
    """The orbit x = 50 km reaches 94 km along y, and never nearer to Mars than 9377 − 50 km."""
    assert run(plant, family, primary_radius_km=9320, seasons=1).primary_shadow.max() < 1.0


def test_orbits_of_another_plant(family: QsoFamily) -> None:
    other = hill(create("gravity", "point_mass", gm_km3_s2=MU))
    with pytest.raises(StageError, match="do not solve the equations"):
        run(other, family)
    moved = replace(family, members=replace(family.members, frame="hill:deimos"))
    with pytest.raises(StageError, match="frame hill:deimos"):
        run(hill(ellipsoid()), moved)


@pytest.mark.parametrize(
    "keys, words",
    [
        ({"needs": {}}, "orbits"),
        ({"cell_deg": 0}, "must be"),
        ({"seasons": 0}, "must be ≥ 1"),
        ({"sun_longitudes": 3}, "must be ≥ 4"),
        ({"sun_elevation_min_deg": 90}, "must be <"),
        ({"sun_distance_m": 2e9, "sun_radius_m": 3e9}, "farther away than its radius"),
        ({"primary_radius_km": -1}, "must be > 0"),
    ],
)
def test_bad_keys(plant: Any, keys: Mapping[str, Any], words: str) -> None:
    with pytest.raises(HillsphereError, match=words):
        stage(plant, **keys)
