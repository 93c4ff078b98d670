"""Sees what a command does: files, programs, connections, pickles; prevents what it must not do.

Python tells of these by audit events (PEP 578), which nothing in the process can keep back. Files
that a C library opens by itself raise none: SPICE and the compile layer have tests of their own.
"""

from __future__ import annotations

import os
import sys
import sysconfig
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

__all__ = ["CANARY", "Sentinel"]

CANARY = "hostile_canary"
"""Name of a module that must never be imported; it stands in every run directory."""

_ROOT = Path(__file__).resolve().parents[2]
_CONNECTIONS = {"socket.connect", "socket.bind", "socket.getaddrinfo", "socket.sendto",
                "socket.gethostbyname"}  # fmt: skip
_PROGRAMS = {"subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork",
             "os.forkpty", "os.spawn", "pty.spawn"}  # fmt: skip
_CHANGES = {"os.remove": 1, "os.rename": 2, "os.rmdir": 1, "os.mkdir": 1, "os.chmod": 1,
            "os.chown": 1, "os.link": 2, "os.symlink": 2, "os.truncate": 1, "os.utime": 1,
            "shutil.rmtree": 1}  # fmt: skip
"""Events of changes, with how many of their arguments are paths."""

_WRITING = os.O_WRONLY | os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_TRUNC


class Sentinel:
    """Watches this process; there is one, since an audit hook cannot be taken away.

    Parameters
    ----------
    outside : Path
        A tree that nothing may read or write.
    """

    def __init__(self, outside: Path) -> None:
        self.outside = os.path.realpath(outside)
        self.faults: list[str] = []
        self._place = ""
        # Now: asked for within an event of tempfile, it would wait for its own lock.
        self._private = os.path.join(os.path.realpath(tempfile.gettempdir()), "hillsphere-cache-")
        self._busy = False
        places = {*sysconfig.get_paths().values(), sys.prefix, sys.base_prefix, sys.exec_prefix,
                  str(_ROOT), "/proc", "/sys", "/dev/null", "/dev/urandom", "/usr/share",
                  "/usr/lib", "/lib", "/etc/localtime", "/etc/mime.types"}  # fmt: skip
        # What the packages that are imported keep for themselves (matplotlib's list of fonts).
        home = Path.home()
        places |= {str(home / ".cache"), str(home / ".config")}
        places |= {entry for entry in sys.path if entry}
        self._readable = tuple(os.path.realpath(place) for place in places)
        sys.addaudithook(self._event)

    @contextmanager
    def watching(self, place: Path) -> Iterator[list[str]]:
        """Watch within the block; `place` is all that may be written, and read beside Python."""
        self._place, self.faults = os.path.realpath(place), []
        try:
            yield self.faults
        finally:
            self._place = ""

    def _event(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self._place or self._busy:
            return
        self._busy = True
        before = len(self.faults)
        try:
            self._judge(event, arguments)
        finally:
            self._busy = False
        if len(self.faults) > before:
            # What an audit hook raises prevents the act: a fault that is found does no harm.
            raise PermissionError(f"kept back by the sentinel: {self.faults[-1]}")

    def _judge(self, event: str, arguments: tuple[Any, ...]) -> None:
        if event in _CONNECTIONS:
            self.faults.append(f"{event} {arguments[1:]!r}")
        elif event in _PROGRAMS:
            self.faults.append(f"{event} {arguments[:2]!r}")
        elif event == "pickle.find_class":
            self.faults.append(f"unpickled {arguments!r}")
        elif event == "import" and arguments and CANARY in str(arguments[0]):
            self.faults.append(f"imported {arguments[0]}")
        elif event == "ctypes.dlopen" and arguments[0] is not None:
            self._read("ctypes.dlopen", arguments[0])
        elif event == "open" and not isinstance(arguments[0], int):
            flags = arguments[2] if isinstance(arguments[2], int) else 0
            if flags & _WRITING:
                self._written("open", arguments[0])
            else:
                self._read("open", arguments[0])
        elif event in _CHANGES:
            for path in arguments[event == "os.symlink" : _CHANGES[event]]:  # not what it leads to
                if not isinstance(path, int):
                    self._written(event, os.path.dirname(os.fsdecode(path)) or ".")

    def _read(self, event: str, path: Any) -> None:
        name = os.fsdecode(path)
        if os.sep not in name and event == "ctypes.dlopen":  # a library of the system, by its name
            return
        real = os.path.realpath(name)
        if not self._is_within(real, (self._place, *self._readable)):
            self.faults.append(f"{event} to read: {name}")

    def _written(self, event: str, path: Any) -> None:
        real = os.path.realpath(os.fsdecode(path))
        allowed = (self._place, "/dev/null")
        private = self._private
        # Python's own compiled files stand beside their sources.
        if not (self._is_within(real, allowed) or real.startswith(private)
                or "__pycache__" in real or real == os.path.dirname(private)):  # fmt: skip
            self.faults.append(f"{event} to write: {os.fsdecode(path)}")

    def _is_within(self, real: str, places: tuple[str, ...]) -> bool:
        if real == self.outside or real.startswith(self.outside + os.sep):
            return False
        return any(real == place or real.startswith(place.rstrip("/") + "/") for place in places)
