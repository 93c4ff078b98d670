"""JSON Schema of a mission file with every installed plugin, for editors and other programs.

The schema lists the keys of every table, with each quantity in all units. It accepts more than
`load_mission`, which alone checks rules between keys, references, needs, files, the keys of a table
with `like`, missing keys of named elements and the values in a table with `for`. With `[each]`, a
table may have neither `type` nor `like`: it changes one of the tables that a table with `for`
expands to.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hillsphere.base.errors import PluginError
from hillsphere.mission.each import EACH_NAME
from hillsphere.mission.tables import (
    FORMAT,
    MISSION_KINDS,
    MISSION_NAME,
    TABLE_NAME,
    TOP_KEYS,
    Head,
)
from hillsphere.plugins.registry import DEFAULT_TYPES, Registered, Registry
from hillsphere.spec.units import UNITS, unit_keys, unit_text

__all__ = ["mission_schema", "split_schema"]

_JSON_BOUNDS = {
    "gt": "exclusiveMinimum",
    "ge": "minimum",
    "lt": "exclusiveMaximum",
    "le": "maximum",
}


def mission_schema(registry: Registry) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of a mission file.

    Parameters
    ----------
    registry : Registry
        The installed components.

    Returns
    -------
    dict
        The schema. ``"x-broken"`` lists components whose Spec cannot be imported, with the reason;
        they are accepted with any keys. It also lists components that several plugins offer, which
        are refused as ambiguous.
    """
    definitions: dict[str, Any] = {}
    broken = {
        f"{kind}.{type_}": message
        for (kind, type_), message in registry.contested.items()
        if kind in MISSION_KINDS
    }
    head = _object(Head.model_json_schema(mode="validation"), named=False)
    for name, definition in head.pop("$defs", {}).items():
        definitions[name] = _object(definition, named=False)
    properties: dict[str, Any] = {
        "format": {"const": FORMAT, "description": "version of the mission format"},
        **head["properties"],
        "each": _EACH,
        "drop": _DROP,
        "profile": {
            "description": "changes that --profile NAME lays over the mission",
            "type": "object",
            "additionalProperties": {
                "type": "object",
                "properties": {"drop": _DROP},
                "propertyNames": {
                    "enum": [k for k in (*TOP_KEYS, *MISSION_KINDS) if k not in _NOT_IN_PROFILES]
                },
            },
        },
    }
    properties["name"]["pattern"] = f"^{MISSION_NAME}$"
    for kind in MISSION_KINDS:
        properties[kind] = _kind(kind, list(registry.of_kind(kind)), definitions, broken)
    properties["stage"]["minProperties"] = 1
    schema: dict[str, Any] = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Hillsphere mission",
        "type": "object",
        "properties": properties,
        "required": ["format", *head["required"], "stage"],
        "additionalProperties": False,
        "if": {"not": {"required": ["each"]}},
        "then": {
            "properties": {
                kind: {"additionalProperties": _BEGUN}
                for kind in MISSION_KINDS
                if kind not in DEFAULT_TYPES
            }
        },
        "$defs": definitions,
    }
    if broken:
        schema["x-broken"] = broken
    return schema


