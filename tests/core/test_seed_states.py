"""Generators made many at a time are NumPy's own."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from hillsphere.base.seed_states import generators
from hillsphere.base.seeds import name_key


def test_known_streams() -> None:
    numbers = np.array([0, 1, 17, 63, 100_000, 2**32 - 1])
    place, what = name_key("verify"), name_key("dispersions.field")
    for number, generator in zip(
        numbers.tolist(), generators(7, place, numbers, what), strict=True
    ):
        sequence = np.random.SeedSequence(7, spawn_key=(place, number, what))
        expected = np.random.default_rng(sequence)
        assert_array_equal(generator.random(5), expected.random(5))
        assert_array_equal(generator.standard_normal(9), expected.standard_normal(9))


SEEDS = st.integers(0, 2**63 - 1) | st.integers(0, 2**200)
KEYS = st.integers(0, 2**64 - 1) | st.integers(0, 2**32)


@settings(max_examples=200, deadline=None)
@given(seed=SEEDS, place=KEYS, what=KEYS, numbers=st.lists(st.integers(0, 2**32 - 1), max_size=4))
def test_any_keys(seed: int, place: int, what: int, numbers: list[int]) -> None:
    made = [g.random() for g in generators(seed, place, np.array(numbers, dtype=np.int64), what)]
    expected = [
        np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(place, n, what))).random()
        for n in numbers
    ]
    assert made == expected


def test_half_used_words_are_not_carried_over() -> None:
    """Numbers of 32 bits come in pairs; a new stream begins without the other half of one."""
    numbers = np.arange(4)
    once = [int(g.integers(2**32, dtype=np.uint32)) for g in generators(1, 2, numbers, 3)]
    key = [np.random.SeedSequence(1, spawn_key=(2, n, 3)) for n in range(4)]
    assert once == [int(np.random.default_rng(k).integers(2**32, dtype=np.uint32)) for k in key]
