"""Logbook of a session: writes measurements and commands to a pass log as they happen."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TextIO

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_tracking.live.measurements import Measurement
from hillsphere_tracking.live.session import Command
from hillsphere_tracking.pointing.mounts import Mount
from hillsphere_tracking.pointing.pass_log import PassLog, header_line, log_lines, write_pass_log
from hillsphere_tracking.pointing.sky import angles_of

__all__ = ["Logbook"]

_TICKS_PER_S = 1e6
"""Ticks per second of a pass log, its resolution of 1 µs: a measurement and a command of the same
tick share a line."""


class Logbook:
    """Collects the measurements and commands of one session, and writes them as they happen.

    A session that is killed leaves what happened before, in the order in which it happened; `save`
    puts it in order of time at the end.

    Parameters
    ----------
    start : Epoch
        Origin of the times.
    mount : Mount
        Mount that receives the commands.
    sigma_rad : float
        Standard deviation of measurements without one.
    path : Path, optional
        File of the log, which begins anew with the first measurement or command; by default
        nothing is written.
    say : callable
        Receives a line if the file cannot be written. The pass goes on.
    """

    def __init__(
        self,
        start: Epoch,
        mount: Mount,
        sigma_rad: float,
        path: Path | None = None,
        say: Callable[[str], None] = print,
    ) -> None:
        self._start, self._mount, self._sigma = start, mount, sigma_rad
        self._path, self._say = path, say
        self._file: TextIO | None = None
        self._failed = path is None
        self._measured: dict[int, tuple[float, float, float]] = {}
        self._commanded: dict[int, tuple[float, float, float, float]] = {}

    def note_measurement(self, t_s: float, measurement: Measurement) -> None:
        """Record a measurement that was used."""
        sigma = self._sigma if measurement.sigma_rad is None else measurement.sigma_rad
        row = (measurement.azimuth_rad, measurement.elevation_rad, sigma)
        self._measured[_tick(t_s)] = row
        self._write({_tick(t_s): row}, {})

    def note_command(self, command: Command) -> None:
        """Record a command with the prediction for its time."""
        self._commanded[_tick(command.t_s)] = command[1:5]
        self._write({}, {_tick(command.t_s): command[1:5]})

    def pass_log(self) -> PassLog | None:
        """Return the pass log of the session; None if nothing was recorded."""
        if self._measured or self._commanded:
            return self._log_of(self._measured, self._commanded)
        return None

    def _log_of(
        self,
        measured: Mapping[int, tuple[float, ...]],
        commanded: Mapping[int, tuple[float, ...]],
    ) -> PassLog:
        ticks = sorted(measured.keys() | commanded.keys())
        azimuth, elevation, sigma = _columns(measured, ticks, 3)
        primary, secondary, *predicted = _columns(commanded, ticks, 4)
        beam = angles_of(self._mount.direction(primary, secondary))
        return PassLog(
            self._start, np.array(ticks) / _TICKS_PER_S, azimuth, elevation, sigma,
            np.isfinite(azimuth), beam[0], beam[1], predicted[0], predicted[1],
        )  # fmt: skip

    def _write(
        self,
        measured: Mapping[int, tuple[float, ...]],
        commanded: Mapping[int, tuple[float, ...]],
    ) -> None:
        if self._failed or self._path is None:
            return
        try:
            if self._file is None:
                self._file = self._path.open("w", encoding="utf-8", newline="")
                self._file.write(header_line())
            self._file.write(log_lines(self._log_of(measured, commanded)))
            # to the system with each line: what a kill of this process cannot undo
            self._file.flush()
        except OSError as error:
            self._failed = True
            self._say(f"the log {self._path} is not written any more: {error.strerror or error}")

    def save(self) -> None:
        """Write the pass log in order of time, unless it is empty.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        if self._file is not None:
            with suppress(OSError):  # a full disk, which writing the log anew tells
                self._file.close()
        log = self.pass_log()
        if log is None or (path := self._path) is None:
            return
        try:
            write_pass_log(path, log)
        except OSError as error:
            raise InputError(
                f"the log {path} cannot be written: {error.strerror or error}"
            ) from error


def _tick(t_s: float) -> int:
    return round(t_s * _TICKS_PER_S)


def _columns(rows: Mapping[int, tuple[float, ...]], ticks: list[int], width: int) -> Array:
    nothing = (np.nan,) * width
    return np.array([rows.get(tick, nothing) for tick in ticks]).T
