"""The stage ``equilibria``: L1 and L2 of Phobos, on a circle and on its ellipse."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere import create
from hillsphere.dynamics import Derivatives, system
from hillsphere.errors import InputError
from hillsphere.testing import RecordingContext, check_presentation, check_product

DATA = Path(__file__).parents[3] / "missions" / "data"
GM = 7.087546066894452e5


def phobos(eccentricity: float = 0.0, *, series: bool = False, **keys: Any) -> Any:
    body = create(
        "body", "moon", name="phobos", primary_gm_m3_s2=4.282837362069909e13,
        semi_major_axis_km=9376.0, eccentricity=eccentricity, semi_axes_km=(13.03, 11.40, 9.14),
    )  # fmt: skip
    gravity = (
        create("gravity", "harmonics", file=str(DATA / "phobos-gravity-degree4.gfc"))
        if series
        else create("gravity", "point_mass", gm_m3_s2=GM)
    )
    return create("plant", "three_body", body=body, gravity=gravity, **keys)


def run(plant: Any, **keys: Any) -> Any:
    stage = create("stage", "equilibria", plant=plant, **keys)
    product = stage.run(RecordingContext())
    check_product(product)
    check_presentation(stage.present(product))
    return product


def at_rest(plant: Any, position: Any, anomaly: float) -> Any:
    x = np.zeros((7, 1))
    x[:3, 0], x[6] = position, anomaly
    return Derivatives(system(plant)).rate(x)[3:6, 0]


def test_points_of_a_point_mass_on_a_circle() -> None:
    found = run(phobos(orbit="elliptic"))  # longitude 0, +x, is under Mars
    assert found.names == ("L1", "L2", "L3", "L4", "L5")
    assert_allclose(found.position_m[:, 0], [16556.782282598, 0.0, 0.0], rtol=1e-11, atol=1e-6)
    assert_allclose(found.position_m[:, 1], [-16576.296666281, 0.0, 0.0], rtol=1e-11, atol=1e-6)
    assert_allclose(found.height_m[0], 16556.782282598 - 13030.0, rtol=1e-9)  # above the tip
    # Hill's problem: λ² = n²(1 ± 2√7) and −4n² out of the plane, to the mass ratio's cube root.
    n = 2.279498952224136e-4
    values = found.eigenvalues_1_s[:, 1]
    assert_allclose(values[0].real, n * np.sqrt(1.0 + 2.0 * np.sqrt(7.0)), rtol=5e-3)
    wanted = n * np.array([np.sqrt(2.0 * np.sqrt(7.0) - 1.0), 2.0])
    assert_allclose(np.sort(np.unique(np.abs(values.imag)))[-2:], np.sort(wanted), rtol=5e-3)


def test_gravity_moves_them_out_and_the_ellipse_with_the_anomaly() -> None:
    plant = phobos(0.0151, series=True, orbit="elliptic")
    found = run(plant, true_anomalies_deg=[0, 90, 180])
    assert found.names == ("L1", "L2") * 3
    assert_allclose(np.degrees(found.true_anomaly_rad), [0, 0, 90, 90, 180, 180], rtol=1e-12)
    for name, position, anomaly in zip(
        found.names, found.position_m.T, found.true_anomaly_rad, strict=True
    ):
        rate = at_rest(plant, position, anomaly)
        if anomaly != found.true_anomaly_rad[2]:
            assert_allclose(rate, 0.0, rtol=0, atol=1e-15)
        # at 90 deg the angular acceleration is not zero: it is part of what is balanced
        assert np.linalg.norm(rate) < 1e-12
        assert np.sign(position[0]) == (1 if name == "L1" else -1)
    circle = run(phobos(series=True, orbit="elliptic"))
    moved = np.linalg.norm(circle.position_m[:, :2], axis=0) - [16556.78, 16576.30]
    assert ((moved > 600.0) & (moved < 800.0)).all()
    distance = np.linalg.norm(found.position_m[:, ::2], axis=0)
    assert distance[0] < distance[1] < distance[2]  # farther from Mars at apoapsis


def test_what_has_no_equilibrium_is_said_before_anything_runs() -> None:
    for plant, keys, said in (
        (phobos(0.0151, orbit="elliptic"), {}, r"vary along the orbit.*one true anomaly"),
        (phobos(), {"true_anomalies_deg": [0]}, "seventh and last state"),
    ):
        with pytest.raises(InputError, match=said):
            create("stage", "equilibria", plant=plant, **keys)


def test_each_anomaly_has_metrics_of_its_own() -> None:
    """Angles are taken within a turn; the number in a metric is that of the anomaly."""
    plant = phobos(0.0151, orbit="elliptic")
    stage = create("stage", "equilibria", plant=plant, true_anomalies_deg=[400, -30])
    found = stage.run(RecordingContext())
    assert_allclose(np.degrees(found.true_anomaly_rad), [40, 40, 330, 330], rtol=1e-12)
    shown = stage.present(found)
    distances = np.linalg.norm(found.position_m, axis=0)
    assert {name: metric.value for name, metric in shown.metrics.items()} == {
        "l1_distance_1": distances[0], "l2_distance_1": distances[1],
        "l1_distance_2": distances[2], "l2_distance_2": distances[3],
    }  # fmt: skip


def test_all_three_oscillations_about_the_triangular_points_are_shown() -> None:
    plant = phobos()
    stage = create("stage", "equilibria", plant=plant)
    found = stage.run(RecordingContext())
    row = stage.present(found).tables["equilibrium_points"].rows[3]
    values = found.eigenvalues_1_s[:, 3]
    wanted = sorted((2.0 * np.pi / values.imag[values.imag > 1e-12]).tolist(), reverse=True)
    periods: Any = [row[f"period_{k}_s"] for k in (1, 2, 3)]
    assert row["point"] == "L4"
    assert len(wanted) == 3
    assert_allclose(periods, wanted, rtol=1e-12)
