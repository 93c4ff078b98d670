from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import elliprd, elliprf

from hillsphere.dynamics import ArrayFunction
from hillsphere.symbolic import variable
from hillsphere_gravity.carlson import _rd_series, _rf_series, carlson_rf_rd

_ARGUMENTS = (variable("x"), variable("y"), variable("z"))
_RF, _RD = carlson_rf_rd(_ARGUMENTS)
_INTEGRALS = ArrayFunction((_RF, *_RD), _ARGUMENTS)


@pytest.mark.parametrize(
    ("ratio", "rf_tolerance", "rd_tolerance"),
    # Arguments are squared axes: 36 is a body of 6:1. Measured 7e-16 there for both; at 100:1
    # 3.3e-13 for R_F, whose series loses more, and 1.7e-14 for R_D.
    [(1.0, 2e-15, 2e-15), (1.0 + 1e-12, 3e-15, 3e-15), (36.0, 3e-15, 3e-15), (1e4, 1.2e-12, 6e-14)],
)
def test_agrees_with_scipy_for_every_ratio(
    ratio: float, rf_tolerance: float, rd_tolerance: float
) -> None:
    rng = np.random.default_rng(3)
    x, y, z = np.exp(rng.uniform(0.0, np.log(ratio) + 1e-300, (3, 2000)))
    expected = np.array([elliprf(x, y, z), elliprd(y, z, x), elliprd(z, x, y), elliprd(x, y, z)])
    errors = np.abs(_INTEGRALS(np.array([x, y, z])) / expected - 1.0)
    assert np.max(errors[0]) <= rf_tolerance
    assert np.max(errors[1:]) <= rd_tolerance


def test_equal_arguments_give_powers() -> None:
    # R_F(x, x, x) = x^(-1/2), R_D(x, x, x) = x^(-3/2), DLMF 19.20.1 and 19.20.18.
    x = np.array([0.3, 1.0, 7.0])
    found = _INTEGRALS(np.array([x, x, x]))
    np.testing.assert_allclose(found[0], x**-0.5, rtol=1e-15)
    np.testing.assert_allclose(found[1:], np.tile(x**-1.5, (3, 1)), rtol=1e-15)


@pytest.mark.parametrize("direction", [(1.0, 0.8, -1.0), (0.9, -0.8, 1.0)])
def test_series_are_of_fifth_order(direction: tuple[float, float, float]) -> None:
    # After five duplications the last terms are below rounding, so a wrong coefficient would not
    # show in the integrals. Alone on spread arguments the right series leave δ⁶ behind: halving δ
    # divides the error by 64 (measured 61 to 65); a wrong coefficient of order k leaves δᵏ.
    series = ArrayFunction((_rf_series(_ARGUMENTS), _rd_series(*_ARGUMENTS)), _ARGUMENTS)

    def errors(spread: float) -> NDArray[np.float64]:
        x, y, z = 1.0 + spread * np.array(direction)[:, None]
        expected = np.array([elliprf(x, y, z), elliprd(x, y, z)])
        return np.asarray(np.abs(series(np.array([x, y, z])) / expected - 1.0)[:, 0])

    np.testing.assert_allclose(errors(0.04) / errors(0.02), 64.0, rtol=0.1)
