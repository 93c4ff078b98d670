"""Choices that `hillsphere resume` takes from ``resume.json``, and those that must be given again.

The file makes `hillsphere resume` work without further arguments. Run directories are passed
between users, so that the file is untrusted. Only harmless choices are taken from it: the name of a
packaged mission, the use of the cache, figures as PNG, and a local executor (serial, or a pool with
its number of workers). Other choices could be used for an attack. The address of a scheduler would
be connected to, and its data unpickled; any other executor is a program, and so is a plugin file; a
mission elsewhere, or files outside a mission's directory, would be read. These must be given on the
command line, even if the same user wrote the file, since nothing in a directory proves that.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from hillsphere.base.errors import InputError
from hillsphere.base.paths import missions_directory
from hillsphere.base.processors import processors
from hillsphere.base.shell_words import shell_line
from hillsphere.mission.load import Mission
from hillsphere.plugins.plugin_files import plugin_files
from hillsphere.runs.executor_choice import ExecutorChoice, executor_table
from hillsphere.runs.run_manifest import SCHEMA, read_record

__all__ = ["LOCAL", "ResumeChoices", "choose", "local_facts", "read_local", "resume_command"]

LOCAL = "resume.json"
"""File of the choices that concern this machine only."""

_LONGEST_TEXT = 4096
"""Longest path of Linux, in characters."""
_LONGEST_NAME = 255
"""Longest name of a file."""

_MOST_WORKERS = 64
"""Largest number of workers that a file may request beyond the number of processors. Each worker is
a Python process of about 200 MB, so that many could exhaust the memory."""


@dataclass(frozen=True)
class ResumeChoices:
    """Choices for the continuation of a run.

    Parameters
    ----------
    mission : str or Path, optional
        Name of a packaged mission, or path of a mission file.
    allow_path : bool
        Whether files outside the directory of the mission may be read.
    executor : str, mapping or Executor, optional
        Executor of the campaigns.
    """

    mission: str | os.PathLike[str] | None = None
    allow_path: bool = False
    executor: ExecutorChoice | None = None


def local_facts(mission: Mission, *, cache: bool, executor: Any, figures: bool) -> dict[str, Any]:
    """Return the content of `LOCAL`.

    Parameters
    ----------
    mission : Mission
        The mission of the run.
    cache : bool
        Whether results of stages may come from the cache.
    executor : mapping or None
        Table of the executor; ``None`` for one that was made in Python.
    figures : bool
        Whether every figure is written as PNG too.

    Returns
    -------
    dict
        Path of the mission, whether it reads files outside its directory, the plugin files, and the
        other arguments.
    """
    packaged = missions_directory().resolve()
    is_packaged = mission.path.parent.resolve() == packaged and mission.path.suffix == ".toml"
    roots = (mission.directory, packaged)
    return {
        "schema": SCHEMA,
        "mission": mission.path.stem if is_packaged else str(mission.path),
        "allow_path": any(
            not any(Path(path).is_relative_to(root) for root in roots)
            for specs in mission.specs.values()
            for spec in specs.values()
            for _, path in spec.data_paths()
        ),
        "cache": cache,
        "executor": executor,
        "figures": figures,
        "plugin_files": {file.name: file.sha256 for file in plugin_files()},
    }


def read_local(directory: Path) -> Mapping[str, Any]:
    """Return the content of `LOCAL` in a run directory.

    Raises
    ------
    InputError
        If it cannot be read or has not the form that a run writes.
    """
    path = directory / LOCAL
    record = read_record(path, ("mission", "allow_path"))
    mission, executor = record["mission"], record.get("executor")
    is_sound = (
        isinstance(mission, str)
        and 0 < len(mission) <= _LONGEST_TEXT
        and isinstance(record["allow_path"], bool)
        and isinstance(record.get("cache", True), bool)
        and isinstance(record.get("figures", False), bool)
        and (executor is None or (isinstance(executor, dict) and _is_word(executor.get("type"))))
        and _are_files(record.get("plugin_files", {}))
    )
    if not is_sound:
        raise InputError(f"{path}: is not the file that a run writes")
    return record


def _are_files(value: Any) -> bool:
    # Bare names: a path would come into the command that is proposed to the user.
    return isinstance(value, dict) and all(
        name == PurePosixPath(name).name == PureWindowsPath(name).name
        and name.isprintable()
        and 0 < len(name) <= _LONGEST_NAME
        and isinstance(digest, str)
        and re.fullmatch("[0-9a-f]{64}", digest)
        for name, digest in value.items()
    )


def choose(
    local: Mapping[str, Any],
    given: ResumeChoices,
    command: Sequence[str],
    settings: Sequence[str],
    *,
    needs_executor: bool = True,
) -> ResumeChoices:
    """Return the given choices, completed by the harmless ones of `LOCAL`.

    Parameters
    ----------
    local : mapping
        Content of `LOCAL`.
    given : ResumeChoices
        Choices of the caller.
    command : sequence of str
        The command line so far: ``("hillsphere", "resume", "runs/one")``.
    settings : sequence of str
        Settings in the run's manifest; they can change the files that the mission reads.
    needs_executor : bool
        Whether the command uses the executor of the run.

    Raises
    ------
    InputError
        If a choice must be given again. The message gives the whole command line.
    """
    if not needs_executor:
        local = {**local, "executor": None}
    wanted = _choices_to_give_again(local)
    missing = []
    if given.mission is None and not is_packaged(local["mission"]):
        missing.append(f"the mission file {_quote_harmless(local['mission'])}")
    if not given.allow_path and local["allow_path"]:
        what = "leave to read files outside the directory of the mission"
        if settings:
            named = _quote_harmless(" ".join(settings))
            what += f", of which the run's settings may name some: {named}"
        missing.append(what)
    if given.executor is None and not _is_of_this_machine(local.get("executor")):
        missing.append(f"the executor {_quote_harmless(_describe(local['executor']))}")
    lost = _lost_plugin_files(local)
    missing += [f"the plugin file {_quote_harmless(name)}" for name in lost]
    if missing:
        command = [*command, *(word for name in lost for word in _option("--plugin", name))]
        whole = replace(
            wanted,
            mission=given.mission if given.mission is not None else wanted.mission,
            executor=given.executor if given.executor is not None else wanted.executor,
        )
        items = "\n".join(f"  {item}" for item in missing)
        raise InputError(
            f"{command[2]!r} names choices that are not taken from a run directory, which another "
            f"user may have written:\n{items}\n"
            "if that is what you want, give it again; the whole command:\n"
            f"  {shell_line([*command, *_options(whole)])}{_keys_without_option(whole.executor)}"
        )
    return ResumeChoices(
        mission=given.mission if given.mission is not None else wanted.mission,
        allow_path=given.allow_path,
        executor=given.executor if given.executor is not None else local.get("executor"),
    )


def _lost_plugin_files(local: Mapping[str, Any]) -> list[str]:
    """Return the names of a run's plugin files that this process has not loaded.

    The record has no path: one from another user would invite to run the program there.

    Raises
    ------
    InputError
        If a file of this name is loaded whose content is another.
    """
    loaded = {file.name: file.sha256 for file in plugin_files()}
    lost = []
    for name, digest in local.get("plugin_files", {}).items():
        if name not in loaded:
            lost.append(name)
        elif loaded[name] != digest:
            raise InputError(
                f"the plugin file {_quote_harmless(name)} is another than that of the run: SHA-256 "
                f"{loaded[name][:12]}…, in the run {_quote_harmless(digest[:12])}…"
            )
    return lost


def resume_command(directory: Path, local: Mapping[str, Any]) -> str:
    """Return the command line that continues a run.

    Parameters
    ----------
    directory : Path
        The run directory.
    local : mapping
        Content of its `LOCAL`.
    """
    words = ["hillsphere", "resume", _as_argument(directory)]
    for name in local.get("plugin_files", {}):
        words += _option("--plugin", name)
    return shell_line([*words, *_options(_choices_to_give_again(local))])


def is_packaged(name: str) -> bool:
    """Return whether a text is the name of a packaged mission."""
    return name in {path.stem for path in missions_directory().glob("*.toml")}


def _choices_to_give_again(local: Mapping[str, Any]) -> ResumeChoices:
    """Return the choices of a file; only those that must be given again become options."""
    executor = local.get("executor")
    return ResumeChoices(
        local["mission"], local["allow_path"], None if _is_of_this_machine(executor) else executor
    )


def _is_of_this_machine(executor: Mapping[str, Any] | None) -> bool:
    """Return whether an executor starts only a limited number of processes of this program."""
    if executor is None or executor == {"type": "serial"}:
        return True
    workers = executor.get("workers")
    return (
        executor.get("type") == "pool"
        and executor.keys() <= {"type", "workers"}
        and (
            workers is None
            or (type(workers) is int and 1 <= workers <= max(_MOST_WORKERS, processors()))
        )
    )


def _options(choices: ResumeChoices) -> list[str]:
    words = []
    if choices.mission is not None and not is_packaged(str(choices.mission)):
        words += _option("--mission", os.fspath(choices.mission))
    if choices.allow_path:
        words.append("--allow-path")
    table = executor_table(choices.executor) or {}
    type_, scheduler, workers = (table.get(key) for key in ("type", "scheduler", "workers"))
    if _is_word(scheduler) and scheduler:
        words += _option("--scheduler", scheduler)
    if type_ is not None and (type_ != "dask" or not scheduler):
        words += _option("--executor", type_)
    if type(workers) is int:
        words += _option("--workers", str(workers))
    return words


def _option(name: str, value: str) -> list[str]:
    # One word where the value would be taken for another option.
    return [f"{name}={value}"] if value.startswith("-") else [name, value]


def _keys_without_option(executor: ExecutorChoice | None) -> str:
    """Return the keys of an executor that have no command-line option, as a text."""
    table = executor_table(executor) or {}
    others = sorted(table.keys() - {"type", "scheduler", "workers"})
    if not others:
        return ""
    return (
        f"\nonly Python can give {_quote_harmless(', '.join(others))} of the executor: "
        "hillsphere.resume_run(…, executor={…})"
    )


def _describe(executor: Mapping[str, Any]) -> str:
    scheduler = executor.get("scheduler")
    at = f" at {scheduler}" if _is_word(scheduler) and scheduler else ""
    workers = executor.get("workers")
    return f"{executor['type']}{at}" + (f" of {workers} workers" if workers is not None else "")


def _is_word(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= _LONGEST_TEXT


def _quote_harmless(text: str) -> str:
    """Return untrusted text in quotes, shortened, with control characters escaped."""
    return ascii(text[:200]) if not text.isprintable() else repr(text[:200])


def _as_argument(path: Path) -> str:
    text = str(path)
    return f"./{text}" if text.startswith("-") else text
