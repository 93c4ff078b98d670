"""Hostile cases: a sound run, mission, cache or data file, spoilt, and what meets it."""

from __future__ import annotations

import json
import os
import random
import shutil
from collections.abc import Callable, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from tests.hostile.mutations import (
    Payloads,
    damage,
    mutate_npz,
    mutate_text,
    pickled,
    replace_file,
)
from tests.hostile.sentinel import CANARY

__all__ = ["Base", "Case", "make_case"]

MISSION = """format = 1
name = "waves"
title = "<b>Waves</b>"
seed = 4

[stage.wave]
type = "wave"

[dispersions.start]
type = "samples"
of = "stage.wave"
parameters = ["height"]
file = "heights.csv"

[stage.many]
type = "many"
repeat = "wave"
dispersions = ["start"]
cases = 70
"""
DATA = {
    "heights.csv": "height\n1.0\n1.1\n0.9\n",
    "field.gfc": "product_type gravity_field\nmodelname m\nearth_gravity_constant 7e5\nradius 1e4\n"
    "max_degree 2\nerrors no\nnorm fully_normalized\nend_of_head ===\ngfc 0 0 1.0 0.0\n"
    "gfc 2 0 -0.01 0.0\ngfc 2 2 0.001 0.002\n",
    "shape.obj": "v 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 0 0\nf 1 2 3\nf 1 4 2\nf 2 4 3\nf 1 3 4\n",
    "shape.tab": "0 0 11.0 0.0\n1 0 0.1 0.0\n1 1 0.1 0.1\n",
    "table.csv": "# source: a paper\na,b\n1,2\n3,4\n",
    "memory.json": '{"format": "hillsphere station memory", "version": 1, "stations": {}}',
    "passes.csv": "utc,azimuth_deg\n2026-01-01T00:00:00,1.0\n",
    "orbits.tle": "A\n1 25544U 98067A   24001.50000000  .00016717  00000-0  10270-3 0  9009\n"
    "2 25544  51.6400 208.9163 0006317  69.9862 290.2027 15.49309239426382\n",
}


@dataclass(frozen=True)
class Base:
    """What the cases are made from.

    Parameters
    ----------
    place : Path
        With the directories ``finished`` and ``broken`` (two runs), and the mission with its data.
    payloads : Payloads
        What is put into them.
    """

    place: Path
    payloads: Payloads

    @classmethod
    def make(cls, place: Path, payloads: Payloads) -> Base:
        """Make the runs; the second one looks as if it had been killed before it was finished."""
        from hillsphere.cli.endings import run
        from hillsphere.runs.store import RunDirectory

        place.mkdir()
        (place / "waves.toml").write_text(MISSION, "utf-8")
        for name, text in DATA.items():
            (place / name).write_text(text, "utf-8")
        np.savez(
            place / "system.npz",
            a=np.eye(2), b=np.ones((2, 1)), c=np.ones((1, 2)), d=np.zeros((1, 1)),
        )  # fmt: skip
        (place / "system.mat").write_bytes(b"")
        clear = RunDirectory.clear_workspace
        with chdir(place), redirect_stdout(StringIO()), redirect_stderr(StringIO()) as said:
            for out in ("finished", "broken"):
                if out == "broken":
                    RunDirectory.clear_workspace = lambda *_: None  # type: ignore[method-assign]
                code = run(["run", "waves.toml", "--out", out, "--workers", "0", "--no-cache"])
                if code:
                    raise RuntimeError(said.getvalue())
        RunDirectory.clear_workspace = clear  # type: ignore[method-assign]
        manifest = place / "broken" / "manifest.json"
        found = json.loads(manifest.read_text("utf-8"))
        found["stages"]["many"] |= {"product": None, "state": "interrupted"}
        manifest.write_text(json.dumps(found | {"state": "interrupted"}), "utf-8")
        (place / "broken" / "many.npz").unlink()
        for run_directory in ("finished", "broken"):
            (place / run_directory / f"{CANARY}.py").write_text("open('imported', 'w')\n")
        return cls(place, payloads)


@dataclass(frozen=True)
class Case:
    """One hostile case.

    Parameters
    ----------
    number : int
        Which of the seed.
    kind : str
        Of what.
    note : str
        What was done.
    act : callable
        Does what a user would; returns the exit code.
    """

    number: int
    kind: str
    note: str
    act: Callable[[], int]


def make_case(base: Base, seed: int, number: int, place: Path) -> Case:
    """Make a case of a seed in a directory of its own.

    Parameters
    ----------
    base : Base
        What it is made from.
    seed, number : int
        Which; the same make the same case.
    place : Path
        Its directory, which is made.
    """
    chance = random.Random(f"{seed}-{number}")
    shutil.copytree(base.place, place, symlinks=True)
    makers = (_run, _run, _run, _run, _mission, _cache, _data, _data, _output)
    kind = makers[number % len(makers)]
    note, act = kind(chance, base.payloads, place)
    return Case(number, kind.__name__.strip("_"), note, act)


