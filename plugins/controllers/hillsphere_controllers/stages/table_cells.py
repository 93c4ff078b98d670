"""Cells of tables and ticks of counts: infinite values are blank."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar, cast

from hillsphere.show.tables import finite_or_blank

__all__ = ["finite_fields", "whole_step"]

Product = TypeVar("Product")

_TICKS = 10
"""Ticks of an axis of counts at most: their numbers do not touch on a narrow page."""


def finite_fields(product: Product, *names: str) -> Product:
    """Return a product whose named fields have NaN in place of infinite values."""
    fields = {name: finite_or_blank(getattr(product, name)) for name in names}
    return cast(Product, replace(cast(Any, product), **fields))


def whole_step(count: float) -> float:
    """Return the distance of ticks at whole numbers, for an axis of counts up to `count`."""
    return max(1.0, -(-count // _TICKS))
