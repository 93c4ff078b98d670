"""How the cost of finding passes grows with the number of satellites; prints a table, draws it.

    python benchmarks/growth_of_passes.py                       # prints
    python benchmarks/growth_of_passes.py docs/images/passes-growth.svg

CPU times of `find_all_passes` with its tracks, ten stations and a day, the shortest of three runs.
The exponent is the slope of a straight line through the logarithms, from ten satellites on.
"""

from __future__ import annotations

import sys
from math import pi, radians
from time import process_time

import numpy as np
from bench_tracking import element_sets, find_ours

from hillsphere.base.geodetic import Station
from hillsphere_tracking.satellites import orbits_of

COUNTS = (1, 3, 10, 30, 100, 300, 1000)
STATIONS, DAYS = 10, 1.0


def measure() -> tuple[np.ndarray, np.ndarray]:
    """Return CPU times, s, and numbers of passes' ends, one for each number of satellites."""
    random = np.random.default_rng(3)
    stations = [
        Station(f"{k}", radians(random.uniform(-70.0, 70.0)), random.uniform(-pi, pi), 100.0)
        for k in range(STATIONS)
    ]
    cpu, events = [], []
    for count in COUNTS:
        orbits = [orbits_of(text, "tle")[0] for text in element_sets(count)]
        best = np.inf
        for _ in range(3):
            begin = process_time()
            found = find_ours(orbits, stations, DAYS)
            best = min(best, process_time() - begin)
        cpu.append(best)
        events.append(sum(one.size for row in found for one in row))
    return np.array(cpu), np.array(events)


def draw(path: str, cpu: np.ndarray, exponent: float, factor: float) -> None:
    """Draw times and the fitted line on logarithmic axes."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.0, 4.0), layout="constrained")
    counts = np.array(COUNTS)
    axes.loglog(counts, cpu, "o", color="#0072b2", label="measured")
    axes.loglog(
        counts[2:], factor * counts[2:] ** exponent, "-", color="#d55e00",
        label=f"grows as satellites to the power {exponent:.2f}",
    )  # fmt: skip
    axes.set_xlabel("satellites")
    axes.set_ylabel("CPU time (s)")
    axes.set_title(f"Passes over {STATIONS} stations in {DAYS:g} day")
    axes.grid(alpha=0.3, which="both")
    axes.legend()
    figure.savefig(path)


if __name__ == "__main__":
    cpu_s, ends = measure()
    slope, offset = np.polyfit(np.log(COUNTS[2:]), np.log(cpu_s[2:]), 1)
    for count, time_s, end in zip(COUNTS, cpu_s, ends, strict=True):
        print(f"{count:>6} satellites {time_s:10.4f} s CPU {end:>9} rises and sets")
    print(f"exponent from {COUNTS[2]} satellites on: {slope:.3f}")
    if len(sys.argv) > 1:
        draw(sys.argv[1], cpu_s, float(slope), float(np.exp(offset)))
