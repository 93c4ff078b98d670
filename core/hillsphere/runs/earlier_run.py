"""Access to an earlier run: its directory, and the changes since then."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from hillsphere.base.errors import InputError
from hillsphere.mission.load import Mission, load_mission
from hillsphere.plugins.registry import Registry
from hillsphere.products.product_codec import load_product, read_fault
from hillsphere.runs.resume_choices import ResumeChoices, choose, read_local
from hillsphere.runs.run_differences import differences
from hillsphere.runs.run_manifest import MANIFEST, parse_time, read_manifest
from hillsphere.runs.run_record import RunRecord
from hillsphere.runs.stage_cache import file_digest
from hillsphere.runs.store import RunDirectory, plain_json

__all__ = ["EarlierRun"]

_LISTED = 20
"""Differences that a message lists; further ones are counted."""


@dataclass(frozen=True)
class EarlierRun:
    """The directory of an ended or a still active run.

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
        """Read the manifest of a run directory.

        Raises
        ------
        InputError
            If it is not a run directory, this version cannot read it, or it holds links, FIFOs or
            devices, which a run does not make and which could redirect reading and writing.
        """
        place = Path(path)
        try:
            if not place.is_dir():
                missing = "it is a file" if place.exists() else "there is no such directory"
            elif not (place / MANIFEST).exists():
                missing = f"it holds no {MANIFEST}"
                if (place / "log.txt").is_file():
                    missing += "; the run ended before it kept anything"
            else:
                missing = ""
        except (OSError, ValueError) as error:  # ValueError: a NUL in the name
            missing = str(error)
        if missing:
            raise InputError(f"{str(path)!r} is no run directory: {missing}")
        directory = RunDirectory(place)
        directory.refuse_links()
        return cls(directory, read_manifest(place))

    @cached_property
    def local(self) -> Mapping[str, Any]:
        """Content of ``resume.json``; use `choices` for the part that may be trusted."""
        return read_local(self.directory.path)

    @property
    def state(self) -> str:
        """``"running"`` (or killed), ``"interrupted"``, ``"failed"`` or ``"finished"``."""
        return str(self.manifest.get("state"))

    def choices(
        self, given: ResumeChoices, command: tuple[str, ...], *, needs_executor: bool = True
    ) -> ResumeChoices:
        """Return the choices for a continuation: see `hillsphere.runs.resume_choices.choose`.

        Parameters
        ----------
        given : ResumeChoices
            Choices of the caller.
        command : tuple of str
            Words after ``hillsphere``, without the run directory: ``("resume",)``.
        needs_executor : bool
            Whether the command uses the executor of the run.
        """
        path = str(self.directory.path)
        name = f"./{path}" if path.startswith("-") else path
        words = ("hillsphere", command[0], name, *command[1:])
        settings = self.manifest.get("sets", ())
        return choose(self.local, given, words, settings, needs_executor=needs_executor)

    def mission(self, registry: Registry | None, choices: ResumeChoices) -> Mission:
        """Load the mission as it is now, with the profile and settings of the run.

        Parameters
        ----------
        registry : Registry, optional
            Components to choose from.
        choices : ResumeChoices
            Result of `choices`: the mission, and whether it may read files elsewhere.

        Raises
        ------
        InputError
            If its file no longer exists or is no longer valid.
        """
        assert choices.mission is not None
        return load_mission(
            choices.mission,
            sets=tuple(self.manifest.get("sets", ())),
            profile=self.manifest.get("profile"),
            registry=registry,
            allow_path=choices.allow_path,
        )

    def continue_in(self, record: RunRecord) -> None:
        """Copy the facts of this run into the record of its continuation.

        Parameters
        ----------
        record : RunRecord
            Record of the mission in its present state.

        Raises
        ------
        InputError
            See `refuse_changes`.
        """
        self.refuse_changes(record)
        record.resumed = [*map(parse_time, self.manifest.get("resumed_utc", [])), record.started]
        record.started = parse_time(self.manifest.get("started_utc"))
        for stage in record.stages.values():
            entry = self.manifest["stages"].get(stage.name, {})
            if stage.key is not None and entry.get("product") and entry.get("key") == stage.key:
                stage.state = "done"
                stage.product = entry["product"]
                stage.cached = bool(entry.get("cached"))
                stage.seconds = float(entry.get("seconds", 0.0))

    def refuse_changes(self, record: RunRecord) -> None:
        """Refuse a continuation if a fact that the results depend on has changed.

        Parameters
        ----------
        record : RunRecord
            Record of the mission in its present state.

        Raises
        ------
        InputError
            If there is a difference; the message lists the differences.
        """
        changes = differences(self.manifest, plain_json(record.manifest("running")))
        if not changes:
            return
        listed = changes[:_LISTED]
        if len(changes) > _LISTED:
            listed.append(f"and {len(changes) - _LISTED} more")
        raise InputError(
            "\n  ".join(
                [
                    f"run {str(self.directory.path)!r} cannot be continued: facts that its results "
                    "depend on have changed (then -> now):",
                    *listed,
                ]
            )
            + f"\nundo that, or begin a new run: {record.command()}"
        )

    def has_its_products(self) -> bool:
        """Return whether the files of all products are those that the run wrote.

        Raises
        ------
        StageError
            If reading fails for another reason than a missing or changed file.
        """
        try:
            for stage, entry in self.manifest["stages"].items():
                if entry.get("product"):
                    self._checked(stage)
        except InputError:
            return False
        return True

    def _checked(self, stage: str) -> Path:
        """Return the file of a product; refuse one that the run did not write."""
        path = self.directory.path / f"{stage}.npz"
        try:
            digest = file_digest(path, follow_links=False)
        except InputError as error:
            if isinstance(error.__cause__, OSError):
                raise read_fault(path, error.__cause__) from error
            raise
        if digest != self.manifest["stages"].get(stage, {}).get("product"):
            raise InputError(
                f"{path}: is not the file that the run wrote; it is damaged or was replaced: "
                "restore it, or run the mission again"
            )
        return path

    def product(self, stage: str, expected: type) -> Any:
        """Return the stored product of a stage.

        Parameters
        ----------
        stage : str
            Its name.
        expected : type
            Class of its product.

        Raises
        ------
        InputError
            If the file is missing or not the one that the run wrote.
        StageError
            If reading fails for another reason.
        """
        path = self._checked(stage)
        product = load_product(path)
        if not isinstance(product, expected):
            raise InputError(f"{path.name}: holds a {type(product).__name__}")
        return product
