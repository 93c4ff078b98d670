"""Campaigns: what the layer costs per case, what it holds in memory, what workers are worth.

The layer is measured with a stage that does nothing, for 24 dispersed quantities and the metrics of
a closed loop; the real work is the mission ``phobos-hover``: 2000 closed-loop flights of 133
samples with dispersed gravity, start and actuator, and errors of navigation and execution. SciPy
flies some of the same cases, without errors, with the same gravity, compiled, and the same law.
``python benchmarks/run.py campaign --long`` measures workers on a minute of work.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import PoolSpec, SerialSpec
from hillsphere.cases.plan import Plan
from hillsphere.cases.repeated import Repeated, RepeatedWork
from hillsphere.dynamics import system
from hillsphere.interfaces import Context, Parameter
from hillsphere.interfaces.cases import CaseBatch, CaseResults
from hillsphere.interfaces.tasks import Executor
from hillsphere.mission import Mission, load_mission
from hillsphere.plugins import Component, hookimpl
from hillsphere.plugins.registry import discover
from hillsphere.presentation import Presentation
from hillsphere.products import CaseTable
from hillsphere.runs.pipeline import run_mission
from hillsphere.spec import StageSpec
from hillsphere_campaigns.case_plan import plan_of
from hillsphere_campaigns.case_table import table_of
from hillsphere_campaigns.engine import run_campaign
from hillsphere_flight.closed_loop import ClosedLoopStage

Array = NDArray[np.float64]
INPUTS, METRICS = 24, 7
LAYER_CASES, MANY_CASES, FLIGHTS, BY_SCIPY = 32_000, 100_000, 2000, 3
LONG_FLIGHTS = 200_000
QUICK_FLIGHTS = 16_000
DISPERSIONS = ("field", "mass", "start", "start_rate", "thrust")
# Run by its path, this module has another name than the one by which its stage is found.
sys.modules.setdefault("bench_campaign", sys.modules[__name__])


@dataclass(frozen=True)
class Nothing:
    """Product of a stage that does nothing."""

    value: float = 0.0


class IdleSpec(StageSpec):
    """A stage that does nothing."""

    produces = "bench_campaign:Nothing"
    examples = ({},)


class Idle:
    """As many inputs and metrics as a closed loop in a field of degree four, and no work."""

    def __init__(self, spec: IdleSpec) -> None:
        self.spec = spec

    def run(self, ctx: Context) -> Nothing:
        """Do nothing."""
        return Nothing()

    def present(self, product: Nothing) -> Presentation:
        """Show nothing."""
        return Presentation()

    def case_inputs(self) -> tuple[Parameter, ...]:
        """Return the inputs."""
        return tuple(Parameter(f"state.x{i}", 1.0 + i, "m") for i in range(INPUTS))

    def run_cases(self, batch: CaseBatch, history: bool = False) -> CaseResults:
        """Return the first inputs as metrics."""
        count = len(batch.numbers)
        return CaseResults(
            tuple(f"m{i}" for i in range(METRICS)),
            ("m",) * METRICS,
            batch.values[:METRICS],
            ("completed",) * count,
            ("",) * count,
            np.zeros(count, dtype=bool),
        )


class Plugin:
    """Offers the stage."""

    @hookimpl
    def hillsphere_components(self) -> list[Component]:
        """Return it."""
        where = "bench_campaign"
        return [Component("stage", "idle", f"{where}:Idle", f"{where}:IdleSpec", "does nothing")]


IDLE = """\
format = 1
name = "idle"
title = "Nothing, many times"
seed = 1

[dispersions.all]
type = "normal"
of = "stage.nothing"
parameters = ["state.*"]
sigma_relative = 0.1

[stage.nothing]
type = "idle"

