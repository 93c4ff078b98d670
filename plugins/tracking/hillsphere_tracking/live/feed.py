"""Feeds of measurements: live from a stream, or from a record in a replay."""

from __future__ import annotations

import os
import queue
import select
import stat
import threading
from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from hillsphere.errors import InputError
from hillsphere.time import Epoch
from hillsphere_tracking.live.measurements import Measurement, measurements

__all__ = ["Feed", "LiveFeed", "ReplayFeed"]

_LONGEST_LINE = 65536
"""Bytes of a line at most: a stream without line ends must not fill the memory. One read takes as
much. What follows up to the next line end is passed over."""
_POLL_S = 0.2
"""Interval (s) in which a reader looks whether it shall end, or whether a file has grown: short to
an operator, rare to the processor."""
_JUMP_S = 60.0
"""A measurement so far (s) ahead of the one before, and not followed by another there, has a wrong
time. Passes have shorter gaps between measurements that are used."""
_DAY_S = 86400.0
"""No pass that is replayed pauses for a day (s): a time so far ahead is wrong even if others
follow it."""


class Feed(Protocol):
    """Sequence of measurements over time."""

    def until(self, start: Epoch, t_s: float) -> list[Measurement]:
        """Return the new measurements up to a time (s) after the start of the session."""
        ...

    def close(self) -> None:
        """Stop reading."""
        ...


class ReplayFeed:
    """Feed of recorded measurements, each released at its time.

    A measurement with a wrong time far ahead would delay all later ones. The feed therefore reads
    one measurement ahead; it reports and skips measurements whose time is far from both neighbours,
    and lines that cannot be read.

    Parameters
    ----------
    source : iterator of Measurement
        The record.
    say : callable
        Receives a line for each fault.

    Raises
    ------
    InputError
        If the record contains no measurements.
    """

    def __init__(self, source: Iterator[Measurement], say: Callable[[str], None]) -> None:
        self._source = source
        self._faults: list[InputError] = []
        self._say: Callable[[str], None] | None = None
        self._latest: Epoch | None = None
        self._astray = 0
        self._after = self._read()
        if self._after is None:
            first = f"{self._faults[0]}" if self._faults else "the input is empty"
            raise InputError(f"no measurements to replay: {first}")
        self._say = say
        for fault in self._faults:
            say(f"passed over: {fault}")
        first_measurement = self._next_in_order()
        assert first_measurement is not None
        self.first: Measurement = first_measurement
        self._next: Measurement | None = first_measurement

    def until(self, start: Epoch, t_s: float) -> list[Measurement]:
        """Return the new measurements up to a time (s) after the start of the session."""
        arrived: list[Measurement] = []
        while self._next is not None and self._next.epoch.seconds_since(start) <= t_s:
            arrived.append(self._next)
            self._next = self._next_in_order()
        return arrived

    def close(self) -> None:
        """Do nothing: the record needs no thread."""

    def _next_in_order(self) -> Measurement | None:
        """Return the next measurement with a plausible time, or None at the end."""
        while (measurement := self._after) is not None:
            self._after = self._read()
            if not _is_astray(self._latest, measurement.epoch, self._after and self._after.epoch):
                self._tell_more()
                if self._latest is None or measurement.epoch.seconds_since(self._latest) > 0.0:
                    self._latest = measurement.epoch
                return measurement
            if not self._astray and self._say is not None:
                when = measurement.epoch.isot(np.zeros(1), 0)[0]
                self._say(
                    f"passed over: {measurement.place}: its time {when} is far from the times of "
                    "the measurements around it"
                )
            self._astray += 1
        self._tell_more()
        return None

    def _tell_more(self) -> None:
        if self._astray > 1 and self._say is not None:
            self._say(f"passed over: {self._astray - 1} more such measurements")
        self._astray = 0

    def _read(self) -> Measurement | None:
        while True:
            try:
                return next(self._source, None)
            except InputError as error:
                if self._say is None:
                    self._faults.append(error)
                else:
                    self._say(f"passed over: {error}")


def _is_astray(before: Epoch | None, here: Epoch, after: Epoch | None) -> bool:
    """Return whether the time of a measurement is implausible between its neighbours."""
    if before is None:
        return after is not None and not -_JUMP_S < after.seconds_since(here) < _DAY_S
    ahead = here.seconds_since(before)
    return ahead > _DAY_S or (
        ahead > _JUMP_S and after is not None and after.seconds_since(here) <= 0.0
    )


class LiveFeed:
    """Feed of a live stream, read by a thread.

    Lines that cannot be read are reported and skipped: one bad line must not end a pass. A regular
    file is followed while it grows.

    Parameters
    ----------
    descriptor : int
        File descriptor of the stream.
    where : str
        Name of the stream, used in messages.
    epoch : Epoch or None
        Origin of times that are given in seconds.
    say : callable
        Receives a line for each fault, and at the end of the input.
    """

    def __init__(
        self, descriptor: int, where: str, epoch: Epoch | None, say: Callable[[str], None]
    ) -> None:
        self._descriptor, self._where, self._epoch, self._say = descriptor, where, epoch, say
        self._arrived: queue.SimpleQueue[Measurement] = queue.SimpleQueue()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="measurements", daemon=True)
        self._thread.start()

    def until(self, start: Epoch, t_s: float) -> list[Measurement]:
        """Return all measurements that have arrived since the last call."""
        arrived: list[Measurement] = []
        while not self._arrived.empty():
            arrived.append(self._arrived.get())
        return arrived

    def close(self) -> None:
        """Stop the thread and wait for its end."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        source = measurements(self._lines(), self._where, self._epoch)
        while True:
            try:
                measurement = next(source, None)
            except InputError as error:
                self._say(f"passed over: {error}")
                continue
            if measurement is None:
                break
            self._arrived.put(measurement)
        if not self._ending.is_set():
            self._say(f"{self._where}: no more measurements; the prediction goes on")

    def _lines(self) -> Iterator[str]:
        """Yield lines as they arrive; another thread can end this, unlike `readline`."""
        buffer, noisy = b"", False
        grows = stat.S_ISREG(os.fstat(self._descriptor).st_mode)
        while not self._ending.is_set():
            if not select.select([self._descriptor], [], [], _POLL_S)[0]:
                continue
            try:
                got = os.read(self._descriptor, _LONGEST_LINE)
            except OSError as error:  # a terminal or a serial line that went away
                self._say(f"{self._where}: {error.strerror or error}")
                got = b""
            if grows and not got:
                self._ending.wait(_POLL_S)
                continue
            *lines, buffer = (buffer + got).split(b"\n")
            if noisy and lines:
                # the end of the line that was passed over
                noisy, lines = False, lines[1:]
            for line in lines:
                yield line.decode("utf-8", "replace")
            if not got:
                break
            if len(buffer) > _LONGEST_LINE:
                if not noisy:
                    self._say(
                        f"passed over: {self._where}: more than {_LONGEST_LINE} bytes without a "
                        "line end"
                    )
                buffer, noisy = b"", True
        if buffer and not noisy and not self._ending.is_set():
            yield buffer.decode("utf-8", "replace")
