"""Components and products made from the examples that every Spec carries."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hillsphere.base.problems import Key
from hillsphere.mission.load import Mission
from hillsphere.plugins.registry import (
    Registered,
    Registry,
    default_registry,
    load_object,
    validate,
)
from hillsphere.runs.wiring import repeated_stages
from hillsphere.spec.base import Ref, Spec, StageSpec
from hillsphere.testing.context import RecordingContext
from hillsphere.testing.contract import require

__all__ = ["bound_example", "example", "example_inputs", "example_product", "example_repeated"]


def example(kind: str, type_: str, number: int = 0, *, registry: Registry | None = None) -> Any:
    """Make a component from an example of its Spec.

    Parameters
    ----------
    kind, type_ : str
        What to make.
    number : int
        Which of ``Spec.examples``.
    registry : Registry, optional
        Where it is found; by default all installed plugins.

    Returns
    -------
    object
        The component. Each reference in the example is filled by the component whose type is the
        name written there, or else the simplest installed one of its kind, made from its own first
        example.

    Raises
    ------
    ContractViolation
        If the Spec has no such example, or a reference cannot be filled.
    """
    registry = registry or default_registry()
    record = registry.get(kind, type_)
    return record.load_target()(bound_example(record, registry, number))


def bound_example(record: Registered, registry: Registry, number: int = 0) -> Spec:
    """Return the Spec of an example with its references filled, a stage's inputs left open."""
    return _example_spec(record, number).bound(
        lambda kind, name: None if kind == "stage" else _filling(kind, name, record, registry)
    )


def example_inputs(spec: Spec, registry: Registry | None = None) -> dict[str, Any]:
    """Make the products that a stage takes from earlier stages.

    Parameters
    ----------
    spec : Spec
        The stage's.
    registry : Registry, optional
        Where stages are found; by default all installed plugins.

    Returns
    -------
    dict of str to object
        By name of the input, as `run` takes them.
    """
    needs = getattr(spec, "needs", None)
    if not isinstance(needs, Spec):
        return {}

    def made(value: Any, path: str) -> Any:
        if isinstance(value, Ref):
            return example_product(path, value.name, registry=registry)
        if isinstance(value, tuple):
            return tuple(made(item, path) for item in value)
        return value

    return {
        name: made(getattr(needs, name), str(needs.schema_extra(name).get("x-product", "")))
        for name in type(needs).model_fields
    }


def example_product(path: str, name: str = "", *, registry: Registry | None = None) -> Any:
    """Make a product by running the stage that yields it and needs least, on its first example.

    Parameters
    ----------
    path : str
        Import path of the product's class, ``"package.module:Class"``.
    name : str
        Type of a stage that is taken instead if it yields it: an example that needs the product of
        a certain stage calls it by its type.
    registry : Registry, optional
        Where the stage is found; by default all installed plugins.

    Returns
    -------
    object
        The product.

    Raises
    ------
    ContractViolation
        If no installed stage yields it.
    """
    registry = registry or default_registry()
    wanted = load_object(path)
    candidates = []
    for record in registry.of_kind("stage"):
        spec = record.load_spec()
        if issubclass(spec, StageSpec) and issubclass(load_object(spec.produces), wanted):
            needs = len(list(_example_spec(record, 0).needs_of()))
            candidates.append((record.component.type != name, needs, record.component.type, record))
    require(candidates, f"no installed stage yields {path}")
    record = min(candidates, key=lambda candidate: candidate[:3])[3]
    bound = bound_example(record, registry)
    inputs = example_inputs(bound, registry) | example_repeated(bound, registry)
    return record.load_target()(bound).run(RecordingContext(), **inputs)


