"""Nominal orbits of a block of cases."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.interfaces.cases import CaseBatch
from hillsphere_tracking.assisted_tracking.nominal_orbits import NominalOrbits, nominal_orbits
from hillsphere_tracking.assisted_tracking.specs import NominalErrorSpec
from hillsphere_tracking.kepler import states_from_elements, wrap_angle
from hillsphere_tracking.mean_elements import EARTH_FIELD, secular_rates, states

ELEMENTS = np.array([7180e3, 0.0436, 0.4157, 4.19, 0.27, 6.12])
TRUE = states(ELEMENTS[:, None], np.zeros(1))[:, 0]
BATCH = CaseBatch(
    np.arange(64), 5 + np.arange(64), np.zeros(64, dtype=bool), (), np.zeros((0, 64)), 2, "s"
)


def made(keys: dict[str, Any], name: str = "A", batch: CaseBatch = BATCH) -> NominalOrbits:
    return nominal_orbits(NominalErrorSpec.model_validate(keys), batch, name, TRUE, EARTH_FIELD)


def off(orbits: NominalOrbits) -> Array:
    return states_from_elements(orbits.osculating, EARTH_FIELD.gm_m3_s2) - TRUE[:, None]


def test_without_errors_the_mean_elements_come_back() -> None:
    difference = made({}).mean - ELEMENTS[:, None]
    difference[2:] = wrap_angle(difference[2:])
    assert_allclose(difference[0], 0.0, rtol=0, atol=1e-5)
    assert_allclose(difference[1:], 0.0, rtol=0, atol=1e-11)


def test_signs_on_each_axis() -> None:
    error = off(made({"position_km": 3, "velocity_m_s": 2}))
    assert_allclose(np.abs(error[:3]), 3e3, rtol=1e-9)
    assert_allclose(np.abs(error[3:]), 2.0, rtol=1e-9)
    # all eight corners of both cubes appear among 64 cases, but for bad luck
    assert len({tuple(s) for s in np.sign(error[:3]).T}) == 8


def test_normal_errors_have_the_size_asked_for() -> None:
    error = off(made({"position_km": 3, "distribution": "normal"}))
    assert np.sqrt(np.mean(error[:3] ** 2)) == pytest.approx(3e3, rel=0.15)
    assert_allclose(error[3:], 0.0, rtol=0, atol=1e-7)


def test_age_moves_along_the_track_early_or_late() -> None:
    orbits = made({"along_track_age_s": 10})
    moved = wrap_angle(orbits.mean[5] - ELEMENTS[5])
    rate = secular_rates(ELEMENTS[:, None])[2, 0]
    assert_allclose(np.abs(moved), 10.0 * rate, rtol=1e-9)
    assert 10 < int((moved > 0.0).sum()) < 54
    assert_allclose(wrap_angle(orbits.mean[3] - ELEMENTS[3]), 0.0, rtol=0, atol=1e-11)


def test_mean_elements_are_drawn() -> None:
    keys = {"semi_major_axis_sigma_km": 5, "node_sigma_deg": 0.5, "mean_anomaly_sigma_deg": 2}
    error = made(keys).mean - ELEMENTS[:, None]
    sizes = np.sqrt(np.mean(np.array([error[0], *wrap_angle(error[[3, 5]])]) ** 2, axis=1))
    assert_allclose(sizes, [5e3, *np.radians([0.5, 2.0])], rtol=0.3)


def test_inputs_of_the_batch_replace_those_of_the_spec() -> None:
    sizes = np.linspace(0.0, 6e3, 64)
    batch = CaseBatch(
        BATCH.numbers, BATCH.draws, BATCH.filler, ("position_error",), sizes[None], 2, "s"
    )
    error = off(made({"position_km": 3}, batch=batch))
    assert_allclose(np.abs(error[0]), sizes, rtol=1e-9, atol=1e-6)


def test_passes_are_independent_and_repeatable() -> None:
    keys = {"position_km": 3}
    assert_array_equal(made(keys).mean, made(keys).mean)
    assert not np.array_equal(made(keys).mean, made(keys, "B").mean)


def test_too_large_an_error() -> None:
    with pytest.raises(InputError, match="nominal_error: pass A: a state is not on an ellipse"):
        made({"velocity_km_s": 9})
