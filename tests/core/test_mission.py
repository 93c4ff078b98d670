"""Loading sound missions: layers, links, order, input files, what stays unimported."""

from __future__ import annotations

import pickle
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from hillsphere.mission import Mission, MissionError, load_mission, packaged_missions
from hillsphere.mission import load as mission_module
from hillsphere.mission.each import expand_tables
from hillsphere.mission.layers import parse_setting
from hillsphere.plugins import Registry
from hillsphere.spec import Spec


@pytest.fixture
def load(tmp_path: Path, toys: Registry, sound_mission: str) -> Any:
    """Load the sound mission, with replacements in its text."""

    def load(*edits: tuple[str, str], added: str = "", **options: Any) -> Mission:
        text = sound_mission
        for old, new in edits:
            assert old in text
            text = text.replace(old, new, 1)
        path = tmp_path / "m.toml"
        path.write_text(text + added)
        return load_mission(path, registry=toys, **options)

    return load


def _values(mission: Mission, kind: str, name: str) -> Any:
    return mission.specs[kind][name]


def test_sound_mission(load: Any, tmp_path: Path, sound_mission: str) -> None:
    mission = load()
    assert (mission.format, mission.name, mission.seed) == (1, "toy", 1)
    assert mission.title == "A mission of toys"
    assert mission.description == ""
    assert mission.path == tmp_path / "m.toml"
    assert mission.directory == tmp_path
    assert mission.text == sound_mission
    assert mission.profiles == ("fast", "heavy")
    assert {kind: list(specs) for kind, specs in mission.specs.items()} == {
        "body": ["moon"],
        "gravity": ["brick", "heap"],
        "plant": ["hill"],
        "stage": ["family", "resonances"],
    }
    assert _values(mission, "gravity", "brick").axes_m == pytest.approx((13030, 11400, 9140))
    assert mission.components["plant"]["hill"].plugin == "toys"
    assert mission.places["gravity", "brick"].endswith("m.toml:11")
    assert mission.order() == ["family", "resonances"]


def test_mission_is_plain_data(load: Any) -> None:
    mission = load()
    assert pickle.loads(pickle.dumps(mission)) == mission
    with pytest.raises(AttributeError, match="cannot assign"):
        mission.seed = 2


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_line_ends_and_byte_order_mark(
    end: str, mark: bytes, tmp_path: Path, toys: Registry, sound_mission: str, load: Any
) -> None:
    path = tmp_path / "other.toml"
    path.write_bytes(mark + sound_mission.replace("\n", end).encode())
    assert load_mission(path, registry=toys).specs == load().specs


# --- profiles and settings ------------------------------------------------------------------


def test_profile_replaces_an_array_whole(load: Any) -> None:
    mission = load(profile="fast")
    assert mission.profile == "fast"
    assert _values(mission, "stage", "family").x_amplitudes_m == (100e3,)
    assert _values(mission, "stage", "family").plant.name == "hill"


def test_profile_in_another_unit_replaces(load: Any) -> None:
    assert _values(load(profile="heavy"), "gravity", "brick").density_kg_m3 == 3000.0


def test_settings_follow_the_profile_in_order(load: Any) -> None:
    sets = ["gravity.brick.density_g_cm3=1", "gravity.brick.density_kg_m3=2"]
    assert _values(load(profile="heavy", sets=sets[:1]), "gravity", "brick").density_kg_m3 == 1000
    assert _values(load(profile="heavy", sets=sets), "gravity", "brick").density_kg_m3 == 2


def test_two_units_in_one_profile_are_a_fault(load: Any) -> None:
    edit = (
        "gravity.brick.density_kg_m3 = 3000.0",
        "gravity.brick.density_kg_m3 = 3000.0\ngravity.brick.density_g_cm3 = 3",
    )
    with pytest.raises(MissionError, match=r"m\.toml:44: gravity\.brick\.density_g_cm3: .* keep"):
        load(edit, profile="heavy")


