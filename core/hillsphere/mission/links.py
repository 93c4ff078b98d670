"""Links between the tables of a mission: references, needs, input files, and order."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import TypeAlias

from hillsphere.base.errors import PluginError
from hillsphere.base.paths import missions_directory
from hillsphere.base.problems import Key, did_you_mean, with_article
from hillsphere.mission.likes import Derived
from hillsphere.mission.tables import MOST_PROBLEMS, Tables
from hillsphere.plugins.registry import OUTCOME_KINDS, Registered
from hillsphere.spec.base import Spec, StageSpec
from hillsphere.spec.result_names import is_named, nearest_name

__all__ = ["Node", "check_links", "check_report", "links_of", "resolve_data_paths", "topological"]

Node: TypeAlias = tuple[str, str]
"""Kind and name of a table."""


def links_of(spec: Spec) -> dict[Node, Key]:
    """Return the tables that a Spec refers to, each with the location of its first reference."""
    links: dict[Node, Key] = {}
    for where, kind, ref in spec.references():
        links.setdefault((kind, ref.name), where)
    return links


def check_links(tables: Tables, layers: Derived) -> None:
    """Add a problem for every reference to a missing or unsuitable table, and for every circle.

    Parameters
    ----------
    tables : Tables
        The validated tables; problems are added to theirs.
    layers : Derived
        Tables with the origin of every value, for messages.
    """
    edges: dict[Node, dict[Node, Key]] = {}
    for kind, name, spec in tables:
        here = edges.setdefault((kind, name), {})
        for where, other_kind, ref in spec.references():
            key = (kind, name, *where)
            if len(tables.problems) > MOST_PROBLEMS:
                return
            names = tables.names.get(other_kind, [])
            if (place := layers.layers.dropped_at(other_kind, ref.name)) is not None:
                if kind in OUTCOME_KINDS:  # it is not evaluated then
                    continue
                message = _dropped_message(kind, other_kind, ref.name, place)
                tables.problems.append(layers.problem(key, message))
            elif ref.name not in names:
                words = other_kind.replace("_", " ")
                hint = did_you_mean(ref.name, names, otherwise="there are")
                hint = hint or f"; write a table [{other_kind}.NAME]"
                message = f"no {words} table is named {ref.name[:60]!r}{hint}"
                tables.problems.append(layers.problem(key, message))
            else:
                here.setdefault((other_kind, ref.name), key)
        for where, table in spec.table_names():
            other_kind, _, other = table.partition(".")
            if (place := layers.layers.dropped_at(other_kind, other)) is not None:
                message = _dropped_message(kind, other_kind, other, place)
                tables.problems.append(layers.problem((kind, name, *where), message))
            elif table != "stage" and other not in tables.names.get(other_kind, []):
                names = [f"{k}.{n}" for k, group in tables.names.items() for n in group]
                hint = did_you_mean(table, names, otherwise="there are")
                message = f"no table is named {table[:80]!r}{hint}"
                tables.problems.append(layers.problem((kind, name, *where), message))
        for where, product, ref in spec.needs_of():
            _check_product(product, ref.name, (kind, name, *where), tables, layers)
        for where, message in spec.misfits(tables.specs):
            tables.problems.append(layers.problem((kind, name, *where), message))
    for circle in _circles(edges):
        stages_only = all(kind == "stage" for kind, _ in circle)
        steps = [name if stages_only else f"{kind}.{name}" for kind, name in circle]
        key = edges[circle[0]][circle[1]]
        message = f"goes in a circle: {' → '.join(steps)}"
        tables.problems.append(layers.problem(key, message))


def check_report(tables: Tables, layers: Derived) -> None:
    """Add a problem for every stage, outcome or metric that the report names and is not there.

    Parameters
    ----------
    tables : Tables
        The validated tables; problems are added to theirs.
    layers : Derived
        Tables with the origin of every value, for messages. What a profile drops may be named.
    """
    if tables.head is None:
        return
    for where, kind, name in tables.head.report.names():
        kinds = OUTCOME_KINDS if kind == "outcome" else (kind,)
        names = [other for one in kinds for other in tables.names.get(one, [])]
        if not kind:
            message = f"{name} is no placeholder; write {{requirement.NAME}} or {{STAGE.METRIC}}"
        elif name in names or any(layers.layers.dropped_at(one, name) for one in kinds):
            continue
        else:
            words = "requirement or claim" if kind == "outcome" else f"{kind} table"
            hint = did_you_mean(name, names, otherwise="there are")
            message = f"no {words} is named {name[:60]!r}{hint}"
        tables.problems.append(layers.problem(("report", *where), message))
    for where, stage, metric in tables.head.report.metrics():
        spec = tables.specs.get("stage", {}).get(stage)
        known = spec.result_names() if isinstance(spec, StageSpec) else None
        if known is not None and not is_named(metric, known.metrics):
            hint = nearest_name(metric, known.metrics) if known.metrics else "; it has none"
            message = f"stage {stage!r} has no metric {metric[:60]!r}{hint}"
            tables.problems.append(layers.problem(("report", *where), message))


def _dropped_message(kind: str, other_kind: str, other: str, place: str) -> str:
    """Return the message that a table refers to one that was dropped."""
    words = other_kind.replace("_", " ")
    return f"{words} table {other!r} is dropped at {place}; drop this {kind} too, or change the key"


def _check_product(product: str, name: str, key: Key, tables: Tables, layers: Derived) -> None:
    record = tables.components.get("stage", {}).get(name)
    if record is None:  # no such stage, or of unknown type: said elsewhere
        return
    yields = _yields(record)
    if product in yields:
        return
    fitting = [
        other for other, component in tables.components["stage"].items()
        if product in _yields(component)
    ]  # fmt: skip
    hint = f"; fitting: {', '.join(fitting)}" if fitting else ""
    message = (
        f"needs {with_article(_class_name(product))}, but stage {name!r} yields "
        f"{with_article(_class_name(yields[0])) if yields else 'nothing'}{hint}"
    )
    tables.problems.append(layers.problem(key, message))


def _yields(record: Registered) -> tuple[str, ...]:
    """Return the classes that the product of a stage has, its own class first."""
    try:
        spec = record.load_spec()
    except PluginError:
        return ()
    produces = str(getattr(spec, "produces", ""))
    return (produces, *getattr(spec, "provides", ())) if produces else ()


def _class_name(path: str) -> str:
    return path.rpartition(":")[2]


def _circles(edges: Mapping[Node, Mapping[Node, Key]]) -> list[list[Node]]:
    """Find circles of references by depth-first search; each table is part of at most one."""
    circles: list[list[Node]] = []
    done: set[Node] = set()
    told: set[Node] = set()
    for root in edges:
        if root in done:
            continue
        path: list[Node] = [root]
        place = {root: 0}
        ahead = [iter(edges[root])]
        while path:
            step = next(ahead[-1], None)
            if step is None:
                ahead.pop()
                last = path.pop()
                del place[last]
                done.add(last)
            elif step in place:
                circle = path[place[step] :]
                if told.isdisjoint(circle):
                    told.update(circle)
                    circles.append([*circle, step])
            elif step not in done and step in edges:
                place[step] = len(path)
                path.append(step)
                ahead.append(iter(edges[step]))
    return circles


def topological(nodes: Iterable[Node], specs: Mapping[str, Mapping[str, Spec]]) -> list[Node]:
    """Sort tables topologically: each after those it refers to, otherwise in the given order.

    Parameters
    ----------
    nodes : iterable of (kind, name)
        Tables to begin with; those that they refer to are added.
    specs : mapping
        Kind → name → Spec, free of circles.

    Returns
    -------
    list of (kind, name)
        Every table reached.
    """
    ordered: dict[Node, None] = {}
    for root in nodes:
        stack = [(root, iter(links_of(specs[root[0]][root[1]])))]
        while stack:
            node, ahead = stack[-1]
            step = next((other for other in ahead if other not in ordered), None)
            if step is None:
                ordered[node] = None
                stack.pop()
            else:
                stack.append((step, iter(links_of(specs[step[0]][step[1]]))))
    return list(ordered)


def resolve_data_paths(
    tables: Tables, layers: Derived, directory: str, *, allow_path: bool
) -> None:
    """Replace the paths of input files in Specs by absolute paths.

    Parameters
    ----------
    tables : Tables
        The validated tables; Specs are replaced, problems added.
    layers : Derived
        Tables with the origin of every value, for messages.
    directory : str
        Directory of the mission file. Input files are looked for there, then in the packaged data.
    allow_path : bool
        Accept absolute paths and paths that lead out of these two directories.
    """
    roots = [directory, str(missions_directory() / "data")]
    for kind, name, spec in list(tables):
        resolved: dict[str, str] = {}
        for where, path in spec.data_paths():
            absolute, message = _resolve(path, roots, allow_path=allow_path)
            if message:
                tables.problems.append(layers.problem((kind, name, *where), message))
            else:
                resolved[path] = absolute
        if resolved:
            tables.specs[kind][name] = spec.with_data_paths(resolved)


def _resolve(path: str, roots: list[str], *, allow_path: bool) -> tuple[str, str]:
    """Return (absolute path, "") or ("", message)."""
    text = path if len(path) <= 100 else path[:100] + "…"
    if "\0" in path:
        return "", f"{text!r} is not a path: it holds a null character"
    if os.path.isabs(path) and not allow_path:
        return "", f"{text!r} is an absolute path; allow it with --allow-path"
    outside = False
    for root in roots:
        real_root = os.path.realpath(root)
        real_path = os.path.realpath(os.path.join(root, path))
        inside = os.path.commonpath([real_root, real_path]) == real_root
        if not (inside or allow_path):
            outside = True
        elif os.path.isfile(real_path):
            if not os.access(real_path, os.R_OK):
                return "", f"{text!r} cannot be read: permission denied"
            return real_path, ""
        elif os.path.isdir(real_path):
            return "", f"{text!r} is a directory; an input file is needed"
        elif os.path.exists(real_path):
            return "", f"{text!r} is not a regular file; an input file is needed"
    if outside:
        return "", (
            f"{text!r} leads out of the directories of the mission and of the packaged data; "
            "allow it with --allow-path"
        )
    return "", f"no file {text!r} beside the mission file or in the packaged data"
