"""Closed-loop campaign: 2000 flights of 133 samples of 60 s in a dispersed harmonic field.

A spacecraft is brought to a point over a Phobos-like moon and held there (Hill's problem,
harmonics of degree 4 whose coefficients differ from case to case) by a linear compensator of nine
states: discretised and held, then with its states, a filter of 0.05 Hz among them, inside the
equations. SciPy flies some of the cases with the same gravity, compiled, and the same compensator.
"""

from __future__ import annotations

from math import pi
from time import perf_counter, process_time

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hillsphere.dynamics import system
from hillsphere.model.bodies import Moon, MoonSpec
from hillsphere.simulation import BLOCK, Cases, Simulator
from hillsphere.spec import Ref
from hillsphere_controllers.specs import StateSpaceSpec
from hillsphere_controllers.state_space import state_space, zero_order_hold_matrices
from hillsphere_gravity.harmonics import Harmonics
from hillsphere_gravity.specs import HarmonicsSpec
from hillsphere_plants.hill import Hill
from hillsphere_plants.specs import HillSpec

Array = NDArray[np.float64]
CASES, SAMPLES, PERIOD = 2000, 133, 60.0
SUBSTEPS_WITH_FILTER = 6
BY_SCIPY = 3
# Chao, Rubincam (1989), Geophysical Research Letters 16(8), 859: fully normalised, times 100.
ROWS = (
    (2, 0, -4.698, 0.0), (2, 1, 0.136, 0.138), (2, 2, 2.276, -0.0202), (3, 0, 0.293, 0.0),
    (3, 1, -0.309, 0.181), (3, 2, -0.847, -0.0655), (3, 3, 0.224, -1.392), (4, 0, 0.762, 0.0),
    (4, 1, 0.347, -0.0776), (4, 2, -0.288, -0.112), (4, 3, -0.280, 0.337), (4, 4, -0.120, -0.0622),
)  # fmt: skip


def plant() -> Hill:
    """Hill's problem in the field of the moon."""
    field = Harmonics(
        HarmonicsSpec.model_validate(
            {
                "gm_m3_s2": 7.0875e5,
                "reference_radius_m": 11.1e3,
                "normalisation": "full",
                "tide_system": "none",
                "coefficients": [
                    {"n": n, "m": m, "c": c / 100, "s": s / 100} for n, m, c, s in ROWS
                ],
            }
        )
    )
    moon = Moon(
        MoonSpec(
            primary_gm_m3_s2=4.282837e13,
            semi_major_axis_m=9377e3,
            semi_axes_m=(13030.0, 11400.0, 9140.0),
        )
    )
    return Hill(HillSpec(body=Ref("moon", moon), gravity=Ref("field", field)))


def matrices(bandwidth: float) -> dict[str, list[list[float]]]:
    """Integral action and filtered position and velocity errors: nine states, continuous form."""
    eye, zero = np.eye(3), np.zeros((3, 3))
    low = bandwidth * eye
    a = np.block([[zero, eye, zero], [zero, -low, zero], [zero, zero, -low]])
    b = np.block([[zero, zero], [low, zero], [zero, low]])
    c = np.block([2e-8 * eye, 2.5e-5 * eye, 0.0075 * eye])
    return {"a": a.tolist(), "b": b.tolist(), "c": c.tolist()}


def simulator(moon: Hill, *, inside: bool) -> Simulator:
    """Return the loop, with the compensator discretised or its states in the equations."""
    table = {"period_s": PERIOD, "form": "continuous", **matrices(2 * pi * 0.05)}
    spec = StateSpaceSpec.model_validate(table | {"states": "continuous" if inside else "sampled"})
    return Simulator(
        moon,
        state_space(spec),
        reference=TARGET,
        run_time=COEFFICIENTS,
        method="dop853" if inside else "rk6",
        substeps=SUBSTEPS_WITH_FILTER if inside else 1,
    )


COEFFICIENTS = [f"gravity.{k}{n},{m}" for n, m, _, _ in ROWS for k in "CS" if k == "C" or m > 0]
TARGET = np.array([20e3, 0.0, 0.0, 0.0, 0.0, 0.0])


