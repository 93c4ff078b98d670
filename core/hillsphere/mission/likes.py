"""Tables that copy another one of the same kind: ``like = "NAME"``.

The other table is copied with profile and settings applied; then the table's own keys, from the
file or a layer, are merged into the copy. Chains are allowed.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from hillsphere.base.problems import Key, Problem, did_you_mean, format_value
from hillsphere.mission.each import Expanded
from hillsphere.spec.annotations import inner
from hillsphere.spec.base import Spec

__all__ = ["Derived", "nested_specs", "resolve_likes", "without_superseded_units"]

_Node = tuple[str, str]


@dataclass
class Derived:
    """Tables with every ``like`` resolved.

    Parameters
    ----------
    layers : Expanded
        The tables with every `for` expanded.
    tables : dict
        The same without ``like`` and without the tables that were dropped.
    bases : dict
        (kind, name) → name of the table that it copies.
    unsound : set
        Tables whose ``like`` is invalid; they are not checked further.
    problems : list of Problem
        Faults of every ``like``.
    elements : dict
        Path of an array that is written as named elements → for each of them its name and the names
        of the elements that it is like, the nearest first.
    """

    layers: Expanded
    tables: dict[str, Any]
    bases: dict[_Node, str] = field(default_factory=dict)
    unsound: set[_Node] = field(default_factory=set)
    problems: list[Problem] = field(default_factory=list)
    elements: dict[Key, list[tuple[str, ...]]] = field(default_factory=dict)

    def problem(self, key: Key, message: str) -> Problem:
        """Return a problem where the value was written, which may be in a copied table."""
        key = self._with_names(key)
        where, name, _ = self._written(key)
        problem = self.layers.layers.problem(where, message)
        if name is None:
            return problem
        kind, own = str(key[0]), str(key[1])
        return replace(
            problem,
            user="" if name == own else f"{kind}.{own}",
            given="" if where[1] == name else self.layers.values_text(kind, name),
        )

    def rank(self, key: Key) -> tuple[int, int]:
        """Return the precedence of a value; of two values of one quantity the higher is used.

        A table's own values have precedence over copied ones; among values of one table, those of
        a later layer.
        """
        where, _, depth = self._written(key)
        return -depth, self.layers.layers.layer(where)

    def replaced_tables(self, key: Key) -> list[dict[str, Any]]:
        """Return the tables of layers and ``like`` that a value replaces, the nearest first."""
        kind, name, rest = str(key[0]), str(key[1]), key[2:]
        written = self.layers.layers.tables[kind]
        tables: list[dict[str, Any]] = []
        while True:
            for place in self.layers.written_as(kind, name):
                table = _value_at(written.get(place), rest)
                if not isinstance(table, dict):
                    table = self.layers.layers.replaced_table((kind, place, *rest))
                if table is not None:
                    tables.append(self.layers.with_values((kind, name), place, key, table))
            if (kind, name) not in self.bases:
                return tables
            name = self.bases[kind, name]

    def _with_names(self, key: Key) -> Key:
        """Return a key with names in place of the indices of named elements."""
        named: Key = ()
        for position, part in enumerate(key):
            names = self.elements.get(named) if isinstance(part, int) else None
            if names is None:
                named = (*named, part)
                continue
            tables = _value_at(self.tables, named)
            rest = key[position + 1 :]
            chain = names[int(part)]
            holder = next((name for name in chain if _holds(tables.get(name), rest)), chain[0])
            named = (*named, holder)
        return named

    def _written(self, key: Key) -> tuple[Key, str | None, int]:
        """Return the key as it is written, the table of the chain that holds it, and its depth.

        An expanded table has two places: its own name, if it is written, and one step deeper the
        table with `for`.
        """
        if len(key) < 2 or not isinstance(self.layers.tables.get(str(key[0])), dict):
            return key, None, 0
        kind, name, rest = str(key[0]), str(key[1]), key[2:]
        written = self.layers.layers.tables[kind]
        depth = 0
        while True:
            for place in self.layers.written_as(kind, name):
                if _holds(written.get(place), rest):
                    return (kind, place, *rest), name, depth
                depth += 1
            if (kind, name) not in self.bases:
                own = str(key[1])
                return (kind, self.layers.written_as(kind, own)[0], *rest), own, 0
            name = self.bases[kind, name]


def resolve_likes(layers: Expanded, kinds: Iterable[str]) -> Derived:
    """Resolve every ``like``, and leave out the dropped tables.

    Parameters
    ----------
    layers : Expanded
        The mission's tables with profile and settings applied, and every `for` expanded.
    kinds : iterable of str
        Kinds of table.

    Returns
    -------
    Derived
        The tables and their faults.
    """
    derived = Derived(layers, dict(layers.tables), problems=list(layers.drop_problems))
    for kind in kinds:
        written = layers.tables.get(kind)
        if not isinstance(written, dict):
            continue
        done: dict[str, dict[str, Any]] = {}
        used: set[str] = set()
        for name, table in written.items():
            if isinstance(table, dict) and layers.dropped_at(kind, name) is None:
                _derive(kind, name, derived, done, used)
        derived.tables[kind] = {
            name: done.get(name, table)
            for name, table in written.items()
            if layers.dropped_at(kind, name) is None
        }
        for name in dict.fromkeys((*written, *layers.layers.tables[kind])):
            if (laid := layers.laid_on_dropped(kind, name, used)) is not None:
                derived.problems.append(laid)
    return derived


def _derive(
    kind: str, root: str, derived: Derived, done: dict[str, dict[str, Any]], used: set[str]
) -> None:
    """Resolve the chain of one table from its far end, without recursion."""
    written: Mapping[str, Any] = derived.layers.tables[kind]
    chain: list[str] = []
    place: dict[str, int] = {}
    name = root
    while name not in done and (kind, name) not in derived.unsound:
        place[name] = len(chain)
        chain.append(name)
        if "like" not in written[name]:
            break
        base = written[name]["like"]
        fault = _fault(kind, base, derived.layers.tables)
        if fault is None and base in place:
            circle = " → ".join([*chain[place[base] :], base])
            fault = f"goes in a circle: {circle}"
        if fault is not None:
            derived.problems.append(derived.problem((kind, name, "like"), fault))
            derived.unsound.add((kind, name))
            chain.pop()
            break
        derived.bases[kind, name] = base
        used.add(base)
        name = base
    for name in reversed(chain):
        base = derived.bases.get((kind, name), "")
        if not base:
            done[name] = dict(written[name])
        elif (kind, base) in derived.unsound:
            derived.unsound.add((kind, name))
        else:
            own = {key: value for key, value in written[name].items() if key != "like"}
            fault = _other_type(base, done[base], own)
            if fault:
                derived.problems.append(derived.problem((kind, name, "type"), fault))
                derived.unsound.add((kind, name))
            else:
                done[name] = _merge(done[base], own)


def _fault(kind: str, base: Any, tables: Mapping[str, Any]) -> str | None:
    if not isinstance(base, str):
        return f"expected the name of another {kind} table, got {format_value(base)}"
    named = {
        other: [name for name, table in group.items() if isinstance(table, dict)]
        for other, group in tables.items()
        if isinstance(group, dict)
    }
    names = named.pop(kind)
    if base in names:
        return None
    start = f"no {kind} table is named {base[:60]!r}"
    bare = base.removeprefix(f"{kind}.")
    if bare in names:
        return f"{start}; write the name alone, {bare!r}"
    for other, group in named.items():
        if base.removeprefix(f"{other}.") in group:
            bare = base.removeprefix(f"{other}.")
            kinds = "but a table can only be like one of its own kind"
            return f"{start}; there is {other}.{bare}, {kinds}"
    return start + did_you_mean(base, names, otherwise="there are")


def _other_type(base: str, below: Mapping[str, Any], own: Mapping[str, Any]) -> str | None:
    if "type" not in own or "type" not in below or own["type"] == below["type"]:
        return None
    return (
        f"it is like {base!r}, whose type is {format_value(below['type'])}, and cannot be of "
        "another; "
        f"got {format_value(own['type'])}"
    )


def _merge(below: Any, above: Any) -> Any:
    if not (isinstance(below, dict) and isinstance(above, dict)):
        return above
    table = dict(below)
    for key, value in above.items():
        table[key] = _merge(below.get(key), value)
    return table


def _holds(table: Any, rest: Key) -> bool:
    """Return whether a table itself gives this key, or a table or array around it."""
    for part in rest:
        if not isinstance(table, dict):
            return True
        if part not in table:
            return False
        table = table[part]
    return True


def _value_at(table: Any, path: Key) -> Any:
    """Return the value at a path through tables; None if there is none."""
    for part in path:
        table = table.get(part) if isinstance(table, Mapping) else None
    return table


def without_superseded_units(
    spec: type[Spec], table: Mapping[str, Any], path: Key, tables: Derived
) -> dict[str, Any]:
    """Remove a quantity in one unit if a value in another unit overrides it.

    Parameters
    ----------
    spec : type
        Spec of the table.
    table : mapping
        Its keys, all layers merged.
    path : tuple
        Path of the table in the mission.
    tables : Derived
        Gives the precedence of keys.

    Returns
    -------
    dict
        The remaining keys. Two units of equal precedence both stay, and are reported as a fault.
    """
    kept = dict(table)
    for keys in spec.units_by_field().values():
        given = [key for key in keys if key in table]
        if len(given) > 1:
            latest = max(tables.rank((*path, key)) for key in given)
            for key in given:
                if tables.rank((*path, key)) < latest:
                    del kept[key]
    for name, nested in nested_specs(spec):
        if isinstance(value := kept.get(name), dict):
            kept[name] = without_superseded_units(nested, value, (*path, name), tables)
    return kept


def nested_specs(spec: type[Spec]) -> Iterator[tuple[str, type[Spec]]]:
    """Yield the fields that hold one nested Spec (arrays are replaced as a whole)."""
    for name, info in spec.model_fields.items():
        annotation = inner(info.annotation)
        if isinstance(annotation, type) and issubclass(annotation, Spec):
            yield name, annotation
