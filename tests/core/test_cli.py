"""The command line: what it prints where, and how it ends."""

from __future__ import annotations

import errno
import json
import os
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from hillsphere.cli.endings import run
from hillsphere.plugins import default_registry

FAULTY = Path(__file__).parent / "faulty"
MISSION = """format = 1
name = "trial"
title = "A trial"
seed = 1

[stage.step]
type = "step"
"""


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """Return the environment of the processes that are started."""
    # A test that imported heyoka in this process has set HEYOKA_CACHE_DIR.
    ours = ("HILLSPHERE_", "HEYOKA_", "PYTHONIO")
    kept = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
    return {**kept, "PYTHONPATH": str(FAULTY), "HILLSPHERE_CACHE": str(tmp_path / "cache")}


@pytest.fixture
def mission(tmp_path: Path) -> Path:
    path = tmp_path / "trial.toml"
    path.write_text(MISSION, "utf-8")
    return path


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    returncode: int
    stdout: str
    stderr: str


class Runner:
    """Runs the command line: in this process, or, which takes longer, in one of its own."""

    def __init__(self, environment: dict[str, str], directory: Path) -> None:
        self.environment = environment
        self.directory = directory

    def __call__(self, *arguments: object) -> Done:
        out, err = StringIO(), StringIO()
        with chdir(self.directory), redirect_stdout(out), redirect_stderr(err):
            code = run([str(argument) for argument in arguments])
        return Done(int(code), out.getvalue(), err.getvalue())

    def apart(self, *arguments: object, **extra: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "hillsphere", *map(str, arguments)],
            cwd=self.directory, env={**self.environment, **extra}, capture_output=True,
            text=True, check=False, encoding="utf-8", stdin=subprocess.DEVNULL,
        )  # fmt: skip

    def start(self, *arguments: object, **options: Any) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "hillsphere", *map(str, arguments)],
            cwd=self.directory, env=self.environment, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True, **options,
        )  # fmt: skip


@pytest.fixture
def hillsphere(
    environment: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Runner]:
    monkeypatch.syspath_prepend(str(FAULTY))
    monkeypatch.setenv("HILLSPHERE_CACHE", environment["HILLSPHERE_CACHE"])
    default_registry.cache_clear()
    yield Runner(environment, tmp_path)
    default_registry.cache_clear()


def test_help_names_the_commands_of_plugins_without_importing_them(hillsphere: Runner) -> None:
    done = hillsphere("--help")
    assert (done.returncode, done.stderr) == (0, "")
    for line in ("run       Run a mission", "greet     the command greet", "absent    the command"):
        assert line in done.stdout
    assert done.stdout.count("  run ") == 1


def test_help_takes_at_most_three_tenths_of_a_second_of_cpu(hillsphere: Runner) -> None:
    # Neither the tracer of a coverage run nor the plugins of these tests, which import what they
    # like, are what is measured: the program is, as it is installed.
    hillsphere.environment = {
        key: value
        for key, value in hillsphere.environment.items()
        if not key.startswith("COV") and key != "PYTHONPATH"
    }

    def cpu_s() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        assert hillsphere.apart("--help").returncode == 0
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    # others on the machine only add to it, so the least of some tries is its cost
    assert any(cpu_s() <= 0.3 for _ in range(12))


def test_no_arguments_shows_help(hillsphere: Runner) -> None:
    done = hillsphere()
    assert done.returncode == 0
    assert done.stdout.startswith("Usage: hillsphere")


