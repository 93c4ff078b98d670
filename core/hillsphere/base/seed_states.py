"""Seeding of many random generators at once, with the same streams as NumPy's SeedSequence.

``numpy.random.PCG64(numpy.random.SeedSequence(seed, spawn_key=(place, number, what)))`` takes about
13 µs, mostly to make objects. Here the same states come from array operations, and one generator is
set to each in turn. Both algorithms are fixed by NumPy's promise of reproducible streams ([1]_).

References
----------
.. [1] R. Kern, NEP 19: Random number generator policy (2018–2019); M. E. O'Neill, PCG: A family of
   simple fast space-efficient statistically good algorithms for random number generation (2014).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Integers

__all__ = ["generators"]

_Words = NDArray[np.uint32]

_POOL = 4
"""Words of entropy that NumPy's SeedSequence holds: its default ``pool_size``."""
# Constants of the hash and mixing functions of NumPy's SeedSequence: they must be its own, or the
# streams differ from those that NumPy promises to keep.
_INIT_A, _MULT_A = 0x43B0D7E5, 0x931E8875
# Those of its output function.
_INIT_B, _MULT_B = 0x8B51F9DD, 0x58F38DED
_MIX_L, _MIX_R = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
_SHIFT = np.uint32(16)
_MASK = 2**32 - 1
"""Reduces Python integers modulo 2³², as the hash computes with words of 32 bits."""
_PCG_MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
"""Multiplier of PCG64's linear congruential generator ([1]_, O'Neill)."""
_MASK_128 = 2**128 - 1
"""Reduces Python integers modulo 2¹²⁸, the modulus of PCG64."""


def generators(
    seed: int, place: int, numbers: Integers, what: int
) -> Iterator[np.random.Generator]:
    """Yield the generator of each number, seeded by ``spawn_key=(place, number, what)``.

    Parameters
    ----------
    seed : int
        Root seed, ≥ 0.
    place, what : int
        Elements of the spawn key before and after the number, ≥ 0
        (`hillsphere.base.seeds.name_key`).
    numbers : ndarray of int, shape (N,)
        Middle elements of the spawn keys, 0 … 2³² − 1.

    Yields
    ------
    numpy.random.Generator
        One object, set anew to the beginning of each number's stream: draw from it before the next
        one is requested.
    """
    bits = np.random.PCG64(0)
    generator = np.random.Generator(bits)
    state = bits.state
    for high, low, increment_high, increment_low in _seeds(seed, place, numbers, what).T.tolist():
        # The seeding of PCG: a step from 0, the seed added, another step.
        increment = (((increment_high << 64 | increment_low) << 1) | 1) & _MASK_128
        begun = (increment + (high << 64 | low)) & _MASK_128
        state["state"]["state"] = (begun * _PCG_MULTIPLIER + increment) & _MASK_128
        state["state"]["inc"] = increment
        bits.state = state
        yield generator


def _seeds(seed: int, place: int, numbers: Integers, what: int) -> NDArray[np.uint64]:
    """Return ``SeedSequence(…).generate_state(4, np.uint64)`` for each number, shape (4, N)."""
    count = len(numbers)
    head = _words_of(seed)
    head += [0] * (_POOL - len(head))
    entropy: list[_Words] = [np.full(count, word, np.uint32) for word in head]
    entropy += [np.full(count, word, np.uint32) for word in _words_of(place)]
    entropy.append(numbers.astype(np.uint32))
    entropy += [np.full(count, word, np.uint32) for word in _words_of(what)]

    constant = _INIT_A

    def hashed(value: _Words) -> _Words:
        nonlocal constant
        value = value ^ np.uint32(constant)
        constant = constant * _MULT_A & _MASK
        value = value * np.uint32(constant)
        return np.asarray(value ^ (value >> _SHIFT))

    def mixed(x: _Words, y: _Words) -> _Words:
        value = _MIX_L * x - _MIX_R * y
        return np.asarray(value ^ (value >> _SHIFT))

    pool = [hashed(word) for word in entropy[:_POOL]]
    for source in range(_POOL):
        for target in range(_POOL):
            if source != target:
                pool[target] = mixed(pool[target], hashed(pool[source]))
    for word in entropy[_POOL:]:
        for target in range(_POOL):
            pool[target] = mixed(pool[target], hashed(word))

    constant = _INIT_B
    out: list[_Words] = []
    for i in range(2 * 4):
        value = pool[i % _POOL] ^ np.uint32(constant)
        constant = constant * _MULT_B & _MASK
        value = value * np.uint32(constant)
        out.append(value ^ (value >> _SHIFT))
    low, high = np.array(out[0::2], np.uint64), np.array(out[1::2], np.uint64)
    return low | high << np.uint64(32)


def _words_of(number: int) -> list[int]:
    """Return a number ≥ 0 in words of 32 bits, the lowest first; 0 is one word."""
    words = [number & _MASK]
    while number := number >> 32:
        words.append(number & _MASK)
    return words