def _commands(arguments: Sequence[str]) -> Callable[[], int]:
    def act() -> int:
        from hillsphere.cli.endings import run

        return int(run(list(arguments)))

    return act


def _run(chance: random.Random, payloads: Payloads, place: Path) -> tuple[str, Callable[[], int]]:
    name = chance.choice(["broken", "broken", "finished"])
    run = place / name
    notes = []
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        files = sorted(p for p in run.rglob("*") if p.suffix != ".py")
        # Half of the time what says how the run is continued, which harms most.
        few = [p for p in files if p.name in ("resume.json", "manifest.json")]
        path = chance.choice(few if few and chance.random() < 0.5 else files)
        how = chance.random()
        if path.name == "resume.json" and path.is_file() and not path.is_symlink() and how < 0.7:
            notes.append(_resume_facts(chance, payloads, path))
        elif path.is_file() and not path.is_symlink():
            notes.append(f"{path.relative_to(run)}: {damage(chance, path, payloads)}")
        else:
            notes.append(f"{path.relative_to(run)}: {replace_file(chance, path, payloads.outside)}")
    given = ["--mission", "waves.toml"] if chance.random() < 0.7 else []
    given += ["--allow-path"] if chance.random() < 0.3 else []
    which = chance.choice(["resume", "resume", "rerun", "figures", "export", "netcdf", "mat"])
    match which:
        case "resume":
            few_workers = ["--workers", "0"] if chance.random() < 0.3 else []
            words = ["resume", name, *given, *few_workers]
        case "rerun":
            words = ["rerun", name, "--case", str(chance.choice([0, 3, 69, 70])), *given]
        case "figures":
            words = ["figures", name, *given]
        case "export":
            words = ["export", name]
        case "netcdf":
            words = ["export", name, "--format", "netcdf", "--out", "x.nc"]
        case _:
            words = ["mat", f"{name}/{chance.choice(['wave', 'many', 'log'])}.npz"]
    return f"{' '.join(words)}: {'; '.join(notes)}", _commands(words)


def _resume_facts(chance: random.Random, payloads: Payloads, path: Path) -> str:
    try:
        facts = dict(json.loads(path.read_text("utf-8")))
    except (ValueError, TypeError, RecursionError):  # damaged before
        return "resume.json"
    key = chance.choice(["executor", "executor", "mission", "allow_path", "cache"])
    options: dict[str, list[Any]] = {
        "executor": payloads.executors(),
        "mission": [str(payloads.outside / "secret.toml"), "../outside/secret.toml", "phobos-qso",
                    "/dev/zero", str(payloads.outside / "pipe"), "-", f"{CANARY}\x1b[2J"],
        "allow_path": [True, 1, "yes"],
        "cache": [True, False, 3],
    }  # fmt: skip
    facts[key] = chance.choice(options[key])
    path.write_text(json.dumps(facts), "utf-8")
    return f"resume.json: {key} = {str(facts[key])[:60]!r}"


def _mission(
    chance: random.Random, payloads: Payloads, place: Path
) -> tuple[str, Callable[[], int]]:
    path = place / "waves.toml"
    text = MISSION
    how = chance.choice(["file", "file", "value", "text", "replaced", "title"])
    if how == "file":
        name = chance.choice([str(payloads.outside / "secret.txt"), "../outside/secret.txt",
                              str(payloads.outside / "passwd"), "/dev/zero", "pipe", "link.csv",
                              "zeros.csv", "broken/many.npz", "."])  # fmt: skip
        os.mkfifo(place / "pipe")
        (place / "link.csv").symlink_to(payloads.outside / "secret.txt")
        (place / "zeros.csv").symlink_to("/dev/zero")
        text = text.replace("heights.csv", name)
    elif how == "value":
        word = chance.choice(['"wave"', '"samples"', "70", '"start"', "4", '["height"]'])
        new = chance.choice(payloads.values())
        text = text.replace(word, json.dumps(new, default=str), 1)
    elif how == "text":
        text = mutate_text(chance, text.encode()).decode("utf-8", "replace")
    elif how == "title":
        text = text.replace("<b>Waves</b>", "<script src=//evil></script>\\u001b[2J")
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    if how == "replaced":
        replace_file(chance, path, payloads.outside, links=False)
    if chance.random() < 0.3:
        damage(chance, place / "heights.csv", payloads)
    words = (
        ["validate", "waves.toml"]
        if chance.random() < 0.5
        else ["run", "waves.toml", "--out", "out", "--workers", "0"]
    )
    return f"{words[0]}: {how}", _commands(words)


