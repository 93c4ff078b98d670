"""Cells and rows of tables, whole ticks: infinite values are blank, long tables are cut."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from hillsphere.interfaces import Array
from hillsphere.presentation import Table

__all__ = ["finite_fields", "finite_or_blank", "first_rows", "whole_step"]

Product = TypeVar("Product")

_TICKS = 10
"""Ticks of an axis of counts at most: their numbers do not touch on a narrow page."""


def finite_or_blank(values: Array | Sequence[float]) -> NDArray[np.float64]:
    """Return values with NaN, which tables show as blank, in place of infinite ones."""
    given = np.asarray(values, dtype=float)
    return np.where(np.isfinite(given), given, np.nan)


def finite_fields(product: Product, *names: str) -> Product:
    """Return a product whose named fields have NaN in place of infinite values."""
    fields = {name: finite_or_blank(getattr(product, name)) for name in names}
    return cast(Product, replace(cast(Any, product), **fields))


def first_rows(table: Table, count: int, what: str = "") -> Table:
    """Return a table cut to a number of rows.

    Parameters
    ----------
    table : Table
        The whole table.
    count : int
        Rows at most.
    what : str
        What the rows are, ``"models"``, for a note that the table is cut; empty for no note.
    """
    total = len(table.rows)
    if total <= count:
        return table
    notes = [*table.notes, f"The first {count} of {total} {what}."] if what else table.notes
    return replace(table, rows=table.rows[:count], notes=notes)


def whole_step(count: float) -> float:
    """Return the distance of ticks at whole numbers, for an axis of counts up to `count`."""
    return max(1.0, float(np.ceil(count / _TICKS)))
