"""Flights of the Hill problem beside other propagators, one core.

512 flights of 40 units of time from the same states: regular quasi-satellite orbits, and flights
with one close pass half-way, whose numbers of steps differ by a factor of a hundred.

Equal accuracy, point mass, no events: each propagator has its loosest tolerance, or its fewest
equal steps, with which nine flights in ten end within 1e-9 of the reference, relative to the
largest state; ours is the step map or Taylor, whichever takes less time for it. heyoka is
driven directly, in its best of three numbers of lanes: with the flights in their order, and sorted
by the numbers of steps that it takes for them, which one would have to know beforehand. numba flies
lanes together in equal steps on the regular set, and flight by flight on the other, where equal
steps do not reach the accuracy. SciPy flies eight of the flights.

Equal tolerance: Taylor beside heyoka's batch mode, also with an impact that ends a flight and a
plane whose crossings are recorded, and with the field of an ellipsoid.

The ratios are medians of paired repeats of CPU time; `--long` adds diffrax.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere import create
from hillsphere.dynamics import StepMap, System, Taylor, system

sys.path.insert(0, str(Path(__file__).resolve().parent))

from lane_peers import (
    Fly,
    diffrax_flights,
    heyoka_batch,
    hill_equations,
    numba_flights,
    scipy_flights,
)

Array = NDArray[np.float64]
FLIGHTS = 512
SCIPY_FLIGHTS = 8
DURATION = 40.0
TOLERANCE = 1e-13
ACCURACY = 1e-9
WITHIN = 0.9
TOLERANCES = (1e-8, 1e-9, 1e-10, 1e-11, 1e-12, 1e-13, 1e-14)
STEPS = (250, 300, 350, 400, 500, 600, 800, 1000, 1400, 2000, 3000)
WIDTHS = (4, 8, 16)
LANES = 8
RADIUS = 0.03
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


def seconds(function: Callable[[], object]) -> float:
    """Return the CPU time of one call."""
    begin = process_time()
    function()
    return process_time() - begin


def paired(ours: Callable[[], object], theirs: Callable[[], object]) -> tuple[float, float, float]:
    """Return our median time, s, and the median and lowest ratio of theirs to it."""
    pairs = [(seconds(ours), seconds(theirs)) for _ in range(REPEATS)]
    ratios = [b / a for a, b in pairs]
    return median(a for a, _ in pairs), median(ratios), min(ratios)


def first_exact(choices: Iterable[Any], make: Callable[[Any], Fly], x: Array, exact: Array) -> Any:
    """Return the first (choice, flights) that reach the accuracy, or None."""
    for choice in choices:
        fly = make(choice)
        end = fly(x)
        errors = np.abs(end - exact[:, : x.shape[1]]).max(axis=0) / np.abs(end).max(axis=0)
        if np.quantile(errors, WITHIN) <= ACCURACY:
            return choice, fly
    return None


def at_equal_accuracy(name: str, equations: System, x: Array) -> dict[str, float]:
    """Return the figures of one set without events."""
    exact = Taylor(equations, 1e-15).propagate(x, DURATION)
    found: dict[str, float] = {}

    def taylor(tolerance: float) -> Fly:
        propagator = Taylor(equations, tolerance)
        return lambda start: propagator.propagate(start, DURATION)

    step_map = StepMap(equations)

    def stepped(steps: int) -> Fly:
        return lambda start: step_map.propagate(start, DURATION, steps)

    # Ours is the cheaper of the two methods that reach the accuracy.
    methods = (("steps", STEPS, stepped), ("tolerance", TOLERANCES, taylor))
    exact_ones = [
        (seconds(lambda fly=one[1]: fly(x)), what, *one)  # type: ignore[misc]
        for what, choices, make in methods
        if (one := first_exact(choices, make, x, exact))
    ]
    _, what, choice, ours = min(exact_ones, key=lambda one: one[0])
    found[f"{name}_{what}"] = choice
    rate = hill_equations()

    def batch(tolerance: float) -> Fly:
        return heyoka_batch(rate, DURATION, tolerance, LANES)[0]

    tolerance, _ = first_exact(TOLERANCES, batch, x, exact)
    best, order = None, np.arange(FLIGHTS)
    for width in WIDTHS:
        fly, steps = heyoka_batch(rate, DURATION, tolerance, width)
        order = np.argsort(steps(x), kind="stable")
        time = min(seconds(lambda fly=fly: fly(x)) for _ in range(3))  # type: ignore[misc]
        if best is None or time < best[0]:
            best = time, width, fly
    assert best is not None
    found[f"{name}_heyoka_tolerance"], found[f"{name}_heyoka_lanes"] = tolerance, best[1]
    in_order, sorted_x = best[2], np.ascontiguousarray(x[:, order])
    peers: dict[str, tuple[Fly, Array]] = {
        "heyoka_in_order": (in_order, x), "heyoka_sorted": (in_order, sorted_x),
    }  # fmt: skip
    numba = numba_flights(DURATION)
    if numba is None:
        print("  numba is not installed: not compared")
    else:
        choices, make = (STEPS, numba[1]) if name == "regular" else (TOLERANCES, numba[0])
        choice, fly = first_exact(choices, make, x, exact)
        found[f"{name}_numba_{'steps' if name == 'regular' else 'tolerance'}"] = choice
        peers["numba"] = (fly, x)
    if os.environ.get("HILLSPHERE_BENCHMARK_LONG"):
        diffrax = diffrax_flights(DURATION)
        if diffrax is None:
            print("  diffrax is not installed: not compared")
        else:
            peers["diffrax"] = (first_exact(TOLERANCES, diffrax, x, exact)[1], x)
    for peer, (fly, start) in peers.items():
        mine, ratio, lowest = paired(lambda: ours(x), lambda fly=fly, s=start: fly(s))  # type: ignore[misc]
        found[f"{name}_exact_us_per_flight"] = mine / FLIGHTS * 1e6
        found[f"{name}_faster_than_{peer}"] = ratio
        found[f"{name}_faster_than_{peer}_lowest"] = lowest
    few = np.ascontiguousarray(x[:, :SCIPY_FLIGHTS])
    _, slow = first_exact(
        TOLERANCES, lambda tolerance: scipy_flights(DURATION, tolerance), few, exact
    )
    found[f"{name}_faster_than_scipy"] = (
        seconds(lambda: slow(few)) / SCIPY_FLIGHTS / (mine / FLIGHTS)
    )
    return found


def at_equal_tolerance(
    name: str, equations: System, rate: list[tuple[Any, Any]], x: Array, events: bool
) -> dict[str, float]:
    """Return the figures of Taylor beside heyoka's batch mode."""
    px, py, pz = equations.x[:3]
    impact = px * px + py * py + pz * pz - RADIUS**2
    if events:
        watched: Any = replace(equations, events={"impact": impact})
        ours = Taylor(watched, TOLERANCE, events=["impact"], record={"plane": py})
    else:
        ours = Taylor(equations, TOLERANCE)
    fly, _ = heyoka_batch(rate, DURATION, TOLERANCE, LANES, (impact, py) if events else None)
    end, other = ours.propagate(x, DURATION), fly(x)
    errors = np.abs(end - other).max(axis=0) / np.abs(end).max(axis=0)
    mine, ratio, lowest = paired(lambda: ours.propagate(x, DURATION), lambda: fly(x))
    return {
        f"{name}_us_per_flight": mine / FLIGHTS * 1e6,
        f"{name}_faster_than_heyoka_batch": ratio,
        f"{name}_lowest_ratio": lowest,
        f"{name}_difference_median": float(np.median(errors)),
    }


