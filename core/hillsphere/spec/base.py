"""Specs: one declaration of a component's parameters for validation, documentation and schema.

A component (gravity model, plant, stage …) has one `Spec`: a frozen pydantic model that forbids
unknown keys. A physical quantity is declared once in SI with `quantity`, its name ending in the SI
suffix of its dimension (``axes_m``); a mission may write any suffix of the closed list in `UNITS`
(``axes_km``) and the value is converted before it is validated. A reference to another component
is declared with `reference` and filled by name in a mission, or by the object itself in Python.

This module imports pydantic only: a plugin's ``specs`` module that keeps to it stays cheap to load.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    GetCoreSchemaHandler,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError, core_schema

from hillsphere.spec.fields import (
    DataPath,
    Pair,
    Vector3,
    data_path,
    need,
    option,
    quantity,
    reference,
    repeated,
    table_name,
)
from hillsphere.spec.result_names import ResultNames
from hillsphere.spec.units import UNITS, unit_keys

__all__ = [
    "UNITS",
    "DataPath",
    "Pair",
    "Ref",
    "ResultNames",
    "Spec",
    "StageSpec",
    "Vector3",
    "data_path",
    "need",
    "option",
    "quantity",
    "reference",
    "repeated",
    "rule",
    "table_name",
    "unit_keys",
]


def rule(key: str, text: str) -> PydanticCustomError:
    """Return the error of a rule between keys, to be raised; the mission reader locates it.

    Parameters
    ----------
    key : str
        Name of the field, or the key in the mission, at which the message is shown.
    text : str
        The fault and its remedy.

    Returns
    -------
    PydanticCustomError
        Raise it in a validator.
    """
    # as a value: pydantic would read braces in a template
    return PydanticCustomError("rule", "{text}", {"text": text, "key": key})


@dataclass(frozen=True)
class Ref:
    """A reference to another component: its name in the mission and, once bound, the object.

    Parameters
    ----------
    name : str
        Name of the other table; ``"(given)"`` if the object was passed in Python.
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


@dataclass(frozen=True)
class _Twice:
    """Marks a quantity that was given in two units, until its field refuses it."""

    first: str
    second: str


def _scale(value: Any, factor: float) -> Any:
    if isinstance(value, bool):
        return value
    if isinstance(value, int | float):
        try:
            return value * factor
        except OverflowError:  # an int beyond the range of floats: refused as not finite
            return inf
    if isinstance(value, list | tuple):
        return tuple(_scale(item, factor) for item in value)
    return value


def _frozen(value: Any) -> Any:
    """Return arrays as tuples, at every depth, since a Spec must be immutable."""
    if isinstance(value, list | tuple):
        return tuple(_frozen(item) for item in value)
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return value


