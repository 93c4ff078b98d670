"""The plan of a campaign: which cases there are, with which inputs, in which blocks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array, Integers
from hillsphere.cases.designs import Design
from hillsphere.cases.repeated import Repeated
from hillsphere.cases.swept import Swept
from hillsphere.interfaces.cases import LANES, CaseBatch
from hillsphere.products.products import Ladder
from hillsphere.uncertainty.dispersed import Dispersed, Quantity

__all__ = ["Plan", "SweepVariant"]


@dataclass(frozen=True)
class SweepVariant:
    """One resolved mission of a sweep and the consecutive swept points that share it.

    A swept key that changes the mission needs a variant of its own. A swept quantity that the stage
    accepts per case (an initial offset, a gain) does not: see `per_case`.

    Parameters
    ----------
    repeated : Repeated
        The stage in it; the same object for variants whose stage does not differ.
    points : int
        Number of its points, which follow each other.
    dispersed : Dispersed
        The quantities that are drawn at random.
    sample : Design
        Random numbers of the repetitions, a row for each `active` quantity.
    active : ndarray of bool, shape (k,)
        Which of the dispersed quantities the design draws; the others stay at their median.
    per_case : mapping of int to Quantity
        Swept quantities that the stage accepts per case, by their rows among the swept names.
    """

    repeated: Repeated
    points: int
    dispersed: Dispersed
    sample: Design
    active: NDArray[np.bool_]
    per_case: Mapping[int, Quantity]


class Plan:
    """The cases of a campaign; blocks are made when they are asked for.

    Case ``j · repetitions + r`` is repetition r at the swept point j; repetition r sees the same
    random numbers at every point. A block holds cases of one variant of the mission: a swept key
    makes variants, a swept quantity that the stage takes case by case makes none. The points of a
    variant follow each other.

    Parameters
    ----------
    variants : sequence of SweepVariant
        In the order of their points.
    swept : Swept
        The points.
    swept_units : sequence of str
        Units of what is swept; ``""`` for what is no number.
    swept_labels : sequence of str
        What each swept quantity is, in words, ``""`` where nothing declares it; may be empty.
    seed : int
        Root seed of the mission.
    stream : str
        Name of the campaign's random numbers.

    Attributes
    ----------
    cases, blocks, repetitions : int
        How many there are: cases in all, blocks, cases at each point.
    design : str
        As in `hillsphere.products.CaseTable`.
    variants : tuple of Repeated
        The stages to be built: what the second item of `block` counts. Points that differ in their
        dispersions alone share one.
    inputs, input_units : tuple of str
        Names and units of the k quantities that differ at random, each once, however many of the
        stage's inputs it sets: ``"gravity.phobos.C2,0"``; ``"state.x"`` for the stage's own.
    swept, swept_units, swept_labels : tuple of str
        Names, SI units and labels of the d quantities that are swept.
    notes : tuple of str
        What a reader of the results should know.
    """

    def __init__(
        self,
        variants: Sequence[SweepVariant],
        swept: Swept,
        swept_units: Sequence[str],
        swept_labels: Sequence[str] = (),
        *,
        seed: int,
        stream: str,
    ) -> None:
        sample = variants[0].sample
        self._variants, self._swept = tuple(variants), swept
        self._seed, self._stream = seed, stream
        self.repetitions = sample.total
        counts = np.array([v.points * self.repetitions for v in variants])
        self._first_case = np.concatenate([[0], np.cumsum(counts)])
        self._first_block = np.concatenate([[0], np.cumsum(-(-counts // LANES))])
        self.cases, self.blocks = int(self._first_case[-1]), int(self._first_block[-1])
        self.design = swept.design or sample.name
        stages = {id(v.repeated): v.repeated for v in variants}
        self.variants = tuple(stages.values())
        self._stage = [list(stages).index(id(v.repeated)) for v in variants]
        self.swept, self.swept_units = swept.names, tuple(swept_units)
        self.swept_labels = tuple(swept_labels)
        self.notes = (sample.note,) if sample.note else ()
        units = {q.name: q.unit for v in variants for q in v.dispersed.quantities}
        self.inputs, self.input_units = tuple(units), tuple(units.values())

    @property
    def points(self) -> Array | None:
        """Swept values, shape (d, P): d quantities at P points; None without a sweep.

        A quantity that is not a number is given by its index in the list of the mission.
        """
        return self._swept.points if self.swept else None

    @property
    def point_labels(self) -> tuple[str, ...]:
        """One name per point; none for no sweep."""
        return self._swept.named(self.swept_units) if self.swept else ()

    @property
    def ladder(self) -> Ladder | None:
        """Groups of points in each of which one quantity increases, if the list declares them."""
        return self._swept.ladder

    def point_of(self, cases: Integers) -> Integers:
        """Return the swept point of each case (N,)."""
        return cases // self.repetitions

    def draw_of(self, cases: Integers) -> Integers:
        """Return the number by which each case (N,) draws its noise."""
        return self._variants[0].sample.draws(cases % self.repetitions)

    def cases_of(self, blocks: range) -> int:
        """Return the number of cases in consecutive blocks."""
        return self._case(blocks.stop) - self._case(blocks.start)

    def _case(self, block: int) -> int:
        """Return the number of cases in the blocks before one."""
        at = int(np.searchsorted(self._first_block, block, side="right")) - 1
        if at == len(self._variants):
            return self.cases
        return int(self._first_case[at] + (block - self._first_block[at]) * LANES)

    def variant_of(self, block: int) -> int:
        """Return the number of a block's stage in `variants`."""
        return self._stage[int(np.searchsorted(self._first_block, block, side="right")) - 1]

    def block(self, number: int) -> tuple[CaseBatch, int]:
        """Return a block and the number of its stage in `variants`.

        Parameters
        ----------
        number : int
            0 … `blocks` − 1.

        Returns
        -------
        tuple of CaseBatch and int
            The same for the same number, whatever was asked before.
        """
        if not 0 <= number < self.blocks:
            raise IndexError(f"block {number} of {self.blocks}")
        at = int(np.searchsorted(self._first_block, number, side="right")) - 1
        begin = self._first_case[at] + (number - self._first_block[at]) * LANES
        lanes = begin + np.arange(LANES)
        last = self._first_case[at + 1] - 1
        cases = np.minimum(lanes, last)
        variant = self._variants[at]
        drawn = self._drawn(variant, cases)
        names: list[str] = []
        rows: list[Array] = []
        quantities = variant.dispersed.quantities
        for quantity, row in zip(quantities, drawn, strict=True):
            names += quantity.inputs
            rows += [row] * len(quantity.inputs)
        dispersed = {quantity.name for quantity in quantities}
        for i, quantity in variant.per_case.items():
            if quantity.name not in dispersed:  # else its distribution lies about the swept value
                names += quantity.inputs
                rows += [self._at_points(i, cases)] * len(quantity.inputs)
        batch = CaseBatch(
            numbers=cases,
            draws=self.draw_of(cases),
            filler=lanes > last,
            names=tuple(names),
            values=np.array(rows).reshape(len(rows), LANES),
            seed=self._seed,
            stream=self._stream,
        )
        return batch, self._stage[at]

    def input_values(self, cases: Integers) -> Array:
        """Return the values (k, N) of `inputs` in some cases (N,), SI.

        NaN where a variant of the mission has no such quantity.
        """
        values = np.full((len(self.inputs), len(cases)), np.nan)
        rows = {name: i for i, name in enumerate(self.inputs)}
        of_variant = np.searchsorted(self._first_case, cases, side="right") - 1
        for at in np.unique(of_variant).tolist():
            variant, here = self._variants[at], np.flatnonzero(of_variant == at)
            into = np.array([rows[q.name] for q in variant.dispersed.quantities], dtype=np.int64)
            for part in np.split(here, range(_CHUNK, len(here), _CHUNK)):
                values[into[:, None], part] = self._drawn(variant, cases[part])
        return values

    def _drawn(self, variant: SweepVariant, cases: Integers) -> Array:
        """Return the values (k, N) of the dispersed quantities of a variant, SI."""
        u = np.full((len(variant.active), len(cases)), 0.5)
        u[variant.active] = variant.sample.unit(cases % self.repetitions)
        dispersed = {quantity.name for quantity in variant.dispersed.quantities}
        about = {i: q.name for i, q in variant.per_case.items() if q.name in dispersed}
        if not about:
            return variant.dispersed.values(u)
        values = np.empty(u.shape)
        points = self.point_of(cases)
        for point in np.unique(points).tolist():
            here = points == point
            nominal = {name: float(self._swept.points[i, point]) for i, name in about.items()}
            values[:, here] = variant.dispersed.values(u[:, here], nominal)
        return values

    def _at_points(self, row: int, cases: Integers) -> Array:
        return np.asarray(self._swept.points[row, self.point_of(cases)])


_CHUNK = 64 * LANES
"""Cases whose inputs are made at once, so that memory stays small."""
