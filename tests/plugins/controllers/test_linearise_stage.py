"""The stage ``linearise``: a plant along a trajectory, and the LFTs of what is uncertain there.

The descent is one to 12° north, 25° east of Phobos from rest in front of L1, planned by minimum
energy in the whole field.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere import create
from hillsphere.dynamics import Derivatives, StepMap, system
from hillsphere.errors import InputError, StageError
from hillsphere.interfaces import Array, Parameter, Scales, Variable
from hillsphere.lti import LtiSystem
from hillsphere.products import FlightSet, Trajectories
from hillsphere.symbolic import Expr, Params
from hillsphere.testing import (
    RecordingContext,
    check_presentation,
    check_product,
    example,
)
from hillsphere_controllers.linearisation import linearise_plant
from hillsphere_controllers.mu.robustness import mu_bounds_on_grid, performance_structure
from hillsphere_controllers.stages.lft.products import FittedModels
from hillsphere_controllers.stages.linearise.presentation import nominal_models, ranks
from hillsphere_controllers.stages.linearise.products import LinearisedFlight
from hillsphere_controllers.stages.uncertain import to_lft
from hillsphere_controllers.systems.algebra import lower_lft

FILE = "missions/data/phobos-gravity-degree4.gfc"


def normal(of: str, parameters: list[str], **keys: Any) -> Any:
    return create("dispersions", "normal", of=of, parameters=parameters, **keys)


FIELD = normal(
    "gravity.phobos", ["C2,1", "S2,1", "S2,2", "C3,*", "S3,*", "C4,*", "S4,*"], sigma_relative=1.0
)


@pytest.fixture(scope="module")
def plant() -> Any:
    body = create(
        "body", "moon", name="phobos", primary_gm_m3_s2=4.282837362069909e13,
        semi_major_axis_m=9376e3, eccentricity=0.0151, semi_axes_m=[13030, 11400, 9140],
    )  # fmt: skip
    gravity = create("gravity", "harmonics", file=FILE)
    return create("plant", "three_body", body=body, gravity=gravity, orbit="elliptic")


@pytest.fixture(scope="module")
def reference(plant: Any) -> FlightSet:
    descent = {
        "name": "rt1",
        "start": {"position_km": [16.56, 0, 0], "others": {"true_anomaly": 0.0}},
        "site": {"latitude_deg": 12, "longitude_deg": 25},
        "touchdown_speed_m_s": 0.5,
        "duration_s": 7980,
    }
    guidance = create("guidance", "minimum_energy")
    stage = create(
        "stage", "reference_trajectories", plant=plant, guidance=guidance, descents=[descent]
    )
    made = stage.run(RecordingContext())
    assert isinstance(made, FlightSet)
    return made


def run(plant: Any, reference: FlightSet, **keys: Any) -> LinearisedFlight:
    stage = create("stage", "linearise", plant=plant, needs={"reference": "descents"}, **keys)
    made = stage.run(RecordingContext(), reference=reference)
    check_presentation(stage.present(made, reference=reference))
    assert isinstance(made, LinearisedFlight)
    return made


@pytest.fixture(scope="module")
def models(plant: Any, reference: FlightSet) -> LinearisedFlight:
    made = run(plant, reference, dispersions=[FIELD])
    check_product(made)
    return made


def test_derivatives_are_those_of_the_plant_at_the_point(
    plant: Any, models: LinearisedFlight
) -> None:
    assert_allclose(models.t_s, np.arange(1, 11) * 798.0, rtol=1e-15)
    k = models.labels.index("nominal, point 8")
    anomaly = float(plant.true_anomaly_after(0.0, np.array([6384.0]))[0])
    there = linearise_plant(
        plant, models.x[:3, 7].tolist(), models.x[3:, 7].tolist(), {"true_anomaly": anomaly}
    )
    system_8 = models.systems[k]
    assert_allclose(system_8.a, there.a, rtol=1e-8, atol=1e-20)
    assert system_8.inputs == ("d[0]", "d[1]", "d[2]", "a[0]", "a[1]", "a[2]")
    assert system_8.outputs == ("r[0]", "r[1]", "r[2]", "v[0]", "v[1]", "v[2]")
    assert_allclose(system_8.b[:, 3:], there.b, rtol=0.0, atol=0.0)
    assert_allclose(system_8.c, np.eye(6), rtol=0.0)
    assert (models.controls, models.measurements) == (3, 6)


def test_one_real_pole_is_unstable_all_along(models: LinearisedFlight) -> None:
    growth = []
    for k in nominal_models(models):
        poles = models.systems[int(k)].poles
        unstable = poles[poles.real > 1e-9]
        assert unstable.size == 1
        assert abs(unstable[0].imag) < 1e-12
        growth.append(1.0 / float(unstable[0].real))
    assert_allclose([growth[0], growth[-1]], [1543.0, 1066.0], rtol=1e-3)
    assert growth.index(min(growth)) == 9


def test_models_stand_at_nominal_bounds_and_opposite_corners(
    plant: Any, models: LinearisedFlight
) -> None:
    assert models.parameters[0] == "point"
    assert len(models.dispersed) == 19
    assert models.dispersed[:2] == ("gravity.phobos.C2,1", "gravity.phobos.S2,1")
    nominal = {q.name.removeprefix("gravity."): q.value for q in plant.parameters()}
    assert_allclose(models.sigma, [abs(nominal[name.rpartition(".")[2]])
                                   for name in models.dispersed], rtol=1e-12)  # fmt: skip
    assert models.affine.all()
    # affine parameters need one bound each: 1 + 19 + a pair of corners, at ten points
    assert len(models.systems) == 10 * (1 + 19 + 2)
    assert models.point.tolist() == [i for i in range(1, 11) for _ in range(22)]
    away = (models.values[1:] - models.nominal[1:, None]) / models.sigma[:, None]
    assert_allclose(np.abs(away[:, -2:]), 3.0, rtol=1e-12)
    assert_allclose(away[:, -1], -away[:, -2], rtol=1e-12)
    assert_allclose(away[:, 1:20], 3.0 * np.eye(19), rtol=0.0, atol=1e-12)


def test_unknown_acceleration_has_the_size_of_its_parameters(
    plant: Any, reference: FlightSet, models: LinearisedFlight
) -> None:
    size = 1e3 * np.sqrt(np.trace(models.acceleration_covariance))
    assert_allclose([size[0], size[-1]], [0.0831, 0.418], rtol=2e-3)
    # by differences of the rates: the sum of the squares of what each coefficient does
    names = tuple(f"gravity.{name.rpartition('.')[2]}" for name in models.dispersed)
    slopes = Derivatives(system(plant, run_time=names))
    anomaly = plant.true_anomaly_after(0.0, models.t_s[-1:])
    x = np.concatenate([models.x[:, -1:], anomaly[None]])
    p = np.repeat(models.nominal[1:, None], 19, axis=1) + np.diag(models.sigma)
    nominal = slopes.rate(x, models.nominal[1:, None])
    change = (slopes.rate(np.repeat(x, 19, axis=1), p) - nominal)[3:6]
    assert_allclose(models.acceleration_covariance[:, :, -1], change @ change.T, rtol=1e-6)
    # the disturbance's channel is its root
    root = models.systems[models.labels.index("nominal, point 10")].b[3:, :3]
    assert_allclose(root @ root.T, models.acceleration_covariance[:, :, -1], rtol=1e-9)
    # an error of the command comes on top
    more = run(plant, reference, dispersions=[FIELD], command_error=0.05, corners=0)
    extra = more.acceleration_covariance - models.acceleration_covariance
    expected = np.array([np.diag((0.05 * u) ** 2) for u in more.u.T]).transpose(1, 2, 0)
    assert_allclose(extra, expected, rtol=1e-9, atol=1e-20)


def test_influence_by_three_criteria(
    plant: Any, reference: FlightSet, models: LinearisedFlight
) -> None:
    short = [name.rpartition(".")[2] for name in models.dispersed]
    by_weight = [short[k] for k in np.argsort(-models.fit_weight)]
    assert by_weight[:3] == ["S3,3", "C4,0", "C3,2"]
    assert float(models.fit_weight.sum()) == pytest.approx(1.0, rel=1e-12)
    assert short[int(np.argmax(models.jacobian_share.max(axis=1)))] == "S3,3"
    assert ranks(np.array([1.0, 3.0, np.nan, 2.0])).tolist() == [4, 2, 1, 3]
    # the end of a flight with one coefficient off, by another formula
    flights, k = reference.flights, short.index("S2,1")
    step = StepMap(system(plant, run_time=["gravity.S2,1"], controls=True), "dop853")
    ends = []
    for value in models.nominal[1 + k] + np.array([0.0, 1.0]) * models.sigma[k]:
        x = flights.x[:, 0, 0]
        for i, u in enumerate(np.asarray(flights.u)[:, :-1, 0].T):
            h = float(flights.t_s[i + 1, 0] - flights.t_s[i, 0])
            x = step.propagate(x[:, None], h, 1, np.array([value, *u]))[:, 0]
        ends.append(x[:3])
    off = float(np.linalg.norm(ends[1] - ends[0]))
    assert models.end_deviation_m[k] == pytest.approx(off, rel=1e-6)


def test_without_dispersions_models_are_nominal(plant: Any, reference: FlightSet) -> None:
    made = run(plant, reference, times_s=[0.0, 100.0, 7980.0])
    assert made.labels == ("nominal, point 1", "nominal, point 2", "nominal, point 3")
    assert made.parameters == ("point",)
    assert made.systems[0].inputs == ("a[0]", "a[1]", "a[2]")
    assert_allclose(made.x[:, 0], reference.flights.x[:6, 0, 0], rtol=0.0)


def test_parameters_that_are_not_affine_are_seen_and_sampled_at_both_bounds(
    plant: Any, reference: FlightSet
) -> None:
    orbit = normal("plant.moving", ["semi_major_axis"], sigma=1e5)
    field = normal("gravity.phobos", ["S2,1"], sigma_relative=1.0)
    made = run(plant, reference, points=1, dispersions=[orbit, field], corners=0)
    assert made.affine.tolist() == [False, True]
    assert [label.rpartition(",")[0] for label in made.labels] == [
        "nominal", "plant.moving.semi_major_axis up", "gravity.phobos.S2,1 up",
        "plant.moving.semi_major_axis down",
    ]  # fmt: skip


@pytest.fixture(scope="module")
def uncertain(models: LinearisedFlight) -> dict[float, FittedModels]:
    made = {}
    for truncation in (0.0, 0.05):
        stage = create(
            "stage", "lft", needs={"models": "linear"}, known=["point"], dispersions=[FIELD],
            sigmas=3, fit="affine", truncation=truncation, truncation_of="nominal",
            compare_sigmas=[2, 3],
        )  # fmt: skip
        made[truncation] = stage.run(RecordingContext(), models=models)
        check_presentation(stage.present(made[truncation], models=models))
    return made


def test_untruncated_lft_is_the_jacobian_at_corners(
    plant: Any, models: LinearisedFlight, uncertain: dict[float, FittedModels]
) -> None:
    """At 200 random corners of 3 σ of the 19 coefficients, against the plant's own derivatives."""
    own = tuple(f"gravity.{name.rpartition('.')[2]}" for name in models.dispersed)
    derivatives = Derivatives(system(plant, run_time=own))
    signs = np.random.default_rng(7).choice([-3.0, 3.0], (19, 200))
    values = models.nominal[1:, None] + signs * models.sigma[:, None]
    for point in (1, 8, 10):
        model = uncertain[0.0].models[point - 1]
        assert int(model.times.sum()) == 57  # three directions of each coefficient
        named = dict(zip(models.dispersed, values, strict=True))
        found = to_lft(model).matrices(named)[0]
        anomaly = np.array([_anomaly(plant, models, point)])
        x = np.concatenate([models.x[:, point - 1], anomaly])[:, None]
        expected = derivatives.both(np.repeat(x, 200, axis=1), values)[1][:6, :6]
        size = np.abs(expected[3:, :3]).max()
        assert_allclose(found[:, 3:, :3], np.moveaxis(expected[3:, :3], 2, 0), rtol=0.0,
                        atol=1e-12 * float(size))  # fmt: skip


