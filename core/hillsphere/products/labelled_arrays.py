"""Products as labelled arrays of xarray."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from hillsphere.base.errors import InputError
from hillsphere.products.fields import declared_fields

if TYPE_CHECKING:
    import xarray

__all__ = ["to_xarray"]


def to_xarray(product: Any) -> xarray.Dataset:
    """Return the arrays of a product as a data set.

    Parameters
    ----------
    product : object
        A dataclass: the product of a stage.

    Returns
    -------
    xarray.Dataset
        Its arrays, numbers and tuples of numbers or texts; those of a product within it as
        ``"field.name"``. Dimensions have the names that the product declares; an axis without one
        is called ``"NAME_0"`` after its array, the second of one name ``"states_2"``. The unit is
        the suffix of a name, SI.

    Raises
    ------
    InputError
        If it is no dataclass.
    ImportError
        If xarray is not installed; the extra ``notebook`` brings it.
    """
    import xarray

    if not is_dataclass(product) or isinstance(product, type):
        raise InputError(f"expected a product, got {product!r}")
    return xarray.Dataset({name: (axes, values) for name, axes, values in _arrays(product, "")})


def _arrays(product: Any, before: str) -> Iterator[tuple[str, tuple[str, ...], Any]]:
    declared = declared_fields(type(product))  # type: ignore[arg-type]
    for field in fields(product):
        value, name = getattr(product, field.name), before + field.name
        if is_dataclass(value):
            yield from _arrays(value, f"{name}.")
            continue
        try:
            array = np.asarray(value)
        except ValueError:  # a tuple of arrays of different lengths
            continue
        if array.dtype.kind not in "bifcU":
            continue
        if not array.size and not isinstance(value, np.ndarray):
            continue  # an empty tuple, of whatever type
        shape = declared[field.name].shape
        given = shape.dimensions if shape is not None else ()
        axes = given if len(given) == array.ndim else range(array.ndim)
        yield name, tuple(_axis_names(axes, before, name)), array


def _axis_names(axes: Sequence[int | str], before: str, name: str) -> Iterator[str]:
    seen: dict[str, int] = {}
    for index, axis in enumerate(axes):
        text = before + axis.replace(" ", "") if isinstance(axis, str) else f"{name}_{index}"
        count = seen[text] = seen.get(text, 0) + 1
        yield text if count == 1 else f"{text}_{count}"  # a matrix has one dimension twice
