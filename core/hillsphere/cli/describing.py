"""``hillsphere describe``: kinds, types and keys of the installed components."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import Any

from hillsphere.base.errors import InputError, PluginError
from hillsphere.base.problems import did_you_mean, with_article
from hillsphere.cli.output import write, write_json, write_table
from hillsphere.cli.spec_description import (
    KeyDescription,
    describe_keys,
    format_example,
    toml_value,
)
from hillsphere.plugins.registry import KINDS, Registered, Registry
from hillsphere.spec.base import Spec, StageSpec
from hillsphere.spec.units import unit_text

__all__ = ["KIND_MEANINGS", "describe_component", "describe_kind", "describe_kinds"]

KIND_MEANINGS: Mapping[str, str] = {
    "body": "a moon, planet or asteroid: its orbit and its rotation",
    "gravity": "the gravity field of a body",
    "shape": "the surface of a body",
    "plant": "equations of motion",
    "orbit_family": "a family of periodic orbits that can be followed",
    "guidance": "a planner of reference trajectories, with their command",
    "compensator": "a control law",
    "estimator": "a navigation filter",
    "sensor": "a measurement with its noise",
    "tracker": "a prediction of a satellite by which an antenna is pointed",
    "dispersions": "what is uncertain, and its distribution",
    "stage": "a step of the mission: it computes a product and presents it",
    "requirement": "a value that a result must keep, for the verdict",
    "claim": "a statement of a publication that is examined",
    "executor": "how work is divided between processes (run --executor)",
    "format": "a file format (convert --from, --to)",
    "command": "a command of a plugin",
}
"""What a component of each kind is, in one line."""
_WIDTH = 100
"""Width of wrapped text, in columns."""


def describe_kinds(registry: Registry, json: bool) -> None:
    """List the kinds of components with their meaning and the number of installed types."""
    counts = {kind: len(list(registry.of_kind(kind))) for kind in KINDS}
    if json:
        write_json(
            [
                {"kind": kind, "types": counts[kind], "meaning": KIND_MEANINGS[kind]}
                for kind in KINDS
            ]
        )
        return
    write_table(
        [(kind, str(counts[kind]), KIND_MEANINGS[kind]) for kind in KINDS],
        header=("kind", "types", "meaning"),
    )
    write("\nhillsphere describe KIND lists the types of a kind")


def describe_kind(registry: Registry, kind: str, json: bool) -> None:
    """List the types of a kind with their summaries.

    Raises
    ------
    InputError
        If there is no such kind; the message gives the nearest one, or the kind of the type that
        was named alone.
    """
    _check_kind(registry, kind)
    records = list(registry.of_kind(kind))
    if json:
        write_json(
            {
                "kind": kind,
                "meaning": KIND_MEANINGS[kind],
                "types": [
                    {"type": r.component.type, "plugin": r.plugin, "summary": r.component.summary}
                    for r in records
                ],
            }
        )
        return
    write(f"{kind}: {KIND_MEANINGS[kind]}\n")
    if not records:
        write(f"no installed plugin offers {with_article(kind)}")
        return
    write_table([(f"  {r.component.type}", r.component.summary) for r in records])
    write(f"\nhillsphere describe {kind} TYPE describes the keys of a type")


def describe_component(registry: Registry, kind: str, type_: str, json: bool) -> None:
    """Describe the keys of a component, with a worked example.

    Raises
    ------
    InputError
        If there is no such kind or type; the message gives the nearest one.
    PluginError
        If several plugins offer it, or its Spec cannot be imported. If there is no such
        class, after the description: its keys are known all the same.
    """
    _check_kind(registry, kind)
    record = registry.get(kind, type_)
    _describe(record, json)
    if fault := record.missing():
        raise PluginError(fault)


def _describe(record: Registered, json: bool) -> None:
    kind, type_ = record.component.kind, record.component.type
    component = record.component
    if kind == "format":
        usage = f"hillsphere convert IN OUT --from {type_}, or --to {type_}"
        if json:
            write_json({**_head(record), "usage": usage})
        else:
            write(f"file format {type_}: {component.summary}\nplugin {record.plugin}; see {usage}")
        return
    if kind == "command":
        usage = f"hillsphere {type_} --help"
        if json:
            write_json({**_head(record), "usage": usage})
        else:
            write(f"command {type_}: {component.summary}\nplugin {record.plugin}; see {usage}")
        return
    spec = record.load_spec()
    keys = describe_keys(spec)
    if json:
        product = getattr(spec, "produces", "")
        write_json(
            {
                **_head(record),
                **({"product": product} if product else {}),
                **_results_record(spec),
                "keys": [_key_record(key) for key in keys],
                "examples": list(spec.examples),
            }
        )
        return
    write(f"{kind} {type_}: {component.summary}")
    write(f"plugin {record.plugin}")
    if meaning := (spec.__doc__ or "").strip():
        write("\n" + "\n".join(_wrap(" ".join(meaning.split()), "")))
    write("\nKeys" + (", bounds in SI units" if any(key.units for key in keys) else ""))
    for key in keys:
        write("")
        _write_key(key)
    if issubclass(spec, StageSpec):
        _write_results(spec)
    if spec.examples:
        write("\nExample\n")
        example = spec.examples[0]
        text = (
            f"executor={dict(type=type_, **example)!r}"
            if kind == "executor"  # no table of a mission: an argument of run_mission
            else format_example(kind, type_, example)
        )
        write(textwrap.indent(text, "  "))


def _check_kind(registry: Registry, kind: str) -> None:
    if kind in KINDS:
        return
    owners = [r.component.kind for r in registry if r.component.type == kind]
    if owners:
        choices = " or ".join(f"hillsphere describe {owner} {kind}" for owner in owners)
        raise InputError(f"{kind!r} is a type, no kind; use {choices}")
    raise InputError(f"no kind {kind[:60]!r}{did_you_mean(kind, KINDS, otherwise='kinds')}")


def _head(record: Registered) -> dict[str, Any]:
    component = record.component
    return {
        "kind": component.kind,
        "type": component.type,
        "plugin": record.plugin,
        "summary": component.summary,
    }


def _key_record(key: KeyDescription) -> dict[str, Any]:
    return {
        "key": key.key,
        "value": key.value,
        "units": list(key.units),
        "bounds": key.bounds,
        "required": key.is_required,
        "default": key.default,
        "meaning": key.meaning,
        "example": key.example,
    }


def _write_key(key: KeyDescription) -> None:
    others = key.units[1:]
    units = f"  (or …_{', …_'.join(others)})" if others else ""
    write(f"  {key.key}{units}")
    value = f"{key.value}, {key.bounds}" if key.bounds else key.value
    if key.is_required:
        need = "required"
    elif key.default is None or key.default == "":
        need = "optional"
    else:
        # Without numbers, as in [], a unit would say nothing.
        unit = f" {unit_text(key.units[0])}" if key.units and key.default != () else ""
        need = f"default {toml_value(key.default)}{unit}"
    for line in (*_wrap(f"{value}; {need}", "      "), *_wrap(key.meaning, "      ")):
        write(line)
    if key.example:
        write(f"      example: {key.example}")


def _results_record(spec: type[Spec]) -> dict[str, Any]:
    """Return what a stage presents; empty for other kinds and for stages that do not say."""
    if not issubclass(spec, StageSpec) or spec.results is None:
        return {}
    tables = {name: list(columns) for name, columns in spec.results.tables.items()}
    return {"metrics": list(spec.results.metrics), "tables": tables}


def _write_results(spec: type[StageSpec]) -> None:
    names = spec.results
    if names is None:
        write("\nResults\n")
        write("  The names of its metrics and tables are known only after a run.")
        return
    ending = ", each with _LABEL at its end if the key label is given"
    write("\nResults" + (ending if "label" in spec.model_fields else ""))
    any_name = [*names.metrics, *names.tables]
    if any("*" in name for name in any_name):
        write("  * stands for names that depend on the mission; validate cannot check these")
    write("")
    for line in _wrap(f"metrics: {', '.join(names.metrics) or 'none'}", "  "):
        write(line)
    for table, columns in names.tables.items():
        told = ", ".join(columns) if columns else "columns known only after a run"
        for line in _wrap(f"table {table}: {told}", "  "):
            write(line)


def _wrap(text: str, indent: str) -> list[str]:
    return textwrap.wrap(
        text, _WIDTH, initial_indent=indent, subsequent_indent=indent,
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip
