"""The run directory with all files of a run, each of which is complete or absent.

::

    manifest.json        what was run, with what, when, how it ended
    summary.json         verdict, metrics, tables, failures
    <stage>.npz          the product of a stage
    <stage>.columns/     the columns of a large campaign, in files of a few thousand cases
    tables/<id>.csv      figures/<id>.svg, with --figures also figures/<id>.png
    files/<stage>/       what a stage writes for other programs (ephemerides)
    cases/               single cases that were repeated with their histories
    report.html          everything on one page
    log.txt              what the stages said; tracebacks of failures
    work/<stage>/        what a stage keeps until it is done, for a run that is resumed
    resume.json          where the mission is, and how it was run: all that belongs to this machine
"""

from __future__ import annotations

import csv
import errno
import json
import math
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, date, datetime
from io import StringIO
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np

from hillsphere.base.atomic import PART_SUFFIX, write_bytes, write_text
from hillsphere.base.errors import InputError, StageError
from hillsphere.base.regular_files import check_regular
from hillsphere.products.product_codec import save_product
from hillsphere.runs.stage_cache import file_digest
from hillsphere.show.presentation import Printed, Table

if sys.platform != "win32":
    import fcntl

__all__ = ["RunDirectory", "csv_text", "plain_json"]

T = TypeVar("T")

_held: set[BinaryIO] = set()
"""Open files whose locks mark the runs of this process."""


def _leave_locks_to_parent() -> None:
    """Close the locked files in a forked child, so that the locks end with their parent.

    Otherwise children of a plugin that outlive a killed run would keep it from being resumed.
    """
    while _held:
        _held.pop().close()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_locks_to_parent)


