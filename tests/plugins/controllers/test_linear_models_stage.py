"""The stage ``linear_models``: models by formulas, files and signals, over their parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.linear_products import LinearModels
from hillsphere.lti import LtiSystem
from hillsphere.plugins import validate
from hillsphere.products import save_product
from hillsphere.testing import RecordingContext, check_stage
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
        (keys(parameters=[STIFFNESS, STIFFNESS]), "'k' stands twice"),
        (keys(parameters=[STIFFNESS, MASS | {"name": "sqrt"}]), "means something"),
        (keys(outputs=["y", "y"]), "'y' stands twice"),
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
