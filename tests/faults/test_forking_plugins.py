"""Plugins that fork and let the child return to the framework: one run, and no more processes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.faults.command_lines import PLUGINS, ROOT, CommandLines, digests
from tests.faults.run_server import control_group

from hillsphere.base.stray_processes import _FRAMEWORK

MISSION = """format = 1
name = "forks"
title = "Forks"
seed = 4

[stage.fork]
type = "forking"

[dispersions.start]
type = "normal"
of = "stage.fork"
parameters = ["height"]
sigma = 0.2

[stage.many]
type = "many_forks"
repeat = "fork"
dispersions = ["start"]
cases = 700
"""
PROCESSES = 30
"""Limit of a run. Without the guard a place that forks once per block of 64 cases makes 2¹¹
processes, and one that forks once per piece 2⁴⁰."""


@pytest.fixture(scope="module")
def commands(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CommandLines]:
    if os.geteuid() == 0 and control_group() is None:
        pytest.skip("no process may limit those of root here: no control group can be made")
    directory = tmp_path_factory.mktemp("forks")
    (directory / "forks.toml").write_text(MISSION, "utf-8")
    with CommandLines(directory) as commands:
        yield commands
    if (group := control_group()) is not None:
        group.rmdir()


@pytest.fixture(scope="module")
def undisturbed(commands: CommandLines) -> dict[str, str]:
    done = commands("run", "forks.toml", "--workers", 0, "--out", "whole", "--no-cache")
    assert done.code == 0, done.text
    return digests(commands.directory / "whole")


@pytest.mark.parametrize(
    ("where", "workers"),
    [
        *((where, 0) for where in ("construct", "run", "raise", "leave", "thread", "pieces",
                                   "between", "advance", "present", "case", "inputs")),
        ("case", 1),
        pytest.param("case", 2, marks=pytest.mark.slow),
        pytest.param("construct", 2, marks=pytest.mark.slow),
        pytest.param("inputs", 2, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_children_end_when_they_come_back(
    commands: CommandLines, undisturbed: dict[str, str], where: str, workers: int
) -> None:
    out = f"{where}-{workers}"
    done = commands(
        "run", "forks.toml", "--workers", workers, "--out", out, "--no-cache", "--set",
        f"stage.fork.where={where}", processes=PROCESSES, seconds=60.0,
    )  # fmt: skip
    assert (done.code, done.signalled, done.lost) == (0, False, []), done.text
    assert digests(commands.directory / out) == undisturbed
    said = done.text.splitlines()
    told = [line for line in said if "has forked came back into" in line]
    if where != "thread":  # whose child has no code of the framework to come back to
        assert len(told) >= 1
        assert "unruly_plugin.py:" in told[0]
    # One message for each process and place that forks, and one result.
    assert len(told) <= 1 + workers
    assert sum(line.startswith("forks: every stage finished") for line in said) == 1


def test_a_plugin_that_forks_when_it_is_imported(
    commands: CommandLines, undisturbed: dict[str, str], tmp_path: Path
) -> None:
    (tmp_path / "forks.toml").write_text(MISSION, "utf-8")
    path = os.pathsep.join(map(str, [*PLUGINS, *filter(None, sys.path)]))
    done = subprocess.run(
        [sys.executable, "-m", "hillsphere", "run", "forks.toml", "--workers", "0", "--out", "out"],
        env={**os.environ, "PYTHONPATH": path, "UNRULY_PLUGIN": "import"}, cwd=tmp_path,
        capture_output=True, text=True, check=False, timeout=60, process_group=0,
    )  # fmt: skip
    assert done.returncode == 0
    assert done.stderr.count("has forked came back into") == 1
    assert digests(tmp_path / "out") == undisturbed


def test_children_that_do_not_come_back_are_left_alone(
    commands: CommandLines, undisturbed: dict[str, str]
) -> None:
    done = commands(
        "run", "forks.toml", "--workers", 0, "--out", "sound", "--no-cache",
        "--set", "stage.fork.where=sound", seconds=60.0,
    )  # fmt: skip
    assert (done.code, done.lost) == (0, []), done.text
    assert "has forked" not in done.text
    assert digests(commands.directory / "sound") == undisturbed


def test_a_child_that_outlives_a_killed_run_holds_no_lock(tmp_path: Path) -> None:
    """A plugin's pool lives on when the run is killed; the run can be resumed all the same."""
    (tmp_path / "forks.toml").write_text(MISSION, "utf-8")
    path = os.pathsep.join(map(str, [*PLUGINS, *filter(None, sys.path)]))
    environment = {**os.environ, "PYTHONPATH": path}
    process = subprocess.Popen(
        [sys.executable, "-m", "hillsphere", "run", "forks.toml", "--workers", "0", "--out", "out",
         "--set", "stage.fork.where=stays"],
        env=environment, cwd=tmp_path, stderr=subprocess.PIPE, text=True, process_group=0,
    )  # fmt: skip
    try:
        assert process.stderr is not None
        assert process.stderr.readline() == "child started\n"
        time.sleep(0.1)  # until the child, which was only just started, is at its work
        process.kill()
        process.wait()
        code = (
            "from pathlib import Path\nfrom hillsphere.runs.store import RunDirectory\n"
            "with RunDirectory(Path('out')).locked():\n    print('free')\n"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], env=environment, cwd=tmp_path, capture_output=True,
            text=True, check=False,
        )  # fmt: skip
        assert done.stdout == "free\n", done.stderr
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        if process.stderr is not None:
            process.stderr.close()


def test_every_package_that_comes_with_the_framework_is_known() -> None:
    table = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert {"hillsphere", *table["entry-points"]["hillsphere"]} == _FRAMEWORK
