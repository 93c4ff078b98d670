"""What the tests of orbits share: one plant, whose flow is compiled once."""

from __future__ import annotations

from typing import Any

import pytest

from hillsphere import create


@pytest.fixture(scope="session")
def plant() -> Any:
    """Hill's problem about Phobos, an ellipsoid: the Phobos QSO bifurcation paper, section 2."""
    body = create(
        "body", "moon", name="phobos", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0
    )
    gravity = create(
        "gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], gm_km3_s2=7.059650784871513e-4
    )
    return create("plant", "hill", body=body, gravity=gravity)
