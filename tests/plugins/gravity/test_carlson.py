from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import elliprd, elliprf

from hillsphere.dynamics import ArrayFunction
from hillsphere.symbolic import variable
from hillsphere_gravity.carlson import _series, carlson_rf_rd, duplications_for

_ARGUMENTS = (variable("x"), variable("y"), variable("z"))
_RF, _RD = carlson_rf_rd(_ARGUMENTS)
_INTEGRALS = ArrayFunction((_RF, *_RD), _ARGUMENTS)


@pytest.mark.parametrize(
    ("ratio", "rf_tolerance", "rd_tolerance"),
    # Arguments are squared axes: 36 is a body of 6:1, 1e4 one of 100:1.
    [(1.0, 2e-15, 2e-15), (1.0 + 1e-12, 3e-15, 3e-15), (36.0, 3e-15, 3e-15), (1e4, 6e-15, 3e-15)],
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
def test_series_are_of_seventh_order(direction: tuple[float, float, float]) -> None:
    # After the duplications the last terms are below rounding, so a wrong coefficient would not
    # show in the integrals. Alone on spread arguments the right series leave δ⁸ behind: halving δ
    # divides the error by 256; a wrong coefficient of order k leaves δᵏ.
    rf, rd = _series(_ARGUMENTS)
    series = ArrayFunction((rf, *rd), _ARGUMENTS)

    def errors(spread: float) -> NDArray[np.float64]:
        x, y, z = 1.0 + spread * np.array(direction)[:, None]
        expected = np.array([elliprf(x, y, z), *_three_rd(x, y, z)])
        return np.asarray(np.abs(series(np.array([x, y, z])) / expected - 1.0)[:, 0])

    np.testing.assert_allclose(errors(0.16) / errors(0.08), 256.0, rtol=0.3)


@pytest.mark.parametrize("ratio", [1.0001, 1.03, 1.4, 2.0, 3.0, 20.0, 1e4])
def test_as_many_duplications_as_the_arguments_need(ratio: float) -> None:
    # Prolate, oblate and between.
    for nominal in ((ratio, 1.0, 1.0), (ratio, ratio, 1.0), (ratio, 0.5 + 0.5 * ratio, 1.0)):
        count = duplications_for(nominal)
        rf, rd = carlson_rf_rd(_ARGUMENTS, count)
        shift = np.array([0.0, 0.1, 1.0, 10.0, 1e3])
        x, y, z = np.array(nominal)[:, None] + shift
        found = ArrayFunction((rf, *rd), _ARGUMENTS)(np.array([x, y, z]))
        expected = np.array([elliprf(x, y, z), *_three_rd(x, y, z)])
        np.testing.assert_allclose(found, expected, rtol=4e-15)


def test_fewer_duplications_for_rounder_bodies() -> None:
    # Phobos 13.03 : 11.40 : 9.14; Eros 34.4 : 11.2 : 11.2. Squares.
    assert duplications_for((1.0, 1.0, 1.0)) == 0
    assert duplications_for((13.03**2, 11.40**2, 9.14**2)) == 3
    assert duplications_for((34.4**2, 11.2**2, 11.2**2)) == 4
    assert duplications_for((100.0**2, 1.0, 1.0)) == 6


def _three_rd(x: Any, y: Any, z: Any) -> tuple[Any, Any, Any]:
    return elliprd(y, z, x), elliprd(z, x, y), elliprd(x, y, z)
