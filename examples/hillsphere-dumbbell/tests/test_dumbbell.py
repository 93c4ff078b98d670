"""Physics of the dumbbell and of zero-velocity maps, and the contracts of Hillsphere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hillsphere import create, load_mission
from hillsphere.errors import InputError
from hillsphere.estimation import Belief
from hillsphere.gravity import GravityField
from hillsphere.interfaces import Array
from hillsphere.sensor_suite import SensorSuite
from hillsphere.show.drawing import draw
from hillsphere.testing import (
    RecordingContext,
    check_gravity,
    check_plugin,
    check_sensor,
    check_stage,
    example,
)
from hillsphere_estimators.plant_model import PlantModel

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


@pytest.mark.parametrize(("half_width_m", "message"), [(1e-300, "nowhere on a map"), (1e-9, "")])
def test_a_map_far_too_small_is_refused_or_drawn(half_width_m: float, message: str) -> None:
    """Its values are infinite, or all the same: the figure raised a TypeError or a ValueError."""
    moon = create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377)
    kind = "point_mass" if message else "dumbbell"
    keys = {} if message else {"length_km": 12, "rod_fraction": 0.0}
    gravity = create("gravity", kind, gm_km3_s2=7e-4, **keys)
    plant = create("plant", "hill", body=moon, gravity=gravity)
    stage = create("stage", "zero_velocity", plant=plant, half_width_m=half_width_m, points=11)
    if message:
        with pytest.raises(InputError, match=message):
            stage.run(RecordingContext())
    else:
        shown = stage.present(stage.run(RecordingContext()))
        assert draw(shown.figures["zero_velocity"]).svg


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


@pytest.mark.parametrize(("number", "size_m"), [(0, 500.0), (1, 20e3)])
def test_limb_ranger_keeps_its_contract(number: int, size_m: float) -> None:
    x = np.concatenate([points_around(size_m), np.zeros((3, 40))])
    check_sensor(example("sensor", "limb_ranger", number), x, np.arange(40.0), {})


def test_limb_ranger_by_the_tangent_to_the_sphere() -> None:
    sensor = create("sensor", "limb_ranger", radius_m=300.0, field_of_view_deg=61, spacecraft=2)
    x = np.zeros((12, 3))
    x[8] = 600.0, 1500.0, 4e6
    t, none = np.zeros(3), np.zeros((1, 3))
    seen = sensor.observe(x, t, {})[0]
    # the tangent from 600 m touches a sphere of 300 m under 30 degrees
    assert seen[0] == pytest.approx(np.pi / 6)
    # the tangent's length by Pythagoras
    assert np.tan(seen[1]) == pytest.approx(300.0 / np.sqrt(1500.0**2 - 300.0**2))
    assert sensor.visible(x, t, {}).tolist() == [True, True, False]
    assert np.isnan(sensor.measure(x, t, {}, none, none)[0]).tolist() == [False, False, True]
    with pytest.raises(InputError, match="spacecraft 2 needs 12 states"):
        sensor.observe(x[:6], t, {})


@pytest.mark.parametrize("type_", ["unscented", "iterated_extended", "information"])
def test_estimators_take_the_limb_ranger_as_any_sensor(type_: str) -> None:
    body = create("body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0)
    gravity = create("gravity", "dumbbell", gm_m3_s2=7e5, length_m=10e3, rod_fraction=0.5)
    plant = create("plant", "hill", body=body, gravity=gravity)
    suite = SensorSuite([create("sensor", "limb_ranger", radius_km=5.0, sigma_rad=1e-4)])
    model, estimator = PlantModel(plant, suite), create("estimator", type_)
    cases, random = 60, np.random.default_rng(3)
    x = np.repeat([[40e3], [5e3], [1e3], [0.0], [-1.0], [0.0]], cases, axis=1)
    sigma = np.array([800.0, 800.0, 800.0, 0.01, 0.01, 0.01])
    t, none = np.zeros(cases), np.zeros((0, cases))
    root = np.repeat(np.diag(sigma)[None], cases, axis=0)
    belief = Belief(x + sigma[:, None] * random.normal(size=x.shape), root, t)
    for k in range(4):
        later = np.full(cases, 600.0 * k)
        x = model.advance(x, t, later, none, np.arange(cases))
        belief = estimator.predict(model, belief, later, none) if k else belief
        seen = suite.measurements(x, later, {}, *(random.normal(size=(1, cases)) for _ in "ab"))
        belief, _ = estimator.update(model, belief, seen)
        t = later
    out = x[:3] / np.linalg.norm(x[:3], axis=0)
    off = np.sum(out * (belief.x - x)[:3], axis=0)
    said = np.sqrt(np.einsum("in,nij,jn->n", out, belief.covariance[:, :3, :3], out))
    # the last measurement alone, by the slope of the angle: nothing may be known worse than by it
    distance = np.linalg.norm(x[:3], axis=0)
    alone = 1e-4 * distance * np.sqrt((distance / 5e3) ** 2 - 1.0)
    assert (said < 1.5 * alone).all()
    assert (said > 0.4 * alone).all()
    assert 0.7 < np.sqrt(np.mean((off / said) ** 2)) < 1.35
