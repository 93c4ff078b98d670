"""Translation of pydantic's errors: the key as the user wrote it, its unit, and its value."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args, get_origin

from pydantic import ValidationError

from hillsphere.base.problems import Key, did_you_mean, format_value
from hillsphere.spec.annotations import describe_annotation, inner, item_of, member_of, members
from hillsphere.spec.base import Spec
from hillsphere.spec.units import UNITS, unit_keys, unit_text

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

__all__ = ["Fault", "faults_of"]

S = TypeVar("S", bound=Spec)

MOST_FAULTS = 100
"""Largest number of explained faults of one table; each takes a fuzzy search of similar names."""

_SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}


@dataclass(frozen=True)
class Fault:
    """One fault in the keys of a component.

    Parameters
    ----------
    key : tuple
        Path of the key as the user wrote it, or should have written it.
    message : str
        The fault and its remedy.
    is_remark : bool
        Whether this is a remark on the list of faults, to be shown at its end.
    """

    key: Key
    message: str
    is_remark: bool = False


@dataclass(frozen=True)
class _Place:
    """Location of an error: the user's path to it, and the declaration of that field."""

    key: Key
    annotation: Any
    value: Any
    description: str = ""
    factor: float = 1.0
    unit: str = ""
    branches: tuple[tuple[Key, str], ...] = ()


@dataclass
class _Table:
    """Unknown and missing keys of one table, which are explained together."""

    spec: type[Spec]
    value: Mapping[str, Any]
    unknown: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)


def faults_of(spec: type[S], keys: Mapping[str, Any]) -> tuple[S | None, list[Fault]]:
    """Validate keys against a Spec and explain every fault.

    Parameters
    ----------
    spec : type
        The Spec class.
    keys : mapping
        Keys and values as in a mission, unit suffixes included.

    Returns
    -------
    spec : Spec or None
        The Spec, if there is no fault.
    faults : list of Fault
        Faults in the order in which the keys were written; missing keys last.
    """
    try:
        return spec.model_validate(dict(keys)), []
    except ValidationError as error:
        count = error.error_count()
        details = error.errors(include_url=False)[:MOST_FAULTS]
    located = [(detail, _place(spec, keys, detail["loc"])) for detail in details]
    tables: dict[Key, _Table] = {}
    faults: dict[Fault, None] = {}
    for detail, place in _one_branch_each(spec, keys, located):
        kind, last = detail["type"], detail["loc"][-1] if detail["loc"] else ""
        if kind == "too_short" and len(place.value) >= detail["ctx"]["min_length"]:
            continue  # items with faults of their own were not counted
        if kind in ("missing", "extra_forbidden") and isinstance(last, str):
            above = _place(spec, keys, detail["loc"][:-1])
            table = tables.setdefault(above.key, _Table(above.annotation, above.value))
            (table.missing if kind == "missing" else table.unknown).append(last)
        else:
            faults[_explain(spec, keys, detail, place)] = None
    for above_key, table in tables.items():
        for name, message in _unknown_and_missing(table):
            faults[Fault((*above_key, name), message)] = None
    ordered = sorted(faults, key=lambda fault: _order(keys, fault.key))
    if count > MOST_FAULTS:
        ordered.append(Fault((), f"{count - MOST_FAULTS} more faults are not listed", True))
    return None, ordered


def _order(keys: Any, path: Key) -> tuple[int, ...]:
    """Sort key: position of each step among the keys as written, absent ones last."""
    order: list[int] = []
    for part in path:
        if isinstance(keys, Mapping) and part in keys:
            order.append(list(keys).index(part))
            keys = keys[part]
        elif isinstance(part, int):
            order.append(part)
            keys = keys[part] if isinstance(keys, list | tuple) and part < len(keys) else None
        else:
            order.append(len(keys) if isinstance(keys, Mapping) else 0)
            keys = None
    return tuple(order)


# --- where an error stands ------------------------------------------------------------------


def _place(spec: type[Spec], keys: Mapping[str, Any], location: tuple[int | str, ...]) -> _Place:
    place = _Place((), spec, keys)
    for part in location:
        place = _step(place, part)
    return place


def _step(place: _Place, part: int | str) -> _Place:
    if len(members(place.annotation)) > 1:
        # pydantic puts the name of the union's member into the location; the user wrote none.
        member = inner(member_of(place.annotation, str(part)))
        return replace(place, annotation=member, branches=(*place.branches, (place.key, str(part))))
    annotation, value = place.annotation, place.value
    if isinstance(annotation, type) and issubclass(annotation, Spec) and isinstance(part, str):
        return _field(place, annotation, part)
    if isinstance(part, int) and isinstance(value, list | tuple):
        item = value[part] if part < len(value) else None
    elif isinstance(value, Mapping) and part in value:
        item = value[part]
    else:
        return place  # a label of pydantic's own, such as "[key]"
    return replace(
        place, key=(*place.key, part), value=item, annotation=inner(item_of(annotation, part))
    )


