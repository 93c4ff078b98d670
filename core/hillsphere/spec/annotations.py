"""Description of type annotations in the terms of a mission file, for messages."""

from __future__ import annotations

import datetime
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from hillsphere.spec.base import Ref, Spec

__all__ = ["describe_annotation", "inner", "item_of", "member_of", "members"]

_PLAIN: dict[Any, tuple[str, str]] = {
    float: ("a number", "numbers"),
    int: ("a whole number", "whole numbers"),
    str: ("a string", "strings"),
    bool: ("true or false", "true or false values"),
    Ref: ("the name of another table", "names of other tables"),
    datetime.datetime: ("a date and time with zone", "dates and times with zone"),
    dict: ("a table", "tables"),
    tuple: ("an array", "arrays"),
    Any: ("a value", "values"),
}
_COUNTS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")


def inner(annotation: Any) -> Any:
    """Return an annotation without ``Annotated`` and ``| None``."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
        elif len(some := members(annotation)) == 1 and some[0] is not annotation:
            annotation = some[0]
        else:
            return annotation


def members(annotation: Any) -> tuple[Any, ...]:
    """Return the members of a union without None; any other annotation as its only member."""
    if get_origin(annotation) in (Union, UnionType):
        return tuple(a for a in get_args(annotation) if a is not NoneType)
    return (annotation,)


def member_of(annotation: Any, label: str) -> Any:
    """Return the member of a union with the label that pydantic uses in an error's location."""
    some = [inner(member) for member in members(annotation)]
    for member in some:
        if isinstance(member, type) and issubclass(member, Spec) and member.__name__ in label:
            return member
    for member in some:
        origin = get_origin(member) or member
        if label.startswith(getattr(origin, "__name__", "?")):
            return member
    return Any


def item_of(annotation: Any, part: str | int) -> Any:
    """Return the annotation of one item of a tuple or of one value of a dict."""
    arguments = get_args(annotation)
    origin = get_origin(annotation)
    if origin is dict:
        return arguments[1]
    if origin is tuple and isinstance(part, int):
        if len(arguments) == 2 and arguments[1] is Ellipsis:
            return arguments[0]
        return arguments[part] if part < len(arguments) else Any
    return Any


def describe_annotation(annotation: Any, *, plural: bool = False) -> str:
    """Describe the expected value: ``"three numbers"``, ``"an array of strings"``, ``"a table"``.

    Parameters
    ----------
    annotation : object
        Type annotation of a field or a part of it.
    plural : bool
        Use the plural: ``"arrays of strings"``.

    Returns
    -------
    str
        The description, without a full stop.
    """
    annotation = inner(annotation)
    some = members(annotation)
    if len(some) > 1:
        return " or ".join(dict.fromkeys(describe_annotation(a, plural=plural) for a in some))
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return ("one of " if not plural else "some of ") + ", ".join(map(repr, arguments))
    if origin is dict:
        items = describe_annotation(arguments[1], plural=True)
        return f"{'tables' if plural else 'a table'} of {items}"
    if origin is tuple:
        return _described_tuple(arguments, plural=plural)
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        return "tables" if plural else "a table"
    if annotation in _PLAIN:
        return _PLAIN[annotation][plural]
    name = getattr(annotation, "__name__", str(annotation))
    return f"values of type {name}" if plural else f"a value of type {name}"


def _described_tuple(arguments: tuple[Any, ...], *, plural: bool) -> str:
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        items = describe_annotation(arguments[0], plural=True)
        return f"{'arrays' if plural else 'an array'} of {items}"
    kinds = list(dict.fromkeys(describe_annotation(a, plural=True) for a in arguments))
    count = _COUNTS[len(arguments)] if len(arguments) < len(_COUNTS) else str(len(arguments))
    items = f"{count} {kinds[0]}" if len(kinds) == 1 else (
        "(" + ", ".join(describe_annotation(a) for a in arguments) + ")"
    )  # fmt: skip
    return f"arrays of {items}" if plural else items
