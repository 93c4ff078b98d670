"""Bad mission files: each gives its problems, no more, each with its line and key."""

from __future__ import annotations

import os
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from hillsphere.base.problems import Problem, format_key, with_article
from hillsphere.mission import MissionError, load_mission
from hillsphere.plugins import Registry

Expected = tuple[int | None, str, str]


def _problems(path: Path, toys: Registry, **options: Any) -> tuple[Problem, ...]:
    with pytest.raises(MissionError) as caught:
        load_mission(path, registry=toys, **options)
    for problem in caught.value.problems:
        assert "\n" not in str(problem)
        assert len(str(problem)) < 600
    return caught.value.problems


def _seen(problems: tuple[Problem, ...], expected: tuple[Expected, ...]) -> None:
    found = [(p.line, format_key(p.key)) for p in problems]
    assert found == [(line, key) for line, key, _ in expected], "\n".join(map(str, problems))
    for problem, (_, _, fragment) in zip(problems, expected, strict=True):
        assert fragment in problem.message


# id, what is replaced in the sound mission, by what, problems (line, key, part of the message)
EDITS: list[tuple[str, str, str, tuple[Expected, ...]]] = [
    # --- above the tables
    ("format-2", "format = 1", "format = 2", ((1, "format", "reads format 1, got 2"),)),
    ("format-text", "format = 1", 'format = "1"', ((1, "format", "got a string '1'"),)),
    ("format-true", "format = 1", "format = true", ((1, "format", "got true"),)),
    ("format-float", "format = 1", "format = 1.0", ((1, "format", "got 1.0"),)),
    ("format-missing", "format = 1", "", ((None, "format", "write format = 1"),)),
    ("name-missing", 'name = "toy"', "", ((None, "name", "missing: name: short name"),)),
    ("name-slash", '"toy"', '"a/b"', ((2, "name", "usable as the name of a directory"),)),
    ("name-dots", '"toy"', '".."', ((2, "name", "got a string '..'"),)),
    ("name-empty", '"toy"', '""', ((2, "name", "got a string ''"),)),
    ("name-long", '"toy"', f'"{"a" * 65}"', ((2, "name", "at most 64"),)),
    ("name-newline", '"toy"', r'"a\n"', ((2, "name", r"'a\n'"),)),
    ("title-number", '"A mission of toys"', "3", ((3, "title", "expected a string, got 3"),)),
    ("title-empty", '"A mission of toys"', '""', ((3, "title", "must not be empty"),)),
    ("seed-negative", "seed = 1", "seed = -1", ((4, "seed", "must be ≥ 0, got -1"),)),
    ("seed-float", "seed = 1", "seed = 1.5", ((4, "seed", "a whole number, got 1.5"),)),
    ("seed-true", "seed = 1", "seed = true", ((4, "seed", "a whole number, got true"),)),
    ("seed-2^63", "seed = 1", f"seed = {2**63}", ((4, "seed", "64 bits"),)),
    ("top-misspelt", "seed = 1", "seeed = 1", (
        (None, "seed", "missing: seed"), (4, "seeed", "did you mean 'seed'?"))),
    ("kind-misspelt", "[body.moon]", "[bdy.moon]", (
        (6, "bdy", "did you mean 'body'?"), (25, "plant.hill.body", "write a table [body.NAME]"))),
    ("kind-number", "seed = 1", "seed = 1\nsensor = 3", (
        (5, "sensor", "expected tables [sensor.NAME], got 3"),)),
    ("kind-without-name", "[plant.hill]", "[plant]", (
        (23, "plant", "write [plant.NAME] instead of [plant]"),
        (31, "stage.family.plant", "write a table [plant.NAME]"))),
    ("kind-array", "[body.moon]", "[[body]]", (
        (6, "body", "give each a name: [body.NAME]"),
        (25, "plant.hill.body", "no body table is named 'moon'"))),
    ("table-is-number", "seed = 1", "seed = 1\nsensor.eye = 3", (
        (5, "sensor.eye", "expected a table [sensor.NAME], got 3"),)),
    ("table-name-case", "[profile.fast]", '[gravity.Big]\ntype="ball"\ngm_m3_s2=1\n[profile.fast]',
    (
        (39, "gravity.Big", "small letters"),)),
    ("table-name-space", "[profile.fast]", '[gravity."a b"]\ntype="ball"\ngm_m3_s2=1\n[profile.q]',
    (
        (39, 'gravity."a b"', "small letters"),)),
    ("command-in-mission", "[profile.fast]", "[command.x]\n[profile.q]", (
        (39, "command", "unknown key or kind of table 'command'"),)),
    # --- types
    ("type-misspelt", '"brick"\naxes', '"brik"\naxes', (
        (12, "gravity.brick.type", "no gravity of type 'brik'; did you mean 'brick'?"),)),
    ("type-far-off", '"brick"\naxes', '"zzz"\naxes', (
        (12, "gravity.brick.type", "installed: ball, brick, file, heap"),)),
    ("type-missing", 'type = "brick"\n', "", (
        (11, "gravity.brick.type", "missing: which gravity it is; installed: ball, brick"),)),
    ("type-number", 'type = "brick"', "type = 3", (
        (12, "gravity.brick.type", "expected a string, got 3"),)),
    ("type-none-installed", "[profile.fast]", '[estimator.e]\ntype="x"\n[profile.fast]', (
        (40, "estimator.e.type", "no plugin brings an estimator"),)),
    ("type-broken", "[profile.fast]", '[sensor.s]\ntype="lost"\n[profile.fast]', (
        (40, "sensor.s.type", "plugin 'toys': sensor 'lost'"),)),
    # --- keys
    ("key-misspelt", "axes_km", "axs_km", (
        (13, "gravity.brick.axs_km", "unknown key 'axs_km'; did you mean 'axes_km'?"),)),
    ("key-unknown", "spin_deg = 180", "zzz = 180", (
        (27, "plant.hill.zzz",
        "unknown key 'zzz'; valid keys: spin_rad, spin_deg, spin_arcsec, body, gravity"),)),
    ("key-misspelt-beside-right-one", 'body = "moon"', 'body = "moon"\nbdoy = "moon"', (
        (26, "plant.hill.bdoy", "did you mean 'body'?"),)),
    ("key-case", "axes_km", "Axes_km", (
        (13, "gravity.brick.Axes_km", "did you mean 'axes_km'?"),)),
    ("key-missing", "density_g_cm3 = 1.860", "", (
        (11, "gravity.brick.density_kg_m3", "missing: density_kg_m3 (or _g_cm3): its density"),)),
    ("unit-missing", "axes_km", "axes", (
        (13, "gravity.brick.axes",
        "needs a unit; write axes_m, axes_km, axes_cm, axes_mm or axes_au"),)),
    ("unit-unknown", "axes_km", "axes_ft", (
        (13, "gravity.brick.axes_ft", "unknown unit 'ft'; write axes_m"),)),
    ("unit-of-other-dimension", "axes_km", "axes_s", (
        (13, "gravity.brick.axes_s", "unknown unit 's'; write axes_m"),)),
    ("unit-twice", "density_g_cm3 = 1.860", "density_g_cm3 = 1\ndensity_kg_m3 = 1", (
        (14, "gravity.brick.density_g_cm3", "density_kg_m3 and density_g_cm3 say the same"),)),
    ("type-of-axes", "[13.03, 11.40, 9.14]", '"abc"', (
        (13, "gravity.brick.axes_km", "expected three numbers, got a string 'abc'"),)),
    ("two-axes", "[13.03, 11.40, 9.14]", "[13.03, 11.40]", (
        (13, "gravity.brick.axes_km", "expected three numbers, got [13.03, 11.4]"),)),
    ("four-axes", "[13.03, 11.40, 9.14]", "[1, 2, 3, 4]", (
        (13, "gravity.brick.axes_km", "expected three numbers, got [1, 2, 3, 4]"),)),
    ("one-axis", "[13.03, 11.40, 9.14]", "13.03", (
        (13, "gravity.brick.axes_km", "expected three numbers, got 13.03"),)),
    ("text-axis", "11.40", '"11.40"', (
        (13, "gravity.brick.axes_km[1]", "expected a number, got a string '11.40'"),)),
    ("true-axis", "11.40", "true", (
        (13, "gravity.brick.axes_km[1]", "expected a number, got true"),)),
    ("negative-axis", "11.40", "-11.4", (
        (13, "gravity.brick.axes_km[1]", "must be > 0 km, got -11.4 km"),)),
    ("zero-axis", "9.14", "0", ((13, "gravity.brick.axes_km[2]", "must be > 0 km, got 0 km"),)),
    ("above-bound", "1.860", "31", (
        (14, "gravity.brick.density_g_cm3", "must be ≤ 30 g/cm³, got 31 g/cm³"),)),
    ("overflow-in-si", "1.860", "1e308", (
        (14, "gravity.brick.density_g_cm3", "too large a number: 1e+308"),)),
    ("date", "1.860", "2027-05-01T12:00:00Z", (
        (14, "gravity.brick.density_g_cm3", "expected a number, got a date or time 2027-05-01"),)),
    ("table-for-number", "1.860", "{ a = 1 }", (
        (14, "gravity.brick.density_g_cm3", "expected a number, got a table"),)),
    ("choice", "density_g_cm3 = 1.860", 'density_g_cm3 = 1.860\nconvention = "ful"', (
        (15, "gravity.brick.convention",
        "one of 'full', 'none', got a string 'ful'; did you mean 'full'?"),)),
    ("empty-array", "[100, 50, 30]", "[]", (
        (32, "stage.family.x_amplitudes_km", "must have at least 1 items, got 0"),)),
    ("only-item-wrong", "[100, 50, 30]", "[-1]", (
        (32, "stage.family.x_amplitudes_km[0]", "must be > 0 km, got -1 km"),)),
    ("count-as-float", 'plant = "hill"', 'plant = "hill"\nsteps = 10.0', (
        (32, "stage.family.steps", "expected a whole number, got 10.0"),)),
    ("count-zero", 'plant = "hill"', 'plant = "hill"\nsteps = 0', (
        (32, "stage.family.steps", "must be ≥ 1, got 0"),)),
    ("bool-as-text", 'plant = "hill"', 'plant = "hill"\nclosed = "no"', (
        (32, "stage.family.closed", "expected true or false, got a string 'no'"),)),
    ("part-unknown-key", "position_km", "positoin_km", (
        (20, "gravity.heap.parts[1].positoin_km", "did you mean 'position_km'?"),)),
    ("part-missing-model", '{ model = "brick" },', "{ },", (
        (19, "gravity.heap.parts[0].model", "missing: model: the model"),)),
    ("part-not-table", '{ model = "brick" },', "3,", (
        (19, "gravity.heap.parts[0]", "expected a table, got 3"),)),
    ("needs-misspelt", "{ family =", "{ famly =", (
        (36, "stage.resonances.needs.famly", "did you mean 'family'?"),)),
    ("needs-text", '{ family = "family" }', '"family"', (
        (36, "stage.resonances.needs", "expected a table, got a string 'family'"),)),
    ("several-in-one-table", "axes_km = [13.03, 11.40, 9.14]\ndensity_g_cm3 = 1.860",
     'axes = 3\ndensity_g_cm3 = -1\nconvention = 3\nfoo = "x"', (
        (13, "gravity.brick.axes", "needs a unit"),
        (14, "gravity.brick.density_g_cm3", "must be > 0 g/cm³"),
        (15, "gravity.brick.convention", "must be one of"),
        (16, "gravity.brick.foo", "unknown key 'foo'"))),
    ("escape-sequence-in-key", "spin_deg", r'"spin\u001b[2J"', (
        (27, r'plant.hill."spin\u001b[2J"', "unknown key"),)),
    # --- links
    ("reference-misspelt", 'gravity = "heap"', 'gravity = "hep"', (
        (26, "plant.hill.gravity", "no gravity table is named 'hep'; did you mean 'heap'?"),)),
    ("reference-of-other-kind", 'gravity = "heap"', 'gravity = "moon"', (
        (26, "plant.hill.gravity", "there are: brick, heap"),)),
    ("reference-number", 'gravity = "heap"', "gravity = 3", (
        (26, "plant.hill.gravity", "must be the name of another table, got 3"),)),
    ("reference-empty", 'gravity = "heap"', 'gravity = ""', (
        (26, "plant.hill.gravity", "must be the name of another table, got a string ''"),)),
    ("reference-in-part", '{ model = "brick", ', '{ model = "bruck", ', (
        (20, "gravity.heap.parts[1].model", "did you mean 'brick'?"),)),
    ("needs-nothing", '{ family = "family" }', '{ family = "famil" }', (
        (36, "stage.resonances.needs.family", "no stage table is named 'famil'"),)),
    ("needs-wrong-product", '{ family = "family" }', '{ family = "family", earlier = "family" }', (
        (36, "stage.resonances.needs.earlier",
         "needs a Resonances, but stage 'family' yields a Family; fitting: resonances"),)),
    ("needs-itself", '{ family = "family" }', '{ family = "family", earlier = "resonances" }', (
        (36, "stage.resonances.needs.earlier", "circle: resonances → resonances"),)),
    ("needs-circle", '{ family = "family" }\nvertical = ["1:17", "1:22"]',
     '{ family = "family", earlier = "b" }\n[stage.b]\ntype = "resonances"\n'
     'needs = { family = "family", earlier = "resonances" }', (
        (36, "stage.resonances.needs.earlier", "circle: resonances → b → resonances"),)),
    ("gravity-circle", '{ model = "brick" },\n    { model = "brick",',
     '{ model = "heap" },\n    { model = "brick",', (
        (19, "gravity.heap.parts[0].model", "circle: gravity.heap → gravity.heap"),)),
    ("stage-as-gravity", "[stage.resonances]", "[gravity.resonances]", (
        (35, "gravity.resonances.type", "no gravity of type 'resonances'"),
    )),
    # --- TOML
    ("table-twice", "[plant.hill]", "[gravity.brick]", (
        (23, "gravity.brick", "this table is given twice, first on line 11"),
        (24, "gravity.brick.type", "this key is given twice, first on line 12"))),
    ("key-twice", "seed = 1", "seed = 1\nseed = 2", (
        (5, "seed", "this key is given twice, first on line 4"),)),
    ("value-missing", "seed = 1", "seed =", ((4, "seed", "expected a value"),)),
    ("equals-missing", "seed = 1", "seed 1", ((4, "seed", "expected '='"),)),
    ("unquoted", '"toy"', "toy", ((2, "name", "a string needs quotes"),)),
    ("quote-open", '"toy"', '"toy', ((2, "name", "no closing quote"),)),
    ("long-quote-open", '"toy"', '"""toy', ((2, "name", "no closing quote"),)),
    ("header-open", "[plant.hill]", "[plant.hill", ((23, "plant.hill", "expected ']'"),)),
    ("array-open", "9.14]", "9.14", (
        (14, "gravity.brick.axes_km", "array that begins on line 13"),)),
    ("inline-table-over-lines", '{ family = "family" }', '{\n family = "family" }', (
        (36, "stage.resonances.needs", "must end on the line on which it begins"),)),
    ("escape", '"toy"', r'"to\y"', ((2, "name", "a backslash"),)),
    ("nan", "1.860", "nan", ((14, "gravity.brick.density_g_cm3", "nan is not accepted"),)),
    ("inf-in-array", "11.40", "-inf", (
        (13, "gravity.brick.axes_km[1]", "-inf is not accepted"),)),
    ("too-large", "1.860", "1e999", ((14, "gravity.brick.density_g_cm3", "too large"),)),
    ("date-without-zone", "1.860", "2027-05-01T12:00:00", (
        (14, "gravity.brick.density_g_cm3", "a time and a zone"),)),
    ("date-only", "1.860", "2027-05-01", (
        (14, "gravity.brick.density_g_cm3", "a time and a zone"),)),
    ("no-date", "1.860", "2027-15-01T00:00:00Z", (
        (14, "gravity.brick.density_g_cm3", "is not a date and time"),)),
    ("leading-zero", "1.860", "01.860", ((14, "gravity.brick.density_g_cm3", "is not a value"),)),
    ("million-digits", "1.860", "1" * 900_000, (
        (14, "gravity.brick.density_g_cm3", "900000 characters"),)),
    ("collision", 'spin_deg = 180', "spin_deg.x = 1\n[plant.hill.spin_deg]", (
        (28, "plant.hill.spin_deg", "collides with"),)),
    ("three-bad-values", "[13.03, 11.40, 9.14]\ndensity_g_cm3 = 1.860",
     "[nan, abc, 9.14]\ndensity_g_cm3 = True", (
        (13, "gravity.brick.axes_km[0]", "finite"), (13, "gravity.brick.axes_km[1]", "quotes"),
        (14, "gravity.brick.density_g_cm3", "write true"))),
    # --- profiles
    ("profile-number", "[profile.fast]", "[profile]\nslow = 3\n[profile.fast]", (
        (40, "profile.slow", "expected a table"),)),
    ("profile-unknown-kind", "stage.family.x_amplitudes_km = [100]", "stge.x = 3", (
        (40, "profile.fast.stge", "did you mean 'stage'?"),)),
    ("profile-format", "[profile.fast]", "[profile.fast]\nformat = 1", (
        (40, "profile.fast.format", "cannot change 'format'"),)),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "expected"), [edit[1:] for edit in EDITS], ids=[edit[0] for edit in EDITS]
)
def test_edited_mission(
    old: str,
    new: str,
    expected: tuple[Expected, ...],
    tmp_path: Path,
    toys: Registry,
    sound_mission: str,
) -> None:
    assert old in sound_mission
    path = tmp_path / "m.toml"
    path.write_text(sound_mission.replace(old, new, 1))
    _seen(_problems(path, toys), expected)
    # The first message names file, line and key as the command line shows them.
    line, key, _ = expected[0]
    where = f"{path}:{line}" if line is not None else f"{path}"
    with pytest.raises(MissionError) as caught:
        load_mission(str(path), registry=toys)
    assert str(caught.value).startswith(f"{where}: {key}: ")