def _field(place: _Place, spec: type[Spec], name: str) -> _Place:
    value = place.value if isinstance(place.value, Mapping) else {}
    if name not in spec.model_fields:
        return replace(place, key=(*place.key, name), annotation=Any, value=value.get(name))
    written, factor, unit = name, 1.0, ""
    if dimension := spec.schema_extra(name).get("x-dimension"):
        factors = unit_keys(name, dimension)
        units = dict(zip(factors, UNITS[dimension], strict=True))
        written = next((key for key in factors if key in value), name)
        factor, unit = factors[written], unit_text(units[written])
    info = spec.model_fields[name]
    return replace(
        place,
        key=(*place.key, written),
        value=value.get(written),
        annotation=inner(info.annotation),
        description=info.description or "",
        factor=factor,
        unit=unit,
    )


def _one_branch_each(
    spec: type[Spec],
    keys: Mapping[str, Any],
    located: list[tuple[ErrorDetails, _Place]],
) -> Iterator[tuple[ErrorDetails, _Place]]:
    """Of a union's errors, keep those of the member that the user most likely meant.

    Candidates are members whose type fits and that have errors only inside; among them the one with
    the fewest errors is taken. If no type fits, one error lists what all members expect.
    """
    counts: dict[Key, dict[str, list[int]]] = {}
    for detail, place in located:
        for depth, (key, label) in enumerate(place.branches):
            inside = place.key != key or depth + 1 < len(place.branches)
            wrong_type = detail["type"].endswith("_type") or detail["type"] == "reference"
            right_type = inside or not wrong_type
            tally = counts.setdefault(key, {}).setdefault(label, [0, 0])
            tally[0] += not right_type
            tally[1] += 1
    chosen = {key: min(labels, key=lambda label: labels[label]) for key, labels in counts.items()}
    collapsed: set[Key] = set()
    for detail, place in located:
        if any(chosen[key] != label for key, label in place.branches):
            continue
        wrong = next(
            (key for key, label in place.branches if counts[key][label][0]),
            None,
        )
        if wrong is None:
            yield detail, place
        elif wrong not in collapsed:
            collapsed.add(wrong)
            union = _place(spec, keys, _location_of(spec, keys, detail, wrong))
            yield {**detail, "type": "union_type"}, union


def _location_of(
    spec: type[Spec], keys: Mapping[str, Any], detail: ErrorDetails, key: Key
) -> tuple[int | str, ...]:
    """Return the shortest head of an error's location that leads to a user's key."""
    location = detail["loc"]
    for length in range(len(location) + 1):
        if _place(spec, keys, location[:length]).key == key:
            return location[:length]
    return location


# --- what an error says ---------------------------------------------------------------------


def _explain(
    spec: type[Spec], keys: Mapping[str, Any], detail: ErrorDetails, place: _Place
) -> Fault:
    kind, context = detail["type"], detail.get("ctx", {})
    if kind == "bound":
        for part in context["where"]:
            place = _step(place, part)
        return Fault(place.key, _out_of_bounds(place, context["sign"], context["limit"]))
    if kind == "unit_twice":
        return Fault((*place.key[:-1], context["second"]), detail["msg"])
    if kind == "missing" and place.key:  # an item of a tuple: too few were given
        place = _place(spec, keys, detail["loc"][:-1])
        return Fault(
            place.key, f"expected {describe_annotation(place.annotation)}, got {_got(place)}"
        )
    explain = _WORDS.get(kind)
    if explain is not None:
        return Fault(place.key, explain(place, context))
    if kind in ("value_error", "assertion_error"):
        return Fault(place.key, str(context["error"]))
    if kind.endswith(("_type", "_from_float", "_parsing", "_instance_of", "_size")):
        return Fault(place.key, _wrong_type(place, context))
    # What a Spec's own validator said; it may name the key that it is about.
    if isinstance(context.get("key"), str):
        place = _step(place, context["key"])
    return Fault(place.key, detail["msg"])


def _out_of_bounds(place: _Place, sign: str, limit: float) -> str:
    unit = f" {place.unit}" if place.unit else ""
    number = limit if place.factor == 1.0 else limit / place.factor
    text = f"{number:.12g}" if isinstance(number, float) else str(number)
    return f"must be {sign} {text}{unit}, got {_got(place)}{unit}"


def _got(place: _Place) -> str:
    return format_value(place.value)


def _wrong_type(place: _Place, context: Mapping[str, Any]) -> str:
    return f"expected {describe_annotation(place.annotation)}, got {_got(place)}"


def _not_finite(place: _Place, context: Mapping[str, Any]) -> str:
    value = place.value
    if isinstance(value, int | float) and abs(value) < float("inf"):
        return f"too large a number: {_got(place)}"
    return f"must be a finite number, got {_got(place)}"


def _wrong_choice(place: _Place, context: Mapping[str, Any]) -> str:
    choices = get_args(place.annotation) if get_origin(place.annotation) is Literal else ()
    if len(choices) == 1:
        return f"must be {choices[0]!r}, got {_got(place)}"
    words = [choice for choice in choices if isinstance(choice, str)]
    hint = ""
    if isinstance(place.value, str) and get_close_matches(place.value[:100], words, n=1):
        hint = did_you_mean(place.value, words)
    expected = ", ".join(map(repr, choices)) or context.get("expected", "")
    return f"must be one of {expected}, got {_got(place)}{hint}"


