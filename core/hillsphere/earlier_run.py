"""A run that was begun before: what its directory holds, and what has changed since."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from hillsphere.errors import InputError
from hillsphere.mission import Mission, load_mission
from hillsphere.paths import missions_directory
from hillsphere.plugins import Registry
from hillsphere.product_codec import load_product, read_fault
from hillsphere.run_differences import differences
from hillsphere.run_record import SCHEMA, RunRecord
from hillsphere.stage_cache import file_digest
from hillsphere.store import RunDirectory, plain_json

__all__ = ["LOCAL", "EarlierRun", "local_facts"]

LOCAL = "resume.json"
"""File of what belongs to this machine: it makes ``resume`` work with no further argument."""

_LISTED = 20


def local_facts(mission: Mission, *, cache: bool, executor: Any) -> dict[str, Any]:
    """Return the content of `LOCAL`.

    Parameters
    ----------
    mission : Mission
        What is run.
    cache : bool
        Whether results of stages may come from the cache.
    executor : mapping or None
        Table of the executor; ``None`` for one that was made in Python.

    Returns
    -------
    dict
        Where the mission is, whether it reads files elsewhere, and the other arguments.
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
    }


@dataclass(frozen=True)
class EarlierRun:
    """A run directory that a run has left, or is still writing to.

    Parameters
    ----------
    directory : RunDirectory
        The directory.
    manifest : mapping
        Content of ``manifest.json``.
    """

    directory: RunDirectory
    manifest: Mapping[str, Any]

    @classmethod
    def open(cls, path: str | Path) -> EarlierRun:
        """Read what a run directory says of its run.

        Raises
        ------
        InputError
            If it is none, or holds what this version cannot read.
        """
        place = Path(path)
        try:
            if not place.is_dir():
                missing = "it is a file" if place.exists() else "there is no such directory"
            elif not (place / "manifest.json").is_file():
                missing = "it holds no manifest.json"
                if (place / "log.txt").is_file():
                    missing += "; the run ended before it kept anything"
            else:
                missing = ""
        except (OSError, ValueError) as error:  # ValueError: a NUL in the name
            missing = str(error)
        if missing:
            raise InputError(f"{str(path)!r} is no run directory: {missing}")
        keys = ("mission", "stages", "versions", "platform")
        return cls(RunDirectory(place), _table(place / "manifest.json", keys))

    @cached_property
    def local(self) -> Mapping[str, Any]:
        """Content of ``resume.json``."""
        return _table(self.directory.path / LOCAL, ("mission", "allow_path"))

    @property
    def state(self) -> str:
        """``"running"`` (or killed), ``"interrupted"``, ``"failed"`` or ``"finished"``."""
        return str(self.manifest.get("state"))

    def mission(self, registry: Registry | None) -> Mission:
        """Load the mission as it is now, with the profile and settings of the run.

        Raises
        ------
        InputError
            If its file is not there any more, or is not sound any more.
        """
        name = str(self.local["mission"])
        if Path(name).is_absolute() and not Path(name).is_file():
            raise InputError(
                f"mission file {name!r}, from which this run was started, is not there any more; "
                f"put it back, or write where it is now into {self.directory.path / LOCAL}"
            )
        return load_mission(
            name,
            sets=tuple(self.manifest.get("sets", ())),
            profile=self.manifest.get("profile"),
            registry=registry,
            allow_path=bool(self.local["allow_path"]),
        )

    def continue_in(self, record: RunRecord) -> None:
        """Make the record of a run that begins now that of this one.

        Parameters
        ----------
        record : RunRecord
            Of the mission as it is now.

        Raises
        ------
        InputError
            See `refuse_changes`.
        """
        self.refuse_changes(record)
        record.resumed = [*map(_moment, self.manifest.get("resumed_utc", [])), record.started]
        record.started = _moment(self.manifest.get("started_utc"))
        for stage in record.stages.values():
            entry = self.manifest["stages"].get(stage.name, {})
            if stage.key is not None and entry.get("product") and entry.get("key") == stage.key:
                stage.state = "done"
                stage.product = entry["product"]
                stage.cached = bool(entry.get("cached"))
                stage.seconds = float(entry.get("seconds", 0.0))

    def refuse_changes(self, record: RunRecord) -> None:
        """Refuse to go on if the results would depend on something else than they did.

        Parameters
        ----------
        record : RunRecord
            Of the mission as it is now.

        Raises
        ------
        InputError
            With every difference.
        """
        found = differences(self.manifest, plain_json(record.manifest("running")))
        if not found:
            return
        listed = found[:_LISTED]
        if len(found) > _LISTED:
            listed.append(f"and {len(found) - _LISTED} more")
        raise InputError(
            "\n  ".join(
                [
                    f"run {str(self.directory.path)!r} cannot be continued: what its results "
                    "depend on has changed (then -> now):",
                    *listed,
                ]
            )
            + f"\nundo that, or begin a new run: {self.manifest.get('command', 'hillsphere run')}"
        )

    def product(self, stage: str, expected: type) -> Any:
        """Return the product of a stage that this run has stored.

        Parameters
        ----------
        stage : str
            Its name.
        expected : type
            Class of its product.

        Raises
        ------
        InputError
            If the file is not what the run wrote, or not there.
        StageError
            If it cannot be read just now.
        """
        path = self.directory.path / f"{stage}.npz"
        try:
            digest = file_digest(path)
        except InputError as error:
            if isinstance(error.__cause__, OSError):
                raise read_fault(path, error.__cause__) from error
            raise
        if digest != self.manifest["stages"].get(stage, {}).get("product"):
            raise InputError(f"{path.name}: is not the file that the run wrote")
        product = load_product(path)
        if not isinstance(product, expected):
            raise InputError(f"{path.name}: holds a {type(product).__name__}")
        return product


def _table(path: Path, keys: tuple[str, ...]) -> Mapping[str, Any]:
    """Read a JSON file that must hold a table with these keys."""
    try:
        found = json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    except ValueError as error:
        raise InputError(f"{path}: is damaged: {error}") from error
    if not isinstance(found, dict) or not all(key in found for key in keys):
        raise InputError(f"{path}: is not the file that a run writes")
    if found.get("schema") != SCHEMA:
        raise InputError(
            f"{path}: written in format {found.get('schema')!r}; this version reads {SCHEMA}"
        )
    return found


def _moment(text: object) -> datetime:
    try:
        return datetime.strptime(str(text), "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=UTC)
    except ValueError as error:
        raise InputError(f"manifest.json: {text!r} is no time") from error
