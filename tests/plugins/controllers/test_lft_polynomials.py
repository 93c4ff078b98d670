from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere_controllers.linear_fractional.polynomials import (
    Terms,
    affine,
    copies_lower_bound,
    evaluate_polynomial,
    polynomial,
)
from hillsphere_controllers.linear_fractional.transformation import Lft
from hillsphere_controllers.linear_fractional.uncertainties import (
    Uncertainty,
    corners,
    random_values,
    real_parameter,
)

THREE = (
    real_parameter("a", -1.0, 2.0, 0.25),
    real_parameter("b", 3.0, 4.0),
    real_parameter("c", -5.0, -0.5, -1.0),
)
ONE = np.ones((1, 1))


def matrices(found: Lft, values: dict[str, Array]) -> Array:
    count = len(next(iter(values.values())))
    made = found.matrices({u.name: values[u.name] for u in found.uncertainties})[3]
    return np.broadcast_to(made, (count, *made.shape[1:]))


def random_terms(seed: int, parameters: int, shape: tuple[int, int], degree: int) -> Terms:
    random = np.random.default_rng(seed)
    every = [e for e in product(range(degree + 1), repeat=parameters) if sum(e) <= degree]
    return {
        e: random.normal(size=(shape[0], 1)) @ random.normal(size=(1, shape[1])) for e in every
        if random.uniform() < 0.6 or not any(e)
    }  # fmt: skip


@settings(derandomize=True, deadline=None, max_examples=25)
@given(
    seed=st.integers(0, 10_000), rows=st.integers(1, 4), columns=st.integers(1, 4),
    degree=st.integers(0, 3),
)  # fmt: skip
def test_a_polynomial_is_what_it_is_at_the_corners_and_inside(
    seed: int, rows: int, columns: int, degree: int
) -> None:
    terms = random_terms(seed, 3, (rows, columns), degree)
    found = polynomial(terms, THREE)
    for values in (corners(THREE), random_values(THREE, 20, seed=seed)):
        direct = evaluate_polynomial(terms, np.array([values[u.name] for u in THREE]))
        assert_allclose(
            matrices(found, values), direct, rtol=0, atol=1e-12 * float(np.abs(direct).max())
        )
    assert found.size >= sum(copies_lower_bound(terms))


@pytest.mark.parametrize(
    ("terms", "size"),
    [
        ({(1, 1, 0): ONE}, 2),  # a b
        ({(1, 1, 0): ONE, (1, 0, 1): ONE}, 3),  # a (b + c)
        ({(3, 0, 0): ONE, (0, 0, 0): ONE}, 3),  # a³ + 1
        ({(1, 1, 0): ONE, (0, 1, 1): ONE, (1, 0, 1): ONE}, 4),  # one of the three twice
        ({(2, 0, 0): np.diag([1.0, 0.0]), (1, 0, 0): np.diag([0.0, 1.0])}, 3),
        # (a b + 1) (a b + 1)
        ({(2, 2, 0): ONE, (1, 1, 0): 2.0 * ONE, (0, 0, 0): ONE}, 4),
    ],
)
def test_known_least_sizes(terms: Terms, size: int) -> None:
    assert polynomial(terms, THREE).size == size


def test_affine_needs_the_rank_of_each_matrix() -> None:
    random = np.random.default_rng(2)
    ranks = {"a": 1, "b": 3, "c": 0}
    slopes = {
        name: random.normal(size=(5, rank)) @ random.normal(size=(rank, 4))
        for name, rank in ranks.items()
    }
    found = affine(random.normal(size=(5, 4)), slopes, THREE)
    assert dict(zip((u.name for u in found.uncertainties), found.times, strict=True)) == {
        "a": 1, "b": 3,
    }  # fmt: skip


def test_entries_of_very_different_units_are_kept() -> None:
    """A row of 1e7 and one of 1e-15 have their own digits each."""
    random = np.random.default_rng(3)
    left, right = np.diag([1e-7, 1.0, 1e7]), np.diag([1e8, 1.0, 1e-8])
    terms: Terms = {
        e: left @ random.normal(size=(3, 3)) @ right for e in [(0, 0, 0), (1, 0, 0), (1, 1, 0)]
    }
    found = polynomial(terms, THREE)
    assert found.size == sum(copies_lower_bound(terms))
    values = random_values(THREE, 30)
    direct = evaluate_polynomial(terms, np.array([values[u.name] for u in THREE]))
    error = np.abs(matrices(found, values) - direct).max(axis=0)
    assert (error <= 1e-12 * np.abs(direct).max(axis=0)).all()


def test_least_copies_of_one_parameter_are_reached() -> None:
    """The rank of the Hankel matrix of the coefficients."""
    random = np.random.default_rng(4)
    p = (real_parameter("a", 0.0, 1.0),)
    row, column = random.normal(size=(2, 3))
    terms: Terms = {
        (0,): np.zeros((3, 3)),
        (1,): np.outer(row, column),
        (2,): np.outer(column, row),
    }
    assert polynomial(terms, p).size == copies_lower_bound(terms)[0]


@pytest.mark.parametrize(
    ("terms", "parameters", "message"),
    [
        ({}, THREE, "at least one term"),
        ({(1, 0): ONE}, THREE, "3 exponents"),
        ({(-1, 0, 0): ONE}, THREE, "3 exponents"),
        ({(0, 0, 0): ONE, (1, 0, 0): np.ones((2, 1))}, THREE, "one shape"),
        ({(0, 0, 0): np.full((1, 1), np.nan)}, THREE, "finite"),
        ({(0,): ONE}, (Uncertainty("z", "complex"),), "real parameters"),
    ],
)
def test_what_does_not_fit_is_said(
    terms: Terms, parameters: tuple[Uncertainty, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        polynomial(terms, parameters)


def test_an_unknown_slope_is_said() -> None:
    with pytest.raises(InputError, match="no uncertainty 'd'; there are: a, b, c"):
        affine(ONE, {"d": ONE}, THREE)


@pytest.mark.parametrize("unit", [1e-6, 1e-2, 1e4])
def test_the_unit_of_a_parameter_does_not_change_its_copies(unit: float) -> None:
    random = np.random.default_rng(1)
    r = random.normal(size=(3, 3))
    terms: Terms = {(1, 0): np.outer(r[0], r[1]), (3, 1): np.outer(r[1], r[2]), (0, 2): r}
    scaled: Terms = {e: matrix / unit ** e[0] for e, matrix in terms.items()}
    assert copies_lower_bound(scaled) == copies_lower_bound(terms)
    parameters = [real_parameter("a", unit, 2.0 * unit), real_parameter("b", 1.0, 2.0)]
    assert polynomial(scaled, parameters).times == (4, 6) == copies_lower_bound(scaled)


def test_half_exponents_and_complex_coefficients_are_refused() -> None:
    p = [real_parameter("p", 1.0, 2.0)]
    half: Any = {(1.5,): np.eye(1)}
    turned: Any = {(1,): 1j * np.eye(1)}
    for terms, match in ((half, "exponents, whole"), (turned, "complex")):
        with pytest.raises(InputError, match=match):
            polynomial(terms, p)
    for value in (1.5 + 1j, np.nan):
        with pytest.raises(InputError, match="p: finite real numbers"):
            polynomial({(1,): np.eye(1)}, p).at({"p": value})