FILES: list[tuple[str, bytes | Callable[[bytes], bytes], tuple[Expected, ...]]] = [
    ("empty", b"", ((None, "", "holds no keys; a mission begins with format = 1"),)),
    ("comments-only", b"# nothing\n\n", ((None, "", "holds no keys"),)),
    ("byte-order-mark-only", b"\xef\xbb\xbf", ((None, "", "holds no keys"),)),
    ("five-megabytes", b"# x\n" * 1_310_720, ((None, "", "larger than 1 MiB"),)),
    ("five-megabytes-of-brackets", b"[" * 5_242_880, ((None, "", "larger than 1 MiB"),)),
    ("brackets", b"[" * 100_000, ((1, "", "expected a key, got '['"),)),
    ("four-brackets", b"[[[[", ((1, "", "expected a key, got '['"),)),
    ("array-brackets", b"a = " + b"[" * 100_000, ((1, "a[0][0]", "deeper than 32"),)),
    ("nested-inline", b"a = " + b"{a=" * 100_000, ((1, "a.a.a", "deeper than 32"),)),
    ("mixed-nesting", b"\na = " + b"[{a=" * 17, ((2, "a[0].a", "deeper than 32"),)),
    ("10000-deep-key", b".".join([b"a"] * 10_000) + b" = 1", ((1, "a.a.a", "deeper than 32"),)),
    ("10000-deep-header", b"\n[" + b".".join([b"a"] * 10_000) + b"]", (
        (2, "a.a.a", "deeper than 32"),)),
    ("10000-deep-array-header", b"[[" + b".".join([b"a"] * 10_000) + b"]]", (
        (1, "a.a.a", "deeper than 32"),)),
    ("header-plus-key-too-deep", b"[" + b".".join([b"a"] * 20) + b"]\n"
     + b".".join([b"b"] * 13) + b" = 1", ((2, "a.a.a", "deeper than 32"),)),
    ("bare-cr", lambda sound: sound.replace(b"\n", b"\r"), ((1, "", "bare carriage return"),)),
    ("one-bare-cr", lambda sound: sound.replace(b'"toy"\n', b'"toy"\r'), (
        (2, "", "bare carriage return"),)),
    ("invalid-utf8", lambda sound: sound.replace(b"toys", b"to\xffys"), (
        (3, "", "not UTF-8 text: byte 0xff"),)),
    ("latin-1", lambda sound: sound.replace(b"toys", "Jouét".encode("latin-1")), (
        (3, "", "not UTF-8 text: byte 0xe9"),)),
    ("truncated-utf8", lambda sound: sound + b"# \xe2\x82", ((44, "", "not UTF-8"),)),
    ("utf-8-surrogate", lambda sound: sound.replace(b"toys", b"\xed\xa0\x80"), (
        (3, "", "not UTF-8"),)),
    ("utf-16", lambda sound: sound.decode().encode("utf-16"), ((1, "", "UTF-16"),)),
    ("nul", lambda sound: sound.replace(b"toys", b"to\0ys"), ((3, "", "U+0000"),)),
    ("nul-at-end", lambda sound: sound + b"\0", ((44, "", "U+0000"),)),
    ("escape-character", lambda sound: sound.replace(b"# line 11", b"# \x1b[2J"), (
        (11, "", "U+001B"),)),
    ("binary", bytes(range(256)) * 16, ((2, "", "not UTF-8 text: byte 0x80"),)),
    ("random-bytes", random.Random(1).randbytes(4096), ((1, "", "not UTF-8"),)),
    ("two-marks", lambda sound: b"\xef\xbb\xbf" * 2 + sound, ((1, "", r"expected a key"),)),
    ("json", b'{"format": 1}', ((1, "", "expected a key, got '{'"),)),
    ("no-stage", lambda sound: sound[: sound.index(b"[stage.family]")], (
        (None, "", "nothing to run; a mission has at least one [stage.NAME]"),)),
    ("stage-empty", lambda sound: sound[: sound.index(b"[stage.family]")] + b"[stage]", (
        (None, "", "nothing to run"),)),
]  # fmt: skip


