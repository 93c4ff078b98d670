"""The modules from which third parties import: each public name resolves and is documented."""

from __future__ import annotations

import ast
import re
from importlib import import_module
from itertools import pairwise
from pathlib import Path

import pytest
from tests.core.test_structure import CORE, ROOT, modules, tree_of

FURTHER = ("hillsphere.products.fields", "hillsphere.show.tables")
"""Faces inside a room, whose own packages are faces or have no public names."""


def public_names(tree: ast.Module) -> list[str] | None:
    """Return the literal ``__all__`` of a module, or None if it has none."""
    for node in tree.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return list(ast.literal_eval(node.value))
    return None


def faces() -> list[str]:
    """Return the modules and packages directly in the core that have an ``__all__``."""
    direct = [*CORE.glob("*.py"), *CORE.glob("*/__init__.py")]
    paths = {path: name for name, path in modules().items()}
    return sorted({paths[p] for p in direct if public_names(tree_of(p)) is not None} | {*FURTHER})


def sort_key(name: str) -> tuple[int, str]:
    """Return the order of ``__all__``: constants, then classes, then functions."""
    return 0 if name.isupper() and len(name) > 1 else 1 if name[:1].isupper() else 2, name


def misordered(names: list[str]) -> list[str]:
    """Return the names of an ``__all__`` that stand twice or behind a name they precede."""
    return [b for a, b in pairwise(names) if sort_key(a) >= sort_key(b)]


def statements(body: list[ast.stmt]) -> list[ast.stmt]:
    """Return the statements of a module, with those under its top-level conditions."""
    nested = [s for node in body if isinstance(node, ast.If) for s in statements(node.body)]
    return [*body, *nested]


def is_documented(module: str, name: str) -> bool:
    """Return whether a name has a docstring where it is defined.

    A function or class has its own, not an inherited or generated one; below a constant or an
    alias stands a string, or there is a comment above or beside it. Imports are followed.
    """
    path = modules().get(module)
    if path is None:
        return True  # of another project, which documents it
    lines = path.read_text("utf-8").split("\n")
    body = statements(tree_of(path).body)
    for node, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return is_documented(node.module, alias.name)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef) and node.name == name:
            if "overload" in map(ast.unparse, node.decorator_list):
                continue  # the last definition is the function
            return bool(ast.get_docstring(node))
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if name in map(ast.unparse, targets):
                below = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
                above = lines[node.lineno - 2].lstrip().startswith("#")
                beside = any("#" in line for line in lines[node.lineno - 1 : node.end_lineno])
                return below or above or beside
    return False


def test_faces_are_those_of_the_architecture_page() -> None:
    text = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    sentence = re.search(r"Third parties import from the faces (.*?)\. The", text, re.DOTALL)
    assert sentence
    named = [name.removeprefix("hillsphere.") for name in re.findall(r"`([\w.]+)`", sentence[1])]
    known = {name.removeprefix("hillsphere.") for name in faces()} - {"hillsphere", "cli"}
    assert sorted(named) == sorted(known), "name each face in docs/architecture.md, nothing else"


@pytest.mark.parametrize("face", faces())
def test_public_names_of_a_face(face: str) -> None:
    names = public_names(tree_of(modules()[face]))
    assert names, f"give {face} an `__all__`"
    module = import_module(face)
    assert [n for n in names if not hasattr(module, n)] == [], (
        f"import these names in {face}, or take them out of its `__all__`"
    )
    assert misordered(names) == [], (
        f"in `__all__` of {face} put constants before classes before functions, each sorted, and "
        "take out names that stand twice (`ruff check --select RUF022 --fix`)"
    )
    assert [n for n in names if n != "__version__" and not is_documented(face, n)] == [], (
        "write a docstring where each is defined; below a constant, a string that explains it"
    )
    # A face with names that are loaded late offers them to type checkers under a condition.
    assert {*names} <= {*dir(module), *imported_for_checkers(face), "__version__"}, (
        f"import the names of {face} under `if TYPE_CHECKING:` too"
    )


def imported_for_checkers(face: str) -> set[str]:
    """Return the names that a module imports anywhere, under conditions too."""
    body = statements(tree_of(modules()[face]).body)
    return {alias.asname or alias.name for node in body if isinstance(node, ast.ImportFrom)
            for alias in node.names}  # fmt: skip


def test_an_unordered_face_is_seen() -> None:
    assert misordered(["MAX", "Array", "Belief", "fly"]) == []
    assert misordered(["Array", "MAX", "fly", "fly", "draw"]) == ["MAX", "fly", "draw"]


def test_a_name_without_a_docstring_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planted = tmp_path / "planted.py"
    planted.write_text(
        "from hillsphere.errors import InputError as Fault\nA = 1\n'Why.'\nB = 2\n\nC = 3  # why\n"
        "class D(Fault): ...\ndef e():\n    'Do it.'\n",
        encoding="utf-8",
    )
    monkeypatch.setitem(modules(), "hillsphere.planted", planted)
    names = ["Fault", "A", "B", "C", "D", "e", "f"]
    assert [n for n in names if not is_documented("hillsphere.planted", n)] == ["B", "D", "f"]