def test_setting_in_another_unit_replaces_inside_a_nested_table(
    tmp_path: Path, sound_mission: str
) -> None:
    from hillsphere.mission.layers import Layers
    from hillsphere.mission.likes import resolve_likes, without_superseded_units
    from hillsphere.mission.toml_source import parse_toml
    from hillsphere.spec import option, quantity

    class Inner(Spec):
        size_m: float = quantity("length", "size")

    class Outer(Spec):
        inner: Inner = option("a table")

    tables, locations, _ = parse_toml(b"[gravity.a]\ninner = { size_km = 1 }\n", "f")
    layers = Layers(tables, locations)
    layers.lay_setting(parse_setting("gravity.a.inner.size_cm=5"))
    tables_with = resolve_likes(expand_tables(layers, ["gravity"]), ["gravity"])
    table = tables_with.tables["gravity"]["a"]
    kept = without_superseded_units(Outer, table, ("gravity", "a"), tables_with)
    assert kept == {"inner": {"size_cm": 5}}


def test_setting_may_add_a_table(load: Any) -> None:
    mission = load(
        sets=["gravity.ball={ type = 'ball', gm_km3_s2 = 7e-4 }", "plant.hill.gravity=ball"]
    )
    assert _values(mission, "gravity", "ball").gm_m3_s2 == pytest.approx(7e5)
    assert _values(mission, "plant", "hill").gravity.name == "ball"
    assert mission.places["gravity", "ball"] == "--set gravity.ball=…"


def test_setting_over_a_profile_that_replaced_a_table(load: Any) -> None:
    # The later layer holds for what it says, the earlier for the rest, and each names its own line.
    edit = ("gravity.brick.density_kg_m3 = 3000.0", "gravity.new = { type = 'ball', gm_m3_s2 = 1 }")
    mission = load(edit, profile="heavy", sets=["gravity.new.gm_km3_s2=2"])
    assert _values(mission, "gravity", "new").gm_m3_s2 == 2e9
    with pytest.raises(MissionError) as caught:
        load(edit, profile="heavy", sets=["gravity.new.gm_km3_s2=-2", "gravity.new.x=1"])
    assert [p.source for p in caught.value.problems] == [
        "--set gravity.new.gm_km3_s2=…", "--set gravity.new.x=…",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "key", "value"),
    [
        ("a.b=1", ("a", "b"), 1),
        ("a.b = 1.5e3", ("a", "b"), 1500.0),
        ("a=1_000", ("a",), 1000),
        ("a=true", ("a",), True),
        ("a=True", ("a",), "True"),
        ("a=word", ("a",), "word"),
        ("a=two words", ("a",), "two words"),
        ("a=1:17", ("a",), "1:17"),
        ("a=../data/x.csv", ("a",), "../data/x.csv"),
        ("a='q'", ("a",), "q"),
        ('a="x=y"', ("a",), "x=y"),
        ('a=""', ("a",), ""),
        ("a=[1, 'x', {b = 2}]", ("a",), [1, "x", {"b": 2}]),
        ("a={ b.c = 1 }", ("a",), {"b": {"c": 1}}),
        ('"a b".c=1', ("a b", "c"), 1),
        ("a=1 # comment", ("a",), 1),
    ],
)
def test_setting_is_read(text: str, key: tuple[str, ...], value: object) -> None:
    setting = parse_setting(text)
    assert setting.key == key
    assert setting.value == value
    assert type(setting.value) is type(value)


# --- order and references -------------------------------------------------------------------


def test_stages_in_order_of_needs_else_of_the_file(load: Any) -> None:
    last = '[stage.{}]\ntype = "resonances"\nneeds = {{ family = "family", earlier = "{}" }}\n'
    added = last.format("z", "a") + last.format("a", "resonances") + (
        '[stage.alone]\ntype = "family"\nplant = "hill"\nx_amplitudes_m = [1]\n'
    )  # fmt: skip
    mission = load(
        ('{ family = "family" }', '{ family = "late" }'),
        added=added + '[stage.late]\ntype = "family"\nplant = "hill"\nx_amplitudes_m = [1]\n',
    )
    assert mission.order() == ["family", "late", "resonances", "a", "z", "alone"]


