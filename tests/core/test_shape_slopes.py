"""How steep a surface of harmonics is, against a dense look at it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.interfaces import Array

ROOT = Path(__file__).parents[2]
EROS = {"file": str(ROOT / "missions/data/eros-shape-degree8.tab"), "length_unit": "m"}
RIDGE = {"coefficients": [[0, 0, 1.0, 0.0], [7, 5, 0.02, -0.03]], "length_unit": "km"}


def differences(shape: Any, r: Array, step: float) -> Array:
    """Return the slopes (3, N) of the surface function at places r (3, N), by differences."""

    def value(at: Array) -> Array:
        return np.asarray(np.linalg.norm(at, axis=0) / shape.radius_array(at) - 1.0)

    moves = step * np.eye(3)[:, :, None]
    return np.array([(value(r + move) - value(r - move)) / (2.0 * step) for move in moves])


@pytest.mark.parametrize("table", [EROS, RIDGE], ids=["eros", "ridge"])
def test_no_place_is_steeper_and_some_nearly_as_steep(table: dict[str, Any]) -> None:
    shape = create("shape", "harmonics", **table)
    directions = np.random.default_rng(3).normal(size=(3, 200_000))
    directions /= np.linalg.norm(directions, axis=0)
    # On the surface; farther out the slope across the ray is smaller, along it the same.
    found = differences(shape, directions * shape.radius_array(directions), 0.01)
    steepest = float(np.linalg.norm(found, axis=0).max())
    assert steepest <= shape.steepest_per_m * (1.0 + 1e-5)
    assert shape.steepest_per_m < 1.5 * steepest
