"""Whatever a mission file holds, it ends in a mission or in a message.

Mutated text is loaded; missions with mutated values go through all of ``hillsphere validate``.
"""

from __future__ import annotations

import io
import random
import re
import shutil
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hillsphere.base.paths import missions_directory
from hillsphere.cli.endings import run
from hillsphere.mission import MissionError, load_mission
from hillsphere.plugins import Registry, discover

REAL = """\
format = 1
name = "real"
title = "Real gravity models"
seed = 1
[body.phobos]
type = "moon"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9377.0
[gravity.phobos]
type = "ellipsoid"
axes_km = [13.03, 11.40, 9.14]
density_g_cm3 = 1.860
[gravity.core]
type = "point_mass"
gm_km3_s2 = 7.0875e-4
[gravity.series]
type = "harmonics"
gm_km3_s2 = 7.0875e-4
reference_radius_km = 11.1
normalisation = "full"
tide_system = "none"
coefficients = [{ n = 2, m = 0, c = -4.698e-2 }, { n = 2, m = 2, c = 2.276e-2, s = -1e-4 }]
[gravity.both]
type = "sum"
parts = [{ model = "phobos" }, { model = "core", position_km = [1, 0, 0], scale = -0.5 }]
[plant.hill]
type = "hill"
body = "phobos"
gravity = "both"
prime_meridian_deg = 180
[profile.other]
gravity.phobos.axes_m = [1, 2, 3]
"""

PIECES = [
    b"=", b".", b",", b"[", b"]", b"[[", b"]]", b"{", b"}", b"\n", b"\r", b"\r\n", b'"', b"'",
    b'"""', b"'''",
    b"#", b"\\", b" ", b"true", b"-1", b"0", b"1e308", b"1e-320", b"1e999", b"nan", b"-inf",
    b"9" * 30, b'""',
    b"[]", b"{}", b"2027-05-01", b"2027-05-01T12:00:00Z", b"\0", b"\x1b", b"\xff", b"\xc3\xa9",
    b"\xef\xbb\xbf",
    b"_km", b"_m", b"_deg", b"type", b"gravity", b"stage", b"profile", b"needs", b"brick", b"heap",
    b"family",
    b"../..", b"/etc/passwd", b'"\\u0000"', b"[" * 50, b"a." * 50, b"\xf0\x9f\x9a\x80",
    b"format = 2\n",
]  # fmt: skip

Mutation = Callable[[bytes], bytes]


@st.composite
def _mutations(draw: st.DrawFn) -> Mutation:
    """One change: bytes overwritten, a piece put in, a stretch cut, doubled or moved."""
    where = draw(st.floats(0, 1))
    length = draw(st.integers(0, 40))
    kind = draw(st.sampled_from(["piece", "bytes", "cut", "double", "swap", "token", "line"]))
    piece = draw(st.sampled_from(PIECES))
    noise = draw(st.binary(max_size=4))
    other = draw(st.floats(0, 1))

    def mutate(data: bytes) -> bytes:
        at = int(where * len(data))
        if kind == "piece":
            return data[:at] + piece + data[at:]
        if kind == "bytes":
            return data[:at] + noise + data[at + len(noise) :]
        if kind == "cut":
            return data[:at] + data[at + length :]
        if kind == "double":
            return data[:at] + data[at : at + length] * 2 + data[at + length :]
        if kind == "swap":
            to = int(other * len(data))
            return data[:to] + data[at : at + length] + data[to:]
        separator = b"\n" if kind == "line" else b" "
        tokens = data.split(separator)
        tokens[int(where * (len(tokens) - 1))] = tokens[int(other * (len(tokens) - 1))] if (
            kind == "line" or length % 2
        ) else piece  # fmt: skip
        return separator.join(tokens)

    return mutate


