"""Runs that are killed, or whose files cannot be written: what comes of them is always the same."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from tests.core.cases.toy_cases import ROOT

from hillsphere.products import CaseTable
from hillsphere.products.product_codec import load_product

KILLED = -9
MISSION = """format = 1
name = "faults"
title = "A spacecraft held over a moon"
seed = 3

[body.moon]
type = "moon"
name = "moon"
primary_gm_km3_s2 = 42828.37
semi_major_axis_km = 9377
semi_axes_km = [13.03, 11.40, 9.14]

[gravity.point]
type = "point_mass"
gm_m3_s2 = 7.1e5

[plant.hill]
type = "hill"
body = "moon"
gravity = "point"

[compensator.direct]
type = "pid"
period_s = 60
proportional = [2.5e-5, 2.5e-5, 2.5e-5]
derivative = [0.0075, 0.0075, 0.0075]

[dispersions.mass]
type = "normal"
of = "gravity.point"
parameters = ["gm"]
sigma_relative = 0.01

[stage.hover]
type = "closed_loop"
plant = "hill"
law = "direct"
target = { position_km = [20, 0, 0] }
duration_min = 133
navigation = { position_m = 5, velocity_mm_s = 2 }
limits = { position_error_km = 2 }
require = { largest_position_error_m = 58 }

