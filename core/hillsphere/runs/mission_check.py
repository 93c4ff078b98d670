"""Check of a mission before its first stage runs, and by ``hillsphere validate``.

`load_mission` checks each table and the links between them. Here the classes are imported and the
components made, which reads their data, so that all faults that components, campaigns or plugins
can detect before a run are reported together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from hillsphere.base.errors import InputError, PluginError
from hillsphere.base.problems import MissionError, Problem
from hillsphere.interfaces.dispersion import StageDispersion
from hillsphere.interfaces.stages import CaseStage, NeedsCheck
from hillsphere.mission.load import Mission
from hillsphere.plugins.registry import OUTCOME_KINDS
from hillsphere.runs.assembly import Assembly, problem_at, problem_of
from hillsphere.runs.wiring import inputs_of, needs_faults, product_class, repeat_faults
from hillsphere.uncertainty.unused import check_dispersion

__all__ = ["CheckedMission", "check_mission"]


@dataclass(frozen=True)
class CheckedMission:
    """A mission whose check has found no fault.

    Parameters
    ----------
    order : tuple of str
        Its stages, each after those that it needs.
    classes : mapping
        Stage → class of its product.
    stages : mapping
        Stage → its component.
    judges : mapping
        (kind, name) → component, of every requirement and claim.
    descriptions : mapping
        ``"kind.name"`` → what a shape or gravity model tells of itself.
    """

    order: tuple[str, ...]
    classes: Mapping[str, type]
    stages: Mapping[str, Any]
    judges: Mapping[tuple[str, str], Any]
    descriptions: Mapping[str, tuple[str, ...]]


def check_mission(mission: Mission) -> CheckedMission:
    """Import the classes and make the components of all stages of a mission.

    Parameters
    ----------
    mission : Mission
        From `hillsphere.load_mission`.

    Returns
    -------
    CheckedMission
        The components of its stages.

    Raises
    ------
    MissionError
        With every fault: a component refuses its parameters, a data file cannot be read, a stage
        needs a product of another type or repeats one that cannot be repeated, a dispersion matches
        no quantity or has sizes for another number of quantities.
    PluginError
        If a class cannot be imported, or a stage declares no product class that is a frozen
        dataclass.
    """
    order = tuple(mission.order())
    classes = {name: product_class(mission, name) for name in order}
    problems: dict[Problem, None] = dict.fromkeys(needs_faults(mission, classes))
    assembly = Assembly(mission)
    judged = [(kind, name) for kind in OUTCOME_KINDS for name in mission.specs.get(kind, {})]
    made: dict[tuple[str, str], Any] = {}
    for key in [*(("stage", name) for name in order), *judged]:
        try:
            made[key] = assembly.get(*key)
        except MissionError as error:
            problems.update(dict.fromkeys(error.problems))
    stages = {name: made["stage", name] for name in order if ("stage", name) in made}
    problems.update(dict.fromkeys(repeat_faults(mission, stages)))
    problems.update(dict.fromkeys(_unmet_keys(mission, stages)))
    problems.update(dict.fromkeys(_unused_dispersions(mission, assembly, stages)))
    if problems:
        raise MissionError(problems)
    judges = {key: made[key] for key in judged}
    return CheckedMission(order, classes, stages, judges, assembly.descriptions())


def _unmet_keys(mission: Mission, stages: Mapping[str, Any]) -> list[Problem]:
    """Return problems for keys that the needed stages cannot meet, by `NeedsCheck`."""
    problems: list[Problem] = []
    for name, stage in stages.items():
        spec = mission.specs["stage"][name]
        there = all(ref.name in stages for _, _, ref in spec.needs_of())
        if there and isinstance(stage, NeedsCheck):
            try:
                stage.check_needs(**inputs_of(spec, stages))
            except InputError as error:
                problems.append(problem_of(mission, ("stage", name), error))
    return problems


def _unused_dispersions(
    mission: Mission, assembly: Assembly, stages: Mapping[str, Any]
) -> list[Problem]:
    """Return the problems of dispersions that no stage refers to and therefore checks."""
    used = {
        ref.name
        for spec in mission.specs["stage"].values()
        for _, kind, ref in spec.references()
        if kind == "dispersions"
    }
    problems: list[Problem] = []
    for name in mission.specs.get("dispersions", {}):
        if name in used:
            continue
        key = ("dispersions", name)
        try:
            dispersion = assembly.get(*key)
            kind, _, table = dispersion.of.partition(".")
            if kind == "stage":
                stage = stages.get(table)  # not there if it could not be made
                if isinstance(stage, CaseStage):
                    if isinstance(dispersion, StageDispersion):
                        dispersion = dispersion.bind_to(stage)
                    check_dispersion(dispersion, stage.case_inputs())
            elif hasattr(component := assembly.get(kind, table), "parameters"):
                check_dispersion(dispersion, component.parameters())
        except MissionError as error:
            problems += error.problems
        except PluginError:
            raise
        except InputError as error:
            problems.append(problem_at(mission, key, str(error)))
    return problems
