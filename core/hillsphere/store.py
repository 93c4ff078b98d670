"""The run directory: what a mission leaves behind, every file complete or absent.

::

    manifest.json        what was run, with what, when, how it ended
    summary.json         verdict, metrics, tables, failures
    <stage>.npz          the product of a stage
    tables/<id>.csv      figures/<id>.svg  figures/<id>.png
    files/<stage>/       what a stage writes for other programs (ephemerides)
    report.html          everything on one page
    log.txt              what the stages said; tracebacks of failures
"""

from __future__ import annotations

import csv
import json
import math
import secrets
from collections.abc import Callable, Mapping
from datetime import UTC, date, datetime
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from hillsphere.atomic import write_bytes, write_text
from hillsphere.drawing import Drawing
from hillsphere.errors import InputError, StageError
from hillsphere.presentation import Printed, Table
from hillsphere.product_codec import save_product

__all__ = ["RunDirectory", "csv_text", "plain_json"]

T = TypeVar("T")


class RunDirectory:
    """A directory that belongs to one run.

    Parameters
    ----------
    path : Path
        An existing, empty directory; use `RunDirectory.create`.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    @staticmethod
    def check(out: str | Path | None) -> None:
        """Refuse a directory that `create` would refuse, before any work is done.

        Raises
        ------
        InputError
            If `out` is there and is not an empty directory.
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
            raise InputError(f"output directory {str(out)!r} is a file; name a directory")

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

    def log(self, line: str) -> None:
        """Add a line to ``log.txt``."""
        data = (line.rstrip("\n") + "\n").encode("utf-8", "backslashreplace")
        try:
            with (self.path / "log.txt").open("ab") as log:
                log.write(data)
        except OSError as error:
            raise self._full("log.txt", error) from error

    def put_product(self, stage: str, product: Any) -> None:
        """Write a stage's product to ``<stage>.npz``."""
        self._write(f"{stage}.npz", lambda path: save_product(path, product))

    def put_table(self, name: str, table: Table) -> None:
        """Write a table to ``tables/<name>.csv``."""
        self._write(f"tables/{name}.csv", lambda path: write_text(path, csv_text(table)))

    def put_drawing(self, name: str, drawing: Drawing) -> None:
        """Write a figure to ``figures/<name>.svg`` and ``.png``."""
        self._write(f"figures/{name}.svg", lambda path: write_bytes(path, drawing.svg))
        self._write(f"figures/{name}.png", lambda path: write_bytes(path, drawing.png))

    def put_json(self, name: str, content: Mapping[str, Any]) -> None:
        """Write a JSON file; see `plain_json` for what becomes of numbers."""
        text = json.dumps(plain_json(content), indent=2, ensure_ascii=False, allow_nan=False)
        self._write(name, lambda path: write_text(path, text + "\n"))

    def put_text(self, name: str, text: str) -> None:
        """Write a text file."""
        self._write(name, lambda path: write_text(path, text))

    def _write(self, name: str, write: Callable[[Path], None]) -> None:
        path = self.path / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path)
        except OSError as error:
            raise self._full(name, error) from error

    def _full(self, name: str, error: OSError) -> StageError:
        return StageError(
            f"{name} cannot be written to {str(self.path)!r}: {error.strerror or error}; free "
            "space there or give another place with --out"
        )


def csv_text(table: Table) -> str:
    """Return a table as CSV: a line of column names, then the rows with every digit.

    An empty cell is a value that is not there; a `Printed` number stands as printed.
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
    """Return a value as JSON knows it: nan and infinities become null, arrays lists.

    Parameters
    ----------
    value : object
        Mappings, sequences, sets of names, arrays, numbers (numpy's too), strings, times, ``None``.

    Returns
    -------
    object
        Nothing but dict, list, str, int, float, bool and ``None``.

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
        return float(value) if math.isfinite(value) else None
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
