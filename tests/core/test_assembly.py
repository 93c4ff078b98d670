"""Components of a mission: made once, references injected, errors located."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hillsphere.errors import InputError
from hillsphere.mission import Mission, load_mission
from hillsphere.plugins import Registry
from hillsphere.runs.assembly import Assembly, build
from hillsphere.show.reference import ReferenceTable


def _mission(path: Path, toys: Registry, text: str) -> Mission:
    path.write_text(text)
    return load_mission(path, registry=toys)


def test_references_are_injected_and_made_once(
    tmp_path: Path, toys: Registry, sound_mission: str
) -> None:
    mission = _mission(tmp_path / "m.toml", toys, sound_mission)
    assembly = Assembly(mission)
    hill: Any = assembly.get("plant", "hill")
    heap = hill.spec.gravity.get()
    first, second = (part.model.get() for part in heap.spec.parts)
    assert first is second is assembly.get("gravity", "brick")
    made = type(hill).made
    assert assembly.get("stage", "family").spec.plant.get() is hill
    assert assembly.get("plant", "hill") is hill
    assert type(hill).made == made + 1
    assert hill.spec.body.get().name == "body"
    assert build(mission, "plant", "hill") is not hill


def test_needs_of_a_stage_stay_unbound(tmp_path: Path, toys: Registry, sound_mission: str) -> None:
    mission = _mission(tmp_path / "m.toml", toys, sound_mission)
    stage = Assembly(mission).get("stage", "resonances")
    assert stage.spec.needs.family.name == "family"
    with pytest.raises(RuntimeError, match="not bound"):
        stage.spec.needs.family.get()


def test_refusal_of_a_component_names_its_table(
    tmp_path: Path, toys: Registry, sound_mission: str
) -> None:
    (tmp_path / "c.csv").write_text("")
    text = sound_mission + '[gravity.file]\ntype = "file"\nfile = "c.csv"\n'
    mission = _mission(tmp_path / "m.toml", toys, text)
    with pytest.raises(InputError) as caught:
        build(mission, "gravity", "file")
    assert str(caught.value) == (
        f"{tmp_path}/m.toml:44: gravity.file: the file has no coefficients"
    )


def test_long_chain_is_built_without_recursion(
    tmp_path: Path, toys: Registry, sound_mission: str
) -> None:
    n = 3000
    links = "".join(
        f'[gravity.h{i}]\ntype = "heap"\nparts = [{{ model = "h{i + 1}" }}]\n' for i in range(n)
    )
    text = sound_mission.replace('gravity = "heap"', 'gravity = "h0"') + links
    text += f'[gravity.h{n}]\ntype = "ball"\ngm_m3_s2 = 1\n'
    mission = _mission(tmp_path / "m.toml", toys, text)
    hill: Any = Assembly(mission).get("stage", "family").spec.plant.get()
    assert hill.spec.gravity.name == "h0"


def _unreadable(path: Path) -> Exception:
    path.write_bytes(bytes(range(256)))
    with pytest.raises(InputError) as caught:
        ReferenceTable.read(path)
    return caught.value


@pytest.mark.parametrize(
    ("error", "key"),
    [
        (_unreadable, ".file"),
        (lambda path: InputError(f"{path}:3: not a number"), ".file"),
        (lambda path: InputError(f"{path} does not state gm_m3_s2"), ".file"),
        (lambda path: FileNotFoundError(2, "No such file", str(path)), ".file"),
        (lambda _: FileNotFoundError(2, "No such file", "/other"), ""),
        (lambda _: InputError("c.csvx: not a number"), ""),
        (lambda _: InputError("max_degree is beyond c.csv: 3"), ""),
    ],
)
def test_fault_of_an_input_file_names_the_key_that_names_the_file(
    error: Callable[[Path], Exception],
    key: str,
    tmp_path: Path,
    toys: Registry,
    sound_mission: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file = tmp_path / "c.csv"
    file.write_text("")
    raised = error(file)

    def refuse(self: object, spec: object) -> None:
        raise raised

    text = sound_mission + '[gravity.file]\ntype = "file"\nfile = "c.csv"\n'
    mission = _mission(tmp_path / "m.toml", toys, text)
    monkeypatch.setattr(mission.components["gravity"]["file"].load_target(), "__init__", refuse)
    with pytest.raises(InputError) as caught:
        build(mission, "gravity", "file")
    line = 46 if key else 44
    assert str(caught.value) == f"{tmp_path}/m.toml:{line}: gravity.file{key}: {raised}"
