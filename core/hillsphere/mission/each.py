"""Expansion of tables with ``for = "controller"`` over the lists of ``[each]``.

A table with `for` is expanded to one table per value. The name of each is that of the table with
``_VALUE`` appended, or with the value in place of ``{controller}``; ``{controller}`` in its strings
is replaced too. Keys of a table that is written under such a name override those of the expanded
table. Profile and settings are applied before, so that they can change the table with `for` as well
as single expanded tables.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import prod
from typing import Any, TypeAlias

from hillsphere.base.problems import Key, Problem, did_you_mean, format_value
from hillsphere.mission.drop import find_dropped
from hillsphere.mission.layers import Layers, Origin

__all__ = ["EACH_NAME", "Expanded", "expand_tables", "size_of"]

EACH_NAME = r"[a-z][a-z0-9_-]{0,63}"
"""Pattern of a list's name in ``[each]``."""

_MOST_TABLES = 1000
"""Largest total number of expanded tables; the largest packaged mission has 80."""
_MOST_CHARACTERS = 1 << 20
"""Largest total of characters and values of all expanded tables: that of the largest file."""
_LONGEST_VALUE = 64
"""Longest value, in characters: it becomes a part of a table's name, whose limit this is."""
_PARTS = re.compile(r"\{\{|\}\}|\{([^{}]*)\}|[{}]")

_Node: TypeAlias = tuple[str, str]
_Value: TypeAlias = str | int | float
_Values: TypeAlias = Mapping[str, _Value]


@dataclass
class Expanded:
    """Tables with every `for` expanded, and the tables that are dropped.

    Parameters
    ----------
    layers : Layers
        The tables as they are written, with profile and settings applied.
    tables : dict
        The same with one table per value in place of every table with `for`.
    sources : dict
        (kind, name) of a table → name of the table with `for` that it comes from.
    values : dict
        (kind, name) of an expanded table → value of each variable.
    problems : list of Problem
        Faults of `[each]`, `for` and strings with braces, which prevent further checks.
    dropped : dict
        (kind, name) of a dropped table → the layer that drops it, and the key there.
    drop_problems : list of Problem
        Faults of `drop`.
    characters : int
        Total size of the expanded tables.
    """

    layers: Layers
    tables: dict[str, Any]
    sources: dict[_Node, str] = field(default_factory=dict)
    values: dict[_Node, _Values] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)
    dropped: dict[_Node, tuple[Origin, Key]] = field(default_factory=dict)
    drop_problems: list[Problem] = field(default_factory=list)
    characters: int = 0

    def written_as(self, kind: str, name: str) -> tuple[str, ...]:
        """Return the tables of the mission file that set a table's keys, in order of precedence."""
        source = self.sources.get((kind, name))
        if source is None:
            return (name,)
        is_written = isinstance(self.layers.tables[kind].get(name), dict)
        return (name, source) if is_written else (source,)

    def values_text(self, kind: str, name: str) -> str:
        """Return the values that a table was expanded with: ``controller = 'k0'``."""
        values = self.values.get((kind, name), {})
        return ", ".join(f"{variable} = {value!r}" for variable, value in values.items())

    def with_values(self, node: _Node, place: str, key: Key, value: Any) -> Any:
        """Return a value of the table `place` as it stands in a table that may be expanded from it.

        Parameters
        ----------
        node : tuple of str
            (kind, name) of the table.
        place : str
            Name of the table in the mission file that sets the value.
        key : tuple
            Path of the value there, for messages.
        value : object
            The value.
        """
        if self.sources.get(node) != place:
            return value
        return _substitute(value, key, self.values[node], self)

    def dropped_at(self, kind: str, name: str) -> str | None:
        """Return where a table was dropped, ``"file:line"`` or the setting; None if it was not."""
        drop = self.dropped.get((kind, name))
        return None if drop is None else drop[0].problem(drop[1], "").place

    def laid_on_dropped(self, kind: str, name: str, used: Iterable[str]) -> Problem | None:
        """Return the problem that a setting has no effect, as its table is dropped; else None.

        Parameters
        ----------
        kind, name : str
            Table in the mission file, before `for` is expanded.
        used : iterable of str
            Names of the tables of this kind that a ``like`` copies.
        """
        origin = self.layers.last_origin(kind, name)
        if origin is None:
            return None
        nodes = [node for node, source in self.sources.items() if (node[0], source) == (kind, name)]
        nodes = nodes or [(kind, name)]
        drops = [self.dropped.get(node) for node in nodes]
        if any(node[1] in used for node in nodes):
            return None  # the setting shows there
        if any(drop is None or drop[0].layer >= origin.layer for drop in drops):
            return None
        place = self.dropped_at(*nodes[0])
        message = f"this table is dropped at {place}; --set {kind}.{name}=true takes it back"
        return replace(origin.problem((kind, name), message), is_idle=True)


