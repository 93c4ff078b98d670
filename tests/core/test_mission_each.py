"""Tables that stand for several (`for` over the lists of ``[each]``), and patterns that `drop`."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from hillsphere.mission import Mission, MissionError, load_mission
from hillsphere.mission.schema import mission_schema
from hillsphere.plugins import Registry

EACH = '[each]\nsize = ["one", "two", 3]\n'  # lines 46 and 47
LINE = 48


@pytest.fixture
def load(tmp_path: Path, toys: Registry, sound_mission: str) -> Any:
    """Load the sound mission with lists and more text at its end, line 48 and on."""

    def load(added: str = "", each: str = EACH, top: str = "", **options: Any) -> Mission:
        path = tmp_path / "m.toml"
        path.write_text(f"{top}{sound_mission}\n\n{each}{added}")
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


ORBITS = '[stage.orbits]\nfor = "size"\ntype = "family"\nplant = "hill"\nx_amplitudes_km = [5]\n'


def amplitudes(mission: Mission, *names: str) -> list[float]:
    """Return the first amplitude of stages, km."""
    return [mission.specs["stage"][name].x_amplitudes_m[0] / 1e3 for name in names]  # type: ignore[attr-defined]


ALL = ("orbits_one", "orbits_two", "orbits_3")


def test_table_stands_for_one_per_value(load: Any) -> None:
    mission = load(ORBITS)
    assert list(mission.specs["stage"]) == ["family", "resonances", *ALL]
    assert amplitudes(mission, *ALL) == [5, 5, 5]
    assert "each" not in mission.resolved()
    assert "for" not in mission.resolved()["stage"]["orbits_3"]


def test_variables_are_replaced_in_strings(load: Any) -> None:
    added = (
        f"{ORBITS}"
        '[stage.found]\nfor = "size"\ntype = "resonances"\n'
        'needs = { family = "orbits_{size}" }\nvertical = ["{size}:17", "{{{size}}}", "{{size}}"]\n'
    )
    spec = load(added).specs["stage"]["found_3"]
    assert spec.needs.family.name == "orbits_3"
    assert spec.vertical == ("3:17", "{3}", "{size}")


def test_string_that_is_the_variable_alone_takes_its_type(load: Any, problems: Any) -> None:
    each = "[each]\nsize = [4, 2.5]\n"
    added = (
        '[stage."orbits_{size}_km"]\nfor = "size"\ntype = "family"\nplant = "hill"\n'
        'x_amplitudes_km = ["{size}", 1]\nsteps = 7\n'
    )
    (told,) = problems(added, each=each)
    assert told.startswith('m.toml:48: stage."orbits_{size}_km": a table\'s name has at most')
    assert told.endswith("(for size = 2.5)")
    mission = load(added, each="[each]\nsize = [4, 25]\n")
    assert amplitudes(mission, "orbits_4_km", "orbits_25_km") == [4, 25]
    (told,) = problems(added.replace('"{size}", 1', '"{size}0"'), each="[each]\nsize = [4]\n")
    assert "got a string '40'" in told


def test_several_variables_form_the_product_the_first_slowest(load: Any) -> None:
    each = '[each]\na = ["x", "y"]\nb = [1, 2]\n'
    added = ORBITS.replace('"size"', '["a", "b"]')
    names = [f"orbits_{a}_{b}" for a in "xy" for b in (1, 2)]
    assert list(load(added, each=each).specs["stage"])[2:] == names
    named = added.replace("[stage.orbits]", '[stage."s{b}{a}"]')
    assert list(load(named, each=each).specs["stage"])[2:] == ["s1x", "s2x", "s1y", "s2y"]


def test_stages_that_follow_each_other_stand_value_by_value(load: Any) -> None:
    more = '[stage.again]\nfor = "size"\nlike = "orbits_{size}"\n'
    change = "[stage.orbits_two]\nsteps = 5\n"  # has no place of its own
    between = '[stage.between]\nlike = "family"\n'
    by_value = [
        name for size in ("one", "two", "3") for name in (f"orbits_{size}", f"again_{size}")
    ]
    stages = list(load(ORBITS + change + more).specs["stage"])
    assert stages == ["family", "resonances", *by_value]
    stages = list(load(ORBITS + change + between + more).specs["stage"])
    again = ["again_one", "again_two", "again_3"]
    assert stages == ["family", "resonances", *ALL, "between", *again]
    # components have no order: those of one table stay together
    bricks = (
        '[gravity.a]\nfor = "size"\nlike = "brick"\n[gravity.b]\nfor = "size"\nlike = "a_{size}"\n'
    )
    gravity = list(load(bricks).specs["gravity"])
    assert gravity[-6:] == ["a_one", "a_two", "a_3", "b_one", "b_two", "b_3"]


def test_table_of_an_expanded_name_changes_that_one(load: Any) -> None:
    change = "[stage.orbits_two]\nx_amplitudes_m = [9000]\nsteps = 5\n"
    mission = load(ORBITS + change)
    assert amplitudes(mission, *ALL) == [5, 9, 5]  # in another unit, too
    assert [mission.specs["stage"][name].steps for name in ALL] == [100, 5, 100]
    assert list(load(change + ORBITS).specs["stage"]) == list(mission.specs["stage"])


def test_setting_reaches_all_and_that_of_one_wins(load: Any) -> None:
    one, all_ = "stage.orbits_two.x_amplitudes_m=[7000]", "stage.orbits.x_amplitudes_km=[6]"
    for sets in ([one, all_], [all_, one]):
        assert amplitudes(load(ORBITS, sets=sets), *ALL) == [6, 7, 6]
    assert amplitudes(load(ORBITS, sets=[all_]), *ALL) == [6, 6, 6]
    nested = ["stage.orbits.x_amplitudes_km=[6]", "stage.orbits.x_amplitudes_km=[8]"]
    assert amplitudes(load(ORBITS, sets=nested), *ALL) == [8, 8, 8]


def test_profile_reaches_all_and_what_it_says_of_one_wins(load: Any) -> None:
    added = (
        f"{ORBITS}[profile.p]\n"
        "stage.orbits_two.x_amplitudes_km = [7]\nstage.orbits.x_amplitudes_km = [6]\n"
    )
    assert amplitudes(load(added, profile="p"), *ALL) == [6, 7, 6]
    sets = ["stage.orbits.x_amplitudes_km=[1]"]
    assert amplitudes(load(added, profile="p", sets=sets), *ALL) == [1, 7, 1]


def test_profile_and_settings_may_change_the_lists(load: Any) -> None:
    added = f'{ORBITS}[profile.p]\neach.size = ["two"]\nstage.orbits.steps = 3\n'
    mission = load(added, profile="p")
    assert list(mission.specs["stage"]) == ["family", "resonances", "orbits_two"]
    mission = load(added, sets=["each.size=[8, 9]"])
    assert list(mission.specs["stage"])[2:] == ["orbits_8", "orbits_9"]


def test_like_takes_expanded_tables_and_is_taken_in_them(load: Any) -> None:
    added = (
        f'{ORBITS}[stage.single]\nlike = "orbits_two"\nsteps = 3\n'
        '[stage.far]\nfor = "size"\nlike = "orbits_{size}"\nclosed = false\n'
        "[stage.orbits_two]\nx_amplitudes_km = [2]\n"
    )
    mission = load(added)
    assert amplitudes(mission, "single", "far_one", "far_two") == [2, 5, 2]
    assert mission.specs["stage"]["far_two"].closed is False
    # a setting of the table that stands for all reaches what is like one of them
    sets = ["stage.orbits.x_amplitudes_m=[4000]"]
    assert amplitudes(load(added, sets=sets), "single", "far_one", "far_two") == [2, 4, 2]


@pytest.mark.parametrize(
    ("each", "added", "expected"),
    [
        ("[each]\nsize = [1]\n", "", "47: each.size: no table is for this list; remove it"),
        ("each = 3\n", "", ": expected lists, [each] NAME = [...]; got 3"),
        ("[each]\nsize = 3\n", "", "47: each.size: expected a list of strings or numbers, got 3"),
        (
            "[each]\nsize = []\n",
            "",
            "47: each.size: expected a list of strings or numbers, got an empty array",
        ),
        (
            "[each]\nsize = [1, true]\n",
            "",
            "47: each.size[1]: expected a string or a number, got true",
        ),
        (
            f'[each]\nsize = [1, "{65 * "a"}"]\n',
            "",
            "47: each.size[1]: must have at most 64 characters, got 65",
        ),
        ('[each]\nsize = [1, "1"]\n', "", "47: each.size[1]: '1' is in the list twice"),
        ("[each]\nSize = [1]\n", "", "47: each.Size: a list's name has at most 64 small letters"),
        (
            EACH,
            ORBITS.replace('"size"', '"sizes"'),
            "49: stage.orbits.for: no list of [each] is named 'sizes'; did you mean 'size'?",
        ),
        (
            "",
            ORBITS,
            "47: stage.orbits.for: no list of [each] is named 'size'; write [each] NAME = [...]",
        ),
        (
            EACH,
            ORBITS.replace('"size"', "3"),
            "49: stage.orbits.for: expected the name of a list of [each] or several, got 3",
        ),
        (
            EACH,
            ORBITS.replace('"size"', '["size", "size"]'),
            "49: stage.orbits.for: names 'size' twice",
        ),
        (
            '[each]\na = ["x", "x_y"]\nb = ["y_z", "z"]\n',
            ORBITS.replace('"size"', '["a", "b"]'),
            "50: stage.orbits.for: stands for stage.orbits_x_y_z twice; its name needs every "
            "variable",
        ),
        (
            '[each]\na = ["x"]\nb = ["y", "z"]\n',
            ORBITS.replace("orbits", '"orbits_{a}"').replace('"size"', '["a", "b"]'),
            '50: stage."orbits_{a}".for: stands for stage.orbits_x twice; its name needs every '
            "variable",
        ),
        (
            EACH,
            f'{ORBITS}[stage."{{size}}bits"]\nfor = "size"\nlike = "family"\n'
            '[stage."orbits_{size}"]\nfor = "size"\nlike = "family"\n',
            '57: stage."orbits_{size}".for: stands for a table stage.orbits_one, for which '
            "stage.orbits stands already",
        ),
        (
            EACH,
            f'{ORBITS}[stage.orbits_two]\nfor = "size"\n',
            "54: stage.orbits_two.for: stage.orbits stands for a table of this name, which "
            "cannot have a `for`",
        ),
        (
            EACH,
            ORBITS.replace('"hill"', '"hill_{siz}"'),
            "51: stage.orbits.plant: no variable is named 'siz'; did you mean 'size'? (a brace "
            "is written '{{')",
        ),
        (
            EACH + 'other = ["a"]\n',
            ORBITS.replace('"hill"', '"hill_{other}"')
            + '[stage.x]\nfor = "other"\nlike = "family"\n',
            "52: stage.orbits.plant: {other} is not among the variables of this table; add it to "
            "`for`",
        ),
        (
            EACH,
            ORBITS.replace('"hill"', '"hill_{size"'),
            "51: stage.orbits.plant: a single '{'; a brace in the text is written '{{'",
        ),
        (
            "[each]\nsize = [1, 2]\n" + "".join(f"a{k} = [1, 2]\n" for k in range(10)),
            ORBITS.replace('"size"', str(["size", *(f"a{k}" for k in range(10))])),
            "59: stage.orbits.for: stands for 2048 tables; all tables with `for` together stand "
            "for at most 1000 tables and 1048576 characters",
        ),
    ],
)
def test_fault_of_a_list_or_for_is_told_alone(
    problems: Any, each: str, added: str, expected: str
) -> None:
    (told,) = problems(added, each=each) if "each = 3" not in each else problems(top=each, each="")
    assert expected in told


def test_fault_names_the_line_of_the_source_and_the_value(problems: Any) -> None:
    # the same with every value: told once
    told = problems(ORBITS.replace('"hill"', "5"))
    assert told == [
        "m.toml:51: stage.orbits.plant: must be the name of another table, got 5 "
        "(for size = 'one' and 2 more)"
    ]
    # with one value
    each = '[each]\nsize = ["hill", "hell"]\n'
    assert problems(ORBITS.replace('"hill"', '"{size}"'), each=each) == [
        "m.toml:51: stage.orbits.plant: no plant table is named 'hell'; did you mean 'hill'? "
        "(for size = 'hell')"
    ]
    # a missing key: the line of the table
    (told,) = problems(ORBITS.replace("x_amplitudes_km = [5]\n", ""))
    assert told.startswith("m.toml:48: stage.orbits.x_amplitudes_m: missing")
    assert told.endswith("(for size = 'one' and 2 more)")
    # a key of one of them, and one that is misspelt
    (told,) = problems(f"{ORBITS}[stage.orbits_two]\nplant = 5\n")
    assert told == "m.toml:54: stage.orbits_two.plant: must be the name of another table, got 5"
    (told,) = problems(ORBITS.replace("plant", "plnt"))
    assert told.startswith("m.toml:51: stage.orbits.plnt: unknown key 'plnt'; did you mean 'plant'")
    # from a setting
    (told,) = problems(ORBITS, sets=["stage.orbits.plant=hell"])
    assert told.startswith("--set stage.orbits.plant=…: stage.orbits.plant: no plant table is")
    # in a table that is like one of them, if that is dropped
    added = f'{ORBITS}[stage.far]\nlike = "orbits_two"\n'
    (told,) = problems(added.replace('"hill"', "5"), sets=["stage.orbits=false"])
    assert told.endswith("(for size = 'two') (in stage.far, which is like it)")


def test_names_that_lead_nowhere_find_expanded_tables(problems: Any) -> None:
    assert problems(ORBITS, sets=["stage.resonances.needs.family=orbits_tow"]) == [
        "--set stage.resonances.needs.family=…: stage.resonances.needs.family: no stage table is "
        "named 'orbits_tow'; did you mean 'orbits_two'?"
    ]
    (told,) = problems(f'{ORBITS}[stage.far]\nlike = "orbits_thee"\n')
    assert told.startswith("m.toml:54: stage.far.like: no stage table is named 'orbits_thee'; did")
    (told,) = problems(ORBITS, sets=["stage.orbits_tow.steps=3"])
    assert "there is no table stage.orbits_tow to change; did you mean 'orbits_two'?" in told


def test_drop_removes_tables_by_pattern(load: Any) -> None:
    added = f'{ORBITS}[profile.p]\ndrop = ["stage.orbits_t*", "stage.reson?nces"]\n'
    assert list(load(added).specs["stage"]) == ["family", "resonances", *ALL]
    assert list(load(added, profile="p").specs["stage"]) == ["family", "orbits_one", "orbits_3"]
    # an own layer takes one back, and drops more
    sets = ["stage.orbits_two=true", 'drop=["stage.orbits_3"]']
    mission = load(added, profile="p", sets=sets)
    assert list(mission.specs["stage"]) == ["family", "orbits_one", "orbits_two"]
    # the name of the table that stands for all
    added = f'{ORBITS}[profile.p]\ndrop = ["stage.orbits"]\n'
    assert list(load(added, profile="p").specs["stage"]) == ["family", "resonances"]


def test_drop_at_the_top_of_the_file_leaves_out_a_combination(load: Any) -> None:
    top = 'drop = ["stage.orbits_one"]\n'
    added = f'{ORBITS}[profile.p]\ndrop = ["stage.orbits_two"]\n'
    assert list(load(added, top=top).specs["stage"])[2:] == ["orbits_two", "orbits_3"]
    assert list(load(added, top=top, profile="p").specs["stage"])[2:] == ["orbits_3"]
    mission = load(added, top=top, sets=["stage.orbits_one=true"])
    assert list(mission.specs["stage"])[2:] == list(ALL)


def test_false_drops_all_or_one_and_that_of_one_wins(load: Any) -> None:
    assert list(load(ORBITS, sets=["stage.orbits=false"]).specs["stage"])[2:] == []
    for sets in (
        ["stage.orbits=false", "stage.orbits_two=true"],
        ["stage.orbits_two=true", "stage.orbits=false"],
    ):
        assert list(load(ORBITS, sets=sets).specs["stage"])[2:] == ["orbits_two"]
    added = f"{ORBITS}[profile.p]\nstage.orbits_two = false\n"
    assert list(load(added, profile="p").specs["stage"])[2:] == ["orbits_one", "orbits_3"]
    mission = load(added, profile="p", sets=["stage.orbits_two=true"])
    assert list(mission.specs["stage"])[2:] == list(ALL)


def test_dropped_table_still_serves_what_is_like_it(load: Any) -> None:
    added = (
        f'{ORBITS}[stage.far]\nlike = "orbits_two"\n[profile.p]\ndrop = ["stage.orbits_*"]\n'
        "stage.orbits.x_amplitudes_km = [6]\n"
    )
    assert amplitudes(load(added, profile="p"), "far") == [6]
    sets = ["stage.orbits_two.x_amplitudes_km=[7]"]
    assert amplitudes(load(added, profile="p", sets=sets), "far") == [7]


@pytest.mark.parametrize(
    ("drop", "expected"),
    [
        (
            '["stage.family", "stage.orbit_*"]',
            "m.toml:54: drop[1]: no table matches 'stage.orbit_*'; did you mean 'stage.orbits_3'?",
        ),
        (
            '["resonances"]',
            "m.toml:54: drop[0]: no table matches 'resonances'; did you mean 'stage.resonances'?",
        ),
        (
            '"stage.family"',
            'm.toml:54: drop: expected patterns of tables, such as ["stage.wide_*"]; '
            "got a string 'stage.family'",
        ),
    ],
)
def test_pattern_that_matches_nothing(problems: Any, drop: str, expected: str) -> None:
    added = f"{ORBITS}[profile.p]\ndrop = {drop}\nstage.resonances = false\n"
    assert problems(added, profile="p") == [expected]
    assert problems(ORBITS, sets=['drop=["stage.no"]'])[0].startswith(
        "--set drop=…: drop[0]: no table matches 'stage.no'"
    )


def test_table_that_refers_to_a_dropped_one_is_told_where(problems: Any) -> None:
    added = f'{ORBITS}[profile.p]\ndrop = ["stage.fam*"]\n'
    assert problems(added, profile="p") == [
        "m.toml:36: stage.resonances.needs.family: stage table 'family' is dropped at m.toml:54; "
        "drop this stage too, or change the key"
    ]


def test_setting_of_dropped_tables_only_is_told(problems: Any, load: Any) -> None:
    added = f'{ORBITS}[profile.p]\ndrop = ["stage.orbits_*"]\n'
    for name in ("orbits", "orbits_two"):
        (told,) = problems(added, profile="p", sets=[f"stage.{name}.steps=3"])
        assert told == (
            f"--set stage.{name}.steps=…: stage.{name}: this table is dropped at m.toml:54; "
            f"--set stage.{name}=true takes it back"
        )
    load(added.replace("_*", "_one"), profile="p", sets=["stage.orbits.steps=3"])


def test_places_are_those_of_the_source(load: Any) -> None:
    places = load(f"{ORBITS}[stage.orbits_two]\nsteps = 3\n").places
    here = {key[1:]: place.rpartition(":")[2] for key, place in places.items()}
    assert here["orbits_one",] == "48"
    assert here["orbits_two",] == "53"
    assert here["orbits_two", "plant"] == "51"
    assert here["orbits_two", "steps"] == "54"


def test_schema_knows_the_three_words(toys: Registry, sound_mission: str) -> None:
    validator = jsonschema.Draft202012Validator(mission_schema(toys))

    def is_sound(added: str, top: str = "") -> bool:
        return bool(validator.is_valid(tomllib.loads(f"{top}{sound_mission}\n{added}")))

    more = (
        '[stage."a_{size}"]\nfor = ["size"]\nlike = "orbits_{size}"\n'
        "[stage.orbits_two]\nsteps = 3\n"
    )
    drop = '[profile.p]\ndrop = ["stage.orbits_*"]\neach.size = ["two"]\n'
    assert is_sound(EACH + ORBITS + more + drop, top='drop = ["stage.a_*"]\n')
    assert is_sound(EACH + ORBITS.replace("[5]", '["{size}"]'))
    for bad in (
        more,  # without [each] a table begins with a type or like another one
        EACH + ORBITS.replace('"size"', "3"),
        EACH + ORBITS.replace("plant", "plnt"),
        EACH.replace("3", "true") + ORBITS,
        EACH + ORBITS + drop.replace('["stage.orbits_*"]', "3"),
        EACH + ORBITS + '[stage."a_{size}"]\nlike = "family"\n',
    ):
        assert not is_sound(bad)
    assert not is_sound("", top="each = 3\n")


def test_tables_do_not_grow_without_limit(problems: Any) -> None:
    each = f"[each]\nsize = {list(range(900))}\n"
    long = ORBITS.replace('"hill"', f'"{400 * "{size}"}"')
    (told,) = problems(long, each=each)
    assert told.startswith("m.toml:49: stage.orbits.for: stands for 900 tables; all tables with")
    (told,) = problems(ORBITS, top=f"drop = {['stage.*'] * 1001}\n")
    assert told == "m.toml:1: drop: must have at most 1000 patterns, got 1001"
