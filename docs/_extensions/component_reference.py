"""Pages of the keys of every component, from the Specs that also give the JSON Schema.

Before the sources are read, ``reference/keys`` is written anew: a page per kind, a page per type,
and one for the head of a mission file. Each key is an object ``kind.type.key`` of the domain
``std``, so that the search finds it and ``:key:`` links to it.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

from docutils import nodes
from generated_pages import escape, escape_bars, heading, with_code, write_pages
from pydantic.fields import FieldInfo
from sphinx.addnodes import desc_name, desc_signature
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

from hillsphere.base.ranges import LARGEST
from hillsphere.mission.tables import Head
from hillsphere.mission.toml_text import settings_of, toml_text
from hillsphere.plugins.registry import DEFAULT_TYPES, KINDS, Registered, default_registry
from hillsphere.spec.annotations import describe_annotation, inner
from hillsphere.spec.base import Spec
from hillsphere.spec.fields import DataPath
from hillsphere.spec.units import UNITS, unit_text

__all__ = ["setup"]

KIND_TEXTS = {
    "body": "Bodies, planets and ephemerides.",
    "gravity": "Gravity fields.",
    "shape": "Surfaces for contact, sight and sites.",
    "plant": "Equations of motion.",
    "orbit_family": "Families of periodic orbits that the stages of orbits continue.",
    "guidance": "Generators of reference trajectories.",
    "compensator": "Control laws.",
    "estimator": "Filters.",
    "sensor": "Measurements and their errors.",
    "tracker": "Predictions of a satellite's direction from what an antenna measured.",
    "dispersions": "Uncertain quantities of a campaign.",
    "stage": "Analyses: each takes components and earlier results, and returns one result.",
    "requirement": "What a run must show.",
    "claim": "Statements of a publication that a run examines.",
    "executor": "Where the cases of a campaign are computed; the option `--executor` names one.",
    "format": "Files that `hillsphere convert` reads and writes; they have no keys.",
}
"""Kind → one sentence for the lists. Commands have no keys: see the page of the command line."""

_SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}


def nested_specs(annotation: Any) -> Iterator[type[Spec]]:
    """Yield the Specs within an annotation."""
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        yield annotation
    for argument in get_args(annotation):
        yield from nested_specs(argument)


def describe_type(spec: type[Spec], name: str) -> str:
    """Return what kind of value a key takes."""
    field = spec.model_fields[name]
    extra = spec.schema_extra(name)
    if kind := extra.get("x-kind"):
        many = "an array of names" if "tuple" in str(field.annotation) else "the name"
        link = f"a table :doc:`[{kind}.NAME] </reference/keys/{kind}>`"
        tables = "an earlier stage" if kind == "stage" else link
        product = str(extra.get("x-product", "")).rpartition(":")[2]
        return f"{many} of {tables}" + (f" that gives a ``{product}``" if product else "")
    if extra.get("x-path") or inner(field.annotation) is DataPath:
        return "the path of a file"
    if extra.get("x-table"):
        return "the name of a table with its kind, such as ``gravity.phobos``"
    return escape(describe_annotation(field.annotation))


def describe_bounds(spec: type[Spec], name: str) -> str:
    """Return the bounds of a key, SI, without those that the dimension alone has."""
    extra = spec.schema_extra(name)
    dimension = extra.get("x-dimension")
    unit = unit_text(next(iter(UNITS[dimension]))) if dimension else ""
    largest = LARGEST.get(dimension or "", None)
    parts = [
        f"{_SIGNS[test]} {limit:g} {unit}".rstrip()
        for test, limit in extra.get("x-bounds", {}).items()
        if largest is None or abs(limit) != largest
    ]
    for one in spec.model_fields[name].metadata:
        for attribute, words in (("min_length", "at least"), ("max_length", "at most")):
            number = getattr(one, attribute, None)
            if number is not None:
                is_text = inner(spec.model_fields[name].annotation) is str
                what = "character" if is_text else "item"
                parts.append(f"{words} {number} {what}{'' if number == 1 else 's'}")
        if pattern := getattr(one, "pattern", None):
            parts.append(f"of the form ``{pattern}``")
    return ", ".join(part if part.startswith("of the form") else escape(part) for part in parts)


def describe_default(spec: type[Spec], name: str) -> str:
    """Return ``"Required."``, ``"Optional."`` or the default with its unit."""
    field: FieldInfo = spec.model_fields[name]
    if field.is_required():
        return "Required."
    default = field.get_default(call_default_factory=True)
    if default is None or isinstance(default, Spec) or default in ((), {}, ""):
        return "Optional."
    if any(isinstance(item, Spec) for item in default) if isinstance(default, tuple) else False:
        return "Optional."
    (text,) = settings_of({"x": default})
    dimension = spec.schema_extra(name).get("x-dimension")
    unit = f" {unit_text(next(iter(UNITS[dimension])))}" if dimension else ""
    return f"Default ``{text.removeprefix('x=')}``{unit}."


def describe_key(spec: type[Spec], name: str, where: str) -> list[str]:
    """Return the lines of one key: meaning, type, bounds, default, units."""
    description = spec.model_fields[name].description or ""
    meaning = escape(description[:1].upper() + description[1:]).rstrip(".")
    kind = describe_type(spec, name)
    facts = ", ".join(part for part in (kind, describe_bounds(spec, name)) if part)
    lines = [f".. key:: {where}.{name}", "", f"   {meaning}.", ""]
    lines += [f"   {facts[:1].upper() + facts[1:]}. {describe_default(spec, name)}", ""]
    keys = spec.units_by_field().get(name, {})
    if len(keys) > 1:
        names = ", ".join(f"``{key}``" for key in keys)
        lines += [f"   In other units: {names}; one of them is written.", ""]
    return lines


def describe_spec(spec: type[Spec], where: str, shown: set[type[Spec]]) -> list[str]:
    """Return the lines of the keys of a Spec, then those of the tables within it."""
    lines: list[str] = []
    inside: list[tuple[str, type[Spec]]] = []
    for name, field in spec.model_fields.items():
        lines += describe_key(spec, name, where)
        inside += [(name, one) for one in nested_specs(field.annotation)]
    for name, one in inside:
        if one in shown or not one.model_fields:
            continue
        shown.add(one)
        lines += heading(f"Keys of {name}", "-")
        lines += [*docstring(one), ""]
        lines += describe_spec(one, f"{where}.{name}", shown)
    return lines


def docstring(spec: type[Spec]) -> list[str]:
    """Return the lines of a Spec's own docstring; `name` in it is code."""
    text = inspect.cleandoc(spec.__dict__.get("__doc__") or "")
    return escape_bars(with_code(text).splitlines())


