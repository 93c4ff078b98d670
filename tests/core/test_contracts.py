"""Contract checks over every registered component, made from the examples of its Spec."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module, metadata
from typing import Any

import numpy as np
import pytest

from hillsphere.interfaces import Array, GuidanceTask
from hillsphere.model.earth.rotation import earth_fixed
from hillsphere.plugins import Registered, Registry, default_registry
from hillsphere.testing import (
    check_case_stage,
    check_compensator,
    check_estimator,
    check_gravity,
    check_guidance,
    check_orbit_family,
    check_plant,
    check_plugin,
    check_sensor,
    check_shape,
    check_spec,
    check_stage,
    check_tracker,
    example,
    examples,
)
from hillsphere.time import Epoch

PLUGINS = [
    "hillsphere.plugins.builtin",
    *(p.value for p in metadata.entry_points(group="hillsphere")),
]
COMPONENTS = [r for r in default_registry() if r.component.kind != "command"]


@pytest.fixture(scope="module", autouse=True)
def _products_of_examples_are_made_once() -> Iterator[None]:
    """Products are frozen: stages that need the same one may share it, as in a mission."""
    make, made = examples.example_product, dict[str, Any]()

    types = {record.component.type for record in default_registry().of_kind("stage")}

    def once(path: str, name: str = "", *, registry: Registry | None = None) -> Any:
        key = f"{path} {name if name in types else ''}"
        if key not in made:
            made[key] = make(path, name, registry=registry)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(examples, "example_product", once)
        yield


def named(record: Registered) -> str:
    return f"{record.component.kind}-{record.component.type}"


def of_kind(kind: str) -> list[tuple[str, int]]:
    """Type and number of every example of every component of a kind."""
    return [
        (record.component.type, number)
        for record in default_registry().of_kind(kind)
        for number in range(len(record.load_spec().examples))
    ]


def directions(count: int, seed: int = 7) -> Array:
    vectors = np.random.default_rng(seed).normal(size=(3, count))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=0))


def outside(model: object, count: int) -> Array:
    """Points two to three times as far out as the largest length that the model declares."""
    spec = getattr(model, "spec", None)
    axes = getattr(model, "semi_axes_m", None)
    sizes = [axes()] if callable(axes) else []
    sizes += [getattr(spec, k) for k in ("reference_radius_m", "length_m") if hasattr(spec, k)]
    size = float(np.max(sizes)) if sizes else 15e3
    reach = 2.0 + np.random.default_rng(8).random(count)
    return directions(count) * size * reach


def test_no_plugin_is_broken() -> None:
    assert default_registry().broken == {}


@pytest.mark.parametrize("name", PLUGINS)
def test_plugin(name: str) -> None:
    check_plugin(import_module(name))


@pytest.mark.parametrize("record", COMPONENTS, ids=named)
def test_spec(record: Registered) -> None:
    check_spec(record.load_spec())


@pytest.mark.parametrize(("type_", "number"), of_kind("gravity"))
def test_gravity(type_: str, number: int) -> None:
    model = example("gravity", type_, number)
    check_gravity(model, outside(model, 30))


@pytest.mark.parametrize(("type_", "number"), of_kind("shape"))
def test_shape(type_: str, number: int) -> None:
    check_shape(example("shape", type_, number), directions(60))


@pytest.mark.parametrize(("type_", "number"), of_kind("plant"))
def test_plant(type_: str, number: int) -> None:
    plant = example("plant", type_, number)
    random = np.random.default_rng(9)
    unit = plant.scales.of(plant.states)[:, None]
    states = random.normal(size=(len(plant.states), 20)) * 0.3 * unit
    # Positions one to two natural lengths out: outside any body, within the plant's range.
    # Several spacecraft follow one another, six states each.
    for first in range(0, len(plant.states) - 5, 6):
        away = directions(20, 7 + first) * plant.scales.length_m
        states[first : first + 3] = away * (1.0 + random.random(20))
    check_plant(plant, states)


@pytest.mark.parametrize(("type_", "number"), of_kind("orbit_family"))
def test_orbit_family(type_: str, number: int) -> None:
    family = example("orbit_family", type_, number)
    unknowns = family.problem[0].unknowns
    # Far out every family of the plants that are shipped tends to its linear motion.
    guess = {"x": [3.0, 2.0], "vy": [-6.1, -4.1], "half_period": [3.0, 2.9], "period": [6.0, 5.8]}
    check_orbit_family(family, np.array([guess.get(name, [0.0, 0.0]) for name in unknowns]))


@pytest.mark.parametrize(("type_", "number"), of_kind("compensator"))
def test_compensator(type_: str, number: int) -> None:
    # Six rows seen, three commanded: a spacecraft near a body.
    law = example("compensator", type_, number)
    check_compensator(law, 6, 3, reacts=type_ != "open_loop")


@pytest.mark.parametrize(("type_", "number"), of_kind("guidance"))
def test_guidance(type_: str, number: int) -> None:
    plant = example("plant", "hill")
    start = np.array([24e3, 5e3, 2e3, 0.0, 0.0, 0.0])
    end = np.array([16e3, 8e3, 1e3]), np.array([-0.3, 0.1, 0.0])
    check_guidance(example("guidance", type_, number), plant, GuidanceTask(start, *end, 7200.0))


@pytest.mark.parametrize(("type_", "number"), of_kind("sensor"))
def test_sensor(type_: str, number: int) -> None:
    # Low orbits all around a body, the Earth or an asteroid, two spacecraft near each other; of
    # the first every station sees some.
    count = 300
    t_s = np.linspace(0.0, 1e5, count)
    x = np.concatenate([directions(count) * 7.5e6, directions(count) * 7e3])
    second = x + np.concatenate([directions(count, 8) * 1e3, np.zeros((3, count))])
    turned = earth_fixed("teme", Epoch.parse("2020-01-01", "UTC"), t_s)
    scene = {
        "earth_fixed": turned,
        "to_body": turned,
        "sun": directions(count, 9) * 1.5e11,
        "boresight": np.stack([-x[:3], -second[:3]]) + directions(count, 10) * 1e4,
        "attitude": np.stack([directions(count, 11), directions(count, 12)]) * 1e-3,
        "origin": np.concatenate([directions(count, 13) * 1.5e11, directions(count, 14) * 2e4]),
        "axes": turned,
        "rate": np.array([[0.0], [0.0], [2e-7]]),
        "earth": np.concatenate([directions(count, 15) * 1.5e11, directions(count, 16) * 3e4]),
        "earth_axes": turned,
    }
    check_sensor(example("sensor", type_, number), np.concatenate([x, second]), t_s, scene)


@pytest.mark.parametrize(("type_", "number"), of_kind("estimator"))
def test_estimator(type_: str, number: int) -> None:
    check_estimator(example("estimator", type_, number))


@pytest.mark.parametrize(("type_", "number"), of_kind("tracker"))
def test_tracker(type_: str, number: int) -> None:
    check_tracker(example("tracker", type_, number), learns=type_ != "table")


# What it needs must belong together, which products of examples do not: its own tests check it.
FITTED = {"tracking_comparison"}


@pytest.mark.parametrize(
    "type_",
    [
        r.component.type
        for r in default_registry().of_kind("stage")
        if r.component.type not in FITTED
    ],
)
def test_stage(type_: str) -> None:
    check_stage(type_)


CASE_STAGES = [
    record.component.type
    for record in default_registry().of_kind("stage")
    if hasattr(record.load_target(), "run_cases")
]
# What the flights of an example need not feel: they do not spend their budget.
INERT = {"closed_loop": ["dv_budget"]}


@pytest.mark.parametrize("type_", CASE_STAGES)
def test_case_stage(type_: str) -> None:
    check_case_stage(type_, inert=INERT.get(type_, []))
