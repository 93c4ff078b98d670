"""What a sweep changes from point to point, before it is known what the stage makes of it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hillsphere.arrays import Array, Integers
from hillsphere.campaign.designs import factorial, space_filling
from hillsphere.campaign.specs import RangeSpec
from hillsphere.errors import InputError
from hillsphere.products import CaseList, Ladder
from hillsphere.uncertainty.samples import read_columns

__all__ = [
    "MOST_POINTS", "Swept", "case_list", "crossed", "grid", "listed", "no_sweep", "sampled",
]  # fmt: skip

MOST_POINTS = 10_000_000

_WITH_UNIT = re.compile(r"(?P<name>.*\S)\s*\[(?P<unit>[^\[\]]*)\]")


@dataclass(frozen=True)
class Swept:
    """Points of a sweep.

    Parameters
    ----------
    design : str
        ``"grid"``, ``"latin_hypercube"``, ``"sobol"``, ``"list"``; ``""`` for no sweep.
    names : tuple of str
        The d things that are changed, by table and key.
    levels : tuple of tuple
        The values that each takes, as a mission would write them.
    index : ndarray of int, shape (d, P)
        Which of them it takes at each of the P points.
    labels : tuple of str
        One name per point; empty for names made of the values.
    units : tuple of str
        What its numbers are said to be in, one per name, ``""`` for nothing said; may be empty.
    ladder : Ladder or None
        Of the P points, if a list has one.
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
        """Whether each takes numbers only."""
        return tuple(
            all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
            for values in self.levels
        )

    @cached_property
    def points(self) -> Array:
        """Values (d, P); of what is no number its place in the list."""
        made = np.empty(self.index.shape)
        for i, (values, number) in enumerate(zip(self.levels, self.numeric, strict=True)):
            table = np.array(values, dtype=float) if number else np.arange(len(values), dtype=float)
            made[i] = table[self.index[i]]
        return made

    def reordered(self, order: Integers) -> Swept:
        """Return the same points in another order."""
        labels = tuple(self.labels[i] for i in order.tolist()) if self.labels else ()
        index = np.ascontiguousarray(self.index[:, order])
        ladder = self.ladder
        if ladder is not None:
            groups = tuple(ladder.groups[i] for i in order.tolist())
            ladder = replace(ladder, values=ladder.values[order], groups=groups)
        return replace(self, index=index, labels=labels, ladder=ladder)

    def of_stage(self, stage: str) -> Swept:
        """Return the same with the repeated stage's name where ``repeat`` stands for it.

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
                f"{name} = {_shown(value)}{'' if unit in ('', '-') else ' ' + unit}"
                for value in level
            ]
            for name, level, unit in zip(self.names, self.levels, units, strict=True)
        ]
        return tuple(
            ", ".join(text[i] for text, i in zip(texts, column, strict=True))
            for column in self.index.T.tolist()
        )


def no_sweep() -> Swept:
    """Return the one point at which nothing is changed."""
    return Swept("", (), (), np.empty((0, 1), dtype=np.int64))


def grid(over: Mapping[str, Sequence[Any] | RangeSpec]) -> Swept:
    """Return every combination of values, those of the last name varying fastest.

    Parameters
    ----------
    over : mapping
        Name → its values, or a range with its number of points.

    Returns
    -------
    Swept
        The points.

    Raises
    ------
    InputError
        If there are no values, or more than ten million points.
    """
    levels = []
    for name, given in over.items():
        if isinstance(given, RangeSpec):
            if given.points is None:
                raise InputError(f"{name}: a grid needs the number of points")
            inner = np.linspace(0.0, 1.0, given.points)
            levels.append(tuple(_in_range(given, inner).tolist()))
        else:
            levels.append(tuple(given))
        if not levels[-1]:
            raise InputError(f"{name}: no values")
    count = prod(len(values) for values in levels)
    if count > MOST_POINTS:
        raise InputError(f"the grid has {count} points; at most {MOST_POINTS} can be computed")
    index = factorial([len(values) for values in levels])
    return Swept("grid", tuple(over), tuple(levels), index)


def sampled(
    over: Mapping[str, RangeSpec],
    design: Literal["latin_hypercube", "sobol"],
    count: int,
    *,
    seed: int,
    stream: str,
) -> Swept:
    """Return points that fill the space between the ends of ranges evenly.

    Parameters
    ----------
    over : mapping of str to RangeSpec
        Name → range.
    design : str
        How.
    count : int
        Number of points.
    seed : int
        Root seed of the mission.
    stream : str
        Name of the campaign's random numbers.

    Returns
    -------
    Swept
        The points.
    """
    cube = space_filling(design, len(over), count, seed, f"points of {stream}")
    levels = tuple(
        tuple(_in_range(given, row).tolist())
        for given, row in zip(over.values(), cube, strict=True)
    )
    index = np.tile(np.arange(count), (len(over), 1))
    return Swept(design, tuple(over), levels, index)


def listed(cases: CaseList) -> Swept:
    """Return the points of a list.

    Parameters
    ----------
    cases : CaseList
        The list.

    Returns
    -------
    Swept
        The points, in its order.

    Raises
    ------
    InputError
        If its parts do not fit together, it is empty or holds what is no finite number.
    """
    d, count = len(cases.names), cases.values.shape[-1]
    if cases.values.shape != (d, count) or len(cases.units) != d:
        raise InputError(
            f"list of cases: {d} names need {d} units and values ({d}, N), got "
            f"{len(cases.units)} and {cases.values.shape}"
        )
    if len(cases.labels) not in (0, count):
        raise InputError(f"list of cases: {len(cases.labels)} labels for {count} points")
    ladder = cases.ladder
    if ladder is not None and not (len(ladder.groups) == len(ladder.values) == count):
        raise InputError(
            f"list of cases: {len(ladder.values)} steps and {len(ladder.groups)} groups of a "
            f"ladder for {count} points"
        )
    if not d or not count or len(set(cases.names)) < d:
        raise InputError("list of cases: needs at least one point, and names that differ")
    if not np.isfinite(cases.values).all():
        row, point = np.argwhere(~np.isfinite(cases.values))[0]
        raise InputError(f"list of cases: {cases.names[row]} is not finite at point {point}")
    levels, index = [], np.empty((d, count), dtype=np.int64)
    for i, row in enumerate(cases.values):
        values, index[i] = np.unique(row, return_inverse=True)
        levels.append(tuple(values.tolist()))
    return Swept("list", cases.names, tuple(levels), index, cases.labels, cases.units, ladder)


def crossed(rows: Swept, others: Swept) -> Swept:
    """Return every row of a list with every point of a grid, those of the grid varying fastest.

    Parameters
    ----------
    rows : Swept
        The list, whose labels and ladder the result keeps, with what the grid changes.
    others : Swept
        The grid.

    Returns
    -------
    Swept
        The points.

    Raises
    ------
    InputError
        If both change the same, or there are more than ten million points.
    """
    if both := sorted(set(rows.names) & set(others.names)):
        raise InputError(f"{both[0]} stands in the rows and in 'over'; leave it out of one of them")
    count, times = rows.index.shape[1], others.index.shape[1]
    if count * times > MOST_POINTS:
        raise InputError(f"there are {count * times} points; at most {MOST_POINTS} can be computed")
    row, point = np.repeat(np.arange(count), times), np.tile(np.arange(times), count)
    more = others.named([""] * len(others.names))

    def with_others(names: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(f"{names[r]}, {more[k]}" for r, k in zip(row, point, strict=True))

    ladder = rows.ladder
    if ladder is not None:
        ladder = replace(ladder, values=ladder.values[row], groups=with_others(ladder.groups))
    return Swept(
        rows.design,
        rows.names + others.names,
        rows.levels + others.levels,
        np.concatenate([rows.index[:, row], others.index[:, point]]),
        with_others(rows.labels) if rows.labels else (),
        rows.units + ("",) * len(others.names) if rows.units else (),
        ladder,
    )


def case_list(path: str | Path) -> CaseList:
    """Read a list of points from a CSV file.

    Parameters
    ----------
    path : str or Path
        Its header names what is set, ``stage.hover.state.x`` or ``stage.hover.state.x [m]``; a name
        with a comma stands in double quotes. Every further line is a point.

    Returns
    -------
    CaseList
        The points.

    Raises
    ------
    InputError
        Naming file and line of what cannot be read.
    """
    columns = read_columns(path)
    parts = [_WITH_UNIT.fullmatch(name) for name in columns]
    names = tuple(m["name"] if m else name for m, name in zip(parts, columns, strict=True))
    units = tuple(m["unit"].strip() if m else "" for m in parts)
    return CaseList(names, units, np.array(list(columns.values())))


def _in_range(given: RangeSpec, u: Array) -> Array:
    """Return values at shares u of the way from one end to the other; both ends exactly."""
    if given.spacing == "log":
        inner = given.first * (given.last / given.first) ** u
    else:
        inner = given.first + (given.last - given.first) * u
    return np.where(u == 0.0, given.first, np.where(u == 1.0, given.last, inner))


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple) and all(isinstance(one, str) for one in value):
        return " + ".join(value) or "none"  # no commas: they separate the parts of a point's name
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return f"{value:.8g}"