def expand_tables(layers: Layers, kinds: Iterable[str]) -> Expanded:
    """Expand every table with `for`, and find the tables that are dropped.

    Parameters
    ----------
    layers : Layers
        The mission's tables with profile and settings applied.
    kinds : iterable of str
        Kinds of table.

    Returns
    -------
    Expanded
        The tables and their faults. Expanded tables take the place of the table with `for`, in the
        order of the list. Consecutive stages with the same `for` are ordered value by value: all
        of them with the first value, then all with the second.
    """
    result = Expanded(layers, dict(layers.tables))
    lists = _lists(result)
    used: set[str] = set()
    groups = [kind for kind in kinds if isinstance(layers.tables.get(kind), dict)]
    for kind in groups:
        variables = {
            name: _variables((kind, name), table["for"], lists, result)
            for name, table in layers.tables[kind].items()
            if isinstance(table, dict) and "for" in table
        }
        used.update(*variables.values())
        if not result.problems:
            _expand_kind(kind, variables, lists, result)
    if not result.problems:
        for name in lists:
            if name not in used:
                _refuse(result, ("each", name), "no table is for this list; remove it")
    if not result.problems:
        nodes = {
            (kind, name): result.sources.get((kind, name), name)
            for kind in groups
            for name, table in result.tables[kind].items()
            if isinstance(table, dict)
        }
        result.dropped, result.drop_problems = find_dropped(layers, nodes)
    return result


def _refuse(result: Expanded, key: Key, message: str) -> None:
    result.problems.append(result.layers.problem(key, message))


def _lists(result: Expanded) -> dict[str, Sequence[_Value]]:
    """Return the lists of ``[each]``, and add a problem for each invalid one."""
    given = result.layers.tables.get("each", {})
    if not isinstance(given, dict):
        _refuse(
            result, ("each",), f"expected lists, [each] NAME = [...]; got {format_value(given)}"
        )
        return {}
    for name, values in given.items():
        key = ("each", name)
        if not re.fullmatch(EACH_NAME, name):
            _refuse(
                result, key,
                "a list's name has at most 64 small letters, digits, '_' and '-' and begins with "
                "a letter",
            )  # fmt: skip
        elif not isinstance(values, list) or not values:
            _refuse(
                result, key, f"expected a list of strings or numbers, got {format_value(values)}"
            )
        else:
            _check_values(key, values, result)
    return given


def _check_values(key: Key, values: list[Any], result: Expanded) -> None:
    texts: set[str] = set()
    for index, value in enumerate(values):
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            _refuse(
                result, (*key, index), f"expected a string or a number, got {format_value(value)}"
            )
        elif len(str(value)) > _LONGEST_VALUE:
            message = f"must have at most {_LONGEST_VALUE} characters, got {len(str(value))}"
            _refuse(result, (*key, index), message)
        elif str(value) in texts:
            _refuse(result, (*key, index), f"{value!r} is in the list twice")
        texts.add(str(value))


def _variables(
    node: _Node, given: Any, lists: Mapping[str, Any], result: Expanded
) -> tuple[str, ...]:
    """Return the names of lists that a table's `for` gives."""
    names = [given] if isinstance(given, str) else given
    key = (*node, "for")
    if not isinstance(names, list) or not names or not all(isinstance(n, str) for n in names):
        _refuse(
            result,
            key,
            f"expected the name of a list of [each] or several, got {format_value(given)}",
        )
        return ()
    for index, name in enumerate(names):
        if name not in lists:
            hint = did_you_mean(name, lists, otherwise="there are") or "; write [each] NAME = [...]"
            _refuse(result, key, f"no list of [each] is named {name[:60]!r}{hint}")
        elif name in names[:index]:
            _refuse(result, key, f"names {name!r} twice")
    return tuple(names)


