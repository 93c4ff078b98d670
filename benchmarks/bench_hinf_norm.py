"""H∞ norm of 200 random systems, of orders 1 to 60, beside SLICOT's AB13DD; what SB10AD saves.

The systems are well scaled, so that both are right. Where poles lie decades apart AB13DD may return
a norm that is too low; ours is proved. H∞ synthesis may begin at the γ of SB10AD: the ratio is of
the times without and with it, everything being checked in both.
"""

from __future__ import annotations

from time import process_time

import numpy as np
from slycot import ab13dd

from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm
from hillsphere_controllers.full_order.hinf import hinf_synthesis

SYSTEMS = 200
LARGEST_ORDER = 60
CLASSES = ((1, 10), (11, 30), (31, 60))
ORDERS = (3, 6, 12, 24)
"""Of the plants that controllers are made for."""
PLANTS = 3
TOLERANCE = 1e-6


def random_system(random: np.random.Generator, order: int) -> LtiSystem:
    """Stable, two inputs and three outputs, poles within a decade or so."""
    a = random.normal(size=(order, order)) / np.sqrt(order)
    a -= (np.linalg.eigvals(a).real.max() + 10.0 ** random.uniform(-2.0, 0.0)) * np.eye(order)
    b, c = random.normal(size=(order, 2)), random.normal(size=(3, order))
    return LtiSystem(a, b, c, random.normal(size=(3, 2)))


def slicot(system: LtiSystem) -> float:
    """Norm by AB13DD."""
    n, (p, m) = system.order, system.shape
    found, _ = ab13dd(
        "C", "I", "N", "D", n, m, p, system.a, np.eye(n), system.b, system.c, system.d
    )
    return float(found)


def generalised_plant(seed: int, order: int) -> LtiSystem:
    """Two controls and measurements, weighted and noisy; poles about −1."""
    random = np.random.default_rng(seed)
    a = random.normal(size=(order, order)) / np.sqrt(order) - np.eye(order)
    d = np.zeros((6, 6))
    d[2:4, 4:], d[4:, 2:4] = np.eye(2), np.eye(2)
    return LtiSystem(a, random.normal(size=(order, 6)), random.normal(size=(6, order)), d)


def synthesis_speedups() -> dict[str, float]:
    """Return times of H∞ synthesis over those with SB10AD's guess, and the largest difference."""
    found, apart = {}, 0.0
    for order in ORDERS:
        times = np.zeros(2)
        for seed in range(PLANTS):
            plant, values = generalised_plant(seed, order), []
            for i in range(2):
                begin = process_time()
                made = hinf_synthesis(plant, 2, 2, tolerance=TOLERANCE, slicot=i == 1)
                values.append(made.solvable)
                times[i] += process_time() - begin
            apart = max(apart, abs(values[0] / values[1] - 1.0))
        found[f"synthesis_speedup_by_sb10ad_order_{order}"] = times[0] / times[1]
    return found | {"synthesis_difference_by_sb10ad": apart}


def figures() -> dict[str, float]:
    """Return the total ratio of times, those by order, and the largest difference."""
    random = np.random.default_rng(0)
    orders = np.linspace(1, LARGEST_ORDER, SYSTEMS).round().astype(int)
    times, apart = np.empty((2, SYSTEMS)), 0.0
    for k, order in enumerate(orders):
        system = random_system(random, int(order))
        values = []
        for i, norm in enumerate((lambda s: hinf_norm(s).value, slicot)):
            begin = process_time()
            values.append(norm(system))
            times[i, k] = process_time() - begin
        apart = max(apart, abs(values[0] / values[1] - 1.0))
    found = {"over_ab13dd_total": times[0].sum() / times[1].sum(), "relative_difference": apart}
    for low, high in CLASSES:
        some = (orders >= low) & (orders <= high)
        found[f"over_ab13dd_orders_{low}_to_{high}"] = times[0, some].sum() / times[1, some].sum()
    return found | synthesis_speedups()
