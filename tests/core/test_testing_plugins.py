"""The conformance kit finds what is broken in a plugin, a Spec, a stage or a product."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest
from matplotlib.figure import Figure as Canvas

from hillsphere.cases.executors.serial import Serial
from hillsphere.cases.executors.specs import SerialSpec
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.plugins import Component, Registry, hookimpl
from hillsphere.presentation import Column, Figure, Metric, Presentation, Table
from hillsphere.spec import Ref, Spec, StageSpec, need, option, reference
from hillsphere.testing import (
    ContractViolation,
    RecordingContext,
    check_plugin,
    check_presentation,
    check_product,
    check_spec,
    check_stage,
    example,
    example_product,
)

SOUND = '''
"""A module."""
from dataclasses import dataclass
from typing import ClassVar
from hillsphere.plugins import Component, hookimpl
from hillsphere.spec import StageSpec, option


class TideSpec(StageSpec):
    """Parameters."""

    produces: ClassVar[str] = "NAME:Tide"
    examples = ({"height": 2},)
    height: int = option("how high")


@dataclass(frozen=True)
class Tide:
    """A product."""

    height: int


class TideStage:
    """A stage."""

    def __init__(self, spec):
        self.spec = spec

    def run(self, ctx):
        return Tide(self.spec.height)

    def present(self, product):
        from hillsphere.presentation import Presentation
        return Presentation()


@hookimpl
def hillsphere_components():
    """Return the components."""
    return [Component("stage", "tide", "NAME:TideStage", "NAME:TideSpec", "a tide")]
'''


def plugin(
    name: str, source: str, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[ModuleType, Registry]:
    """Import a module of this source, and a registry that holds it."""
    (directory / f"{name}.py").write_text(source.replace("NAME", name), "utf-8")
    monkeypatch.syspath_prepend(directory)
    monkeypatch.setenv("PYTHONPATH", str(directory))
    module = __import__(name)
    monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, name, module)
    registry = Registry(strict=True)
    registry.add_plugin(name, module)
    return module, registry


def test_a_sound_plugin_passes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module, registry = plugin("sound_plugin", SOUND, tmp_path, monkeypatch)
    check_plugin(module, registry=registry)
    assert check_stage("tide", registry=registry).height == 2
    assert check_stage("tide", {"height": 5}, registry=registry).height == 5
    with pytest.raises(ContractViolation, match="has 1 tables, number 1 is wanted"):
        example("stage", "tide", 1, registry=registry)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"a tide")', '"")', "needs a summary"),
        ('"a tide")', '"a\\ntide")', "several lines"),
        ('    """A stage."""\n', "", "has no docstring"),
        ('"how high"', '""', "height has no description"),
        ("examples = ({", "other: ClassVar = ({", "examples is empty"),
        ('{"height": 2}', '{"height": 2, "type": "tide"}', "leave 'type' out"),
        ('    """Parameters."""\n', "", "TideSpec has no docstring"),
        ('produces: ClassVar[str] = "NAME:Tide"', "", "produces is empty"),
        ('"NAME:Tide"', '"NAME:TideStage"', "not a dataclass"),
        ("def run(self, ctx)", "def run(self, ctx, extra)", "run does not take the inputs"),
        ("def present", "def show", "has no method present"),
        ('"""A module."""', "import scipy", "importing .* imports numpy"),
    ],
)
def test_a_fault_of_a_plugin_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, old: str, new: str, message: str
) -> None:
    assert old in SOUND
    name = f"faulty_{abs(hash((old, new)))}"
    module, registry = plugin(name, SOUND.replace(old, new, 1), tmp_path, monkeypatch)
    with pytest.raises(ContractViolation, match=message):
        check_plugin(module, registry=registry)


def test_an_example_that_does_not_validate_is_found() -> None:
    class Wrong(Spec):
        """Parameters."""

        examples = ({"count": "many"},)
        count: int = option("how many")

    with pytest.raises(InputError, match=r"Wrong.examples\[0\]: count: "):
        check_spec(Wrong)


def test_nested_specs_are_checked() -> None:
    class Inner(Spec):
        """Parameters."""

        count: int

    class Outer(Spec):
        """Parameters."""

        examples = ({"parts": [{"count": 1}]},)
        parts: tuple[Inner, ...] = option("parts")

    with pytest.raises(ContractViolation, match=r"Inner\.count has no description"):
        check_spec(Outer)


@dataclass(frozen=True)
class First:
    """Made by `Source`."""

    values: Array
    note: str = "x"
    missing: float = math.nan
    pairs: tuple[int, ...] = (1, 2)


class SourceSpec(StageSpec):
    """Parameters."""

    produces: ClassVar[str] = f"{__name__}:First"
    examples = ({},)


class Source:
    """A stage that needs nothing."""

    def __init__(self, spec: SourceSpec) -> None: ...

    def run(self, ctx: RecordingContext) -> First:
        ctx.info("made")
        ctx.track("numbers", 3)(1)
        return First(ctx.rng("a").normal(size=3))

    def present(self, product: First) -> Presentation:
        return Presentation()


class DrainNeeds(Spec):
    """Inputs."""

    one: Ref = need(f"{__name__}:First", "a first")
    many: tuple[Ref, ...] = need(f"{__name__}:First", "several", default=())
    other: Ref | None = need(f"{__name__}:First", "perhaps", default=None)


class DrainSpec(StageSpec):
    """Parameters."""

    produces: ClassVar[str] = f"{__name__}:First"
    examples = ({"needs": {"one": "a", "many": ["b", "c"]}},)
    needs: DrainNeeds = option("inputs")


class Drain:
    """A stage that needs another's product."""

    def __init__(self, spec: DrainSpec) -> None: ...

    def run(
        self, ctx: RecordingContext, one: First, many: tuple[First, ...], other: First | None
    ) -> Any:
        assert other is None
        return One(len(many)) if one.note == "wrong" else First(one.values)

    def present(self, product: First, **inputs: Any) -> Presentation:
        return Presentation()


