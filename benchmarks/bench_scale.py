"""Growth of campaigns: memory and CPU with the number of cases, and the cost of eight dask workers.

``python benchmarks/bench_scale.py figure`` draws ``docs/images/campaign-growth.svg`` from a hundred
to a million cases. ``python benchmarks/run.py scale --long`` measures a million cases and the
cluster; all that is measured is CPU time and memory, which a busy machine does not change much.
"""

from __future__ import annotations

import os
import pickle
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from bench_campaign import Repeated, idle, plan_of

from hillsphere.cases.checkpoints import Checkpoints
from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import PoolSpec, SerialSpec
from hillsphere.cases.repeated import RepeatedWork
from hillsphere.cases.stored_blocks import BlockFiles, StoredBlocks
from hillsphere.interfaces.tasks import Executor, StoredTask, Task
from hillsphere_campaigns.engine import run_campaign

HERE = Path(__file__).resolve().parent
GROWTH = (100, 1000, 10_000, 100_000, 1_000_000)
WORKERS = 8
TASKS = 2000
FILE_CASES = 400_000


def one(cases: int) -> tuple[float, float]:
    """Return CPU time (s) and largest memory (MB) of a run of so many cases, start included."""
    begin = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, str(HERE / "bench_campaign.py"), "memory", str(cases)],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    end = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = end.ru_utime + end.ru_stime - begin.ru_utime - begin.ru_stime
    return cpu, float(done.stdout.split()[1])


def exponent(cases: np.ndarray, values: np.ndarray) -> float:
    """Return the slope of ln values over ln cases, by least squares."""
    return float(np.polyfit(np.log(cases), np.log(values), 1)[0])


def growth(sizes: tuple[int, ...] = GROWTH) -> dict[str, np.ndarray]:
    """Return cases, CPU time (s) and memory (MB); ``start`` is that of the least campaign."""
    one(sizes[0])  # caches
    found = np.array([one(size) for size in sizes])
    cpu, memory = found.T
    return {"cases": np.array(sizes), "cpu": cpu, "memory": memory, "start": found[0]}


def draw(path: Path) -> None:
    """Draw CPU time and memory against cases, with exponents from 10 000 cases on."""
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot as plt

    found = growth()
    n, late = found["cases"], found["cases"] >= 10_000
    plt.rcParams["svg.hashsalt"] = "campaign-growth"
    figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.4), constrained_layout=True)
    words = (("cpu", "CPU time (s)", "#0072B2"), ("memory", "largest memory (MB)", "#D55E00"))
    for axis, (key, label, colour), start in zip(axes, words, found["start"], strict=True):
        values = found[key]
        slope = exponent(n[late], values[late] - start)
        axis.loglog(n, values, "o-", color=colour, label="measured")
        axis.axhline(start, color="0.4", lw=0.8, ls="--", label="a hundred cases")
        fit = (values[-1] - start) * (n / n[-1]) ** slope
        axis.loglog(n, start + fit, ":", color="0.2", label=f"that + c · cases^{slope:.2f}")
        axis.set(xlabel="cases", ylabel=label)
        axis.legend(frameon=False, fontsize=8)
        axis.grid(alpha=0.3)
        print(f"{key}: {values.tolist()}, start {start:.4g}, exponent {slope:.3f}")
    axes[1].set_ylim(100, 1000)
    figure.savefig(path, metadata={"Date": None})


def campaign(
    executor: Executor, cases: int, directory: Path, group_blocks: int | None = None
) -> tuple[float, float]:
    """Run cases that cost nothing into files; return CPU of this process and wall clock, s."""
    plan = plan_of(Repeated(idle(directory), "nothing"), ("all",), cases=cases, stream="scale")
    files = BlockFiles(directory / "work", "scale", plan)
    begin, cpu = perf_counter(), process_time()
    run_campaign(
        plan, RepeatedWork(plan.variants, (), files), executor=executor,
        checkpoints=Checkpoints(directory / "work", "scale"), stored=StoredBlocks(files),
        group_blocks=group_blocks,
    )  # fmt: skip
    return process_time() - cpu, perf_counter() - begin


def cluster(name: str, executor: Executor) -> dict[str, float]:
    """Cost in the run's process of tasks of one block, and of a campaign whose workers write."""
    found = {}
    with tempfile.TemporaryDirectory() as directory:
        spent, took = campaign(executor, 64, Path(directory))
    for what, cases, group, units in (
        ("task_by_value", 64 * TASKS, 1, TASKS),
        ("file", FILE_CASES, None, FILE_CASES / 4096),
    ):
        with tempfile.TemporaryDirectory() as directory:
            cpu, wall = campaign(executor, cases, Path(directory), group)
        found[f"{name}_{what}_cpu_ms"] = (cpu - spent) / units * 1e3
        found[f"{name}_{what}_per_s"] = units / (wall - took)
    return found


def traffic() -> dict[str, float]:
    """Bytes per case that travel to a worker and back, by value and in files."""
    with tempfile.TemporaryDirectory() as directory:
        place = Path(directory)
        plan = plan_of(Repeated(idle(place), "nothing"), ("all",), cases=4096, stream="scale")
        work = RepeatedWork(plan.variants, (), BlockFiles(place, "scale", plan)).prepare()
        task = Task(0, tuple(plan.block(i)[0] for i in range(plan.blocks)))
        stored = StoredTask(0, range(1))
        sizes = [len(pickle.dumps(t)) + len(pickle.dumps(work(t))) for t in (task, stored)]
        on_disk = sum(path.stat().st_size for path in place.glob("cases-*.npy"))
    return {
        "by_value_bytes_per_case": sizes[0] / 4096,
        "in_files_bytes_per_file": sizes[1],
        "disk_bytes_per_case": on_disk / 4096,
    }


def two_workers() -> dict[str, float]:
    """CPU time of two workers over that of one, beyond 5 s of work, starts included."""
    spent = []
    for workers in (1, 2):
        with tempfile.TemporaryDirectory() as directory:
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            cpu, _ = campaign(Pool(PoolSpec(workers=workers)), FILE_CASES, Path(directory))
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent.append(cpu + after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return {"one_worker_cpu_s": spent[0], "cpu_of_one_over_two_workers": spent[0] / spent[1]}


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    found = traffic()
    if os.environ.get("HILLSPHERE_BENCHMARK_LONG"):
        from hillsphere_dask.dask import Dask
        from hillsphere_dask.specs import DaskSpec

        cpu, memory = one(1_000_000)
        found |= {"million_cases_cpu_s": cpu, "million_cases_memory_mb": memory}
        found |= two_workers() | cluster("dask", Dask(DaskSpec(workers=WORKERS)))
        found |= cluster("serial", Serial(SerialSpec()))
    return found


if __name__ == "__main__":
    if sys.argv[1:] == ["figure"]:
        draw(HERE.parent / "docs" / "images" / "campaign-growth.svg")
    else:
        for figure, number in figures().items():
            print(f"{figure:<40} {number:12.4g}", flush=True)
