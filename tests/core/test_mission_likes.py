"""Tables that begin as a copy of another one, and tables that a profile or a setting drops."""

from __future__ import annotations

import inspect
import sys
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from hillsphere.mission import Mission, MissionError, load_mission
from hillsphere.mission.schema import mission_schema
from hillsphere.plugins import Registry


@pytest.fixture
def load(tmp_path: Path, toys: Registry, sound_mission: str) -> Any:
    """Load the sound mission with more text at its end, line 46 and on."""

    def load(added: str = "", **options: Any) -> Mission:
        path = tmp_path / "m.toml"
        path.write_text(f"{sound_mission}\n\n{added}")
        return load_mission(path, registry=toys, **options)

    return load


@pytest.fixture
def problems(load: Any, tmp_path: Path) -> Any:
    """Return the problems of such a mission, as text without the directory."""

    def problems(added: str = "", **options: Any) -> list[str]:
        with pytest.raises(MissionError) as caught:
            load(added, **options)
        return [str(p).replace(f"{tmp_path}/", "") for p in caught.value.problems]

    return problems


def test_copy_is_merged_with_what_the_table_says(load: Any) -> None:
    mission = load(
        '[gravity.small]\nlike = "brick"\naxes_km = [1, 1, 1]\n'
        '[stage.two]\nlike = "resonances"\nvertical = ["1:9"]\n'
        '[stage.more]\nlike = "two"\nneeds = { family = "third" }\n'
        '[stage.third]\nlike = "family"\n'
    )
    small = mission.specs["gravity"]["small"]
    assert small.axes_m == (1000.0, 1000.0, 1000.0)
    assert small.density_kg_m3 == mission.specs["gravity"]["brick"].density_kg_m3
    more = mission.specs["stage"]["more"]
    assert more.vertical == ("1:9",)  # of the chain, replaced whole
    assert more.needs.family.name == "third"
    assert mission.specs["stage"]["two"].needs.family.name == "family"
    assert mission.specs["stage"]["third"] == mission.specs["stage"]["family"]
    assert list(mission.specs["stage"]) == ["family", "resonances", "two", "more", "third"]
    assert "like" not in mission.resolved()["stage"]["more"]


def test_profile_and_settings_of_the_base_reach_the_copy_unless_it_says_otherwise(
    load: Any,
) -> None:
    added = (
        '[stage.a]\nlike = "family"\n'
        '[stage.b]\nlike = "family"\nx_amplitudes_km = [7]\n'
        '[stage.c]\nlike = "family"\n'
        "[profile.third]\nstage.c.x_amplitudes_km = [3]\n"
        "stage.family.x_amplitudes_km = [4]\n"
    )

    def amplitudes(**options: Any) -> list[float]:
        stages = load(added, **options).specs["stage"]
        return [stages[name].x_amplitudes_m[0] / 1e3 for name in ("family", "a", "b", "c")]

    assert amplitudes() == [100, 100, 7, 100]
    assert amplitudes(profile="third") == [4, 4, 7, 3]
    sets = ["stage.family.x_amplitudes_m=[5000]"]  # another unit
    assert amplitudes(profile="third", sets=sets) == [5, 5, 7, 3]
    assert amplitudes(sets=["stage.a.x_amplitudes_m=[6000]"]) == [100, 6, 7, 100]


def test_other_unit_supersedes_that_of_the_base(load: Any, problems: Any) -> None:
    added = '[gravity.small]\nlike = "brick"\naxes_m = [1, 2, 3]\n'
    assert load(added).specs["gravity"]["small"].axes_m == (1.0, 2.0, 3.0)
    # the copy's own value holds before a setting of the base in its unit
    made = load(added, sets=["gravity.brick.axes_m=[9, 9, 9]"])
    assert made.specs["gravity"]["small"].axes_m == (1.0, 2.0, 3.0)
    (told,) = problems(f"{added}axes_cm = [1, 2, 3]\n")
    assert told.startswith("m.toml:49: gravity.small.axes_cm: axes_m and axes_cm say the same")


def test_setting_may_add_a_copy(load: Any) -> None:
    mission = load(sets=["stage.again.like=family", "stage.again.x_amplitudes_km=[9]"])
    assert mission.specs["stage"]["again"].x_amplitudes_m == (9000.0,)


@pytest.mark.parametrize(
    ("added", "expected"),
    [
        (
            '[stage.a]\nlike = "famly"\n',
            "m.toml:47: stage.a.like: no stage table is named 'famly'; did you mean 'family'?",
        ),
        (
            '[stage.a]\nlike = "brick"\n',
            "m.toml:47: stage.a.like: no stage table is named 'brick'; there is gravity.brick, "
            "but a table can only be like one of its own kind",
        ),
        (
            '[stage.a]\nlike = "stage.family"\n',
            "m.toml:47: stage.a.like: no stage table is named 'stage.family'; write the name "
            "alone, 'family'",
        ),
        (
            "[stage.a]\nlike = 3\n",
            "m.toml:47: stage.a.like: expected the name of another stage table, got 3",
        ),
        ('[stage.a]\nlike = "a"\n', "m.toml:47: stage.a.like: goes in a circle: a → a"),
        (
            '[stage.a]\nlike = "b"\n[stage.b]\nlike = "c"\n[stage.c]\nlike = "b"\n',
            "m.toml:51: stage.c.like: goes in a circle: b → c → b",
        ),
        (
            '[stage.a]\nlike = "family"\ntype = "resonances"\n',
            "m.toml:48: stage.a.type: it is like 'family', whose type is a string 'family', and "
            "cannot be of another; got a string 'resonances'",
        ),
    ],
)
def test_like_that_leads_nowhere(problems: Any, added: str, expected: str) -> None:
    assert problems(added) == [expected]