def _wrong_length(place: _Place, context: Mapping[str, Any]) -> str:
    arguments = get_args(place.annotation)
    if get_origin(place.annotation) is tuple and Ellipsis not in arguments:
        return _wrong_type(place, context)
    value = place.value
    length = len(value) if isinstance(value, list | tuple | str | Mapping) else "?"
    least, most = context.get("min_length"), context.get("max_length")
    bound = f"at least {least}" if least is not None else f"at most {most}"
    if isinstance(value, str):
        return "must not be empty" if value == "" and least == 1 else (
            f"must have {bound} characters, got {length}"
        )  # fmt: skip
    return f"must have {bound} items, got {length}"


def _describe_bound(name: str) -> Callable[[_Place, Mapping[str, Any]], str]:
    return lambda place, context: _out_of_bounds(place, _SIGNS[name], context[name])


_WORDS: dict[str, Callable[[_Place, Mapping[str, Any]], str]] = {
    "finite_number": _not_finite,
    "literal_error": _wrong_choice,
    "enum": _wrong_choice,
    "too_short": _wrong_length,
    "too_long": _wrong_length,
    "string_too_short": _wrong_length,
    "string_too_long": _wrong_length,
    "string_pattern_mismatch": lambda place, context: (
        f"{_got(place).removeprefix('a string ')} does not match the pattern {context['pattern']}"
    ),
    "multiple_of": lambda place, context: (
        f"must be a multiple of {context['multiple_of']}, got {_got(place)}"
    ),
    "reference": lambda place, _: f"must be the name of another table, got {_got(place)}",
    "greater_than": _describe_bound("gt"),
    "greater_than_equal": _describe_bound("ge"),
    "less_than": _describe_bound("lt"),
    "less_than_equal": _describe_bound("le"),
    "union_tag_not_found": lambda _, context: f"missing: {context['discriminator']}",
    "union_tag_invalid": lambda _, context: (
        f"{context['discriminator']} must be one of {context['expected_tags']}, "
        f"got {context['tag']!r}"
    ),
}


# --- unknown and missing keys ---------------------------------------------------------------


def _unknown_and_missing(table: _Table) -> Iterator[tuple[str, str]]:
    """Explain unknown and missing keys together: a misspelt key is one fault, not two."""
    fields = {name: _keys(table.spec, name) for name in table.spec.model_fields}
    # All keys are candidates, since --set can add a misspelt key beside the right one. Absent keys
    # come first, since they are more likely to be meant.
    is_given = {name: any(key in table.value for key in keys) for name, keys in fields.items()}
    valid = {key: name for name in sorted(fields, key=is_given.__getitem__) for key in fields[name]}
    missing = dict.fromkeys(table.missing)
    for word in table.unknown:
        if name := _without_unit(table.spec, word, valid):
            missing.pop(name, None)
            keys = fields[name]
            stem = name.removesuffix(_suffix(table.spec, name))
            unit = word.removeprefix(stem)
            what = "needs a unit" if word + "_" == stem else f"unknown unit {unit!r}"
            yield (
                word,
                f"{what}; write {', '.join(keys[:-1])}{' or ' if keys[:-1] else ''}{keys[-1]}",
            )
        else:
            near = get_close_matches(word[:100], valid, n=1)
            if near:
                missing.pop(valid[near[0]], None)
            hint = did_you_mean(word, valid, otherwise="valid keys")
            yield word, f"unknown key {_short(word)!r}{hint}"
    for name in missing:
        keys = fields[name]
        suffix = _suffix(table.spec, name)
        others = [f"_{k.removeprefix(name.removesuffix(suffix))}" for k in keys[1:]]
        also = f" (or {', '.join(others)})" if others else ""
        description = table.spec.model_fields[name].description
        yield name, f"missing: {name}{also}" + (f": {description}" if description else "")


def _short(word: str) -> str:
    return word if len(word) <= 60 else word[:60] + "…"


def _keys(spec: type[Spec], name: str) -> list[str]:
    dimension = spec.schema_extra(name).get("x-dimension")
    return list(unit_keys(name, dimension)) if dimension else [name]


def _suffix(spec: type[Spec], name: str) -> str:
    dimension = spec.schema_extra(name).get("x-dimension")
    return next(iter(UNITS[dimension])) if dimension else ""


def _without_unit(spec: type[Spec], word: str, valid: Mapping[str, str]) -> str | None:
    """Return the quantity that a word names without a unit, or with an unknown one."""
    for name in dict.fromkeys(valid.values()):
        suffix = _suffix(spec, name)
        stem = name.removesuffix(suffix)
        unit = word.removeprefix(stem)
        if suffix and (word + "_" == stem or (unit != word and unit.isalnum() and len(unit) <= 5)):
            return name
    return None
