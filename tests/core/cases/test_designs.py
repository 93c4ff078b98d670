"""Designs: how evenly they fill the cube, and what they depend on."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import stats

from hillsphere.base.seeds import name_key
from hillsphere.cases.designs import Design, DesignName, factorial, random_rows, space_filling
from hillsphere.errors import InputError
from hillsphere.interfaces import Array

GROUPS = (("field", 3), ("start", 2))
NAMES: list[DesignName] = ["random", "latin_hypercube", "sobol", "sobol_indices"]


def design(name: DesignName, cases: int, *, seed: int = 1, stream: str = "verify") -> Design:
    return Design(name, cases, GROUPS, seed, stream)


def everything(made: Design) -> Array:
    return made.unit(np.arange(made.total))


@pytest.mark.parametrize("name", NAMES)
def test_the_same_whatever_is_asked_first(name: DesignName) -> None:
    whole = everything(design(name, 64))
    assert ((whole > 0) & (whole < 1)).all()
    other = design(name, 64)
    for which in (np.array([40, 3, 40]), np.arange(63, 10, -1), np.arange(64)):
        assert_array_equal(other.unit(which), whole[:, which])
    assert_array_equal(everything(design(name, 64)), whole)


@pytest.mark.parametrize("name", NAMES)
def test_another_seed_or_stream_gives_others(name: DesignName) -> None:
    whole = everything(design(name, 32))
    assert (everything(design(name, 32, seed=2)) != whole).all()
    assert (everything(design(name, 32, stream="other")) != whole).all()


def test_random_cases_are_drawn_as_documented() -> None:
    key = (name_key("verify"), 17, name_key("dispersions.start"))
    generator = np.random.default_rng(np.random.SeedSequence(1, spawn_key=key))
    assert_array_equal(design("random", 30).unit(np.array([17]))[3:, 0], generator.random(2))


@pytest.mark.parametrize("name", ["random", "sobol"])
def test_a_shorter_campaign_is_the_beginning_of_a_longer_one(name: DesignName) -> None:
    assert_array_equal(everything(design(name, 2000))[:, :100], everything(design(name, 100)))


def test_a_group_does_not_change_with_the_others() -> None:
    which = np.arange(20)
    both = random_rows(GROUPS, which, 1, "verify")
    assert_array_equal(random_rows(GROUPS[::-1], which, 1, "verify")[:2], both[3:])
    assert_array_equal(random_rows(GROUPS[:1], which, 1, "verify"), both[:3])
    longer = random_rows((("field", 7),), which, 1, "verify")
    assert_array_equal(longer[:3], both[:3])


def test_random_numbers_are_uniform_and_uncorrelated() -> None:
    u = everything(design("random", 4000))
    for row in u:
        assert stats.kstest(row, "uniform").pvalue > 1e-3
    assert_allclose(np.corrcoef(u), np.eye(5), rtol=0, atol=0.06)
    assert abs(np.corrcoef(u[0, :-1], u[0, 1:])[0, 1]) < 0.06


def test_latin_hypercube_has_one_case_in_each_slice() -> None:
    for cases in (1, 10, 100):
        u = everything(design("latin_hypercube", cases))
        for row in u:
            assert_array_equal(np.sort(np.floor(row * cases)), np.arange(cases))


def test_sobol_is_a_net() -> None:
    """64 points: one in each slice of 1/64, one in each of 8 × 8 squares of the first two."""
    u = everything(design("sobol", 64))
    for row in u:
        assert_array_equal(np.sort(np.floor(row * 64)), np.arange(64))
    squares = np.floor(u[:2] * 8)
    assert len(set(map(tuple, squares.T.tolist()))) == 64


@pytest.mark.parametrize("name", ["sobol", "latin_hypercube"])
def test_space_filling_designs_estimate_better(name: DesignName) -> None:
    def error(kind: DesignName, seed: int) -> float:
        u = everything(design(kind, 256, seed=seed))
        return float(abs(np.prod(1.0 + 0.5 * (u - 0.5), axis=0).mean() - 1.0))

    even = np.mean([error(name, seed) for seed in range(10)])
    assert even < 0.35 * np.mean([error("random", seed) for seed in range(10)])


def test_sobol_indices_blocks() -> None:
    made = design("sobol_indices", 16)
    assert made.total == 16 * 7
    a, b, *mixed = np.split(everything(made), 7, axis=1)
    for i, ab in enumerate(mixed):
        expected = a.copy()
        expected[i] = b[i]
        assert_array_equal(ab, expected)
    assert_array_equal(made.draws(np.arange(made.total)), np.tile(np.arange(16), 7))
    assert (a != b).all()


def test_sobol_indices_of_a_known_function() -> None:
    """Y = 3 u1 + 2 u2: indices in proportion to the variances, 9 : 4 : 0."""
    made = Design("sobol_indices", 1024, (("g", 3),), 3, "s")
    u = everything(made)
    y = (3 * u[0] + 2 * u[1]).reshape(5, 1024)
    found = stats.sobol_indices(
        func={"f_A": y[None, 0], "f_B": y[None, 1], "f_AB": y[2:, None, :]}, n=1024
    )
    assert_allclose(found.first_order.ravel(), [9 / 13, 4 / 13, 0], rtol=0, atol=0.01)
    assert_allclose(found.total_order.ravel(), [9 / 13, 4 / 13, 0], rtol=0, atol=0.01)


@pytest.mark.parametrize("name", NAMES)
def test_no_quantities(name: DesignName) -> None:
    made = Design(name, 10, (), 1, "noise only")
    assert made.unit(np.arange(10)).shape == (0, 10)
    assert_array_equal(made.draws(np.arange(10)), np.arange(10))


def test_a_number_that_is_no_power_of_two_is_noted_not_warned_of() -> None:
    assert "64 rather than 70" in design("sobol", 70).note
    assert everything(design("sobol", 70)).shape == (5, 70)
    assert design("sobol", 64).note == ""
    assert design("latin_hypercube", 70).note == ""


def test_too_many_dimensions() -> None:
    with pytest.raises(InputError, match="at most 21201 dimensions, 30000 are needed"):
        space_filling("sobol", 30000, 4, 1, "x")


def test_factorial() -> None:
    assert_array_equal(factorial([2, 3]), [[0, 0, 0, 1, 1, 1], [0, 1, 2, 0, 1, 2]])
    assert factorial([]).shape == (0, 1)
