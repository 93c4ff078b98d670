"""Components and products made from the examples of Specs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hillsphere.base.problems import Key
from hillsphere.mission.load import Mission
from hillsphere.mission.report_spec import ReportSpec
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
        Kind and type of the component.
    number : int
        Index in ``Spec.examples``.
    registry : Registry, optional
        Registry of the component; by default of all installed plugins.

    Returns
    -------
    object
        The component. Each reference in the example is bound to the component whose type equals the
        reference's name, or else to the simplest installed one of its kind, made from its own first
        example.

    Raises
    ------
    ContractViolation
        If the Spec has no such example, or a reference cannot be bound.
    """
    registry = registry or default_registry()
    record = registry.get(kind, type_)
    return record.load_target()(bound_example(record, registry, number))


def bound_example(record: Registered, registry: Registry, number: int = 0) -> Spec:
    """Return the Spec of an example with its references bound, except a stage's inputs."""
    return _example_spec(record, number).bound(
        lambda kind, name: None if kind == "stage" else _filling(kind, name, record, registry)
    )


def example_inputs(spec: Spec, registry: Registry | None = None) -> dict[str, Any]:
    """Make the products that a stage takes from earlier stages.

    Parameters
    ----------
    spec : Spec
        Spec of the stage.
    registry : Registry, optional
        Registry of stages; by default of all installed plugins.

    Returns
    -------
    dict of str to object
        Name of the input → product, as `run` takes them.
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
    """Make a product by running the simplest stage that yields it, on its first example.

    Parameters
    ----------
    path : str
        Import path of the product's class, ``"package.module:Class"``.
    name : str
        Type of a stage that is preferred if it yields the product: an example that needs the
        product of a certain stage refers to it by its type.
    registry : Registry, optional
        Registry of stages; by default of all installed plugins.

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
    """Make the repeated stage of a campaign: the simplest installed stage that can be repeated.

    Parameters
    ----------
    spec : Spec
        Spec of the campaign.
    registry : Registry, optional
        Registry of stages; by default of all installed plugins.

    Returns
    -------
    dict of str to Repeated
        Name of the field → repeated stage, as `run` takes them; empty for a stage that repeats
        none. It belongs to a mission made of examples. For every dispersion that the campaign
        names, this mission has a table for the first quantity of the stage itself.

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
        kind, table, registered = waiting.pop()
        made = _example_spec(registered, 0)
        specs.setdefault(kind, {})[table] = made
        components.setdefault(kind, {})[table] = registered
        waiting += [
            (other, ref.name, _filling_record(other, ref.name, registered, registry))
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
        format=1, name="example", title="Examples", seed=1, description="", report=ReportSpec(),
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
    """Return the component for a reference: of the type that is its name, or the simplest.

    An example that needs a certain type gives it as the name: ``{"body": "planet"}``.
    """
    candidates = [record for record in registry.of_kind(kind) if record != user]
    require(candidates, f"{user.component.type}: no other installed component is a {kind}")
    named = (record for record in candidates if record.component.type == name)
    return next(named, None) or min(candidates, key=lambda record: _size(record, registry))


def _size(record: Registered, registry: Registry) -> tuple[int, int, str]:
    """Return a sort key of components: number of references, those to a fixed type, and name.

    The references are those of the component's examples.
    """
    types = {(other.component.kind, other.component.type) for other in registry}
    names = [(kind, ref.name) for _, kind, ref in _example_spec(record, 0).references()]
    return len(names), len(types.intersection(names)), record.component.type
