"""The tables of a mission, each validated by the Spec of its component."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from pydantic import field_validator
from pydantic_core import PydanticCustomError

from hillsphere.base.errors import PluginError, UnknownComponentError
from hillsphere.base.problems import Problem, did_you_mean, format_value
from hillsphere.mission.elements import arrange_elements
from hillsphere.mission.faults import faults_of
from hillsphere.mission.likes import Derived, without_superseded_units
from hillsphere.mission.report_spec import ReportSpec
from hillsphere.plugins.registry import DEFAULT_TYPES, KINDS, Registered, Registry, kind_words
from hillsphere.spec.base import Spec, option

__all__ = [
    "FORMAT",
    "MISSION_KINDS",
    "MISSION_NAME",
    "MOST_PROBLEMS",
    "TABLE_NAME",
    "TOP_KEYS",
    "Head",
    "Tables",
    "validate_tables",
]

FORMAT = 1
"""Version of the mission format that this version of the framework reads."""

MISSION_KINDS = tuple(kind for kind in KINDS if kind not in ("executor", "format", "command"))
"""Kinds of components in a mission. Executors, file formats and commands are not among them."""

MISSION_NAME = r"[A-Za-z0-9](?:[A-Za-z0-9._-]{0,62}[A-Za-z0-9_-])?"
TABLE_NAME = r"[a-z][a-z0-9_-]{0,63}"
MOST_PROBLEMS = 100
"""Largest number of listed problems; a text with more is most likely not a mission."""


class Head(Spec):
    """Keys at the head of a mission file, above its tables."""

    examples = ({"name": "phobos-qso", "title": "Orbits around Phobos", "seed": 1},)

    name: str = option("short name; the run directory is called after it")
    title: str = option("one line that says what the mission is about", min_length=1)
    seed: int = option("root seed of everything random", ge=0, le=2**63 - 1)
    description: str = option("what a reader should know", default="")
    report: ReportSpec = option("what the report asks, answers and shows", default=ReportSpec())

    @field_validator("name")
    @classmethod
    def _usable_as_directory(cls, name: str) -> str:
        if not re.fullmatch(MISSION_NAME, name):
            raise PydanticCustomError(
                "rule",
                "must be usable as the name of a directory: at most 64 letters, digits, '.', '_' "
                "and '-', beginning with a letter or digit; got {name}",
                {"name": format_value(name)},
            )
        return name


TOP_KEYS = ("format", *Head.model_fields, "each", "drop", "profile")


@dataclass
class Tables:
    """Result of the validation of a mission's tables.

    Parameters
    ----------
    head : Head or None
        The keys above the tables, if they are valid.
    specs : dict
        Kind → name → Spec, of every valid table.
    components : dict
        Kind → name → the component's record, of every table whose type is installed.
    names : dict
        Kind → names of all tables, valid or not.
    problems : list of Problem
        All faults.
    """

    head: Head | None = None
    specs: dict[str, dict[str, Spec]] = field(default_factory=dict)
    components: dict[str, dict[str, Registered]] = field(default_factory=dict)
    names: dict[str, list[str]] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def __iter__(self) -> Iterator[tuple[str, str, Spec]]:
        """Yield (kind, name, Spec) of every valid table."""
        for kind, table in self.specs.items():
            for name, spec in table.items():
                yield kind, name, spec


def validate_tables(layers: Derived, registry: Registry) -> Tables:
    """Validate a mission's head and tables, except for the links between tables.

    Parameters
    ----------
    layers : Derived
        The mission's tables with all layers applied and every ``like`` resolved.
    registry : Registry
        The installed components.

    Returns
    -------
    Tables
        Specs and problems.
    """
    validated = Tables()
    tables = layers.tables
    if not tables:
        message = f"holds no keys; a mission begins with format = {FORMAT}, name, title and seed"
        validated.problems.append(layers.problem((), message))
        return validated
    if (problem := _format_problem(layers)) is not None:
        validated.problems.append(problem)
        if "format" in tables:
            return validated  # another format has other keys
    head = {key: tables[key] for key in Head.model_fields if key in tables}
    validated.head, faults = faults_of(Head, head)
    validated.problems += [
        replace(layers.problem(fault.key, fault.message), is_remark=fault.is_remark)
        for fault in faults
    ]
    for key, value in tables.items():
        if key in MISSION_KINDS:
            _kind(key, value, layers, registry, validated)
        elif key not in TOP_KEYS:
            validated.problems.append(layers.problem((key,), unknown_top_key(key)))
        if len(validated.problems) > MOST_PROBLEMS:
            break
    if "stage" not in tables or tables["stage"] == {}:
        message = "nothing to run; a mission has at least one [stage.NAME]"
        validated.problems.append(layers.problem((), message))
    return validated


def unknown_top_key(key: str) -> str:
    """Return the message for a top-level key that is neither a key of the head nor a kind."""
    hint = did_you_mean(key, (*MISSION_KINDS, *TOP_KEYS), otherwise="a mission has")
    return f"unknown key or kind of table {key[:60]!r}{hint}"


def _format_problem(layers: Derived) -> Problem | None:
    given = layers.tables.get("format")
    if isinstance(given, int) and not isinstance(given, bool) and given == FORMAT:
        return None
    if given is None:
        return layers.problem(("format",), f"missing: write format = {FORMAT}")
    message = f"this version reads format {FORMAT}, got {format_value(given)}"
    return layers.problem(("format",), message)


def _kind(kind: str, value: Any, layers: Derived, registry: Registry, tables: Tables) -> None:
    if isinstance(value, list) and any(isinstance(item, dict) for item in value):
        message = f"[[{kind}]] is an array of tables; give each a name: [{kind}.NAME]"
        tables.problems.append(layers.problem((kind,), message))
        return
    if not isinstance(value, dict):
        message = f"expected tables [{kind}.NAME], got {format_value(value)}"
        tables.problems.append(layers.problem((kind,), message))
        return
    plain = {name for name, table in value.items() if not isinstance(table, dict)}
    plain_is_told = len(plain) > 1 or "type" in plain
    if plain_is_told:
        message = f"the table needs a name: write [{kind}.NAME] instead of [{kind}]"
        tables.problems.append(layers.problem((kind,), message))
    tables.names[kind] = [name for name in value if name not in plain]
    for name, table in value.items():
        if name in plain:
            if table is False and layers.rank((kind, name))[1] > 0:
                hint = did_you_mean(name, tables.names[kind], otherwise=f"{kind} tables")
                message = f"there is no table {kind}.{name} to drop{hint}"
                tables.problems.append(layers.problem((kind, name), message))
            elif not plain_is_told:
                message = f"expected a table [{kind}.NAME], got {format_value(table)}"
                tables.problems.append(layers.problem((kind, name), message))
            continue
        _table(kind, name, table, layers, registry, tables)
        if len(tables.problems) > MOST_PROBLEMS:
            return


def _table(
    kind: str,
    name: str,
    table: Mapping[str, Any],
    layers: Derived,
    registry: Registry,
    tables: Tables,
) -> None:
    def refuse(message: str, *key: str | int) -> None:
        tables.problems.append(layers.problem((kind, name, *key), message))

    if not re.fullmatch(TABLE_NAME, name):
        refuse(
            "a table's name has at most 64 small letters, digits, '_' and '-' and begins with a "
            "letter"
        )
    if (kind, name) in layers.unsound:
        return
    type_ = table.get("type", None if _is_misnamed(kind, name, layers) else DEFAULT_TYPES.get(kind))
    if type_ is None:
        refuse(_missing_type(kind, name, layers, registry, tables), "type")
        return
    if not isinstance(type_, str):
        refuse(f"expected a string, got {format_value(type_)}", "type")
        return
    try:
        record = registry.get(kind, type_)
        spec_class = record.load_spec()
    except (UnknownComponentError, PluginError) as error:
        refuse(str(error), "type")
        return
    tables.components.setdefault(kind, {})[name] = record
    keys = {key: value for key, value in table.items() if key != "type"}
    keys = without_superseded_units(spec_class, keys, (kind, name), layers)
    known = len(layers.problems)
    keys = arrange_elements(spec_class, keys, (kind, name), layers)
    if len(layers.problems) > known:
        return
    spec, faults = faults_of(spec_class, keys)
    for fault in faults:
        problem = layers.problem((kind, name, *fault.key), fault.message)
        tables.problems.append(replace(problem, is_remark=fault.is_remark))
    if spec is not None:
        tables.specs.setdefault(kind, {})[name] = spec


def _is_misnamed(kind: str, name: str, layers: Derived) -> bool:
    """Return whether a table without a type is laid over the file: most likely a misspelt name."""
    return layers.rank((kind, name))[1] > 0


def _missing_type(kind: str, name: str, layers: Derived, registry: Registry, tables: Tables) -> str:
    if _is_misnamed(kind, name, layers):
        others = [other for other in tables.names[kind] if other != name]
        hint = did_you_mean(name, others, otherwise=f"{kind} tables")
        return f"there is no table {kind}.{name} to change{hint}; a new one needs a type"
    types = ", ".join(record.component.type for record in registry.of_kind(kind))
    return f"missing: which {kind_words(kind)} it is; installed: {types or 'none'}"
