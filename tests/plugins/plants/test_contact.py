"""Contact with surfaces that are expressions, and with such as are functions of arrays."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest

from hillsphere import create
from hillsphere.dynamics import StepMap, Taylor, system
from hillsphere.errors import InputError
from hillsphere.interfaces import Array, Variable
from hillsphere.model.shapes.sphere import unit_vectors
from hillsphere.model.shapes.triangulation import triangulate
from hillsphere.simulation import Cases, simulate
from hillsphere.symbolic import Expr, constant

AXES = (13030.0, 11400.0, 9140.0)
GM = 7.087546066894452e5


def mesh_of(shape: Any, subdivisions: int) -> Any:
    mesh = triangulate(shape, subdivisions)
    return create(
        "shape", "polyhedron", vertices=mesh.vertices.tolist(),
        faces=(mesh.faces + 1).tolist(), length_unit="m",
    )  # fmt: skip


class Coasting:
    """A continuous law with a state of its own that commands nothing."""

    period_s = 60.0
    measurement: Literal["held", "continuous"] = "continuous"
    inputs = 7
    states = (Variable("clock", 0, 1),)

    def initial(self, n_cases: int) -> Array:
        return np.zeros((1, n_cases))

    def sample(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> Array:
        return xc

    def derivative(self, xc: Any, y: Any, ref: Any, t: Expr) -> tuple[Expr, ...]:
        return (constant(1.0) + 0.0 * xc[0],)

    def control(self, xc: Any, y: Any, ref: Any, t: Expr) -> tuple[Expr, ...]:
        return (0.0 * xc[0], 0.0 * y[0], 0.0 * ref[0])


def ellipsoid() -> Any:
    return create("shape", "ellipsoid", axes_m=AXES)


def plant(kind: str = "three_body", gravity: Any = None, **keys: Any) -> Any:
    body = create(
        "body", "moon", name="phobos", primary_gm_m3_s2=4.282837362069909e13,
        semi_major_axis_m=9376e3, eccentricity=0.0151, **keys,
    )  # fmt: skip
    field = gravity or create("gravity", "point_mass", gm_m3_s2=GM)
    more = {"orbit": "elliptic"} if kind == "three_body" else {"prime_meridian_deg": 130.0}
    return create("plant", kind, body=body, gravity=field, **more)


def starts(made: Any, count: int = 6) -> Array:
    """Points at 20 km from which to fall."""
    way = np.random.default_rng(1).normal(size=(3, count))
    x = np.zeros((len(made.states), count))
    x[:3] = 20e3 * way / np.linalg.norm(way, axis=0)
    x[3:6] = -8.0 * x[:3] / 20e3
    return x


def impacts(made: Any, x: Array) -> Any:
    return StepMap(system(made)).locate("impact", x, 4000.0, 400)


def test_a_shape_that_is_an_expression_is_that_of_the_axes() -> None:
    one, other = plant(semi_axes_m=AXES), plant(shape=ellipsoid())
    x = starts(one)
    found, expected = impacts(other, x), impacts(one, x)
    assert found.found.all()
    np.testing.assert_array_equal(found.x, expected.x)
    flight = Taylor(system(other), events=["impact"]).fly(x, 4000.0)
    assert set(flight.ended_by) == {"impact"}
    np.testing.assert_allclose(flight.x[:3], found.x[:3], rtol=0, atol=1e-4)


@pytest.mark.parametrize("kind", ["three_body", "hill"])
def test_contact_with_a_mesh_tends_to_that_with_the_ellipsoid(kind: str) -> None:
    """By a quarter with each subdivision, in plants of both frames."""
    smooth = plant(kind, shape=ellipsoid())
    x = starts(smooth)
    expected = impacts(smooth, x)
    gaps = []
    for k in (3, 4):
        shape = mesh_of(ellipsoid(), k)
        made = plant(kind, shape=shape)
        found = impacts(made, x)
        assert found.found.all()
        gaps.append(np.max(np.linalg.norm(found.x[:3] - expected.x[:3], axis=0)))
        c, s = made.rotation
        body = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ found.x[:3]
        np.testing.assert_allclose(shape.surface_array(body), 0.0, rtol=0, atol=1e-12)
    assert gaps[1] < gaps[0] / 2
    assert gaps[1] < 80.0


def test_a_mesh_of_the_gravity_is_met() -> None:
    """Gravity that is a polyhedron brings its surface along, as an ellipsoid does."""
    gravity = create("gravity", "polyhedron", shape=ellipsoid(), subdivisions=2, gm_m3_s2=GM)
    made = plant(gravity=gravity)
    assert made.surface is gravity
    x = starts(made, 3)
    found = impacts(made, x)
    assert found.found.all()
    np.testing.assert_allclose(gravity.surface_array(found.x[:3]), 0.0, rtol=0, atol=1e-12)
    jacobian = StepMap(system(made), stm=True).propagate(x, 60.0, 4)[1]
    assert np.isfinite(jacobian).all()


def test_harmonics_and_grid_are_met() -> None:
    rows = [[0, 0, 11.0, 0], [1, 0, 0.1, 0], [2, 0, -0.6, 0], [2, 2, 0.4, 0.1]]
    series = create("shape", "harmonics", coefficients=rows, length_unit="km")
    lat, lon = np.linspace(-90, 90, 91), np.arange(0, 360, 2.0)
    radii = series.radius_array(unit_vectors(lat, lon)).reshape(91, 180)
    radii[0], radii[-1] = radii[0].mean(), radii[-1].mean()
    grid = create("shape", "grid", radii=radii.tolist(), length_unit="m")
    ends = []
    for shape in (series, grid):
        made = plant(shape=shape)
        ends.append(impacts(made, starts(made)))
        distance = np.linalg.norm(ends[-1].x[:3], axis=0)
        np.testing.assert_allclose(distance, shape.radius_array(ends[-1].x[:3]), rtol=1e-12)
    np.testing.assert_allclose(ends[0].x[:3], ends[1].x[:3], rtol=0, atol=10.0)
    flight = Taylor(system(plant(shape=series)), events=["impact"]).fly(starts(plant()), 4000.0)
    np.testing.assert_allclose(flight.x[:3], ends[0].x[:3], rtol=0, atol=1e-3)


def test_the_taylor_propagator_refuses_what_it_cannot_watch() -> None:
    made = system(plant(shape=mesh_of(ellipsoid(), 1)))
    with pytest.raises(InputError, match="surface:level, a function of arrays"):
        Taylor(made, events=["impact"])
    with pytest.raises(InputError, match="use StepMap"):
        Taylor(made, record=["impact"])
    x = starts(plant())
    assert np.isfinite(Taylor(made).propagate(x, 100.0)).all()


@pytest.mark.parametrize("continuous", [False, True])
def test_flights_under_a_law_end_at_the_mesh(continuous: bool) -> None:
    """The simulator's events: with run-time parameters, and with states of a law beside."""
    shape = mesh_of(ellipsoid(), 2)
    made = plant(shape=shape)
    x = starts(made, 3)
    if continuous:
        law: Any = Coasting()
    else:
        zeros = [0.0, 0.0, 0.0]
        law = create(
            "compensator", "pid", period_s=60.0, proportional=zeros, integral=zeros,
            derivative=zeros,
        )  # fmt: skip
    cases = Cases(x, np.array([[1.0, 1.01, 0.99]]) * GM)
    flights = simulate(
        made, law, cases, 70, run_time=["gravity.gm"], reference=np.zeros(7), substeps=6
    )
    assert set(flights.cause) == {"impact"}
    np.testing.assert_allclose(shape.surface_array(flights.x[:3]), 0.0, rtol=0, atol=1e-11)


def test_the_brillouin_sphere_is_that_of_the_shape() -> None:
    """The farthest point of the shape, which lies on no axis, not its box."""
    rows = [[0, 0, 11.0, 0], [2, 2, 0.4, 0.3]]
    shape = create("shape", "harmonics", coefficients=rows, length_unit="km")
    field = create(
        "gravity", "harmonics", gm_m3_s2=GM, reference_radius_m=11.1e3, normalisation="full",
        tide_system="none", coefficients=[{"n": 2, "m": 0, "c": -0.05}],
    )  # fmt: skip
    made = plant(gravity=field, shape=shape)
    assert made.series_radius_m == pytest.approx(11e3 + np.sqrt(15 / 4) * 500.0, rel=1e-9)
    assert max(made.semi_axes_m) < made.series_radius_m - 100.0
    assert plant(gravity=field).series_radius_m == 11.1e3
    assert plant(gravity=field, semi_axes_m=AXES).series_radius_m == AXES[0]
