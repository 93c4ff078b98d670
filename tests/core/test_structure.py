"""What keeps the structure from growing back: rooms, imports, names, constants, shares.

The checks read source files; none imports what it judges.
"""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
CORE = ROOT / "core" / "hillsphere"
ROOMS = 16
"""Packages of the core at most; more would not be read from the tree."""


@cache
def modules(root: Path = ROOT) -> dict[str, Path]:
    """Return the modules of core and plugins by name."""
    found = {}
    for base in (root / "core", *sorted((root / "plugins").iterdir())):
        for path in base.rglob("*.py"):
            parts = path.relative_to(base).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = path
    return found


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


def imports_of(path: Path, known: dict[str, Path]) -> set[str]:
    """Return the modules that a file imports anywhere, for type checkers too."""
    found = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                found |= {inner} & known.keys() or {node.module} & known.keys()
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names} & known.keys()
    return found


def import_graph(known: dict[str, Path]) -> dict[str, set[str]]:
    return {name: imports_of(path, known) - {name} for name, path in known.items()}


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of modules that import each other: what is left when leaves are taken off.

    A module that imports nothing of the rest, or that nothing of the rest imports, is in no circle.
    """
    left = {name: set(targets) for name, targets in graph.items()}
    while True:
        used = set().union(*left.values()) if left else set()
        leaves = {name for name, targets in left.items() if not targets or name not in used}
        if not leaves:
            return [sorted(left)] if left else []
        left = {n: targets - leaves for n, targets in left.items() if n not in leaves}


def is_face(path: Path) -> bool:
    """Return whether a module only passes on names of others."""
    return all(
        isinstance(node, ast.ImportFrom)
        or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
        or (isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__")
        for node in tree_of(path).body
    )


def test_rooms_of_the_core() -> None:
    rooms = [path.parent.name for path in CORE.glob("*/__init__.py")]
    assert len(rooms) <= ROOMS, rooms
    loose = [path for path in CORE.glob("*.py") if not path.name.startswith("__")]
    assert [path.name for path in loose if not is_face(path)] == []


def test_no_import_circle() -> None:
    assert circles(import_graph(modules())) == []


def test_a_circle_is_seen() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [["b", "c"]]


def test_plugins_import_only_the_core_and_themselves() -> None:
    wrong = [
        f"{name} imports {target}"
        for name, targets in import_graph(modules()).items()
        for target in targets
        if target.partition(".")[0] not in ("hillsphere", name.partition(".")[0])
    ]
    assert wrong == []


RUN_PATH = ("hillsphere.cli", "hillsphere.runs.pipeline", "hillsphere.plugins.builtin")
EXEMPT = ("hillsphere.cli", "hillsphere.testing", "hillsphere.__main__")


def unused_by_two(graph: dict[str, set[str]], named: set[str]) -> list[str]:
    """Return core modules outside the run path that fewer than two plugins import.

    The conformance kit counts as a plugin: its checks are the first use of an interface.
    """
    reached: set[str] = set()
    begin = {name for name in graph if name.startswith(RUN_PATH)} | named
    while begin:
        reached |= begin
        begin = {target for name in begin for target in graph[name]} - reached
    faces = {name for name in graph if name.count(".") == 1 and is_face(modules()[name])}
    users: dict[str, set[str]] = {}
    for name, targets in graph.items():
        kit = name.startswith("hillsphere.testing")
        plugin = "kit" if kit else name.partition(".")[0]
        if plugin != "hillsphere":
            through = set(targets)
            for face in targets & faces:
                through |= graph[face]
            for target in through:
                users.setdefault(target, set()).add(plugin)
    # A module that serves a used module is used as it is.
    wide = {name for name, plugins in users.items() if len(plugins) > 1}
    served: set[str] = set()
    while wide:
        served |= wide
        wide = {t for name in wide for t in graph[name]} - served
    return sorted(
        name
        for name in graph
        if name.startswith("hillsphere.")
        and not name.startswith(EXEMPT)
        and name not in faces
        and name not in reached | served
        and modules()[name].name != "__init__.py"
    )


def named_in_core() -> set[str]:
    """Return the modules that the core names in strings: its components, a process it starts."""
    texts = [path.read_text("utf-8") for path in CORE.rglob("*.py")]
    named = {
        name for text in texts for name in re.findall(r'"(?:from )?(hillsphere[\w.]+)[:" ]', text)
    }
    return named & modules().keys()


def test_core_modules_are_used_by_the_run_path_or_two_plugins() -> None:
    graph = import_graph(modules())
    assert unused_by_two(graph, named_in_core()) == []
    assert "hillsphere.lone" in unused_by_two_with_a_lone_module(graph)


def unused_by_two_with_a_lone_module(graph: dict[str, set[str]]) -> list[str]:
    known = modules()
    known["hillsphere.lone"] = known["hillsphere.base.arrays"]
    try:
        planted = {**graph, "hillsphere.lone": set()}
        planted["hillsphere_orbits.flow"] = graph["hillsphere_orbits.flow"] | {"hillsphere.lone"}
        return unused_by_two(planted, named_in_core())
    finally:
        del known["hillsphere.lone"]
