"""Pages of the public names of modules, from their docstrings.

Before the sources are read, ``reference/modules`` is written anew: a page per module of `MODULES`,
with a list of its names and the documentation of each.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from generated_pages import escape_bars, heading, with_code, write_pages
from public_modules import MODULES
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

__all__ = ["setup"]


def origin_of(module: str, name: str) -> str:
    """Return the module that defines a name, by way of the imports of a face."""
    for node in ast.walk(ast.parse(inspect.getsource(import_module(module)))):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return origin_of(node.module, alias.name)
    return module


def data_lines(target: str, module: str, name: str) -> list[str]:
    """Return the entry of a constant or an alias, with the string below it in its module."""
    analyzer = ModuleAnalyzer.for_module(origin_of(module, name))
    analyzer.analyze()
    text = analyzer.attr_docs.get(("", name), [])
    lines = (f"   {line}".rstrip() for line in escape_bars(text))
    return [f".. py:data:: {target}", "", *lines, ""]


def page(name: str, documented: dict[int, str]) -> list[str]:
    """Return the page of a module; what an earlier page documents is a link to it."""
    module = import_module(name)
    lines = [*heading(name, "="), f".. module:: {name}", ""]
    lines += [*escape_bars(inspect.cleandoc(module.__doc__ or "").splitlines()), ""]
    entries: list[str] = []
    own: list[str] = []
    for one in module.__all__:
        value, target = getattr(module, one), f"{name}.{one}"
        is_class, is_function = inspect.isclass(value), inspect.isfunction(value)
        if one == "__version__":
            continue
        if (is_class or is_function) and id(value) in documented:
            entries += [f"``{one}`` is :py:obj:`{documented[id(value)]}`.", ""]
        elif is_class or is_function:
            documented[id(value)] = target
            own.append(one)
            entries += [f".. auto{'class' if is_class else 'function'}:: {target}"]
            entries += ["   :members:", ""] if is_class else [""]
        else:
            entries += data_lines(target, name, one)
    if own:
        lines += [".. autosummary::", "   :nosignatures:", "", *(f"   {one}" for one in own), ""]
    return lines + entries


def pages() -> dict[str, list[str]]:
    """Return path below ``reference/modules`` → lines."""
    documented: dict[int, str] = {}
    written = {name: page(name, documented) for names in MODULES.values() for name in names}
    index = heading("Public functions and classes", "=")
    for title, names in MODULES.items():
        index += heading(title, "-")
        for name in names:
            first = inspect.cleandoc(import_module(name).__doc__ or "").splitlines()[0]
            index += [f":doc:`{name}`", f"   {with_code(first)}", ""]
    index += [".. toctree::", "   :hidden:", "", *(f"   {name}" for name in written)]
    written["index"] = index
    return written


def _prepare(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Keep absolute values, and sources that only the module's docstring lists, as text."""
    for index, line in enumerate(escape_bars(lines)):
        without_source = re.sub(r"\[(\d+)\]_", r"[\1]", line)
        lines[index] = re.sub(r"\(\*(?=\w)", r"(\*", without_source)  # a shape (*shape, N)


def _generate(app: Sphinx) -> None:
    write_pages(Path(app.srcdir) / "reference" / "modules", pages())


def setup(app: Sphinx) -> Mapping[str, Any]:
    """Register the generator."""
    app.connect("builder-inited", _generate)
    app.connect("autodoc-process-docstring", _prepare, priority=900)  # after numpydoc
    return {"parallel_read_safe": True, "parallel_write_safe": True}