def test_version(hillsphere: Runner) -> None:
    import hillsphere as package

    assert hillsphere("--version").stdout == f"hillsphere {package.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rnu"], "hillsphere: No such command 'rnu'. Did you mean 'run'?; see"),
        (["run"], "hillsphere run: Missing argument 'MISSION'; see 'hillsphere run --help'"),
        (["run", "x", "--foo"], "hillsphere run: No such option: --foo"),
        (["run", "x", "--set"], "hillsphere: Option '--set' requires an argument"),
        (["plugins", "extra"], "hillsphere plugins: Got unexpected extra argument"),
    ],
)
def test_usage_errors_are_one_line(hillsphere: Runner, arguments: list[str], message: str) -> None:
    done = hillsphere(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(message)
    assert done.stderr.count("\n") == 1


def test_run_prints_the_verdict_and_the_report(hillsphere: Runner, mission: Path) -> None:
    done = hillsphere.apart("run", mission, "--out", "out")
    assert done.returncode == 0
    assert done.stderr == ""  # not a terminal: no progress
    assert done.stdout.splitlines() == [
        "trial: every stage finished; the mission states no requirement",
        "  All is well.",
        "",
        "report: out/report.html",
    ]
    assert (hillsphere.directory / "out" / "report.html").is_file()


def test_run_prints_metrics_if_asked(hillsphere: Runner, mission: Path) -> None:
    lines = hillsphere("run", mission, "--out", "out", "-v").stdout.splitlines()
    assert lines[-5:] == [
        "", "third  0.3333333333  m²/s²", "sound  True", "", "report: out/report.html",
    ]  # fmt: skip


def test_run_in_the_working_directory_by_default(hillsphere: Runner, mission: Path) -> None:
    done = hillsphere("run", mission.name)
    assert done.returncode == 0
    (directory,) = (hillsphere.directory / "runs").iterdir()
    assert done.stdout.splitlines()[-1] == f"report: runs/{directory.name}/report.html"


def test_run_json(hillsphere: Runner, mission: Path) -> None:
    done = hillsphere("run", mission, "--out", "out", "--json", "--no-cache", "--quiet")
    shown = json.loads(done.stdout)
    assert shown["metrics"]["third"] == {"value": 1.0 / 3.0, "unit": "m²/s²"}
    assert shown["directory"] == "out"
    stored = json.loads((hillsphere.directory / "out" / "summary.json").read_text("utf-8"))
    assert {key: shown[key] for key in stored} == stored


def test_output_survives_a_terminal_without_unicode(hillsphere: Runner, mission: Path) -> None:
    done = hillsphere.apart("run", mission, "-v", PYTHONIOENCODING="ascii", PYTHONUTF8="0")
    assert done.returncode == 0
    assert "m\\xb2/s\\xb2" in done.stdout


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ("plainly", "stage 'step' failed: the tank is empty\n"),
        ("strangely", "stage 'step' failed: ZeroDivisionError: never mind\n"),
    ],
)
def test_a_failed_stage_ends_with_1(
    hillsphere: Runner, mission: Path, how: str, message: str
) -> None:
    done = hillsphere("run", mission, "--set", f"stage.step.fails={how}", "--out", "out")
    assert done.returncode == 1
    assert done.stderr == message
    assert done.stdout.startswith("trial: failed; 1 stage did not finish\n")
    assert "Traceback" in (hillsphere.directory / "out" / "log.txt").read_text("utf-8")


