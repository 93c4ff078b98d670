"""The stage ``linear_models``: models by formulas, files and signals, over their parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.products import save_product
from hillsphere.testing import RecordingContext, check_presentation, check_stage
from hillsphere_controllers.analysis.h2_norm import h2_norm
from hillsphere_controllers.linear_products import LinearModels
from hillsphere_controllers.stages.linear_models.presentation import present_linear_models
from hillsphere_controllers.stages.linear_models.specs import LinearModelsSpec
from hillsphere_controllers.stages.linear_models.stage import LinearModelsStage
from hillsphere_controllers.systems.exchange import save_mat

SPRING: dict[str, Any] = {
    "a": [[0, 0, 1, 0], [0, 0, 0, 1], ["-k/m", "k/m", 0, 0], ["k", "-k", 0, 0]],
    "b": [[0], [0], ["1/m"], [0]],
    "c": [[0, 1, 0, 0]],
    "inputs": ["u"],
    "outputs": ["y"],
}
MASS = {"name": "m", "nominal": 1.0, "unit": "kg"}
STIFFNESS = {"name": "k", "nominal": 1.25, "values": [0.5, 2.0], "unit": "N/m"}


def keys(**more: Any) -> dict[str, Any]:
    return {
        "parameters": [STIFFNESS, MASS],
        "systems": [SPRING],
        "inputs": [],
        "outputs": [],
        "controls": ["u"],
        "measurements": ["y"],
    } | more


def run(table: dict[str, Any]) -> LinearModels:
    spec = validate(LinearModelsSpec, table, where="stage")
    assert isinstance(spec, LinearModelsSpec)
    return LinearModelsStage(spec).run(RecordingContext())


def test_stage_keeps_its_contract() -> None:
    product = check_stage("linear_models")
    assert [weight.outputs for weight in product.weights] == [("z_error",), ("z_control",)]


def test_two_masses_have_the_frequency_of_their_physics() -> None:
    models = run(keys(parameters=[STIFFNESS, MASS | {"values": [1.0, 3.0]}]))
    assert models.labels == ("k=0.5, m=1", "k=0.5, m=3", "k=2, m=1", "k=2, m=3")
    assert models.units == ("N/m", "kg")
    assert_allclose(models.values, [[0.5, 0.5, 2.0, 2.0], [1.0, 3.0, 1.0, 3.0]], rtol=0.0)
    for system, k, m in zip(models.systems, *models.values, strict=True):
        fastest = float(np.abs(system.poles.imag).max())
        assert fastest == pytest.approx(np.sqrt(k * (1.0 + 1.0 / m)), rel=1e-9)


def test_a_list_takes_values_together() -> None:
    models = run(keys(parameters=[STIFFNESS, MASS | {"values": [1.0, 3.0]}], combine="list"))
    assert_allclose(models.values, [[0.5, 2.0], [1.0, 3.0]], rtol=0.0)


def test_one_name_stands_for_numbered_signals() -> None:
    column = {"d": [[1, 2], [3, 4]], "inputs": ["u"], "outputs": ["y"]}
    weight = {"numerator": [1], "denominator": [1, 1], "channels": 2, "inputs": ["e"],
              "outputs": ["z"]}  # fmt: skip
    models = run(
        keys(
            parameters=[], systems=[column, weight], junctions=["e = r - y"], inputs=["r"],
            outputs=["z"], measurements=["e"],
        )
    )  # fmt: skip
    assert models.systems[0].inputs == ("r[0]", "r[1]", "u[0]", "u[1]")
    assert (models.controls, models.measurements) == (2, 2)
    assert models.weights[0].inputs == ("e[0]", "e[1]")
    response = models.systems[0].response(np.zeros(1))[0]
    assert_allclose(response[2:], np.hstack([np.eye(2), [[-1, -2], [-3, -4]]]), rtol=1e-15)


def test_systems_come_from_files(tmp_path: Path) -> None:
    given = LtiSystem(np.array([[-2.0]]), np.array([[1.0]]), np.array([[3.0]]), np.zeros((1, 1)))
    save_mat(tmp_path / "p.mat", {"P": given, "other": np.eye(2)})
    np.savez(tmp_path / "p.npz", a=given.a, b=given.b, c=given.c, d=given.d)
    save_product(tmp_path / "stored.npz", given)
    for name in ("p.mat", "p.npz", "stored.npz"):
        system = {"file": str(tmp_path / name), "inputs": ["u"], "outputs": ["y"]}
        models = run(keys(parameters=[], systems=[system]))
        assert_allclose(models.systems[0].response(np.zeros(1)), [[[1.5]]], rtol=1e-15)


def test_weights_that_differ_are_not_shown_as_weights() -> None:
    weight = {"d": [["k"]], "inputs": ["y"], "outputs": ["z"]}
    models = run(keys(systems=[SPRING, weight], outputs=["z"]))
    assert models.weights == ()


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (keys(systems=[SPRING | {"c": [["stiff", 1, 0, 0]]}]), "no parameter 'stiff'"),
        (keys(systems=[SPRING | {"c": [["k +", 1, 0, 0]]}]), "no formula"),
        (keys(systems=[SPRING | {"b": [[0], [0]]}]), "b.*must be 4 × 1"),
        (keys(systems=[SPRING | {"numerator": [1], "denominator": [1, 1]}]), "just one of"),
        (keys(systems=[{"inputs": ["u"], "outputs": ["y"]}]), "none is"),
        (keys(measurements=[]), "given together"),
        (keys(parameters=[STIFFNESS, STIFFNESS]), "'k' is listed twice"),
        (keys(parameters=[STIFFNESS, MASS | {"name": "sqrt"}]), "means something"),
        (keys(outputs=["y", "y"]), "'y' is listed twice"),
        (keys(parameters=[STIFFNESS, MASS | {"values": [1, 2, 3]}], combine="list"), "as many"),
    ],
)
def test_faults_are_found_before_anything_runs(table: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        validate(LinearModelsSpec, table, where="stage")


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (keys(parameters=[STIFFNESS, MASS | {"nominal": 0.0}]), r"systems\[0\].*no value"),
        (keys(measurements=["position"]), "position"),
        (keys(systems=[{"file": "nothing.mat", "inputs": ["u"], "outputs": ["y"]}]),
         r"systems\[0\].*nothing\.mat"),
    ],
)  # fmt: skip
def test_faults_of_values_are_said_with_their_key(table: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        run(table)


def moving(stiffness: float) -> LtiSystem:
    """Return two independent oscillators with positions and velocities as outputs."""
    a = np.kron(np.array([[0.0, 1.0], [-stiffness, 0.0]]), np.eye(2))
    b = np.kron(np.array([[0.0], [1.0]]), np.eye(2))
    return LtiSystem(
        a, np.hstack([2.0 * b, b]), np.eye(4), np.zeros((4, 4)), None,
        ("d[0]", "d[1]", "a[0]", "a[1]"), ("r[0]", "r[1]", "v[0]", "v[1]"),
    )  # fmt: skip


GIVEN = LinearModels(
    (moving(1.0), moving(2.0), moving(3.0)), ("nominal, point 1", "k up", "nominal, point 2"),
    ("point", "field.own.k"), ("-", "N/m"), np.array([[1.0, 1.0, 2.0], [1.0, 2.0, 3.0]]),
    np.array([1.0, 1.0]), 2, 4, (),
)  # fmt: skip
LOOP: dict[str, Any] = {
    "needs": {"models": "given"},
    "systems": [
        {"model": True, "inputs": ["a"], "outputs": ["v", "r"]},
        {"low_pass": {"frequency_hz": 0.5, "order": 2}, "channels": 2, "inputs": ["r"],
         "outputs": ["r_hat"]},
        {"delay": {"time_s": 0.2}, "channels": 2, "inputs": ["u"], "outputs": ["a"]},
        {"d": [[0.5, 0], [0, 0.5]], "inputs": ["v"], "outputs": ["z"]},
    ],
    "inputs": [],
    "outputs": ["z"],
    "controls": ["u"],
    "measurements": ["r_hat"],
}  # fmt: skip


def run_on(given: LinearModels, table: dict[str, Any]) -> LinearModels:
    spec = validate(LinearModelsSpec, table, where="stage")
    assert isinstance(spec, LinearModelsSpec)
    stage = LinearModelsStage(spec)
    made = stage.run(RecordingContext(), models=given)
    check_presentation(stage.present(made, models=given))
    return made


def test_every_model_of_an_earlier_stage_is_connected() -> None:
    made = run_on(GIVEN, LOOP)
    assert made.labels == GIVEN.labels
    assert (made.parameters, made.units) == (GIVEN.parameters, GIVEN.units)
    assert_allclose(made.values, GIVEN.values, rtol=0.0)
    assert (made.controls, made.measurements) == (2, 2)
    assert [weight.outputs for weight in made.weights] == [("z[0]", "z[1]")]
    omega = np.array([0.3, 2.0])
    s = 1j * omega
    corner = 2.0 * np.pi * 0.5
    for system, k in zip(made.systems, (1.0, 2.0, 3.0), strict=True):
        late = (1 - 0.1 * s) / (1 + 0.1 * s) / (s * s + k)
        response = system.response(omega)
        assert_allclose(response[:, 0, 0], 0.5 * s * late, rtol=1e-12)
        assert_allclose(response[:, 3, 1], late * (corner / (s + corner)) ** 2, rtol=1e-12)


def test_some_models_are_taken_by_name_and_combined_with_formulas() -> None:
    weight = LOOP["systems"][-1] | {"d": [["w", 0], [0, "w"]]}
    table = LOOP | {
        "which": ["nominal*"],
        "systems": [*LOOP["systems"][:-1], weight],
        "parameters": [{"name": "w", "nominal": 1.0, "values": [1.0, 4.0]}],
    }
    made = run_on(GIVEN, table)
    assert made.labels == (
        "nominal, point 1, w=1", "nominal, point 2, w=1", "nominal, point 1, w=4",
        "nominal, point 2, w=4",
    )  # fmt: skip
    assert made.parameters == ("point", "field.own.k", "w")
    assert_allclose(
        made.values, [[1, 2, 1, 2], [1, 3, 1, 3], [1, 1, 4, 4]], rtol=0.0
    )  # fmt: skip


def test_models_are_discretised_for_inputs_that_are_held() -> None:
    table = LOOP | {
        "systems": [{"model": True, "inputs": ["a"], "outputs": ["r"]}],
        "outputs": [],
        "controls": ["a"],
        "measurements": ["r"],
        "period_s": 0.5,
    }
    made = run_on(GIVEN, table).systems[0]
    assert made.dt_s == 0.5
    pole = np.exp(0.5j)
    found = made.poles[np.argsort(made.poles.imag)]
    assert_allclose(found, [pole.conjugate()] * 2 + [pole] * 2, rtol=1e-12)
    with pytest.raises(InputError, match="low_pass is one in continuous time"):
        run_on(GIVEN, LOOP | {"period_s": 0.5})


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({k: v for k, v in LOOP.items() if k != "needs"}, "given together"),
        (keys(needs={"models": "given"}), "given together"),
        (keys(which=["nominal*"]), "which"),
        (LOOP | {"systems": [LOOP["systems"][0] | {"channels": 2}]}, "stands there once"),
    ],
)
def test_models_and_their_place_are_given_together(table: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        validate(LinearModelsSpec, table, where="stage")


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (LOOP | {"which": ["mean*"]}, "which.*no model 'mean"),
        (LOOP | {"systems": [{"model": True, "inputs": ["b"], "outputs": ["r"]}]},
         r"systems\[0\].inputs.*no signal 'b'"),
        (LOOP | {"parameters": [{"name": "point", "nominal": 1.0}]}, "'point' already"),
    ],
)  # fmt: skip
def test_faults_of_given_models_are_said(table: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        run_on(GIVEN, table)


def test_more_models_than_the_table_lists_are_drawn() -> None:
    many = 60
    count = np.arange(1.0, many + 1.0)
    product = LinearModels(
        tuple(moving(k) for k in count), tuple(f"model {k:g}" for k in count),
        ("point",), ("-",), count[None], np.array([1.0]), 2, 4, (),
    )  # fmt: skip
    made = present_linear_models(product)
    check_presentation(made)
    table = made.tables["linear_models"]
    assert len(table.rows) < many == table.total


def test_poles_on_the_border_are_not_counted_by_their_rounding() -> None:
    """Free masses: two poles at zero and a pair on the axis, none of them unstable."""
    table = present_linear_models(run(keys())).tables["linear_models"]
    assert [(row["unstable_poles"], row["border_poles"]) for row in table.rows] == 2 * [(0, 4)]


@pytest.mark.parametrize("period_s", [None, 60.0])
def test_coloured_noise_has_its_deviation_and_its_memory(period_s: float | None) -> None:
    """A first-order Gauss-Markov process: the H2 norm is the deviation, e-folding the time."""
    table = {
        "systems": [
            {"gauss_markov": {"deviation": 0.5, "correlation_time_min": 10}, "inputs": ["w"],
             "outputs": ["n"], "channels": 2},
        ],
        "inputs": ["w"], "outputs": ["n"],
    }  # fmt: skip
    more = {} if period_s is None else {"period_s": period_s}
    (system,) = run(table | more).systems
    assert system.shape == (2, 2)
    assert h2_norm(system) == pytest.approx(0.5 * np.sqrt(2.0), rel=1e-9)  # two of them
    rate = -1.0 / 600.0
    decay = system.poles.real if period_s is None else np.log(system.poles.real) / period_s
    assert_allclose(decay, rate, rtol=1e-9)