def _anomaly(plant: Any, models: LinearisedFlight, point: int) -> float:
    """Return the true anomaly that the stage took: in a line between the trajectory's times."""
    t = models.t_s[point - 1]
    low = 10.0 * np.floor(t / 10.0)
    ends: Array = plant.true_anomaly_after(0.0, np.array([low, low + 10.0]))
    return float(np.interp(t, [low, low + 10.0], ends))


def test_sizes_grow_towards_touchdown_and_with_the_bounds(
    uncertain: dict[float, FittedModels],
) -> None:
    made = uncertain[0.05]
    assert made.sizes.tolist() == [
        [5, 5, 5, 5, 7, 10, 14, 19, 22, 24],
        [10, 10, 10, 11, 13, 15, 20, 23, 27, 29],
    ]
    assert made.after.sum(axis=1).tolist() == made.sizes[1].tolist()
    assert (made.dropped <= 0.05).all()
    assert (made.dropped > 0.04).all()


def test_gravity_breaks_exact_cancellation_and_not_integral_action(
    models: LinearisedFlight,
) -> None:
    """At low frequency, where errors are to stay below 1e-3, near 3 σ of the field.

    A nominal design may meet that by feeding the acceleration of the commanded place forward; then
    the loop's stiffness alone stands against what is not known of the gravity's gradient.
    """
    plants = create(
        "stage", "linear_models", needs={"models": "linear"},
        systems=[
            {"model": True, "inputs": ["a"], "outputs": ["r", "v"]},
            {"numerator": [0.5, 0.005], "denominator": [1, 5e-6], "channels": 3, "inputs": ["e"],
             "outputs": ["z_error"]},
        ],
        junctions=["e = r_cmd - r"], inputs=["r_cmd"], outputs=["z_error"], controls=["a"],
        measurements=["r_cmd", "r", "v"],
    ).run(RecordingContext(), models=models)  # fmt: skip
    uncertain = create(
        "stage", "lft", needs={"models": "plants"}, known=["point"], dispersions=[FIELD],
        sigmas=3, fit="affine", truncation=0.05,
    ).run(RecordingContext(), models=plants)  # fmt: skip
    model, stiffness, damping = uncertain.models[7], 1.5e-4 * np.eye(3), 1.7e-2 * np.eye(3)
    gradient = models.systems[models.labels.index("nominal, point 8")].a[3:, :3]
    none = np.zeros((3, 3))
    forward = LtiSystem(
        -0.01 * np.eye(3), np.hstack([0.01 * np.eye(3), none, none]), stiffness - gradient,
        np.hstack([none, -stiffness, -damping]),
    )  # fmt: skip
    integral = LtiSystem(
        -5e-7 * np.eye(3), np.hstack([np.eye(3), -np.eye(3), none]), 3e-7 * np.eye(3),
        np.hstack([none, -stiffness, -damping]),
    )  # fmt: skip
    structure = to_lft(model).structure
    found = {}
    for name, controller in (("forward", forward), ("integral", integral)):
        loop = lower_lft(model.system, controller)
        assert loop.is_stable
        whole = performance_structure(loop, structure)
        omega = np.array([1e-7])
        nominal = to_lft(replace(model, system=loop)).nominal.response(omega)[0]
        bounds = mu_bounds_on_grid(loop, whole, omega)
        found[name] = (float(np.linalg.norm(nominal, 2)), *(float(one[0]) for one in bounds))
    assert found["forward"][0] < 0.03
    assert found["forward"][1] > 1.9  # a field within 3 σ breaks it
    assert found["integral"][0] < 0.3
    assert found["integral"][2] < 1.15 * found["integral"][0]  # and none breaks this


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"times_s": [1.0, 9000.0]}, "9000 s is beyond"),
        ({"follow": "rt7"}, "rt7"),
        ({"dispersions": [normal("stage.flight", ["state.x"], sigma=1.0)]}, "takes no parameter"),
        ({"dispersions": [normal("gravity.phobos", ["C9,9"], sigma=1.0)]}, "C9,9"),
        ({"dispersions": [FIELD, FIELD]}, "two of them vary"),
    ],
)
def test_faults_are_said(plant: Any, reference: FlightSet, keys: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        run(plant, reference, **keys)


def test_a_trajectory_of_another_frame_is_refused(reference: FlightSet) -> None:
    with pytest.raises(StageError, match="frame"):
        run(example("plant", "hill"), reference)


class Spring:
    """ẍ = −(k² + t/100 s) x + aₓ, ÿ = −k y + a_y, its velocities between its positions."""

    frame = "hill:toy"
    states = (
        Variable("x", 1, 0), Variable("vx", 1, -1), Variable("y", 1, 0), Variable("vy", 1, -1),
    )  # fmt: skip
    controls = (Variable("ax", 1, -2), Variable("ay", 1, -2))
    scales = Scales(1.0, 1.0)

    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter("k", 2.0),)

    def derivative(
        self, x: tuple[Expr, ...], u: tuple[Expr, ...], t: Expr, p: Params
    ) -> tuple[Expr, ...]:
        k = p["k"]
        return x[1], u[0] - (k * k + 0.01 * t) * x[0], x[3], u[1] - k * x[2]

    def events(self, x: tuple[Expr, ...], t: Expr, p: Params) -> dict[str, Expr]:
        return {}


