"""A scan of invariant manifolds: 2000 trajectories of each of four branches over 10 days, one core.

Both sides of the unstable and the stable manifold of a 1:17 orbit about Phobos, with the crossings
of the plane z = 0 and of two cylinders, impact, and the moment at which each trajectory leaves its
orbit. Beside it the Taylor propagator with the same events, timed on a few of the trajectories, is
what the step map is chosen over; and SciPy's DOP853 with a numpy right-hand side and event
functions, timed on one.

Time is CPU time of this process; compiled code is in the cache.
"""

from __future__ import annotations

from time import process_time
from typing import Any

import numpy as np
from bench_engine import GM, numpy_rate
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from hillsphere import create
from hillsphere.dynamics import Taylor
from hillsphere.products import OrbitSet, PeriodicOrbits
from hillsphere.testing import RecordingContext
from hillsphere_orbits.flow import flow_of

Array = NDArray[np.float64]
TRAJECTORIES = 2000
DAYS = 10.0
AFTER = 9.4  # days after a trajectory has left its orbit; before, it flies beside it for some days
DAY = 86400.0
CYLINDERS_KM = (100.0, 30.0)
# 1:17 at 70 km: x0, vy0 and period, normalised
X0, VY0, PERIOD = 1.435320509108, -2.977099929327, 99.20298576821
FEW = 40  # trajectories that the Taylor propagator flies


def plant() -> Any:
    """Return the circular Hill problem about the ellipsoid of the QSO paper."""
    body = create(
        "body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0, name="phobos"
    )
    gravity = create("gravity", "ellipsoid", axes_km=[13.03, 11.40, 9.14], gm_m3_s2=GM)
    return create("plant", "hill", body=body, gravity=gravity)


def orbit(equations: Any) -> OrbitSet:
    """Return the unstable orbit as a product."""
    flow, scales = flow_of(equations), equations.scales
    x0 = np.array([[X0, 0.0, 70e3 / scales.length_m, 0.0, VY0, 0.0]]).T
    _, monodromy = flow.with_matrix(x0, PERIOD, 1400)
    return OrbitSet(
        PeriodicOrbits(
            frame=flow.system.frame,
            states=flow.names,
            x0=x0 * flow.system.unit[:, None],
            period_s=np.array([PERIOD * scales.time_s]),
            integral=np.array([np.nan]),
            monodromy=monodromy,
            residual=np.zeros(1),
            labels=("1:17, 70 km",),
            length_m=scales.length_m,
            time_s=scales.time_s,
        )
    )


def taylor_seconds(equations: Any, starts: Array) -> float:
    """CPU seconds per trajectory of the Taylor propagator with the same events."""
    flow = flow_of(equations)
    x, y, z = flow.system.x[:3]
    unit = equations.scales.length_m
    record = {"plane": z}
    for radius in CYLINDERS_KM:
        record[f"cylinder {radius:g}"] = x * x + y * y - (radius * 1e3 / unit) ** 2
    taylor = Taylor(flow.system, events=("impact",), record=record)
    duration = DAYS * DAY / equations.scales.time_s
    taylor.fly(starts[:, :4], 0.1)
    begin = process_time()
    taylor.fly(starts[:, :FEW], duration)
    return (process_time() - begin) / FEW


def scipy_seconds(equations: Any, start: Array) -> float:
    """CPU seconds of SciPy's DOP853 for one trajectory with the same events."""
    unit = equations.scales.length_m

    def plane(t: float, y: Array) -> float:
        return float(y[2])

    def outer(t: float, y: Array) -> float:
        return float(y[0] ** 2 + y[1] ** 2 - (CYLINDERS_KM[0] * 1e3 / unit) ** 2)

    def inner(t: float, y: Array) -> float:
        return float(y[0] ** 2 + y[1] ** 2 - (CYLINDERS_KM[1] * 1e3 / unit) ** 2)

    def rate(t: float, y: Array) -> Array:
        return np.asarray(numpy_rate(t, np.concatenate([y, np.zeros(36)]))[:6])

    duration = DAYS * DAY / equations.scales.time_s
    begin = process_time()
    solve_ivp(
        rate, (0.0, 0.1 * duration), start, method="DOP853", rtol=1e-11, atol=1e-11,
        events=(plane, outer, inner),
    )  # fmt: skip
    return 10.0 * (process_time() - begin)


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    equations = plant()
    given = orbit(equations)

    def stage(count: int) -> Any:
        return create(
            "stage", "invariant_manifolds", plant=equations, needs={"orbits": ["orbits"]},
            trajectories=count, duration_d=AFTER, cylinders_km=list(CYLINDERS_KM),
            start_distance=9e-4,
        )  # fmt: skip

    stage(4).run(RecordingContext(), orbits=(given,))  # compiles
    begin = process_time()
    product = stage(TRAJECTORIES).run(RecordingContext(), orbits=(given,))
    elapsed = process_time() - begin
    count = len(product.ended_by)
    own = product.met_event == 0
    unit = np.asarray(flow_of(equations).system.unit)[:, None]
    starts = np.ascontiguousarray(product.start / unit)
    taylor, scipy = taylor_seconds(equations, starts), scipy_seconds(equations, starts[:, 0])
    flown = np.abs(product.end_time_s - product.start_time_s)
    return {
        "scan_cpu_s": elapsed,
        "days_flown_mean": float(np.mean(flown)) / DAY,
        "trajectories": count,
        "events_met": product.met_trajectory.size,
        "largest_z_at_the_plane_m": float(np.max(np.abs(product.met[2, own]))),
        "faster_than_taylor": taylor * count / elapsed,
        "faster_than_scipy": scipy * count / elapsed,
    }


if __name__ == "__main__":
    for figure, number in figures().items():
        print(f"{figure:<40} {number:12.4g}")
