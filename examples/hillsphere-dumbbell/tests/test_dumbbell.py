"""Physics of the dumbbell and of zero-velocity maps, and the contracts of Hillsphere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hillsphere import create, load_mission
from hillsphere.errors import InputError
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array
from hillsphere.testing import check_gravity, check_plugin, check_stage, example

import hillsphere_dumbbell
from hillsphere_dumbbell.specs import DumbbellSpec

MISSION = Path(__file__).parents[1] / "missions" / "dumbbell-moon.toml"


def points_around(size_m: float, count: int = 40) -> Array:
    """Random points, 2 to 4 sizes from the origin."""
    random = np.random.default_rng(1)
    directions = random.normal(size=(3, count))
    reach = size_m * (2 + 2 * random.random(count))
    return np.asarray(directions / np.linalg.norm(directions, axis=0) * reach)


def test_plugin_keeps_its_contract() -> None:
    check_plugin(hillsphere_dumbbell)


@pytest.mark.parametrize(("number", "size_m"), [(0, 12e3), (1, 500.0)])
def test_gravity_keeps_its_contract(number: int, size_m: float) -> None:
    check_gravity(example("gravity", "dumbbell", number), points_around(size_m))


def test_potential_against_quadrature_over_the_rod() -> None:
    gm, length, rod, share = 2.0e5, 4000.0, 0.3, 0.7
    model = create(
        "gravity", "dumbbell", gm_m3_s2=gm, length_m=length, rod_fraction=rod, first_share=share
    )
    points = points_around(length)
    spheres = gm * (1 - rod)
    centre = -(1 - rod) * (2 * share - 1) * length / 2
    nodes, weights = np.polynomial.legendre.leggauss(40)
    rod_x = centre + nodes * length / 2

    def from_mass(mass: float, x: float) -> Array:
        return np.asarray(mass / np.sqrt((points[0] - x) ** 2 + points[1] ** 2 + points[2] ** 2))

    expected = from_mass(spheres * share, centre + length / 2)
    expected += from_mass(spheres * (1 - share), centre - length / 2)
    for x, weight in zip(rod_x, weights, strict=True):
        expected += from_mass(gm * rod * weight / 2, x)
    # Gauss–Legendre of 40 nodes is exact to round-off two rod lengths away.
    np.testing.assert_allclose(GravityField(model).potential(points), expected, rtol=2e-15)


def test_short_dumbbell_has_the_equilibria_of_a_point_mass() -> None:
    # Hill's problem: L1 and L2 at ±(GM/3n²)^(1/3), growth rate n·sqrt(1 + 2√7)
    # (Murray and Dermott 1999, Solar System Dynamics, section 3.13).
    body = create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0)
    gm = 7.0875e5
    gravity = create("gravity", "dumbbell", gm_m3_s2=gm, length_m=1.0, rod_fraction=0.5)
    plant = create("plant", "hill", body=body, gravity=gravity)
    product = check_stage("zero_velocity", {"plant": plant, "half_width_km": 40.0, "points": 21})
    n = body.mean_motion_rad_s
    radius = (gm / (3 * n**2)) ** (1 / 3)
    far = np.hypot(*product.equilibria_m) > 1e3
    np.testing.assert_allclose(
        product.equilibria_m[:, far], [[-radius, radius], [0.0, 0.0]], rtol=1e-8, atol=1e-6
    )
    rate = n * np.sqrt(1 + 2 * np.sqrt(7))
    np.testing.assert_allclose(product.growth_rate_1_s[far], rate, rtol=1e-7)


def test_a_plant_without_integral_is_refused() -> None:
    class Drifting:
        states = controls = ()

    with pytest.raises(InputError, match="has no integral of motion"):
        create("stage", "zero_velocity", plant=Drifting(), half_width_km=1.0)


def test_mission_is_valid() -> None:
    mission = load_mission(MISSION)
    assert mission.order() == ["map"]
    spec = mission.specs["gravity"]["moon"]
    assert isinstance(spec, DumbbellSpec)
    assert spec.length_m == 12e3
