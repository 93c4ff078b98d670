"""Specs: the one declaration that documents, validates and describes a component's parameters.

A component (gravity model, plant, stage …) has one `Spec`: a frozen pydantic model that forbids
unknown keys. A physical quantity is declared once in SI with `quantity`, its name ending in the SI
suffix of its dimension (``axes_m``); a mission may write any suffix of the closed list in `UNITS`
(``axes_km``) and the value is converted before it is validated. A reference to another component
is declared with `reference` and filled by name in a mission, or by the object itself in Python.

This module imports pydantic only: a plugin's ``specs`` module that keeps to it stays cheap to load.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, model_validator
from pydantic_core import PydanticCustomError, core_schema

__all__ = [
    "UNITS",
    "DataPath",
    "Pair",
    "Ref",
    "Spec",
    "StageSpec",
    "Vector3",
    "data_path",
    "need",
    "option",
    "quantity",
    "reference",
    "unit_keys",
]

UNITS: Mapping[str, Mapping[str, float]] = {
    "length": {"m": 1.0, "km": 1e3, "cm": 1e-2, "mm": 1e-3, "au": 1.495978707e11},
    "time": {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0},
    "angle": {"rad": 1.0, "deg": 0.017453292519943295, "arcsec": 4.84813681109536e-06},
    "speed": {"m_s": 1.0, "km_s": 1e3, "cm_s": 1e-2, "mm_s": 1e-3},
    "acceleration": {"m_s2": 1.0, "km_s2": 1e3, "mm_s2": 1e-3},
    "angular_rate": {"rad_s": 1.0, "deg_s": 0.017453292519943295, "deg_h": 4.84813681109536e-06},
    "gravitational_parameter": {"m3_s2": 1.0, "km3_s2": 1e9},
    "density": {"kg_m3": 1.0, "g_cm3": 1e3},
    "mass": {"kg": 1.0, "t": 1e3},
    "area_to_mass": {"m2_kg": 1.0},
    "frequency": {"hz": 1.0},
}
"""Closed list of unit suffixes: dimension → suffix → factor to SI; the SI suffix stands first."""

Vector3: TypeAlias = tuple[float, float, float]
Pair: TypeAlias = tuple[float, float]


def quantity(dimension: str, description: str, *, default: Any = ..., **bounds: Any) -> Any:
    """Declare a physical quantity; the field's name must end in the SI suffix of its dimension.

    Parameters
    ----------
    dimension : str
        A key of `UNITS`.
    description : str
        What it is, in which frame; it becomes the documentation and the JSON Schema.
    default : object, optional
        SI value; without it the key is required.
    **bounds
        pydantic bounds in SI (``gt``, ``ge``, ``lt``, ``le``, ``min_length``, ``max_length``). On an
        array of numbers the numeric bounds hold for each element.

    Returns
    -------
    pydantic.fields.FieldInfo
        The field.
    """
    return option(description, default=default, extra={"x-dimension": dimension}, **bounds)


def option(
    description: str, *, default: Any = ..., extra: dict[str, Any] | None = None, **bounds: Any
) -> Any:
    """Declare a parameter without unit: a count, a ratio, a choice.

    Parameters
    ----------
    description : str
        What it is.
    default : object, optional
        Without it the key is required.
    extra : dict, optional
        Further JSON Schema keys.
    **bounds
        pydantic bounds; on an array of numbers the numeric ones hold for each element.

    Returns
    -------
    pydantic.fields.FieldInfo
        The field.
    """
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
        Kind of the component that is meant, e.g. ``"gravity"``.
    description : str
        What the component is needed for.
    default : str or None, optional
        Without it the key is required.

    Returns
    -------
    pydantic.fields.FieldInfo
        The field.
    """
    return option(description, default=default, extra={"x-kind": kind})


def need(product: str, description: str, *, default: Any = ...) -> Any:
    """Declare what a stage takes from an earlier stage; annotate the field as `Ref`.

    Parameters
    ----------
    product : str
        Import path ``"package.module:Class"`` of the product that the earlier stage must yield.
    description : str
        What it is needed for.
    default : None, optional
        ``None`` makes the input optional.

    Returns
    -------
    pydantic.fields.FieldInfo
        The field; it belongs in the nested Spec of a stage's ``needs``.
    """
    return option(description, default=default, extra={"x-kind": "stage", "x-product": product})


def data_path(description: str, *, default: Any = ...) -> Any:
    """Declare an input file; annotate the field as `DataPath`.

    Parameters
    ----------
    description : str
        What the file holds.
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


@dataclass(frozen=True)
class Ref:
    """A reference to another component: its name in the mission and, once bound, the object.

    Parameters
    ----------
    name : str
        Name of the other table; ``"(given)"`` where the object was passed in Python.
    target : object, optional
        The component.
    """

    name: str
    target: Any = None

    def get(self) -> Any:
        """Return the component; `RuntimeError` if the reference was never bound."""
        if self.target is None:
            raise RuntimeError(f"reference {self.name!r} is not bound to a component")
        return self.target

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Accept a name, a `Ref` or the component itself."""

        def accept(value: Any) -> Ref:
            if isinstance(value, Ref):
                return value
            if isinstance(value, str):
                if not value:
                    raise PydanticCustomError("reference", "must be the name of a table")
                return Ref(value)
            if value is None or isinstance(value, bool | int | float | list | tuple | dict):
                raise PydanticCustomError("reference", "must be the name of a table")
            return Ref("(given)", value)

        return core_schema.no_info_plain_validator_function(
            accept,
            json_schema_input_schema=core_schema.str_schema(min_length=1),
            serialization=core_schema.plain_serializer_function_ser_schema(
                lambda ref: ref.name, return_schema=core_schema.str_schema()
            ),
        )


