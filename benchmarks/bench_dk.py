"""µ synthesis of two published plants: bounds certified over all frequencies, and what they cost.

The distillation column is that of Skogestad, Morari and Doyle (1988), for which D–K iteration of
the literature ends at about 1.02, where this one is stopped, and careful scalings at 0.974. The two
masses with an uncertain spring between them are those of Wie and Bernstein (1992), with weights on
the second mass and on the force: the spring's stiffness as a real number, by D,G–K, against the
same as a complex one, by D–K, both judged with the real one.

Time is CPU time of this process, so that a busy machine hardly counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from time import process_time

import numpy as np

from hillsphere.lti import LtiSystem
from hillsphere_controllers.dk.results import DkDesign
from hillsphere_controllers.dk.synthesis import dk_synthesis
from hillsphere_controllers.mu.blocks import BlockStructure, full, repeated_real
from hillsphere_controllers.mu.robustness import robust_stability
from hillsphere_controllers.systems.algebra import append, gain, series
from hillsphere_controllers.systems.interconnection import connect, with_names

GAINS = np.array([[0.878, -0.864], [1.082, -1.096]])
INTEGRATOR = 1e-6  # 1/s, the weight's pole, which must not lie on the axis


def twice(pole: float, low: float, high: float) -> LtiSystem:
    """Return two lags of those gains at zero frequency and infinity."""
    one = np.ones((1, 1))
    lag = LtiSystem(-pole * one, one, pole * (low - high) * one, high * one)
    return append(lag, lag)


def column() -> LtiSystem:
    """Return the column with its weights."""
    parts = [
        with_names(series(gain(GAINS), twice(1.0 / 75.0, 1.0, 0.0)), "ud", "y"),
        with_names(twice(2.0, 0.2, 2.0), "u", "z"),
        with_names(twice(INTEGRATOR, 0.05 / INTEGRATOR, 0.5), "yt", "p"),
    ]
    return connect(
        parts, ["ud = u + d", "yt = y + w", "e = - yt"], ["d", "w", "u"], ["z", "p", "e"]
    )


def two_masses() -> LtiSystem:
    """Return masses of one with a spring of 0.5 to 2 between them."""
    k, half, push, noise, force = 1.25, 0.75, 0.1, 0.05, 0.1
    a = np.array([[0, 0, 1, 0], [0, 0, 0, 1], [-k, k, 0, 0], [k, -k, 0, 0]], dtype=float)
    b = np.zeros((4, 5))
    b[2], b[3] = [-1.0, push, 0.0, 0.0, 1.0], [1.0, 0.0, push, 0.0, 0.0]
    c = np.array([[half, -half, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0], [0, 1, 0, 0]], dtype=float)
    d = np.zeros((4, 5))
    d[2, 4], d[3, 3] = force, noise
    return LtiSystem(a, b, c, d)


def timed(
    plant: LtiSystem, structure: BlockStructure, channels: int, target: float = 0.0
) -> tuple[DkDesign, float]:
    """Return a design and its seconds."""
    begin = process_time()
    design = dk_synthesis(plant, channels, channels, structure, reduction=0.0, target=target)
    return design, process_time() - begin


def figures() -> Mapping[str, float]:
    """Return the figures, for benchmarks/run.py."""
    three = BlockStructure([full(1), full(1), full(2)])
    distilled, column_s = timed(column(), three, 2, target=1.02)
    real = BlockStructure([repeated_real(1, "k"), full(3, 2)])
    mixed, mixed_s = timed(two_masses(), real, 1)
    plain, plain_s = timed(two_masses(), BlockStructure([full(1), full(3, 2)]), 1)
    judged = robust_stability(plain.closed_loop, real, complex_shares=()).upper
    return {
        "column_certified": distilled.robustness.upper,
        "column_lower_bound": distilled.robustness.lower,
        "column_states": float(distilled.controller.order),
        "column_to_1.02_cpu_s": column_s,
        "two_masses_certified_by_dgk": mixed.robustness.upper,
        "two_masses_certified_by_dk": min(judged, plain.robustness.upper),
        "two_masses_dgk_to_dk": mixed.robustness.upper / min(judged, plain.robustness.upper),
        "two_masses_dgk_cpu_s": mixed_s,
        "two_masses_dk_cpu_s": plain_s,
    }


if __name__ == "__main__":
    for figure, number in figures().items():
        print(f"{figure:<40} {number:12.4g}")
