"""Run directories whose JSON files hold values of other types: one message, and nothing written."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterable, Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from hashlib import sha256
from io import StringIO
from pathlib import Path

import pytest
from tests.core.mutations import with_other_type
from tests.core.wave_missions import WAVES, waves_mission

from hillsphere.cli.endings import run
from hillsphere.plugins import default_registry

MISSION = waves_mission(10)
MISSION_AGAIN = ("--mission", "waves.toml")
COMMANDS = {
    "resume": ("resume", "out", *MISSION_AGAIN, "--workers", "0"),
    "resume as JSON": ("resume", "out", "--json"),
    "report": ("report", "out", "--verbose"),
    "compare": ("compare", "out", "sound"),
    "rerun": ("rerun", "out", "--case", "3", *MISSION_AGAIN),
    "figures": ("figures", "out", *MISSION_AGAIN),
    "export": ("export", "out"),
    "export as netCDF": ("export", "out", "--format", "netcdf"),
}
FILES = ("manifest.json", "resume.json", "summary.json")
SAMPLE = 8
"""Broken files of each kind for each command in every run of the tests."""
MANY = 150


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Directory with ``waves.toml`` and a finished run ``sound`` of it."""
    place = tmp_path_factory.mktemp("broken")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HILLSPHERE_CACHE", str(place / "cache"))
        patch.syspath_prepend(str(WAVES))
        default_registry.cache_clear()
        (place / "waves.toml").write_text(MISSION, "utf-8")
        code, said = command(place, "run", "waves.toml", "--out", "sound", "--workers", "0")
        assert (code, said) == (0, "")
        yield place
    default_registry.cache_clear()


def command(place: Path, *arguments: str) -> tuple[int, str]:
    """Run a command; return its exit code and what it says on stderr."""
    err = StringIO()
    with chdir(place), redirect_stdout(StringIO()), redirect_stderr(err):
        code = run(arguments)
    return int(code), err.getvalue()


def digests(directory: Path) -> dict[str, str]:
    return {
        str(path.relative_to(directory)): sha256(path.read_bytes()).hexdigest()
        for path in directory.rglob("*")
        if path.is_file()
    }


def break_and_use(place: Path, name: str, file: str, seeds: Iterable[int]) -> None:
    out, wrong = place / "out", []
    for seed in seeds:
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(place / "sound", out)
        if seed % 2:
            manifest = json.loads((out / "manifest.json").read_text("utf-8"))
            (out / "manifest.json").write_text(json.dumps({**manifest, "state": "interrupted"}))
        (out / file).write_bytes(with_other_type((out / file).read_bytes(), seed))
        before = digests(out)
        code, said = command(place, *COMMANDS[name])
        after = digests(out)
        if code == 2:
            if not re.search(r"\bout\b", said) or "Traceback" in said:
                wrong.append((seed, "the message does not name the run", said))
            if after != before:
                wrong.append((seed, "refused, but something was written", said))
        elif code != 0 and not (code == 4 and name == "compare"):  # 4: another result
            wrong.append((seed, f"exit code {code}", said))
        if any(path.endswith(".part") for path in after):
            wrong.append((seed, "half a file", said))
    assert not wrong


@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("name", COMMANDS)
def test_values_of_other_types_are_refused_or_none_of_the_results(
    place: Path, name: str, file: str
) -> None:
    # 43 gives a time of the manifest another type, 1082 a stage; both were told without the run's
    # name. A case that is repeated starts a process, which takes a second.
    more = range(44, 44 + (1 if name == "rerun" else SAMPLE - 1))
    break_and_use(place, name, file, [43, 1082, *more])


@pytest.mark.slow
@pytest.mark.parametrize("file", FILES)
@pytest.mark.parametrize("name", COMMANDS)
def test_many_values_of_other_types(place: Path, name: str, file: str) -> None:
    break_and_use(place, name, file, range(1000, 1000 + MANY))