def test_bad_missions_end_with_2_and_all_messages(hillsphere: Runner, mission: Path) -> None:
    mission.write_text(MISSION + 'fals = "plainly"\nlasts_min = -1\n', "utf-8")
    for command in ("run", "validate"):
        done = hillsphere(command, mission)
        assert (done.returncode, done.stdout) == (2, "")
        first, second = done.stderr.splitlines()
        assert first.startswith(f"{mission}:8: stage.step.fals: ")
        assert second.startswith(f"{mission}:9: stage.step.lasts_min: ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["phobos-qs0"], "phobos-qs0"),
        (["absent.toml"], "absent.toml"),
        (["trial.toml", "--set", "stage.step.lasts_h=soon"], "--set stage.step.lasts_h"),
        (["trial.toml", "--profile", "slow"], "slow"),
        (["trial.toml", "--out", "trial.toml"], "trial.toml"),
        (["trial.toml", "--out", "/proc/no/such"], "/proc/no/such"),
        (["trial.toml", "--strict-plugins"], "plugin 'shattered' is broken"),
    ],
)
def test_bad_input_ends_with_2(
    hillsphere: Runner, mission: Path, arguments: list[str], message: str
) -> None:
    done = hillsphere("run", *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert message in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (hillsphere.directory / "runs").exists()


def test_validate_says_what_is_valid(hillsphere: Runner, mission: Path) -> None:
    bad = mission.with_name("bad.toml")
    bad.write_text("format = 2\n", "utf-8")
    done = hillsphere("validate", mission, bad)
    assert done.returncode == 2
    assert done.stdout == f"{mission}: valid (1 stage)\n"
    assert done.stderr.startswith(f"{bad}")
    shown = json.loads(hillsphere("validate", mission, bad, "--json").stdout)
    assert [(entry["mission"], entry["valid"]) for entry in shown] == [
        (str(mission), True),
        (str(bad), False),
    ]
    (problem, *_) = shown[1]["problems"]
    assert set(problem) == {"source", "line", "key", "message"}


def test_plugins_lists_what_is_broken_and_disabled(
    hillsphere: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HILLSPHERE_DISABLE_PLUGINS", "hillsphere_orbits")
    done = hillsphere("plugins")
    assert done.returncode == 0
    assert re.search(r"stage +step", done.stdout)
    assert "qso_family" not in done.stdout
    assert "broken: shattered: ModuleNotFoundError" in done.stdout
    assert "disabled: hillsphere_orbits" in done.stdout
    monkeypatch.delenv("HILLSPHERE_DISABLE_PLUGINS")
    default_registry.cache_clear()
    shown = json.loads(hillsphere("plugins", "--json").stdout)
    assert list(shown["broken"]) == ["shattered"]
    assert {c["kind"] for c in shown["components"]} >= {"gravity", "plant", "stage", "command"}
    assert hillsphere("plugins", "--strict-plugins").returncode == 2


def test_missions_are_listed(hillsphere: Runner) -> None:
    from hillsphere.mission import packaged_missions

    found = packaged_missions()
    shown = json.loads(hillsphere("missions", "--json").stdout)
    assert [(m["name"], m["title"]) for m in shown] == found
    profiles = {m["name"]: list(m["cpu_s"]) for m in shown}
    assert profiles["phobos-qso"] == ["", "fast", "measured"]  # "": the whole mission
    head, *lines = hillsphere("missions").stdout.splitlines()
    assert head.split() == ["mission", "CPU", "time", "profiles", "title"]
    assert [line.split()[0] for line in lines[:-2]] == [name for name, _ in found]
    assert "CPU time of one run" in lines[-1]


def test_measured_times_are_those_of_packaged_missions_and_their_profiles() -> None:
    from hillsphere.base.paths import missions_directory
    from hillsphere.mission import load_mission

    measured = json.loads((missions_directory() / "times.json").read_text("utf-8"))
    for row in measured["runs"]:
        assert row["profile"] in {"", *load_mission(row["mission"]).profiles}
        assert row["version"] in {"before", "now"}
        assert row["cpu_s"] > 0


def test_missions_shows_this_versions_time_with_figures(hillsphere: Runner) -> None:
    from hillsphere.base.paths import missions_directory

    measured = json.loads((missions_directory() / "times.json").read_text("utf-8"))
    shown = {m["name"]: m["cpu_s"] for m in json.loads(hillsphere("missions", "--json").stdout)}
    ours = [row for row in measured["runs"] if row["version"] == "now" and row["figures"]]
    assert ours
    assert len(ours) < len(measured["runs"])  # others are listed, and not shown
    for row in ours:
        assert shown[row["mission"]][row["profile"]] == row["cpu_s"]


def test_schema_is_json_schema_with_the_plugins_in_it(hillsphere: Runner, mission: Path) -> None:
    import tomllib

    import jsonschema

    schema = json.loads(hillsphere("schema").stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    assert validator.is_valid(tomllib.loads(MISSION))
    assert not validator.is_valid(tomllib.loads(MISSION + "lasts_min = -1\n"))


def test_a_plugins_command_runs(hillsphere: Runner) -> None:
    assert hillsphere("greet", "you", "--loud").stdout == "hello you!\n"
    assert "Greet someone." in hillsphere("greet", "--help").stdout
    done = hillsphere("greet")
    assert done.returncode == 2
    # typer before 0.27 writes an argument in capitals
    assert done.stderr.lower().startswith("hillsphere greet: missing argument 'name'")
    assert hillsphere("leave").returncode == 7


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("absent", "plugin 'faulty_plugin': command 'absent' (faulty_plugin:nowhere_to_be_found)"),
        ("stringy", "must be a typer.Typer, got str"),
    ],
)
def test_a_broken_command_says_so_when_called(
    hillsphere: Runner, command: str, message: str
) -> None:
    done = hillsphere(command)
    assert done.returncode == 2
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


def test_an_error_in_a_plugins_command_is_logged_under_its_name(hillsphere: Runner) -> None:
    done = hillsphere.apart("explode")
    assert (done.returncode, done.stdout) == (3, "")
    start = (
        "plugin 'faulty_plugin': its command 'explode' failed: RuntimeError: the fuse was short; "
        "the traceback is in "
    )
    assert done.stderr.startswith(start)
    assert done.stderr.count("\n") == 1
    log = Path(done.stderr.removeprefix(start).strip()).read_text("utf-8")
    assert "explode" in log.splitlines()[0]
    assert "Traceback" in log
    assert "was short" in log


def test_an_internal_error_is_ours(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    from hillsphere.cli.endings import run
    from hillsphere.mission import load as mission

    def fails() -> None:
        raise OSError(errno.EACCES, "no entry")

    monkeypatch.setattr(mission, "packaged_missions", fails)
    monkeypatch.setenv("HILLSPHERE_CACHE", str(tmp_path))
    assert run(["missions"]) == 3
    assert capsys.readouterr().err.startswith("internal error: PermissionError: [Errno 13]")


def test_an_internal_error_can_be_shown(
    hillsphere: Runner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HILLSPHERE_TRACEBACK", "1")
    done = hillsphere("explode")
    assert done.returncode == 3
    assert "Traceback" in done.stderr
    assert done.stderr.splitlines()[-1] == (
        "plugin 'faulty_plugin': its command 'explode' failed: RuntimeError: the fuse was short"
    )


def test_an_internal_error_without_a_place_for_its_log(
    hillsphere: Runner, mission: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HILLSPHERE_CACHE", str(mission))
    done = hillsphere("explode")
    assert done.returncode == 3
    assert "no log could be written" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_ends_with_130(
    hillsphere: Runner, mission: Path, number: signal.Signals
) -> None:
    # A shell starts background jobs with SIGINT ignored, and this test may run in one.
    process = hillsphere.start(
        "run", mission, "--set", "stage.step.lasts_s=60", "--out", "out",
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    log = hillsphere.directory / "out" / "log.txt"
    try:
        deadline = time.monotonic() + 60
        while not (log.exists() and "under way" in log.read_text("utf-8")):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        process.send_signal(number)
        stdout, stderr = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, stdout) == (130, "")
    assert stderr.startswith("interrupted")
    assert stderr.count("\n") == 1
    manifest = json.loads((log.parent / "manifest.json").read_text("utf-8"))
    assert manifest["state"] == "interrupted"


def unblocked() -> None:
    """Take the signals as at a terminal, whatever started this test ignores."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_leaves_no_worker_behind(
    hillsphere: Runner, mission: Path, number: signal.Signals
) -> None:
    process = hillsphere.start(
        "run", mission, "--set", "stage.step.lasts_s=0.2", "--set", "stage.step.parts=1000",
        "--workers", "2", "--out", "out", preexec_fn=unblocked,
    )  # fmt: skip
    log = hillsphere.directory / "out" / "log.txt"
    workers: set[int] = set()
    try:
        deadline = time.monotonic() + 60
        while len(workers) < 2:
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
            text = log.read_text("utf-8") if log.exists() else ""
            workers = {int(name) for name in re.findall(r"process (\d+)\n", text)} - {process.pid}
        process.send_signal(number)
        stdout, stderr = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, stdout) == (130, "")
    assert stderr.startswith("interrupted")
    assert stderr.count("\n") == 1
    for worker in workers:
        with pytest.raises(ProcessLookupError):
            os.kill(worker, 0)


@pytest.mark.parametrize(
    ("number", "message"),
    [
        (signal.SIGINT, "interrupted\n"),
        (signal.SIGTERM, "interrupted by SIGTERM\n"),
        (signal.SIGHUP, "interrupted by SIGHUP\n"),
    ],
)
def test_a_signal_outside_of_a_run_ends_with_130(
    hillsphere: Runner, number: signal.Signals, message: str
) -> None:
    process = hillsphere.start("wait", preexec_fn=unblocked)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "waiting\n"
        process.send_signal(number)
        _, stderr = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, stderr) == (130, message)


def test_under_nohup_a_hangup_is_ignored(hillsphere: Runner) -> None:
    def ignoring_hangups() -> None:
        unblocked()
        signal.signal(signal.SIGHUP, signal.SIG_IGN)

    process = hillsphere.start("wait", preexec_fn=ignoring_hangups)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "waiting\n"
        process.send_signal(signal.SIGHUP)
        process.send_signal(signal.SIGTERM)
        _, stderr = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, stderr) == (130, "interrupted by SIGTERM\n")


@pytest.mark.parametrize("again", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_during_the_ending_do_not_change_it(
    hillsphere: Runner, again: signal.Signals
) -> None:
    process = hillsphere.start("wait", preexec_fn=unblocked)
    try:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline() == "waiting\n"
        process.send_signal(signal.SIGINT)
        assert process.stderr.readline() == "interrupted\n"
        deadline = time.monotonic() + 30
        while process.poll() is None:
            assert time.monotonic() < deadline
            process.send_signal(again)
            time.sleep(0.001)
        _, stderr = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, stderr) == (130, "")


def test_a_stage_that_is_not_yet_shown_keeps_its_product(hillsphere: Runner, mission: Path) -> None:
    process = hillsphere.start(
        "run", mission, "--set", "stage.step.shows_s=60", "--out", "out", preexec_fn=unblocked
    )
    product = hillsphere.directory / "out" / "step.npz"
    log = hillsphere.directory / "out" / "log.txt"
    try:
        deadline = time.monotonic() + 60
        while not (log.exists() and "to be shown" in log.read_text("utf-8")):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.05)
        process.send_signal(signal.SIGHUP)
        _, stderr = process.communicate(timeout=30)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "finished stages: none;" in stderr  # it has shown nothing yet
    assert product.exists()


@pytest.mark.parametrize(
    ("redirections", "code", "message"),
    [
        (">&-", 2, "standard output is closed; redirect it to /dev/null if it is not wanted\n"),
        (">/dev/full", 2, "standard output cannot be written: No space left on device\n"),
        ("<&-", 0, ""),
        ("2>&-", 0, ""),
    ],
)
@pytest.mark.parametrize("command", ["plugins", "greet you"])
def test_streams_that_cannot_be_used(
    hillsphere: Runner, command: str, redirections: str, code: int, message: str
) -> None:
    done = subprocess.run(
        f"'{sys.executable}' -m hillsphere {command} {redirections}", shell=True,
        env=hillsphere.environment, cwd=hillsphere.directory, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (code, message)


@pytest.mark.parametrize("redirection", ["2>&-", "2>/dev/full", "0>&- 2>&-"])
def test_a_message_that_nobody_can_read(hillsphere: Runner, redirection: str) -> None:
    done = subprocess.run(
        f"'{sys.executable}' -m hillsphere run nosuch {redirection}", shell=True,
        env=hillsphere.environment, cwd=hillsphere.directory, capture_output=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (2, b"", b"")


def test_an_interrupt_of_evaluated_text_is_an_exit_code(hillsphere: Runner) -> None:
    (hillsphere.directory / "interrupted.py").write_text(
        "import hillsphere.cli.endings as endings\n"
        "def run(arguments):\n"
        "    try:\n"
        "        exec('raise KeyboardInterrupt')\n"
        "    except KeyboardInterrupt:\n"
        "        return 130\n"
        "endings.run = run\n"
        "endings.main()\n"
    )
    done = subprocess.run(
        [sys.executable, "-m", "interrupted"], cwd=hillsphere.directory,
        env=hillsphere.environment, check=False,
    )  # fmt: skip
    assert done.returncode == 130  # and not -2, the end by SIGINT itself


def test_a_working_directory_that_is_gone(hillsphere: Runner) -> None:
    gone = hillsphere.directory / "gone"
    gone.mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "hillsphere", "validate", "phobos-qso"], cwd=gone,
        env=hillsphere.environment, capture_output=True, text=True, check=False,
        preexec_fn=gone.rmdir,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("the working directory cannot be used (No such file")
    assert done.stderr.count("\n") == 1


def test_a_compile_cache_that_cannot_be_written(hillsphere: Runner, mission: Path) -> None:
    done = hillsphere.apart("doctor", "--json", HILLSPHERE_CACHE=str(mission), PYTHONPATH="")
    checks = json.loads(done.stdout)["checks"]
    assert {c["state"] for c in checks if c["group"] == "self-test"} == {"ok"}
    assert done.stderr.startswith(f"compiled code is not kept: {mission}/compiled cannot be")
    assert done.stderr.count("\n") == 1


def test_validate_checks_every_profile(hillsphere: Runner, mission: Path) -> None:
    good = MISSION + "[profile.slow]\nstage.step.lasts_min = 1\n"
    mission.write_text(good, "utf-8")
    done = hillsphere("validate", mission)
    assert done.stdout == f"{mission}: valid (1 stage; also with profile slow)\n"
    mission.write_text(good + "[profile.never]\nstage.step.lasts_min = -1\n", "utf-8")
    done = hillsphere("validate", mission)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"{mission}:11: ")
    assert done.stderr.endswith("(with profile never)\n")
    assert done.stderr.count("\n") == 1
    (problem,) = json.loads(hillsphere("validate", mission, "--json").stdout)[0]["problems"]
    assert problem["line"] == 11
    assert hillsphere("validate", mission, "--profile", "slow").returncode == 0


def test_a_setting_may_be_meant_for_what_a_profile_drops(hillsphere: Runner, mission: Path) -> None:
    second = MISSION.partition("[stage.step]")[2]
    text = f"{MISSION}\n[stage.other]{second}\n[profile.short]\nstage.other = false\n"
    mission.write_text(text, "utf-8")
    setting = ("--set", "stage.other.lasts_s=2")
    done = hillsphere("validate", mission, *setting)
    assert (done.returncode, done.stderr) == (0, "")
    first, remark = done.stdout.splitlines()
    assert first == f"{mission}: valid (2 stages; also with profile short)"
    line = text.splitlines().index("stage.other = false") + 1
    dropped = f"this table is dropped at {mission}:{line}; --set stage.other=true takes it back"
    assert remark == f"  profile short: --set stage.other.lasts_s=… has no effect, {dropped}"
    (shown,) = json.loads(hillsphere("validate", mission, *setting, "--json").stdout)
    assert (shown["problems"], shown["remarks"]) == ([], [remark.strip()])
    # What else is wrong in the profile is told, and only that.
    mission.write_text(f"{text}stage.step.lasts_s = -1\n", "utf-8")
    done = hillsphere("validate", mission, *setting)
    assert done.returncode == 2
    assert "has no effect" not in done.stderr
    assert "stage.other" not in done.stderr
    assert done.stderr.endswith("(with profile short)\n")
    # With the profile itself it is a fault, told once.
    mission.write_text(text, "utf-8")
    done = hillsphere("validate", mission, *setting, "--profile", "short")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"--set stage.other.lasts_s=…: stage.other: {dropped}\n"


@pytest.fixture
def rival(hillsphere: Runner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Install a second plugin that offers what the faulty one offers."""
    place = tmp_path / "rival"
    info = place / "rival_plugin-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rival-plugin\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[hillsphere]\nrival_plugin = rival_plugin\n")
    (place / "rival_plugin.py").write_text(
        "from hillsphere.plugins import Component, hookimpl\n"
        "@hookimpl\n"
        "def hillsphere_components():\n"
        "    return [Component('stage', 'step', 'a:B', 'a:C', 'a rival'),\n"
        "            Component('command', 'greet', 'a:d', '', 'another rival')]\n"
    )
    monkeypatch.syspath_prepend(str(place))
    monkeypatch.syspath_prepend(str(FAULTY))  # the first of the two


@pytest.mark.usefixtures("rival")
def test_contested_components_are_shown(hillsphere: Runner) -> None:
    offered = "is offered by two plugins, 'faulty_plugin' and 'rival_plugin'"
    shown = json.loads(hillsphere("plugins", "--json").stdout)["contested"]
    assert [(c["kind"], c["type"]) for c in shown] == [
        ("command", "greet"), ("stage", "step"), ("command", "run"),
    ]  # fmt: skip
    assert f"stage 'step' {offered}" in shown[1]["message"]
    lines = hillsphere("plugins").stdout.splitlines()
    assert sum(line.startswith("contested: ") for line in lines) == 3
    assert any(line.startswith(f"contested: stage 'step' {offered}") for line in lines)
    done = hillsphere("schema")
    assert done.returncode == 0
    assert f"not in the schema: stage 'step' {offered}" in done.stderr
    done = hillsphere("greet", "you")
    assert done.returncode == 2
    assert done.stderr.startswith(f"command 'greet' {offered}")
    checks = json.loads(hillsphere("doctor", "--json").stdout)["checks"]
    failed = {c["name"] for c in checks if c["state"] == "fail"}
    assert {"contested stage step", "contested command greet", "contested command run"} <= failed


@pytest.mark.parametrize("arguments", [["--help"], ["plugins"], ["schema"], ["run", "trial.toml"]])
def test_a_reader_that_has_gone_is_no_error(
    hillsphere: Runner, mission: Path, arguments: list[str]
) -> None:
    read, write = os.pipe()
    os.close(read)
    process = subprocess.Popen(
        [sys.executable, "-m", "hillsphere", *arguments], cwd=hillsphere.directory,
        env=hillsphere.environment, stdout=write, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    os.close(write)
    _, stderr = process.communicate(timeout=60)
    assert (process.returncode, stderr) == (0, "")


def test_doctor(hillsphere: Runner, monkeypatch: pytest.MonkeyPatch) -> None:
    done = hillsphere("doctor", "--json")
    shown = json.loads(done.stdout)
    failed = [c for c in shown["checks"] if c["state"] == "fail"]
    # What is wrong here is what this test's own plugin brings; all else must be in order.
    assert {c["name"] for c in failed} == {
        "shattered", "command absent", "contested command run",
    }  # fmt: skip
    assert (done.returncode, shown["ok"]) == (1, False)
    groups = {c["group"] for c in shown["checks"]}
    assert {"version", "plugin", "compile cache", "self-test"} <= groups
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place != str(FAULTY)])
    default_registry.cache_clear()
    done = hillsphere("doctor")
    assert done.returncode == 0, done.stdout
    assert done.stdout.count("self-test") == 3