@dataclass(frozen=True)
class One:
    """Of another class than `First`."""

    count: int


class LonelySpec(Spec):
    """Parameters."""

    examples = ({"friend": "a"},)
    friend: Ref = reference("sensor", "a companion")


class Lonely:
    """Needs another of its kind."""

    def __init__(self, spec: LonelySpec) -> None: ...


class Offer:
    @hookimpl
    def hillsphere_components(self) -> list[Component]:
        """Return the components."""
        here = __name__
        return [
            Component("stage", "source", f"{here}:Source", f"{here}:SourceSpec", "source"),
            Component("stage", "drain", f"{here}:Drain", f"{here}:DrainSpec", "drain"),
            Component("sensor", "lonely", f"{here}:Lonely", f"{here}:LonelySpec", "lonely"),
        ]


@pytest.fixture
def registry(monkeypatch: pytest.MonkeyPatch) -> Registry:
    monkeypatch.setitem(sys.modules, __name__, sys.modules.get(__name__) or _this_module())
    made = Registry(strict=True)
    made.add_plugin("offer", Offer())
    return made


def _this_module() -> ModuleType:
    module = ModuleType(__name__)
    module.__dict__.update(globals())
    return module


def test_a_stage_that_needs_another_is_given_its_product(registry: Registry) -> None:
    source = example("stage", "source", registry=registry).run(RecordingContext())
    assert check_stage("source", registry=registry).values.tolist() == source.values.tolist()
    drained = check_stage("drain", registry=registry)
    assert drained.values.tolist() == source.values.tolist()


def test_a_product_of_the_wrong_class_is_found(registry: Registry) -> None:
    given = {"one": First(np.zeros(1), note="wrong"), "many": (), "other": None}
    with pytest.raises(ContractViolation, match="must yield First, got One"):
        check_stage("drain", inputs=given, registry=registry)


def test_a_product_that_no_stage_yields_is_named(registry: Registry) -> None:
    with pytest.raises(ContractViolation, match="no installed stage yields"):
        example_product(f"{__name__}:One", registry=registry)


def test_a_reference_that_nothing_can_fill_is_named(registry: Registry) -> None:
    with pytest.raises(ContractViolation, match="no other installed component is a sensor"):
        example("sensor", "lonely", registry=registry)


def test_a_product_that_cannot_be_stored_is_found() -> None:
    check_product(First(np.array([1.0, np.nan])))
    with pytest.raises(InputError, match="pairs"):
        check_product(First(np.zeros(1), pairs=[1, 2]))  # type: ignore[arg-type]


def draw(canvas: Canvas, *, labels: bool) -> None:
    axes = canvas.add_subplot()
    axes.plot([0, 1])
    if labels:
        axes.set_xlabel("x / km")


def test_a_sound_presentation_passes() -> None:
    table = Table("T", [Column("x_km", "km"), Column("x_km_paper", "km")], [{"x_km": 1.0}])
    check_presentation(
        Presentation(
            metrics={"count": Metric(3)},
            tables={"table": table},
            figures={"figure": Figure("F", lambda canvas: draw(canvas, labels=True))},
            verdict=["Fine."],
        )
    )


@pytest.mark.parametrize(
    ("shown", "message"),
    [
        (lambda: "text", "must be a Presentation"),
        (lambda: Presentation(metrics={"Big Name": Metric(1)}), "Big Name"),
        (lambda: Presentation(tables={"t": Table("", [], [])}), "has no title"),
        (lambda: Presentation(tables={"t": Table("T", [Column("a")], [{"b": 1}])}), "b"),
        (lambda: Presentation(tables={"t": Table("T", [Column("a_paper")], [])}), "beside no a"),
        (lambda: Presentation(figures={"f": Figure("", lambda canvas: None)}), "has no title"),
        (lambda: Presentation(figures={"f": Figure("F", lambda canvas: None)}), "draws no axes"),
        (
            lambda: Presentation(figures={"f": Figure("F", lambda c: draw(c, labels=False))}),
            "axes without labels",
        ),
        (lambda: Presentation(verdict=[""]), "made of sentences"),
    ],
)
def test_a_fault_of_a_presentation_is_found(shown: Callable[[], Any], message: str) -> None:
    with pytest.raises(ContractViolation, match=message):
        check_presentation(shown())


def test_a_context_without_a_pipeline_has_a_place_and_an_executor(tmp_path: Path) -> None:
    context = RecordingContext(3)
    place = context.workspace()
    assert place.is_dir()
    assert context.workspace() == place
    assert isinstance(context.executor, Serial)
    assert context.executor is context.executor
    assert len(context.fingerprint) == 64
    assert context.fingerprint == RecordingContext(3).fingerprint != RecordingContext(4).fingerprint
    said: list[str] = []

    def note() -> str:
        said.append("note")
        return ""

    context.track("work", 2, note)(1)
    assert said == ["note"]
    del context
    assert not place.exists()
    given = RecordingContext(workspace=tmp_path / "kept", executor=Serial(SerialSpec()))
    assert given.workspace() == tmp_path / "kept"
    assert given.workspace().is_dir()
