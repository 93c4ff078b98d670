"""Fixed-structure H∞ synthesis: one controller for ten plants; and a collection of plants.

    python benchmarks/run.py structured --long          # ten spacecraft, 10 starts, all processors
    python benchmarks/bench_structured.py PATH          # the collection in a .npz file
    python benchmarks/bench_structured.py PATH AC2 HE1:2 --starts 4
    python benchmarks/bench_structured.py PATH --order 20 --results ours.jsonl
    python benchmarks/bench_structured.py PATH --order 20 --reference --limit 99 --results ref.jsonl
    python benchmarks/bench_structured.py PATH --order 20 --results ours.jsonl --compare ref.jsonl

A file of plants has arrays PLANT/A, /B1, /B, /C1, /C, /D11, /D12, /D21 of ẋ = A x + B1 w + B u,
z = C1 x + D11 w + D12 u, y = C x + D21 w, as those of COMPleib [1]_. The figures beside ours are
from one run of HIFOO 3.5 with its own settings, rounded as published or measured so; it is no race
of equal budgets.

References
----------
.. [1] F. Leibfritz (2004), COMPleib: COnstraint Matrix-optimization Problem library, University of
   Trier.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Mapping
from time import perf_counter, process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.specs import PoolSpec
from hillsphere.errors import HillsphereError, Interrupted
from hillsphere.lti import LtiSystem
from hillsphere.testing import RecordingContext
from hillsphere_controllers.structured import active_plants
from hillsphere_controllers.structured.effort import EFFORTS
from hillsphere_controllers.structured.requirements import DesignPlant
from hillsphere_controllers.structured.search_runs import Progress
from hillsphere_controllers.structured.structure import Diagonal, FreeEntries, free_state_space
from hillsphere_controllers.structured.synthesis import StructuredDesign, synthesise
from hillsphere_controllers.structured.verdict import AGREED

Array = NDArray[np.float64]
LONG = "HILLSPHERE_BENCHMARK_LONG"
ROUNDS, FIRST_SEED = 20, 1001
"""Rounds of a reference, of ten starts and ten searches by other routes each, and their seeds: none
is that of a run that is compared with it."""
SEEDS = 3
"""Seeds of the comparison of searches by the highest plants with those by all."""
ALL_ROUTES = 1.001
"""Effort by which all searches by other routes are done, however many agree."""

# Static output feedback, or PLANT:order. HIFOO's γ.
KNOWN = {
    "AC2": 0.111489, "AC4": 0.935467, "AC4:1": 0.557936, "AC4:2": 0.557293, "AC6": 4.11396,
    "AC7": 0.0650907, "AC8": 2.00501, "AC9": 1.00216, "AC16": 15.6014, "AC17": 6.61243,
    "HE1": 0.153944, "HE1:2": 0.08489, "HE5": 8.89516, "DIS1": 4.17044, "DIS2": 1.05483,
    "DIS3": 1.08987, "TG1": 12.8462, "AGS": 8.17324, "EB1": 3.12253, "EB2": 2.0201, "EB3": 2.05753,
    "MFP": 31.5899, "BDT1": 0.266333, "WEC1": 4.05014, "NN1": 13.8755, "NN2": 2.22158,
    "NN4": 1.36146, "NN8": 2.91031, "NN14": 17.4759, "NN15": 0.103749, "NN16": 0.955683,
    "NN17": 11.2182, "PSM": 0.920243, "REA2": 1.14919, "REA2:1": 1.17198, "REA3": 74.2513,
    "DLR1": 2.77729,
}  # fmt: skip


def spacecraft(seed: int) -> DesignPlant:
    """Return a spacecraft with a flexible appendage about each axis, 15 states.

    Angle, rate, and a mode of the appendage in each of three axes, coupled by the products of
    inertia; torques u, disturbing torques w, noise on the angles, rates and on the acceleration of
    the appendages; z are filtered angles and torques. Inertias, frequencies and dampings differ
    from one to the next.
    """
    random = np.random.default_rng(seed)
    inertia = np.diag([1.0, 1.3, 0.8]) * random.uniform(0.8, 1.2, 3)
    products = 0.08 * random.uniform(-1.0, 1.0, (3, 3))
    inertia = inertia + products + products.T
    frequency = np.array([1.6, 2.3, 3.1]) * random.uniform(0.85, 1.15, 3)
    damping = random.uniform(0.002, 0.01, 3)
    share = 0.35 * np.sqrt(np.diag(inertia)) * random.uniform(0.8, 1.2, 3)
    # J θ̈ + δ q̈ = u + w,  q̈ + 2ζω q̇ + ω² q + δᵀ θ̈ = 0, solved for the accelerations
    mass = np.block([[inertia, np.diag(share)], [np.diag(share), np.eye(3)]])
    stiff = np.zeros((6, 12))
    stiff[3:, 6:9], stiff[3:, 9:] = -np.diag(frequency**2), -np.diag(2.0 * damping * frequency)
    torque = np.vstack([np.eye(3), np.zeros((3, 3))])
    moved, pushed = np.linalg.solve(mass, stiff), np.linalg.solve(mass, torque)
    a, b = np.zeros((15, 15)), np.zeros((15, 3))
    a[:3, 3:6] = a[6:9, 9:12] = np.eye(3)
    a[3:6, :12], a[9:12, :12] = moved[:3], moved[3:]
    b[3:6], b[9:12] = pushed[:3], pushed[3:]
    a[12:, :3], a[12:, 12:] = np.eye(3), -0.02 * np.eye(3)  # filter of the angles
    noise = np.diag(np.repeat([0.02, 0.05, 0.1], 3))
    c_z = np.zeros((9, 15))
    c_z[:3, :3], c_z[3:6, 12:] = np.eye(3), 0.1 * np.eye(3)
    c_y = np.zeros((9, 15))
    c_y[:6, :6], c_y[6:, :12] = np.eye(6), moved[3:]
    order = np.arange(9).reshape(3, 3).T.ravel()  # angle, rate and acceleration of each axis
    d = np.zeros((18, 15))
    d[6:9, 12:] = 0.3 * np.eye(3)
    d[15:, :3], d[15:, 12:], d[9:, 3:12] = pushed[3:], pushed[3:], noise
    rows = np.concatenate([np.arange(9), 9 + order])
    system = LtiSystem(
        a, np.hstack([b, np.zeros((15, 9)), b]), np.vstack([c_z, c_y])[rows], d[rows]
    )
    return DesignPlant(system, name=f"spacecraft {seed}")


def many_plants(starts: int = 10) -> tuple[StructuredDesign, float]:
    """Return a design for ten spacecraft, 24 parameters, and its time, s."""
    ctx = RecordingContext(executor=Pool(PoolSpec()))
    structure = Diagonal([free_state_space(1, 1, 3) for _ in range(3)])
    begun = perf_counter()
    found = synthesise([spacecraft(i) for i in range(10)], structure, starts=starts, ctx=ctx)
    return found, perf_counter() - begun


def compare_active_plants() -> dict[str, float]:
    """Return CPU time with all plants in every step over that with the highest, and the worst γ.

    Of ten spacecraft, one start each of three seeds; γ relative to that with all plants.
    """
    plants = [spacecraft(i) for i in range(10)]
    structure = Diagonal([free_state_space(1, 1, 3) for _ in range(3)])
    few, times, gammas = active_plants._FEW, np.zeros((SEEDS, 2)), np.zeros((SEEDS, 2))
    try:
        for k in range(SEEDS):
            for i, active_plants._FEW in enumerate((few, len(plants))):
                begun = process_time()
                made = synthesise(
                    plants, structure, starts=1, seed=1 + k, effort="quick", shaken=False
                )
                times[k, i], gammas[k, i] = process_time() - begun, made.gamma
    finally:
        active_plants._FEW = few
    return {
        "highest_plants_speedup": float(times[:, 1].sum() / times[:, 0].sum()),
        "highest_plants_worst_gamma": float((gammas[:, 0] / gammas[:, 1]).max()),
    }


def figures() -> Mapping[str, float]:
    """Return the figures for ``run.py``."""
    if LONG not in os.environ:
        return {}
    active = compare_active_plants()
    found, seconds = many_plants()
    print(f"ten spacecraft: γ {found.gamma:.6g} ≥ {found.lower_bound:.6g}; starts", found.starts)
    return active | {
        "ten_plants_24_parameters_10_starts_s": seconds,
        "ten_plants_gamma": found.gamma,
        "ten_plants_lower_bound": found.lower_bound,
    }


def load(data: Mapping[str, Array], name: str) -> tuple[DesignPlant, FreeEntries]:
    """Return a plant of the collection and the structure of PLANT or PLANT:order."""
    plant, _, order = name.partition(":")
    a, b1, b, c1, c, d11, d12, d21 = (
        data[f"{plant}/{key}"] for key in ("A", "B1", "B", "C1", "C", "D11", "D12", "D21")
    )
    ny, nu = len(c), b.shape[1]
    d = np.block([[d11, d12], [d21, np.zeros((ny, nu))]])
    system = LtiSystem(a, np.hstack([b1, b]), np.vstack([c1, c]), d)
    return DesignPlant(system, name=name), free_state_space(int(order or 0), nu, ny)


def small_plants(data: Mapping[str, Array], order: int) -> list[str]:
    """Return the plants of an order at most, the smallest first."""
    sizes = {key.partition("/")[0]: len(data[key]) for key in data if key.endswith("/A")}
    return sorted((name for name, n in sizes.items() if n <= order), key=lambda n: (sizes[n], n))


def solve(data: Mapping[str, Array], name: str, options: argparse.Namespace) -> dict[str, Any]:
    """Return γ, its verdict, the γ of the starts alone, and the costs for a plant."""
    plant, structure = load(data, name)
    begun, cpu = perf_counter(), process_time()
    row: dict[str, Any] = {"name": name, "order": plant.system.order, "gamma": None, "rounds": 0}

    def stop(progress: Progress) -> None:
        if perf_counter() - begun > options.limit:
            raise Interrupted(f"{name}: the limit of {options.limit:g} s")

    # a reference is of rounds with other seeds, so that one that the limit ends has all routes too
    seeds = range(FIRST_SEED, FIRST_SEED + ROUNDS) if options.reference else [options.seed]
    for seed in seeds:
        try:
            found = synthesise(
                plant, structure, starts=options.starts, seed=seed, progress=stop,
                effort=ALL_ROUTES if options.reference else options.effort,
            )  # fmt: skip
        except (HillsphereError, Interrupted) as error:
            row["error"] = str(error)
        else:
            row["rounds"] += 1
            if row["gamma"] is None or found.gamma < row["gamma"]:
                row |= describe_design(found)
        if perf_counter() - begun > options.limit:
            break
    return row | {"cpu_s": process_time() - cpu, "wall_s": perf_counter() - begun}


def describe_design(found: StructuredDesign) -> dict[str, Any]:
    """Return what a row says of a design."""
    verdict = found.verdict
    return {
        "gamma": found.gamma,
        "starts_alone": float(np.min(np.append(found.starts, found.shaken))),
        "agreeing_starts": int(np.sum(found.starts <= found.starts.min() * (1.0 + AGREED))),
        "lower_bound": found.lower_bound,
        "full_order": verdict.full_order,
        "verdict": verdict.kind,
        "routes": dict(zip(verdict.routes, verdict.gammas.tolist(), strict=True)),
        "searches": dict(zip(verdict.routes, verdict.searches.tolist(), strict=True)),
        "interrupted": found.interrupted,
        "largest_parameter": float(np.abs(found.theta).max()),
        "evaluations": found.evaluations,
    }


def read_rows(path: str) -> dict[str, dict[str, Any]]:
    """Return the rows of a file of results by name, the last of each; none if there is no file."""
    if not os.path.exists(path):
        return {}
    with open(path, encoding="utf-8") as file:
        return {row["name"]: row for row in map(json.loads, file) if row}


def collection(options: argparse.Namespace) -> None:
    """Print γ, time and verdict for plants of a file; those in the file of results are done."""
    with np.load(options.path, allow_pickle=False) as archive:
        data = {key: archive[key] for key in archive.files}
    names = options.names or (
        small_plants(data, options.order) if options.order is not None else list(KNOWN)
    )
    rows = read_rows(options.results) if options.results else {}
    begun = perf_counter()
    for name in names:
        if name not in rows and perf_counter() - begun < options.total:
            rows[name] = solve(data, name, options)
            if options.results:
                with open(options.results, "a", encoding="utf-8") as file:
                    file.write(json.dumps(rows[name]) + "\n")
            print(describe(rows[name]), flush=True)
    if options.compare:
        compare(rows, [read_rows(path) for path in options.compare])


def describe(row: Mapping[str, Any]) -> str:
    """Return a row in a line."""
    name, gamma = row["name"], row["gamma"]
    if gamma is None:
        return f"{name:7s} order {row['order']:2d}  {row['error']}"
    known = KNOWN.get(name, np.nan)
    return (
        f"{name:7s} order {row['order']:2d}  γ {gamma:<10.6g} known {known:<10.6g} "
        f"{100.0 * (gamma / known - 1.0):+8.3f} %  starts alone "
        f"{100.0 * (row['starts_alone'] / gamma - 1.0):+8.3f} %  {row['verdict']:12s} "
        f"{row['cpu_s']:6.1f} s"
    )


def compare(rows: Mapping[str, Mapping[str, Any]], others: list[dict[str, dict[str, Any]]]) -> None:
    """Print by how much each γ is above the best that any file of results, or HIFOO, has."""
    within = wrong = 0
    missed: list[str] = []
    solved = {name: row for name, row in rows.items() if row["gamma"] is not None}
    for name, row in solved.items():
        others_best = [r[name]["gamma"] for r in others if r.get(name, {}).get("gamma")]
        best = min([row["gamma"], KNOWN.get(name, np.inf), *others_best])
        share = row["gamma"] / best - 1.0
        if share <= AGREED:
            within += 1
            continue
        wrong += row["verdict"] in ("confirmed", "best")
        missed.append(f"  {name:7s} {100.0 * share:+.3f} % above {best:.6g}, {row['verdict']}")
    print(f"{within} of {len(solved)} within {100.0 * AGREED:g} % of the best known")
    print("\n".join(missed))
    print(f"{wrong} of the {len(missed)} others were called confirmed")


def main() -> None:
    """Run the collection."""
    parser = argparse.ArgumentParser(description="a collection of plants")
    parser.add_argument("path", help=".npz file of the plants")
    parser.add_argument("names", nargs="*", help="PLANT or PLANT:order; left out: those of HIFOO")
    parser.add_argument("--order", type=int, help="all plants of this order at most, static")
    parser.add_argument("--starts", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--effort", default="normal", choices=list(EFFORTS))
    parser.add_argument(
        "--reference", action="store_true",
        help=f"{ROUNDS} rounds of other seeds: 200 starts and as many searches by other routes",
    )  # fmt: skip
    parser.add_argument("--limit", type=float, default=np.inf, help="s for one plant")
    parser.add_argument("--total", type=float, default=np.inf, help="s after which no plant begins")
    parser.add_argument("--results", help="file of a JSON row for each plant; the run is resumed")
    parser.add_argument("--compare", nargs="*", help="files of results to compare these with")
    collection(parser.parse_args())


if __name__ == "__main__":
    main()
