"""The runs in the given folders, found by listing them: no name of a request becomes a path."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from hillsphere.base.errors import InputError
from hillsphere.base.regular_files import check_regular, read_bytes
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere.runs.run_summary import RunSummary

if sys.platform != "win32":
    import fcntl

__all__ = ["ListedRun", "MissingError", "RunFolders", "ServedRun"]

_TAIL_BYTES = 4096
"""End of a log that is shown: some 40 lines."""
_DEFAULT = Path("runs")
"""Where ``hillsphere run`` puts runs; it need not exist yet."""


class MissingError(InputError):
    """There is no such page, run, file or case."""


@dataclass(frozen=True)
class ListedRun:
    """A run in the list.

    Parameters
    ----------
    key : str
        ``"0/name"``: index of its folder and name of its directory.
    name, mission, profile, started, state, verdict : str
        What the list shows. The state is ``"running"`` only if a process holds the run's lock.
    """

    key: str
    name: str
    mission: str
    profile: str
    started: str
    state: str
    verdict: str

    @property
    def url(self) -> str:
        """Return the path of its page."""
        return f"/runs/{quote(self.key)}"

    def has_text(self, text: str) -> bool:
        """Return whether all words of a text occur in what the list shows."""
        shown = " ".join(
            (self.name, self.mission, self.profile, self.started, self.state, self.verdict)
        ).casefold()
        return all(word in shown for word in text.casefold().split())


@dataclass(frozen=True)
class ServedRun:
    """A run directory that was found in its folder.

    Parameters
    ----------
    key : str
        As of `ListedRun`.
    path : Path
        The directory.
    """

    key: str
    path: Path

    @property
    def url(self) -> str:
        """Return the path of its page."""
        return f"/runs/{quote(self.key)}"

    def open(self) -> EarlierRun:
        """Read the manifest; `MissingError` if there is none, or the directory holds links."""
        try:
            return EarlierRun.open(self.path)
        except InputError as error:
            raise MissingError(str(error)) from error

    def summary(self) -> RunSummary:
        """Read manifest and summary, which must have the form that a run writes."""
        return RunSummary.read(self.path)

    def state(self, manifest: Mapping[str, Any]) -> str:
        """Return the state; a run whose process has ended without a word is interrupted."""
        state = str(manifest.get("state", ""))
        return "interrupted" if state == "running" and not self.is_locked() else state

    def is_locked(self) -> bool:
        """Return whether a process is writing to the run.

        The shared lock is held for some microseconds. A run that another process resumes in just
        these finds its directory locked; nothing is lost by that.
        """
        flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
        try:
            log = os.open(self.path / "log.txt", flags)
        except OSError:
            return False
        try:
            check_regular(os.fstat(log), "log.txt")
            fcntl.flock(log, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            return False
        finally:
            os.close(log)
        return False

    def log_end(self) -> str:
        """Return the last lines of ``log.txt``; ``""`` if it cannot be read."""
        try:
            with open(os.open(self.path / "log.txt", os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK),
                      "rb") as log:  # fmt: skip
                check_regular(os.fstat(log.fileno()), "log.txt")
                size = log.seek(0, os.SEEK_END)
                log.seek(max(0, size - _TAIL_BYTES))
                text = log.read(_TAIL_BYTES).decode("utf-8", "replace")
        except OSError:
            return ""
        return text if size <= _TAIL_BYTES else text.partition("\n")[2]

    def file(self, *parts: str, max_bytes: int) -> bytes:
        """Return a file of the run, found by listing one directory after the other.

        Raises
        ------
        MissingError
            If there is no such regular file.
        """
        place = self.path
        try:
            for index, part in enumerate(parts):
                with os.scandir(place) as entries:
                    entry = next((entry for entry in entries if entry.name == part), None)
                is_last = index == len(parts) - 1
                if entry is None or not (
                    entry.is_file(follow_symlinks=False)
                    if is_last
                    else entry.is_dir(follow_symlinks=False)
                ):
                    raise MissingError(f"run {self.path.name!r} has no {'/'.join(parts)}")
                place = Path(entry.path)
            if os.path.realpath(place) != str(place):  # the place is absolute and without links
                raise MissingError(f"run {self.path.name!r} has no {'/'.join(parts)}")
            return read_bytes(place, max_bytes, follow_links=False)
        except OSError as error:
            raise MissingError(
                f"{'/'.join(parts)} cannot be read: {error.strerror or error}"
            ) from error

    def names(self, folder: str, suffix: str) -> list[str]:
        """Return the names of the files of a kind in a folder of the run, without the suffix."""
        try:
            with os.scandir(self.path / folder) as entries:
                names = [
                    entry.name.removesuffix(suffix)
                    for entry in entries
                    if entry.name.endswith(suffix) and entry.is_file(follow_symlinks=False)
                ]
        except OSError:
            return []
        return sorted(filter(_is_shown, names))


class RunFolders:
    """Folders whose direct child directories are runs.

    Parameters
    ----------
    folders : sequence of Path or None
        Folders that must exist; without any ``runs``, which need not.

    Raises
    ------
    InputError
        If a given folder does not exist.
    """

    def __init__(self, folders: Sequence[Path] | None) -> None:
        for folder in folders or ():
            if not folder.is_dir():
                raise InputError(f"{str(folder)!r} is no folder of runs")
        self.paths = [Path(os.path.realpath(folder)) for folder in folders or [_DEFAULT]]
        self._rows: dict[str, tuple[Any, ListedRun | None]] = {}

    def find(self, folder: str, name: str) -> ServedRun:
        """Return a run.

        Parameters
        ----------
        folder, name : str
            Index of the folder, and name of the directory, both as a request has them.

        Raises
        ------
        MissingError
            If there is no such directory, or it is a link.
        """
        for index, path in enumerate(self.paths):
            if folder != str(index) or name not in self._names(path):
                continue
            # A listed name leads nowhere else, unless the directory has become a link since.
            if os.path.realpath(path / name) == str(path / name):
                return ServedRun(f"{index}/{name}", path / name)
        raise MissingError("there is no such run")

    def runs(self) -> list[ListedRun]:
        """Return all runs, the latest first."""
        keys = [(f"{index}/{name}", path / name)
                for index, path in enumerate(self.paths) for name in self._names(path)]  # fmt: skip
        self._rows = {key: row for key, row in self._rows.items() if key in dict(keys)}
        rows = [row for key, path in keys if (row := self._row(ServedRun(key, path))) is not None]
        return sorted(rows, key=lambda row: (row.started, row.name), reverse=True)

    def _names(self, folder: Path) -> list[str]:
        try:
            with os.scandir(folder) as entries:
                return [e.name for e in entries
                        if e.is_dir(follow_symlinks=False) and _is_shown(e.name)]  # fmt: skip
        except OSError:
            return []

    def _row(self, run: ServedRun) -> ListedRun | None:
        """Return the row of a run, read anew if its files have changed; None if it is no run."""
        stamp = [_stamp(run.path / name) for name in ("manifest.json", "summary.json")]
        then, row = self._rows.get(run.key, (None, None))
        if then != stamp or (row is not None and row.state == "running"):
            row = _read_row(run) if stamp[0] is not None else None
            self._rows[run.key] = (stamp, row)
        return row


def _read_row(run: ServedRun) -> ListedRun | None:
    try:
        manifest = run.open().manifest
    except InputError:
        return None
    try:
        verdict = str(run.summary().summary["verdict"]["text"])
    except InputError:
        verdict = ""
    mission = str(manifest["mission"].get("name", ""))
    return ListedRun(
        run.key, run.path.name, mission, manifest.get("profile") or "",
        str(manifest.get("started_utc", "")), run.state(manifest), verdict,
    )  # fmt: skip


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        status = path.lstat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size


def _is_shown(name: str) -> bool:
    """Return whether a name of a file can stand in an address: not one of undecodable bytes."""
    return name.isprintable() and not name.startswith(".")
