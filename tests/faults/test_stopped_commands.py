"""Commands that are asked to stop: gone within seconds, also while they compile."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.faults.command_lines import PLUGINS

from hillsphere.base.signals import GRACE_S

GONE_S = 5.0
"""Time in which a command is gone after a signal."""

MISSION = """format = 1
name = "compiles"
title = "Compiles"
seed = 4

[stage.before]
type = "forking"

[stage.long]
type = "compiling"
"""


@pytest.fixture
def started(tmp_path: Path) -> Iterator[list[subprocess.Popen[str]]]:
    (tmp_path / "compiles.toml").write_text(MISSION, "utf-8")
    processes: list[subprocess.Popen[str]] = []
    yield processes
    for process in processes:
        process.kill()
        process.communicate()


def start(directory: Path, *options: str) -> subprocess.Popen[str]:
    path = os.pathsep.join(map(str, [*PLUGINS, *filter(None, sys.path)]))
    return subprocess.Popen(
        [sys.executable, "-m", "hillsphere", "run", "compiles.toml", "--out", "out", *options],
        env={**os.environ, "PYTHONPATH": path, "HILLSPHERE_CACHE": str(directory / "cache")},
        cwd=directory, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip


def wait_for_compiling(process: subprocess.Popen[str], directory: Path) -> None:
    deadline = time.monotonic() + 60
    log = directory / "out/log.txt"
    while not (log.is_file() and "long: compiling" in log.read_text("utf-8")):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.02)


def of_session(session: int) -> list[str]:
    """Return the command lines of the processes of a session, which no group leaves."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            fields = (place / "stat").read_text().rpartition(")")[2].split()
            if int(fields[3]) == session and fields[0] != "Z":
                found.append((place / "cmdline").read_text().replace("\0", " "))
        except OSError:  # it has just ended
            continue
    return found


@pytest.mark.parametrize(
    ("options", "number"),
    [
        (("--workers", "0"), signal.SIGTERM),
        pytest.param(("--workers", "0"), signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(("--workers", "0"), signal.SIGHUP, marks=pytest.mark.slow),
        (("--workers", "1", "--set", "stage.long.elsewhere=true"), signal.SIGTERM),
    ],
)
def test_a_command_that_compiles_is_gone_soon_after_a_signal(
    tmp_path: Path,
    started: list[subprocess.Popen[str]],
    options: tuple[str, ...],
    number: signal.Signals,
) -> None:
    process = start(tmp_path, "--quiet", *options)
    started.append(process)
    wait_for_compiling(process, tmp_path)
    time.sleep(1.0)  # until it is in the compiler, or its worker is
    begin = time.monotonic()
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert time.monotonic() - begin < GONE_S
    assert process.returncode == 130
    assert "results so far are in out; continue with: hillsphere resume out --mission " in said
    assert said.count("\n") == 1
    assert of_session(process.pid) == []


def test_a_child_of_a_plugin_takes_no_signal_for_the_run(tmp_path: Path) -> None:
    """`multiprocessing` ends its children by SIGTERM, of which the run must not hear."""
    code = f"""
import os, signal, sys, time
from hillsphere.base.signals import end_in_time, interrupt
signal.signal(signal.SIGTERM, interrupt)
end_in_time()
child = os.fork()
if not child:
    time.sleep(60)
    os._exit(0)
time.sleep(0.2)
os.kill(child, signal.SIGTERM)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
time.sleep({GRACE_S + 0.5})
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "-15\n", "")
