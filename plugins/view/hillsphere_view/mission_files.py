"""The missions that the page can start: the packaged ones, and those of the command line."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import read_text
from hillsphere.mission.load import Mission, load_mission, packaged_missions
from hillsphere.plugins import Registry
from hillsphere.runs.mission_check import check_mission
from hillsphere.runs.resume_choices import is_packaged
from hillsphere_view.run_folders import MissingError

__all__ = ["MissionFiles"]

_MAX_BYTES = 4 << 20
"""Largest mission file that is shown; the largest packaged one has 60 kB."""


class MissionFiles:
    """Missions by the words with which a request names them.

    Parameters
    ----------
    files : sequence of Path
        Mission files of the command line, named ``file:0`` and so on.
    registry : Registry
        Components of missions.

    Raises
    ------
    InputError
        If a file does not exist.
    """

    def __init__(self, files: Sequence[Path], registry: Registry) -> None:
        for file in files:
            if not file.is_file():
                raise InputError(f"there is no mission file {str(file)!r}")
        self._files = {f"file:{index}": file.absolute() for index, file in enumerate(files)}
        self._registry = registry

    def listed(self) -> list[tuple[str, str, str]]:
        """Return (word of requests, name, title) of all missions, those of the user first."""
        rows = []
        for word, file in self._files.items():
            head = _head(file)
            rows.append((word, file.name, str(head.get("title", ""))))
        return rows + [(name, name, title) for name, title in packaged_missions()]

    def target(self, word: str) -> str:
        """Return what the command line takes for a mission; `MissingError` for an unknown one."""
        if word in self._files:
            return str(self._files[word])
        if is_packaged(word):
            return word
        raise MissingError("there is no such mission")

    def load(self, word: str, sets: Sequence[str] = (), profile: str | None = None) -> Mission:
        """Load a mission and check it as before a run; `MissionError` with every problem."""
        mission = load_mission(
            self.target(word), sets=tuple(sets), profile=profile, registry=self._registry
        )
        check_mission(mission)
        return mission

    def text(self, word: str) -> str:
        """Return the text of a mission file; ``""`` if it cannot be read."""
        try:
            mission = load_mission(self.target(word), registry=self._registry)
        except MissingError:
            raise
        except InputError:
            file = self._files.get(word)
            return "" if file is None else _text(file)
        return mission.text

    def profiles(self, word: str) -> tuple[str, ...]:
        """Return the profiles of a mission; none if it cannot be read."""
        target = self.target(word)
        try:
            return load_mission(target, registry=self._registry).profiles
        except InputError:
            return ()

    def of_run(self, manifest: Mapping[str, Any]) -> list[str]:
        """Return the options with which a run is continued.

        A run directory does not choose a file that is read. If its mission bears the name of one of
        the command line's files, that file is given; whether it is the same is checked by the
        command that continues the run.
        """
        name = manifest["mission"].get("name")
        same = [file for file in self._files.values() if _head(file).get("name") == name]
        return [f"--mission={same[0]}"] if same else []


def _text(file: Path) -> str:
    try:
        return read_text(file, max_bytes=_MAX_BYTES)
    except (OSError, ValueError):
        return ""


def _head(file: Path) -> Mapping[str, Any]:
    try:
        return tomllib.loads(_text(file))
    except (tomllib.TOMLDecodeError, RecursionError):
        return {}
