"""Eleven families of orbits in space, 1:17 to 1:27 to 120 km: one core, beside a SciPy loop.

The stage follows all families in lockstep and returns their orbits with multipliers, windows of
stability, secondary bifurcations and closure by Taylor series. What a user would write instead
follows one family at a time: half a period with SciPy's DOP853 and the 42 variational equations in
numpy, Newton's correction on a tangent prediction, one orbit after the other. It is timed on the
first orbits of one family and scaled by the number of orbits that the stage returns along the
curves, which favours it: it neither checks nor judges them.

Time is CPU time of this process, so that a busy machine hardly counts; compiled code is in the
cache, and other threads would count as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from time import process_time
from typing import Any

import numpy as np
from bench_engine import GM, LENGTH, MEAN_MOTION, numpy_rate
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hillsphere import create
from hillsphere.products import Bifurcations
from hillsphere.testing import RecordingContext

Array = NDArray[np.float64]
ORDERS = range(17, 28)
AMPLITUDES_KM = (70, 80, 90, 100, 110, 120)
STEPS = 3  # orbits that the plain loop computes
TOLERANCE = 1e-9  # of the plain loop; the stage's orbits are good to 1e-10


def plant() -> Any:
    """Return the circular Hill problem about the ellipsoid of the QSO paper."""
    body = create(
        "body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0, name="phobos"
    )
    gravity = create("gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], gm_m3_s2=GM)
    return create("plant", "hill", body=body, gravity=gravity)


def bifurcations(equations: Any) -> Bifurcations:
    """Return the vertical bifurcations that the families start from."""
    family = create(
        "stage", "qso_family", plant=equations, x_amplitudes_km=[50], x_min_km=40, x_max_km=60,
        drift_revolutions=1, curve_members=41,
    )  # fmt: skip
    stage = create(
        "stage", "bifurcations", plant=equations, needs={"family": "family"},
        vertical=[f"1:{n}" for n in ORDERS],
    )  # fmt: skip
    found = stage.run(RecordingContext(), family=family.run(RecordingContext()))
    assert isinstance(found, Bifurcations)
    return found


def half_period(z: Array) -> tuple[Array, Array]:
    """Return (y, vx, vz) after half a period and their derivatives by (x, z, vy, half period)."""
    start = np.array([z[0], 0.0, z[1], 0.0, z[2], 0.0])
    y0 = np.concatenate([start, np.eye(6).ravel()])
    end = solve_ivp(numpy_rate, (0.0, z[3]), y0, method="DOP853", rtol=TOLERANCE, atol=TOLERANCE).y[
        :, -1
    ]
    rate = numpy_rate(0.0, end)[:6]
    odd, free = [1, 3, 5], [0, 2, 4]
    slopes = np.concatenate([end[6:].reshape(6, 6)[np.ix_(odd, free)], rate[odd, None]], axis=1)
    return end[odd], slopes


def plain_loop(z: Array) -> float:
    """Return the seconds per orbit of continuation from a member z (4,)."""
    begin = process_time()
    _, slopes = half_period(z)
    step = 0.1
    for _ in range(STEPS):
        line = np.linalg.svd(slopes)[2][-1]
        line = line if line[1] > 0.0 else -line
        foot = z = z + step * line
        for _ in range(8):
            values, slopes = half_period(z)
            residual = np.append(values, line @ (z - foot))
            if float(np.max(np.abs(residual))) < 1e-8:
                break
            z = z - np.linalg.solve(np.vstack([slopes, line]), residual)
    return (process_time() - begin) / STEPS


def figures() -> Mapping[str, float]:
    """Return the figures, for benchmarks/run.py."""
    equations = plant()
    where = bifurcations(equations)
    stage = create(
        "stage", "spatial_qso_families", plant=equations, needs={"bifurcations": "bifurcations"},
        z_amplitudes_km=list(AMPLITUDES_KM),
    )  # fmt: skip
    begin = process_time()
    found = stage.run(RecordingContext(), bifurcations=where)
    elapsed = process_time() - begin
    orbits = found.curve_z_m.size + found.member_z_m.size
    first = np.flatnonzero(found.curve_family == 5)[4]
    x = found.curve.x0[:, first] / LENGTH
    z = np.array([x[0], x[2], x[4] / MEAN_MOTION, 0.5 * found.curve.period_s[first] * MEAN_MOTION])
    each = plain_loop(z)
    return {
        "eleven_families_cpu_s": elapsed,
        "families_followed": float(len(set(found.curve_family.tolist()))),
        "orbits": float(orbits),
        "half_closure_max": float(found.curve_half_residual.max()),
        "ms_per_orbit": 1e3 * elapsed / orbits,
        "scipy_ms_per_orbit": 1e3 * each,
        "faster_than_scipy_loop": each * orbits / elapsed,
    }


if __name__ == "__main__":
    for figure, number in figures().items():
        print(f"{figure:<40} {number:12.4g}")