def _load(path: Path, registry: Registry, data: bytes, setting: str | None) -> bool:
    path.write_bytes(data)
    try:
        load_mission(path, registry=registry, sets=[] if setting is None else [setting])
        return True
    except MissionError as error:
        problems = error.problems
    assert problems
    assert all(str(problem).isprintable() for problem in problems)
    return False


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File that every example overwrites."""
    return tmp_path_factory.mktemp("fuzz") / "m.toml"


_SETTINGS = settings(
    max_examples=800,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@_SETTINGS
@given(mutations=st.lists(_mutations(), min_size=1, max_size=4))
def test_mutated_toys(
    mutations: list[Mutation], scratch: Path, toys: Registry, sound_mission: str
) -> None:
    data = sound_mission.encode()
    for mutate in mutations:
        data = mutate(data)
    _load(scratch, toys, data, None)


REGISTRY = discover()


@settings(_SETTINGS, max_examples=400)
@given(mutations=st.lists(_mutations(), min_size=1, max_size=3))
def test_mutated_real_models(mutations: list[Mutation], scratch: Path) -> None:
    data = REAL.encode()
    for mutate in mutations:
        data = mutate(data)
    _load(scratch, REGISTRY, data, None)


@settings(_SETTINGS, max_examples=250)
@given(
    setting=st.one_of(
        st.text(max_size=40),
        st.builds(
            "{}={}".format,
            st.sampled_from(
                ["stage.family.steps", "gravity.brick.axes_km", "name", "gravity", "a.b"]
            ),
            st.one_of(st.text(max_size=20), st.sampled_from([p.decode("latin-1") for p in PIECES])),
        ),
    )
)
def test_any_setting(setting: str, scratch: Path, toys: Registry, sound_mission: str) -> None:
    _load(scratch, toys, sound_mission.encode(), setting)


@settings(_SETTINGS, max_examples=150)
@given(data=st.binary(max_size=200))
def test_any_bytes(data: bytes, scratch: Path, toys: Registry) -> None:
    assert not _load(scratch, toys, data, None)


def test_mutations_leave_some_missions_sound(
    scratch: Path, toys: Registry, sound_mission: str
) -> None:
    # Guards the tests above: their starting points are sound but for the missing stage.
    assert _load(scratch, toys, sound_mission.encode(), None)
    assert _load(scratch, toys, sound_mission.encode(), "stage.family.steps=3")
    scratch.write_text(REAL)
    with pytest.raises(MissionError) as caught:
        load_mission(scratch, registry=REGISTRY)
    assert [p.message[:14] for p in caught.value.problems] == ["nothing to run"]


STARTS = (
    "phobos-hover",
    "robust-control-demo",
    "deimos-qso",
    "assisted-tracking",
    "bennu-formation",
)
"""Packaged missions of many kinds of components that are made in a third of a second."""

WORDS = [
    "0", "-1", "1", "2", "0.5", "1e-320", "1e-9", "1e6", "1e300", "-1e300", "nan", "inf", "9" * 30,
    "true", "false", '""', '"x"', '"../x"', "[]", "{}", "[0]", "[1, 2]", "[[1]]", "[0, 0, 0]",
    "{ a = 1 }", "2027-05-01",
]  # fmt: skip

_TOKEN = re.compile(r'"[^"\n]*"|(?<![\w.])-?\d[\w.+-]*|\[[^\[\]\n]*\]')
"""A string, a number, or an array within a line."""


def _with_other_values(chance: random.Random, text: str) -> str:
    """Return a mission with one to three values replaced, or lines left out or doubled."""
    for _ in range(chance.choice([1, 1, 2, 3])):
        tokens = [*_TOKEN.finditer(text)]
        kind = chance.random()
        if kind < 0.15:
            lines = text.splitlines(keepends=True)
            at = chance.randrange(len(lines))
            lines[at : at + 1] = [] if chance.random() < 0.5 else lines[at : at + 1] * 2
            text = "".join(lines)
            continue
        token = chance.choice(tokens)
        other = chance.choice(WORDS) if kind < 0.6 else chance.choice(tokens)[0]
        text = text[: token.start()] + other + text[token.end() :]
    return text


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory with the data of the packaged missions."""
    there = tmp_path_factory.mktemp("values")
    shutil.copytree(missions_directory() / "data", there / "data")
    return there


def _validate(folder: Path, text: str) -> tuple[int, str]:
    path = folder / "m.toml"
    path.write_text(text, "utf-8")
    told = io.StringIO()
    with redirect_stdout(told), redirect_stderr(told):
        code = run(["validate", str(path)])
    return code, told.getvalue()


@pytest.mark.parametrize(
    "seeds", [range(60), pytest.param(range(60, 1060), marks=pytest.mark.slow)], ids=["few", "many"]
)
def test_mutated_values_are_validated(seeds: range, folder: Path) -> None:
    codes, faults = [], []
    for seed in seeds:
        chance = random.Random(seed)
        mission = chance.choice(STARTS)
        text = (missions_directory() / f"{mission}.toml").read_text("utf-8")
        code, told = _validate(folder, _with_other_values(chance, text))
        codes.append(code)
        # "cannot make it" is what is said of a plugin's class that raises a raw exception.
        if code not in (0, 2) or "Traceback" in told or "cannot make it" in told:
            faults.append(f"seed {seed}, {mission}: code {code}: {told[-600:]}")
    assert not faults, "\n".join(faults)
    assert {0, 2} <= set(codes)
