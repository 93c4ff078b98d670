"""Points of a sweep, before they are resolved to keys of the mission or inputs of the stage."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from hillsphere.base.arrays import Array, Integers
from hillsphere.base.errors import InputError
from hillsphere.products.products import Ladder

__all__ = ["Swept", "no_sweep"]


@dataclass(frozen=True)
class Swept:
    """Points of a sweep.

    Parameters
    ----------
    design : str
        ``"grid"``, ``"latin_hypercube"``, ``"sobol"``, ``"list"``; ``""`` for no sweep.
    names : tuple of str
        Names of the d swept quantities, by table and key.
    levels : tuple of tuple
        The values of each, as a mission would write them.
    index : ndarray of int, shape (d, P)
        Index of the value of each at the P points.
    labels : tuple of str
        One name per point; empty for names made of the values.
    units : tuple of str
        Units that a list declares, one per name, ``""`` where it declares none; may be empty.
    ladder : Ladder or None
        Ladder of the P points, if a list has one.
    """

    design: str
    names: tuple[str, ...]
    levels: tuple[tuple[Any, ...], ...]
    index: Integers
    labels: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    ladder: Ladder | None = None

    @cached_property
    def numeric(self) -> tuple[bool, ...]:
        """Whether each swept quantity takes numbers only."""
        return tuple(
            all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
            for values in self.levels
        )

    @cached_property
    def points(self) -> Array:
        """Values (d, P); a quantity that is not a number is given by its index in `levels`."""
        made = np.empty(self.index.shape)
        for i, (values, number) in enumerate(zip(self.levels, self.numeric, strict=True)):
            table = np.array(values, dtype=float) if number else np.arange(len(values), dtype=float)
            made[i] = table[self.index[i]]
        return made

    def reordered(self, order: Integers) -> Swept:
        """Return the points in another order."""
        labels = tuple(self.labels[i] for i in order.tolist()) if self.labels else ()
        index = np.ascontiguousarray(self.index[:, order])
        ladder = self.ladder
        if ladder is not None:
            groups = tuple(ladder.groups[i] for i in order.tolist())
            ladder = replace(ladder, values=ladder.values[order], groups=groups)
        return replace(self, index=index, labels=labels, ladder=ladder)

    def of_stage(self, stage: str) -> Swept:
        """Return the points with ``repeat`` in their names replaced by the name of the stage.

        Raises
        ------
        InputError
            If one key is named in both ways.
        """
        names = tuple(re.sub(r"^repeat\.", f"stage.{stage}.", name) for name in self.names)
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"{name} is swept twice: by this name and by that of 'repeat'")
        return replace(self, names=names)

    def named(self, units: Sequence[str]) -> tuple[str, ...]:
        """Return one name per point: its own, or one made of the values."""
        if self.labels:
            return self.labels
        texts = [
            [
                f"{name} = {_format_value(value)}{'' if unit in ('', '-') else ' ' + unit}"
                for value in level
            ]
            for name, level, unit in zip(self.names, self.levels, units, strict=True)
        ]
        return tuple(
            ", ".join(text[i] for text, i in zip(texts, column, strict=True))
            for column in self.index.T.tolist()
        )


def no_sweep() -> Swept:
    """Return a sweep of one point that changes nothing."""
    return Swept("", (), (), np.empty((0, 1), dtype=np.int64))


def _format_value(value: Any) -> str:
    if isinstance(value, list | tuple) and all(isinstance(one, str) for one in value):
        return " + ".join(value) or "none"  # no commas: they separate the parts of a point's name
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return f"{value:.8g}"
