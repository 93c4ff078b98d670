"""The exponent of a growth is that of the larger sizes, and of the medians."""

from __future__ import annotations

import numpy as np
from benchmarks.growth_of_controllers import Curve, measure


def test_the_exponent_is_of_the_upper_sizes() -> None:
    sizes = np.array([1, 2, 4, 8, 16])
    cpu = np.where(sizes < 4, 1.0, 1e-3 * sizes**2.5)
    times = np.stack([cpu, 0.9 * cpu, 50.0 * cpu], axis=1)  # one of three was disturbed
    exponent, factor = Curve("c", sizes, times, fitted_from=4).fit()
    np.testing.assert_allclose([exponent, factor], [2.5, 1e-3], rtol=1e-12)


def test_every_size_has_its_problems() -> None:
    called: list[tuple[int, int]] = []
    curve = measure("c", (2, 3), 2, lambda size, seed: lambda: called.append((size, seed)))
    assert called[0] == (2, 0)  # what all need is loaded then
    assert called[1:] == [(size, seed) for size in (2, 3) for seed in range(7)]
    assert curve.all_cpu.shape == (2, 7)
