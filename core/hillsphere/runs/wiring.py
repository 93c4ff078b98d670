"""Inputs of stages: products of earlier stages, and the stage that a campaign repeats."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass, replace
from typing import TYPE_CHECKING, Any

from hillsphere.base.errors import InputError, PluginError
from hillsphere.base.problems import MissionError, Problem, with_article
from hillsphere.interfaces.stages import CaseStage
from hillsphere.mission.load import Mission
from hillsphere.plugins.registry import load_object
from hillsphere.runs.assembly import problem_at
from hillsphere.spec.base import Ref, Spec, StageSpec

if TYPE_CHECKING:
    from hillsphere.cases.repeated import Repeated

__all__ = [
    "inputs_of",
    "needs_faults",
    "product_class",
    "repeat_faults",
    "repeated_stages",
    "stages_to_repeat",
    "takes_from",
]


def product_class(mission: Mission, stage: str) -> type:
    """Return the product class of a stage.

    Raises
    ------
    PluginError
        If its Spec declares none, or the class cannot be imported or is not a frozen dataclass.
    """
    path = str(getattr(mission.specs["stage"][stage], "produces", ""))
    what = f"stage {stage!r} ({_type(mission, stage)})"
    if not path:
        raise PluginError(f"{what}: its Spec declares no product; set `produces`")
    product = _class(path, what)
    if not (is_dataclass(product) and product.__dataclass_params__.frozen):  # type: ignore[attr-defined]
        raise PluginError(
            f"{what}: its product class {path!r} must be a frozen dataclass, which can be stored; "
            "decorate it with @dataclass(frozen=True)"
        )
    return product


def needs_faults(mission: Mission, classes: Mapping[str, type]) -> Iterator[Problem]:
    """Yield a problem for every need whose stage yields a product of another class.

    Parameters
    ----------
    mission : Mission
        The mission.
    classes : mapping
        Stage → class of its product.
    """
    for name in classes:
        for where, path, ref in mission.specs["stage"][name].needs_of():
            wanted = _class(path, f"stage {name!r} ({_type(mission, name)})")
            given = classes[ref.name]
            if not issubclass(given, wanted):
                yield problem_at(
                    mission,
                    ("stage", name, *where),
                    f"needs {with_article(wanted.__name__)}, but stage {ref.name!r} yields "
                    f"{with_article(given.__name__)}",
                )


def repeat_faults(mission: Mission, stages: Mapping[str, Any]) -> Iterator[Problem]:
    """Yield the problems of stages that repeat others.

    Parameters
    ----------
    mission : Mission
        The mission.
    stages : mapping
        Stage → its component. Its optional method ``check`` is called with the `Repeated` without
        products; an error that it raises becomes a problem at the stage's line.
    """
    for name, stage in stages.items():
        for field, other in repeated_stages(mission.specs["stage"][name]):
            if other not in stages:  # it could not be made, which is told elsewhere
                continue
            if not isinstance(stages[other], CaseStage):
                fitting = [key for key, made in stages.items() if isinstance(made, CaseStage)]
                hint = f"it can repeat {', '.join(fitting)}" if fitting else "no stage here can"
                yield problem_at(
                    mission,
                    ("stage", name, field),
                    f"stage {other!r} ({_type(mission, other)}) cannot be "
                    f"repeated: it has no run_cases; {hint}"
                    + _instead(mission.specs["stage"][other]),
                )
                continue
            check = getattr(stage, "check", None)
            if check is None:
                continue
            try:
                check(_make_repeated(mission, other, {}, by=name))
            except MissionError as error:
                yield from error.problems
            except InputError as error:
                yield problem_at(mission, ("stage", name), str(error))


def _instead(spec: Spec) -> str:
    """Return what to do instead of repeating a stage, as the end of a message."""
    instead = spec.instead_of_repeating if isinstance(spec, StageSpec) else ""
    return f"; instead, {instead}" if instead else ""


def repeated_stages(spec: Spec) -> Iterator[tuple[str, str]]:
    """Yield (field, name) of the stages that a stage repeats, see `hillsphere.spec.repeated`."""
    for field in type(spec).model_fields:
        value = getattr(spec, field)
        if isinstance(value, Ref) and type(spec).schema_extra(field).get("x-repeats"):
            yield field, value.name


def takes_from(spec: Spec) -> list[str]:
    """Return the names of the stages whose products a stage requires, each once."""
    return sorted(
        {ref.name for _, _, ref in spec.needs_of()} | {name for _, name in repeated_stages(spec)}
    )


def inputs_of(spec: Spec, products: Mapping[str, Any]) -> dict[str, Any]:
    """Return the inputs of a stage from earlier ones.

    Parameters
    ----------
    spec : Spec
        Spec of the stage.
    products : mapping
        Stage → product, at least for the stages that it needs.

    Returns
    -------
    dict
        One item per field of its ``needs``.
    """
    needs = getattr(spec, "needs", None)
    if not isinstance(needs, Spec):
        return {}
    return {
        field: _resolve_product(getattr(needs, field), products)
        for field in type(needs).model_fields
    }


def _resolve_product(value: Any, products: Mapping[str, Any]) -> Any:
    if isinstance(value, Ref):
        return products[value.name]
    if isinstance(value, tuple):
        return tuple(_resolve_product(item, products) for item in value)
    if isinstance(value, dict):
        return {key: _resolve_product(item, products) for key, item in value.items()}
    return value


def stages_to_repeat(
    mission: Mission, stage: str, products: Mapping[str, Any]
) -> dict[str, Repeated]:
    """Return the repeated stages by field, each with the products that it needs itself."""
    return {
        field: replace(
            _make_repeated(
                mission, other, inputs_of(mission.specs["stage"][other], products), by=stage
            ),
            nominal=products.get(other),
        )
        for field, other in repeated_stages(mission.specs["stage"][stage])
    }


def _make_repeated(mission: Mission, stage: str, inputs: Mapping[str, Any], by: str) -> Repeated:
    from hillsphere.cases.repeated import Repeated

    return Repeated(mission, stage, inputs, by)


def _type(mission: Mission, stage: str) -> str:
    return mission.components["stage"][stage].component.type


def _class(path: str, what: str) -> type:
    try:
        loaded = load_object(path)
    except (ImportError, AttributeError, ValueError) as error:
        raise PluginError(f"{what}: product class {path!r} cannot be imported: {error}") from error
    if not isinstance(loaded, type):
        raise PluginError(f"{what}: {path!r} is not a class")
    return loaded
