"""The mission ``phobos-hover``: a campaign on a closed loop, against SciPy and by another route."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.special import sph_legendre_p_all
from tests.missions.pages import check_page

from hillsphere.cases.case_classes import has_ended
from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import SerialSpec
from hillsphere.cases.repeated import Repeated, RepeatedWork
from hillsphere.mission import load_mission
from hillsphere.products import CaseTable, load_product
from hillsphere_campaigns.case_plan import plan_of
from hillsphere_campaigns.case_table import table_of
from hillsphere_campaigns.engine import run_campaign

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.missions.conftest import Run

Array = NDArray[np.float64]

pytestmark = pytest.mark.slow  # 50 s

RADIUS, MEAN_MOTION = 11.1e3, float(np.sqrt(42828.37e9 / 9377e3**3))
PERIOD, SAMPLES, MOST = 60.0, 133, 0.01
# No errors of navigation and execution: what differs is then known from the table of cases alone.
EXACT = {
    f"stage.hover.{key}": 0.0
    for key in (
        "navigation.position_m",
        "navigation.velocity_m_s",
        "actuator.magnitude",
        "actuator.pointing_rad",
    )
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, mission_run: Callable[..., Run]) -> Run:
    out = tmp_path_factory.mktemp("missions") / "hover"
    return mission_run(out, "phobos-hover", "--profile", "fast", "--no-cache")


def exact_cases(count: int, directory: Path) -> CaseTable:
    """Fly cases of the mission's campaign without errors of navigation and execution."""
    mission = load_mission("phobos-hover")
    repeated = Repeated(mission, "hover").changed(EXACT)
    names = tuple(mission.specs["dispersions"])
    plan = plan_of(repeated, names, cases=count, stream="hover")
    outcomes, stopped = run_campaign(
        plan,
        RepeatedWork(plan.variants),
        executor=Serial(SerialSpec()),
        checkpoints=Checkpoints(directory, "test"),
    )
    return table_of(plan, outcomes, "hover", stopped)


def table(run: Run, stage: str) -> CaseTable:
    product = load_product(run.directory / f"{stage}.npz")
    assert isinstance(product, CaseTable)
    return product


def potential(place: Array, given: dict[str, float]) -> float:
    """Potential of the field, less its point mass, by SciPy's normalised Legendre functions.

    Four-pi-normalised harmonics without the Condon-Shortley phase are √(4π (2 − δ)) (−1)^m times
    the orthonormal ones. The far side of the moon, which the IAU counts from longitude 180°, is on
    the x axis: body axes are turned by half a turn.
    """
    x, y, z = -place[0], -place[1], place[2]
    r = float(np.sqrt(x * x + y * y + z * z))
    longitude, colatitude = np.arctan2(y, x), np.arccos(z / r)
    total, legendre = 0.0, sph_legendre_p_all(4, 4, colatitude)[0]
    for n in range(1, 5):
        for m in range(n + 1):
            c = given.get(f"gravity.phobos.C{n},{m}", 0.0)
            s = given.get(f"gravity.phobos.S{n},{m}", 0.0) if m else 0.0
            size = np.sqrt(4 * np.pi * (1 if m == 0 else 2)) * (-1.0) ** m
            p = size * float(legendre[n, m])
            wave = c * np.cos(m * longitude) + s * np.sin(m * longitude)
            total += (RADIUS / r) ** n * p * wave
    return given["gravity.phobos.gm"] / r * total


def acceleration(place: Array, given: dict[str, float]) -> Array:
    """Attraction: of the point mass exactly, of the rest by differences."""
    r = float(np.linalg.norm(place))
    pull: Array = -given["gravity.phobos.gm"] * place / r**3
    h = 20.0
    for i in range(3):
        step = np.eye(3)[i] * h
        inner = potential(place + step, given) - potential(place - step, given)
        outer = potential(place + 2 * step, given) - potential(place - 2 * step, given)
        pull[i] += (8 * inner - outer) / (12 * h)
    return pull


def law() -> tuple[Array, Array, Array]:
    """Matrices of the compensator, discretised by the exponential of the whole."""
    keys = load_mission("phobos-hover").specs["compensator"]["integral"].model_dump()
    a, b, c = (np.array(keys[name]) for name in "abc")
    both = np.zeros((15, 15))
    both[:9, :9], both[:9, 9:] = a, b
    found = expm(both * PERIOD)
    return found[:9, :9], found[:9, 9:], c


