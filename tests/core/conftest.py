"""A small registry of toy components and a sound mission for them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Literal

import pytest

from hillsphere.errors import InputError
from hillsphere.plugins import Component, Registry, default_registry, hookimpl
from hillsphere.spec import (
    DataPath,
    Ref,
    Spec,
    StageSpec,
    Vector3,
    data_path,
    need,
    option,
    quantity,
    reference,
)


def forget_plugin_files() -> None:
    """Leave this process as one that has not loaded a plugin file yet."""
    module = sys.modules.get("hillsphere.plugins.plugin_files")
    if module is None or not module._loaded:
        return
    for name in list(module._loaded):
        sys.modules.pop(name, None)
    module._loaded.clear()
    default_registry.cache_clear()


@pytest.fixture(autouse=True)
def without_plugin_files() -> Iterator[None]:
    """Unload plugin files after a test: they would be in registry, keys and records of the next."""
    yield
    forget_plugin_files()


class BallSpec(Spec):
    """A ball."""

    examples = ({"gm_km3_s2": 1.0},)
    gm_m3_s2: float = quantity("gravitational_parameter", "its attraction", gt=0)


class BrickSpec(Spec):
    """A brick."""

    examples = ({"axes_km": [3, 2, 1], "density_g_cm3": 2},)
    axes_m: Vector3 = quantity("length", "semi-axes along x, y, z", gt=0)
    density_kg_m3: float = quantity("density", "its density", gt=0, le=30e3)
    convention: Literal["full", "none"] = option("normalisation", default="full")


class PartSpec(Spec):
    """A part of a heap."""

    examples = ({"model": "ball"},)
    model: Ref = reference("gravity", "the model")
    position_m: Vector3 = quantity("length", "where it is", default=(0.0, 0.0, 0.0))
    name: str = option("name of the part", default="", max_length=8)


class HeapSpec(Spec):
    """Several models."""

    examples = ({"parts": [{"model": "ball"}]},)
    parts: tuple[PartSpec, ...] = option("the models", min_length=1)


class FileSpec(Spec):
    """Coefficients from a file."""

    examples = ({"file": "toy.csv"},)
    file: DataPath = data_path("the coefficients")


class HillSpec(Spec):
    """Equations of motion."""

    examples = ({"body": "moon", "gravity": "ball"},)
    body: Ref = reference("body", "what it moves about")
    gravity: Ref = reference("gravity", "what attracts it")
    spin_rad: float = quantity("angle", "phase of the body", default=0.0)


class FamilySpec(StageSpec):
    """Orbits."""

    produces = "toy_products:Family"
    examples = ({"plant": "hill", "x_amplitudes_km": [100, 50]},)
    plant: Ref = reference("plant", "the equations of motion")
    x_amplitudes_m: tuple[float, ...] = quantity("length", "amplitudes", gt=0, min_length=1)
    steps: int = option("number of steps", default=100, ge=1)
    closed: bool = option("whether the family is closed", default=True)


class ResonancesNeeds(Spec):
    """What it takes."""

    examples = ({"family": "family"},)
    family: Ref = need("toy_products:Family", "the family")
    earlier: Ref | None = need("toy_products:Resonances", "to continue from", default=None)


class ResonancesSpec(StageSpec):
    """Resonances."""

    produces = "toy_products:Resonances"
    examples = ({"needs": {"family": "family"}, "vertical": ["1:17"]},)
    needs: ResonancesNeeds = option("what it takes")
    vertical: tuple[str, ...] = option("resonances d:n", default=())


class Toy:
    """A component that remembers its Spec and counts how often it was made."""

    made = 0

    def __init__(self, spec: Spec) -> None:
        type(self).made += 1
        self.spec = spec


class Picky:
    """A component that refuses its Spec."""

    def __init__(self, spec: Spec) -> None:
        raise InputError("the file has no coefficients")


class ToyPlugin:
    """The plugin of the toys."""

    @hookimpl
    def hillsphere_components(self) -> list[Component]:
        """Return the toys."""
        here = __name__
        table = [
            ("gravity", "ball", "Toy", "BallSpec"),
            ("gravity", "brick", "Toy", "BrickSpec"),
            ("gravity", "heap", "Toy", "HeapSpec"),
            ("gravity", "file", "Picky", "FileSpec"),
            ("plant", "hill", "Toy", "HillSpec"),
            ("stage", "family", "Toy", "FamilySpec"),
            ("stage", "resonances", "Toy", "ResonancesSpec"),
            ("sensor", "lost", "Toy", "NoSuchSpec"),
        ]
        return [
            Component(kind, type_, f"{here}:{target}", f"{here}:{spec}", f"a toy {type_}")
            for kind, type_, target, spec in table
        ]


SOUND = """\
format = 1
name = "toy"
title = "A mission of toys"
seed = 1

[body.moon]
type = "moon"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9377.0

[gravity.brick]  # line 11
type = "brick"
axes_km = [13.03, 11.40, 9.14]
density_g_cm3 = 1.860

[gravity.heap]
type = "heap"
parts = [
    { model = "brick" },
    { model = "brick", position_km = [1, 0, 0] },
]

[plant.hill]  # line 23
type = "hill"
body = "moon"
gravity = "heap"
spin_deg = 180

[stage.family]  # line 29
type = "family"
plant = "hill"
x_amplitudes_km = [100, 50, 30]

[stage.resonances]  # line 34
type = "resonances"
needs = { family = "family" }
vertical = ["1:17", "1:22"]

[profile.fast]  # line 39
stage.family.x_amplitudes_km = [100]

[profile.heavy]  # line 42
gravity.brick.density_kg_m3 = 3000.0
"""


@pytest.fixture(scope="session")
def toys() -> Registry:
    """Registry of the toys and of the core's own components."""
    from hillsphere.plugins import builtin as components

    registry = Registry()
    registry.add_plugin("hillsphere", components)
    registry.add_plugin("toys", ToyPlugin())
    assert not registry.broken
    return registry


@pytest.fixture(scope="session")
def sound_mission() -> str:
    """Text of a mission of toys that is sound."""
    return SOUND
