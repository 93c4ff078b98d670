"""The packaged field and shape of asteroid Eros: two instruments that tell of one body."""

from __future__ import annotations

from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.gravity import GravityField
from hillsphere_gravity.ellipsoid import CODATA_2018_G
from hillsphere_gravity.quadrupole import second_moments
from hillsphere_plants.equilibria.spinning_body import spin_equilibria

DATA = Path(__file__).parents[3] / "missions" / "data"
RADIUS = 16e3
RATE = 1639.389232 * pi / 180 / 86400


def field() -> Any:
    return create("gravity", "harmonics", file=str(DATA / "eros-gravity-degree4.gfc"))


def shape() -> Any:
    return create("shape", "harmonics", file=str(DATA / "eros-shape-degree8.tab"), length_unit="m")


def homogeneous(subdivisions: int = 4) -> Any:
    return create(
        "gravity", "polyhedron", shape=shape(), subdivisions=subdivisions,
        gm_m3_s2=field().gm_m3_s2,
    )  # fmt: skip


def test_a_homogeneous_body_of_the_shape_has_the_gravity() -> None:
    """To two per cent of the largest coefficient; the shape is cut at degree 8."""
    mesh = homogeneous().mesh
    # Yeomans et al. (2000), Science 289, 2085: 2.67 ± 0.03 g/cm³
    density = field().gm_m3_s2 / CODATA_2018_G / mesh.volume_m3
    assert density == pytest.approx(2670.0, abs=30.0)
    assert np.linalg.norm(mesh.centroid_m) < 50.0
    moments = second_moments(mesh) / mesh.volume_m3 / RADIUS**2
    xx, yy, zz = np.diag(moments)
    found = {
        "C2,0": (zz - 0.5 * (xx + yy)) / sqrt(5),
        "C2,1": sqrt(3 / 5) * moments[0, 2],
        "S2,1": sqrt(3 / 5) * moments[1, 2],
        "C2,2": sqrt(12 / 5) * (xx - yy) / 4,
        "S2,2": sqrt(12 / 5) * moments[0, 1] / 2,
    }
    measured = {q.name: q.value for q in field().parameters()}
    for name, value in found.items():
        assert value == pytest.approx(measured[name], abs=0.02 * measured["C2,2"])


def test_gravity_of_both_outside_the_brillouin_sphere() -> None:
    radius = shape().largest_radius_m
    assert 17.5e3 < radius < 17.7e3
    way = np.random.default_rng(1).normal(size=(3, 40))
    r = 2.0 * radius * way / np.linalg.norm(way, axis=0)
    series, body = (GravityField(model).acceleration(r) for model in (field(), homogeneous()))
    size = np.linalg.norm(series, axis=0)
    assert np.max(np.linalg.norm(series - body, axis=0) / size) < 0.01


def test_equilibrium_points_lie_off_the_four_sides() -> None:
    """Two off the ends, unstable in a line; two off the flanks, where motion spirals away."""
    found = spin_equilibria(homogeneous(3), RATE)
    assert found.position_m.shape == (3, 4)
    longitude = np.degrees(np.arctan2(found.position_m[1], found.position_m[0])) % 360
    np.testing.assert_allclose(longitude, [79, 178, 259, 343], rtol=0, atol=3.0)
    distance = np.linalg.norm(found.position_m, axis=0)
    assert ((distance > 13e3) & (distance < 20.5e3)).all()
    growing = found.eigenvalues.real > 1e-5
    np.testing.assert_array_equal(growing.sum(axis=0), [2, 1, 2, 1])
