"""A synthesis that is interrupted on the command line and resumed makes the same controller."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from numpy.testing import assert_array_equal

from hillsphere.cli.endings import run
from hillsphere.products.product_codec import load_product
from hillsphere_controllers.stages.synthesis.products import Synthesis
from hillsphere_controllers.structured.records import SearchResult, Start
from hillsphere_controllers.structured.search import Search

MISSION = """format = 1
name = "mass"
title = "A mass that is pushed"
seed = 3

[stage.mass]
type = "linear_models"
figures = false
systems = [
    { numerator = [1], denominator = [1, 0, 0], inputs = ["push"], outputs = ["x"] },
    { d = [[0.1]], inputs = ["u"], outputs = ["effort"] },
]
junctions = ["push = u + f", "y = x + noise"]
inputs = ["f", "noise"]
outputs = ["x", "effort"]
controls = ["u"]
measurements = ["y"]

[stage.structured]
type = "synthesis"
needs = { models = "mass" }
method = "structured"
figures = false

[stage.structured.structured]
parts = [{ kind = "transfer_function", order = 1 }]
starts = 3
shaken = false
"""


def as_at_a_terminal() -> None:
    """Take the signal as there: a child of a background job of a shell is born deaf to it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def started(*arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "hillsphere", *map(str, arguments)], stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, start_new_session=True, preexec_fn=as_at_a_terminal,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )  # fmt: skip


def wait(process: subprocess.Popen[str], there: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120.0
    while not there():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.005)


def made(directory: str) -> Synthesis:
    product = load_product(Path(directory, "structured.npz"))
    assert isinstance(product, Synthesis)
    return product


def test_an_interrupted_synthesis_is_resumed_to_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The searches that ended before are not repeated, and change nothing."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HILLSPHERE_CACHE", str(tmp_path / "cache"))
    Path("mission.toml").write_text(MISSION, "utf-8")
    work = Path("out", "work", "structured")

    def kept() -> set[str]:
        return {path.name for path in work.glob("searches-*/search-*.npz")}

    process = started("run", "mission.toml", "--out", "out", "--workers", "0", "--no-cache")
    try:
        wait(process, lambda: len(kept()) >= 1)
        process.send_signal(signal.SIGINT)
        stdout, stderr = process.communicate(timeout=60)
    finally:
        process.kill()
    assert (process.returncode, stdout) == (130, "")
    assert "continue with: hillsphere resume out" in stderr
    before = kept()
    assert 1 <= len(before) < 3
    (failure,) = json.loads(Path("out", "summary.json").read_text("utf-8"))["failures"]
    assert (failure["stage"], failure["state"]) == ("structured", "interrupted")
    assert not Path("out", "structured.npz").exists()

    searched: list[int] = []
    search = Search.__call__

    def counted(self: Search, start: Start) -> SearchResult:
        searched.append(start.number)
        return search(self, start)

    monkeypatch.setattr(Search, "__call__", counted)
    code = run(["resume", "out", "--mission", "mission.toml", "--workers", "0"])
    assert code == 0, capsys.readouterr().err
    assert sorted(searched) == [k for k in range(3) if f"search-{k:05d}.npz" not in before]
    assert run(["run", "mission.toml", "--out", "whole", "--workers", "0", "--no-cache"]) == 0
    capsys.readouterr()
    whole, resumed = made("whole"), made("out")
    for name in ("a", "b", "c", "d"):
        assert_array_equal(getattr(resumed.controller, name), getattr(whole.controller, name))
    assert (resumed.gamma, resumed.controller.order) == (whole.gamma, 1)
    assert (
        Path("out", "structured.npz").read_bytes() == Path("whole", "structured.npz").read_bytes()
    )
    assert not work.exists()