def _expand_kind(
    kind: str,
    variables: Mapping[str, tuple[str, ...]],
    lists: Mapping[str, Sequence[_Value]],
    result: Expanded,
) -> None:
    written: Mapping[str, Any] = result.layers.tables[kind]
    names: dict[str, list[str]] = {}
    for name, over in variables.items():
        count = prod(len(lists[variable]) for variable in over)
        result.characters += count * size_of(written[name])
        if count + len(result.sources) > _MOST_TABLES or result.characters > _MOST_CHARACTERS:
            message = f"stands for {count} tables; all tables with `for` together stand for at most"
            limits = f"{_MOST_TABLES} tables and {_MOST_CHARACTERS} characters"
            _refuse(result, (kind, name, "for"), f"{message} {limits}")
            return
        names[name] = _names(kind, name, over, lists, result)
    for name in names:
        if (kind, name) in result.sources:
            source = result.sources[kind, name]
            message = f"{kind}.{source} stands for a table of this name, which cannot have a `for`"
            _refuse(result, (kind, name, "for"), message)
    if result.problems:
        return
    ordered: dict[str, Any] = {}
    own = [name for name in written if (kind, name) not in result.sources]
    # Only stages have an order; components of one type stay together.
    for run in _runs(own, variables) if kind == "stage" else ([name] for name in own):
        if run[0] not in names:
            ordered[run[0]] = written[run[0]]
            continue
        for index in range(len(names[run[0]])):
            for name in run:
                new = names[name][index]
                table = {key: value for key, value in written[name].items() if key != "for"}
                for key, value in table.items():
                    table[key] = _substitute(
                        value, (kind, name, key), result.values[kind, new], result
                    )
                ordered[new] = _merge_tables(table, written.get(new))
    result.tables[kind] = ordered


def _names(
    kind: str,
    source: str,
    variables: tuple[str, ...],
    lists: Mapping[str, Sequence[_Value]],
    result: Expanded,
) -> list[str]:
    """Return the names of the tables that a table expands to, and record their source."""
    made: list[str] = []
    pattern = source if "{" in source else "_".join((source, *(f"{{{v}}}" for v in variables)))
    for combination in product(*(lists[variable] for variable in variables)):
        values = dict(zip(variables, combination, strict=True))
        name = str(_substitute(pattern, (kind, source), values, result, as_text=True))
        if result.problems:
            break
        if (other := result.sources.get((kind, name))) is not None:
            message = f"stands for a table {kind}.{name}, for which {kind}.{other} stands already"
            if other == source:
                message = f"stands for {kind}.{name} twice; its name needs every variable"
            _refuse(result, (kind, source, "for"), message)
            break
        result.sources[kind, name] = source
        result.values[kind, name] = values
        made.append(name)
    return made


def _runs(names: Iterable[str], variables: Mapping[str, tuple[str, ...]]) -> Iterator[list[str]]:
    """Yield groups of consecutive tables with the same `for`; other tables alone."""
    run: list[str] = []
    for name in names:
        if run and (name not in variables or variables[name] != variables.get(run[0])):
            yield run
            run = []
        run.append(name)
    if run:
        yield run


def _substitute(
    value: Any, key: Key, values: _Values, result: Expanded, as_text: bool = False
) -> Any:
    """Replace variables in the strings of a value; without any, return the same object."""
    if isinstance(value, list):
        items = [_substitute(item, (*key, k), values, result) for k, item in enumerate(value)]
        return items if any(a is not b for a, b in zip(items, value, strict=True)) else value
    if isinstance(value, dict):
        return {
            name: _substitute(item, (*key, name), values, result) for name, item in value.items()
        }
    if not isinstance(value, str) or not ("{" in value or "}" in value):
        return value
    if not as_text and value.startswith("{") and value[1:-1] in values and value.endswith("}"):
        return values[value[1:-1]]

    def text(match: re.Match[str]) -> str:
        part = match.group()
        if part in ("{{", "}}"):
            return part[0]
        name = match.group(1)
        if name in values:
            return str(values[name])
        problem = _explain_part(part, name, values, key, result)
        if problem not in result.problems:
            result.problems.append(problem)
        return part

    return _PARTS.sub(text, value)


def size_of(value: Any) -> int:
    """Return the number of values plus the number of characters in strings."""
    if isinstance(value, dict):
        return sum(1 + size_of(item) for item in value.values())
    if isinstance(value, list):
        return sum(1 + size_of(item) for item in value)
    return len(value) if isinstance(value, str) else 1


def _explain_part(
    part: str, name: str | None, values: _Values, key: Key, result: Expanded
) -> Problem:
    if name is None:
        message = f"a single {part!r}; a brace in the text is written {part * 2!r}"
    elif name in result.layers.tables.get("each", {}):
        message = f"{part[:60]} is not among the variables of this table; add it to `for`"
    else:
        hint = did_you_mean(name, values, otherwise="this table has")
        message = f"no variable is named {name[:60]!r}{hint} (a brace is written '{{{{')"
    return result.layers.problem(key, message)


def _merge_tables(below: Any, above: Any) -> Any:
    """Return a table with the keys of another one merged into it; ignore other values."""
    if not isinstance(above, dict):
        return below
    table = dict(below)
    for key, value in above.items():
        both = isinstance(value, dict) and isinstance(below.get(key), dict)
        table[key] = _merge_tables(below[key], value) if both else value
    return table
