"""The mission ``robust-control-demo``: a distillation column, and two masses on a spring."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.missions.pages import check_page

from hillsphere.lti import LtiSystem
from hillsphere.products import ControlDesign, load_product
from hillsphere_controllers.linear_products import UncertainModels
from hillsphere_controllers.stages.mu_analysis.products import MuAnalysis
from hillsphere_controllers.stages.synthesis.products import Synthesis
from hillsphere_controllers.stages.uncertain import to_lft
from hillsphere_controllers.systems.algebra import lower_lft

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.missions.conftest import Run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, mission_run: Callable[..., Run]) -> Run:
    out = tmp_path_factory.mktemp("missions") / "robust-control"
    return mission_run(out, "robust-control-demo", "--profile", "fast", "--no-cache")


def rows(run: Run, table: str) -> dict[str, dict[str, Any]]:
    return {row["controller"]: row for row in run.rows(table)}


def spring(k: float) -> LtiSystem:
    """Return two masses of 1 kg from the force on the first to the position of the second."""
    a = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-k, k, 0, 0], [k, -k, 0, 0]], dtype=float)
    b = np.array([[0.0], [0.0], [1.0], [0.0]])
    return LtiSystem(a, b, np.array([[0.0, 1.0, 0.0, 0.0]]), np.zeros((1, 1)))


def test_skogestad_postlethwaite_table_8_1(run: Run) -> None:
    """The peaks of the book, on a coarse grid, are a little below those that are certified."""
    found = rows(run, "mu_summary")["inverse"]
    for name in ("robust_performance", "robust_stability"):
        assert found[f"{name}_paper"] <= found[f"{name}_lower"] * 1.0001
        assert found[f"{name}_lower"] == pytest.approx(found[f"{name}_paper"], rel=5e-3)
        assert found[f"{name}_lower"] <= found[f"{name}_certified"]
    assert found["nominal_performance"] == pytest.approx(0.5, abs=1e-6)


def test_iteration_makes_the_column_robust(run: Run) -> None:
    found = rows(run, "mu_summary")
    assert found["dk"]["robust_performance_certified"] < 1.15
    assert found["inverse"]["robust_performance_lower"] > 5.7
    design = load_product(run.directory / "dk.npz")
    assert isinstance(design, Synthesis)
    assert design.iterations is not None
    assert found["dk"]["robust_performance_lower"] <= design.iterations.upper_mu


def test_one_controller_stabilises_every_spring(run: Run) -> None:
    design = load_product(run.directory / "structured.npz")
    assert isinstance(design, ControlDesign)
    assert design.controller.order == 2
    for k in np.linspace(0.5, 2.0, 31):
        assert lower_lft(_with_loop(spring(k)), design.controller).is_stable
    product = load_product(run.directory / "masses_mu.npz")
    assert isinstance(product, MuAnalysis)
    stability = next(one for one in product.results if one.analysis == "robust_stability")
    assert stability.upper < 1.0
    # put into the equations of motion, the worst stiffness is on the border of stability
    (worst,) = stability.values
    assert not 0.5 < worst < 2.0
    loop = lower_lft(_with_loop(spring(float(worst))), design.controller)
    assert float(loop.poles.real.max()) == pytest.approx(0.0, abs=1e-6)


def test_worst_gain_is_reached_by_the_stiffness_found(run: Run) -> None:
    product = load_product(run.directory / "masses_mu.npz")
    uncertain = load_product(run.directory / "masses_uncertain.npz")
    design = load_product(run.directory / "structured.npz")
    assert isinstance(product, MuAnalysis)
    assert isinstance(uncertain, UncertainModels)
    gained = next(one for one in product.results if one.analysis == "worst_case_gain")
    worst = to_lft(uncertain.models[0]).at({"k": gained.values[0]})
    loop = lower_lft(worst, design.controller)
    omega = gained.frequency_rad_s * np.linspace(0.9, 1.1, 4001)
    reached = np.linalg.norm(loop.response(omega), 2, axis=(1, 2)).max()
    assert_allclose(reached, gained.lower, rtol=1e-4)
    assert gained.lower <= gained.upper <= 1.03 * gained.lower


def test_figures_are_drawn(run: Run) -> None:
    for name in ("mu_bounds", "mu_sensitivities", "synthesis_gains", "synthesis_steps",
                 "synthesis_iterations", "lft_responses"):  # fmt: skip
        found = list((run.directory / "figures").glob(f"{name}*.json"))
        assert found, name
        assert all(path.stat().st_size > 1_000 for path in found)


def _with_loop(plant: LtiSystem) -> LtiSystem:
    """Return a plant that is seen as well as measured, to close its loop."""
    return LtiSystem(
        plant.a, np.hstack([plant.b, plant.b]), np.vstack([plant.c, plant.c]), np.zeros((2, 2))
    )


@pytest.mark.slow
def test_its_page_works_in_a_browser(run: Run) -> None:
    check_page(run.directory)
