"""H∞ norm of 200 random systems, of orders 1 to 60, beside SLICOT's AB13DD.

The systems are well scaled, so that both are right. Where poles lie decades apart AB13DD may return
a norm that is too low; ours is proved.
"""

from __future__ import annotations

from time import process_time

import numpy as np
from slycot import ab13dd

from hillsphere.lti import LtiSystem
from hillsphere_controllers.analysis.hinf_norm import hinf_norm

SYSTEMS = 200
LARGEST_ORDER = 60
CLASSES = ((1, 10), (11, 30), (31, 60))


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
    return found