def dispersed(moon: Hill) -> Cases:
    """2000 starts and coefficients."""
    random = np.random.default_rng(1)
    size = np.array([200.0, 200.0, 200.0, 0.01, 0.01, 0.01])[:, None]
    nominal = {q.name: q.value for q in moon.parameters()}
    values = np.array([nominal[name] for name in COEFFICIENTS])[:, None]
    return Cases(
        x0=TARGET[:, None] + size * random.normal(size=(6, CASES)),
        p=values * (1.0 + random.normal(size=(len(values), CASES))),
    )


def by_scipy(moon: Hill, cases: Cases, case: int, *, inside: bool) -> Array:
    """Fly one case with SciPy's DOP853 and the same compensator, sample by sample."""
    equations = system(moon, run_time=COEFFICIENTS, controls=True)
    rate = equations.function(*equations.rhs)
    a, b, c = (np.array(m) for m in matrices(2 * pi * 0.05).values())
    ad, bd = zero_order_hold_matrices(a, b, PERIOD)
    p = np.asarray(cases.p)[:, case]
    y = np.concatenate([np.asarray(cases.x0)[:, case], np.zeros(9)])

    def held(t: float, y: Array, values: Array, error: Array) -> Array:
        return rate(y, values)

    def moving(t: float, y: Array, values: Array, error: Array) -> Array:
        values[-3:] = c @ y[6:]
        return np.concatenate([rate(y[:6], values), a @ y[6:] + b @ error])

    for k in range(SAMPLES):
        error = TARGET - y[:6]
        arguments = (np.concatenate([p, c @ y[6:]]), error)
        n = 15 if inside else 6
        end = solve_ivp(
            moving if inside else held, (k * PERIOD, (k + 1) * PERIOD), y[:n],
            method="DOP853", rtol=1e-10, atol=1e-7, args=arguments,
        ).y[:, -1]  # fmt: skip
        y = end if inside else np.concatenate([end, ad @ y[6:] + bd @ error])
    return y[:6]


def in_blocks(loop: Simulator, cases: Cases) -> float:
    """Fly the cases 64 at a time, as a campaign does; return the CPU time of the best of five."""
    lanes = [np.minimum(np.arange(k, k + BLOCK), CASES - 1) for k in range(0, CASES, BLOCK)]
    x0, p = np.asarray(cases.x0), np.asarray(cases.p)
    blocks = [Cases(np.ascontiguousarray(x0[:, k]), np.ascontiguousarray(p[:, k])) for k in lanes]
    times = []
    for _ in range(5):
        begin = process_time()
        for block in blocks:
            loop.fly(block, SAMPLES)
        times.append(process_time() - begin)
    return min(times)


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    moon = plant()
    cases = dispersed(moon)
    found: dict[str, float] = {}
    for name, inside in (("held", False), ("filter_inside", True)):
        begin = perf_counter()
        loop = simulator(moon, inside=inside)
        found[f"{name}_compile_s"] = perf_counter() - begin
        times = []
        for _ in range(5):
            begin = process_time()
            flights = loop.fly(cases, SAMPLES)
            times.append(process_time() - begin)
        found[f"{name}_2000_flights_cpu_s"] = min(times)
        found[f"{name}_2000_flights_in_blocks_cpu_s"] = in_blocks(loop, cases)
        found[f"{name}_completed"] = flights.counts().get("completed", 0)
        begin = process_time()
        other = [by_scipy(moon, cases, case, inside=inside) for case in range(BY_SCIPY)]
        per_case = (process_time() - begin) / BY_SCIPY
        found[f"{name}_scipy_s_per_flight"] = per_case
        found[f"{name}_speedup"] = per_case * CASES / min(times)
        difference = np.array(other).T[:3] - flights.x[:3, :BY_SCIPY]
        found[f"{name}_position_difference_m"] = float(np.abs(difference).max())
    return found


if __name__ == "__main__":
    for figure, number in figures().items():
        print(f"{figure:<40} {number:12.4g}")
