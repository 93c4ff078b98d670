"""A landing whose ground is a shape of its own: planned to a site on it, flown until contact."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hillsphere import create
from hillsphere.model.shapes.triangulation import triangulate
from hillsphere.testing import RecordingContext

GM = 7.087546066894452e5


def mesh() -> Any:
    """Return an ellipsoid of few facets: its ground is up to kilometres below the ellipsoid."""
    made = triangulate(create("shape", "ellipsoid", axes_m=(13030.0, 11400.0, 9140.0)), 2)
    return create(
        "shape", "polyhedron", vertices=made.vertices.tolist(), faces=(made.faces + 1).tolist(),
        length_unit="m",
    )  # fmt: skip


def bumps() -> Any:
    """Return a series of heights."""
    rows = [[0, 0, 11.0, 0], [2, 0, -0.6, 0], [2, 2, 0.4, 0.1], [3, 1, 0.1, -0.1]]
    return create("shape", "harmonics", coefficients=rows, length_unit="km")


@pytest.mark.parametrize("ground", [mesh, bumps])
def test_touchdown_is_on_the_shape(ground: Any) -> None:
    shape = ground()
    body = create(
        "body", "moon", name="phobos", primary_gm_m3_s2=4.282837362069909e13,
        semi_major_axis_km=9376.0, eccentricity=0.0151, shape=shape,
    )  # fmt: skip
    gravity = create("gravity", "point_mass", gm_m3_s2=GM)
    plant = create("plant", "three_body", body=body, gravity=gravity, orbit="elliptic")
    descent = {
        "name": "down",
        "start": {"position_km": [16.56, 0, 0], "others": {"true_anomaly": 0.0}},
        "site": {"latitude_deg": 12, "longitude_deg": 25},
        "touchdown_speed_m_s": 0.5,
        "duration_s": 5400,
    }
    planner = create("guidance", "minimum_energy")
    references = create(
        "stage", "reference_trajectories", plant=plant, guidance=planner, descents=[descent]
    ).run(RecordingContext())
    end = references.flights.x[:3, -1, 0]
    assert np.linalg.norm(end) == pytest.approx(shape.radius_array(end[:, None])[0], rel=1e-9)
    law = create("compensator", "open_loop", period_s=60.0)
    flight = create(
        "stage", "closed_loop", plant=plant, law=law, needs={"reference": "references"},
        substeps=6, success=["impact"], overtime_s=120.0, limits={"position_error_km": 5},
    )  # fmt: skip
    found = flight.run(RecordingContext(), reference=references)
    assert found.status == "impact"
    touched = found.end_x[:3]
    assert np.linalg.norm(touched) == pytest.approx(
        shape.radius_array(touched[:, None])[0], rel=1e-12
    )
    values = dict(zip(found.metrics, found.values.tolist(), strict=True))
    # Open loop and by another propagator: contact is as planned, but for a moment.
    assert abs(values["early"]) < 0.1
    assert values["final_speed"] == pytest.approx(0.5, rel=1e-3)
