"""What keeps the structure from growing back: rooms, imports, names, constants, shares.

The checks read source files; none imports what it judges. A failure names the places and says what
to do about them.
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


@cache
def import_graph() -> dict[str, set[str]]:
    """Return the modules that each module imports."""
    known = modules()
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
    assert len(rooms) <= ROOMS, (
        f"the core has {len(rooms)} packages, at most {ROOMS} are allowed: put the new modules "
        f"into one of {sorted(rooms)}"
    )
    loose = [path for path in CORE.glob("*.py") if not path.name.startswith("__")]
    assert [path.name for path in loose if not is_face(path)] == [], (
        "move the code of these modules into a package of the core; a module beside the packages "
        "only imports names and lists them in `__all__`"
    )


def test_no_import_circle() -> None:
    assert circles(import_graph()) == [], (
        "these modules import each other, directly or through others: move what they share to a "
        "module below both, usually a type to `interfaces` or `base`"
    )


def test_a_circle_is_seen() -> None:
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [["b", "c"]]


def test_plugins_import_only_the_core_and_themselves() -> None:
    wrong = [
        f"{name} imports {target}"
        for name, targets in import_graph().items()
        for target in targets
        if target.partition(".")[0] not in ("hillsphere", name.partition(".")[0])
    ]
    assert wrong == [], (
        "a plugin imports the core and itself only: move what both plugins need to the core, as an "
        "interface if one plugin implements it"
    )


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
    graph = import_graph()
    assert unused_by_two(graph, named_in_core()) == [], (
        "move each of these core modules to the one plugin that uses it, or delete it"
    )
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


# --- constants


def is_numeric(value: ast.expr) -> bool:
    """Return whether an expression is made of numbers alone."""
    match value:
        case ast.Constant():
            return isinstance(value.value, int | float | complex) and value.value not in (
                True,
                False,
            )
        case ast.UnaryOp():
            return is_numeric(value.operand)
        case ast.BinOp():
            return is_numeric(value.left) and is_numeric(value.right)
        case ast.Tuple() | ast.List():
            return bool(value.elts) and all(map(is_numeric, value.elts))
    return False


def unexplained(text: str) -> list[str]:
    """Return the numeric constants of a module that no comment and no docstring explains.

    A word explains a constant beside it, in the line above, or in the string below it; a string
    below several constants in a row explains all of them.
    """
    lines, body = text.split("\n"), ast.parse(text).body
    missing: list[str] = []
    row: list[str] = []
    for node in body:
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            row = []
            continue
        if not (
            isinstance(node, ast.Assign | ast.AnnAssign) and node.value and is_numeric(node.value)
        ):
            missing += row
            row = []
            continue
        beside = lines[node.lineno - 2 : node.lineno - 1] if node.lineno > 1 else []
        explained = any(line.lstrip().startswith("#") for line in beside)
        explained |= any("#" in line for line in lines[node.lineno - 1 : node.end_lineno])
        if not explained:
            named = node.targets[0] if isinstance(node, ast.Assign) else node.target
            row.append(ast.unparse(named))
    return missing + row


def test_every_numeric_constant_says_why() -> None:
    found = {
        str(path.relative_to(ROOT)): missing
        for path in modules().values()
        if (missing := unexplained(path.read_text("utf-8")))
    }
    assert found == {}, (
        "say why each of these constants has its value: a comment beside or above it, or a string "
        "below it"
    )


def test_an_unexplained_constant_is_seen() -> None:
    text = 'A = 1.0\n"""Why."""\nB = 2 * 3  # why\n# why\nC = (1, 2)\n\nD = -5\n'
    assert unexplained(text) == ["D"]


# --- names

PAST = frozenset(
    {
        *("told", "kept", "seen", "made", "given", "taken", "found", "held", "drawn", "shown"),
        *("known", "written", "left", "sent", "flown", "swept", "built", "chosen", "thrown"),
        *("hidden", "driven", "gone", "grown", "met", "lost", "come", "begun", "worn"),
    }
)
"""Irregular past forms with which no function's name begins."""
VERBS_IN_ED = frozenset({"need", "seed", "feed", "speed", "proceed", "exceed", "embed"})
PREPOSITIONS = frozenset(
    {
        *("to", "by", "of", "at", "in", "on", "out", "as", "for", "from", "with", "up", "along"),
        *("it", "all", "about", "between", "over", "that", "so", "there", "alike", "anew"),
    }
)
DECLARED = frozenset({"repeated"})
"""Public names of the interface that mission authors' Specs use: they declare a field."""


