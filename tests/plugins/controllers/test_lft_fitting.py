from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.linear_fractional.fitting import fit_polynomial
from hillsphere_controllers.linear_fractional.uncertainties import real_parameter

TWO = (real_parameter("speed", 100.0, 300.0, 150.0), real_parameter("height", -1.0, 2.0))


def points(count: int, seed: int = 0) -> Array:
    random = np.random.default_rng(seed)
    return np.array([random.uniform(u.lower, u.upper, count) for u in TWO])


def samples(at: Array) -> Array:
    speed, height = at
    made = np.zeros((len(speed), 2, 2))
    made[:, 0, 0] = 3.0 + 2e-2 * speed
    made[:, 0, 1] = 1e-5 * speed**2 * height
    made[:, 1, 0] = 7e5
    made[:, 1, 1] = 1e6 * height
    return made


def test_a_polynomial_is_found_again() -> None:
    at = points(40)
    fit = fit_polynomial(at, samples(at), TWO, degree=3, tolerance=1e-10)
    fresh = points(100, seed=1)
    expected = samples(fresh)
    scale = np.abs(expected).max(axis=0)
    assert (np.abs(fit(fresh) - expected) <= 1e-11 * scale).all()
    # in q: 1, s, s², h, s h, s² h at the most
    assert set(fit.terms) <= {(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)}
    assert len(fit.terms) < 10
    assert fit.left_out_error < 1e-9
    assert_allclose(sum(fit.shares), 1.0, rtol=1e-12)
    made = fit.lft()
    found = made.matrices({"speed": fresh[0], "height": fresh[1]})[3]
    assert (np.abs(found - expected) <= 1e-11 * scale).all()


def test_terms_come_by_their_influence() -> None:
    """Orthogonal monomials on a full grid of −1, 0, 1: shares are the squares of coefficients."""
    p = (real_parameter("x", -1.0, 1.0), real_parameter("y", -1.0, 1.0))
    grid = np.array([(x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0)]).T
    values = (1.0 * grid[0] + 3.0 * grid[1] + 0.5 * grid[0] * grid[1])[:, None, None]
    fit = fit_polynomial(grid, values, p, degree=2, tolerance=1e-12)
    assert list(fit.terms) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    # mean squares: 2/3 of 9, 2/3 of 1, 4/9 of 1/4
    power = np.array([0.0, 6.0, 2.0 / 3.0, 1.0 / 9.0])
    assert_allclose(fit.shares, power / power.sum(), rtol=0, atol=1e-14)
    assert_allclose(fit.terms[(0, 1)], [[3.0]], rtol=1e-12)


def test_what_is_no_polynomial_is_fitted_within_the_tolerance_everywhere() -> None:
    at = points(200)
    values = np.exp(0.005 * at[0] + 0.3 * at[1])[:, None, None]
    fit = fit_polynomial(at, values, TWO, degree=5, tolerance=1e-3)
    assert fit.error <= 1e-3
    assert fit.errors[-2] > 1e-3
    fresh = points(300, seed=9)
    exact = np.exp(0.005 * fresh[0] + 0.3 * fresh[1])
    assert np.abs(fit(fresh)[:, 0, 0] - exact).max() <= 3e-3 * np.ptp(values)


def test_the_error_of_a_sample_left_out_is_that_of_a_fit_without_it() -> None:
    at = points(12)
    random = np.random.default_rng(4)
    values = random.normal(size=(12, 1, 1))
    fit = fit_polynomial(at, values, TWO, degree=1, most_terms=3, weights=np.ones((1, 1)))
    worst = 0.0
    for k in range(12):
        kept = np.arange(12) != k
        plane = np.vstack([np.ones(12), at]).T
        found = np.linalg.lstsq(plane[kept], values[kept, 0, 0], rcond=None)[0]
        worst = max(worst, abs(float(plane[k] @ found - values[k, 0, 0])))
    assert_allclose(fit.left_out_error, worst, rtol=1e-9)


def test_a_parameter_that_stays_nominal_gives_no_terms() -> None:
    at = points(20)
    at[1] = TWO[1].nominal
    fit = fit_polynomial(at, samples(at), TWO, degree=3, tolerance=1e-9)
    assert all(e[1] == 0 for e in fit.terms)


def test_entries_that_never_change_cost_no_copies() -> None:
    """Beside ones, small changes of rank one: rounding in the ones would look like copies."""
    at = points(20)
    made = np.zeros((20, 3, 4))
    made[:, 0, 2], made[:, 1, 3], made[:, 2, 0] = 1.0, 1.0 / 3.0, 0.7
    made[:, 2, 1] = 1e-7 * at[0]
    made[:, 2, 3] = 1e-7 * at[1]
    fit = fit_polynomial(at, made, TWO, degree=1, tolerance=1e-12)
    assert fit.lft().times == (1, 1)
    for matrix in fit.terms.values():
        assert np.count_nonzero(matrix[:2]) in (0, 2)


def test_too_few_terms_are_said() -> None:
    at = points(50)
    with pytest.raises(InputError, match="raise the degree"):
        fit_polynomial(at, samples(at), TWO, degree=1, tolerance=1e-6)
    assert (
        len(fit_polynomial(at, samples(at), TWO, degree=3, tolerance=0.0, most_terms=2).terms) == 2
    )


def test_what_does_not_fit_is_said() -> None:
    at = points(5)
    with pytest.raises(InputError, match=r"points \(2, N\)"):
        fit_polynomial(at[:1], samples(at), TWO)
    with pytest.raises(InputError, match="finite"):
        fit_polynomial(at, samples(at) * np.nan, TWO)
    with pytest.raises(InputError, match="weights"):
        fit_polynomial(at, samples(at), TWO, weights=np.ones(2))
    with pytest.raises(InputError, match="degree ≥ 0"):
        fit_polynomial(at, samples(at), TWO, degree=-1)


def test_complex_samples_are_refused() -> None:
    turned: Any = 1j * np.ones((3, 1, 1))
    with pytest.raises(InputError, match="must be real"):
        fit_polynomial(np.ones((1, 3)), turned, [real_parameter("p", 0.0, 2.0)])
