"""Campaigns on the command line: executors, interruptions, single cases, exports."""

from __future__ import annotations

import csv
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import netcdf_file
from tests.core.wave_missions import WAVES, waves_mission

from hillsphere.cli.endings import run
from hillsphere.plugins import default_registry
from hillsphere.products.product_codec import load_product

MISSION = waves_mission(130)
AGAIN = ("--mission", "waves.toml")
"""What a run of an own mission is resumed with: its directory is data, and does not choose."""
SLOW = ("--set", "stage.wave.steps=3000", "--set", "stage.many.cases=2000", "--no-cache")
"""A campaign of 32 blocks that take some 20 ms each."""


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    returncode: int
    stdout: str
    stderr: str


class Runner:
    """Runs commands in a directory: in this process, or in one that can be killed."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        (directory / "waves.toml").write_text(MISSION, "utf-8")

    def __call__(self, *arguments: object) -> Done:
        out, err = StringIO(), StringIO()
        with chdir(self.directory), redirect_stdout(out), redirect_stderr(err):
            code = run([str(argument) for argument in arguments])
        return Done(int(code), out.getvalue(), err.getvalue())

    def start(self, *arguments: object) -> subprocess.Popen[str]:
        def unblocked() -> None:
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                signal.signal(number, signal.SIG_DFL)

        path = [str(WAVES), *filter(None, [os.environ.get("PYTHONPATH")])]
        return subprocess.Popen(
            [sys.executable, "-m", "hillsphere", *map(str, arguments)], cwd=self.directory,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(path)}, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, preexec_fn=unblocked,
        )  # fmt: skip

    def until(self, process: subprocess.Popen[str], there: Callable[[], bool]) -> None:
        """Wait until something is there, while the process goes on."""
        deadline = time.monotonic() + 60
        while not there():
            assert process.poll() is None, process.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.002)

    def kept(self, run: str) -> int:
        """Count the groups of blocks that a campaign has kept so far."""
        return len(list((self.directory / run / "work" / "many").glob("blocks-*.npz")))

    def digest(self, run: str) -> str:
        return sha256((self.directory / run / "many.npz").read_bytes()).hexdigest()


@pytest.fixture(scope="module", autouse=True)
def _waves(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install the plugin in this process and in those that it starts."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HILLSPHERE_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.syspath_prepend(str(WAVES))
        default_registry.cache_clear()
        yield
    default_registry.cache_clear()


@pytest.fixture
def hillsphere(tmp_path: Path) -> Runner:
    return Runner(tmp_path)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Runner:
    """Directory with an undisturbed run ``out`` of the slow campaign."""
    runner = Runner(tmp_path_factory.mktemp("whole"))
    done = runner("run", "waves.toml", *SLOW, "--out", "out", "--workers", "0")
    assert (done.returncode, done.stderr) == (0, "")
    return runner


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Runner:
    """Directory with a run ``out`` in which case 3 raised and case 65 killed its worker."""
    runner = Runner(tmp_path_factory.mktemp("broken"))
    done = runner(
        "run", "waves.toml", "--set", "stage.many.cases=66", "--set", "stage.wave.raises_at=3",
        "--set", "stage.wave.kills_at=65", "--out", "out", "--workers", "1",
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    return runner


# --- interruptions


def test_a_killed_run_is_resumed_to_the_same_bits(hillsphere: Runner, whole: Runner) -> None:
    process = hillsphere.start("run", "waves.toml", *SLOW, "--out", "out", "--workers", "2")
    hillsphere.until(process, lambda: hillsphere.kept("out") >= 3)
    other = hillsphere("resume", "out", *AGAIN)
    process.kill()
    process.communicate()
    assert (other.returncode, other.stdout) == (2, "")
    assert other.stderr == (
        "run 'out' is still going on in another process; wait for it, or interrupt it first\n"
    )
    assert hillsphere.kept("out") >= 3
    manifest = json.loads((hillsphere.directory / "out" / "manifest.json").read_text())
    assert manifest["state"] == "running"
    done = hillsphere("resume", "out", *AGAIN, "--workers", "0")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("waves: every stage finished")
    assert hillsphere.digest("out") == whole.digest("out")
    assert not (hillsphere.directory / "out" / "work").exists()
    assert str(hillsphere.directory) not in (
        hillsphere.directory / "out" / "manifest.json"
    ).read_text("utf-8")


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
    ],
)
def test_a_signal_keeps_every_finished_group(
    hillsphere: Runner, whole: Runner, number: signal.Signals
) -> None:
    process = hillsphere.start("run", "waves.toml", *SLOW, "--out", "out", "--workers", "1")
    try:
        hillsphere.until(process, lambda: hillsphere.kept("out") >= 2)
        process.send_signal(number)
        stdout, stderr = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, stdout) == (130, "")
    assert stderr == (
        "interrupted; finished stages: wave; results so far are in out; continue with: "
        f"hillsphere resume out --mission {hillsphere.directory}/waves.toml\n"
    )
    kept = hillsphere.kept("out")
    assert kept >= 2
    directory = hillsphere.directory / "out"
    (failure,) = json.loads((directory / "summary.json").read_text())["failures"]
    assert (failure["stage"], failure["state"]) == ("many", "interrupted")
    assert list((directory / "work" / "many").glob("*.part")) == []
    done = hillsphere("resume", "out", *AGAIN, "--workers", "0", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["verdict"]["state"] == "success"
    assert hillsphere.digest("out") == whole.digest("out")


def test_a_finished_run_has_nothing_left_to_do(whole: Runner) -> None:
    before = (whole.directory / "out" / "manifest.json").read_bytes()
    done = whole("resume", "out")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines() == [
        "waves: this run is finished; nothing is left to do",
        "report: out/report.html",
    ]
    shown = json.loads(whole("resume", "out", "--json").stdout)
    assert shown["directory"] == "out"
    assert shown["verdict"]["state"] == "success"
    assert (whole.directory / "out" / "manifest.json").read_bytes() == before


def test_a_torn_product_of_a_finished_run_is_computed_again(whole: Runner) -> None:
    product = whole.directory / "out" / "wave.npz"
    sound = product.read_bytes()
    product.write_bytes(sound[:-100])
    done = whole("resume", "out", *AGAIN, "--workers", "0")
    assert (done.returncode, done.stderr) == (0, "")
    assert "nothing is left to do" not in done.stdout
    assert product.read_bytes() == sound
    assert "its product is damaged and computed again" in (product.parent / "log.txt").read_text()


def test_a_changed_mission_is_refused(hillsphere: Runner) -> None:
    process = hillsphere.start("run", "waves.toml", *SLOW, "--out", "out", "--workers", "1")
    hillsphere.until(process, lambda: hillsphere.kept("out") >= 1)
    process.kill()
    process.communicate()
    path = hillsphere.directory / "waves.toml"
    path.write_text(MISSION.replace("sigma = 0.2", "sigma = 0.3"), "utf-8")
    for arguments in (["resume", "out", *AGAIN], ["rerun", "out", *AGAIN, "--case", "1"]):
        done = hillsphere(*arguments)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.splitlines()[1:-1] == ["  dispersions.start.sigma: 0.2 -> 0.3"]
    path.write_text(MISSION, "utf-8")
    # What was kept so far is compared with; the run is not finished.
    done = hillsphere("rerun", "out", *AGAIN, "--case", "5")
    assert done.returncode == 0, done.stderr
    assert "  the same as in the run, to the last bit\n" in done.stdout
    done = hillsphere("rerun", "out", *AGAIN, "--case", "1999")
    assert "  the run has not computed this case\n" in done.stdout
    done = hillsphere("export", "out")
    assert done.returncode == 2
    assert done.stderr == (
        "campaign 'many' is not finished in run 'out'; hillsphere resume continues it\n"
    )
    assert hillsphere.kept("out") >= 1


# --- quantiles over time


BANDS = (*SLOW, "--set", 'stage.many.bands=["*height"]')


def test_bands_are_the_same_bits_killed_or_not_by_one_worker_or_two(hillsphere: Runner) -> None:
    process = hillsphere.start("run", "waves.toml", *BANDS, "--out", "out", "--workers", "2")
    hillsphere.until(process, lambda: hillsphere.kept("out") >= 3)
    process.kill()
    process.communicate()
    assert hillsphere("resume", "out", *AGAIN, "--workers", "0").returncode == 0
    assert not (hillsphere.directory / "out" / "work").exists()
    done = hillsphere("run", "waves.toml", *BANDS, "--out", "one", "--workers", "1")
    assert (done.returncode, done.stderr) == (0, "")
    assert hillsphere.digest("one") == hillsphere.digest("out")
    table = load_product_of(hillsphere, "many")
    bands = table.bands
    assert (bands.names, bands.units) == (("height", "seen.height"), ("m", "m"))
    assert bands.time_s.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert (bands.count == 2000).all()
    # Histories begin at what was drawn and end at the metric.
    begins, ends = (np.quantile(x[0], bands.levels) for x in (table.input_values, table.values))
    np.testing.assert_array_equal(bands.values[:, 0, 0], begins)
    np.testing.assert_array_equal(bands.values[:, 1, -1], ends)
    done = hillsphere("export", "out")
    assert (done.returncode, done.stdout) == (0, "out/many.csv\nout/many-bands.csv\n")
    with (hillsphere.directory / "out/many-bands.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    medians = [float(row["seen.height p50 [m]"]) for row in rows]
    assert medians == bands.values[1, 1].tolist()
    done = hillsphere("rerun", "out", *AGAIN, "--case", "1017")
    assert "  the same as in the run, to the last bit\n" in done.stdout


def test_lines_of_a_sweep_stand_before_the_bands_of_a_campaign(hillsphere: Runner) -> None:
    path = hillsphere.directory / "waves.toml"
    text = path.read_text("utf-8") + (
        '\n[stage.few]\ntype = "sweep"\nrepeat = "wave"\nover = { "stage.wave.height" = [0, 1] }\n'
        'lines = ["height"]\nneeds = { behind = "many" }\n'
    )
    path.write_text(text, "utf-8")
    done = hillsphere("validate", "waves.toml")
    assert done.returncode == 2
    said = ": stage.few.needs.behind: stage 'many' keeps no bands; give it bands = [\"…\"], or name"
    assert said in done.stderr
    bands = ("--set", 'stage.many.bands=["height"]', "--set", "stage.many.cases=64")
    done = hillsphere("run", "waves.toml", *bands, "--out", "out", "--workers", "0")
    assert (done.returncode, done.stderr) == (0, "")
    table = load_product_of(hillsphere, "few")
    lines = table.lines
    assert (lines.names, lines.units, lines.case.tolist()) == (("height",), ("m",), [0, 1])
    np.testing.assert_array_equal(lines.values[0, -1], table.values[0])
    assert (hillsphere.directory / "out" / "figures" / "sweep_lines.json").is_file()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        (
            'stage.many.bands=["heigth"]',
            "bands: the history of a case has no quantity 'heigth'; did you mean 'height'?",
        ),
        (
            'stage.many.show=["fold"]',
            "show: stage 'wave' has no metric 'fold'; did you mean 'folded'?",
        ),
    ],
)
def test_a_name_that_finds_nothing_is_told_after_the_first_block(
    hillsphere: Runner, setting: str, message: str
) -> None:
    done = hillsphere(
        "run", "waves.toml", *SLOW, "--set", setting, "--out", "out", "--workers", "0"
    )
    assert done.returncode == 1
    assert done.stderr.splitlines() == [f"stage 'many' failed: {message}"]
    assert hillsphere.kept("out") <= 1


# --- executors


def test_executors_give_the_same_bits_and_are_remembered(hillsphere: Runner) -> None:
    chosen = {
        "pool": ([], {"type": "pool"}),
        "one": (["--workers", "1"], {"type": "pool", "workers": 1}),
        "none": (["--workers", "0"], {"type": "serial"}),
        "serial": (["--executor", "serial"], {"type": "serial"}),
    }
    for name, (options, table) in chosen.items():
        done = hillsphere("run", "waves.toml", "--out", name, "--no-cache", *options)
        assert (done.returncode, done.stderr) == (0, "")
        local = json.loads((hillsphere.directory / name / "resume.json").read_text())
        assert local["executor"] == table
    assert len({hillsphere.digest(name) for name in chosen}) == 1
    assert load_product(hillsphere.directory / "pool" / "many.npz").values.shape == (1, 130)


def load_product_of(runner: Runner, stage: str) -> Any:
    return load_product(runner.directory / "out" / f"{stage}.npz")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--executor", "pol"], "no executor of type 'pol'; did you mean 'pool'?"),
        (["--workers", "-1"], "hillsphere run: Invalid value for '--workers': "),
        (["--workers", "0", "--executor", "pool"], "--workers 0: the executor 'pool' needs at"),
        (["--workers", "2", "--executor", "serial"], "executor 'serial': workers: "),
        (["--scheduler", "tcp://h:1", "--executor", "pool"], "executor 'pool': scheduler: "),
        (["--scheduler", "nowhere"], "executor 'dask': scheduler: "),
    ],
)
def test_executors_that_are_refused(hillsphere: Runner, options: list[str], message: str) -> None:
    done = hillsphere("run", "waves.toml", "--out", "out", *options)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(message)
    assert done.stderr.count("\n") == 1
    assert not (hillsphere.directory / "out").exists()


# --- what is repeated


def test_a_campaign_needs_the_nominal_case(hillsphere: Runner) -> None:
    text = MISSION.replace('type = "wave"\n', 'type = "wave"\nfails = true\n')
    (hillsphere.directory / "waves.toml").write_text(text, "utf-8")
    done = hillsphere("run", "waves.toml", "--out", "out")
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "stage 'wave' failed: the tide is out",
        "stage 'many' was not run: it needs wave",
    ]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'repeat = "wave"', 'repeat = "echo"',
            "waves.toml:17: stage.many.repeat: stage 'echo' (echo) cannot be repeated: it has no "
            "run_cases; it can repeat wave",
        ),
        ('["height"]', '["width"]', "waves.toml:15: stage.many: "),
        ('repeat = "wave"', 'repeat = "waves"', "waves.toml:17: stage.many.repeat: "),
    ],
)  # fmt: skip
def test_what_cannot_be_repeated_is_told_before_anything_runs(
    hillsphere: Runner, old: str, new: str, message: str
) -> None:
    text = MISSION + '[stage.echo]\ntype = "echo"\nneeds = { wave = "wave" }\n'
    (hillsphere.directory / "waves.toml").write_text(text.replace(old, new), "utf-8")
    done = hillsphere("run", "waves.toml", "--out", "out")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(message)
    assert done.stderr.count("\n") == 1
    assert not (hillsphere.directory / "out").exists()


# --- single cases


def test_a_case_is_repeated_with_its_history(whole: Runner) -> None:
    table = load_product_of(whole, "many")
    done = whole("rerun", "out", *AGAIN, "--case", "1017")
    assert (done.returncode, done.stderr) == (0, "")
    head, *_ = lines = done.stdout.splitlines()
    assert head == "many: case 1017 of stage wave, draw 1017"
    assert lines[1:3] == ["  succeeded: completed", "  the same as in the run, to the last bit"]
    shown = json.loads(whole("rerun", "out", *AGAIN, "--case", "1017", "--json").stdout)
    assert shown["now"] == shown["then"]
    assert shown["differences"] == []
    folded = table.values[0, 1017]
    assert shown["now"]["metrics"] == {"folded": {"value": folded, "unit": "m"}}
    height = table.input_values[0, 1017]
    assert shown["inputs"] == {"height": {"value": height, "unit": "m"}}
    names = [f"out/cases/many-1017.{end}" for end in ("csv", "npz", "svg")]
    assert shown["files"] == names
    assert lines[-3:] == [f"history: {name}" for name in names]
    histories = load_product(whole.directory / "out/cases/many-1017.npz")
    assert histories.values.shape == (2, 5, 1)
    assert histories.values[0, -1, 0] == folded
    rows = list(csv.reader((whole.directory / "out/cases/many-1017.csv").read_text().splitlines()))
    assert rows[0] == ["time [s]", "height [m]", "seen.height [m]"]
    assert [float(row[1]) for row in rows[1:]] == histories.values[0, :, 0].tolist()
    png = whole.directory / "out/cases/many-1017.png"
    assert not png.exists()
    done = whole("rerun", "out", *AGAIN, "--case", "1017", "--figures")
    assert done.stdout.splitlines()[-1] == "history: out/cases/many-1017.png"
    assert png.read_bytes().startswith(b"\x89PNG")


def test_a_case_that_raised_shows_where(broken: Runner) -> None:
    done = broken("rerun", "out", *AGAIN, "--case", "3")
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[1:4] == [
        "  undecided (computation): error (ArithmeticError)",
        "  ArithmeticError: the wave broke",
        "  the same as in the run, to the last bit",
    ]
    assert "Traceback (most recent call last):" in lines
    assert any("waves_plugin.py" in line and "run_cases" in line for line in lines)
    assert lines[-2:] == ["ArithmeticError: the wave", "broke"]
    assert not (broken.directory / "out/cases").exists()


def test_a_case_that_killed_its_worker_says_so_again(broken: Runner) -> None:
    done = broken("rerun", "out", *AGAIN, "--case", "65")
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert lines[1] == "  undecided (computation): killed"
    assert re.fullmatch("  its worker ended: .*9.*", lines[2])
    assert lines[3] == "  the same as in the run, to the last bit"


def test_the_neighbour_of_a_case_that_kills_is_repeated(broken: Runner) -> None:
    done = broken("rerun", "out", *AGAIN, "--case", "64", "--json")
    shown = json.loads(done.stdout)
    assert shown["now"]["status"] == "completed"
    assert (done.returncode, shown["differences"]) == (0, [])


@pytest.mark.slow
def test_what_a_worker_was_lost_for_is_not_kept_for_other_runs(hillsphere: Runner) -> None:
    (hillsphere.directory / "waves.toml").write_text(
        MISSION
        + '[stage.few]\ntype = "many"\nrepeat = "wave"\ndraws_as = "many"\n'
        + 'dispersions = ["start"]\ncases = 60\n'
        + '[stage.both]\ntype = "campaign_comparison"\nneeds.campaigns = ["few", "many"]\n'
    )
    for name in ("one", "two"):
        done = hillsphere(
            "run", "waves.toml", "--set", "stage.many.cases=65", "--set", "stage.wave.kills_at=64",
            "--out", name, "--workers", "1",
        )  # fmt: skip
        assert (done.returncode, done.stderr) == (0, "")
    stages = json.loads((hillsphere.directory / "two/manifest.json").read_text())["stages"]
    kept = {name: stage["cached"] for name, stage in stages.items()}
    assert kept == {"wave": True, "few": True, "many": False, "both": False}


def test_a_case_that_is_not_the_same_is_told(
    whole: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WAVES_TIDE", "1e-15")
    done = whole("rerun", "out", *AGAIN, "--case", "7")
    assert (done.returncode, done.stderr) == (1, "")
    lines = done.stdout.splitlines()
    assert lines[2] == "  NOT the same as in the run (then -> now):"
    value = float(load_product_of(whole, "many").values[0, 7])
    assert lines[3] == f"    folded: {value!r} -> {value + 1e-15!r}"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--case", "2000"], "campaign 'many' has no case 2000: they are 0 to 1999"),
        (["--case", "-1"], "campaign 'many' has no case -1: they are 0 to 1999"),
        (["--case", "1", "--stage", "wave"], "'wave' is no campaign of run 'out'; it has many"),
        ([], "hillsphere rerun: Missing option '--case'"),
    ],
)
def test_cases_that_are_not_there(whole: Runner, options: list[str], message: str) -> None:
    done = whole("rerun", "out", *AGAIN, *options)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(message)


# --- exports


def test_cases_are_exported(whole: Runner) -> None:
    table = load_product_of(whole, "many")
    done = whole("export", "out")
    assert (done.returncode, done.stdout, done.stderr) == (0, "out/many.csv\n", "")
    with (whole.directory / "out/many.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["folded [m]"]) for row in rows] == table.values[0].tolist()
    done = whole("export", "out", "--stage", "many", "--format", "netcdf", "--out", "m.nc")
    assert (done.returncode, done.stdout) == (0, "m.nc\n")
    with netcdf_file(whole.directory / "m.nc", mmap=False) as dataset:
        np.testing.assert_array_equal(dataset.variables["metric_folded"][:], table.values[0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["out", "--stage", "wave"], "'wave' is no campaign of run 'out'; it has many"),
        (["out", "--format", "xls"], "hillsphere export: Invalid value for '--format'"),
        (["out", "--out", "no/where.csv"], "no/where.csv cannot be written: No such file or dir"),
        (["."], "'.' is no run directory: it holds no manifest.json"),
    ],
)
def test_exports_that_are_refused(whole: Runner, options: list[str], message: str) -> None:
    done = whole("export", *options)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(message)
    assert done.stderr.count("\n") == 1


def test_a_run_without_campaign_has_no_cases(hillsphere: Runner) -> None:
    path = hillsphere.directory / "waves.toml"
    path.write_text(MISSION[: MISSION.index("[stage.many]")], "utf-8")
    assert hillsphere("run", "waves.toml", "--out", "out").returncode == 0
    for arguments in (["rerun", "out", *AGAIN, "--case", "1"], ["export", "out"]):
        done = hillsphere(*arguments)
        assert (done.returncode, done.stderr) == (2, "run 'out' has no campaign\n")
