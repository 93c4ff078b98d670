"""Taylor flights of the point-mass Hill problem beside heyoka's own batch mode, one core.

512 flights of 40 units of time from the same states with the same tolerance, without events:
regular quasi-satellite orbits, and flights with one close pass half-way, whose numbers of steps
differ by a factor of a hundred. heyoka is driven directly, eight lanes at a time in the order of
the flights. The ratios are medians of seven paired repeats of CPU time.
"""

from __future__ import annotations

from collections.abc import Callable
from statistics import median
from time import process_time
from typing import Any

import heyoka
import numpy as np
from numpy.typing import NDArray

from hillsphere import create
from hillsphere.dynamics import Taylor, system

Array = NDArray[np.float64]
FLIGHTS = 512
DURATION = 40.0
TOLERANCE = 1e-13
LANES = 8
REPEATS = 7


def regular(rng: np.random.Generator) -> Array:
    """Return starts (6, N) of quasi-satellite orbits, normalised."""
    x = np.zeros((6, FLIGHTS))
    x[0] = rng.uniform(1.0, 4.0, FLIGHTS)
    x[2] = rng.uniform(-0.2, 0.2, FLIGHTS)
    x[4] = -2.0 * x[0] * rng.uniform(0.98, 1.02, FLIGHTS) - 0.3 / x[0] ** 2
    return x


def close(rng: np.random.Generator, taylor: Taylor) -> Array:
    """Return starts (6, N) from which flights pass at 0.01 to 0.2 after half their duration."""
    radius = 10.0 ** rng.uniform(-2.0, -0.7, FLIGHTS)
    angle, tilt = rng.uniform(0.0, 2.0 * np.pi, FLIGHTS), rng.uniform(-0.5, 0.5, FLIGHTS)
    place = radius * np.array([np.cos(angle), np.sin(angle), np.zeros(FLIGHTS)])
    across = np.array([-np.sin(angle) * np.cos(tilt), np.cos(angle) * np.cos(tilt), np.sin(tilt)])
    across *= rng.choice([-1.0, 1.0], FLIGHTS)
    jacobi = rng.uniform(-1.0, 4.0, FLIGHTS)
    speed = np.sqrt(2.0 / radius + 3.0 * place[0] ** 2 - place[2] ** 2 - jacobi)
    start: Array = taylor.propagate(np.concatenate([place, across * speed]), -0.5 * DURATION)
    return start


def peer() -> Callable[[Array], Array]:
    """Return heyoka's batch mode on starts (6, N)."""
    x, y, z, vx, vy, vz = heyoka.make_vars("x", "y", "z", "vx", "vy", "vz")
    pull = (x * x + y * y + z * z) ** -1.5
    rate = [
        (x, vx), (y, vy), (z, vz), (vx, 2.0 * vy + 3.0 * x - x * pull),
        (vy, -2.0 * vx - y * pull), (vz, -z - z * pull),
    ]  # fmt: skip
    integrator: Any = heyoka.taylor_adaptive_batch(rate, np.zeros((6, LANES)), tol=TOLERANCE)

    def fly(start: Array) -> Array:
        end = np.empty_like(start)
        for k in range(0, start.shape[1], LANES):
            integrator.state[:] = start[:, k : k + LANES]
            integrator.set_time(0.0)
            integrator.propagate_until(DURATION)
            end[:, k : k + LANES] = integrator.state
        return end

    return fly


def seconds(function: Callable[[], object]) -> float:
    """Return the CPU time of one call."""
    begin = process_time()
    function()
    return process_time() - begin


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    print(f"  heyoka {heyoka.__version__}")
    body = create(
        "body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0, name="phobos"
    )
    gravity = create("gravity", "point_mass", gm_m3_s2=7.0875e5)
    equations = system(create("plant", "hill", body=body, gravity=gravity), normalised=True)
    ours, theirs = Taylor(equations, tol=TOLERANCE), peer()
    rng = np.random.default_rng(3)
    found = {}
    for name, start in (("regular", regular(rng)), ("close", close(rng, ours))):
        end, other = ours.propagate(start, DURATION), theirs(start)
        errors = np.abs(end - other).max(axis=0) / np.abs(end).max(axis=0)
        pairs = [
            (
                seconds(lambda x=start: ours.propagate(x, DURATION)),
                seconds(lambda x=start: theirs(x)),
            )  # type: ignore[misc]
            for _ in range(REPEATS)
        ]
        ratios = sorted(b / a for a, b in pairs)
        found[f"{name}_us_per_flight"] = median(a for a, _ in pairs) / FLIGHTS * 1e6
        found[f"{name}_faster_than_heyoka_batch"] = median(ratios)
        found[f"{name}_lowest_ratio"] = ratios[0]
        found[f"{name}_difference_median"] = float(np.median(errors))
    return found


if __name__ == "__main__":
    for figure, number in figures().items():
        print(f"{figure:<40} {number:12.4g}")
