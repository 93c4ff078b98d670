"""Completion of the command line in a shell: names, and silence where there are none."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import pytest

from hillsphere.cli.endings import COMPLETION_VARIABLE, run
from hillsphere.testing import HEAVY_MODULES

RUN = (
    "import sys\n"
    "from hillsphere.cli.endings import run\n"
    "code = run([])\n"
    f"print([name for name in {HEAVY_MODULES!r} if name in sys.modules], file=sys.stderr)\n"
    "sys.exit(code)\n"
)


def offered(line: str, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return what the shell would offer for the last word of a line, which may be empty."""
    words = line.split(" ")
    monkeypatch.setenv("COMP_WORDS", line)
    monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
    monkeypatch.setenv(COMPLETION_VARIABLE, "complete_bash")
    out = StringIO()
    with redirect_stdout(out):
        assert run([]) == 0
    return out.getvalue().split()


@pytest.mark.parametrize(
    ("line", "names"),
    [
        ("hillsphere desc", ["describe"]),
        ("hillsphere run phobos-q", ["phobos-qso"]),
        ("hillsphere validate deimos-qso phobos-q", ["phobos-qso"]),
        ("hillsphere run phobos-qso --profile ", ["fast", "measured"]),
        ("hillsphere run --quiet phobos-qso --profile f", ["fast"]),
        ("hillsphere run phobos-qso --set gravity.point_mass.g", ["gravity.point_mass.gm_km3_s2="]),
        ("hillsphere describe gra", ["gravity"]),
        ("hillsphere describe stage qso", ["qso_family"]),
        ("hillsphere describe nothing ", []),
        ("hillsphere run absent.toml --profile ", []),
        ("hillsphere rerun absent --stage ", []),
    ],
)
def test_names_are_offered(line: str, names: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    assert offered(line, monkeypatch) == names


def test_stages_of_a_run_are_offered(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    state = {"type": "closed_loop", "state": "finished", "cached": False, "seconds": 1.0,
             "key": None, "product": None}  # fmt: skip
    stages = {"hover": state, "verify": state}
    manifest = {
        "schema": 1, "mission": {"name": "m", "title": "t", "stage": {}}, "stages": stages,
        "versions": {"python": "3", "packages": {}, "plugins": {}},
        "platform": {}, "started_utc": "2026-01-01T00:00:00Z",
    }  # fmt: skip
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    assert offered(f"hillsphere rerun {tmp_path} --stage v", monkeypatch) == ["verify"]
    assert offered(f"hillsphere figures {tmp_path} h", monkeypatch) == ["hover"]


def test_a_fault_leaves_names_out(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails() -> Path:
        raise SystemExit("a plugin did this")

    monkeypatch.setattr("hillsphere.base.paths.missions_directory", fails)
    assert offered("hillsphere run phobos-q", monkeypatch) == []


def test_a_broken_command_offers_nothing_and_says_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise RuntimeError("broken")

    monkeypatch.setattr("hillsphere.cli.plugin_commands.CommandGroup.list_commands", fails)
    monkeypatch.setenv("COMP_WORDS", "hillsphere ")
    monkeypatch.setenv("COMP_CWORD", "1")
    monkeypatch.setenv(COMPLETION_VARIABLE, "complete_bash")
    out, err = StringIO(), StringIO()
    monkeypatch.setattr(sys, "stderr", err)
    with redirect_stdout(out):
        assert run([]) == 2
    assert (out.getvalue(), err.getvalue()) == ("", "")


def test_the_script_for_the_shell_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")
    out = StringIO()
    with redirect_stdout(out):
        assert run(["--show-completion", "bash"]) == 0
    assert f"{COMPLETION_VARIABLE}=complete_bash" in out.getvalue()


def test_nothing_numerical_is_imported() -> None:
    line = "hillsphere run phobos-qso --set stage."
    environment = {
        **os.environ, "COMP_WORDS": line, "COMP_CWORD": "4", COMPLETION_VARIABLE: "complete_bash",
    }  # fmt: skip
    code = RUN.replace("code = run([])", "try: code = run([])\nexcept SystemExit as e: code = 0")
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0
    assert "stage.family.plant=" in done.stdout.split()
    assert done.stderr.splitlines()[-1] == "[]"