class RunDirectory:
    """A directory that belongs to one run.

    Parameters
    ----------
    path : Path
        An existing directory; `RunDirectory.create` makes one for a new run.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @staticmethod
    def check(out: str | Path | None) -> None:
        """Refuse a directory that `create` would refuse, before any work is done.

        Raises
        ------
        InputError
            If `out` exists and is not an empty directory.
        """
        if out is None:
            return
        place = Path(out)
        try:
            is_directory, is_other = place.is_dir(), place.exists() or place.is_symlink()
            is_full = is_directory and next(place.iterdir(), None) is not None
        except OSError as error:
            raise _unusable(out, error) from error
        if is_full:
            raise InputError(
                f"output directory {str(out)!r} is not empty; name one that is empty or does not "
                "exist"
            )
        if is_other and not is_directory:
            what = "is a link that leads nowhere"
            with suppress(OSError):  # leads nowhere, or in a circle
                mode = place.stat().st_mode
                what = "is a file" if stat.S_ISREG(mode) else "is a device or a FIFO"
            raise InputError(f"output directory {str(out)!r} {what}; name a directory")

    @classmethod
    def create(cls, out: str | Path | None, mission: str, started: datetime) -> RunDirectory:
        """Make the directory of a run.

        Parameters
        ----------
        out : str or Path or None
            The directory, empty or absent; ``None`` makes ``runs/<mission>-<UTC>-<8 hex>`` in the
            working directory.
        mission : str
            Name of the mission.
        started : datetime
            Start of the run, UTC.

        Returns
        -------
        RunDirectory
            The directory.

        Raises
        ------
        InputError
            If it cannot be made or is not empty.
        """
        cls.check(out)
        stamp = started.astimezone(UTC).strftime("%Y%m%dT%H%M%SZ")
        path = (
            Path("runs") / f"{mission}-{stamp}-{secrets.token_hex(4)}" if out is None else Path(out)
        )
        try:
            path.mkdir(parents=True, exist_ok=out is not None)
            # The first file: a directory that cannot be written to is found here, not after hours.
            (path / "log.txt").touch(exist_ok=False)
        except (OSError, ValueError) as error:  # ValueError: a NUL in the name
            raise _unusable(path, error) from error
        return cls(path)

    def refuse_links(self) -> None:
        """Refuse a directory with entries other than regular files and directories.

        A run makes no others. Through a link, files elsewhere would be read, written or removed; a
        FIFO would block.

        Raises
        ------
        InputError
            If there is such an entry, which the message names, or the directory cannot be read.
        """
        waiting = [self.path]
        try:
            while waiting:
                # What is not there any more was removed by a run that goes on.
                with suppress(FileNotFoundError), os.scandir(waiting.pop()) as entries:
                    for entry in entries:
                        if entry.is_dir(follow_symlinks=False):
                            waiting.append(Path(entry.path))
                            continue
                        with suppress(FileNotFoundError):
                            check_regular(entry.stat(follow_symlinks=False), entry.path)
        except OSError as error:
            raise InputError(
                f"run directory {str(self.path)!r} cannot be used: {error.filename}: "
                f"{error.strerror}; remove it, if it is not yours"
            ) from error

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Lock the run directory against other processes within the block.

        Raises
        ------
        InputError
            If another process holds it, or the directory cannot be written to.

        Notes
        -----
        The operating system's lock on ``log.txt`` is used, which ends with the process in any case.
        On a file system without locks there is none.
        """
        try:
            log = self._open_log()
        except OSError as error:
            raise _unusable(self.path, error) from error
        with log:
            try:
                if sys.platform != "win32":
                    fcntl.flock(log, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(
                    f"run {str(self.path)!r} is still going on in another process; wait for it, or "
                    "interrupt it first"
                ) from None
            except OSError:  # no locks here, as on some network file systems
                pass
            _held.add(log)
            try:
                yield
            finally:
                _held.discard(log)

    def workspace(self, stage: str) -> Path:
        """Return the directory ``work/<stage>``, which is made if necessary.

        Raises
        ------
        StageError
            If it cannot be made.
        """
        path = self.path / "work" / stage
        try:
            path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise self._full(f"work/{stage}", error) from error
        return path

    def clear_workspace(self, stage: str) -> None:
        """Remove ``work/<stage>`` with its content; ignore entries that cannot be removed."""
        shutil.rmtree(self.path / "work" / stage, ignore_errors=True)
        with suppress(OSError):  # another stage's may be there still
            (self.path / "work").rmdir()

    def clear_parts(self) -> None:
        """Remove temporary files of a killed run, except in ``cases/``: repeats may write there."""
        for part in self.path.rglob(f".*{PART_SUFFIX}"):
            if part.relative_to(self.path).parts[0] != "cases":
                with suppress(OSError):
                    part.unlink()

    def log(self, line: str) -> None:
        """Add a line to ``log.txt``."""
        data = (line.rstrip("\n") + "\n").encode("utf-8", "backslashreplace")
        try:
            with self._open_log() as log:
                log.write(data)
        except OSError as error:
            raise self._full("log.txt", error) from error

    def _open_log(self) -> BinaryIO:
        """Open ``log.txt`` for appending: the only file that is not written atomically."""
        path = self.path / "log.txt"
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_CLOEXEC", 0)
        # Neither to another file through a link, nor waiting for the reader of a FIFO.
        flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
        descriptor = os.open(path, flags, 0o666)
        try:
            status = os.fstat(descriptor)
            check_regular(status, str(path))
            if status.st_nlink > 1:
                raise OSError(
                    errno.EMLINK, "log.txt is also another file (a hard link); make a copy of it"
                )
        except BaseException:
            os.close(descriptor)
            raise
        return os.fdopen(descriptor, "ab")  # outside the block, as in `open_regular`

    def put_product(self, name: str, product: Any) -> str:
        """Write a product, a stage's by its name, to ``<name>.npz``; return the file's SHA-256."""
        self._write(f"{name}.npz", lambda path: save_product(path, product))
        return file_digest(self.path / f"{name}.npz")

    def put_table(self, name: str, table: Table) -> None:
        """Write a table to ``tables/<name>.csv``."""
        self._write(f"tables/{name}.csv", lambda path: write_text(path, csv_text(table)))

    def put_svg(self, name: str, svg: bytes, folder: str = "figures") -> Path:
        """Write a figure to ``figures/<name>.svg``, or to another folder; return the file."""
        return self._write(f"{folder}/{name}.svg", lambda path: write_bytes(path, svg))

    def put_png(self, name: str, png: bytes, folder: str = "figures") -> Path:
        """Write a figure to ``figures/<name>.png``, or to another folder; return the file."""
        return self._write(f"{folder}/{name}.png", lambda path: write_bytes(path, png))

    def put_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a JSON file; see `plain_json` for the conversion of values."""
        text = json.dumps(plain_json(content), indent=2, ensure_ascii=False, allow_nan=False)
        self._write(name, lambda path: write_text(path, text + "\n"))

    def put_text(self, name: str, text: str) -> None:
        """Write a text file."""
        self.put_file(name, text)

    def put_file(self, name: str, content: str | bytes) -> None:
        """Write a file: text as UTF-8, bytes as they are."""

        def write(path: Path) -> None:
            if isinstance(content, str):
                write_text(path, content)
            else:
                write_bytes(path, content)

        self._write(name, write)

    def _write(self, name: str, write: Callable[[Path], None]) -> Path:
        path = self.path / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path)
        except OSError as error:
            raise self._full(name, error) from error
        return path

    def _full(self, name: str, error: OSError) -> StageError:
        return StageError(
            f"{name} cannot be written to {str(self.path)!r}: {error.strerror or error}; free "
            "space there and resume the run, or give another place with --out"
        )


def csv_text(table: Table) -> str:
    """Return a table as CSV: a line of column names, then the rows with every digit.

    An empty cell is a missing value; a `Printed` number is written as printed.
    """
    stream = StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    names = [column.name for column in table.columns]
    writer.writerow(names)
    for row in table.rows:
        writer.writerow([_csv_cell(row.get(name)) for name in names])
    return stream.getvalue()


def _csv_cell(value: Any) -> Any:
    if isinstance(value, Printed):
        return value.text
    plain = value.item() if isinstance(value, np.generic) else value
    # repr of a float is its shortest exact form; csv would write the same, numpy scalars not.
    return repr(plain) if isinstance(plain, float) else plain


def plain_json(value: Any) -> Any:
    """Convert a value to JSON types: nan becomes null, an infinity a text, arrays become lists.

    Parameters
    ----------
    value : object
        Mappings, sequences, sets of names, arrays, numbers (numpy's too), strings, times, ``None``.

    Returns
    -------
    object
        Consists of dict, list, str, int, float, bool and ``None``. JSON has no infinity, which is
        ``"inf"`` or ``"-inf"``.

    Raises
    ------
    InputError
        If the value holds anything else.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        if math.isinf(value):
            return str(value)
        return None if math.isnan(value) else float(value)
    if isinstance(value, Mapping):
        return {str(key): plain_json(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return plain_json(value.tolist())
    if isinstance(value, list | tuple):
        return [plain_json(item) for item in value]
    if isinstance(value, date):
        return value.isoformat()
    raise InputError(f"a {type(value).__name__} cannot stand in a JSON file: {value!r}")


def _unusable(path: str | Path, error: OSError | ValueError) -> InputError:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else error
    return InputError(
        f"run directory {str(path)!r} cannot be used: {reason}; choose another with --out"
    )
