"""Bounds of the eccentric anomaly contain the root of Kepler's equation, in exact arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from hillsphere.engine.dynamics import intervals as iv
from hillsphere.engine.dynamics.bounds import Bound

ACCURATE = 10**60
"""Denominator to which terms of the series are rounded: forty digits more than the ends have."""


def exact_sine(angle: Fraction) -> Fraction:
    """Sum of the sine's series, to fifty digits for angles up to fifty."""
    term, total, k = angle, angle, 1
    while abs(term) > Fraction(1, 10**50):
        term = Fraction(round(-term * angle * angle / ((k + 1) * (k + 2)) * ACCURATE), ACCURATE)
        total, k = total + term, k + 2
    return total


def kepler(e: float, m: float, anomaly: float) -> Fraction:
    """E − e sin E − M, which rises with E."""
    return Fraction(anomaly) - Fraction(e) * exact_sine(Fraction(anomaly)) - Fraction(m)


def test_the_root_of_keplers_equation_is_within_the_bounds() -> None:
    rng = np.random.default_rng(1)
    e, m = rng.uniform(0.0, 0.985, 200), rng.uniform(-40.0, 40.0, 200)
    lo, hi = Bound(iv.point(m)).symbolic_eccentric_anomaly(Bound(iv.point(e))).value
    assert all(kepler(*lane) <= 0 for lane in zip(e, m, lo, strict=True))
    assert all(kepler(*lane) >= 0 for lane in zip(e, m, hi, strict=True))
    assert np.max(hi - lo) < 1e-11


def test_a_lane_has_the_same_bounds_beside_any_others() -> None:
    rng = np.random.default_rng(2)
    e, m = rng.uniform(0.0, 0.985, 50), rng.uniform(-9.0, 9.0, 50)
    together = Bound(iv.point(m)).symbolic_eccentric_anomaly(Bound(iv.point(e))).value
    for k in (0, 17, 49):
        alone = Bound(iv.point(m[k : k + 1])).symbolic_eccentric_anomaly(
            Bound(iv.point(e[k : k + 1]))
        )
        assert alone.value[0][0] == together[0][k]
        assert alone.value[1][0] == together[1][k]


def test_a_wide_mean_anomaly_spans_both_ends() -> None:
    e = Bound((np.array([0.1]), np.array([0.3])))
    lo, hi = Bound((np.array([0.5]), np.array([1.0]))).symbolic_eccentric_anomaly(e).value
    assert kepler(0.1, 0.5, float(lo[0])) <= 0 <= kepler(0.1, 0.5, float(lo[0]) + 1e-13)
    assert kepler(0.3, 1.0, float(hi[0]) - 1e-13) <= 0 <= kepler(0.3, 1.0, float(hi[0]))
