"""``hillsphere mat``: systems of products in files for MATLAB."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from hillsphere.cli.endings import run
from hillsphere.lti import LtiSystem
from hillsphere.products.product_codec import save_product
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import real_parameter
from hillsphere_controllers.linear_products import UncertainModels
from hillsphere_controllers.stages.uncertain import uncertain_model
from hillsphere_controllers.systems.exchange import load_mat


def models() -> UncertainModels:
    """Two lags of an uncertain rate, each with a control and a measurement."""
    rate = real_parameter("rate", 0.5, 2.0)
    made = []
    for pole in (-1.0, -2.0):
        system = LtiSystem(
            np.array([[pole]]), np.array([[-1.0, 1.0]]), np.array([[1.0], [1.0]]),
            np.zeros((2, 2)), None, ("w", "u"), ("z", "y"),
        )  # fmt: skip
        made.append(uncertain_model(Lft(system, (rate,), (1,)), {"rate": "1/s"}))
    return UncertainModels(tuple(made), ("slow", "fast"), 1, 1)


def test_uncertain_models_become_m_and_blocks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    product = tmp_path / "uncertain.npz"
    save_product(product, models())
    assert run(["mat", str(product)]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "uncertain.mat")
    found = load_mat(tmp_path / "uncertain.mat")
    assert sorted(found) == ["models_1", "models_2"]
    second = found["models_2"]
    assert isinstance(second, tuple)
    system, structure = second
    assert_array_equal(system.a, [[-2.0]])
    assert [(block.kind, block.rows, block.name) for block in structure.blocks] == [
        ("real", 1, "rate")
    ]


def test_a_controller_alone(tmp_path: Path) -> None:
    product, out = tmp_path / "best-controller.npz", tmp_path / "k.mat"
    one = np.ones((1, 1))
    save_product(product, LtiSystem(-one, one, 2.0 * one, 0.0 * one, 0.1, ("y",), ("u",)))
    assert run(["mat", str(product), "--out", str(out)]) == 0
    system = load_mat(out)["system"]
    assert isinstance(system, LtiSystem)
    assert (system.dt_s, system.inputs, system.outputs) == (0.1, ("y",), ("u",))
    assert_array_equal(system.c, [[2.0]])


def test_what_cannot_be_written_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    product = tmp_path / "structure.npz"
    save_product(product, real_parameter("k", 0.0, 1.0))
    assert run(["mat", str(product)]) == 2
    assert "holds no linear system" in capsys.readouterr().err
    save_product(product, models())
    assert run(["mat", str(product), "--out", str(tmp_path / "none" / "k.mat")]) == 2
    assert "cannot be written" in capsys.readouterr().err
