from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from hillsphere.errors import InputError
from hillsphere_controllers.mu.blocks import (
    Block,
    BlockStructure,
    full,
    repeated_complex,
    repeated_real,
)


def mixed() -> BlockStructure:
    return BlockStructure([repeated_real(2, "mass"), full(1, 3, "flex"), repeated_complex(1)])


def test_sizes() -> None:
    structure = mixed()
    assert structure.shape == (6, 4)  # M has as many outputs as Δ has columns
    assert_array_equal(structure.sizes, [2, 3, 1])
    assert structure.size == 6
    assert_array_equal(structure.real(), [True, True, False, False, False, False])
    assert not structure.purely_real
    assert BlockStructure([repeated_real()]).purely_real


def test_squared_matrix_closes_the_same_loop() -> None:
    structure = mixed()
    random = np.random.default_rng(0)
    m = random.normal(size=(6, 4)) + 1j * random.normal(size=(6, 4))
    row = np.zeros((3, 3))
    row[0] = 0.5
    delta = structure.perturbation([0.3, row, 0.2j])
    inner = structure.remove_padding(delta)
    assert inner.shape == (4, 6)
    direct = np.linalg.det(np.eye(6) - m @ inner)
    squared = np.linalg.det(np.eye(6) - structure.pad_to_square(m) @ delta)
    np.testing.assert_allclose(squared, direct, rtol=1e-12)


def test_parts_and_values() -> None:
    structure = mixed()
    delta = np.zeros((4, 6), dtype=complex)
    delta[:2, :2] = 0.25 * np.eye(2)
    delta[2, 2:5] = 1.0
    delta[3, 5] = 1j
    assert structure.real_values(delta) == {"mass": 0.25}
    assert BlockStructure([repeated_real()]).real_values(np.array([[2.0 + 0j]])) == {"0": 2.0}
    parts = [delta[rows, columns] for rows, columns in structure.parts()]
    assert [part.shape for part in parts] == [(2, 2), (1, 3), (1, 1)]
    assert parts[2][0, 0] == 1j


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: BlockStructure([]), "at least one block"),
        (lambda: full(0), "at least one row"),
        (lambda: Block("real", 1, 2), "square"),
        (lambda: mixed().pad_to_square(np.ones((4, 6))), "close a matrix of 6 × 4, got 4 × 6"),
        (lambda: mixed().indices([3]), "no block 3; they are numbered 0 to 2"),
    ],
)
def test_what_does_not_fit(make: Callable[[], object], match: str) -> None:
    with pytest.raises(InputError, match=match):
        make()


def test_what_is_no_block_and_no_matrix_is_refused() -> None:
    wrong: Any = "foo"
    half: Any = 1.5
    for make, match in (
        (lambda: Block(wrong, 1, 1), "no kind of block"),
        (lambda: repeated_real(half), "whole number"),
        (lambda: BlockStructure([repeated_real(1, "a"), repeated_real(1, "a")]), "one name"),
        (lambda: mixed().pad_to_square(np.full(mixed().shape, np.nan)), "finite numbers"),
        (lambda: mixed().pad_to_square(np.full(mixed().shape, 1e200)), "scale"),
    ):
        with pytest.raises(InputError, match=match):
            make()
