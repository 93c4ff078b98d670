from __future__ import annotations

import numpy as np

from hillsphere.gravity import GravityField
from hillsphere_gravity.point_mass import PointMass
from hillsphere_gravity.specs import PointMassSpec


def test_closed_form() -> None:
    model = PointMass(PointMassSpec(gm_m3_s2=5.0))
    r = np.random.default_rng(0).normal(size=(3, 40))
    distance = np.linalg.norm(r, axis=0)
    field = GravityField(model)
    np.testing.assert_allclose(field.potential(r), 5.0 / distance, rtol=2e-15)
    np.testing.assert_allclose(field.acceleration(r), -5.0 * r / distance**3, rtol=3e-15)
    expected = 5.0 * (
        3.0 * r[:, None] * r[None, :] / distance**5 - np.eye(3)[..., None] / distance**3
    )
    size = np.abs(expected).max(axis=(0, 1))
    assert np.max(np.abs(field.gradient(r) - expected) / size) <= 6e-15
    assert model.gm_m3_s2 == 5.0


def test_gm_at_run_time() -> None:
    field = GravityField(PointMass(PointMassSpec(gm_m3_s2=5.0)), ["gm"])
    r = np.array([[2.0, 2.0], [0.0, 0.0], [0.0, 0.0]])
    np.testing.assert_allclose(field.potential(r, [[7.0, 9.0]]), [3.5, 4.5], rtol=1e-15)