def test_long_chain_of_references_needs_no_recursion(load: Any) -> None:
    n = 3000
    links = "".join(
        f'[gravity.h{i}]\ntype = "heap"\nparts = [{{ model = "h{i + 1}" }}]\n' for i in range(n)
    )
    end = f'[gravity.h{n}]\ntype = "heap"\nparts = [{{ model = "brick" }}]\n'
    mission = load(('gravity = "heap"', 'gravity = "h0"'), added=links + end)
    assert mission.order() == ["family", "resonances"]
    with pytest.raises(
        MissionError, match=r"goes in a circle: gravity\.h0 → gravity.h1 → "
    ) as caught:
        load(('gravity = "heap"', 'gravity = "h0"'), added=links + end.replace("brick", "h0"))
    assert len(caught.value.problems) == 1


def test_every_circle_is_told_once(load: Any) -> None:
    heap = '[gravity.{}]\ntype = "heap"\nparts = [{}]\n'
    part = '{{ model = "{}" }}'
    added = (
        heap.format("a", ", ".join(part.format(x) for x in ("b", "b", "heap")))
        + heap.format("b", part.format("a"))
        + heap.format("c", part.format("c"))
    )
    with pytest.raises(MissionError) as caught:
        load(added=added)
    assert [p.message for p in caught.value.problems] == [
        "goes in a circle: gravity.a → gravity.b → gravity.a",
        "goes in a circle: gravity.c → gravity.c",
    ]


def test_fault_in_one_table_hides_none_in_another(load: Any) -> None:
    with pytest.raises(MissionError) as caught:
        load(
            ("seed = 1", "seed = -1"),
            ("9.14]", "-9.14]"),
            ('body = "moon"', 'body = "mon"'),
            ('type = "resonances"', 'type = "resonance"'),
            sets=["plant.hill.spin_deg=x", "zzz=1"],
        )
    assert [(p.line, p.key) for p in caught.value.problems] == [
        (4, ("seed",)),
        (13, ("gravity", "brick", "axes_km", 2)),
        (35, ("stage", "resonances", "type")),
        (None, ("zzz",)),
        (None, ("plant", "hill", "spin_deg")),
    ]


# --- input files ----------------------------------------------------------------------------

FILE_TABLE = '[gravity.file]\ntype = "file"\nfile = "{}"\n'


def test_input_file_beside_the_mission(load: Any, tmp_path: Path) -> None:
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "c.csv").write_text("1")
    for text in ("d/c.csv", "d/../d/c.csv", "./d/c.csv"):
        mission = load(added=FILE_TABLE.format(text))
        assert _values(mission, "gravity", "file").file == str(tmp_path / "d" / "c.csv")


