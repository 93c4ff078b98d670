"""Lanes with sub-steps of their own, on the circular Hill problem about a point mass."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere_orbits.flow import Flow, flow_of
from hillsphere_orbits.spatial_qso_families.shooting import SpatialShooting, ends, sub_steps

Z = np.array([[1.9, 1.8, 1.7], [0.5, 0.6, 0.7], [-3.9, -3.7, -3.5], [9.0, 12.0, 15.0]])


@pytest.fixture(scope="module")
def flow() -> Flow:
    body: Any = create(
        "body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0, name="phobos"
    )
    gravity = create("gravity", "point_mass", gm_km3_s2=7.06e-4)
    return flow_of(create("plant", "hill", body=body, gravity=gravity))


def test_a_lane_with_its_sub_steps_is_the_lane_alone(flow: Flow) -> None:
    """The phases in which lanes drop out only change rounding."""
    problem = SpatialShooting(flow, "position", np.array([120, 90, 200]))
    end, phi = problem.fly(problem.state(Z), Z[-1])
    for k, count in enumerate(problem.counts):
        alone = problem.of(np.array([k]))
        one, matrix = flow.with_matrix(alone.state(Z[:, [k]]), Z[-1, [k]], int(count))
        np.testing.assert_allclose(end[:, k], one[:, 0], rtol=0, atol=1e-11)
        size = np.abs(matrix).max()
        np.testing.assert_allclose(phi[:, :, k], matrix[:, :, 0], rtol=0, atol=1e-12 * size)
    np.testing.assert_allclose(ends(problem, Z, problem.counts), end, rtol=0, atol=1e-11)


def test_a_lane_that_leaves_the_domain_harms_no_other(flow: Flow) -> None:
    problem = SpatialShooting(flow, "position", np.array([60, 60, 80]))
    z = Z.copy()
    z[:3, 1] = np.nan
    values, slopes = problem.residual(np.where(np.isnan(z), 0.0, z))
    assert not np.isfinite(values[:, 1]).all()
    good = problem.of(np.array([0, 2]))
    alone, _ = good.residual(Z[:, [0, 2]])
    np.testing.assert_allclose(values[:, [0, 2]], alone, rtol=0, atol=1e-12)
    assert np.isfinite(slopes[:, :, [0, 2]]).all()


def test_sub_steps_meet_the_tolerance_lane_by_lane(flow: Flow) -> None:
    problem = SpatialShooting(flow, "position", np.full(3, 20))
    counts, found = sub_steps(problem, Z, 1e-9)
    assert found.all()
    assert counts[0] < counts[2]
    error = np.abs(ends(problem, Z, counts) - ends(problem, Z, 4 * counts)).max(axis=0)
    assert np.all(error <= 2e-9)


def test_sub_steps_of_an_orbit_that_cannot_be_computed(flow: Flow) -> None:
    problem = SpatialShooting(flow, "position", np.full(2, 20))
    z = Z[:, :2].copy()
    z[:3, 1] = 0.0
    _, found = sub_steps(problem, z, 1e-9)
    np.testing.assert_array_equal(found, [True, False])
