"""Description of a component's keys from its Spec, and of its example as text of a mission."""

from __future__ import annotations

import datetime
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args, get_origin

from annotated_types import MaxLen, MinLen
from pydantic.fields import FieldInfo

from hillsphere.base.ranges import LARGEST
from hillsphere.plugins.registry import DEFAULT_TYPES
from hillsphere.spec.annotations import describe_annotation, inner, members
from hillsphere.spec.base import Spec, StageSpec
from hillsphere.spec.units import UNITS

__all__ = ["KeyDescription", "describe_keys", "format_example", "toml_value"]

_SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_LINE = 100
"""Longest line on which an array of the example stands whole, in characters."""


@dataclass(frozen=True)
class KeyDescription:
    """One key of a component's table.

    Parameters
    ----------
    key : str
        Path within the table: ``"start.position_m"``; ``"parts[].model"`` is a key of each table of
        an array, ``"over.NAME.min"`` one of each table under a name that the mission chooses.
    value : str
        The expected value: ``"three numbers"``.
    units : tuple of str
        Unit suffixes with which the key may end, the SI unit of `key` first; empty for a number
        without unit and for all other values.
    bounds : str
        ``"> 0, ≤ 10"``, in SI; empty without bounds. Bounds that only exclude wrong units, of
        `hillsphere.base.ranges`, are left out.
    is_required : bool
        Whether the table must have the key; for a key of an inner table, whether that table must.
    default : object
        Value without the key, in SI as a mission would write it; None if there is none.
    meaning : str
        What the key means.
    example : str
        The key as a line of a mission, from the examples of the Spec; empty if none has it.
    """

    key: str
    value: str
    units: tuple[str, ...]
    bounds: str
    is_required: bool
    default: Any
    meaning: str
    example: str


def describe_keys(spec: type[Spec]) -> list[KeyDescription]:
    """Describe every key of a Spec and of the Specs nested in it, in the order of declaration.

    Parameters
    ----------
    spec : type
        The Spec class.

    Returns
    -------
    list of KeyDescription
        A key whose value is a table is followed by the keys of that table.
    """
    return list(_keys(spec, "", spec.examples, (spec,)))


def _keys(
    spec: type[Spec], prefix: str, examples: Sequence[Any], outer: tuple[type[Spec], ...]
) -> Iterator[KeyDescription]:
    # The key that all stages inherit comes last: it says the least about any of them.
    for name in sorted(spec.model_fields, key=lambda name: name in StageSpec.model_fields):
        field, extra = spec.model_fields[name], spec.schema_extra(name)
        units = tuple(UNITS[extra["x-dimension"]]) if "x-dimension" in extra else ()
        written = _find_example(spec, name, examples)
        parts = list(_inner_tables(field.annotation, ""))
        yield KeyDescription(
            key=prefix + name,
            value=_value(field, extra),
            units=units,
            bounds=_bounds(field, extra),
            is_required=field.is_required(),
            default=_default(field),
            meaning=field.description or "",
            example=f"{written[0]} = {toml_value(written[1])}" if written and not parts else "",
        )
        for suffix, part in parts:
            if part not in outer:
                inside = list(_inside(written[1], suffix)) if written else []
                yield from _keys(
                    part, f"{prefix}{name}{suffix}.", [*inside, *part.examples], (*outer, part)
                )


def _inner_tables(annotation: Any, suffix: str) -> Iterator[tuple[str, type[Spec]]]:
    """Yield (what stands between its key and those of the table, Spec) for every nested Spec."""
    annotation = inner(annotation)
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        yield suffix, annotation
    elif len(some := members(annotation)) > 1:
        for member in some:
            yield from _inner_tables(member, suffix)
    elif get_origin(annotation) is dict:
        yield from _inner_tables(get_args(annotation)[1], suffix + ".NAME")
    elif get_origin(annotation) is tuple:
        for item in dict.fromkeys(a for a in get_args(annotation) if a is not Ellipsis):
            yield from _inner_tables(item, suffix + "[]")


def _inside(value: Any, suffix: str) -> Iterator[Any]:
    """Yield the tables of an example at the places that a suffix of `_inner_tables` stands for."""
    if suffix.startswith("[]") and isinstance(value, list | tuple):
        for item in value:
            yield from _inside(item, suffix[2:])
    elif suffix.startswith(".NAME") and isinstance(value, Mapping):
        for item in value.values():
            yield from _inside(item, suffix[5:])
    elif not suffix and isinstance(value, Mapping):
        yield value


def _find_example(spec: type[Spec], name: str, examples: Sequence[Any]) -> tuple[str, Any] | None:
    keys = spec.units_by_field().get(name, {name: 1.0})
    for example in examples:
        for key in keys:
            if isinstance(example, Mapping) and key in example:
                return key, example[key]
    return None