def _leaves(
    value: Any, where: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    """Yield (place within the value, item) for every item of nested arrays and tables."""
    if isinstance(value, tuple | list):
        for index, item in enumerate(value):
            yield from _leaves(item, (*where, index))
    elif isinstance(value, dict):
        for key, item in value.items():
            yield from _leaves(item, (*where, key))
    else:
        yield where, value


def _map_items(value: Any, change: Callable[[Any], Any]) -> Any:
    """Apply `change` to every item of nested arrays and tables; keep unchanged objects."""
    if isinstance(value, tuple):
        items = tuple(_map_items(item, change) for item in value)
        return value if all(a is b for a, b in zip(items, value, strict=True)) else items
    if isinstance(value, dict):
        table = {key: _map_items(item, change) for key, item in value.items()}
        return value if all(table[key] is value[key] for key in value) else table
    return change(value)


class Spec(BaseModel):
    """Base of all parameter declarations: frozen, strict, no unknown keys, no nan or inf.

    `examples` holds at least one table as a mission would write it, for the documentation, the
    JSON Schema and the contract tests. A reference in an example may be any name; the contract
    tests replace it by a component of its kind.

    Arrays arrive as tuples, so annotate a field ``tuple[float, ...]``, never ``list``. A rule
    between fields is a ``model_validator(mode="after")`` that raises ValueError; to have the
    message placed at one key, raise `rule`.
    """

    examples: ClassVar[tuple[dict[str, Any], ...]] = ()

    _unit_keys: ClassVar[dict[str, dict[str, float]]] = {}
    _bounds: ClassVar[dict[str, Mapping[str, float]]] = {}

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, validate_default=False
    )

    @classmethod
    def schema_extra(cls, name: str) -> Mapping[str, Any]:
        """Return the extra JSON Schema keys of a field (``x-dimension``, ``x-kind`` …)."""
        extra = cls.model_fields[name].json_schema_extra
        return extra if isinstance(extra, dict) else {}

    @classmethod
    def units_by_field(cls) -> Mapping[str, Mapping[str, float]]:
        """Return the accepted keys of each quantity: field → key → factor to SI."""
        return cls._unit_keys

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Check that every quantity is named by its SI suffix, when the class is made."""
        super().__pydantic_init_subclass__(**kwargs)
        cls._unit_keys = {}
        cls._bounds = {}
        for name in cls.model_fields:
            extra = cls.schema_extra(name)
            if bounds := extra.get("x-bounds"):
                cls._bounds[name] = bounds
            dimension = extra.get("x-dimension")
            if dimension is None:
                continue
            suffix = next(iter(UNITS[dimension]))
            if not name.endswith("_" + suffix):
                raise TypeError(f"{cls.__name__}.{name}: a {dimension} must be named *_{suffix}")
            cls._unit_keys[name] = unit_keys(name, dimension)

    @model_validator(mode="before")
    @classmethod
    def _to_si(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        given = {key: _frozen(value) for key, value in data.items()}
        for name, keys in cls._unit_keys.items():
            units = [key for key in keys if key in given]
            if len(units) == 1:
                given[name] = _scale(given.pop(units[0]), keys[units[0]])
            elif units:
                for key in units:
                    del given[key]
                given[name] = _Twice(units[0], units[1])
        return given

    # Both faults are raised by the field, not by the model, so that neither hides another's.
    @field_validator("*", mode="wrap")
    @classmethod
    def _once_and_in_bounds(
        cls, value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo
    ) -> Any:
        if isinstance(value, _Twice):
            raise PydanticCustomError(
                "unit_twice", "{first} and {second} say the same thing; keep one",
                {"first": value.first, "second": value.second},
            )  # fmt: skip
        made = handler(value)
        bounds = cls._bounds.get(info.field_name or "")
        if bounds:
            for where, number in _leaves(made):
                if isinstance(number, bool) or not isinstance(number, int | float):
                    continue
                for test, limit in bounds.items():
                    if not _BOUND_TESTS[test](number, limit):
                        raise PydanticCustomError(
                            "bound", "must be {sign} {limit}",
                            {"sign": _BOUND_SIGNS[test], "limit": limit, "where": where,
                             "value": number},
                        )  # fmt: skip
        return made

    def references(self) -> Iterator[tuple[tuple[str | int, ...], str, Ref]]:
        """Yield (location, kind, reference) for every reference here and in nested Specs."""
        for where, field, item in self._items():
            if isinstance(item, Ref):
                yield where, field.get("x-kind", ""), item

    def data_paths(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield (location, path) for every input file named here and in nested Specs."""
        for where, field, item in self._items():
            if isinstance(item, str) and field.get("x-path"):
                yield where, item

    def table_names(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield (location, ``"kind.name"``) for every `table_name` here and in nested Specs."""
        for where, field, item in self._items():
            if isinstance(item, str) and field.get("x-table"):
                yield where, item

    def needs_of(self) -> Iterator[tuple[tuple[str | int, ...], str, Ref]]:
        """Yield (location, import path of the product, reference) for every `need`."""
        for where, field, item in self._items():
            if isinstance(item, Ref) and (product := field.get("x-product")):
                yield where, product, item

    def _items(self) -> Iterator[tuple[tuple[str | int, ...], Mapping[str, Any], Any]]:
        """Yield (location, extra facts of its field, item) here and in nested Specs."""
        for name in type(self).model_fields:
            for where, item in _leaves(getattr(self, name), (name,)):
                if isinstance(item, Spec):
                    for inner, field, leaf in item._items():
                        yield (*where, *inner), field, leaf
                else:
                    yield where, self.schema_extra(name), item

    def misfits(
        self, tables: Mapping[str, Mapping[str, Spec]]
    ) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """Yield (location, message) for every conflict with other tables of the mission.

        Called when a mission is validated, for rules that concern several references together.

        Parameters
        ----------
        tables : mapping
            Kind → name → Spec of every valid table. A referenced table may be missing, which is
            reported elsewhere.
        """
        yield from ()

    def bound(self, lookup: Callable[[str, str], Any]) -> Self:
        """Return a copy whose references hold their components.

        Parameters
        ----------
        lookup : callable
            ``lookup(kind, name)`` returns the component.

        Returns
        -------
        Spec
            Copy of the same class.
        """

        def bind(field: Mapping[str, Any], item: Any) -> Any:
            if isinstance(item, Ref) and item.target is None:
                return Ref(item.name, lookup(field.get("x-kind", ""), item.name))
            return item

        return self._changed(bind)

    def with_data_paths(self, resolved: Mapping[str, str]) -> Self:
        """Return a copy in which the paths of input files are replaced.

        Parameters
        ----------
        resolved : mapping of str to str
            Path in this Spec → new path.

        Returns
        -------
        Spec
            Copy of the same class.
        """

        def resolve(field: Mapping[str, Any], item: Any) -> Any:
            is_path = isinstance(item, str) and field.get("x-path")
            return resolved.get(item, item) if is_path else item

        return self._changed(resolve)

    def _changed(self, change: Callable[[Mapping[str, Any], Any], Any]) -> Self:
        """Apply ``change(extra facts of the field, item)`` here and in nested Specs."""
        changed: dict[str, Any] = {}
        for name in type(self).model_fields:
            field = self.schema_extra(name)

            def one(item: Any, field: Mapping[str, Any] = field) -> Any:
                return item._changed(change) if isinstance(item, Spec) else change(field, item)

            value = getattr(self, name)
            new = _map_items(value, one)
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


class StageSpec(Spec):
    """Base of a stage's declaration.

    `produces` is the import path of the stage's product class. A stage that takes products of
    earlier stages has a field ``needs`` whose type is a Spec of `need` fields. `provides` lists the
    base classes of the product that other stages may need (``hillsphere.products:OrbitSet``), so
    that a mission is checked without importing them. A stage that campaigns repeat lists in
    `course` the dotted keys that define the reference of its cases: figures overlay only cases that
    agree in all of them. `results` names the metrics and tables that it may present, without the
    end that an option ``label`` appends, so that a requirement on any other is refused before the
    run; None if they are known only after it. A stage that campaigns cannot repeat may say in
    `instead_of_repeating` what else varies its inputs, for the message.
    """

    produces: ClassVar[str] = ""
    provides: ClassVar[tuple[str, ...]] = ()
    course: ClassVar[tuple[str, ...]] = ()
    results: ClassVar[ResultNames | None] = None
    instead_of_repeating: ClassVar[str] = ""

    figures: bool = option("whether its figures are drawn", default=True)

    def result_names(self) -> ResultNames | None:
        """Return the names of the results of this stage; None if they are known only after it."""
        if self.results is None:
            return None
        return self.results.with_label(str(getattr(self, "label", "")))
