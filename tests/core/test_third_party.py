"""The example package, installed as a third party would: its mission, its tests, its imports."""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import sysconfig
import venv
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "hillsphere-dumbbell"


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Interpreter of a scratch environment with the example installed, and its source copy."""
    directory = tmp_path_factory.mktemp("third-party")
    source = directory / "hillsphere-dumbbell"
    shutil.copytree(EXAMPLE, source, ignore=shutil.ignore_patterns("__pycache__", ".*"))
    venv.create(directory / "venv", with_pip=False)
    python = directory / "venv" / "bin" / "python"
    # No network: everything else is taken from the environment that runs this test. addsitedir,
    # unlike a bare path, follows the .pth files of editable installs.
    outer = sysconfig.get_path("purelib")
    inner = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        capture_output=True, text=True, check=True,
    ).stdout.strip()  # fmt: skip
    Path(inner, "outer.pth").write_text(f"import site; site.addsitedir({outer!r})\n", "utf-8")
    run(python, "-m", "pip", "install", "--no-build-isolation", "--no-deps", "--no-index",
        "--disable-pip-version-check", "--root-user-action=ignore", source,
        cwd=directory)  # fmt: skip
    return python, source


def run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST_", "COV_"))}
    environment.pop("PYTHONPATH", None)
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def test_its_components_are_listed(installed: tuple[Path, Path], tmp_path: Path) -> None:
    python, _ = installed
    listed = json.loads(run(python, "-m", "hillsphere", "plugins", "--json", cwd=tmp_path).stdout)
    mine = [c for c in listed["components"] if c["plugin"] == "hillsphere_dumbbell"]
    assert [(c["kind"], c["type"]) for c in mine] == [
        ("gravity", "dumbbell"),
        ("sensor", "limb_ranger"),
        ("stage", "zero_velocity"),
    ]
    assert {c["distribution"] for c in mine} == {"hillsphere-dumbbell 1.0.0"}
    assert listed["broken"] == {}


def test_its_mission_runs(installed: tuple[Path, Path], tmp_path: Path) -> None:
    python, source = installed
    out = tmp_path / "out"
    run(python, "-m", "hillsphere", "run", source / "missions" / "dumbbell-moon.toml",
        "--profile", "fast", "--no-cache", "--out", out, cwd=tmp_path)  # fmt: skip
    summary = json.loads((out / "summary.json").read_text("utf-8"))
    assert summary["mission"] == "dumbbell-moon"
    rows = summary["tables"]["equilibria"]["rows"]
    # Hill's L1 and L2 of a point mass lie at 16.57 km; the elongated moon pushes them outwards.
    assert [row["y_km"] for row in rows] == [0.0, 0.0]
    assert all(16.6 < abs(row["x_km"]) < 20.0 for row in rows)
    assert (out / "map.npz").is_file()
    assert any((out / "figures").glob("zero_velocity*.svg"))
    assert "zero-velocity" in (out / "report.html").read_text("utf-8").lower()


def test_its_components_are_in_the_schema(installed: tuple[Path, Path], tmp_path: Path) -> None:
    python, _ = installed
    schema = run(python, "-m", "hillsphere", "schema", cwd=tmp_path).stdout
    assert '"dumbbell"' in schema
    assert "rod_fraction" in schema


def test_its_own_tests_pass(installed: tuple[Path, Path]) -> None:
    python, source = installed
    done = run(python, "-m", "pytest", "-q", "-p", "no:cacheprovider", cwd=source)
    assert " passed" in done.stdout


def imports(path: Path) -> Iterator[str]:
    """Dotted names that a file imports from the framework and its built-in plugins."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_it_uses_no_private_door() -> None:
    files = list(EXAMPLE.rglob("*.py"))
    assert files
    for path in files:
        for name in imports(path):
            top = name.partition(".")[0]
            if top.startswith("hillsphere"):
                # Its tests fly the sensor with a filter, on the plant model of the estimators.
                own = {"hillsphere", "hillsphere_dumbbell"}
                tools = {"hillsphere_estimators"} if path.name.startswith("test_") else set()
                assert top in own | tools, f"{path.name}: {name}"
                private = [part for part in name.split(".") if part.startswith("_")]
                assert not private, f"{path.name}: {name}"
