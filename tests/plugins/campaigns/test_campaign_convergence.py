"""Running estimates of campaigns are those of their prefixes."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from hillsphere.cases.case_classes import ratio_interval
from hillsphere_campaigns.convergence import convergence_of_failures, convergence_of_mean
from hillsphere_campaigns.statistics import mean_interval


def test_convergence_is_that_of_the_prefixes() -> None:
    values = 1e6 + np.random.default_rng(7).normal(size=500)
    kept = np.arange(500) % 7 != 0
    mean = convergence_of_mean(values, kept)
    ratio = convergence_of_failures(~kept)
    assert_array_equal(mean.cases[[0, -1]], [1, 500])
    assert np.isnan(mean.value[0])
    for i in (len(mean.cases) // 2, len(mean.cases) - 1):
        n = mean.cases[i]
        some = values[:n][kept[:n]]
        assert_allclose(mean.value[i], some.mean(), rtol=1e-14)
        assert_allclose(mean.interval[:, i], mean_interval(some), rtol=1e-12)
        assert_allclose(ratio.value[i], 1.0 - some.size / n, rtol=1e-12)
        assert_allclose(ratio.interval[:, i], ratio_interval(n - some.size, n), rtol=1e-12)
    assert convergence_of_failures(np.empty(0, dtype=bool)).cases.size == 0
    assert np.isnan(convergence_of_mean(values[:3], np.zeros(3, dtype=bool)).value).all()