def flown(given: dict[str, float]) -> tuple[Array, float]:
    """Fly a case sample by sample; return its distances from the target, and Δv."""
    a, b, c = law()
    n = MEAN_MOTION
    target = np.array([20e3, 0, 0, 0, 0, 0])
    x = target + [given[f"offset.{name}"] for name in ("x", "y", "z", "vx", "vy", "vz")]
    gain = np.array([given[f"actuator.gain.{name}"] for name in ("ax", "ay", "az")])
    state, spent, distances = np.zeros(9), 0.0, []
    for _ in range(SAMPLES):
        distances.append(float(np.linalg.norm((x - target)[:3])))
        command = c @ state
        u = gain * command * min(1.0, MOST / max(float(np.linalg.norm(command)), 1e-300))
        state = a @ state + b @ (target - x)
        spent += PERIOD * float(np.linalg.norm(u))

        def rate(t: float, y: Array, u: Array = u) -> Array:
            pull = acceleration(y[:3], given) + u
            pull += [2 * n * y[4] + 3 * n**2 * y[0], -2 * n * y[3], -(n**2) * y[2]]
            return np.concatenate([y[3:], pull])

        # A minute is short beside the motion: one step of order eight.
        x = solve_ivp(
            rate, (0, PERIOD), x, "DOP853", rtol=1e-9, atol=1e-6, first_step=PERIOD
        ).y[:, -1]  # fmt: skip
    distances.append(float(np.linalg.norm((x - target)[:3])))
    return np.array(distances), spent


def test_cases_fly_as_in_other_equations_and_another_loop(tmp_path: Path) -> None:
    cases = exact_cases(70, tmp_path)
    assert cases.case.tolist() == list(range(70))
    for case in (0, 66):  # one of each block
        given = dict(zip(cases.inputs, cases.input_values[:, case].tolist(), strict=True))
        distances, spent = flown(given)
        values = dict(zip(cases.metrics, cases.values[:, case].tolist(), strict=True))
        assert values["final_position_error"] == pytest.approx(distances[-1], rel=0, abs=1e-5)
        assert values["largest_position_error"] == pytest.approx(
            distances[60:].max(), rel=0, abs=1e-5
        )
        assert values["dv"] == pytest.approx(spent, rel=1e-9)


def test_what_differs_is_spread_as_declared(run: Run) -> None:
    cases = table(run, "verify")
    count = len(cases.case)
    assert count == 192
    spread = {
        "offset.x": (0.0, 200.0),
        "offset.vz": (0.0, 0.01),
        "gravity.phobos.gm": (7.087546066894452e5, 0.003 * 7.087546066894452e5),
        "gravity.phobos.C2,0": (-0.04698, 0.05 * 0.04698),
        "gravity.phobos.S4,3": (0.00337, 0.05 * 0.00337),
        "actuator.gain.ay": (1.0, 0.05 / np.sqrt(3.0)),
    }
    for name, (mean, deviation) in spread.items():
        values = cases.input_values[cases.inputs.index(name)]
        # Four standard errors: one of six goes beyond in fewer than 1 of 2000 seeds.
        assert abs(values.mean() - mean) < 4 * deviation / np.sqrt(count), name
        assert abs(values.std(ddof=1) / deviation - 1) < 4 / np.sqrt(2 * count), name


def test_both_laws_saw_the_same(run: Run) -> None:
    first, second = table(run, "verify"), table(run, "verify_unfiltered")
    assert first.inputs == second.inputs
    assert np.array_equal(first.input_values, second.input_values)
    row = next(r for r in run.rows("comparison_metrics") if r["metric"] == "dv")
    both = has_ended(first) & has_ended(second)
    dv = [t.values[t.metrics.index("dv")][both] for t in (first, second)]
    assert row["difference"] == pytest.approx(float(np.mean(dv[1] - dv[0])), rel=1e-12)
    # Without filters a minute's delay is saved: less is spent in every single case.
    assert np.all(dv[1] < dv[0])


def test_a_longer_period_and_worse_navigation_fail_more(run: Run) -> None:
    failures = {
        (r["compensator.integral.period_s"], r.get("stage.hover.navigation.position_m")): r["ratio"]
        for r in run.rows("sweep_failures")
    }
    ratios = np.array(list(failures.values()))
    assert len(failures) in (2, 6)
    assert ratios.min() < 0.1
    assert ratios.max() > 0.8


def test_the_report_says_what_failed(run: Run) -> None:
    cases = table(run, "verify")
    rows = run.rows("campaign_classes")
    assert sum(row["cases"] for row in rows) == 192
    assert {row["status"] for row in rows} <= {"completed", "requirement"}
    beyond = cases.values[cases.metrics.index("largest_position_error")] > 22.0
    assert np.array_equal(cases.failed, beyond)
    metrics: dict[str, Any] = run.summary["metrics"]
    assert metrics["campaign_failures"]["value"] == int(beyond.sum())
    assert json.loads((run.directory / "manifest.json").read_text("utf-8"))["seed"] == 1


@pytest.mark.slow
def test_its_page_works_in_a_browser(run: Run) -> None:
    check_page(run.directory)
