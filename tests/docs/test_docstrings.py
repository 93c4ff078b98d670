"""Docstrings of the public names are complete: parameters, what is returned, errors, shapes."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import FunctionType
from typing import Any

import pytest

from hillsphere.errors import InputError
from hillsphere.interfaces import Array

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs" / "_extensions"))
from public_modules import MODULES  # type: ignore[import-not-found]  # noqa: E402

NAMES = [name for names in MODULES.values() for name in names]
SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
ENTRY = re.compile(r"^(\*{0,2}[\w., *]+?)(?: : (.*))?$")
FIELD = re.compile(r'^    (\w+): [^\n]*\n    """(.*?)"""', re.MULTILINE | re.DOTALL)
"""A field of a class with the string below it."""
ARRAYS = re.compile(r"\b(Array|NDArray|Integers)\b")


def sections(text: str) -> dict[str, str]:
    """Return the sections of a docstring in the style of numpydoc, by heading."""
    parts = SECTION.split(inspect.cleandoc(text))
    return {"": parts[0].strip(), **dict(zip(parts[1::2], parts[2::2], strict=True))}


def entries(section: str) -> dict[str, tuple[str, str]]:
    """Return name → (type, text) of a section of parameters; "a, b : int" gives two names."""
    found: dict[str, tuple[str, str]] = {}
    names: list[str] = []
    for line in section.splitlines():
        if line and not line.startswith(" ") and (match := ENTRY.match(line)):
            names = [name.strip().lstrip("*") for name in match[1].split(",")]
            found |= dict.fromkeys(names, (match[2] or "", ""))
        elif line.strip():
            found |= {n: (found[n][0], f"{found[n][1]} {line.strip()}") for n in names}
    return found


def raised(function: FunctionType) -> set[str]:
    """Return the errors of the framework that the body of a function raises itself."""
    tree = ast.parse(inspect.cleandoc("\n" + inspect.getsource(function)))
    calls = [n.exc for n in ast.walk(tree) if isinstance(n, ast.Raise) and n.exc is not None]
    names = {ast.unparse(c.func if isinstance(c, ast.Call) else c) for c in calls}
    return {name for name in names if name.endswith("Error") and name != "AttributeError"}


def parameter_faults(
    wanted: dict[str, Any], documented: dict[str, tuple[str, str]]
) -> Iterator[str]:
    """Tell which parameters are missing, unknown, or arrays without a shape."""
    for name, annotation in wanted.items():
        if name not in documented:
            yield f"parameter {name} is not documented"
        elif not documented[name][1]:
            yield f"parameter {name} has no text"
        elif ARRAYS.search(str(annotation)) and not re.search(
            r"[Ss]hape|\(.*\)|\bany\b|array_like|system",
            f"{annotation} {' '.join(documented[name])}",
        ):
            yield f"array {name} has no shape"
    for name in documented.keys() - wanted.keys():
        yield f"{name} is documented and is no parameter"


def parameters_of(function: Any) -> dict[str, Any]:
    """Return the parameters that a caller gives, with their annotations."""
    given = inspect.signature(function).parameters.values()
    return {p.name: p.annotation for p in given if p.name not in ("self", "cls")}


def function_faults(function: FunctionType) -> Iterator[str]:
    """Tell what the docstring of a function lacks."""
    found = sections(function.__doc__ or "")
    if not found[""]:
        yield "has no docstring"
        return
    yield from parameter_faults(parameters_of(function), entries(found.get("Parameters", "")))
    returns = str(inspect.signature(function).return_annotation)
    if returns not in ("None", "NoReturn") and not {"Returns", "Yields"} & found.keys():
        yield "does not say what it returns"
    told = found.get("Raises", "")
    yield from (f"does not tell of {name}" for name in raised(function) if name not in told)


def class_faults(cls: type) -> Iterator[str]:
    """Tell what the docstring of a class lacks about its construction, or a method about itself."""
    found = sections(cls.__doc__ or "")
    if not found[""]:
        yield "has no docstring"
        return
    if not (getattr(cls, "_is_protocol", False) or issubclass(cls, BaseException)):
        documented = entries(found.get("Parameters", ""))
        if dataclasses.is_dataclass(cls):
            documented |= entries(found.get("Attributes", ""))
            source = inspect.getsource(cls)
            # a string below a field documents it where it is declared
            documented |= {name: ("", text) for name, text in FIELD.findall(source)}
            wanted = {f.name: f.type for f in dataclasses.fields(cls)
                      if f.init and not f.name.startswith("_")}  # fmt: skip
        elif "__init__" in vars(cls):
            wanted = parameters_of(cls.__init__)
        else:
            wanted = dict.fromkeys(documented, "")
        yield from parameter_faults(wanted, documented)
    for name, value in vars(cls).items():
        if name.startswith("_"):
            continue
        plain = getattr(value, "fget", None) or getattr(value, "func", None) or value
        plain = getattr(plain, "__func__", plain)
        if inspect.isfunction(plain) and not inspect.getdoc(getattr(cls, name, plain)):
            yield f"{name} has no docstring"


def faults_of(name: str) -> dict[str, list[str]]:
    """Return the faults of the public names that a module defines, by name."""
    module = import_module(name)
    found: dict[str, list[str]] = {}
    for one in module.__all__:
        value = getattr(module, one)
        is_ours = str(getattr(value, "__module__", "")).startswith("hillsphere")
        if not is_ours or one == "hillsphere_components":  # a hook, which its declaration describes
            continue
        if inspect.isclass(value):
            told = list(class_faults(value))
        elif inspect.isfunction(value):
            told = list(function_faults(value))
        else:
            continue
        if told:
            found[one] = told
    return found


@pytest.mark.parametrize("name", NAMES)
def test_docstrings_of_public_names_are_complete(name: str) -> None:
    assert faults_of(name) == {}


def test_what_a_docstring_lacks_is_seen() -> None:
    def norm(x: Array, power: float) -> Array:
        """Return the norm.

        Parameters
        ----------
        x : ndarray
            The vector.
        other : float
            Nothing.
        """
        if power < 1.0:
            raise InputError("no norm")
        return x

    assert sorted(function_faults(norm)) == [  # type: ignore[arg-type]
        "array x has no shape", "does not say what it returns", "does not tell of InputError",
        "other is documented and is no parameter", "parameter power is not documented",
    ]  # fmt: skip
