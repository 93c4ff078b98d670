"""The JSON Schema accepts sound missions and refuses what load_mission refuses key by key."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from hillsphere.base.paths import missions_directory
from hillsphere.mission import MissionError, load_mission, packaged_missions
from hillsphere.mission.schema import mission_schema
from hillsphere.plugins import Component, Registry, default_registry, hookimpl


@pytest.fixture(scope="module")
def validator(toys: Registry) -> Any:
    """Make a validator of missions of toys."""
    schema = json.loads(json.dumps(mission_schema(toys)))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def test_sound_mission_is_accepted(validator: Any, sound_mission: str) -> None:
    assert list(validator.iter_errors(tomllib.loads(sound_mission))) == []


BAD = [
    ("format = 1", "format = 2"),
    ("format = 1", ""),
    ('name = "toy"', ""),
    ('"toy"', '"a/b"'),
    ('"A mission of toys"', '""'),
    ("seed = 1", "seed = -1"),
    ("seed = 1", "seed = 1.5"),
    ("seed = 1", "seed = 1\nzzz = 1"),
    ("[plant.hill]", "[plant.Hill]"),
    ('"brick"\naxes', '"brik"\naxes'),
    ('type = "brick"\n', ""),
    ("axes_km", "axs_km"),
    ("axes_km", "axes"),
    ("axes_km", "axes_ft"),
    ("density_g_cm3 = 1.860", ""),
    ("density_g_cm3 = 1.860", "density_g_cm3 = 1\ndensity_kg_m3 = 1"),
    ("[13.03, 11.40, 9.14]", '"abc"'),
    ("[13.03, 11.40, 9.14]", "[13.03, 11.40]"),
    ("[13.03, 11.40, 9.14]", "[1, 2, 3, 4]"),
    ("11.40", "-11.40"),
    ("11.40", "true"),
    ("1.860", "31"),
    ("density_g_cm3 = 1.860", 'density_g_cm3 = 1.860\nconvention = "ful"'),
    ("spin_deg = 180", "spin_deg = 180\nspin_rad = 3"),
    ("[100, 50, 30]", "[]"),
    ("[100, 50, 30]", "[100, 0]"),
    ('plant = "hill"', 'plant = "hill"\nsteps = 0'),
    ('plant = "hill"', 'plant = "hill"\nclosed = "no"'),
    ("position_km", "positoin_km"),
    ('{ model = "brick" },', "{ },"),
    ("{ family =", "{ famly ="),
    ('gravity = "heap"', 'gravity = ""'),
    ("[profile.fast]  # line 39\nstage", "[profile.fast]\nstge"),
]


@pytest.mark.parametrize(("old", "new"), BAD)
def test_bad_mission_is_refused_by_both(
    old: str, new: str, validator: Any, tmp_path: Path, toys: Registry, sound_mission: str
) -> None:
    assert old in sound_mission
    text = sound_mission.replace(old, new, 1)
    path = tmp_path / "m.toml"
    path.write_text(text)
    with pytest.raises(MissionError):
        load_mission(path, registry=toys)
    assert not validator.is_valid(tomllib.loads(text))


def test_bounds_are_those_of_the_unit(toys: Registry) -> None:
    brick = mission_schema(toys)["$defs"]["gravity.brick"]["properties"]
    assert brick["density_kg_m3"]["maximum"] == 30e3
    assert brick["density_g_cm3"]["maximum"] == 30.0
    assert brick["density_g_cm3"]["description"] == "its density [g/cm³]"
    assert brick["axes_km"]["prefixItems"][2]["exclusiveMinimum"] == 0


def test_component_with_a_broken_spec_is_named() -> None:
    class Plugin:
        @hookimpl
        def hillsphere_components(self) -> list[Component]:
            return [Component("gravity", "lost", "no_such:Lost", "no_such:LostSpec", "gone")]

    registry = Registry()
    registry.add_plugin("lost-plugin", Plugin())
    schema = mission_schema(registry)
    assert "lost-plugin" in schema["x-broken"]["gravity.lost"]


def test_examples_and_packaged_missions_are_accepted() -> None:
    registry = default_registry()
    schema = mission_schema(registry)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert "x-broken" not in schema
    for record in registry:
        component = record.component
        if component.kind not in ("command", "executor"):
            inner = {"$ref": f"#/$defs/{component.kind}.{component.type}", "$defs": schema["$defs"]}
            accepted = jsonschema.Draft202012Validator(inner)  # checked once, as a whole
            for example in record.load_spec().examples:
                accepted.validate(json.loads(json.dumps(example)))
    accepted = jsonschema.Draft202012Validator(schema)
    for name, _ in packaged_missions():
        text = (missions_directory() / f"{name}.toml").read_text()
        accepted.validate(tomllib.loads(text))
