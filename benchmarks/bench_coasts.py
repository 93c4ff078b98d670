"""Coasts between impulses about Phobos: legs that are proved together, beside one by one.

16 flights of 16 legs of twelve hours on a quasi-satellite orbit, with an impact to be excluded and
a limit of their size. Whoever follows the sub-steps of a flight needs each leg proved before the
next; such a follower, which does nothing, gives the time of proofs leg by leg.
"""

from __future__ import annotations

from collections.abc import Mapping
from statistics import median
from time import process_time
from typing import Any, Literal

import numpy as np
from bench_families import plant
from numpy.typing import NDArray

from hillsphere.simulation import Cases, Limit, Simulator

Array = NDArray[np.float64]
CASES, LEGS, LEG_S, SUBSTEPS = 16, 16, 43200.0, 40
AMPLITUDE_M, MEAN_MOTION = 50e3, 2.279e-4  # rad/s, of Phobos
MOST_M = 4.0 * AMPLITUDE_M
REPEATS = 7


class Coast:
    """No impulse."""

    actuation: Literal["hold", "impulse"] = "impulse"
    period_s = LEG_S

    def initial(self, n_cases: int) -> Array:
        """Return no states."""
        return np.zeros((0, n_cases))

    def step(self, k: int, t_s: Array, y: Array, ref: Array, xc: Array) -> tuple[Array, Array]:
        """Return impulses of zero."""
        return np.zeros((3, y.shape[1])), xc


class Follows:
    """An observer that looks at every sub-step and keeps nothing."""

    def recorder(self, first: int, count: int) -> Any:
        """Return a function that does nothing."""
        return lambda now: None

    follower = recorder


def figures() -> Mapping[str, float]:
    """Return the figures, for benchmarks/run.py."""
    rng = np.random.default_rng(1)
    x0 = np.array([AMPLITUDE_M, 0.0, 0.0, 0.0, -2.0 * MEAN_MOTION * AMPLITUDE_M, 0.0])[:, None]
    x0 = x0 + np.array([100.0] * 3 + [0.03] * 3)[:, None] * rng.standard_normal((6, CASES))
    size = Limit(
        "size",
        lambda t, x, cases: 1.0 - np.abs(x[:3]).max(axis=0) / MOST_M,
        lipschitz=[1.0 / MOST_M] * 3 + [0.0] * 3,
    )
    simulator = Simulator(plant(), Coast(), limits=[size], substeps=SUBSTEPS)

    def fly(observer: Follows | None) -> tuple[float, Any]:
        begin = process_time()
        flights = simulator.fly(Cases(x0), LEGS, observer=observer)
        return process_time() - begin, flights

    pairs = [(fly(None), fly(Follows())) for _ in range(1 + REPEATS)][1:]
    (_, together), (_, alone) = pairs[0]
    return {
        "ms_per_leg": 1e3 * median(one[0] for one, _ in pairs) / LEGS,
        "faster_than_leg_by_leg": median(other[0] / one[0] for one, other in pairs),
        "faster_than_leg_by_leg_least": min(other[0] / one[0] for one, other in pairs),
        "completed": float(together.status.count("completed")),
        "largest_difference": float(np.abs(together.x - alone.x).max()),
    }


if __name__ == "__main__":
    for figure, number in figures().items():
        print(f"{figure:<40} {number:12.4g}")
