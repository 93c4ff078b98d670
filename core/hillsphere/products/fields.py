"""Declarations of a product's fields: shape, label and significant digits, beside the type.

::

    @dataclass(frozen=True)
    class Heights:
        labels: Annotated[tuple[str, ...], Shape("orbits"), Label("orbit")]
        altitude_m: Annotated[Array, Shape("orbits", 3), Label("altitude", 5, "km")]

The unit is the suffix of the field's name. Files of products are checked against the shapes
(`hillsphere.products.product_codec`), tables take labels, units and digits from here
(`hillsphere.show.tables`). A field without a declaration may hold anything that can be stored.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np

from hillsphere.base.errors import InputError

__all__ = ["DeclaredField", "Label", "Shape", "declared_fields", "dimension_sizes"]

_DIMENSION = re.compile(r"([A-Za-z]\w*)(?: ?\+ ?(\d+))?", re.ASCII)


@dataclass(frozen=True, init=False)
class Shape:
    """Shape of an array, or length of a tuple, in the annotation of a product's field.

    Parameters
    ----------
    *dimensions : int or str
        A number, or the name of a dimension (``"orbits"``), whose size is the same in all fields
        of a product; ``"bands + 1"`` is one larger. A field that may be ``None`` must have the
        shape unless it is ``None``.

    Raises
    ------
    ValueError
        If a dimension is neither.
    """

    dimensions: tuple[int | str, ...]

    def __init__(self, *dimensions: int | str) -> None:
        for dimension in dimensions:
            if isinstance(dimension, str) and not _DIMENSION.fullmatch(dimension):
                raise ValueError(
                    f"a dimension is a number, a name, or a name plus a number, got {dimension!r}"
                )
        object.__setattr__(self, "dimensions", dimensions)

    def __str__(self) -> str:
        inside = ", ".join(map(str, self.dimensions))
        return f"({inside},)" if len(self.dimensions) == 1 else f"({inside})"


@dataclass(frozen=True)
class Label:
    """Presentation of a field in tables, in the annotation of a product's field.

    Parameters
    ----------
    text : str
        Heading of its columns.
    digits : int
        Significant digits shown.
    unit : str
        Suffix of the displayed unit, ``"km"``; by default that of the field's name.
    """

    text: str
    digits: int = 8
    unit: str = ""


@dataclass(frozen=True)
class DeclaredField:
    """Declaration of one field of a product's class.

    Parameters
    ----------
    name : str
        Name of the field.
    shape : Shape or None
        Declared shape, if any.
    label : Label or None
        Declared label, if any.
    is_text : bool
        Whether it holds strings or truth values: its columns have no unit.
    """

    name: str
    shape: Shape | None
    label: Label | None
    is_text: bool


@cache
def declared_fields(cls: type) -> Mapping[str, DeclaredField]:
    """Return the declarations of all fields of a product class, inherited ones included.

    Parameters
    ----------
    cls : type
        A dataclass.

    Returns
    -------
    mapping
        Name of the field → its declaration.

    Raises
    ------
    InputError
        If an annotation cannot be evaluated in a class that uses ``Annotated``: the names in it
        must be imported at run time too.
    """
    try:
        hints = get_type_hints(cls, include_extras=True)
    except NameError as error:
        texts = [str(text) for base in cls.__mro__ for text in vars(base).get(
            "__annotations__", {}).values()]  # fmt: skip
        if any("Annotated" in text for text in texts):
            raise InputError(
                f"the fields of {cls.__name__} cannot be read: {error}; import the name at run "
                "time, not only for type checking"
            ) from error
        hints = {}
    return {field.name: _declaration_of(field.name, hints.get(field.name)) for field in fields(cls)}


def dimension_sizes(product: Any, **known: int) -> dict[str, int]:
    """Return the sizes of a product's named dimensions; check all its fields on the way.

    Parameters
    ----------
    product : object
        An instance of a dataclass.
    **known : int
        Sizes that dimensions must have.

    Returns
    -------
    dict of str to int
        Dimension → size. Nested products are not checked.

    Raises
    ------
    InputError
        If a field has another shape than its class declares; the message names the field and both
        shapes.
    """
    cls: type = type(product)
    sizes, origins = dict(known), dict.fromkeys(known, "")
    for name, declared in declared_fields(cls).items():
        value = getattr(product, name)
        if declared.shape is None or value is None:
            continue
        wanted = declared.shape.dimensions
        # The items of a tuple may be arrays of different lengths, which have no shape together.
        shape = (len(value),) if isinstance(value, tuple) and len(wanted) == 1 else np.shape(value)
        fits = len(shape) == len(wanted)
        for dimension, size in zip(wanted, shape, strict=False):
            stem, more = _split(dimension)
            if fits and stem and stem not in sizes and size >= more:
                sizes[stem], origins[stem] = size - more, f" by {name}"
            fits = fits and size == (sizes.get(stem, -1 - more) if stem else 0) + more
        if not fits:
            stems = dict.fromkeys(stem for stem, _ in map(_split, wanted) if stem in sizes)
            given = ", ".join(f"{stem} = {sizes[stem]}{origins[stem]}" for stem in stems)
            raise InputError(
                f"{cls.__name__}.{name} must have the shape {declared.shape}"
                f"{f' with {given}' if given else ''}, got {shape}"
            )
    return sizes


def _split(dimension: int | str) -> tuple[str, int]:
    """Return name and addend of a dimension; a number has no name."""
    if isinstance(dimension, int):
        return "", dimension
    match = _DIMENSION.fullmatch(dimension)
    assert match is not None, "checked by Shape"
    return match[1], int(match[2] or 0)


def _declaration_of(name: str, hint: Any) -> DeclaredField:
    parts = [hint, *get_args(hint)]  # of `Annotated[…] | None` too
    marks = [m for part in parts if get_origin(part) is Annotated for m in part.__metadata__]
    shapes = [mark for mark in marks if isinstance(mark, Shape)]
    labels = [mark for mark in marks if isinstance(mark, Label)]
    return DeclaredField(
        name,
        shapes[0] if shapes else None,
        labels[0] if labels else None,
        _holds(hint, (str, bool, np.str_, np.bool_)),
    )


def _holds(hint: Any, types: tuple[type, ...]) -> bool:
    return hint in types or any(_holds(part, types) for part in get_args(hint))
