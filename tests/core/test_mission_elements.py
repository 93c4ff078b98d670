"""Arrays of tables that are written as tables of named elements."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from hillsphere.mission import Mission, MissionError, load_mission
from hillsphere.mission.schema import mission_schema
from hillsphere.plugins import Registry

PILE = """\
[gravity.pile]
type = "heap"
[gravity.pile.parts]
low = { model = "brick" }
high = { model = "brick", position_km = [0, 0, 2] }
side = { like = "high", position_m = [5, 0, 0] }
"""  # lines 46 to 51


@pytest.fixture
def load(tmp_path: Path, toys: Registry, sound_mission: str) -> Any:
    """Load the sound mission with more text at its end, line 46 and on."""

    def load(added: str = PILE, **options: Any) -> Mission:
        path = tmp_path / "m.toml"
        path.write_text(f"{sound_mission}\n\n{added}")
        return load_mission(path, registry=toys, **options)

    return load


@pytest.fixture
def problems(load: Any, tmp_path: Path) -> Any:
    """Return the problems of such a mission, as text without the directory."""

    def problems(added: str = PILE, **options: Any) -> list[str]:
        with pytest.raises(MissionError) as caught:
            load(added, **options)
        return [str(p).replace(f"{tmp_path}/", "") for p in caught.value.problems]

    return problems


def parts(mission: Mission, name: str = "pile") -> list[tuple[str, tuple[float, ...]]]:
    """Return name and position of the parts of a heap, m."""
    return [(part.name, part.position_m) for part in mission.specs["gravity"][name].parts]  # type: ignore[attr-defined]


LOW, HIGH = ("low", (0.0, 0.0, 0.0)), ("high", (0.0, 0.0, 2000.0))
SIDE = ("side", (5.0, 0.0, 0.0))


def test_elements_stand_in_their_order_and_have_their_names(load: Any) -> None:
    mission = load()
    assert parts(mission) == [LOW, HIGH, SIDE]
    written = mission.resolved()["gravity"]["pile"]["parts"]
    assert [part["name"] for part in written] == ["low", "high", "side"]
    assert all(part["model"] == "brick" and "like" not in part for part in written)


def test_element_may_give_another_name_which_copies_do_not_take(load: Any) -> None:
    added = PILE.replace("2] }", '2], name = "top" }')
    assert [name for name, _ in parts(load(added))] == ["low", "top", "side"]


def test_unit_of_a_copy_supersedes_that_of_its_base(load: Any) -> None:
    assert parts(load(PILE.replace("position_m = [5", "position_cm = [500")))[2] == SIDE
    sets = ["gravity.pile.parts.side.position_km=[1,0,0]"]
    assert parts(load(sets=sets))[2] == ("side", (1000.0, 0.0, 0.0))


def test_profile_setting_and_like_reach_single_elements(load: Any) -> None:
    added = (
        f'{PILE}[gravity.more]\nlike = "pile"\nparts.low.position_m = [1, 1, 1]\n'
        'parts.new = { model = "ball" }\n'
        '[gravity.ball]\ntype = "ball"\ngm_km3_s2 = 1\n'
        "[profile.p]\ngravity.pile.parts.high.position_km = [0, 0, 3]\n"
    )
    moved = ("low", (1.0, 1.0, 1.0))
    new = ("new", (0.0, 0.0, 0.0))
    assert parts(load(added), "more") == [moved, HIGH, SIDE, new]
    up = ("high", (0.0, 0.0, 3000.0))
    assert parts(load(added, profile="p"), "more") == [moved, up, SIDE, new]
    sets = ["gravity.pile.parts.low.model=ball"]
    assert load(added, sets=sets).specs["gravity"]["more"].parts[0].model.name == "ball"


def test_array_replaces_elements_and_elements_an_array(load: Any) -> None:
    added = f'{PILE}[gravity.few]\nlike = "pile"\nparts = [{{ model = "brick" }}]\n'
    assert parts(load(added), "few") == [("", (0.0, 0.0, 0.0))]
    added = f'{PILE}[profile.p]\ngravity.heap.parts.one = {{ model = "brick" }}\n'
    assert parts(load(added, profile="p"), "heap") == [("one", (0.0, 0.0, 0.0))]


def test_false_leaves_an_element_out(load: Any) -> None:
    added = f'{PILE}[gravity.few]\nlike = "pile"\nparts.low = false\n[profile.p]\n'
    added += "gravity.pile.parts.side = false\n"
    mission = load(added, profile="p")
    assert parts(mission) == [LOW, HIGH]
    assert parts(mission, "few") == [HIGH]
    assert parts(load(sets=["gravity.pile.parts.low=false"])) == [HIGH, SIDE]


def test_element_that_is_left_out_still_serves_what_is_like_it(load: Any) -> None:
    added = f'{PILE}[gravity.few]\nlike = "pile"\nparts.side.like = "low"\nparts.low = false\n'
    added += '[gravity.one]\nlike = "few"\nparts.high.position_m = [1, 1, 1]\n[profile.p]\n'
    added += 'gravity.one.parts.high = false\ngravity.one.parts.side.like = "high"\n'
    assert parts(load(added), "few") == [HIGH, SIDE]
    assert parts(load(added, profile="p"), "one") == [SIDE]
    bare = added.replace(", position_m = [5, 0, 0]", "")
    assert parts(load(bare), "few") == [HIGH, ("side", (0.0, 0.0, 0.0))]
    assert parts(load(bare, profile="p"), "one") == [("side", (1.0, 1.0, 1.0))]
    # the value of a table with `for` stands in it, too
    each = "[each]\nsize = [1, 2]\n" + PILE.replace("type", 'for = "size"\ntype')
    each = each.replace("[0, 0, 2]", '["{size}", 0, 0]').replace(", position_m = [5, 0, 0]", "")
    for name in ("pile", "pile_2"):
        mission = load(each, sets=[f"gravity.{name}.parts.high=false"])
        assert parts(mission, "pile_2") == [LOW, ("side", (2000.0, 0.0, 0.0))]


def test_elements_of_a_table_with_for(load: Any) -> None:
    added = (
        "[each]\nsize = [1, 2]\n"
        + PILE.replace("type", 'for = "size"\ntype').replace("[5,", '["{size}",')
        + "[gravity.pile_2.parts]\nhigh.position_km = [0, 0, 4]\nlow = false\n"
    )
    mission = load(added)
    assert parts(mission, "pile_1") == [LOW, HIGH, ("side", (1.0, 0.0, 0.0))]
    assert parts(mission, "pile_2") == [("high", (0.0, 0.0, 4000.0)), ("side", (2.0, 0.0, 0.0))]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            '{ model = "brick" }',
            "3",
            "49: gravity.pile.parts.low: expected a table, or false to leave it out; got 3",
        ),
        (
            '{ model = "brick" }',
            "true",
            "49: gravity.pile.parts.low: expected a table, or false to leave it out; got true",
        ),
        (
            "low = {",
            "hihg = false\nlow = {",
            "49: gravity.pile.parts.hihg: there is no element 'hihg' to leave out; did you mean "
            "'high'?",
        ),
        (
            'like = "high"',
            'like = "hihg"',
            "51: gravity.pile.parts.side.like: no element is named 'hihg'; did you mean 'high'?",
        ),
        (
            'like = "high"',
            "like = 3",
            "51: gravity.pile.parts.side.like: expected the name of another element, got 3",
        ),
        (
            'like = "high"',
            'like = "side"',
            "51: gravity.pile.parts.side.like: goes in a circle: side → side",
        ),
        (
            'model = "brick", position_km = [0',
            'like = "side", position_km = [0',
            "51: gravity.pile.parts.side.like: goes in a circle: high → side → high",
        ),
        (
            "high = {",
            "high_above_all = {",
            "51: gravity.pile.parts.side.like: no element is named 'high'; there are: low",
        ),
    ],
)
def test_fault_of_an_element_is_told_at_its_line(
    problems: Any, old: str, new: str, expected: str
) -> None:
    assert old in PILE
    told = problems(PILE.replace(old, new, 1))
    assert f"m.toml:{expected}" in told[0] or f"m.toml:{expected}" in told[-1]


def test_fault_in_an_element_names_the_element_that_holds_it(problems: Any) -> None:
    # its own key, and one that its copy has from it: told once
    assert problems(PILE.replace("[0, 0, 2]", "[0, 0]")) == [
        "m.toml:50: gravity.pile.parts.high.position_km: expected three numbers, got [0, 0]"
    ]
    (told,) = problems(PILE.replace("[5, 0, 0]", "3"))
    assert told.startswith("m.toml:51: gravity.pile.parts.side.position_m: expected three numbers")
    # a reference that leads nowhere, after an element that is left out
    added = PILE.replace('{ model = "brick", ', '{ model = "brik", ')
    (told,) = problems(f"{added}[profile.p]\ngravity.pile.parts.low = false\n", profile="p")
    assert told.startswith("m.toml:50: gravity.pile.parts.high.model: no gravity table is named")
    # a missing key, and one that does not exist
    (told,) = problems(PILE.replace('{ model = "brick" }', "{}"))
    assert told == "m.toml:49: gravity.pile.parts.low.model: missing: model: the model"
    (told,) = problems(PILE.replace('like = "high", position_m', 'like = "high", positoin_m'))
    assert told.startswith("m.toml:51: gravity.pile.parts.side.positoin_m: unknown key 'positoin_m")
    # a name that is too long, and a key twice in different units
    (told,) = problems(PILE.replace("side", "side_of_all"))
    assert told.startswith("m.toml:51: gravity.pile.parts.side_of_all.name: must have at most 8")
    (told,) = problems(PILE.replace("position_m =", "position_cm = [1, 1, 1], position_m ="))
    assert "gravity.pile.parts.side.position_" in told
    assert "say the same thing" in told


def test_fault_in_a_copied_table_names_its_user(problems: Any) -> None:
    added = f'{PILE.replace("[0, 0, 2]", "3")}[gravity.more]\nlike = "pile"\n'
    (told,) = problems(f"{added}parts.high.model = 7\n")[-1:]
    assert told == (
        "m.toml:54: gravity.more.parts.high.model: must be the name of another table, got 7"
    )
    (told,) = problems(added, sets=["gravity.pile=false"])
    assert told.startswith("m.toml:50: gravity.pile.parts.high.position_km: expected three numbers")
    assert told.endswith("(in gravity.more, which is like it)")
    (told,) = problems(PILE, sets=["gravity.pile.parts.high.position_km=3"])
    assert told.startswith("--set gravity.pile.parts.high.position_km=…: gravity.pile.parts.high")


def test_items_of_an_array_are_set_whole(problems: Any) -> None:
    (told,) = problems(sets=["gravity.heap.parts.one.model=brick"])
    assert told.endswith("gravity.heap.parts is an array; set it whole")


def test_copies_do_not_grow_without_limit(problems: Any) -> None:
    long = f'model = "{5000 * "a"}"'
    added = PILE.replace('model = "brick", ', f"{long}, ")
    added += "".join(f'a{k} = {{ like = "high" }}\n' for k in range(20))
    (told,) = problems(added)
    assert told == (
        "m.toml:48: gravity.pile.parts: its elements copy 105168 values and characters by `like`, "
        "at most 65536"
    )


def test_schema_knows_named_elements(toys: Registry, sound_mission: str) -> None:
    validator = jsonschema.Draft202012Validator(mission_schema(toys))

    def is_sound(added: str) -> bool:
        return bool(validator.is_valid(tomllib.loads(f"{sound_mission}\n{added}")))

    assert is_sound(PILE)
    assert is_sound(f"{PILE}more = false\n")
    for bad in (
        PILE.replace("position_m", "positoin_m"),
        PILE.replace('like = "high"', "like = 3"),
        PILE.replace("[5, 0, 0]", "[5, 0]"),
        f"{PILE}more = true\n",
    ):
        assert not is_sound(bad)