[stage.many]
type = "monte_carlo"
repeat = "nothing"
dispersions = ["all"]
cases = 100000
"""


def idle(directory: Path, cases: int = MANY_CASES) -> Mission:
    """Return the mission of the stage that does nothing."""
    registry = discover(strict=True)
    registry.add_plugin("idle", Plugin())
    path = directory / "idle.toml"
    path.write_text(IDLE.replace("cases = 100000", f"cases = {cases}"))
    return load_mission(path, registry=registry)


def hover(changes: Mapping[str, Any] | None = None) -> Repeated:
    """Return the closed loop of the mission ``phobos-hover``, possibly with other keys."""
    return Repeated(load_mission("phobos-hover"), "hover").changed(changes or {})


def flown(plan: Plan, executor: Executor, directory: Path) -> tuple[CaseTable, float, float]:
    """Run a campaign with checkpoints; return its table and its seconds of wall clock and CPU."""
    begin, cpu = perf_counter(), process_time()
    outcomes, stopped = run_campaign(
        plan,
        RepeatedWork(plan.variants),
        executor=executor,
        checkpoints=Checkpoints(directory, "benchmark"),
    )
    table = table_of(plan, outcomes, "repeated", stopped)
    return table, perf_counter() - begin, process_time() - cpu


@contextmanager
def scratch() -> Iterator[Path]:
    """Give a directory for checkpoints."""
    with tempfile.TemporaryDirectory() as directory:
        yield Path(directory)


def layer() -> dict[str, float]:
    """Cost of a campaign of cases that cost nothing: plan, isolation, checkpoints, table."""
    serial = Serial(SerialSpec())
    with scratch() as directory:
        repeated = Repeated(idle(directory), "nothing")
        best = np.inf
        for attempt in range(3):
            cpu = process_time()
            plan = plan_of(repeated, ("all",), cases=LAYER_CASES, stream="layer")
            planned = process_time() - cpu
            _, _, spent = flown(plan, serial, directory / f"work{attempt}")
            best = min(best, planned + spent)
    return {"layer_us_per_case": best / LAYER_CASES * 1e6}


def against_scipy() -> dict[str, float]:
    """Campaign of the mission's flights on one core, and SciPy's DOP853 on some of them."""
    serial = Serial(SerialSpec())
    found: dict[str, float] = {}
    errors = (
        "navigation.position_m",
        "navigation.velocity_m_s",
        "actuator.magnitude",
        "actuator.pointing_rad",
    )
    exact = {f"stage.hover.{key}": 0.0 for key in errors}
    with scratch() as directory:
        for name, changes in (("with_errors", {}), ("exact", exact)):
            plan = plan_of(hover(changes), DISPERSIONS, cases=FLIGHTS, stream="benchmark")
            few = plan_of(hover(changes), DISPERSIONS, cases=64, stream="benchmark")
            flown(few, serial, directory / f"{name}-warm")  # compiled code is kept
            table, _, cpu = flown(plan, serial, directory / name)
            found[f"flights_{name}_us_per_case"] = cpu / FLIGHTS * 1e6
            found[f"flights_{name}_failed"] = float(np.count_nonzero(table.failed))
        stage = plan.variants[0].build()
    assert isinstance(stage, ClosedLoopStage)
    begin = process_time()
    other = np.array([by_scipy(stage, table, case) for case in range(BY_SCIPY)])
    per_case = (process_time() - begin) / BY_SCIPY
    ours = table.values[table.metrics.index("final_position_error"), :BY_SCIPY]
    found["scipy_s_per_flight"] = per_case
    found["faster_than_scipy_loop"] = per_case / (found["flights_exact_us_per_case"] * 1e-6)
    found["position_error_difference_m"] = float(np.abs(other - ours).max())
    return found


def by_scipy(stage: ClosedLoopStage, table: CaseTable, case: int) -> float:
    """Fly a case sample by sample; return its distance from the target at the end."""
    given = dict(zip(table.inputs, table.input_values[:, case].tolist(), strict=True))
    parameters = stage.plant.parameters()
    names = tuple(q.name for q in parameters)
    equations = system(stage.plant, run_time=names, controls=True)
    rate = equations.function(*equations.rhs)
    # A quantity of the field is named by its table there, by the way to it here.
    field = {q.name: given.get(q.name.replace("gravity.", "gravity.phobos."), q.value)
             for q in parameters}  # fmt: skip
    values = np.array([*field.values(), 0.0, 0.0, 0.0])
    target = np.zeros(6)
    target[:3] = stage.spec.target.position_m if stage.spec.target else ()
    y = target + [given.get(f"offset.{name}", 0.0) for name in stage.rows.names]
    gain = np.array([given[f"actuator.gain.{name}"] for name in stage.commands])
    law, xc = stage.law, stage.law.initial(1)
    actuator = stage.spec.actuator
    most = (actuator and actuator.maximum_acceleration_m_s2) or np.inf
    period, samples = law.period_s, round((stage.spec.duration_s or 0.0) / law.period_s)
    for k in range(samples):
        u, xc = law.step(k, np.array([k * period]), y[:, None], target[:, None], xc)  # type: ignore[union-attr]
        size = float(np.linalg.norm(u))
        values[-3:] = gain * u[:, 0] * (min(size, most) / size if size else 0.0)
        y = solve_ivp(
            lambda t, y: rate(y, values), (0.0, period), y,
            method="DOP853", rtol=1e-10, atol=1e-7,
        ).y[:, -1]  # fmt: skip
    return float(np.linalg.norm((y - target)[:3]))


def workers(flights: int, name: str) -> dict[str, float]:
    """Wall clock of one and of two worker processes on the mission's flights, start included."""
    plan = plan_of(hover(), DISPERSIONS, cases=flights, stream="benchmark")
    wall = {}
    with scratch() as directory:
        for count in (1, 2):
            pool = Pool(PoolSpec(workers=count))
            _, wall[count], _ = flown(plan, pool, directory / f"{name}{count}")
    return {
        "processors_speedup": processors(),
        f"one_worker_{name}_s": wall[1],
        f"two_workers_{name}_s": wall[2],
        f"two_workers_{name}_speedup": wall[1] / wall[2],
    }


