"""Logbook of a session: collects measurements and commands for a pass log."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from hillsphere.errors import InputError
from hillsphere.interfaces import Array
from hillsphere.time import Epoch
from hillsphere_tracking.live.measurements import Measurement
from hillsphere_tracking.live.session import Command
from hillsphere_tracking.pointing.mounts import Mount
from hillsphere_tracking.pointing.pass_log import PassLog, write_pass_log
from hillsphere_tracking.pointing.sky import angles_of

__all__ = ["Logbook"]

_TICKS_PER_S = 1e6
"""Ticks per second of a pass log, its resolution of 1 µs: a measurement and a command of the same
tick share a line."""


class Logbook:
    """Collects the measurements and commands of one session.

    Parameters
    ----------
    start : Epoch
        Origin of the times.
    mount : Mount
        Mount that receives the commands.
    sigma_rad : float
        Standard deviation of measurements without one.
    """

    def __init__(self, start: Epoch, mount: Mount, sigma_rad: float) -> None:
        self._start, self._mount, self._sigma = start, mount, sigma_rad
        self._measured: dict[int, tuple[float, float, float]] = {}
        self._commanded: dict[int, tuple[float, float, float, float]] = {}

    def note_measurement(self, t_s: float, measurement: Measurement) -> None:
        """Record a measurement that was used."""
        sigma = self._sigma if measurement.sigma_rad is None else measurement.sigma_rad
        self._measured[_tick(t_s)] = (measurement.azimuth_rad, measurement.elevation_rad, sigma)

    def note_command(self, command: Command) -> None:
        """Record a command with the prediction for its time."""
        self._commanded[_tick(command.t_s)] = command[1:5]

    def pass_log(self) -> PassLog | None:
        """Return the pass log of the session; None if nothing was recorded."""
        ticks = sorted(self._measured.keys() | self._commanded.keys())
        if not ticks:
            return None
        azimuth, elevation, sigma = _columns(self._measured, ticks, 3)
        primary, secondary, *predicted = _columns(self._commanded, ticks, 4)
        beam = angles_of(self._mount.direction(primary, secondary))
        return PassLog(
            self._start, np.array(ticks) / _TICKS_PER_S, azimuth, elevation, sigma,
            np.isfinite(azimuth), beam[0], beam[1], predicted[0], predicted[1],
        )  # fmt: skip

    def save(self, path: Path) -> None:
        """Write the pass log, unless it is empty.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        log = self.pass_log()
        if log is None:
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