def test_any_plant_its_order_its_time_and_parameters_that_bend() -> None:
    t = np.linspace(0.0, 10.0, 11)
    x = np.array([np.sin(t), np.cos(t), 2.0 * t, np.full(11, 2.0)])[:, :, None]
    flights = Trajectories("hill:toy", ("x", "vx", "y", "vy"), ("p",), ("way",), t[:, None], x)
    stiffness = normal("plant.toy", ["k"], sigma=0.1)
    made = run(
        Spring(),
        FlightSet(flights),
        points=2,
        start_time_s=100.0,
        dispersions=[stiffness],
        sigmas=2,
    )
    assert made.labels[:4] == (
        "nominal, point 1", "plant.toy.k up, point 1", "plant.toy.k down, point 1",
        "corner 1, point 1",
    )  # fmt: skip
    assert made.affine.tolist() == [False]
    for i, (time, model) in enumerate(zip((105.0, 110.0), (made.systems[0], made.systems[5]),
                                          strict=True)):  # fmt: skip
        expected = np.zeros((4, 4))
        expected[0, 1] = expected[2, 3] = 1.0
        expected[1, 0], expected[3, 2] = -(4.0 + 0.01 * time), -2.0
        assert_allclose(model.a, expected, rtol=1e-14)
        # r, then v, whatever the plant's order
        assert_allclose(model.c, np.eye(4)[[0, 2, 1, 3]], rtol=0.0)
        # ∂a/∂k = (−2 k x, −y)
        slope = np.array([-4.0 * x[0, 5 + 5 * i, 0], -x[2, 5 + 5 * i, 0]])
        assert_allclose(made.acceleration_slopes[:, 0, i], slope, rtol=1e-13)
        assert_allclose(
            made.acceleration_covariance[:, :, i], 0.01 * np.outer(slope, slope), rtol=1e-13
        )
    # a polynomial of second degree meets all of them
    stage = create("stage", "lft", needs={"models": "linear"}, known=["point"], degree=2,
                   dispersions=[stiffness], sigmas=2)  # fmt: skip
    uncertain = stage.run(RecordingContext(), models=made)
    at = to_lft(uncertain.models[0]).at({"plant.toy.k": 2.15})
    assert at.a[1, 0] == pytest.approx(-(2.15**2 + 1.05), rel=1e-12)
    with pytest.raises(InputError, match="not affine"):
        create("stage", "lft", needs={"models": "linear"}, known=["point"], fit="affine").run(
            RecordingContext(), models=made
        )


