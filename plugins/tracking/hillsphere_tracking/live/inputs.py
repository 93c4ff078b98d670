"""Inputs of ``hillsphere track``: measurements with their clock, and the Earth's orientation."""

from __future__ import annotations

import os
import stat
import sys
import warnings
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np

from hillsphere.base.constants import DAY_S
from hillsphere.base.orientation import (
    ConstantOrientation,
    EarthOrientation,
    EarthOrientationWarning,
    OrientationTable,
)
from hillsphere.cli.streams import say
from hillsphere.errors import InputError
from hillsphere.time import Epoch
from hillsphere_tracking.live.clock import Clock, RealTime, Replay
from hillsphere_tracking.live.feed import Feed, LiveFeed, ReplayFeed
from hillsphere_tracking.live.measurements import measurements

__all__ = ["input_of", "orientation_of"]


def input_of(
    stack: ExitStack, source: str, epoch: Epoch | None, replay: bool, speed: float
) -> tuple[Feed, Clock]:
    """Return the feed of measurements and the clock of a session.

    Parameters
    ----------
    stack : ExitStack
        Stack that closes the source.
    source : str
        Name of a file, or ``-`` for stdin.
    epoch : Epoch or None
        Origin of times that are given in seconds.
    replay : bool
        Replay the times of the measurements instead of using real time.
    speed : float
        Speed of the replay.

    Raises
    ------
    InputError
        If the source cannot be read, or contains no measurements to replay.
    """
    if source == "-":
        descriptor, where = sys.stdin.fileno(), "stdin"
    else:
        try:
            descriptor, where = os.open(source, os.O_RDONLY), source
        except OSError as error:
            raise InputError(f"{source}: cannot be read: {error.strerror or error}") from error
        stack.callback(os.close, descriptor)
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise InputError(f"{source}: is a directory; a file or a pipe is needed")
    if not replay:
        arriving = LiveFeed(descriptor, where, epoch, say)
        stack.callback(arriving.close)
        return arriving, RealTime()
    lines = stack.enter_context(
        os.fdopen(descriptor, encoding="utf-8", errors="replace", closefd=False)
    )
    try:
        recorded = ReplayFeed(measurements(_read(lines), where, epoch), say)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    return recorded, Replay(recorded.first.epoch, speed)


def orientation_of(ut1_minus_utc_s: float | None, start: Epoch) -> EarthOrientation:
    """Return the Earth's orientation: the given UT1 − UTC, or the installed table.

    Beyond the end of the table its last values are held constant.
    """
    if ut1_minus_utc_s is not None:
        return ConstantOrientation(ut1_minus_utc_s)
    table = OrientationTable.installed()
    lapse = table.lapse(start, np.array([DAY_S]))
    if lapse is None:
        return table
    say(f"{lapse}, or --ut1-minus-utc")
    with warnings.catch_warnings():
        # one warning suffices, instead of one per command: hold the last values as constants
        warnings.simplefilter("ignore", EarthOrientationWarning)
        held = table.at(start, np.zeros(1))
    tai = start.to("TAI")
    tai_minus_utc = DAY_S * ((tai.day - start.day) + (tai.fraction - start.fraction))
    return ConstantOrientation(
        float(held.ut1_minus_tai_s[0]) + tai_minus_utc,
        float(held.x_pole_rad[0]),
        float(held.y_pole_rad[0]),
    )


def _read(lines: Iterator[str]) -> Iterator[str]:
    try:
        yield from lines
    except OSError as error:
        raise InputError(f"measurements cannot be read: {error.strerror or error}") from error
