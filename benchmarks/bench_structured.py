"""Fixed-structure H∞ synthesis: one controller for ten plants; and a collection of plants.

    python benchmarks/run.py structured --long          # ten spacecraft, 10 starts, all processors
    python benchmarks/bench_structured.py PATH          # the collection in a .npz file
    python benchmarks/bench_structured.py PATH AC2 HE1:2 --starts 4

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
import os
from collections.abc import Mapping
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from hillsphere.cases.executors.pool import Pool
from hillsphere.cases.executors.specs import PoolSpec
from hillsphere.lti import LtiSystem
from hillsphere.testing import RecordingContext
from hillsphere_controllers.structured.requirements import DesignPlant
from hillsphere_controllers.structured.structure import Diagonal, free_state_space
from hillsphere_controllers.structured.synthesis import StructuredDesign, synthesise

Array = NDArray[np.float64]
LONG = "HILLSPHERE_BENCHMARK_LONG"

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


def figures() -> Mapping[str, float]:
    """Return the figures for ``run.py``."""
    if LONG not in os.environ:
        return {}
    found, seconds = many_plants()
    print(f"ten spacecraft: γ {found.gamma:.6g} ≥ {found.lower_bound:.6g}; starts", found.starts)
    return {
        "ten_plants_24_parameters_10_starts_s": seconds,
        "ten_plants_gamma": found.gamma,
        "ten_plants_lower_bound": found.lower_bound,
    }


def collection(path: str, names: list[str], starts: int) -> None:
    """Print γ, time and spread for plants of a file."""
    data = np.load(path, allow_pickle=False)
    near, within = 0, 0
    for name in names:
        plant, _, order = name.partition(":")
        a, b1, b, c1, c, d11, d12, d21 = (
            data[f"{plant}/{key}"] for key in ("A", "B1", "B", "C1", "C", "D11", "D12", "D21")
        )
        ny, nu = len(c), b.shape[1]
        d = np.block([[d11, d12], [d21, np.zeros((ny, nu))]])
        system = LtiSystem(a, np.hstack([b1, b]), np.vstack([c1, c]), d)
        begun = perf_counter()
        found = synthesise(
            DesignPlant(system), free_state_space(int(order or 0), nu, ny), starts=starts
        )
        seconds, known = perf_counter() - begun, KNOWN.get(name, np.nan)
        share = found.gamma / known - 1.0
        near, within = near + (not share > 1e-3), within + (not share > 1e-2)
        low, middle = np.quantile(found.starts, [0.0, 0.5])
        print(
            f"{name:7s} order {len(a):2d}  γ {found.gamma:<10.6g} known {known:<10.6g} "
            f"{100.0 * share:+8.3f} %  starts {low:.6g}, median {middle:.6g}  {seconds:6.1f} s",
            flush=True,
        )
    print(f"{near} of {len(names)} within 0.1 % of the known value, {within} within 1 %")


def main() -> None:
    """Run the collection."""
    parser = argparse.ArgumentParser(description="a collection of plants")
    parser.add_argument("path", help=".npz file of the plants")
    parser.add_argument("names", nargs="*", default=list(KNOWN), help="PLANT or PLANT:order")
    parser.add_argument("--starts", type=int, default=10)
    options = parser.parse_args()
    collection(options.path, options.names, options.starts)


if __name__ == "__main__":
    main()