def test_gravity_of_arrays_has_no_derivatives_by_parameters() -> None:
    """A polyhedron is linearised at its nominal density; dispersing it is refused with a remedy."""
    corners = [[a, b, c] for a in (-1e4, 1e4) for b in (-1e4, 1e4) for c in (-1e4, 1e4)]
    faces = [[1, 2, 4], [1, 4, 3], [5, 7, 8], [5, 8, 6], [1, 5, 6], [1, 6, 2],
             [3, 4, 8], [3, 8, 7], [1, 3, 7], [1, 7, 5], [2, 6, 8], [2, 8, 4]]  # fmt: skip
    shape = create("shape", "polyhedron", vertices=corners, faces=faces, length_unit="m")
    gravity = create("gravity", "polyhedron", shape=shape, density_g_cm3=1.86)
    body = create(
        "body", "moon", name="phobos", primary_gm_m3_s2=4.282837362069909e13,
        semi_major_axis_m=9376e3,
    )  # fmt: skip
    cube = create("plant", "three_body", body=body, gravity=gravity, orbit="elliptic")
    x = np.zeros((7, 2))
    x[0], x[1, 1], x[4] = 25e3, 10.0, 0.1
    flights = FlightSet(
        Trajectories(
            frame=cube.frame, states=tuple(v.name for v in cube.states), plans=("a",),
            labels=("a",), t_s=np.array([[0.0], [100.0]]), x=x[:, :, None],
        )
    )  # fmt: skip
    assert run(cube, flights, points=1).labels == ("nominal, point 1",)
    density = normal("gravity.phobos", ["density"], sigma_relative=0.1)
    with pytest.raises(InputError, match=r"gravity\.density .*function of arrays.*leave disp"):
        run(cube, flights, points=1, dispersions=[density])
