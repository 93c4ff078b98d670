"""Pass log: table of the measured, commanded and predicted angles of a tracked pass.

The CSV file has one line per measurement or command, in order of time, in degrees (shortened; while
the pass lasts, in the order in which they happen)::

    utc,azimuth_deg,elevation_deg,sigma_deg,locked,commanded_…,commanded_…,predicted_…,predicted_…
    2027-06-01T12:30:00.000000,284.031369,5.048786,0.05,1,284.03,5.05,284.03,5.05
    2027-06-01T12:30:01.000000,,,,0,284.05,5.07,284.05,5.07

Missing values are empty: angles without lock, commands of a station that only receives.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from math import inf, isfinite, nan
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.atomic import write_text
from hillsphere.base.regular_files import read_text
from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch

__all__ = ["PassLog", "header_line", "log_lines", "read_pass_log", "write_pass_log"]

_COLUMNS = (
    "utc", "azimuth_deg", "elevation_deg", "sigma_deg", "locked", "commanded_azimuth_deg",
    "commanded_elevation_deg", "predicted_azimuth_deg", "predicted_elevation_deg",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class PassLog:
    """Log of a tracked pass.

    Parameters
    ----------
    epoch : Epoch
        Origin of the times, UTC.
    times_s : ndarray, shape (K,)
        Times in increasing order.
    azimuth_rad, elevation_rad, sigma_rad : ndarray, shape (K,)
        Measured angles and their standard deviation; finite wherever `locked` is true, else NaN if
        nothing was measured.
    locked : ndarray of bool, shape (K,)
        Whether the receiver had the signal.
    commanded_azimuth_rad, commanded_elevation_rad : ndarray, shape (K,)
        Commanded direction of the beam; NaN if unknown.
    predicted_azimuth_rad, predicted_elevation_rad : ndarray, shape (K,)
        Predicted direction of the satellite; NaN if unknown.

    Raises
    ------
    InputError
        If the shapes differ, times do not increase, or a measurement with lock is not finite.
    """

    epoch: Epoch
    times_s: Array
    azimuth_rad: Array
    elevation_rad: Array
    sigma_rad: Array
    locked: NDArray[np.bool_]
    commanded_azimuth_rad: Array
    commanded_elevation_rad: Array
    predicted_azimuth_rad: Array
    predicted_elevation_rad: Array

    def __post_init__(self) -> None:
        columns = (
            self.times_s, self.azimuth_rad, self.elevation_rad, self.sigma_rad, self.locked,
            self.commanded_azimuth_rad, self.commanded_elevation_rad,
            self.predicted_azimuth_rad, self.predicted_elevation_rad,
        )  # fmt: skip
        shapes = {np.shape(column) for column in columns}
        if len(shapes) != 1 or np.ndim(self.times_s) != 1:
            raise InputError(
                f"the columns of a pass log must have the same shape (K,), got {sorted(shapes)}"
            )
        if not (np.isfinite(self.times_s).all() and np.all(np.diff(self.times_s) > 0.0)):
            raise InputError("the times of a pass log must be finite and increase")
        tracked = np.array([self.azimuth_rad, self.elevation_rad, self.sigma_rad])[:, self.locked]
        if not (np.isfinite(tracked).all() and np.all(tracked[2] > 0.0)):
            raise InputError(
                "a pass log needs finite angles and a standard deviation > 0 wherever it was locked"
            )


def write_pass_log(path: Path, log: PassLog) -> None:
    """Write a pass log; the file appears complete or not at all.

    Parameters
    ----------
    path : Path
        The file, in an existing directory.
    log : PassLog
        The log; times are written to 1 µs, angles to 1e-9°.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    write_text(path, header_line() + log_lines(log), follow_links=True)


def header_line() -> str:
    """Return the first line of a pass log."""
    return ",".join(_COLUMNS) + "\n"