def examples(spec: type[Spec], kind: str, type_: str) -> list[str]:
    """Return the examples of a Spec as a mission writes them."""
    lines: list[str] = []
    for table in spec.__dict__.get("examples", ()):
        keys = table if DEFAULT_TYPES.get(kind) == type_ else {"type": type_, **table}
        text = toml_text({kind: {"example": keys}})
        lines += [".. code-block:: toml", "", *(f"   {line}" for line in text.splitlines()), ""]
    return lines


def type_page(record: Registered) -> list[str]:
    """Return the page of one component."""
    kind, type_ = record.component.kind, record.component.type
    spec = record.load_spec()
    summary = record.component.summary
    lines = heading(type_, "=")
    lines += [f'``[{kind}.NAME]``, ``type = "{type_}"``: {escape(summary)}.', ""]
    text = docstring(spec)
    if text and text[0].rstrip(".").lower() == escape(record.component.summary).lower():
        text = text[1:]  # the summary has told it
    lines += [*text, ""]
    if produces := str(getattr(spec, "produces", "")):
        lines += [f"It returns a ``{produces.rpartition(':')[2]}``.", ""]
    if spec.model_fields:
        lines += heading("Keys", "-")
        lines += describe_spec(spec, f"{kind}.{type_}", {spec})
    if shown := examples(spec, kind, type_):
        lines += [*heading("Examples", "-"), *shown]
    origin = record.component.target.partition(":")[0]
    lines += [f"The component is in the module ``{origin}``."]
    return lines