def _value(field: FieldInfo, extra: Mapping[str, Any]) -> str:
    is_several = get_origin(inner(field.annotation)) is tuple
    if extra.get("x-path"):
        return "paths of files" if is_several else "the path of a file"
    if extra.get("x-table"):
        return 'the name of any table, such as "gravity.phobos"'
    if extra.get("x-repeats"):
        return "the name of the stage to repeat"
    if product := extra.get("x-product"):
        product = product.rpartition(":")[2]
        return f"names of stages that yield {product}" if is_several else (
            f"the name of a stage that yields {product}"
        )  # fmt: skip
    if kind := extra.get("x-kind"):
        return f"names of [{kind}.NAME]" if is_several else f"the name of a [{kind}.NAME]"
    return describe_annotation(field.annotation)


def _bounds(field: FieldInfo, extra: Mapping[str, Any]) -> str:
    bounds = dict(extra.get("x-bounds", {}))
    largest = LARGEST.get(extra.get("x-dimension", ""))
    shown = {
        name: limit for name, limit in bounds.items() if largest is None or abs(limit) != largest
    }
    if "gt" in shown and "ge" in shown:  # of both, only the stricter one says something
        del shown["gt" if shown["ge"] > shown["gt"] else "ge"]
    unit = next(iter(UNITS[extra["x-dimension"]]), "") if "x-dimension" in extra else ""
    texts = [
        f"{_SIGNS[name]} {limit:g}" + (f" {unit}" if unit and limit else "")
        for name, limit in shown.items()
    ]
    is_text = inner(field.annotation) is str
    noun = "characters" if is_text else "items"
    for rule in field.metadata:
        if isinstance(rule, MinLen) and rule.min_length:
            texts.append("not empty" if rule.min_length == 1 else f"at least {rule.min_length} "
                         f"{noun}")  # fmt: skip
        elif isinstance(rule, MaxLen):
            texts.append(f"at most {rule.max_length} {noun}")
        elif (pattern := getattr(rule, "pattern", None)) and not extra.get("x-table"):
            texts.append(f"of the form {pattern}")
    return ", ".join(texts)


def _default(field: FieldInfo) -> Any:
    if field.is_required():
        return None
    default = field.get_default(call_default_factory=True)
    if isinstance(default, Spec) or (isinstance(default, tuple) and default
                                     and isinstance(default[0], Spec)):  # fmt: skip
        return None  # the keys of the inner table have defaults of their own
    return default


def toml_value(value: Any) -> str:
    """Write a value as TOML on one line; tables become inline tables.

    Parameters
    ----------
    value : object
        Text, number, truth value, date, array or table, as in the examples of a Spec.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, datetime.datetime):
        return value.isoformat()
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_key(key)} = {toml_value(item)}" for key, item in value.items())
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return repr(value) if isinstance(value, int | float) else toml_value(str(value))


def format_example(kind: str, type_: str, table: Mapping[str, Any]) -> str:
    """Write an example of a Spec as a table of a mission.

    Parameters
    ----------
    kind, type_ : str
        Kind and type of the component.
    table : mapping
        The example.

    Returns
    -------
    str
        TOML, without a newline at its end. Tables in the table have headings of their own.
    """
    head = [f"[{kind}.NAME]"]
    if DEFAULT_TYPES.get(kind) != type_:
        head.append(f"type = {toml_value(type_)}")
    return "\n".join([*head, *_table_lines(f"{kind}.NAME", table)])


def _table_lines(path: str, table: Mapping[str, Any]) -> Iterator[str]:
    later = {key: value for key, value in table.items() if _has_own_heading(value)}
    for key, value in table.items():
        if key not in later:
            yield from _lines(_key(key), value)
    for key, value in later.items():
        inner_path = f"{path}.{_key(key)}"
        many = [value] if isinstance(value, Mapping) else value
        for item in many:
            yield f"\n[{inner_path}]" if isinstance(value, Mapping) else f"\n[[{inner_path}]]"
            yield from _table_lines(inner_path, item)


def _has_own_heading(value: Any) -> bool:
    """Return whether a table, or an array of tables, is too long for one line."""
    is_table = isinstance(value, Mapping)
    is_array = isinstance(value, list | tuple) and bool(value) and all(
        isinstance(item, Mapping) for item in value
    )  # fmt: skip
    return (is_table or is_array) and len(toml_value(value)) > _LINE // 2


def _lines(key: str, value: Any) -> list[str]:
    line = f"{key} = {toml_value(value)}"
    if len(line) <= _LINE or not isinstance(value, list | tuple):
        return [line]
    return [f"{key} = [", *(f"    {toml_value(item)}," for item in value), "]"]


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else toml_value(key)