def unit_keys(name: str, dimension: str) -> dict[str, float]:
    """Every key that a mission may write for an SI field, with its factor to SI.

    Parameters
    ----------
    name : str
        Field name, ending in the dimension's SI suffix.
    dimension : str
        A key of `UNITS`.

    Returns
    -------
    dict of str to float
        ``{"axes_m": 1.0, "axes_km": 1000.0, …}``.
    """
    units = UNITS[dimension]
    stem = name.removesuffix(next(iter(units)))
    return {stem + suffix: factor for suffix, factor in units.items()}


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, bool):
        return value
    if isinstance(value, int | float):
        return value * factor
    if isinstance(value, list | tuple):
        return tuple(_scaled(item, factor) for item in value)
    return value


def _numbers(value: Any) -> Iterator[float]:
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield value
    elif isinstance(value, list | tuple):
        for item in value:
            yield from _numbers(item)


class Spec(BaseModel):
    """Base of all parameter declarations: frozen, strict, no unknown keys, no nan or inf.

    `examples` holds tables as a mission would write them, at least one: they feed documentation,
    JSON Schema and the contract tests. A reference in an example is any name;
    the contract tests put a component of its kind there.
    """

    examples: ClassVar[tuple[dict[str, Any], ...]] = ()

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, validate_default=False
    )

    @classmethod
    def schema_extra(cls, name: str) -> Mapping[str, Any]:
        """Return the declaration's extra facts of a field (``x-dimension``, ``x-kind`` …)."""
        extra = cls.model_fields[name].json_schema_extra
        return extra if isinstance(extra, dict) else {}

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Check that every quantity is named by its SI suffix, when the class is made."""
        super().__pydantic_init_subclass__(**kwargs)
        for name in cls.model_fields:
            dimension = cls.schema_extra(name).get("x-dimension")
            if dimension is not None and not name.endswith("_" + next(iter(UNITS[dimension]))):
                suffix = next(iter(UNITS[dimension]))
                raise TypeError(f"{cls.__name__}.{name}: a {dimension} must be named *_{suffix}")

    @model_validator(mode="before")
    @classmethod
    def _to_si(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        given = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items()}
        for name in cls.model_fields:
            extra = cls.schema_extra(name)
            if dimension := extra.get("x-dimension"):
                keys = unit_keys(name, dimension)
                found = [key for key in keys if key in given]
                if len(found) > 1:
                    raise PydanticCustomError(
                        "unit_twice", "{first} and {second} say the same thing; keep one",
                        {"first": found[0], "second": found[1], "key": found[1]},
                    )  # fmt: skip
                if found:
                    given[name] = _scaled(given.pop(found[0]), keys[found[0]])
        return given

    @model_validator(mode="after")
    def _in_bounds(self) -> Spec:
        for name in type(self).model_fields:
            if name not in self.model_fields_set:
                continue
            bounds = type(self).schema_extra(name).get("x-bounds", {})
            for number in _numbers(getattr(self, name)):
                for test, limit in bounds.items():
                    if not _BOUND_TESTS[test](number, limit):
                        raise PydanticCustomError(
                            "bound", "must be {sign} {limit}",
                            {"sign": _BOUND_SIGNS[test], "limit": limit, "key": name,
                             "value": number},
                        )  # fmt: skip
        return self

    def references(self) -> Iterator[tuple[tuple[str | int, ...], str, Ref]]:
        """Yield (location, kind, reference) for every reference here and in nested Specs."""
        for name in type(self).model_fields:
            kind = type(self).schema_extra(name).get("x-kind", "")
            yield from _references((name,), kind, getattr(self, name))

    def bound(self, lookup: Any) -> Spec:
        """Return a copy whose references hold their components.

        Parameters
        ----------
        lookup : callable
            ``lookup(kind, name)`` returns the component.

        Returns
        -------
        Spec
            Of the same class.
        """
        changed: dict[str, Any] = {}
        for name in type(self).model_fields:
            value = getattr(self, name)
            new = _bound(value, type(self).schema_extra(name).get("x-kind", ""), lookup)
            if new is not value:
                changed[name] = new
        return self.model_copy(update=changed) if changed else self


_BOUND_TESTS = {
    "gt": lambda x, y: x > y,
    "ge": lambda x, y: x >= y,
    "lt": lambda x, y: x < y,
    "le": lambda x, y: x <= y,
}
_BOUND_SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}


def _references(
    where: tuple[str | int, ...], kind: str, value: Any
) -> Iterator[tuple[tuple[str | int, ...], str, Ref]]:
    if isinstance(value, Ref):
        yield where, kind, value
    elif isinstance(value, Spec):
        for inner, inner_kind, ref in value.references():
            yield (*where, *inner), inner_kind, ref
    elif isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from _references((*where, index), kind, item)
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _references((*where, key), kind, item)


def _bound(value: Any, kind: str, lookup: Any) -> Any:
    if isinstance(value, Ref):
        return value if value.target is not None else Ref(value.name, lookup(kind, value.name))
    if isinstance(value, Spec):
        return value.bound(lookup)
    if isinstance(value, tuple):
        items = tuple(_bound(item, kind, lookup) for item in value)
        return value if all(a is b for a, b in zip(items, value, strict=True)) else items
    if isinstance(value, dict):
        table = {key: _bound(item, kind, lookup) for key, item in value.items()}
        return value if all(table[key] is value[key] for key in value) else table
    return value


class StageSpec(Spec):
    """Base of a stage's declaration.

    A stage says what it yields in `produces` (the import path of a product class) and, if it takes
    anything from earlier stages, has a field ``needs`` whose type is a Spec of `need` fields.
    """

    produces: ClassVar[str] = ""
