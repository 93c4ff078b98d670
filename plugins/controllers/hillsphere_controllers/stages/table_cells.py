"""Fields and rows of the stages' tables: infinite values are blank, long tables are cut."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar, cast

from hillsphere.presentation import Table
from hillsphere.show.tables import finite_or_blank

__all__ = ["finite_fields", "first_rows"]

Product = TypeVar("Product")


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
