"""Fields and rows of tables, ticks of counts: infinite values are blank, long tables are cut."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar, cast

from hillsphere.presentation import Table
from hillsphere.show.tables import finite_or_blank

__all__ = ["finite_fields", "first_rows", "whole_step"]

Product = TypeVar("Product")

_TICKS = 10
"""Ticks of an axis of counts at most: their numbers do not touch on a narrow page."""


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
    return max(1.0, -(-count // _TICKS))
