"""Designs: where in the unit cube, or among the swept values, the cases of a campaign lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import prod
from typing import Literal

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.base.seed_states import generators
from hillsphere.base.seeds import name_key

__all__ = ["Design", "DesignName", "factorial", "random_rows", "space_filling"]

DesignName = Literal["random", "latin_hypercube", "sobol", "sobol_indices"]

_MOST_SOBOL = 21201
"""Dimensions of the direction numbers that scipy has."""

_AT_ONCE = 1024
"""Cases that are drawn together: their neighbours are asked for next."""

_KEPT = 64
"""Groups of random cases that are kept, as their inputs are asked for again for the table: all of
65 536 cases, and more than the tasks under way of a larger campaign. One of 24 quantities has
200 kB."""


@dataclass
class Design:
    """Numbers in (0, 1) for the cases that differ at random.

    ``random`` draws each case from generators of its own, one for each group of quantities: a case
    does not change when others are added, nor when another group is. ``latin_hypercube`` [1]_ and
    ``sobol`` (scrambled, [2]_) fill the space more evenly but belong together as
    a whole; their number of cases is part of them, but for ``sobol``, whose first cases are those
    of a shorter one. ``sobol_indices`` consists of the samples A, B and, for each quantity i, A
    with i taken from B ([3]_), one after the other.

    Parameters
    ----------
    name : str
        One of these.
    cases : int
        Number n of cases; for ``sobol_indices`` of each sample.
    groups : tuple of (str, int)
        Name and number of quantities of each group, k in all.
    seed : int
        Root seed of the mission.
    stream : str
        Name of the campaign's random numbers.

    Raises
    ------
    InputError
        If there are more quantities than a Sobol sequence has dimensions.

    References
    ----------
    .. [1] M. D. McKay, R. J. Beckman, W. J. Conover (1979), A comparison of three methods for
       selecting values of input variables …, Technometrics 21.
    .. [2] J. Matoušek (1998), On the L2-discrepancy for anchored boxes, J. Complexity 14.
    .. [3] A. Saltelli et al. (2010), Variance based sensitivity analysis of model output, Comput.
       Phys. Commun. 181.
    """

    name: DesignName
    cases: int
    groups: tuple[tuple[str, int], ...]
    seed: int
    stream: str
    _whole: Array | None = field(init=False, repr=False, default=None)
    _groups: dict[int, Array] = field(init=False, repr=False, default_factory=dict)

    def __getstate__(self) -> dict[str, object]:
        """Leave out what can be drawn again, for workers."""
        return vars(self) | {"_whole": None, "_groups": {}}

    @property
    def quantities(self) -> int:
        """Number k of quantities."""
        return sum(count for _, count in self.groups)

    @property
    def total(self) -> int:
        """Number of all cases: n, for ``sobol_indices`` n (k + 2)."""
        return self.cases * (self.quantities + 2 if self.name == "sobol_indices" else 1)

    def draws(self, which: Integers) -> Integers:
        """Return the numbers by which cases draw their noise.

        Their own; in ``sobol_indices`` that of their row in the sample, so that what differs
        between A, B and the others is the inputs alone.
        """
        return which % self.cases

    def unit(self, which: Integers) -> Array:
        """Return the numbers (k, N) of some cases, all in (0, 1)."""
        row = which % self.cases
        if self.name == "random":
            return self._random(row)
        if self._whole is None:
            what: Literal["latin_hypercube", "sobol"] = (
                "latin_hypercube" if self.name == "latin_hypercube" else "sobol"
            )
            self._whole = space_filling(what, self._dimensions, self.cases, self.seed, self.stream)
        if self.name != "sobol_indices":
            return np.ascontiguousarray(self._whole[:, row])
        k, sample = self.quantities, which // self.cases
        of_b = (sample == 1) | (sample - 2 == np.arange(k)[:, None])
        return np.where(of_b, self._whole[k:, row], self._whole[:k, row])

    def _random(self, row: Integers) -> Array:
        """Return random numbers (k, N) of rows; those used last are kept."""
        values = np.empty((self.quantities, len(row)))
        group = row // _AT_ONCE
        for number in np.unique(group).tolist():
            drawn = self._groups.pop(number, None)
            if drawn is None:
                first = number * _AT_ONCE
                here = np.arange(first, min(first + _AT_ONCE, self.cases))
                drawn = random_rows(self.groups, here, self.seed, self.stream)
            self._groups[number] = drawn  # the last one is the youngest
            places = np.flatnonzero(group == number)
            values[:, places] = drawn[:, row[places] - number * _AT_ONCE]
        while len(self._groups) > _KEPT:
            del self._groups[next(iter(self._groups))]
        return values

    @property
    def _dimensions(self) -> int:
        return self.quantities * (2 if self.name == "sobol_indices" else 1)

    @property
    def note(self) -> str:
        """What a reader should know of the number of cases; ``""`` for nothing."""
        if self.name in ("sobol", "sobol_indices") and self.cases & (self.cases - 1):
            near = 1 << max(0, round(np.log2(self.cases)))
            return (
                f"A Sobol sequence is balanced for a power of two only: {near} rather than "
                f"{self.cases} would estimate better."
            )
        return ""


def random_rows(
    groups: Sequence[tuple[str, int]], draws: Integers, seed: int, stream: str
) -> Array:
    """Draw uniform numbers, for each draw number and group from a generator of its own.

    Parameters
    ----------
    groups : sequence of (str, int)
        Name of each group and the number of its quantities, k in all.
    draws : ndarray of int, shape (N,)
        Draw numbers, ≥ 0.
    seed : int
        Root seed of the mission.
    stream : str
        Name of the campaign's random numbers.

    Returns
    -------
    ndarray, shape (k, N)
        In (0, 1), from PCG64 seeded by ``SeedSequence(seed, spawn_key=(key of stream, draw, key of
        "dispersions.GROUP"))``, see `hillsphere.base.seeds`.
    """
    place, begin = name_key(stream), 0
    out = np.empty((len(draws), sum(count for _, count in groups)))
    for name, count in groups:
        drawn = np.empty((len(draws), count))
        what = name_key(f"dispersions.{name}")
        for line, generator in zip(drawn, generators(seed, place, draws, what), strict=True):
            generator.random(out=line)
        out[:, begin : begin + count] = drawn
        begin += count
    return _inside(out.T)


def space_filling(
    name: Literal["latin_hypercube", "sobol"], dimensions: int, count: int, seed: int, stream: str
) -> Array:
    """Return points that fill the unit cube more evenly than random ones.

    Parameters
    ----------
    name : str
        ``"latin_hypercube"`` or ``"sobol"``, the latter scrambled.
    dimensions : int
        Dimensions d of the cube.
    count : int
        Number of points.
    seed : int
        Root seed of the mission.
    stream : str
        Name of the random numbers.

    Returns
    -------
    ndarray, shape (d, count)
        In (0, 1).

    Raises
    ------
    InputError
        If a Sobol sequence has not so many dimensions.
    """
    sequence = np.random.SeedSequence(seed, spawn_key=(name_key(stream), name_key(name)))
    generator = np.random.Generator(np.random.PCG64(sequence))
    if dimensions == 0:
        return np.empty((0, count))
    # Here: it takes most of a second, and a worker needs it for few campaigns.
    from scipy.stats import qmc

    if name == "latin_hypercube":
        points = qmc.LatinHypercube(dimensions, seed=generator).random(count)
    elif dimensions > _MOST_SOBOL:
        raise InputError(
            f"a Sobol sequence has at most {_MOST_SOBOL} dimensions, {dimensions} are needed; "
            "use 'latin_hypercube' or 'random'"
        )
    else:
        # Its beginning, whatever the number: asked for no power of two, scipy would warn.
        exponent = max(0, (count - 1).bit_length())
        points = qmc.Sobol(dimensions, scramble=True, seed=generator).random_base2(exponent)[:count]
    return _inside(np.ascontiguousarray(points.T))


def factorial(counts: Sequence[int]) -> Integers:
    """Return every combination of indices, the last varying fastest.

    Parameters
    ----------
    counts : sequence of int
        Number of values of each of d quantities.

    Returns
    -------
    ndarray of int, shape (d, P)
        P is the product of the counts: 1 if there are none.
    """
    if not counts:
        return np.empty((0, 1), dtype=np.int64)
    return np.indices(tuple(counts)).reshape(len(counts), prod(counts)).astype(np.int64)


def _inside(points: Array) -> Array:
    """Keep away from 0, which generators may yield and whose quantile may be infinite."""
    return np.maximum(points, 2.0**-54)