def log_lines(log: PassLog) -> str:
    """Return the lines of a pass log below its header, times to 1 µs and angles to 1e-9°."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for i, utc in enumerate(log.epoch.to("UTC").isot(log.times_s, 6)):
        writer.writerow(
            [
                utc,
                _cell(log.azimuth_rad[i]),
                _cell(log.elevation_rad[i]),
                _cell(log.sigma_rad[i]),
                int(log.locked[i]),
                _cell(log.commanded_azimuth_rad[i]),
                _cell(log.commanded_elevation_rad[i]),
                _cell(log.predicted_azimuth_rad[i]),
                _cell(log.predicted_elevation_rad[i]),
            ]
        )
    return text.getvalue()


def read_pass_log(path: Path) -> PassLog:
    """Read a pass log, also one that was not finished.

    While a pass lasts, measurements and commands are written as they happen: each kind is in order
    of time, and a measurement may stand below the command of a later time. What was written last
    may be a part of a line, which is left out.

    Parameters
    ----------
    path : Path
        File written by `write_pass_log`.

    Returns
    -------
    PassLog
        Log whose epoch is the time of the first line.

    Raises
    ------
    InputError
        If the file cannot be read, or a line is invalid; the message names file and line.
    """
    try:
        text = read_text(path)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"the pass log {path} cannot be read: {error}") from None
    try:
        # the last line of a file that was cut off has no end
        whole = text[: text.rfind("\n") + 1] if "\n" in text else text
        lines = list(csv.reader(whole.splitlines()))
    except csv.Error as error:
        raise InputError(f"{path}: not the CSV table of a pass log: {error}") from None
    if not lines or tuple(lines[0]) != _COLUMNS:
        raise InputError(f"{path}:1: a pass log begins with the line {','.join(_COLUMNS)}")
    if len(lines) < 2:
        raise InputError(f"{path}: the pass log has no measurements")
    epochs: list[Epoch] = []
    rows: list[list[float]] = []
    latest = {True: -inf, False: -inf}
    for number, cells in enumerate(lines[1:], start=2):
        where = f"{path}:{number}"
        if len(cells) != len(_COLUMNS):
            raise InputError(f"{where}: expected {len(_COLUMNS)} values, got {len(cells)}")
        try:
            epochs.append(Epoch.parse(cells[0], "UTC"))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        row = [epochs[-1].seconds_since(epochs[0]), *_numbers(cells, where)]
        measured, commanded = _kinds(row)
        for kind in {measured, not commanded}:
            if row[0] <= latest[kind]:
                what = "measurement" if kind else "command"
                raise InputError(
                    f"{where}: {cells[0]} is not after the {what} before it; sort the log"
                )
            latest[kind] = row[0]
        rows.append(row)
    columns = np.array(_join_rows(rows)).T
    first = int(np.argmin([row[0] for row in rows]))
    columns[0] -= columns[0, 0]
    azimuth, elevation, sigma = np.radians(columns[1:4])
    pointed = np.radians(columns[5:])
    return PassLog(
        epochs[first], columns[0], azimuth, elevation, sigma, columns[4] == 1.0,
        pointed[0], pointed[1], pointed[2], pointed[3],
    )  # fmt: skip


def _kinds(row: list[float]) -> tuple[bool, bool]:
    """Return whether a row has a measurement, and a command; one without either is the former."""
    commanded = any(isfinite(value) for value in row[5:])
    return row[4] == 1.0 or isfinite(row[1]) or not commanded, commanded


def _join_rows(rows: list[list[float]]) -> list[list[float]]:
    """Return the rows in order of time, a measurement and a command of one time in one."""
    joined: list[list[float]] = []
    for row in sorted(rows, key=lambda row: row[0]):
        if joined and row[0] == joined[-1][0]:
            measured, other = (row, joined[-1]) if _kinds(row)[0] else (joined[-1], row)
            joined[-1] = [*measured[:5], *other[5:]]
        else:
            joined.append(row)
    return joined


def _numbers(cells: list[str], where: str) -> list[float]:
    if cells[4] not in ("0", "1"):
        raise InputError(f"{where}: locked must be 0 or 1, got {cells[4]!r}")
    values = []
    for name, cell in zip(_COLUMNS[1:], cells[1:], strict=True):
        try:
            value = float(cell) if cell.strip() else nan
        except ValueError:
            raise InputError(f"{where}: {name} must be a number, got {cell!r}") from None
        if value in (inf, -inf) or (cell.strip() and not isfinite(value)):
            raise InputError(f"{where}: {name} must be finite, got {cell!r}")
        values.append(value)
    if cells[4] == "1":
        if not all(isfinite(value) for value in values[:3]):
            raise InputError(f"{where}: locked, but an angle or its standard deviation is missing")
        if not values[2] > 0.0:
            raise InputError(f"{where}: sigma_deg must be > 0, got {cells[3]!r}")
    return values


def _cell(angle_rad: float) -> str:
    return f"{np.degrees(angle_rad):.9f}" if np.isfinite(angle_rad) else ""
