"""Targets of the commands of ``hillsphere track``: CSV on stdout, or a rotator."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack
from math import degrees, radians

import numpy as np

from hillsphere.cli.streams import say
from hillsphere.errors import InputError
from hillsphere.time import Epoch
from hillsphere_tracking.live.rotator import RotatorLink
from hillsphere_tracking.live.rotctl import PORT, Rotctl
from hillsphere_tracking.live.session import Command

__all__ = ["target_of"]


def target_of(
    stack: ExitStack, rotator: str, timeout_s: float, start: Epoch, axes: tuple[str, str]
) -> tuple[tuple[float, float] | None, Callable[[Command], None]]:
    """Return the position of the axes (rad, None if unknown) and a receiver of commands.

    Parameters
    ----------
    stack : ExitStack
        Stack that stops the rotator.
    rotator : str
        ``HOST`` or ``HOST:PORT`` of a rotctld; empty for a CSV table on stdout.
    timeout_s : float
        Longest wait for the connection and for each answer of the rotctld.
    start : Epoch
        Origin of the times.
    axes : tuple of two str
        Names of the axes.

    Raises
    ------
    InputError
        If the address is invalid.
    RotatorError
        If the rotator cannot be reached.
    """
    if not rotator:
        return None, _table(start, axes)
    host, colon, port = rotator.rpartition(":")
    if not colon:
        host, port = rotator, str(PORT)
    if not (host and port.isdigit() and 0 < int(port) < 65536):
        raise InputError(f"--rotator must be HOST or HOST:PORT, got {rotator!r}")
    link = RotatorLink(lambda: Rotctl(host, int(port), timeout_s), say)
    primary, secondary = link.start()
    stack.callback(link.end)
    return (radians(primary), radians(secondary)), lambda command: link.point(
        degrees(command.primary_rad), degrees(command.secondary_rad)
    )


def _table(start: Epoch, axes: tuple[str, str]) -> Callable[[Command], None]:
    first, second = axes
    sys.stdout.write(
        f"utc,{first}_deg,{second}_deg,predicted_azimuth_deg,predicted_elevation_deg,state\n"
    )

    def write(command: Command) -> None:
        when = start.isot(np.array([command.t_s]), 3)[0]
        cells = ",".join(f"{degrees(angle):.4f}" for angle in command[1:5])
        sys.stdout.write(f"{when},{cells},{command.state}\n")
        sys.stdout.flush()

    return write