def processors() -> float:
    """Return by how much two processes that only count do more than one, at this moment.

    Two, if the machine is free; what two workers are worth is to be read beside it.
    """
    count = [sys.executable, "-S", "-c", "sum(range(60_000_000))"]
    begin = perf_counter()
    subprocess.run(count, check=True)
    alone = perf_counter() - begin
    begin = perf_counter()
    both = [subprocess.Popen(count) for _ in range(2)]
    for one in both:
        one.wait()
    return 2.0 * alone / (perf_counter() - begin)


def memory() -> dict[str, float]:
    """Largest memory of a process that runs, keeps and shows 100 000 cases."""
    begin = perf_counter()
    done = subprocess.run(
        [sys.executable, __file__, "memory"], check=True, capture_output=True, text=True
    )
    cases, megabytes = done.stdout.split()
    return {
        "many_cases": float(cases),
        "many_cases_memory_mb": float(megabytes),
        "many_cases_s": perf_counter() - begin,
    }


def _many(count: int) -> None:
    """Run so many cases in this process, and say how many there are and its memory."""
    with scratch() as directory:
        mission = idle(directory, count)
        result = run_mission(mission, out=directory / "run", use_cache=False)
        table = result.products["many"]
        assert isinstance(table, CaseTable)
        cases = len(table.case)
    assert cases == count
    # Linux counts in kilobytes, macOS in bytes.
    unit = 1e6 if sys.platform == "darwin" else 1e3
    print(cases, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit)


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    found = layer() | memory() | against_scipy()
    if os.environ.get("HILLSPHERE_BENCHMARK_LONG"):
        return found | workers(LONG_FLIGHTS, "long")
    return found | workers(QUICK_FLIGHTS, "quick")


if __name__ == "__main__":
    if sys.argv[1:2] == ["memory"]:
        _many(int(sys.argv[2]) if sys.argv[2:] else MANY_CASES)
    else:
        for figure, number in figures().items():
            print(f"{figure:<40} {number:12.4g}")
