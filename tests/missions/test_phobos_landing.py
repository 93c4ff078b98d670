"""The mission ``phobos-landing``, its fast profile: from the field's uncertainty to flights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from hillsphere.products import ControlDesign, load_product
from hillsphere_controllers.stages.linearise.products import LinearisedFlight
from hillsphere_guidance.reference_trajectories.products import ReferenceTrajectories

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.missions.conftest import Run


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, mission_run: Callable[..., Run]) -> Run:
    out = tmp_path_factory.mktemp("missions") / "phobos-landing"
    return mission_run(out, "phobos-landing", "--profile", "fast", "--no-cache")


def rows(run: Run, table: str, key: str) -> dict[Any, dict[str, Any]]:
    return {row[key]: row for row in run.rows(table)}


def value(run: Run, metric: str) -> float:
    return float(run.summary["metrics"][metric]["value"])


def test_references_end_on_the_ellipsoid_at_the_sites(run: Run) -> None:
    """Sites 12° N 25° E, 15° S 15° E, 11° S 165° W; 0.5 m/s along the inward normal."""
    made = load_product(run.directory / "references.npz")
    assert isinstance(made, ReferenceTrajectories)
    axes = np.array([13030.0, 11400.0, 9140.0])
    sites = {"rt1": (12, 25), "rt2": (-15, 15), "rt3": (-11, -165)}
    for k, label in enumerate(made.flights.labels):
        latitude, longitude = np.radians(sites[label])
        end = made.flights.x[:, -1, k]
        place = end[:3] / np.linalg.norm(end[:3])
        aim = [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
        np.testing.assert_allclose(place, aim, rtol=0, atol=1e-12)
        assert np.sum((end[:3] / axes) ** 2) == pytest.approx(1.0, abs=1e-12)
        normal = end[:3] / axes**2
        np.testing.assert_allclose(
            end[3:6], -0.5 * normal / np.linalg.norm(normal), rtol=0, atol=1e-12
        )


def test_cost_of_the_references(run: Run) -> None:
    """Computed once by other code: B-spline, Gauss quadrature, SciPy's least squares."""
    found = rows(run, "reference_trajectories", "descent")
    for name, cost in (("rt1", 8.0545), ("rt2", 8.1921), ("rt3", 7.8444)):
        assert found[name]["dv_m_s"] == pytest.approx(cost, abs=1e-3)
        assert found[name]["replay_m"] < 1e-3
    fuel = rows(run, "reference_trajectories_fuel", "descent")["rt1"]["dv_m_s"]
    assert fuel < 0.8 * found["rt1"]["dv_m_s"]


def test_one_unstable_pole_and_an_unknown_acceleration_that_grows(run: Run) -> None:
    made = load_product(run.directory / "linear.npz")
    assert isinstance(made, LinearisedFlight)
    assert made.affine.all()
    poles = [row["unstable_poles"] for row in run.rows("linearised_points")]
    assert poles == [1, 1]
    sigma = np.sqrt(np.trace(made.acceleration_covariance, axis1=0, axis2=1))
    assert sigma[1] > 3.0 * sigma[0]


def test_sizes_of_the_truncated_field(run: Run) -> None:
    """Copies at T/2 and T: more towards touchdown, and with 3 than with 2 standard deviations."""
    sizes = run.rows("lft_sizes_uncertain_3_sigma")
    assert [row["copies_2_sigma"] for row in sizes] == [7, 24]
    assert [row["copies_3_sigma"] for row in sizes] == [13, 29]


@pytest.mark.parametrize("name", ["k0", "ka", "ka2", "ka3"])
def test_controllers_are_diagonal_of_third_order_and_stable(run: Run, name: str) -> None:
    made = load_product(run.directory / f"{name}.npz")
    assert isinstance(made, ControlDesign)
    k = made.controller
    assert k.order == 3
    assert np.linalg.eigvals(k.a).real.max() <= 0.0
    mask = np.kron(np.eye(3), np.ones((1, 3))) == 0.0
    assert not k.d[mask].any()
    assert not (k.a - np.diag(np.diag(k.a))).any()


def test_every_compensator_lands_and_the_open_loop_does_not(run: Run) -> None:
    found = rows(run, "campaign_summary", "name")
    for name in ("K0", "KA", "KA,2σ", "KA,3σ"):
        assert found[f"{name}, failures"]["mean"] == 0.0
        assert found[f"{name}, largest_position_error"]["mean"] < 2.0
        assert found[f"{name}, largest_position_error"]["mean_paper"] > 0.0
    lost = run.rows("campaign_classes_verify_open_loop")
    assert sum(row["cases"] for row in lost if row["failed"]) == 64


def test_sampled_designs_trade_sensitivity_for_accuracy(run: Run) -> None:
    """Updates every 60 s at Ms 2.5 and 3, every 30 and 10 s at Ms 2, actuator errors included."""
    error = {
        name: value(run, f"campaign_largest_position_error_mean_verify_swift_{name}")
        for name in ("60", "60_bold", "30", "10")
    }
    assert error["60"] < 0.45
    assert error["60_bold"] < 0.33
    assert error["30"] < 0.15
    assert error["10"] < 0.03
    assert value(run, "campaign_largest_velocity_error_mean_verify_swift_10") < 1.2e-3