def test_input_file_in_the_packaged_data(
    load: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packaged = tmp_path / "packaged"
    (packaged / "data").mkdir(parents=True)
    (packaged / "data" / "c.csv").write_text("1")
    monkeypatch.setattr("hillsphere.mission.links.missions_directory", lambda: packaged)
    mission = load(added=FILE_TABLE.format("c.csv"))
    assert _values(mission, "gravity", "file").file == str(packaged / "data" / "c.csv")
    (tmp_path / "c.csv").write_text("2")
    mission = load(added=FILE_TABLE.format("c.csv"))
    assert _values(mission, "gravity", "file").file == str(tmp_path / "c.csv")


def test_input_file_elsewhere_if_allowed(load: Any, tmp_path: Path) -> None:
    outside = tmp_path.parent / "outside.csv"
    outside.write_text("1")
    for text in (str(outside), "../outside.csv"):
        mission = load(added=FILE_TABLE.format(text), allow_path=True)
        assert _values(mission, "gravity", "file").file == str(outside)


def test_input_file_that_may_not_be_read(
    load: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "c.csv").write_text("1")
    monkeypatch.setattr("os.access", lambda *_: False)
    with pytest.raises(MissionError, match=r":46: gravity\.file\.file: .* permission denied"):
        load(added=FILE_TABLE.format("c.csv"))


# --- resolved -------------------------------------------------------------------------------


def test_resolved_is_a_mission_in_si(load: Any, toys: Registry, tmp_path: Path) -> None:
    mission = load(("seed = 1", 'seed = 1\ndescription = "text"'), profile="fast")
    tables = mission.resolved()
    assert tables["gravity"]["brick"] == {
        "type": "brick",
        "axes_m": [13030.0, 11400.0, 9140.0],
        "density_kg_m3": 1860.0,
        "convention": "full",
    }
    assert tables["stage"]["resonances"]["needs"] == {"family": "family"}
    assert tables["description"] == "text"
    path = tmp_path / "again.toml"
    path.write_text(_toml(tables))
    again = load_mission(path, registry=toys)
    assert again.specs == mission.specs
    assert again.resolved() == tables


def _toml(tables: dict[str, Any]) -> str:
    def value(item: Any) -> str:
        if isinstance(item, dict):
            return "{" + ", ".join(f"{key} = {value(v)}" for key, v in item.items()) + "}"
        if isinstance(item, list):
            return "[" + ", ".join(map(value, item)) + "]"
        return str(item).lower() if isinstance(item, bool) else repr(item)

    return "".join(f"{key} = {value(item)}\n" for key, item in tables.items())


# --- packaged missions ----------------------------------------------------------------------


def test_packaged_missions(
    tmp_path: Path, toys: Registry, sound_mission: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "toy.toml").write_text(sound_mission)
    (tmp_path / "bad.toml").write_text("a = [")
    (tmp_path / "data").mkdir()
    monkeypatch.setattr(mission_module, "missions_directory", lambda: tmp_path)
    listed = dict(packaged_missions())
    assert listed["toy"] == "A mission of toys"
    assert listed["bad"].startswith("(unreadable: bad.toml:1: a: the array")
    assert load_mission("toy", registry=toys).path == tmp_path / "toy.toml"
    with pytest.raises(
        MissionError, match=r"^ty: no packaged mission .* did you mean 'toy'"
    ) as caught:
        load_mission("ty", registry=toys)
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize("name", ["", "..", "to\0y", "x\ny", "toy.TOML"])
def test_odd_names_are_not_found(name: str, toys: Registry) -> None:
    with pytest.raises(MissionError) as caught:
        load_mission(name, registry=toys)
    assert len(str(caught.value).splitlines()) == 1


def test_every_packaged_mission_loads() -> None:
    for name, title in packaged_missions():
        assert title
        assert load_mission(name).title == title
        for profile in load_mission(name).profiles:
            load_mission(name, profile=profile)


def test_own_mission_by_relative_path(
    tmp_path: Path, toys: Registry, sound_mission: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "m.toml").write_text(sound_mission)
    (tmp_path / "plain").write_text(sound_mission)
    monkeypatch.chdir(tmp_path)
    assert load_mission("m.toml", registry=toys).path == tmp_path / "m.toml"
    assert load_mission("./plain", registry=toys).directory == tmp_path
    assert load_mission(Path("plain"), registry=toys).name == "toy"


# --- what stays unimported ------------------------------------------------------------------

HEAVY = ("numpy", "scipy", "control", "cvxpy", "matplotlib", "heyoka")


def test_loading_imports_nothing_numerical(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(
        'format = 1\nname = "m"\ntitle = "t"\nseed = 1\n'
        '[body.b]\ntype = "moon"\nprimary_gm_km3_s2 = 1\nsemi_major_axis_km = 1\n'
        '[gravity.e]\ntype = "ellipsoid"\naxes_km = [3, 2, 1]\ndensity_g_cm3 = 2\n'
        '[plant.h]\ntype = "hill"\nbody = "b"\ngravity = "e"\n'
    )
    code = (
        "import sys\n"
        "from hillsphere.mission import MissionError, load_mission\n"
        "from hillsphere.mission.schema import mission_schema\n"
        "from hillsphere.plugins import default_registry\n"
        f"try: load_mission({str(path)!r})\n"
        "except MissionError as error: problems = error.problems\n"
        "assert [p.message[:14] for p in problems] == ['nothing to run'], problems\n"
        "mission_schema(default_registry())\n"
        f"print(*[name for name in {HEAVY!r} if name in sys.modules])\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert run.stdout.split() == []


def test_tables_of_the_text_are_those_of_tomllib(load: Any) -> None:
    mission = load()
    tables = tomllib.loads(mission.text)
    assert [k for k in tables if k in mission.specs] == list(mission.specs)