@pytest.mark.parametrize(
    ("made", "expected"), [file[1:] for file in FILES], ids=[file[0] for file in FILES]
)
def test_bad_file(
    made: bytes | Callable[[bytes], bytes],
    expected: tuple[Expected, ...],
    tmp_path: Path,
    toys: Registry,
    sound_mission: str,
) -> None:
    data = made if isinstance(made, bytes) else made(sound_mission.encode())
    path = tmp_path / "m.toml"
    path.write_bytes(data)
    _seen(_problems(path, toys), expected)


def test_long_unterminated_values_and_many_faults_are_told_briefly(
    tmp_path: Path, toys: Registry, sound_mission: str
) -> None:
    path = tmp_path / "m.toml"
    path.write_text("".join(f"k{i} = nan\n" for i in range(5000)))
    assert len(_problems(path, toys)) == 100
    rows = "".join(f"[gravity.g{i}]\ntype = 'bal'\n" for i in range(5000))
    path.write_text(sound_mission + rows)
    problems = _problems(path, toys)
    assert len(problems) == 101
    assert problems[-1].message == "there are more problems than are listed"
    keys = "".join(f"k{i} = 1\n" for i in range(5000))
    path.write_text(sound_mission + "[gravity.big]\ntype = 'ball'\n" + keys)
    problems = _problems(path, toys)
    assert len(problems) == 101
    # 5000 unknown keys and a missing one, of which 100 are explained.
    assert problems[-1].message == "4901 more faults are not listed"
    assert problems[-1].line == 44


