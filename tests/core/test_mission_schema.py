"""The JSON Schema accepts sound missions and refuses what load_mission refuses key by key."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import referencing
from referencing import Resource

from hillsphere.base.paths import missions_directory
from hillsphere.cli.endings import run
from hillsphere.mission import MissionError, load_mission, packaged_missions
from hillsphere.mission.schema import mission_schema, split_schema
from hillsphere.mission.tables import MISSION_KINDS
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
    schema = mission_schema(registry)  # the tests of the command check that it is one
    assert "x-broken" not in schema
    for record in registry:
        component = record.component
        if component.kind not in ("command", "executor", "format"):
            inner = {"$ref": f"#/$defs/{component.kind}.{component.type}", "$defs": schema["$defs"]}
            accepted = jsonschema.Draft202012Validator(inner)  # checked once, as a whole
            for example in record.load_spec().examples:
                accepted.validate(json.loads(json.dumps(example)))
    accepted = jsonschema.Draft202012Validator(schema)
    for name, _ in packaged_missions():
        text = (missions_directory() / f"{name}.toml").read_text()
        accepted.validate(tomllib.loads(text))


def split_validator(documents: dict[str, Any]) -> Any:
    """Make a validator that finds the documents by their names, as files of one folder."""
    resources = [
        (f"file:///schemas/{name}", Resource.from_contents({**document, "$id": f"/schemas/{name}"}))
        for name, document in documents.items()
    ]
    registry: Any = referencing.Registry().with_resources(resources)
    return jsonschema.Draft202012Validator(
        {"$ref": "file:///schemas/mission.schema.json"}, registry=registry
    )


def test_documents_of_the_kinds_judge_as_the_whole_does(toys: Registry, sound_mission: str) -> None:
    documents = json.loads(json.dumps(split_schema(mission_schema(toys))))
    assert set(documents) == {"mission.schema.json", *(f"{k}.schema.json" for k in MISSION_KINDS)}
    for name, document in documents.items():
        jsonschema.Draft202012Validator.check_schema(document)
        assert document["$id"] == name
    judge = split_validator(documents)
    assert judge.is_valid(tomllib.loads(sound_mission))
    for old, new in BAD:
        assert not judge.is_valid(tomllib.loads(sound_mission.replace(old, new, 1))), (old, new)


def test_every_reference_of_a_document_leads_somewhere() -> None:
    documents = split_schema(mission_schema(default_registry()))

    def references(value: Any) -> Iterator[str]:
        if isinstance(value, dict):
            yield from (v for k, v in value.items() if k == "$ref" and isinstance(v, str))
            value = list(value.values())
        if isinstance(value, list):
            for item in value:
                yield from references(item)

    for document in documents.values():
        for reference in references(document):
            name, _, place = reference.partition("#/$defs/")
            assert name in documents if name else place in document["$defs"], reference


def test_folder_of_documents(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new" / "schemas"
    assert run(["schema", "--folder", str(folder)]) == 0
    written = sorted(path.name for path in folder.iterdir())
    assert capsys.readouterr().out.count("\n") == len(written)
    assert json.loads((folder / "stage.schema.json").read_text("utf-8"))["$defs"]
    (tmp_path / "file").write_text("")
    assert run(["schema", "--folder", str(tmp_path / "file")]) == 2
    assert "cannot be written" in capsys.readouterr().err
