"""What has been measured by now: read as it arrives, or as its time comes in a replay."""

from __future__ import annotations

import os
import queue
import select
import threading
from collections.abc import Callable, Iterator
from itertools import chain
from typing import Protocol

from hillsphere.errors import InputError
from hillsphere.time import Epoch
from hillsphere_tracking.live.measurements import Measurement, measurements

__all__ = ["Arriving", "Feed", "Recorded"]

_LONGEST_LINE = 65536
_POLL_S = 0.2


class Feed(Protocol):
    """Measurements one after the other."""

    def until(self, start: Epoch, t_s: float) -> list[Measurement]:
        """Return those that are new, up to a time after the session's start."""
        ...

    def close(self) -> None:
        """Read no further."""
        ...


class Recorded:
    """Measurements of the past, each given when its time has come.

    Parameters
    ----------
    source : iterator of Measurement
        Asked no further than needed.
    """

    def __init__(self, source: Iterator[Measurement]) -> None:
        first = next(source, None)
        if first is None:
            raise InputError("no measurements to replay: the input is empty")
        self.first = first
        self._source = chain([first], source)
        self._next: Measurement | None = None

    def until(self, start: Epoch, t_s: float) -> list[Measurement]:
        """Return the measurements whose time has come."""
        found: list[Measurement] = []
        while True:
            if self._next is None:
                self._next = next(self._source, None)
            if self._next is None or self._next.epoch.seconds_since(start) > t_s:
                return found
            found.append(self._next)
            self._next = None

    def close(self) -> None:
        """Do nothing: nothing is read ahead."""


class Arriving:
    """Measurements that arrive, read by a thread of its own.

    What cannot be read is told and passed over: one bad line must not end a pass.

    Parameters
    ----------
    descriptor : int
        Of the stream.
    where : str
        Its name, for messages.
    epoch : Epoch or None
        From which times in seconds count.
    say : callable
        Is given a line for each fault, and at the end of the input.
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
        """Return what has arrived, whatever its time."""
        found: list[Measurement] = []
        while not self._arrived.empty():
            found.append(self._arrived.get())
        return found

    def close(self) -> None:
        """End the thread."""
        self._ending.set()
        self._thread.join()

    def _run(self) -> None:
        source = measurements(self._lines(), self._where, self._epoch)
        while True:
            try:
                found = next(source, None)
            except InputError as error:
                self._say(f"passed over: {error}")
                continue  # a message, unlike a table, ends here
            if found is None:
                break
            self._arrived.put(found)
        if not self._ending.is_set():
            self._say(f"{self._where}: no more measurements; the prediction goes on")

    def _lines(self) -> Iterator[str]:
        """Yield lines as they come. Not `readline`, from which no thread can be called back."""
        buffer = b""
        while not self._ending.is_set():
            if not select.select([self._descriptor], [], [], _POLL_S)[0]:
                continue
            try:
                got = os.read(self._descriptor, _LONGEST_LINE)
            except OSError as error:  # a terminal or a serial line that went away
                self._say(f"{self._where}: {error.strerror or error}")
                got = b""
            *lines, buffer = (buffer + got).split(b"\n")
            for line in lines:
                yield line.decode("utf-8", "replace")
            if not got or len(buffer) > _LONGEST_LINE:
                break
        if buffer and not self._ending.is_set():
            yield buffer.decode("utf-8", "replace")
