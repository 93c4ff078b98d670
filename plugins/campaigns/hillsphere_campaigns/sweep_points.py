"""Points of a sweep: grids, samples between ends, and lists from files."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any, Literal

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.cases.designs import factorial, space_filling
from hillsphere.cases.specs import RangeSpec
from hillsphere.cases.swept import Swept
from hillsphere.errors import InputError
from hillsphere.products import CaseList
from hillsphere.uncertainty.samples import read_columns

__all__ = ["MOST_POINTS", "case_list", "cross_points", "grid", "points_of_list", "sample_ranges"]

MOST_POINTS = 10_000_000
"""Points of a sweep at most: their table alone would fill a gigabyte."""

_WITH_UNIT = re.compile(r"(?P<name>.*\S)\s*\[(?P<unit>[^\[\]]*)\]")


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


def sample_ranges(
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


def points_of_list(cases: CaseList) -> Swept:
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


def cross_points(rows: Swept, others: Swept) -> Swept:
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
    """Return values that divide a range at the fractions u; exact at both ends."""
    if given.spacing == "log":
        inner = given.first * (given.last / given.first) ** u
    else:
        inner = given.first + (given.last - given.first) * u
    return np.where(u == 0.0, given.first, np.where(u == 1.0, given.last, inner))