[stage.verify]
type = "monte_carlo"
repeat = "hover"
dispersions = ["mass"]
cases = 500
"""

Fault = dict[str, Any]


@dataclass
class Runs:
    """The command line, in processes in which something goes wrong; see `faulty_runs`."""

    server: subprocess.Popen[str]
    directory: Path
    number: int = 0

    def __call__(self, *arguments: object, fault: Fault | None = None) -> dict[str, Any]:
        assert self.server.stdin is not None
        assert self.server.stdout is not None
        request = {
            "arguments": [*map(str, arguments), "--quiet"],
            "fault": fault,
            "log": str(self.directory / "output.txt"),
        }
        self.server.stdin.write(json.dumps(request) + "\n")
        self.server.stdin.flush()
        found: dict[str, Any] = json.loads(self.server.stdout.readline())
        return found

    @property
    def said(self) -> str:
        """Return what the last one wrote."""
        return (self.directory / "output.txt").read_text("utf-8")

    def begin(
        self, place: Path, workers: int, fault: Fault | None = None, *more: str
    ) -> dict[str, Any]:
        mission = self.directory / "faults.toml"
        return self(
            "run", mission, "--no-cache", "--out", place, "--workers", workers, *more, fault=fault
        )

    def resume(self, place: Path, *more: object, fault: Fault | None = None) -> dict[str, Any]:
        # A run directory is data: it does not choose the mission that it is continued with.
        mission = self.directory / "faults.toml"
        return self("resume", place, "--mission", mission, *more, fault=fault)

    def place(self) -> Path:
        """Return a name for a run directory."""
        self.number += 1
        return self.directory / f"run-{self.number}"


@dataclass
class Undisturbed:
    """What a run that nothing happens to leaves, and how much there was to do."""

    digests: dict[str, str]
    counts: dict[str, int]


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runs]:
    directory = tmp_path_factory.mktemp("faults")
    (directory / "faults.toml").write_text(MISSION, "utf-8")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("HILLSPHERE_", "HEYOKA_"))}
    place = os.pathsep.join([str(ROOT), *filter(None, sys.path)])
    server = subprocess.Popen(
        [sys.executable, "-m", "tests.plugins.campaigns.faulty_runs", "faults.toml"],
        env={**kept, "PYTHONPATH": place, "HILLSPHERE_CACHE": str(directory / "cache"),
             "OMP_NUM_THREADS": "1"},
        cwd=directory, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    with server:
        yield Runs(server, directory)
        assert server.stdin is not None
        server.stdin.close()


@pytest.fixture(scope="module")
def undisturbed(runs: Runs) -> Undisturbed:
    place = runs.place()
    found = runs.begin(place, 0)
    assert found["code"] == 0, runs.said
    table = load_product(place / "verify.npz")
    assert isinstance(table, CaseTable)
    assert table.case.tolist() == list(range(500))
    # A mission in which nothing ever fails would not show that failures are kept.
    assert 0 < table.failed.sum() < 500
    return Undisturbed(digests(place), found["counts"])


def digests(place: Path) -> dict[str, str]:
    """Return the SHA-256 of every product of a run."""
    return {path.name: sha256(path.read_bytes()).hexdigest() for path in place.glob("*.npz")}


def check_files(place: Path) -> None:
    """Assert that whatever stands under its name is whole."""
    for path in place.rglob("*.npz"):
        load_product(path)
    for path in place.rglob("*.json"):
        json.loads(path.read_text("utf-8"))


def finish(runs: Runs, place: Path, undisturbed: Undisturbed) -> str:
    """Resume a run that ended early; assert that nothing is lost; return how it was resumed."""
    check_files(place)
    how = "resumed"
    kept = {path.name: path.stat().st_mtime_ns for path in place.glob("work/verify/*.npz")}
    found = runs.resume(place, "--workers", 0)
    if found["code"] == 2:
        # It ended before it had written down what it is; nothing was computed by then.
        assert not list(place.rglob("*.npz"))
        reasons = ("manifest.json", "resume.json", "there is no such directory")
        assert any(reason in runs.said for reason in reasons)
        how, place = "begun anew", runs.place()
        found = runs.begin(place, 0)
    assert found["code"] == 0, runs.said
    assert digests(place) == undisturbed.digests
    assert not (place / "work").exists()
    assert not list(place.rglob("*.part"))
    assert not kept or "set aside" not in (place / "log.txt").read_text("utf-8")
    return how


def moment(chance: random.Random, phase: str, counts: dict[str, int]) -> Fault:
    """Return a moment at which a run is killed."""
    event = {"rename": "replace"}.get(phase, phase)
    if phase == "any":
        return {"after_s": chance.uniform(0.05, 1.5)}
    fault: Fault = {"event": event, "at": chance.randint(1, counts[event]), "act": "kill"}
    if phase == "compute":
        fault["delay_s"] = chance.uniform(0.0005, 0.05)
    elif chance.random() < 0.5 and phase != "merge":
        fault["act"] = "kill halfway"
    return fault


def kill_main(
    runs: Runs, undisturbed: Undisturbed, phases: list[str], workers: int
) -> Counter[str]:
    """Kill a run once for each of the phases, and resume it; return in which it was killed."""
    chance = random.Random(20260)
    met: Counter[str] = Counter()
    for phase in phases:
        while True:
            place = runs.place()
            if phase == "load":
                # Killed while it takes up what an earlier part has left.
                fault = {"event": "compute", "at": 3, "act": "kill"}
                assert runs.begin(place, workers, fault)["code"] == KILLED
                fault = {"event": "merge", "at": chance.randint(1, 2), "act": "kill"}
                found = runs.resume(place, fault=fault)
            else:
                fault = moment(chance, phase, undisturbed.counts)
                found = runs.begin(place, workers, fault)
            if found["code"] == KILLED:
                met[found["phase"]] += 1
                finish(runs, place, undisturbed)
                # After a delay it may have come on to something else.
                if phase in ("any", "load", found["phase"]):
                    break
            else:
                # It was done before the moment came.
                assert found["code"] == 0, runs.said
                assert digests(place) == undisturbed.digests
    return met


PHASES = ["compute", "write", "rename", "merge"]


def test_a_killed_run_is_resumed_to_the_same_result(runs: Runs, undisturbed: Undisturbed) -> None:
    met = kill_main(runs, undisturbed, PHASES, workers=1)
    assert all(met[phase] for phase in PHASES), met


@pytest.mark.slow
def test_a_run_killed_thirty_times_loses_nothing(runs: Runs, undisturbed: Undisturbed) -> None:
    met = kill_main(runs, undisturbed, 5 * [*PHASES, "load", "any"], workers=2)
    assert met.total() >= 30
    assert all(met[phase] >= 5 for phase in PHASES), met


def kill_anywhere(runs: Runs, undisturbed: Undisturbed, kills: int) -> Counter[str]:
    """Kill runs at random moments, and what resumes them; return how often each was killed."""
    chance = random.Random(20261)
    killed: Counter[str] = Counter()
    while killed.total() < kills:
        place = runs.place()
        longest_s = 1.5
        found = runs.begin(
            place, chance.choice((0, 1, 2)), {"after_s": chance.uniform(0.02, longest_s)}
        )
        what, resumes = "run", 0
        while found["code"] == KILLED:
            killed[what] += 1
            # Without a manifest there is nothing to resume yet.
            is_begun = (place / "manifest.json").is_file()
            if killed.total() == kills or not is_begun or resumes == 2:
                break
            check_files(place)
            what, resumes = "resume", resumes + 1
            found = runs.resume(place, fault={"after_s": chance.uniform(0.02, longest_s)})
        assert found["code"] in (0, KILLED), runs.said
        if found["code"] == KILLED:
            finish(runs, place, undisturbed)
        assert digests(place) in (undisturbed.digests, {})
    return killed


def test_a_resumed_run_that_is_killed_is_resumed_again(
    runs: Runs, undisturbed: Undisturbed
) -> None:
    assert kill_anywhere(runs, undisturbed, 4).total() == 4


@pytest.mark.slow
def test_sixty_kills_of_run_and_resume_lose_nothing(runs: Runs, undisturbed: Undisturbed) -> None:
    killed = kill_anywhere(runs, undisturbed, 60)
    assert killed["run"] >= 20
    assert killed["resume"] >= 10


@pytest.mark.parametrize(
    "options",
    [
        "--workers 1",
        "--workers 2",
        pytest.param("--workers 4", marks=pytest.mark.slow),
        pytest.param("--executor pool", marks=pytest.mark.slow),
        "--executor serial",
        pytest.param("--executor dask --workers 1", marks=pytest.mark.slow),
        pytest.param("--executor dask --workers 2", marks=pytest.mark.slow),
        pytest.param("--executor dask --workers 4", marks=pytest.mark.slow),
    ],
)
def test_every_executor_leaves_the_same_files(
    runs: Runs, undisturbed: Undisturbed, options: str
) -> None:
    place = runs.place()
    mission = runs.directory / "faults.toml"
    found = runs("run", mission, "--no-cache", "--out", place, *options.split())
    assert found["code"] == 0, runs.said
    assert digests(place) == undisturbed.digests


def kill_workers(runs: Runs, cases: int, kills: int) -> dict[str, int]:
    """Kill workers of one run at random times; return what they were doing."""
    several = ("--set", f"stage.verify.cases={cases}")
    sound, place = runs.place(), runs.place()
    assert runs.begin(sound, 0, None, *several)["code"] == 0, runs.said
    found = runs.begin(place, 2, {"workers": kills, "seed": kills}, *several)
    assert found["code"] == 0, runs.said
    assert digests(place) == digests(sound)
    counts: dict[str, int] = found["counts"]
    assert counts["killed"] == kills
    return counts


def test_killed_workers_change_nothing(runs: Runs, undisturbed: Undisturbed) -> None:
    counts = kill_workers(runs, cases=1500, kills=3)
    assert counts["computing"] >= 1


@pytest.mark.slow
def test_thirty_killed_workers_change_nothing(runs: Runs, undisturbed: Undisturbed) -> None:
    counts = kill_workers(runs, cases=30_000, kills=30)
    assert counts["computing"] >= 10
    assert counts["starting"] >= 3


ACTS = {
    "open": ("ENOSPC", "EIO"),
    "write": ("ENOSPC", "EIO", "short", "kill halfway"),
    "fsync": ("ENOSPC", "EIO", "kill"),
    "replace": ("ENOSPC", "EIO", "kill", "kill halfway"),
}
"""What may go wrong with a file: "kill halfway" of a replace is after it, "short" is half of the
data and then no space."""


def break_files(
    runs: Runs,
    undisturbed: Undisturbed,
    number: int,
    rounds: int,
    without: Sequence[str] = (),
) -> tuple[Counter[tuple[str, str]], Counter[str]]:
    """Let something go wrong with a file in each of many runs, and resume them."""
    chance = random.Random(number)
    pairs = [(event, act) for event, acts in ACTS.items() for act in acts if act not in without]
    struck: Counter[tuple[str, str]] = Counter()
    ends: Counter[str] = Counter()
    waiting = rounds * pairs
    while waiting:
        event, act = waiting.pop()
        fault = {"event": event, "at": chance.randint(1, undisturbed.counts[event]), "act": act}
        place = runs.place()
        found = runs.begin(place, 0, fault)
        if found["code"] == 0:
            # Its groups were larger, and there were fewer files than usual.
            assert found["counts"][event] < fault["at"]
            waiting.append((event, act))
            continue
        if act.startswith("kill"):
            assert found["code"] == KILLED, fault
        else:
            assert found["struck"], fault
            assert found["code"] == 1, (fault, runs.said)
            assert not list(place.rglob("*.part"))
        struck[event, act] += 1
        ends[finish(runs, place, undisturbed)] += 1
    return struck, ends


def test_files_that_cannot_be_written_cost_nothing_that_was(
    runs: Runs, undisturbed: Undisturbed
) -> None:
    # EIO goes the way of ENOSPC, and runs are killed while they write in another test; the longer
    # test has all.
    others = ("EIO", "kill", "kill halfway")
    struck, ends = break_files(runs, undisturbed, 1, rounds=1, without=others)
    assert set(struck.values()) == {1}
    assert ends["resumed"] >= 3


@pytest.mark.slow
def test_three_hundred_faults_of_files_cost_nothing_that_was(
    runs: Runs, undisturbed: Undisturbed
) -> None:
    struck, ends = break_files(runs, undisturbed, 2, rounds=24)
    assert struck.total() >= 300
    assert min(struck.values()) >= 20
    assert ends["resumed"] >= 270
