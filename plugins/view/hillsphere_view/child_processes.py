"""Commands that the page starts: each in a process of its own, which outlives the server."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from threading import Lock
from typing import IO, Any

from hillsphere.base.errors import InputError
from hillsphere.base.shell_words import shell_line

__all__ = ["MOST", "BusyError", "Child", "ChildProcesses"]

MOST = 2
"""Commands at a time; each takes all processors that it can use."""
_TAIL_BYTES = 16 << 10
"""End of the messages of a command that is shown."""
_MOST_JSON = 4 << 20
"""Longest result of a repeated case that is read; with hundreds of metrics it has 100 kB."""


class BusyError(InputError):
    """As many commands are going on as may, or one for the same run."""


@dataclass
class Child:
    """A command that was started.

    Parameters
    ----------
    key : str
        The run that it writes to.
    command : str
        ``"run"``, ``"resume"`` or ``"rerun"``.
    detail : str
        The case that is repeated, ``"stage/number"``.
    process : Popen
        The process.
    output, messages : file
        Its standard output and error, which have no name.
    """

    key: str
    command: str
    detail: str
    process: subprocess.Popen[bytes]
    output: IO[bytes]
    messages: IO[bytes]
    started: float = field(default_factory=time.monotonic)

    @property
    def is_running(self) -> bool:
        """Return whether the process has not ended."""
        return self.process.poll() is None

    @property
    def seconds(self) -> int:
        """Return the time since the start."""
        return round(time.monotonic() - self.started)

    def message(self) -> str:
        """Return what the command has written to its standard error."""
        size = os.fstat(self.messages.fileno()).st_size
        data = os.pread(self.messages.fileno(), _TAIL_BYTES, max(0, size - _TAIL_BYTES))
        return data.decode("utf-8", "replace")

    def result(self) -> Any:
        """Return the JSON document of the standard output; None if there is none."""
        data = os.pread(self.output.fileno(), _MOST_JSON, 0)
        try:
            return json.loads(data)
        except (ValueError, RecursionError):
            return None

    def stop(self) -> None:
        """Ask the process to end and to keep what is finished."""
        if self.is_running:
            self.process.send_signal(signal.SIGTERM)


class ChildProcesses:
    """The commands that this server has started, the latest of each run."""

    def __init__(self) -> None:
        self._latest: dict[str, Child] = {}
        self._lock = Lock()

    def of(self, key: str) -> Child | None:
        """Return the latest command for a run, if any."""
        return self._latest.get(key)

    def running(self) -> list[Child]:
        """Return the commands that have not ended."""
        return [child for child in list(self._latest.values()) if child.is_running]

    def start(
        self, key: str, words: Sequence[str], *, detail: str = "", others: Iterable[str] = ()
    ) -> Child:
        """Start a command of the framework.

        Parameters
        ----------
        key : str
            The run that it writes to.
        words : sequence of str
            The command line after ``hillsphere``.
        detail : str
            As of `Child`.
        others : iterable of str
            Runs that other processes are writing to.

        Raises
        ------
        BusyError
            If it cannot be started now.
        """
        with self._lock:
            going = {child.key for child in self.running()} | set(others)
            if key in going:
                raise BusyError("this run is still going on; wait for its end, or stop it")
            if len(going) >= MOST:
                raise BusyError(f"{MOST} runs are going on already; wait for one of them to end")
            # Both stay open: they are read while the command goes on, and after its end.
            output, messages = (tempfile.TemporaryFile() for _ in range(2))  # noqa: SIM115
            try:
                # A session of its own: neither Ctrl-C nor the end of the terminal reaches it.
                process = subprocess.Popen(
                    [sys.executable, "-P", "-m", "hillsphere", *words],
                    stdin=subprocess.DEVNULL, stdout=output, stderr=messages,
                    start_new_session=True,
                )  # fmt: skip
            except (OSError, ValueError) as error:  # ValueError: a null character
                raise InputError(f"{shell_line(words)}: cannot be started: {error}") from error
            child = Child(key, words[0], detail, process, output, messages)
            self._latest[key] = child
            return child