def split_schema(schema: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """Return the schema of `mission_schema` as one document per kind of table.

    Parameters
    ----------
    schema : mapping
        The whole schema.

    Returns
    -------
    dict
        Name of a file to its schema: ``mission.schema.json`` for the whole file, which refers to
        ``gravity.schema.json`` and so on. The name is also its ``"$id"``, relative to the folder
        in which the files stand together.
    """
    definitions: Mapping[str, Any] = schema["$defs"]
    properties = dict(schema["properties"])
    documents: dict[str, dict[str, Any]] = {}
    for kind in MISSION_KINDS:
        documents[f"{kind}.schema.json"] = {
            "$schema": schema["$schema"],
            "$id": f"{kind}.schema.json",
            "title": f"Hillsphere: tables [{kind}.NAME]",
            **properties[kind],
            "$defs": _of_kind(kind, definitions),
        }
        properties[kind] = {"$ref": f"{kind}.schema.json"}
    own = {
        name: definition
        for name, definition in definitions.items()
        if name.partition(".")[0] not in MISSION_KINDS
    }
    head = {"$schema": schema["$schema"], "$id": "mission.schema.json"}
    whole = {**head, **schema, "properties": properties, "$defs": own}
    return {"mission.schema.json": whole, **documents}


def _of_kind(kind: str, definitions: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: definition
        for name, definition in definitions.items()
        if name.partition(".")[0] == kind
    }


_NOT_IN_PROFILES = ("format", "profile")
_EACH = {
    "description": "lists of values; a table with for = NAME stands for one table per value",
    "type": "object",
    "propertyNames": {"pattern": f"^{EACH_NAME}$"},
    "additionalProperties": {
        "type": "array",
        "minItems": 1,
        "uniqueItems": True,
        "items": {"type": ["string", "number"]},
    },
}
_DROP = {
    "description": "patterns of the tables that are no part of the mission, such as stage.wide_*",
    "type": "array",
    "items": {"type": "string"},
}
_FOR = {
    "description": "lists of [each]: the table stands for one table per value",
    "anyOf": [
        {"type": "string"},
        {"type": "array", "minItems": 1, "uniqueItems": True, "items": {"type": "string"}},
    ],
}
_BEGUN = {"anyOf": [{"required": ["type"]}, {"required": ["like"]}]}
_NAMED = ".named"
"""Suffix of the definition of a named element, which may lack keys, beside that of an item."""
_PATTERN_NAME = r"^[a-z0-9_{}-]*\{[a-z0-9_{}-]*$"


def _kind(
    kind: str, records: list[Registered], definitions: dict[str, Any], broken: dict[str, str]
) -> dict[str, Any]:
    """Return the schema of the tables of one kind, whose keys depend on their type."""
    rules = []
    for record in records:
        type_ = record.component.type
        name = f"{kind}.{type_}"
        try:
            made = record.load_spec().model_json_schema(
                mode="validation", ref_template=f"#/$defs/{name}.{{model}}"
            )
        except PluginError as error:
            broken[name] = str(error)
            continue
        for inner, definition in made.pop("$defs", {}).items():
            definitions[f"{name}.{inner}"] = element = _object(definition)
            definitions[f"{name}.{inner}{_NAMED}"] = _named_element(element)
        table = _object(made)
        table["title"] = type_
        table["description"] = record.component.summary
        table["properties"] = {"type": {"const": type_}, **table["properties"]}
        definitions[name] = table
        is_default = DEFAULT_TYPES.get(kind) == type_
        rules.append(
            {
                "if": {
                    "properties": {"type": {"const": type_}, "like": False, "for": False},
                    "required": [] if is_default else ["type"],
                },
                "then": {"$ref": f"#/$defs/{name}"},
            }
        )
        rules.append(
            {
                "if": {
                    "properties": {"type": {"const": type_}},
                    "required": ["for"] if is_default else ["type", "for"],
                },
                "then": {"propertyNames": {"enum": ["like", "for", *table["properties"]]}},
            }
        )
    table_schema: dict[str, Any] = {
        "type": "object",
        "properties": {
            "type": {"enum": [record.component.type for record in records]},
            "like": {
                "type": "string",
                "pattern": f"^{TABLE_NAME}$|{_PATTERN_NAME}",
                "description": f"the {kind} table that this one begins as a copy of",
            },
            "for": _FOR,
        },
    }
    if rules:
        table_schema["allOf"] = rules
    return {
        "type": "object",
        "patternProperties": {
            f"^{TABLE_NAME}$": table_schema,
            _PATTERN_NAME: {**table_schema, "required": ["for"]},
        },
        "additionalProperties": False,
    }


def _object(schema: dict[str, Any], *, named: bool = True) -> dict[str, Any]:
    """Replace every quantity of a Spec's schema by one key per unit, of which one is allowed.

    With `named`, an array of tables may be a table of named elements: in the tables of components,
    but not at the head of a mission.
    """
    properties: dict[str, Any] = {}
    required: list[str] = []
    rules: list[dict[str, Any]] = []
    for key, declared in schema.get("properties", {}).items():
        declared = _without_null(declared)
        dimension = declared.pop("x-dimension", None)
        bounds = declared.pop("x-bounds", {})
        is_required = key in schema.get("required", [])
        if dimension is None:
            bounded = _with_bounds(declared, bounds, 1.0)
            properties[key] = _or_named(bounded) if named else bounded
            if is_required:
                required.append(key)
            continue
        keys = unit_keys(key, dimension)
        for (alternative, factor), suffix in zip(keys.items(), UNITS[dimension], strict=True):
            one = _with_bounds(declared, bounds, factor)
            one.pop("title", None)
            if factor != 1.0:
                one.pop("default", None)
            one["description"] = f"{declared.get('description', key)} [{unit_text(suffix)}]"
            properties[alternative] = one
        choices: list[dict[str, Any]] = [{"required": [alternative]} for alternative in keys]
        if not is_required:
            choices.append({"not": {"anyOf": list(choices)}})
        rules.append({"oneOf": choices})
    made = {**schema, "properties": properties, "required": required}
    if rules:
        made["allOf"] = rules
    return made


def _named_element(element: Mapping[str, Any]) -> dict[str, Any]:
    """Return the schema of a named element, which may lack keys that it has from another one."""
    like = {"type": "string", "description": "the element that this one begins as a copy of"}
    kept = {key: element[key] for key in ("title", "description") if key in element}
    return {
        **kept,
        "type": "object",
        "properties": {"like": like, **element["properties"]},
        "additionalProperties": False,
    }


def _or_named(schema: dict[str, Any]) -> dict[str, Any]:
    """Allow a table of named elements in place of an array of tables."""
    item = schema.get("items", {}).get("$ref") if schema.get("type") == "array" else None
    if item is None:
        return schema
    outside = ("description", "title", "default")
    array = {key: value for key, value in schema.items() if key not in outside}
    elements = {
        "type": "object",
        "additionalProperties": {"anyOf": [{"const": False}, {"$ref": item + _NAMED}]},
    }
    around = {key: schema[key] for key in outside if key in schema}
    return {**around, "anyOf": [array, elements]}


def _without_null(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Remove the alternative null from a schema, since TOML has no null."""
    made = dict(schema)
    if made.get("default", 0) is None:
        del made["default"]
    if "anyOf" in made:
        some = [choice for choice in made["anyOf"] if choice.get("type") != "null"]
        if len(some) == 1:
            del made["anyOf"]
            made = {**some[0], **made}
        else:
            made["anyOf"] = some
    return made


def _with_bounds(schema: Mapping[str, Any], bounds: Mapping[str, float], factor: float) -> Any:
    """Copy a schema and add bounds, given in SI, to every number in it."""
    made: dict[str, Any] = {}
    for key, value in schema.items():
        if key in ("items", "additionalProperties") and isinstance(value, dict):
            made[key] = _with_bounds(value, bounds, factor)
        elif key in ("prefixItems", "anyOf", "oneOf"):
            made[key] = [_with_bounds(item, bounds, factor) for item in value]
        else:
            made[key] = value
    if made.get("type") in ("number", "integer"):
        for name, limit in bounds.items():
            made[_JSON_BOUNDS[name]] = limit if factor == 1.0 else limit / factor
    return made
