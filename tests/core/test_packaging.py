"""The lists in pyproject.toml, the built archives and the README's commands."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
TEST_COMMAND = "python3 -m venv .venv && .venv/bin/pip install -e '.[test]' && .venv/bin/pytest"
RUN_COMMAND = (
    "python3 -m venv .venv && .venv/bin/pip install . && .venv/bin/hillsphere run phobos-qso"
)


@pytest.fixture(scope="module")
def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))


def plugin_packages() -> list[Path]:
    """Import packages in plugins/, relative to the root."""
    found = (ROOT / "plugins").glob("*/*/__init__.py")
    return sorted(path.parent.relative_to(ROOT) for path in found)


def test_every_plugin_folder_holds_one_package() -> None:
    folders = {p.name for p in (ROOT / "plugins").iterdir() if p.is_dir() and any(p.iterdir())}
    packages = plugin_packages()
    assert sorted(p.parts[1] for p in packages) == sorted(folders)
    assert all(p.name == f"hillsphere_{p.parts[1]}" for p in packages)
    assert all((ROOT / p / "py.typed").is_file() for p in packages)


def test_lists_are_in_step_with_the_folders(project: dict[str, Any]) -> None:
    packages = [p.as_posix() for p in plugin_packages()]
    names = [Path(p).name for p in packages]
    roots = sorted(["core", *(str(Path(p).parent) for p in packages)])
    tool = project["tool"]
    assert sorted(tool["hatch"]["build"]["targets"]["wheel"]["packages"]) == sorted(
        ["core/hillsphere", *packages]
    )
    assert project["project"]["entry-points"]["hillsphere"] == {name: name for name in names}
    assert sorted(tool["mypy"]["mypy_path"]) == roots
    assert sorted(tool["ruff"]["src"]) == roots


def build(target: str, directory: Path) -> Path:
    done = subprocess.run(
        [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(directory)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PIP_NO_INDEX": "1"},
    )
    assert done.returncode == 0, done.stderr
    (archive,) = directory.iterdir()
    return archive


def test_wheel_holds_missions_types_and_entry_points(
    tmp_path: Path, project: dict[str, Any]
) -> None:
    with zipfile.ZipFile(build("wheel", tmp_path)) as wheel:
        names = set(wheel.namelist())
        entry_points = next(n for n in names if n.endswith("entry_points.txt"))
        offered = wheel.read(entry_points).decode()
    for path in (ROOT / "missions").rglob("*"):
        if path.is_file():
            assert f"hillsphere/missions/{path.relative_to(ROOT / 'missions').as_posix()}" in names
    assert "hillsphere/py.typed" in names
    templates = list((ROOT / "core" / "hillsphere" / "cli" / "templates").iterdir())
    assert {f"hillsphere/cli/templates/{path.name}" for path in templates} <= names
    for package in plugin_packages():
        assert f"{package.name}/py.typed" in names
        assert f"{package.name} = {package.name}" in offered
    assert "hillsphere = hillsphere.cli:main" in offered
    assert {name.split("/")[0] for name in names if not name.split("/")[0].endswith(".dist-info")} \
        == {"hillsphere", *(p.name for p in plugin_packages())}  # fmt: skip


def test_sdist_holds_what_tests_need(tmp_path: Path) -> None:
    with tarfile.open(build("sdist", tmp_path)) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    for name in ("pyproject.toml", "README.md", "LICENSE", "core/hillsphere/__init__.py",
                 "tests/core/test_packaging.py",
                 "examples/hillsphere-dumbbell/pyproject.toml"):  # fmt: skip
        assert name in names
    assert not any(name.startswith((".venv", "runs/", ".git/")) for name in names)


def test_version_is_stated_once_over(project: dict[str, Any]) -> None:
    import hillsphere

    assert project["project"]["version"] == hillsphere.__version__


def test_conda_recipe_has_the_same_requirements(project: dict[str, Any]) -> None:
    recipe = (ROOT / "packaging" / "conda" / "recipe.yaml").read_text("utf-8")
    run = recipe.partition("  run:\n")[2].partition("\n\n")[0]
    names = {"heyoka.py": "heyoka", "matplotlib-base": "matplotlib"}
    required = {
        f"{names.get(name, name)}{limit}" for name, limit in re.findall(r"- (\S+) (>=\S+)", run)
    }
    wanted = {f"python{project['project']['requires-python']}", *project["project"]["dependencies"]}
    assert required == wanted
    assert f'version: "{project["project"]["version"]}"' in recipe


def test_citation_is_of_this_version(project: dict[str, Any]) -> None:
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"version: {project['project']['version']}\n" in citation
    assert f"license: {project['project']['license']}\n" in citation


def test_list_of_dependencies_is_whole(project: dict[str, Any]) -> None:
    rows = re.findall(
        r"^\| ([\w-]+) \| (.+) \| [\d.]+ \|$",
        (ROOT / "docs" / "dependencies.md").read_text("utf-8"),
        re.MULTILINE,
    )
    extras = project["project"]["optional-dependencies"]
    chosen = [
        text for extra in ("notebook", "web", "dask", "mesh", "spice") for text in extras[extra]
    ]
    needed = {re.match(r"[\w-]+", t)[0] for t in [*project["project"]["dependencies"], *chosen]}  # type: ignore[index]
    listed = dict(rows)
    assert needed <= listed.keys(), "run benchmarks/list_dependencies.py in a whole environment"
    assert [name for name, licence in rows if "GPL" in licence or not licence.strip()] == []


@pytest.mark.parametrize("command", [TEST_COMMAND, RUN_COMMAND])
def test_readme_commands_are_run_by_ci_word_for_word(command: str) -> None:
    readme = (ROOT / "README.md").read_text("utf-8").splitlines()
    assert readme.count(command) == 1
    # .ci/run takes the line from the README, so that the two cannot drift; this is its pattern.
    patterns = re.findall(r'readme_command "([^"]+)"', (ROOT / ".ci" / "run").read_text("utf-8"))
    matched = [[line for line in readme if re.search(p, line)] for p in patterns]
    assert [command] in matched


def test_readme_links_lead_somewhere() -> None:
    for readme in (ROOT / "README.md", *(ROOT / "examples").glob("*/README.md")):
        for target in re.findall(r"\]\(([^)#:]+)\)", readme.read_text("utf-8")):
            assert (readme.parent / target).exists(), f"{readme.name}: {target}"
