"""Declarations of the fields of a Spec: quantities, options, references, needs, input files.

`hillsphere.spec` offers these names; import them from there.
"""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

from pydantic import Field

from hillsphere.base.problems import did_you_mean
from hillsphere.base.ranges import within_largest
from hillsphere.spec.units import units_of

__all__ = [
    "DataPath",
    "Pair",
    "Vector3",
    "data_path",
    "need",
    "option",
    "quantity",
    "reference",
    "repeated",
    "table_name",
]

_BOUNDS = ("gt", "ge", "lt", "le", "min_length", "max_length", "pattern")
"""Bounds that a field may have."""

Vector3: TypeAlias = tuple[float, float, float]
"""Type of a field with three numbers, as the components along x, y and z."""

Pair: TypeAlias = tuple[float, float]
"""Type of a field with two numbers."""


def quantity(dimension: str, description: str, *, default: Any = ..., **bounds: Any) -> Any:
    """Declare a physical quantity; the field's name must end in the SI suffix of its dimension.

    Parameters
    ----------
    dimension : str
        A key of `UNITS`.
    description : str
        Meaning and frame of the quantity, for the documentation and the JSON Schema.
    default : object, optional
        SI value; without it the key is required.
    **bounds
        pydantic bounds in SI (``gt``, ``ge``, ``lt``, ``le``, ``min_length``, ``max_length``). On
        an array of numbers the numeric bounds hold for each element. A side without a bound gets
        the largest magnitude of the dimension (`hillsphere.base.ranges`).

    Returns
    -------
    pydantic.fields.FieldInfo
        The field.

    Raises
    ------
    InputError
        If there is no such dimension.
    TypeError
        If there is no such bound.
    """
    units_of(dimension)  # refuses an unknown one
    given: dict[str, float] = {k: bounds.pop(k) for k in ("gt", "ge", "lt", "le") if k in bounds}
    bounds |= within_largest(dimension, given)
    return option(description, default=default, extra={"x-dimension": dimension}, **bounds)


def option(
    description: str, *, default: Any = ..., extra: dict[str, Any] | None = None, **bounds: Any
) -> Any:
    """Declare a parameter without unit: a count, a ratio, a choice.

    Parameters
    ----------
    description : str
        Meaning of the parameter.
    default : object, optional
        Without it the key is required.
    extra : dict, optional
        Further JSON Schema keys.
    **bounds
        pydantic bounds (``gt``, ``ge``, ``lt``, ``le``, ``min_length``, ``max_length``,
        ``pattern``); on an array of numbers the numeric ones hold for each element.

    Returns
    -------
    pydantic.fields.FieldInfo
        The field.

    Raises
    ------
    TypeError
        If there is no such bound.
    """
    # pydantic takes any other keyword as a remark for the schema, and the bound would not hold.
    if unknown := sorted({*bounds} - {*_BOUNDS}):
        hint = did_you_mean(unknown[0], _BOUNDS, otherwise="there are")
        raise TypeError(f"a field has no bound {unknown[0]!r}{hint}")
    schema = dict(extra or {})
    each = {k: bounds.pop(k) for k in ("gt", "ge", "lt", "le") if k in bounds}
    if each:
        schema["x-bounds"] = each
    return Field(default, description=description, json_schema_extra=schema or None, **bounds)


def reference(kind: str, description: str, *, default: Any = ...) -> Any:
    """Declare a reference to a component of another table; annotate the field as `Ref`.

    Parameters
    ----------
    kind : str
        Kind of the component, e.g. ``"gravity"``.
    description : str
        Purpose of the component.
    default : str or None, optional
        Without it the key is required.

    Returns
    -------
    pydantic.fields.FieldInfo
        The field.
    """
    return option(description, default=default, extra={"x-kind": kind})


def need(product: str, description: str, *, default: Any = ..., **bounds: Any) -> Any:
    """Declare a product of earlier stages; annotate the field ``Ref`` or ``tuple[Ref, ...]``.

    Parameters
    ----------
    product : str
        Import path ``"package.module:Class"`` of the product that the earlier stage must yield.
    description : str
        Purpose of the product.
    default : None, optional
        ``None`` makes the input optional.
    **bounds
        For several: ``min_length``, ``max_length``.

    Returns
    -------
    pydantic.fields.FieldInfo
        The field; it belongs in the nested Spec of a stage's ``needs``.
    """
    extra = {"x-kind": "stage", "x-product": product}
    return option(description, default=default, extra=extra, **bounds)


def repeated(description: str) -> Any:
    """Declare the stage that a campaign repeats; annotate the field as `Ref`.

    Parameters
    ----------
    description : str
        Use of the repeated stage.

    Returns
    -------
    pydantic.fields.FieldInfo
        The field. The stage is first run once with nominal values; `Stage.run` receives a
        `hillsphere.cases.repeated.Repeated` under the field's name.
    """
    return option(description, extra={"x-kind": "stage", "x-repeats": True})


def table_name(description: str) -> Any:
    """Declare the name of any table of the mission, ``"gravity.phobos"``; annotate it ``str``.

    Parameters
    ----------
    description : str
        Purpose of the table.

    Returns
    -------
    pydantic.fields.FieldInfo
        The field. Validation of the mission checks that the table exists. ``"stage"`` alone is the
        stage that a campaign repeats.
    """
    pattern = r"^(stage|[a-z_]+\.[a-z][a-z0-9_-]{0,63})$"
    return option(description, extra={"x-table": True}, pattern=pattern)


def data_path(description: str, *, default: Any = ...) -> Any:
    """Declare an input file; annotate the field as `DataPath`.

    Parameters
    ----------
    description : str
        Content of the file.
    default : str or None, optional
        Without it the key is required.

    Returns
    -------
    pydantic.fields.FieldInfo
        The field. A mission resolves it relative to its own file, then in the packaged data; the
        Spec that a component receives holds the absolute path.
    """
    return option(description, default=default, extra={"x-path": True})


DataPath: TypeAlias = Annotated[str, Field(min_length=1)]
"""Type of a field with the path of a file of data, declared by `data_path`."""