def figures() -> dict[str, float]:
    """Return the figures, for benchmarks/run.py."""
    packages = ("heyoka", "numba", "scipy", "numpy")
    print("  " + ", ".join(f"{name} {_version(name)}" for name in packages))
    body = create(
        "body", "moon", primary_gm_km3_s2=42828.37, semi_major_axis_km=9377.0, name="phobos"
    )
    point = create("gravity", "point_mass", gm_m3_s2=7.0875e5)
    solid = create("gravity", "ellipsoid", gm_m3_s2=7.0875e5, axes_km=[0.13, 0.114, 0.0914])
    equations, shaped = (
        system(create("plant", "hill", body=body, gravity=gravity), normalised=True)
        for gravity in (point, solid)
    )
    rng = np.random.default_rng(3)
    sets = {"regular": regular(rng), "close": close(rng, Taylor(equations, tol=TOLERANCE))}
    rate, on_ellipsoid = hill_equations(), list(zip(shaped.x, shaped.rhs, strict=True))
    found: dict[str, float] = {}
    for name, x in sets.items():
        found |= at_equal_accuracy(name, equations, x)
        found |= at_equal_tolerance(name, equations, rate, x, False)
        found |= at_equal_tolerance(f"{name}_with_events", equations, rate, x, True)
        found |= at_equal_tolerance(f"{name}_ellipsoid", shaped, on_ellipsoid, x, False)
    return found


def _version(package: str) -> str:
    try:
        return version(package)
    except ModuleNotFoundError:
        return "not installed"


if __name__ == "__main__":
    for figure, number in figures().items():
        print(f"{figure:<40} {number:12.4g}")
