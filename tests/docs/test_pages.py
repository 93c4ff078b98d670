"""Pages of the documentation: their examples run, and the names in them exist."""

from __future__ import annotations

import re
import shlex
import sys
import tomllib
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import typer

from hillsphere.cli import commands, result_commands, run_commands
from hillsphere.cli.application import app
from hillsphere.mission import load_mission
from hillsphere.plugins import default_registry

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted([DOCS / "start.md", *(DOCS / "how-to").glob("*.md")])
TEXTS = {path.relative_to(DOCS).as_posix(): path.read_text("utf-8") for path in PAGES}
EVERY = [path for path in DOCS.rglob("*.md") if "_build" not in path.parts]

FILE_NAME = re.compile(r"# (\S+\.(?:py|toml))$")
"""First line of a block that is a file of its own."""


def blocks(text: str, language: str) -> list[tuple[str, str | None]]:
    """Return (content, output that is shown below it) of the blocks of a language."""
    pattern = rf"```{language}\n(.*?)```\n(?:\n```text\n(.*?)```\n)?"
    return [(block, shown or None) for block, shown in re.findall(pattern, text, re.DOTALL)]


def file_of(block: str) -> str | None:
    """Return the name of the file that a block is."""
    match = FILE_NAME.match(block.partition("\n")[0])
    return match[1] if match else None


def pages_with(language: str) -> list[str]:
    return [name for name, text in TEXTS.items() if blocks(text, language)]


@pytest.mark.slow  # pages run missions
@pytest.mark.parametrize("name", pages_with("python"))
def test_python_of_a_page_prints_what_it_shows(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In order, in one session; a block that begins with the name of a file is that file."""
    session = ModuleType("page")
    monkeypatch.setitem(sys.modules, "page", session)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)
    files = []
    for block, shown in blocks(TEXTS[name], "python"):
        if file := file_of(block):
            path = tmp_path / file
            path.parent.mkdir(exist_ok=True)
            path.write_text(block, "utf-8")
            files.append(file)
            continue
        exec(block, session.__dict__)
        printed = capsys.readouterr().out
        if shown is not None:
            assert printed == shown, block
    for file in files:  # each is a module that can be imported
        import_module(file.removesuffix(".py").replace("/", ".").removesuffix(".__init__"))
    for module in [module for module in sys.modules if module.startswith("my_")]:
        del sys.modules[module]


@pytest.mark.parametrize("name", pages_with("toml"))
def test_toml_of_a_page_is_a_mission(name: str, tmp_path: Path) -> None:
    """The blocks of a page are one mission, valid as a whole and under each of its profiles."""
    plain = [block for block, _ in blocks(TEXTS[name], "toml")]
    for block in plain:
        tomllib.loads(block)
    tables = "\n".join(block for block in plain if not file_of(block))
    if "format = 1" not in tables:
        assert name == "how-to/add-a-gravity-model.md"  # its only block is a pyproject.toml
        return
    if 'file = "moon.obj"' in tables:  # a file of the reader's, here of four faces
        corners = "v 13 0 0\nv -9 9 0\nv -9 -9 0\nv 0 0 9\n"
        (tmp_path / "moon.obj").write_text(f"{corners}f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")
    path = tmp_path / "mission.toml"
    path.write_text(tables, "utf-8")
    mission = load_mission(str(path), allow_path=True)
    assert mission.order()
    for profile in mission.profiles:
        assert load_mission(str(path), profile=profile, allow_path=True).order()


@pytest.mark.parametrize("name", pages_with("sh"))
def test_commands_of_a_page_exist(name: str) -> None:
    """Each line ``hillsphere COMMAND OPTIONS`` names a command and options that are there."""
    for block, _ in blocks(TEXTS[name], "sh"):
        for line in block.splitlines():
            words = shlex.split(line, comments=True)
            if words[:1] == ["hillsphere"]:
                assert unknown_options(words[1:]) == [], line


def unknown_options(words: list[str]) -> list[str]:
    """Return the options of a command line that the command does not have."""
    assert {commands, result_commands, run_commands}  # each adds its commands to the application
    group: Any = typer.main.get_command(app)
    command = group.commands.get(words[0])
    if command is None:  # a plugin's, which the group would import when it is called
        record = default_registry().get("command", words[0])
        command = typer.main.get_command(record.load_target())
    known = {option for one in command.params for option in (*one.opts, *one.secondary_opts)}
    given = {word.partition("=")[0] for word in words[1:] if word.startswith("--")}
    return sorted(given - known - {"--help"})


def test_an_unknown_option_is_seen() -> None:
    assert unknown_options(["run", "phobos-qso", "--profile", "fast", "--colour"]) == ["--colour"]


@pytest.mark.parametrize("path", EVERY, ids=lambda path: path.relative_to(DOCS).as_posix())
def test_names_that_a_page_links_to_exist(path: Path) -> None:
    for target in re.findall(r"\{py:\w+\}`(?:[^`<]*<)?([\w.]+)>?`", path.read_text("utf-8")):
        assert resolve(target), target


def resolve(name: str) -> bool:
    """Return whether a dotted name is a module, or an attribute of one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            value: object = import_module(".".join(parts[:length]))
        except ImportError:
            continue
        for part in parts[length:]:
            value = getattr(value, part, None)
        return value is not None
    return False


def test_a_name_that_does_not_exist_is_seen() -> None:
    assert resolve("hillsphere.Motion.stm")
    assert not resolve("hillsphere.Motion.fly")
