"""Missions with something wrong in them: refused in plain words, or run within limits."""

from __future__ import annotations

import json
import random
import re
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from tests.faults.command_lines import PLUGINS, CommandLines, Ended
from tests.faults.mission_mutants import Mutant, mutant

from hillsphere.errors import InputError
from hillsphere.mission import load_mission
from hillsphere.plugins import Registry, discover

GONE_S = 5.0
"""Time in which a command is gone after a signal."""

RUN_S = 10.0
MEMORY = 2 << 30
"""Limits of a run: wall-clock time until it is sent SIGTERM, bytes of its address space."""

CHEAP = ("waves", "hover", "dumbbell-moon")
"""Missions whose mutants cost about a second each."""


@pytest.fixture(scope="module")
def registry() -> Iterator[Registry]:
    with pytest.MonkeyPatch.context() as patch:
        for place in PLUGINS:
            patch.syspath_prepend(str(place))
        registry = discover()
        assert not registry.broken
        # Specs of plugins are imported when a mission first needs them.
        yield registry


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the directory in which mutants are checked and run."""
    return tmp_path_factory.mktemp("mutants")


def validated(numbers: Sequence[int], scratch: Path, registry: Registry) -> list[Mutant]:
    """Check mutants under each of their profiles; return those that are sound."""
    sound = []
    path = scratch / "m.toml"
    for number in numbers:
        made = mutant(number)
        path.write_bytes(made.data)
        try:
            mission = load_mission(path, registry=registry)
            for profile in mission.profiles:
                load_mission(path, registry=registry, profile=profile)
        except InputError as error:
            lines = str(error).split("\n")
            assert all(lines), (number, lines)
            assert all(line.isprintable() for line in lines), (number, lines)
        else:
            sound.append(made)
    return sound


def run(
    commands: CommandLines, made: Mutant, stop_s: float | None = None
) -> tuple[Ended, list[str]]:
    """Run a mutant within limits, and resume it if it was stopped; return what is wrong.

    It is stopped after `stop_s` if that is given, or else by chance.
    """
    chance = random.Random(f"run {made.number}")
    (commands.directory / "m.toml").write_bytes(made.data)
    out = f"out-{made.number}"
    profile = ["--profile", "fast"] if b"[profile.fast" in made.data else []
    # In a quarter the signal comes at any moment, as few runs last so long; in a tenth there is a
    # worker, whose start takes longer than most of the runs; in a tenth there are figures.
    done = commands(
        "run", "m.toml", "--out", out, "--no-cache", "--quiet", *profile,
        "--workers", int(chance.random() < 0.1),
        seconds=stop_s or (RUN_S if chance.random() < 0.75 else chance.uniform(0.05, 6.0)),
        memory=MEMORY, draws=chance.random() < 0.1,
    )  # fmt: skip
    wrong = faults_of(done)
    place = commands.directory / out
    if done.code == 130 and (place / "manifest.json").is_file():
        again = commands(
            "resume", out, "--mission", "m.toml", "--quiet", seconds=2.0, memory=MEMORY, draws=False
        )
        wrong += [f"resumed: {fault}" for fault in faults_of(again)]
        if again.code == 2:
            wrong.append(f"it is not resumed: {again.text}")
    for path in [*place.glob("*.json")]:
        json.loads(path.read_text("utf-8"))
    shutil.rmtree(place, ignore_errors=True)
    return done, wrong


def faults_of(done: Ended) -> list[str]:
    """Return what a command did that none may, whatever its mission is."""
    wrong = []
    if done.code not in (0, 1, 2, 130):
        wrong.append(f"exit code {done.code}: {done.text[-500:]}")
    if "Traceback" in done.text or "internal error" in done.text:
        wrong.append(done.text[-500:])
    if done.after_s > GONE_S:
        wrong.append(f"it lived for {done.after_s:.1f} s after the signal")
    if done.lost:
        wrong.append(f"it left processes: {done.lost}")
    if done.code == 2 and len(re.findall(r"^\S", done.text, re.M)) < 1:
        wrong.append("no message")
    return wrong


def test_mutants_are_refused_in_plain_words_and_run_within_limits(
    scratch: Path, registry: Registry
) -> None:
    sound = validated(range(200), scratch, registry)
    shares = zip(CHEAP, (4, 1, 2), strict=True)
    some = [made for base, n in shares for made in [m for m in sound if m.base == base][:n]]
    assert len(some) == 7
    ends: Counter[int] = Counter()
    with CommandLines(scratch) as commands:
        for k, made in enumerate(some):
            # The first compiles its equations, which takes more than a second. Stopped after 0.1 s
            # it is not near its end, however fast the machine is.
            done, wrong = run(commands, made, 0.1 if k == 0 else None)
            assert not wrong, (made.number, made.base, made.changes, wrong)
            ends[done.code] += 1
    assert ends[0] >= 2
    assert ends[130] >= 1


@pytest.mark.slow
def test_ten_thousand_mutants_are_refused_in_plain_words_and_a_thousand_run(
    scratch: Path, registry: Registry
) -> None:
    sound = validated(range(10_000), scratch, registry)
    cheap = [made for made in sound if made.base in CHEAP]
    others = [made for made in sound if made.base not in CHEAP]
    some = [*cheap[:750], *others][:1000]
    assert len(some) == 1000
    wrong = {}
    with CommandLines(scratch) as commands:
        for made in some:
            _, found = run(commands, made)
            if found:
                wrong[made.number, made.base] = found
    assert not wrong
