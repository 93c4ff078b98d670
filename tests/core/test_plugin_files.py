"""Plugins of one file, named on the command line: loaded, recorded, and never taken from a run."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import pytest
from tests.core.conftest import forget_plugin_files
from tests.core.wave_missions import WAVES, waves_mission

from hillsphere.base.errors import PluginError
from hillsphere.cli.endings import run
from hillsphere.plugins import add_plugin_file, default_registry, plugin_files

SOURCE = (WAVES / "waves_plugin.py").read_text("utf-8").replace('"waves_plugin:', 'f"{__name__}:')
"""The plugin of the tests of campaigns, as one file that names itself."""


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    """Make a directory with a plugin file and its mission, and forget what a test loads."""
    (tmp_path / "waves.py").write_text(SOURCE, "utf-8")
    (tmp_path / "sea.toml").write_text(waves_mission(130), "utf-8")
    default_registry.cache_clear()
    with chdir(tmp_path):
        yield tmp_path


def hillsphere(*arguments: str) -> tuple[int, str]:
    """Run a command as in a process of its own; return its exit code and all that it wrote."""
    forget_plugin_files()
    out = StringIO()
    with redirect_stdout(out), redirect_stderr(out):
        code = run(list(arguments))
    return int(code), out.getvalue()


def test_a_mission_uses_the_components_of_a_file(place: Path) -> None:
    code, told = hillsphere("run", "./sea.toml", "--out", "none")
    assert code == 2
    assert "no stage of type 'wave'" in told
    common = ("run", "./sea.toml", "--plugin", "waves.py", "--no-cache", "--workers")
    assert hillsphere(*common, "0", "--out", "a")[0] == 0
    assert hillsphere(*common, "2", "--out", "b")[0] == 0
    a, b = (json.loads((place / name / "summary.json").read_text("utf-8")) for name in "ab")
    assert a == b
    manifest = json.loads((place / "a" / "manifest.json").read_text("utf-8"))
    assert manifest["command"].endswith("--plugin waves.py")
    digest = manifest["sources"]["hillsphere_plugin_file_waves"]
    assert manifest["versions"]["plugins"]["waves.py"] == f"waves.py {digest[:12]}"
    code, told = hillsphere("plugins", "--plugin", "waves.py")
    assert "waves.py" in told
    assert hillsphere("describe", "stage", "wave", "--plugin", "waves.py")[0] == 0


def test_the_digest_of_a_file_is_in_the_keys_of_its_stages(place: Path) -> None:
    keys = []
    for end in ("", "\n# changed\n"):
        (place / "waves.py").write_text(SOURCE + end, "utf-8")
        out = f"run{len(end)}"
        assert hillsphere("run", "./sea.toml", "--plugin", "waves.py", "--out", out)[0] == 0
        manifest = json.loads((place / out / "manifest.json").read_text("utf-8"))
        keys.append({name: stage["key"] for name, stage in manifest["stages"].items()})
    assert all(keys[0][name] != keys[1][name] for name in keys[0])


def test_a_run_does_not_choose_its_plugin_file(place: Path) -> None:
    failing = ("--set", "stage.wave.fails=true")
    assert hillsphere("run", "./sea.toml", "--plugin", "waves.py", "--out", "a", *failing)[0] == 1
    code, told = hillsphere("resume", "a", "--mission", "sea.toml")
    assert code == 2
    assert "the plugin file" in told
    assert "--plugin waves.py" in told
    assert (
        str(place) not in (place / "a" / "resume.json").read_text("utf-8").split("plugin_files")[1]
    )
    assert hillsphere("resume", "a", "--mission", "sea.toml", "--plugin", "waves.py")[0] == 1
    (place / "waves.py").write_text(SOURCE + "\n# changed\n", "utf-8")
    code, told = hillsphere("resume", "a", "--mission", "sea.toml", "--plugin", "waves.py")
    assert code == 2
    assert "is another than that of the run" in told


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("x = 1\nif\n", "bad.py:2: the plugin file cannot be loaded: SyntaxError"),
        ("x = 1\n\nraise OSError('no')\n", "bad.py:3: the plugin file cannot be loaded: OSError"),
        ("raise SystemExit(3)\n", "bad.py:1: the plugin file cannot be loaded: SystemExit: 3"),
        ("import nowhere_at_all\n", "bad.py:1: the plugin file cannot be loaded: ModuleNotFound"),
        ("x = 1\n", "bad.py: plugin 'bad.py' is broken: PluginError: it offers no component"),
        ("\0", "bad.py"),
        (
            "from hillsphere.plugins import Component, hookimpl\n"
            "@hookimpl\n"
            "def hillsphere_components():\n"
            "    return [Component('gravity', 'point_mass', 'a:B', 'a:C', 's')]\n",
            "bad.py: gravity 'point_mass' is already offered by plugin 'hillsphere_gravity'",
        ),
    ],
)  # fmt: skip
def test_a_faulty_file_is_refused_with_its_line(place: Path, source: str, said: str) -> None:
    (place / "bad.py").write_text(source, "utf-8")
    code, told = hillsphere("run", "phobos-qso", "--plugin", "bad.py", "--out", "a")
    assert code == 2
    assert said in told
    assert len(told.splitlines()) == 1
    assert not (place / "a").exists()
    assert "hillsphere_plugin_file_bad" not in sys.modules


def test_a_worker_executes_the_source_of_its_process(place: Path) -> None:
    file = add_plugin_file("waves.py")
    assert add_plugin_file(place / "waves.py") == file
    (place / "waves.py").write_text("raise OSError\n", "utf-8")
    with pytest.raises(PluginError, match="has changed since it was loaded"):
        add_plugin_file("waves.py")
    sent = pickle.loads(pickle.dumps(plugin_files.plugin_files()))
    forget_plugin_files()
    plugin_files.load_plugin_files(sent)
    assert plugin_files.plugin_files() == (file,)
    assert "waves.py" in {record.plugin for record in default_registry()}


def test_a_file_is_not_executed_before_it_is_known(place: Path) -> None:
    hillsphere("run", "./sea.toml", "--plugin", "waves.py", "--out", "a", "--workers", "0")
    (place / "waves.py").write_text(SOURCE + "\nopen('EXECUTED', 'w')\n", "utf-8")
    for command in (("resume", "a"), ("figures", "a"), ("rerun", "a", "--case", "1")):
        code, told = hillsphere(*command, "--mission", "sea.toml", "--plugin", "waves.py")
        assert code == 2
        assert "is another than that of the run" in told
        assert not (place / "EXECUTED").exists()


def test_completion_and_wrong_calls_execute_no_file(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (place / "waves.py").write_text("open('EXECUTED', 'w')\n", "utf-8")
    assert hillsphere("run", "--plugin", "waves.py")[0] == 2  # no mission
    monkeypatch.setenv("_HILLSPHERE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", "hillsphere run --plugin waves.py ph")
    monkeypatch.setenv("COMP_CWORD", "4")
    program = [sys.executable, "-m", "hillsphere"]
    done = subprocess.run(program, capture_output=True, text=True, check=False, timeout=60)
    assert "phobos-qso" in done.stdout
    assert not (place / "EXECUTED").exists()


@pytest.mark.parametrize(
    "files",
    [
        {"/tmp/evil.py": "0" * 64},
        {"..\\evil.py": "0" * 64},
        {"evil.py\n": "0" * 64},
        {"evil.py": "0"},
        {"": "0" * 64},
    ],
)
def test_a_record_names_files_without_their_place(place: Path, files: dict[str, str]) -> None:
    failing = ("--set", "stage.wave.fails=true")
    hillsphere("run", "./sea.toml", "--plugin", "waves.py", "--out", "a", *failing)
    record = json.loads((place / "a" / "resume.json").read_text("utf-8"))
    (place / "a" / "resume.json").write_text(json.dumps(record | {"plugin_files": files}), "utf-8")
    code, told = hillsphere("resume", "a", "--mission", "sea.toml")
    assert code == 2
    assert "is not the file that a run writes" in told
    assert "evil" not in told


def test_all_files_of_a_process_are_in_all_keys(place: Path) -> None:
    (place / "other.py").write_text(
        "from hillsphere.plugins import Component, hookimpl\n"
        "@hookimpl\n"
        "def hillsphere_components():\n"
        "    return [Component('gravity', 'own', __name__ + ':B', __name__ + ':C', 's')]\n",
        "utf-8",
    )
    keys = []
    for more in ((), ("--plugin", "other.py")):
        out = f"run{len(more)}"
        hillsphere("run", "./sea.toml", "--plugin", "waves.py", *more, "--out", out)
        manifest = json.loads((place / out / "manifest.json").read_text("utf-8"))
        keys.append({name: stage["key"] for name, stage in manifest["stages"].items()})
    assert keys[0].keys() == keys[1].keys()
    assert all(keys[0][name] != keys[1][name] for name in keys[0])


@pytest.mark.parametrize("module", ["helper_beside.py", "helper_beside/__init__.py"])
def test_a_module_beside_a_file_is_refused(place: Path, module: str) -> None:
    (place / module).parent.mkdir(exist_ok=True)
    (place / module).write_text("X = 1\n", "utf-8")
    sys.modules.pop("this", None)
    head = "import os, sys; sys.path.insert(0, os.path.dirname(__file__)); import helper_beside\n"
    (place / "waves.py").write_text(
        f"{head}import this\n" + SOURCE.replace("from __future__", "# "), "utf-8"
    )
    found = list(sys.path)
    try:
        for _ in range(2):
            code, told = hillsphere("plugins", "--plugin", "waves.py")
            assert code == 2
            assert "imports 'helper_beside' from beside it" in told
            assert "helper_beside" not in sys.modules
    finally:
        sys.path[:] = found
    assert "this" in sys.modules  # modules from elsewhere stay


def test_a_file_is_executed_as_by_python(place: Path) -> None:
    (place / "waves.py").write_text(
        SOURCE.replace("from __future__ import annotations", "print('noise')")
        + "\ndef f(x: int) -> None: ...\nassert f.__annotations__['x'] is int\n",
        "utf-8",
    )
    done = subprocess.run(
        [sys.executable, "-m", "hillsphere", "plugins", "--json", "--plugin", "waves.py"],
        capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    assert "noise" in done.stderr
    assert json.loads(done.stdout)


def test_two_files_of_one_name_and_other_machines_are_refused(place: Path) -> None:
    (place / "other").mkdir()
    (place / "other" / "waves.py").write_text(SOURCE, "utf-8")
    code, told = hillsphere("plugins", "--plugin", "waves.py", "--plugin", "other/waves.py")
    assert code == 2
    assert "was loaded under this name before" in told
    code, told = hillsphere(
        "run", "./sea.toml", "--plugin", "waves.py", "--executor", "dask", "--out", "a"
    )
    assert code == 2
    assert "serial and pool only" in told
    code, told = hillsphere("plugins", "--plugin", "absent.py")
    assert code == 2
    assert "'absent.py' cannot be read: No such file" in told
    os.mkfifo(place / "pipe.py")
    code, told = hillsphere("plugins", "--plugin", "pipe.py")
    assert code == 2
    assert "not a regular file" in told


@pytest.mark.parametrize(
    ("name", "fault"),
    [("Wvae", "has no attribute 'Wvae'"), ("NUMBER", "is no class, got an int")],
)
def test_a_class_that_does_not_exist_is_told(place: Path, name: str, fault: str) -> None:
    broken = SOURCE.replace('f"{__name__}:WaveStage"', f'f"{{__name__}}:{name}"') + "\nNUMBER = 3\n"
    assert broken.count(f":{name}") == 1
    (place / "waves.py").write_text(broken, "utf-8")
    assert hillsphere("plugins", "--plugin", "waves.py")[0] == 0  # quick: nothing is imported
    for command in (("plugins", "--strict-plugins"), ("describe", "stage", "wave")):
        code, told = hillsphere(*command, "--plugin", "waves.py")
        assert code == 2
        assert "plugin 'waves.py': stage 'wave'" in told
        assert fault in told


def test_an_unknown_type_reminds_of_plugin_files(place: Path) -> None:
    code, told = hillsphere("run", "./sea.toml", "--out", "none")
    assert code == 2
    assert "--plugin FILE" in told
    (place / "sea.toml").write_text(waves_mission(130).replace('"wave"', '"wvae"'), "utf-8")
    code, told = hillsphere("run", "./sea.toml", "--plugin", "waves.py", "--out", "none")
    assert "no stage of type 'wvae'; did you mean 'wave'?" in told
    assert "--plugin FILE" not in told