def test_value_is_faulted_where_it_was_written(problems: Any) -> None:
    added = (
        '[stage.a]\nlike = "family"\nplant = 5\n'  # line 48
        '[stage.b]\nlike = "a"\nx_amplitudes_km = [1]\n'
    )
    # in the base, told once
    told = problems(added)
    assert len(told) == 1
    assert told[0].startswith("m.toml:48: stage.a.plant: ")
    # the base is dropped: who suffers is named
    (told,) = problems(added, sets=["stage.a=false"])
    assert told.startswith("m.toml:48: stage.a.plant: ")
    assert told.endswith("(in stage.b, which is like it)")
    # the copy's own, and what nobody has said
    told = problems('[gravity.a]\nlike = "heap"\nparts = [{ model = "nope" }]\n')
    assert len(told) == 1
    assert told[0].startswith("m.toml:48: gravity.a.parts[0].model: no gravity table")
    told = problems('[gravity.a]\ntype = "brick"\n[gravity.b]\nlike = "a"\n')
    assert {text.split(": ")[0] for text in told} == {"m.toml:46", "m.toml:48"}
    # of a setting of the base
    (told,) = problems('[stage.a]\nlike = "family"\n', sets=["stage.family.plant=hell"])
    assert told.startswith("--set stage.family.plant=…: stage.family.plant: no plant table")


def test_dropped_table_is_not_part_of_the_mission(load: Any) -> None:
    added = "[profile.short]\nstage.resonances = false\n"
    assert list(load(added).specs["stage"]) == ["family", "resonances"]
    assert list(load(added, profile="short").specs["stage"]) == ["family"]
    assert list(load(sets=["stage.resonances=false"]).specs["stage"]) == ["family"]
    again = load(added, profile="short", sets=["stage.resonances=true"])
    assert list(again.specs["stage"]) == ["family", "resonances"]


def test_dropped_base_still_serves(load: Any) -> None:
    added = '[stage.a]\nlike = "family"\n[profile.p]\nstage.family.x_amplitudes_km = [2]\n'
    sets = ["stage.family=false", "stage.resonances=false"]
    mission = load(added, profile="p", sets=sets)
    assert list(mission.specs["stage"]) == ["a"]
    assert mission.specs["stage"]["a"].x_amplitudes_m == (2000.0,)
    # a setting of it changes the copy, too
    mission = load(added, sets=[*sets, "stage.family.x_amplitudes_km=[8]"])
    assert mission.specs["stage"]["a"].x_amplitudes_m == (8000.0,)


@pytest.mark.parametrize(
    ("added", "options", "expected"),
    [
        (
            "[profile.p]\nstage.family = false\n",
            {"profile": "p"},
            "m.toml:36: stage.resonances.needs.family: stage table 'family' is dropped at "
            "m.toml:47; drop this stage too, or change the key",
        ),
        (
            "",
            {"sets": ["gravity.heap=false"]},
            "m.toml:26: plant.hill.gravity: gravity table 'heap' is dropped at --set "
            "gravity.heap=…; drop this plant too, or change the key",
        ),
        (
            "",
            {"sets": ["stage.resonance=false"]},
            "--set stage.resonance=…: stage.resonance: there is no table stage.resonance to drop; "
            "did you mean 'resonances'?",
        ),
        (
            "",
            {"sets": ["stage.resonances=false", 'stage.resonances.vertical=["1:3"]']},
            "--set stage.resonances.vertical=…: stage.resonances: this table is dropped at --set "
            "stage.resonances=…; --set stage.resonances=true takes it back",
        ),
        (
            "",
            {"sets": ["stage.family=false", "stage.resonances=false"]},
            "m.toml: nothing to run; a mission has at least one [stage.NAME]",
        ),
    ],
)
def test_dropped_table_that_is_needed(
    problems: Any, added: str, options: dict[str, Any], expected: str
) -> None:
    assert problems(added, **options) == [expected]


def test_false_in_the_file_itself_drops_nothing(
    tmp_path: Path, toys: Registry, sound_mission: str
) -> None:
    path = tmp_path / "m.toml"
    path.write_text("stage.odd = false\n" + sound_mission)
    with pytest.raises(MissionError, match=r"1: stage\.odd: expected a table \[stage\.NAME\], got"):
        load_mission(path, registry=toys)


def test_long_chain_needs_no_recursion(load: Any) -> None:
    # Python's own limit is 1000 calls; a lower one needs a chain that is no longer than it.
    links = [f'[stage.s{k}]\nlike = "s{k - 1}"\n' for k in range(400, 0, -1)]
    text = '[stage.s0]\nlike = "family"\n' + "".join(links)
    load('[stage.s0]\nlike = "family"\n')  # imports, which are deep
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack(0)) + 300)
    try:
        mission = load(text)
    finally:
        sys.setrecursionlimit(limit)
    assert mission.specs["stage"]["s400"] == mission.specs["stage"]["family"]


def test_schema_knows_like(toys: Registry) -> None:
    validator = jsonschema.Draft202012Validator(mission_schema(toys))

    def sound(table: dict[str, Any]) -> bool:
        mission = {"format": 1, "name": "m", "title": "t", "seed": 1, "stage": {"a": table}}
        return bool(validator.is_valid(mission))

    assert sound({"like": "family"})
    assert sound({"like": "family", "type": "family", "x_amplitudes_km": [1]})
    assert not sound({"like": 3})
    assert not sound({"x_amplitudes_km": [1]})
    assert not sound({"like": "family", "type": "famly"})
