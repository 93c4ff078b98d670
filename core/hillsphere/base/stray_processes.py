"""Child processes that a plugin forks are ended when they return into the framework.

After ``os.fork()`` both processes return from the plugin's function. The child that does so goes on
with the run as its parent does: it computes the remaining cases, calls the plugin again, which
forks again, and within seconds there are thousands of processes that write the same files.

No list of the places where the framework calls plugins would stay complete, and a check at each of
them would cost time in every step. So the child is marked when it is made: the innermost function
of the framework that waits on its stack gets a trace function, and the first line that the child
executes there ends it. A child that ends by itself, executes another program, or belongs to
`multiprocessing`, whose children never return, meets no such line. The parent is not traced.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from types import FrameType
from typing import Any, NoReturn

__all__ = ["STRAY_CODE", "end_child_of", "install"]

STRAY_CODE = 70
"""Exit code of a process that was ended: EX_SOFTWARE of sysexits.h, an error in a program."""

_FRAMEWORK = frozenset(
    f"hillsphere{part}"
    for part in (
        "", "_campaigns", "_controllers", "_dask", "_estimators", "_flight", "_gravity",
        "_guidance", "_orbits", "_plants", "_sensors", "_tracking", "_view",
    )
)  # fmt: skip
"""Packages to which a child must not come back: this one and those that come with it, which call
other plugins too and fork nothing themselves."""

_PID_BYTES = 8
"""Bytes of a process number in the pipe: at least those of any system's ``pid_t``."""

_sites: set[tuple[str, int]] = set()
"""Places in plugins that have forked: only the first child of each place prints a message."""

_ended: tuple[int, int] | None = None
"""Ends of a pipe to which ended children write their numbers, so that their parent reaps them."""

_known: tuple[int, int] | None = None
"""The same in a child: its parent's pipe."""

_mark: tuple[tuple[str, int], FrameType] | None = None
"""In a child: where it was forked, and the frame to which it must not come back."""

_unreaped: list[int] = []
_is_first = True


def install() -> None:
    """Watch the forks of this process from now on."""
    if hasattr(os, "register_at_fork"):  # Windows has no fork
        os.register_at_fork(before=_before, after_in_child=_after_in_child)


def end_child_of(process: int) -> None:
    """End this process if a plugin has forked it from that one.

    It guards functions that a stage calls in a loop of its own: a child that stays in that loop
    never returns to the framework.

    Parameters
    ----------
    process : int
        Number of the process to which an object belongs, such as the context of a stage.
    """
    if _mark is not None and os.getpid() != process:
        _end(*_mark)


def _before() -> None:
    """Prepare for a child that may return, and reap the children that have."""
    global _ended, _is_first
    forking = sys._getframe(1)
    if _home(forking) is None:
        return
    _is_first = _site(forking) not in _sites
    _sites.add(_site(forking))
    with suppress(OSError):  # without descriptors the children stay until their parent ends
        if _ended is None:
            _ended = os.pipe()
            os.set_blocking(_ended[0], False)
        _reap(_ended[0])


def _reap(descriptor: int) -> None:
    """Wait for the children that have ended, so that none stays in the process table."""
    with suppress(BlockingIOError):
        while data := os.read(descriptor, 512 * _PID_BYTES):
            _unreaped.extend(
                int.from_bytes(data[i : i + _PID_BYTES], "little")
                for i in range(0, len(data), _PID_BYTES)
            )
    for pid in list(_unreaped):
        try:
            over = os.waitpid(pid, os.WNOHANG)[0] == pid
        except ChildProcessError:  # a grandchild, or the plugin has waited for it
            over = True
        if over:
            _unreaped.remove(pid)


def _after_in_child() -> None:
    """End this process when it comes back to the frame of the framework that called the plugin."""
    global _ended, _known, _mark
    forking = sys._getframe(1)
    home = _home(forking)
    if home is None:
        return
    _known, _ended = _ended, None
    _unreaped.clear()
    site = _site(forking)
    _mark = site, home

    def trace(frame: FrameType, event: str, argument: Any) -> None:
        # The second: compiled code of the framework's, such as map(), calls the plugin once more.
        if frame is home or frame.f_back is home:
            _end(site, home)

    home.f_trace = trace
    sys.settrace(trace)


def _home(frame: FrameType | None) -> FrameType | None:
    """Return the framework's innermost frame that called fork; None if there is none."""
    while frame is not None:
        package = str(frame.f_globals.get("__name__")).partition(".")[0]
        if package in _FRAMEWORK:
            return frame
        if package == "multiprocessing":
            return None
        frame = frame.f_back
    return None


def _site(frame: FrameType) -> tuple[str, int]:
    return frame.f_code.co_filename, frame.f_lineno


def _end(site: tuple[str, int], home: FrameType) -> NoReturn:
    """End this process with a message, without the cleanup that its parent will do as well."""
    message = (
        f"a process that {site[0]}:{site[1]} has forked came back into "
        f"{home.f_globals.get('__name__')} and was ended; let it end by os._exit(), or start it by "
        "subprocess or multiprocessing\n"
    )
    with suppress(OSError):
        if _is_first:
            os.write(2, message.encode("utf-8", "backslashreplace"))
    with suppress(OSError):
        if _known is not None:
            os.write(_known[1], os.getpid().to_bytes(_PID_BYTES, "little"))
    # Not sys.exit(): files that the parent will flush, locks that it will release.
    os._exit(STRAY_CODE)
