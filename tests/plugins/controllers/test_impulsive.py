"""Impulsive feedback: dead band, maximum, and the loop in free space."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.errors import InputError
from hillsphere.plugins import default_registry, validate
from hillsphere.simulation import Cases, simulate
from hillsphere.testing import example
from hillsphere_controllers.impulsive import Impulsive
from hillsphere_controllers.specs import ImpulsiveSpec

GAIN = np.hstack([1e-3 * np.eye(3), np.eye(3)]).tolist()
KEYS: dict[str, Any] = {"period_s": 600, "gain": GAIN}


def law(**keys: Any) -> Impulsive:
    return Impulsive(ImpulsiveSpec.model_validate({**KEYS, **keys}))


def test_dead_band_and_maximum() -> None:
    compensator = law(dead_band_m_s=0.05, maximum_m_s=2.0)
    y = np.zeros((6, 4))
    y[3:5] = [[0.03, 0.6, 3.0, 0.0], [0.03, 0.8, 4.0, 0.0]]
    u, _ = compensator.step(0, np.zeros(4), y, np.zeros((6, 4)), compensator.initial(4))
    # Sizes 0.042, 1, 5 and 0: dropped, done, cut to 2, nothing to do.
    done = np.array([[0.0, 0.0, 0.0], [-0.6, -0.8, 0.0], [-1.2, -1.6, 0.0], [0.0, 0.0, 0.0]])
    assert_allclose(u.T, done, rtol=0, atol=1e-15)


def test_every_correction_is_the_gain_times_the_error() -> None:
    plant, target = example("plant", "hill"), np.array([30e3, 0.0, 0.0, 0.0, 0.0, 0.0])
    x0 = (target + np.array([100.0, 50.0, -80.0, 0.1, -15.0, 0.05]))[:, None]
    flights = simulate(
        plant, law(), Cases(x0), 5, reference=target, substeps=4, history=True
    )  # fmt: skip
    history = flights.history
    assert history is not None
    told = -np.array(GAIN) @ (history.x[:, :5, 0] - target[:, None])
    assert_allclose(history.u[:, :, 0], told, rtol=1e-13)
    assert_allclose(flights.dv_m_s[0], np.linalg.norm(told, axis=0).sum(), rtol=1e-13)


def test_within_the_dead_band_nothing_is_spent() -> None:
    plant = example("plant", "hill")
    x0 = np.array([[60e3], [0.0], [0.0], [0.0], [-28.0], [0.0]])
    idle = simulate(plant, law(dead_band_m_s=1e8), Cases(x0), 5, substeps=4)
    assert_array_equal(idle.dv_m_s, 0.0)
    assert_array_equal(idle.firings, 0)
    assert_array_equal(idle.samples, 5)


def test_another_number_of_rows_is_refused() -> None:
    with pytest.raises(InputError, match="gain has 6 columns; the law sees 3"):
        law().step(0, np.zeros(1), np.zeros((3, 1)), np.zeros((3, 1)), np.zeros((0, 1)))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"gain": [[1.0, 2.0], [1.0]]}, "rows of the same length"),
        ({"gain": [[]]}, "rows of the same length"),
        ({"dead_band_m_s": 1.0, "maximum_m_s": 0.5}, "below the dead band"),
        ({"period_s": -1}, "must be > 0"),
    ],
)
def test_bad_specs(keys: dict[str, Any], message: str) -> None:
    spec = default_registry().get("compensator", "impulsive").load_spec()
    with pytest.raises(InputError, match=message):
        validate(spec, {**KEYS, **keys}, where="here")