# --- what is not a readable file ------------------------------------------------------------


def test_missing_file(tmp_path: Path, toys: Registry) -> None:
    _seen(_problems(tmp_path / "none.toml", toys), ((None, "", "no such file"),))


def test_directory(tmp_path: Path, toys: Registry) -> None:
    (tmp_path / "d.toml").mkdir()
    problems = _problems(tmp_path / "d.toml", toys)
    _seen(problems, ((None, "", "is a directory"),))
    assert problems[0].message == "is a directory; give the mission file itself"


def test_pipe(tmp_path: Path, toys: Registry) -> None:
    os.mkfifo(tmp_path / "p.toml")
    _seen(_problems(tmp_path / "p.toml", toys), ((None, "", "is not a regular file"),))


def test_unreadable_file(
    tmp_path: Path, toys: Registry, sound_mission: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The tests may run as root, whom no permission stops: the refusal is played.
    path = tmp_path / "m.toml"
    path.write_text(sound_mission)

    def refuse(*args: object, **options: object) -> None:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr("os.open", refuse)
    _seen(_problems(path, toys), ((None, "", "permission denied"),))


def test_file_below_a_file(tmp_path: Path, toys: Registry) -> None:
    (tmp_path / "f").write_text("")
    _seen(_problems(tmp_path / "f" / "m.toml", toys), ((None, "", "Not a directory"),))


def test_path_with_null_character(toys: Registry) -> None:
    _seen(_problems(Path("a\0b.toml"), toys), ((None, "", "null"),))


def test_link_that_leads_to_itself(tmp_path: Path, toys: Registry) -> None:
    (tmp_path / "l.toml").symlink_to(tmp_path / "l.toml")
    _seen(_problems(tmp_path / "l.toml", toys), ((None, "", "cannot be read"),))


def test_unknown_packaged_name(toys: Registry) -> None:
    with pytest.raises(MissionError, match="no packaged mission has this name") as caught:
        load_mission("no-such-mission", registry=toys)
    assert len(caught.value.problems) == 1


# --- settings and profiles ------------------------------------------------------------------

SETTINGS: list[tuple[str, Expected]] = [
    ("a", (None, "", "write key=value")),
    ("=3", (None, "", "write key=value")),
    ("seed=", (None, "seed", 'an empty string is written ""')),
    ("a..b=1", (None, "", "not a key")),
    ("[a]=1", (None, "", "not a key")),
    ("#=1", (None, "", "not a key")),
    ("[a]#=1", (None, "", "not a key")),
    ("a.b\nc=1", (None, "", "one line")),
    ("seed=1\nname='x'", (None, "seed", "one line")),
    (".".join(["stage"] * 40) + "=1", (None, "", "deeper than 32")),
    ("stage.family.steps=" + "[" * 100, (None, "stage.family.steps", "deeper than 32")),
    ("stage.family.steps=[1", (None, "stage.family.steps", "not closed")),
    ("stage.family.steps=nan", (None, "stage.family.steps", "finite")),
    ("stage.family.steps=2027-01-01", (None, "stage.family.steps", "zone")),
    ("stage.family.steps=ten", (None, "stage.family.steps", "got a string 'ten'")),
    ("stage.family.steps=1.5", (None, "stage.family.steps", "a whole number, got 1.5")),
    ("stage.family.step=1", (None, "stage.family.step", "did you mean 'steps'?")),
    ("stage.famly.steps=1", (None, "stage.famly.type", "to change; did you mean 'family'?")),
    ("stge.family.steps=1", (None, "stge.family.steps", "did you mean 'stage'?")),
    ("stage.family.x_amplitudes_m=[-1]", (None, "stage.family.x_amplitudes_m[0]", "> 0 m")),
    ("stage.family.x_amplitudes_km.0=1", (None, "stage.family.x_amplitudes_km.0", "set it whole")),
    ("profile.fast.seed=1", (None, "profile.fast.seed", "chosen with --profile")),
    ("gravity.brick=3", (None, "gravity.brick", "expected a table [gravity.NAME], got 3")),
    ("name=a/b", (None, "name", "directory")),
    ("format=2", (None, "format", "reads format 1")),
    ("plant.hill.gravity=hep", (None, "plant.hill.gravity", "did you mean 'heap'?")),
    # Misspelt, while the file has the right key already.
    ("stage.family.plnat=hill", (None, "stage.family.plnat", "did you mean 'plant'?")),
    ("gravity.brick.axis_km=[1,2,3]", (None, "gravity.brick.axis_km", "you mean 'axes_km'?")),
    ("gravity.brick.axes=[1,2,3]", (None, "gravity.brick.axes", "needs a unit; write axes_m,")),
    ("titel=x", (None, "titel", "did you mean 'title'?")),
    ("plant.hill.zzz=1", (
        None, "plant.hill.zzz",
        "valid keys: body, gravity, spin_rad, spin_deg, spin_arcsec")),
]  # fmt: skip


@pytest.mark.parametrize(("setting", "expected"), SETTINGS, ids=[s[0][:30] for s in SETTINGS])
def test_bad_setting(
    setting: str, expected: Expected, tmp_path: Path, toys: Registry, sound_mission: str
) -> None:
    path = tmp_path / "m.toml"
    path.write_text(sound_mission)
    problems = [p for p in _problems(path, toys, sets=[setting]) if p.source.startswith("--set")]
    _seen(tuple(problems), (expected,))
    if "\n" not in setting:
        assert str(problems[0]).startswith(f"--set {setting.partition('=')[0][:20]}")


def test_profile_that_is_not_there(tmp_path: Path, toys: Registry, sound_mission: str) -> None:
    path = tmp_path / "m.toml"
    path.write_text(sound_mission)
    _seen(_problems(path, toys, profile="fst"), ((None, "", "did you mean 'fast'?"),))
    path.write_text(sound_mission[: sound_mission.index("[profile.fast]")])
    _seen(_problems(path, toys, profile="fast"), ((None, "", "it has none"),))


def test_fault_in_a_profile_names_the_profile_line(
    tmp_path: Path, toys: Registry, sound_mission: str
) -> None:
    path = tmp_path / "m.toml"
    path.write_text(sound_mission.replace("x_amplitudes_km = [100]\n", "x_amplitudes_km = [-1]\n"))
    load_mission(path, registry=toys)
    expected = ((40, "stage.family.x_amplitudes_km[0]", "must be > 0 km, got -1 km"),)
    _seen(_problems(path, toys, profile="fast"), expected)


# --- input files ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "fragment"),
    [
        ("none.csv", "no file 'none.csv' beside the mission file"),
        ("", "must not be empty"),
        ("../secret.csv", "leads out of the directories"),
        ("sub/../../secret.csv", "leads out of the directories"),
        ("link.csv", "leads out of the directories"),
        ("/etc/hostname", "absolute path; allow it with --allow-path"),
        ("sub", "is a directory"),
        (".", "is a directory"),
        (r"a\u0000b", "null character"),
        ("x" * 5000, "no file"),
        ("~/x.csv", "no file"),
        ("pipe.csv", "'pipe.csv' is not a regular file"),
    ],
    ids=lambda text: str(text)[:24],
)
def test_bad_input_file(
    file: str, fragment: str, tmp_path: Path, toys: Registry, sound_mission: str
) -> None:
    (tmp_path / "secret.csv").write_text("1")
    home = tmp_path / "home"
    (home / "sub").mkdir(parents=True)
    (home / "link.csv").symlink_to(tmp_path / "secret.csv")
    os.mkfifo(home / "pipe.csv")
    path = home / "m.toml"
    path.write_text(sound_mission + f'[gravity.file]\ntype = "file"\nfile = "{file}"\n')
    _seen(_problems(path, toys), ((46, "gravity.file.file", fragment),))


def test_article() -> None:
    assert [with_article(noun) for noun in ("Family", "OrbitSet")] == ["a Family", "an OrbitSet"]
