"""The contract of stages that campaigns repeat: what breaks it is found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hillsphere_campaigns
from hillsphere.base.seeds import draws
from hillsphere.interfaces import Array, Context, Parameter
from hillsphere.interfaces.cases import LANES, CaseBatch, CaseResults, Histories
from hillsphere.plugins import Component, Registry, hookimpl
from hillsphere.plugins import builtin as components
from hillsphere.presentation import Presentation
from hillsphere.products import Trajectories
from hillsphere.spec import StageSpec
from hillsphere.testing import ContractViolation, check_case_stage

HERE = __name__
FAULT: dict[str, Callable[[CaseBatch, CaseResults], CaseResults]] = {}
FAULT_NAMED: dict[str, Callable[[CaseBatch, CaseResults], CaseResults]] = {}
"""What spoils calls that ask for histories by name."""


class ToySpec(StageSpec):
    """A toy."""

    produces = "hillsphere.products:Trajectories"
    examples = ({},)


class Toy:
    """A sum of two inputs and a draw, spoilt by whatever `FAULT` holds."""

    def __init__(self, spec: ToySpec) -> None:
        self.spec = spec

    def run(self, ctx: Context) -> Trajectories:
        raise NotImplementedError

    def present(self, product: Trajectories) -> Presentation:
        raise NotImplementedError

    def case_inputs(self) -> tuple[Parameter, ...]:
        return (Parameter("a", 2.0, "m"), Parameter("b", 0.0, "m"), Parameter("c", np.nan, "m"))

    def run_cases(self, batch: CaseBatch, history: bool | tuple[str, ...] = False) -> CaseResults:
        noise = draws(batch.seed, batch.stream, batch.draws, "toy", (1,))[0]
        total: Array = batch.value("a", 2.0) + batch.value("b", 0.0) + noise
        histories = Histories(
            np.zeros((1, LANES)), ("sum",), ("m",), np.ascontiguousarray(total[None, None])
        )
        found = CaseResults(
            ("sum",), ("m",), total[None], ("completed",) * LANES, ("",) * LANES,
            np.zeros(LANES, dtype=bool), histories if history else None,
        )  # fmt: skip
        if isinstance(history, tuple) and (spoil_named := FAULT_NAMED.get("it")):
            return spoil_named(batch, found)
        for spoil in FAULT.values():
            found = spoil(batch, found)
        return found


class Plugin:
    """Offers the toy."""

    @hookimpl
    def hillsphere_components(self) -> list[Component]:
        return [Component("stage", "toy", f"{HERE}:Toy", f"{HERE}:ToySpec", "a toy")]


def registry() -> Registry:
    made = Registry(strict=True)
    made.add_plugin("hillsphere", components)
    made.add_plugin("hillsphere_campaigns", hillsphere_campaigns)
    made.add_plugin("toys", Plugin())
    return made


@pytest.fixture(autouse=True)
def _no_fault() -> Any:
    FAULT.clear()
    FAULT_NAMED.clear()
    yield
    FAULT.clear()
    FAULT_NAMED.clear()


def test_a_sound_stage() -> None:
    found = check_case_stage("toy", registry=registry())
    assert found.metrics == ("sum",)


def by_place(batch: CaseBatch, found: CaseResults) -> CaseResults:
    return replace(found, values=found.values + 1e-9 * np.arange(LANES))


def by_neighbours(batch: CaseBatch, found: CaseResults) -> CaseResults:
    return replace(found, values=found.values + 1e-12 * found.values.mean())


def by_number(batch: CaseBatch, found: CaseResults) -> CaseResults:
    return replace(found, values=found.values + 1e-9 * batch.numbers)


def by_history(batch: CaseBatch, found: CaseResults) -> CaseResults:
    told = found.histories is not None
    return replace(found, status=("completed" if told else "ended",) * LANES)


def by_call(batch: CaseBatch, found: CaseResults, count: list[int] = [0]) -> CaseResults:  # noqa: B006
    count[0] += 1
    return replace(found, values=found.values + 1e-9 * count[0])


def not_finite(batch: CaseBatch, found: CaseResults) -> CaseResults:
    return replace(found, values=np.where(np.arange(LANES) == 5, np.nan, found.values))


def without_b(batch: CaseBatch, found: CaseResults) -> CaseResults:
    still = np.round(found.values - batch.value("b", 0.0), 9)  # but for rounding
    told = found.histories
    kept = None if told is None else replace(told, values=still[:, None].copy())
    return replace(found, values=still, histories=kept)


def short(batch: CaseBatch, found: CaseResults) -> CaseResults:
    return replace(found, values=found.values[:, :-1])


def renamed(batch: CaseBatch, found: CaseResults) -> CaseResults:
    return replace(found, metrics=("sum" if batch.draws[0] else "total",))


def without_history(batch: CaseBatch, found: CaseResults) -> CaseResults:
    return replace(found, histories=None)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (by_place, "in another place|equal inputs"),
        (by_neighbours, "in another place|among filler"),
        (by_number, "in another place|another number"),
        (by_history, "with histories"),
        (by_call, "at a second call"),
        (not_finite, r"cases \[5\] did not fail and are not finite"),
        (without_b, r"inputs \['b'\] change nothing"),
        (short, r"values are \(1, 63\)"),
        (renamed, "metrics or units differ"),
        (without_history, "histories must be there"),
    ],
)
def test_what_breaks_it(spoil: Any, message: str) -> None:
    FAULT["it"] = spoil
    with pytest.raises(ContractViolation, match=message):
        check_case_stage("toy", registry=registry())


def of_another_name(batch: CaseBatch, found: CaseResults) -> CaseResults:
    assert found.histories is not None
    return replace(found, histories=replace(found.histories, names=("total",)))


def of_another_value(batch: CaseBatch, found: CaseResults) -> CaseResults:
    assert found.histories is not None
    values = found.histories.values + 1e-12
    return replace(found, histories=replace(found.histories, values=values))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (of_another_name, "keeps no history of sum by name"),
        (of_another_value, "the history of sum differs where it is named"),
    ],
)
def test_histories_that_are_asked_for_by_name(spoil: Any, message: str) -> None:
    FAULT_NAMED["it"] = spoil
    with pytest.raises(ContractViolation, match=message):
        check_case_stage("toy", registry=registry())


def test_inert_inputs_are_named() -> None:
    FAULT["it"] = without_b
    check_case_stage("toy", inert=["b"], registry=registry())
    FAULT.clear()
    with pytest.raises(ContractViolation, match=r"\['b'\] are called inert and are not"):
        check_case_stage("toy", inert=["b"], registry=registry())


def test_a_stage_that_is_none_of_these() -> None:
    with pytest.raises(ContractViolation, match="has no case_inputs and run_cases"):
        check_case_stage("sweep", registry=registry())