def sentence(record: Registered) -> str:
    """Return the summary of a component as a sentence."""
    text = escape(record.component.summary)
    return f"{text[:1].upper()}{text[1:]}."


def head_page() -> list[str]:
    """Return the page of the keys above the tables of a mission."""
    lines = heading("Head of a mission", "=")
    lines += [
        "Keys above the tables, and the table ``[report]``. The key ``format`` is always 1.",
        "",
    ]
    lines += describe_spec(Head, "mission", {Head})
    return lines


def kind_page(kind: str, records: Iterable[Registered]) -> list[str]:
    """Return the page that lists the types of a kind."""
    lines = [*heading(kind, "="), with_code(KIND_TEXTS[kind]), ""]
    for record in records:
        type_ = record.component.type
        lines += [f":doc:`{type_} <{kind}/{type_}>`", f"   {sentence(record)}", ""]
    lines += [".. toctree::", "   :hidden:", ""]
    lines += [f"   {kind}/{record.component.type}" for record in records]
    return lines


def units_page() -> list[str]:
    """Return the page of dimensions, unit suffixes and largest magnitudes."""
    lines = heading("Units", "=")
    lines += [
        "A quantity is named by its SI unit and may be written in any unit of its dimension: the",
        "suffix of the key tells which. A value beyond the largest magnitude is refused, because",
        "it is most likely written in a wrong unit; keys with narrower bounds say so.", "",
        ".. list-table::", "   :header-rows: 1", "",
        "   * - dimension", "     - suffixes, the SI unit first", "     - largest magnitude (SI)",
    ]  # fmt: skip
    for dimension, units in UNITS.items():
        lines += [
            f"   * - {dimension.replace('_', ' ')}",
            "     - " + ", ".join(f"``_{suffix}``" for suffix in units),
            f"     - {LARGEST[dimension]:g}",
        ]
    return lines


def pages() -> dict[str, list[str]]:
    """Return path below ``reference/keys`` → lines, for the components of this distribution."""
    by_kind: dict[str, list[Registered]] = {}
    for record in default_registry():
        own = record.distribution.partition(" ")[0] in ("", "hillsphere")  # "": the core's own
        if own and record.component.spec:
            by_kind.setdefault(record.component.kind, []).append(record)
    kinds = [kind for kind in KINDS if kind in by_kind]
    written: dict[str, list[str]] = {"head": head_page(), "units": units_page()}
    index = [*heading("Keys of a mission file", "=")]
    index += [
        "These pages are made from the declarations that also validate missions and make the JSON",
        "Schema (``hillsphere schema``). A key of the search has the form ``kind.type.key``.", "",
        ":doc:`Head of a mission <head>`", "   Name, title, seed and report.", "",
        ":doc:`Units <units>`", "   Suffixes of keys and their factors.", "",
    ]  # fmt: skip
    for kind in kinds:
        records = by_kind[kind]
        types = ", ".join(f":doc:`{r.component.type} <{kind}/{r.component.type}>`" for r in records)
        index += [f":doc:`{kind} <{kind}>`", f"   {with_code(KIND_TEXTS[kind])} {types}", ""]
        written[kind] = kind_page(kind, records)
        for record in records:
            written[f"{kind}/{record.component.type}"] = type_page(record)
    index += [".. toctree::", "   :hidden:", "", *(f"   {p}" for p in ("head", "units", *kinds))]
    written["index"] = index
    return written


def _generate(app: Sphinx) -> None:
    write_pages(Path(app.srcdir) / "reference" / "keys", pages())


def _parse_key(env: BuildEnvironment, text: str, node: desc_signature) -> str:
    """Show the last part of ``kind.type.key`` and keep the whole as the target."""
    shown = text.rpartition(".")[2]
    node += desc_name("", "", nodes.Text(shown))
    return text


def setup(app: Sphinx) -> Mapping[str, Any]:
    """Register the object type and the generator."""
    app.add_object_type("key", "key", "pair: %s; key of a mission", _parse_key)
    app.connect("builder-inited", _generate)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
