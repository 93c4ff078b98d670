"""Arrays of tables that are written as tables of named elements.

Where a Spec declares an array of tables, a mission may write a table whose keys name the elements::

    [stage.references.descents]
    rt1 = { site = { latitude_deg = 12, longitude_deg = 25 }, duration_s = 7980 }
    rt2 = { like = "rt1", site = { latitude_deg = -15, longitude_deg = 15 } }

The elements stand in the order in which they are written. The key is the element's `name` if its
Spec has one and the element does not give another. Tables merge, so that a profile, a setting and a
table with ``like`` reach the keys of single elements; `false` in place of an element leaves it out.
An element with ``like`` begins as a copy of another one of the same table, which may be left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, get_args, get_origin

from hillsphere.base.problems import Key, did_you_mean, format_value
from hillsphere.mission.each import size_of
from hillsphere.mission.likes import Derived, nested_specs, without_superseded_units
from hillsphere.spec.annotations import inner
from hillsphere.spec.base import Spec

__all__ = ["arrange_elements", "element_specs"]

_MOST_COPIED = 1 << 16
"""Largest total of values and characters that the elements of one array copy by ``like``: a
sixteenth of the largest file; the packaged missions copy at most 111 in one array."""


def element_specs(spec: type[Spec]) -> Iterator[tuple[str, type[Spec]]]:
    """Yield the fields of a Spec that hold an array of tables, each with the Spec of an element."""
    for name, info in spec.model_fields.items():
        annotation = inner(info.annotation)
        arguments = get_args(annotation)
        if get_origin(annotation) is tuple and len(arguments) == 2 and arguments[1] is Ellipsis:
            element = inner(arguments[0])
            if isinstance(element, type) and issubclass(element, Spec):
                yield name, element


def arrange_elements(
    spec: type[Spec], table: Mapping[str, Any], path: Key, tables: Derived
) -> dict[str, Any]:
    """Return a table with arrays in place of the tables of named elements, at every depth.

    Parameters
    ----------
    spec : type
        Spec of the table.
    table : mapping
        Its keys, all layers merged, without superseded units.
    path : tuple
        Path of the table in the mission.
    tables : Derived
        The names of elements are recorded and problems are added here.

    Returns
    -------
    dict
        The keys.
    """
    arranged = dict(table)
    for name, element in element_specs(spec):
        if isinstance(given := arranged.get(name), dict):
            arranged[name] = _array(element, given, (*path, name), tables)
    for name, nested in nested_specs(spec):
        if isinstance(given := arranged.get(name), dict):
            arranged[name] = arrange_elements(nested, given, (*path, name), tables)
    return arranged


def _array(
    spec: type[Spec], given: Mapping[str, Any], path: Key, tables: Derived
) -> list[dict[str, Any]]:
    """Return the elements of one array, and record from which elements each takes its keys."""
    own: dict[str, dict[str, Any]] = {}
    left_out: set[str] = set()
    for name, value in given.items():
        here = (*path, name)
        fault = ""
        if isinstance(value, dict):
            own[name] = without_superseded_units(spec, value, here, tables)
        elif value is not False:
            fault = f"expected a table, or false to leave it out; got {format_value(value)}"
        elif replaced := tables.replaced_tables(here):
            own[name] = {}
            for table in reversed(replaced):
                own[name] = _merge_element(spec, own[name], table)
            left_out.add(name)
        else:
            others = [other for other in given if other != name]
            hint = did_you_mean(name, others, otherwise="there are")
            fault = f"there is no element {name[:60]!r} to leave out{hint}"
        if fault:
            tables.problems.append(tables.problem(here, fault))
    chains = {
        name: chain
        for name in own
        if name not in left_out and (chain := _chain(name, own, path, tables))
    }
    copied = sum(size_of(own[base]) for chain in chains.values() for base in chain[1:])
    if copied > _MOST_COPIED:
        message = f"its elements copy {copied} values and characters by `like`, at most"
        tables.problems.append(tables.problem(path, f"{message} {_MOST_COPIED}"))
        return []
    tables.elements[path] = list(chains.values())
    array = []
    for name, chain in chains.items():
        element: dict[str, Any] = {}
        for base in reversed(chain):
            element = _merge_element(spec, element, own[base])
        element.pop("like", None)
        if "name" in spec.model_fields:
            element["name"] = own[name].get("name", name)
        array.append(arrange_elements(spec, element, (*path, name), tables))
    return array


def _chain(
    name: str, own: Mapping[str, dict[str, Any]], path: Key, tables: Derived
) -> tuple[str, ...]:
    """Return an element and those that it is like, the nearest first; nothing after a fault."""
    chain = dict.fromkeys([name])
    while "like" in own[name]:
        base = own[name]["like"]
        if not isinstance(base, str):
            fault = f"expected the name of another element, got {format_value(base)}"
        elif base not in own:
            hint = did_you_mean(base, own, otherwise="there are")
            fault = f"no element is named {base[:60]!r}{hint}"
        elif base in chain:
            circle = [*chain, base][list(chain).index(base) :]
            fault = f"goes in a circle: {' → '.join(circle)}"
        else:
            chain[base] = None
            name = base
            continue
        problem = tables.problem((*path, name, "like"), fault)
        if problem not in tables.problems:  # other elements may be like this one
            tables.problems.append(problem)
        return ()
    return tuple(chain)


def _merge_element(
    spec: type[Spec], below: Mapping[str, Any], above: Mapping[str, Any]
) -> dict[str, Any]:
    """Merge an element into a copy; a quantity replaces the same one in another unit."""
    merged = dict(below)
    for keys in spec.units_by_field().values():
        if any(key in above for key in keys):
            for key in keys:
                merged.pop(key, None)
    nested = dict(nested_specs(spec))
    for key, value in above.items():
        if isinstance(value, dict) and isinstance(merged.get(key), dict):
            merged[key] = (
                _merge_element(nested[key], merged[key], value)
                if key in nested
                else {**merged[key], **value}
            )
        else:
            merged[key] = value
    return merged
