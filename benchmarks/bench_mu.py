"""Bounds of µ: the upper one beside SLICOT's AB13MD, and the peak certified over all frequencies.

Both sides bound µ of the same matrices. What is certified holds everywhere; what a dense grid of
the same system takes with AB13MD stands beside it.
"""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import numpy as np
from numpy.typing import NDArray
from slycot import ab13md

from hillsphere.lti import LtiSystem
from hillsphere_controllers.mu.blocks import Block, BlockStructure, full, repeated_real
from hillsphere_controllers.mu.certified import certified_peak
from hillsphere_controllers.mu.upper_bound import upper_bound

Complex = NDArray[np.complex128]

GRID = 1000
REPEATS = 3


def best_time(function: Callable[[], object]) -> float:
    """Shortest processor time of some runs, s: the one least disturbed."""
    times = []
    for _ in range(REPEATS):
        start = process_time()
        function()
        times.append(process_time() - start)
    return min(times)


def slicot(m: Complex, blocks: list[Block]) -> float:
    """Bound of AB13MD."""
    kinds = np.array([1 if b.kind == "real" else 2 for b in blocks])
    return float(ab13md(m.copy(), np.array([b.rows for b in blocks]), kinds)[0])


def large_blocks() -> list[Block]:
    """19 blocks of a 24 by 24 matrix."""
    return [*[repeated_real()] * 10, *[full(1)] * 6, full(2), full(3), full(3)]


def large_loop(blocks: list[Block]) -> LtiSystem:
    """Ten oscillators over two decades, of about the same gain, 20 inputs and outputs."""
    random = np.random.default_rng(0)
    n, size = 20, sum(b.rows for b in blocks)
    a, root = np.zeros((n, n)), np.ones(n)
    for k in range(0, n, 2):
        omega, zeta = 10.0 ** random.uniform(-1.0, 1.0), 10.0 ** random.uniform(-1.3, -0.3)
        a[k : k + 2, k : k + 2] = omega * np.array([[-zeta, 1.0], [-1.0, -zeta]])
        root[k : k + 2] = np.sqrt(omega * zeta)
    turn = np.linalg.qr(random.normal(size=(n, n)))[0]
    b = turn @ (root[:, None] * random.normal(size=(n, size)))
    c = (random.normal(size=(size, n)) * root) @ turn.T
    return LtiSystem(turn @ a @ turn.T, b, c, 0.3 * random.normal(size=(size, size)))


def figures() -> dict[str, float]:
    """Return times and ratios."""
    random = np.random.default_rng(1)
    blocks = large_blocks()
    structure = BlockStructure(blocks)
    own, other, apart = [], [], []
    for _ in range(5):
        m = random.normal(size=(24, 24, 2)) @ np.array([1.0, 1j])
        own.append(best_time(lambda m=m: upper_bound(m, structure)))
        other.append(best_time(lambda m=m: slicot(m, blocks)))
        apart.append(abs(upper_bound(m, structure).value / slicot(m, blocks) - 1.0))
    twenty = [repeated_real() if k % 2 else full(1) for k in range(20)]
    system = large_loop(twenty)
    found = certified_peak(system, BlockStructure(twenty))
    certified_s = best_time(lambda: certified_peak(system, BlockStructure(twenty)))
    one = system.response(np.array([found.frequency_rad_s]))[0]
    on_grid_s = GRID * best_time(lambda: slicot(one, twenty))
    return {
        "upper_bound_24_by_24_cpu_ms": 1e3 * float(np.mean(own)),
        "upper_bound_24_by_24_speedup": float(np.sum(other) / np.sum(own)),
        "upper_bound_relative_difference": float(np.max(apart)),
        "certified_20_blocks_20_states_cpu_s": certified_s,
        "certified_20_blocks_20_states_intervals": float(len(found.intervals)),
        "certified_faster_than_grid_of_1000": on_grid_s / certified_s,
    }