def _cache(chance: random.Random, payloads: Payloads, place: Path) -> tuple[str, Callable[[], int]]:
    """Return a run whose cache somebody has prepared: products, functions and machine code."""
    from hillsphere.cli.endings import run

    cache = place / "cache"
    os.environ["HILLSPHERE_CACHE"] = str(cache)
    words = ["run", "waves.toml", "--workers", "0", "--out"]
    with chdir(place), redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        run([*words, "first"])
    functions = cache / "compiled" / "functions"
    functions.mkdir(parents=True, mode=0o700)
    functions.parent.chmod(0o700)
    key = "0" * 64
    content = pickled()
    # A digest that fits: whoever writes an entry can write that, too.
    entry = functions / f"{key}.function"
    entry.write_bytes(sha256(key.encode() + content).digest() + content)
    entry.chmod(0o666)  # as a stranger's is seen by this user, who could trust his own
    (cache / "compiled" / "cache.db").write_bytes(b"SQLite format 3\0")
    path = chance.choice([cache, *sorted(cache.rglob("*"))])
    spoil = chance.choice(["mode", "owner", "content", "replaced"])
    if spoil == "mode":
        path.chmod(0o777 if path.is_dir() else 0o666)
    elif spoil == "owner" and os.geteuid() == 0:
        os.chown(path, 12345, -1)
    elif spoil == "content" and path.is_file():
        content = path.read_bytes()
        is_archive = path.suffix == ".npz"
        path.write_bytes(
            mutate_npz(chance, content, payloads) if is_archive else mutate_text(chance, content)
        )
    elif path != cache:
        spoil = replace_file(chance, path, payloads.outside)

    def act() -> int:
        from hillsphere.base.paths import compiled_code_directory
        from hillsphere.symbolic.compile_cache import _load

        used = compiled_code_directory()
        _load(used / "functions" / f"{key}.function", key)
        return int(run([*words, "out"]))

    return f"a run with a cache: {path.relative_to(place)}: {spoil}", act


def _data(chance: random.Random, payloads: Payloads, place: Path) -> tuple[str, Callable[[], int]]:
    """Return what reads a data file."""
    from hillsphere.base.orientation import OrientationTable
    from hillsphere.formats.obj import read_obj
    from hillsphere.formats.shape_harmonics import read_shape_harmonics
    from hillsphere.products.product_codec import load_product
    from hillsphere.show.reference import ReferenceTable
    from hillsphere.uncertainty.samples import read_columns
    from hillsphere_controllers.stages.linear_models.systems import system_from_file
    from hillsphere_gravity.icgem import read_icgem
    from hillsphere_gravity.shadr import read_shadr
    from hillsphere_tracking.memory import read_memory
    from hillsphere_tracking.passes.sources import orbits_of_file
    from hillsphere_tracking.pointing.pass_log import read_pass_log

    readers: dict[str, list[Callable[[Path], object]]] = {
        "heights.csv": [read_columns],
        "field.gfc": [read_icgem, read_shadr, OrientationTable.read],
        "shape.obj": [read_obj],
        "shape.tab": [read_shape_harmonics],
        "table.csv": [ReferenceTable.read],
        "memory.json": [read_memory],
        "passes.csv": [read_pass_log],
        "orbits.tle": [orbits_of_file],
        "system.npz": [system_from_file],
        "system.mat": [system_from_file],
        "finished/many.npz": [load_product],
        "body.bsp": [_kernel],
    }
    name = chance.choice(list(readers))
    path = place / name
    if name == "body.bsp":
        path.write_text(f"KPL/MK\n\\begindata\nKERNELS_TO_LOAD=('{payloads.outside}/secret.txt')\n")
    how = damage(chance, path, payloads, links=False)

    def act() -> int:
        from hillsphere.errors import InputError, StageError

        for read in readers[name]:
            try:
                read(path)
            except InputError as error:
                print(str(error)[:300])  # noqa: T201 - it is judged like what a command says
            except StageError:
                return 1
        return 0

    return f"{name}: {how}", act


def _kernel(path: Path) -> object:
    from hillsphere import create

    body = create("body", "spice", kernel=str(path), target="399")
    return body.states(np.zeros(1))


def _output(
    chance: random.Random, payloads: Payloads, place: Path
) -> tuple[str, Callable[[], int]]:
    """Return a command whose output is no regular file, or a link."""
    path = place / "result"
    if chance.random() < 0.5:
        path.write_text("old")
    # What a link that the user has named leads to is written: here, to a file of the case.
    (place / "outputs").mkdir()
    for stand_in in ("passwd", "secret.txt"):
        (place / "outputs" / stand_in).write_text("old")
    os.mkfifo(place / "outputs" / "pipe")
    how = replace_file(chance, path, place / "outputs")
    name = "result"
    words = chance.choice(
        [
            ["export", "finished", "--out", name],
            ["export", "finished", "--format", "netcdf", "--out", name],
            ["run", "waves.toml", "--out", name, "--workers", "0"],
        ]
    )
    return f"{' '.join(words)}: {how}", _commands(words)
