"""Checks of a plugin package: its components, their Specs, and fast discovery."""

from __future__ import annotations

import inspect
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import is_dataclass
from types import ModuleType
from typing import Any, get_args

from hillsphere.plugins.registry import (
    Registered,
    Registry,
    default_registry,
    load_object,
    validate,
)
from hillsphere.spec.base import Spec, StageSpec
from hillsphere.testing.contract import require
from hillsphere.testing.examples import bound_example

__all__ = ["HEAVY_MODULES", "check_plugin", "check_spec"]

HEAVY_MODULES = ("numpy", "scipy", "control", "cvxpy", "matplotlib", "heyoka")
"""Packages that listing, validating and describing components must not import."""


def check_plugin(module: ModuleType, *, registry: Registry | None = None) -> None:
    """Check a plugin package.

    Parameters
    ----------
    module : module
        Module of its entry point, with ``hillsphere_components``.
    registry : Registry, optional
        Registry of components for references in examples; by default of all installed plugins.

    Raises
    ------
    ContractViolation
        If it offers no component or one name twice; if a Spec lacks a description or an example, or
        an example is invalid; if its own module or a Spec's imports one of `HEAVY_MODULES`; if a
        component cannot be made from its examples; if a stage's `run` and `present` do not accept
        the needs of its Spec.
    PluginError
        If a component cannot be imported.
    """
    own = Registry(strict=True)
    own.add_plugin(module.__name__, module)
    records = list(own)
    everything = registry or default_registry()
    check_light([module.__name__, *(_module_of(r.component.spec) for r in records)])
    for record in records:
        kind, type_ = record.component.kind, record.component.type
        what = f"{kind} {type_!r}"
        require(record.component.summary, f"{what}: needs a summary of one line")
        require("\n" not in record.component.summary, f"{what}: its summary has several lines")
        if kind == "command":
            record.load_target()
            continue
        installed = everything.get(kind, type_)
        require(
            installed.component == record.component,
            f"{what}: another plugin, {installed.plugin!r}, is installed under this name",
        )
        spec = record.load_spec()
        check_spec(spec)
        target = record.load_target()
        require(inspect.getdoc(target), f"{what}: {record.component.target} has no docstring")
        for number in range(len(spec.examples)):
            component = target(bound_example(record, everything, number))
            if kind == "stage":
                _check_signatures(what, component, record)


def check_spec(spec: type[Spec]) -> None:
    """Check the declaration of a component's parameters.

    Parameters
    ----------
    spec : type
        The Spec class.

    Raises
    ------
    ContractViolation
        If it, or a Spec nested in it, lacks a docstring or a field's description; if it has no
        example; if a stage declares no product.
    InputError
        If an example does not validate.
    """
    name = spec.__name__
    require(issubclass(spec, Spec), f"{name} must derive from hillsphere.spec.Spec")
    for part in (spec, *nested_specs(spec)):
        require(part.__dict__.get("__doc__"), f"{part.__name__} has no docstring")
        for key, field in part.model_fields.items():
            require(
                field.description,
                f"{part.__name__}.{key} has no description; declare it with quantity(), option(), "
                "reference(), need() or data_path()",
            )
    require(
        spec.examples,
        f"{name}.examples is empty; give at least one table as a mission would write it",
    )
    for number, table in enumerate(spec.examples):
        require("type" not in table, f"{name}.examples[{number}]: leave 'type' out")
        validate(spec, table, where=f"{name}.examples[{number}]")
    if issubclass(spec, StageSpec):
        require(spec.produces, f"{name}.produces is empty; name the class of the stage's product")
        require(
            is_dataclass(load_object(spec.produces)),
            f"{name}.produces: {spec.produces} is not a dataclass",
        )
        for path in spec.provides:
            require(
                issubclass(load_object(spec.produces), load_object(path)),
                f"{name}.provides: {spec.produces} does not derive from {path}",
            )


def check_light(modules: Iterable[str]) -> None:
    """Check, in a new interpreter, that importing modules imports none of `HEAVY_MODULES`.

    Parameters
    ----------
    modules : iterable of str
        Names, imported one after the other.

    Raises
    ------
    ContractViolation
        If a module imports a heavy one; the message names both.
    """
    code = (
        "import sys\nfrom importlib import import_module\n"
        f"heavy = {HEAVY_MODULES!r}\n"
        "for name in sys.argv[1:]:\n"
        "    import_module(name)\n"
        "    found = [h for h in heavy if h in sys.modules]\n"
        "    if found:\n"
        "        sys.exit(f'importing {name} imports {found[0]}')\n"
    )
    names = list(dict.fromkeys(modules))
    done = subprocess.run(
        [sys.executable, "-P", "-c", code, *names], capture_output=True, text=True, check=False
    )
    require(
        done.returncode == 0,
        f"{done.stderr.strip()}; a plugin's own module and its specs import hillsphere.plugins "
        "and hillsphere.spec only, so that listing and validating stay cheap",
    )


def nested_specs(spec: type[Spec]) -> Iterator[type[Spec]]:
    """Yield the Specs nested in a Spec's fields, at every depth, each once."""
    seen: set[type[Spec]] = {spec}
    waiting: list[Any] = [field.annotation for field in spec.model_fields.values()]
    while waiting:
        annotation = waiting.pop()
        waiting.extend(get_args(annotation))
        if isinstance(annotation, type) and issubclass(annotation, Spec) and annotation not in seen:
            seen.add(annotation)
            waiting.extend(field.annotation for field in annotation.model_fields.values())
            yield annotation


def _module_of(path: str) -> str:
    return path.partition(":")[0] or "hillsphere.plugins"


def _check_signatures(what: str, stage: Any, record: Registered) -> None:
    spec = record.load_spec()
    needs = spec.model_fields.get("needs")
    inputs = {
        name: None
        for part in (get_args(needs.annotation) or (needs.annotation,) if needs else ())
        if isinstance(part, type) and issubclass(part, Spec)
        for name in part.model_fields
    }
    repeats = {f: None for f in spec.model_fields if spec.schema_extra(f).get("x-repeats")}
    for method, given in (("run", inputs | repeats), ("present", inputs)):
        require(callable(getattr(stage, method, None)), f"{what}: has no method {method}")
        try:
            inspect.signature(getattr(stage, method)).bind(None, **given)
        except TypeError as error:
            require(False, f"{what}: {method} does not take the inputs {list(given)}: {error}")
