"""A mission of toys whose stage can be repeated, for dispersions and plans."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hillsphere.cases.repeated import Repeated
from hillsphere.interfaces import Array, Parameter
from hillsphere.interfaces.cases import CaseBatch, CaseResults
from hillsphere.mission import Mission, load_mission
from hillsphere.plugins import Component, Registry, hookimpl
from hillsphere.plugins import builtin as components
from hillsphere.spec import Ref, Spec, StageSpec, option, quantity, reference

HERE = __name__
COEFFICIENTS = {"C2,0": -0.1, "C2,2": 0.02, "S2,2": 0.0, "C3,1": 0.004}


class BallSpec(Spec):
    """Attraction with a few coefficients."""

    examples = ({"gm_km3_s2": 7e-4},)
    gm_m3_s2: float = quantity("gravitational_parameter", "attraction", gt=0)
    degree: int = option("largest degree", default=3)


class Ball:
    """A toy gravity model."""

    def __init__(self, spec: BallSpec) -> None:
        self.spec = spec

    def parameters(self) -> tuple[Parameter, ...]:
        used = {k: v for k, v in COEFFICIENTS.items() if int(k[1]) <= self.spec.degree}
        gm = Parameter("gm", self.spec.gm_m3_s2, "m3/s2")
        return (gm, *(Parameter(name, value) for name, value in used.items()))


class LawSpec(Spec):
    """A law with a model of its own."""

    examples = ({"model": "phobos"},)
    model: Ref = reference("gravity", "what it believes")


class Law:
    """A toy law."""

    def __init__(self, spec: LawSpec) -> None:
        self.model: Ball = spec.model.get()


class LimitsSpec(Spec):
    """Limits of a flight."""

    examples = ({"dv_m_s": 3.0},)
    dv_m_s: float = quantity("speed", "Δv at hand", default=3.0, gt=0)


class HoverSpec(StageSpec):
    """A stage that can be repeated."""

    produces = "hillsphere.products:CaseTable"
    examples = ({"gravity": "phobos", "law": "own"},)
    gravity: Ref = reference("gravity", "the truth")
    law: Ref = reference("compensator", "the law")
    period_s: float = quantity("time", "between samples", default=60.0, gt=0)
    samples: int = option("their number", default=10, ge=1)
    mode: str = option("how", default="calm")
    limits: LimitsSpec = option("limits", default=LimitsSpec())


class Hover:
    """A toy stage."""

    built = 0

    def __init__(self, spec: HoverSpec) -> None:
        type(self).built += 1
        self.spec = spec

    def case_inputs(self) -> tuple[Parameter, ...]:
        truth: Ball = self.spec.gravity.get()
        law: Law = self.spec.law.get()
        return (
            *(Parameter(f"gravity.{q.name}", q.value, q.unit) for q in truth.parameters()),
            *(Parameter(f"law.model.{q.name}", q.value, q.unit) for q in law.model.parameters()),
            Parameter("state.x", 20e3, "m"),
            Parameter("state.y", 0.0, "m"),
            Parameter("state.vx", float("nan"), "m/s"),
        )

    def run_cases(self, batch: CaseBatch, history: bool = False) -> CaseResults:
        values: Array = batch.value("state.x", 20e3)[None]
        count = values.shape[1]
        failed = np.zeros(count, dtype=bool)
        return CaseResults(("x",), ("m",), values, ("completed",) * count, ("",) * count, failed)

    def run(self, ctx: Any) -> Any:
        raise NotImplementedError

    def present(self, product: Any) -> Any:
        raise NotImplementedError


class Idle:
    """A toy stage that cannot be repeated."""

    def __init__(self, spec: Spec) -> None:
        self.spec = spec


class IdleSpec(StageSpec):
    """A stage that cannot be repeated."""

    produces = "hillsphere.products:CaseTable"
    examples = ({},)


class Plugin:
    """The plugin of these toys."""

    @hookimpl
    def hillsphere_components(self) -> list[Component]:
        table = [
            ("gravity", "ball", "Ball"),
            ("compensator", "law", "Law"),
            ("stage", "hover", "Hover"),
            ("stage", "idle", "Idle"),
        ]
        return [
            Component(kind, type_, f"{HERE}:{name}", f"{HERE}:{name}Spec", f"a toy {type_}")
            for kind, type_, name in table
        ]


MISSION = """\
format = 1
name = "toy"
title = "Toys"
seed = 11

[gravity.phobos]
type = "ball"
gm_km3_s2 = 7e-4

[gravity.believed]
type = "ball"
gm_km3_s2 = 8e-4

[gravity.unused]
type = "ball"
gm_km3_s2 = 9e-4

[compensator.own]
type = "law"
model = "believed"

[stage.hover]
type = "hover"
gravity = "phobos"
law = "own"

[stage.idle]
type = "idle"
"""


def toy_registry() -> Registry:
    """Return a registry of these toys and of the core's components."""
    registry = Registry(strict=True)
    registry.add_plugin("hillsphere", components)
    registry.add_plugin("toys", Plugin())
    return registry


def toy_mission(directory: Path, tables: str = "", sets: tuple[str, ...] = ()) -> Mission:
    """Load the mission with further tables."""
    path = directory / "toy.toml"
    path.write_text(MISSION + tables)
    return load_mission(path, sets=sets, registry=toy_registry())


def toy_repeated(directory: Path, tables: str = "", sets: tuple[str, ...] = ()) -> Repeated:
    """Return its stage, to be repeated."""
    return Repeated(toy_mission(directory, tables, sets), "hover")