def example_repeated(spec: Spec, registry: Registry | None = None) -> dict[str, Any]:
    """Make what a campaign repeats: the simplest installed stage that can be.

    Parameters
    ----------
    spec : Spec
        The campaign's.
    registry : Registry, optional
        Where stages are found; by default all installed plugins.

    Returns
    -------
    dict of str to Repeated
        By field, as `run` takes them; empty for a stage that repeats none. It belongs to a mission
        made of examples, which has a table for every dispersion that the campaign names: of the
        first quantity of the stage itself.

    Raises
    ------
    ContractViolation
        If no installed stage can be repeated.
    """
    registry = registry or default_registry()
    return {field: _example_mission(name, spec, registry) for field, name in repeated_stages(spec)}


def _example_mission(name: str, campaign: Spec, registry: Registry) -> Any:
    from hillsphere.cases.repeated import Repeated

    fitting = [
        record
        for record in registry.of_kind("stage")
        if hasattr(target := record.load_target(), "run_cases") and hasattr(target, "case_inputs")
    ]
    require(fitting, "no installed stage can be repeated: none has run_cases and case_inputs")
    record = min(fitting, key=lambda record: _size(record, registry))
    specs: dict[str, dict[str, Spec]] = {}
    components: dict[str, dict[str, Registered]] = {}
    waiting = [("stage", name, record)]
    while waiting:
        kind, table, found = waiting.pop()
        made = _example_spec(found, 0)
        specs.setdefault(kind, {})[table] = made
        components.setdefault(kind, {})[table] = found
        waiting += [
            (other, ref.name, _filling_record(other, ref.name, found, registry))
            for _, other, ref in made.references()
            if other != "stage" and ref.name not in specs.get(other, {})
        ]
    places: dict[Key, str] = {
        (kind, table, *where): "example"
        for kind, tables in specs.items()
        for table, spec in tables.items()
        for where in ((), *(where for where, _ in spec.data_paths()))
    }
    here = Path.cwd()
    mission = Mission(
        format=1, name="example", title="Examples", seed=1, description="",
        path=here / "example.toml", directory=here, text="", profile=None, sets=(), profiles=(),
        specs=specs, components=components, places=places,
    )  # fmt: skip
    repeated = Repeated(mission, name, example_inputs(specs["stage"][name], registry), "campaign")
    own = [p.name for p in repeated.case_inputs() if "." not in p.name.removeprefix("state.")]
    for _, kind, ref in campaign.references():
        if kind == "dispersions":
            normal = registry.get(kind, "normal")
            keys = {"of": f"stage.{name}", "parameters": own[:1], "sigma": 1e-6}
            specs.setdefault(kind, {})[ref.name] = normal.load_spec().model_validate(keys)
            components.setdefault(kind, {})[ref.name] = normal
            own = own[1:]
    return repeated


def _example_spec(record: Registered, number: int) -> Spec:
    spec = record.load_spec()
    what = f"{record.component.kind} {record.component.type!r}"
    require(
        len(spec.examples) > number,
        f"{what}: {spec.__name__}.examples has {len(spec.examples)} tables, number {number} is "
        "wanted; give at least one table as a mission would write it, without 'type'",
    )
    return validate(spec, spec.examples[number], where=f"{what}, example {number}")


def _filling(kind: str, name: str, user: Registered, registry: Registry) -> Any:
    record = _filling_record(kind, name, user, registry)
    return record.load_target()(bound_example(record, registry))


def _filling_record(kind: str, name: str, user: Registered, registry: Registry) -> Registered:
    """Return what fills a reference: the component of the type that is its name, or the simplest.

    So an example that needs a certain type writes it: ``{"body": "planet"}``.
    """
    candidates = [record for record in registry.of_kind(kind) if record != user]
    require(candidates, f"{user.component.type}: no other installed component is a {kind}")
    named = (record for record in candidates if record.component.type == name)
    return next(named, None) or min(candidates, key=lambda record: _size(record, registry))


def _size(record: Registered, registry: Registry) -> tuple[int, int, str]:
    """Order components by what their examples refer to, then by how much of that must be of a type.

    At last by name.
    """
    types = {(other.component.kind, other.component.type) for other in registry}
    names = [(kind, ref.name) for _, kind, ref in _example_spec(record, 0).references()]
    return len(names), len(types.intersection(names)), record.component.type