def misnamed(text: str) -> list[str]:
    """Return functions of a module whose names are bare participles.

    Before a noun a participle is an adjective (``bracketed_roots``); alone or before a preposition
    it says neither what the function does nor what it returns.
    """
    wrong = []
    for node in ast.parse(text).body:
        if isinstance(node, ast.FunctionDef) and node.name not in DECLARED:
            first, *rest = node.name.lstrip("_").split("_")
            past = first in PAST or (first.endswith("ed") and first not in VERBS_IN_ED)
            if past and (not rest or rest[0] in PREPOSITIONS):
                wrong.append(node.name)
    return wrong


def test_functions_begin_with_a_verb_or_are_a_noun() -> None:
    found = {
        str(path.relative_to(ROOT)): names
        for path in modules().values()
        if (names := misnamed(path.read_text("utf-8")))
    }
    assert found == {}, (
        "rename these functions: begin with a verb (`fit_polynomial`, `is_converged`), or take the "
        "noun of what is returned (`hinf_norm`)"
    )


def test_a_participle_is_seen() -> None:
    names = ("told", "_linked_to", "bracketed_roots", "seed_of", "hinf_norm", "_rested")
    text = "".join(f"def {name}(): ...\n" for name in names)
    assert misnamed(text) == ["told", "_linked_to", "_rested"]


# --- stages


def stage_modules() -> dict[str, str]:
    """Return the module of every built-in stage by its type."""
    pattern = re.compile(r'"stage",\s*"(\w+)",\s*"(hillsphere[\w.]+):')
    texts = [path.read_text("utf-8") for name, path in modules().items() if name.count(".") <= 2]
    return {type_: module for text in texts for type_, module in pattern.findall(text)}


def test_a_stage_bears_the_name_of_its_type() -> None:
    stages = stage_modules()
    assert len(stages) >= 38, (
        f"only {len(stages)} of 38 stages are seen: register each as "
        '`Component("stage", "TYPE", "MODULE:CLASS", …)` in the `__init__` of its plugin'
    )
    assert {t: m for t, m in stages.items() if t not in m.split(".")} == {}, (
        "rename each module, or the folder that holds it, to the type of its stage"
    )


SHOWING = re.compile(r"presentation|figures|tables|verdict")


def share_of_presentation(folder: Path) -> float:
    """Return the lines of a plugin that show results, as a share of all its lines."""
    lines = {path: len(path.read_text("utf-8").split("\n")) for path in folder.rglob("*.py")}
    return sum(n for p, n in lines.items() if SHOWING.search(p.stem)) / sum(lines.values())


def test_presentation_is_at_most_a_third_of_a_plugin() -> None:
    folders = (ROOT / "plugins").iterdir()
    shares = {folder.name: share_of_presentation(folder) for folder in folders}
    assert {name: share for name, share in shares.items() if share > 1 / 3} == {}, (
        "shorten what shows results in these plugins: declare labels and digits with the fields of "
        "the product, and build tables with `hillsphere.show.tables`"
    )


# --- figures


def drawing_imports(tree: ast.Module) -> list[str]:
    """Return the drawing libraries that a module imports."""
    names = [
        alias.name if isinstance(node, ast.Import) else str(node.module)
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    ]
    return sorted({name for name in names if name.split(".")[0] in ("matplotlib", "plotly")})


def test_no_plugin_draws() -> None:
    found = {
        str(path.relative_to(ROOT)): names
        for path in (ROOT / "plugins").rglob("*.py")
        if (names := drawing_imports(tree_of(path)))
    }
    assert found == {}, "declare these figures as data, `hillsphere.presentation.Chart`"


def test_an_import_for_drawing_is_seen() -> None:
    text = "def draw():\n    from matplotlib.ticker import LogLocator\n    import plotly\n"
    assert drawing_imports(ast.parse(text)) == ["matplotlib.ticker", "plotly"]
