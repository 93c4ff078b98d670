"""Handling of the signals that end a process: by an exception, an event, and a time limit.

Python handles a signal between two of its own instructions. Compiling the equations of a mission is
one instruction that may take minutes: `end_in_time` ends a process that does not react in time.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, NoReturn

__all__ = ["GRACE_S", "STOPPING", "child_groups", "end_in_time", "ignore", "interrupt", "remedy",
           "stop_signals"]  # fmt: skip

STOPPING = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if hasattr(signal, name)  # Windows has no SIGHUP
)


GRACE_S = 2.5
"""Time that a command has to end by itself after a signal. Senders such as batch systems often
kill after 5 or 10 s: by then the workers must be stopped and the user told how to resume."""

INTERRUPTED = 130
"""Exit code, as `hillsphere.cli.endings` explains."""

child_groups: set[int] = set()
"""Process groups of workers; code that starts a group adds it, and removes it after its end."""

_handlers: set[Callable[..., Any]] = set()
"""Handlers of `stop_signals` that are in place."""

_remedies: list[str] = []


def interrupt(number: int, frame: FrameType | None) -> NoReturn:
    """Handle a signal: raise a `KeyboardInterrupt` that names it."""
    raise KeyboardInterrupt(f"interrupted by {signal.Signals(number).name}")


def ignore(number: int, frame: FrameType | None) -> None:
    """Handle a signal by doing nothing: `end_in_time` is already ending the process."""


@contextmanager
def stop_signals(stopped: threading.Event) -> Iterator[None]:
    """Set the event at the signals of `STOPPING`, then raise `KeyboardInterrupt`, in the block.

    Threads that poll the event notice the signal at once, whatever the main thread is doing.

    Parameters
    ----------
    stopped : threading.Event
        Set before the exception is raised.

    Notes
    -----
    A process whose signals are ignored (as under nohup) or handled by its own code keeps that; so
    does any thread but the main one, where Python allows no handler.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def stopping(usual: Callable[[int, FrameType | None], Any]) -> Callable[..., None]:
        def stop(number: int, frame: FrameType | None) -> None:
            stopped.set()
            usual(number, frame)

        return stop

    told = sys.unraisablehook

    def tell(fault: sys.UnraisableHookArgs) -> None:
        # A signal met a destructor, which cannot raise: the event is set, and stops the run.
        if not issubclass(fault.exc_type, KeyboardInterrupt):
            told(fault)

    taken: dict[int, Any] = {}
    ours: list[Callable[..., Any]] = []
    sys.unraisablehook = tell
    try:
        for number in STOPPING:
            handler = signal.getsignal(number)
            # Those of Python, of the system and of our command line; no others.
            if handler in (signal.default_int_handler, interrupt, signal.SIG_DFL):
                usual = interrupt if handler is signal.SIG_DFL else handler
                assert callable(usual)
                taken[number] = handler
                ours.append(stopping(usual))
                _handlers.add(ours[-1])
                signal.signal(number, ours[-1])
        yield
    finally:
        sys.unraisablehook = told
        for number, handler in taken.items():
            signal.signal(number, handler)
        _handlers.difference_update(ours)


@contextmanager
def remedy(text: str) -> Iterator[None]:
    """Set the message that `end_in_time` prints in the block: what is kept, how to resume."""
    _remedies.append(text)
    try:
        yield
    finally:
        _remedies.remove(text)


def end_in_time() -> None:
    """End this process `GRACE_S` after a signal of `STOPPING` if it has not ended by then.

    Only for the command line, which owns its process. The workers of `child_groups` are killed.

    Notes
    -----
    The system's part of the handler, which runs at once, writes the signal's number to a pipe; a
    thread reads it. Compiling and propagating release the interpreter's lock, so that the thread
    runs while the main thread is in them. Signals that are ignored, or that a plugin's command
    handles by a function of its own, end nothing.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    threading.Thread(target=_end_late, args=(reading,), daemon=True).start()


def _end_late(reading: int) -> None:
    while not (numbers := [n for n in os.read(reading, 64) if n in STOPPING and _is_ours(n)]):
        pass
    time.sleep(GRACE_S)
    for group in list(child_groups):
        with suppress(OSError):
            os.killpg(group, signal.SIGKILL)
    parts = [f"interrupted by {signal.Signals(numbers[0]).name}", *_remedies[-1:]]
    with suppress(OSError):
        os.write(2, ("; ".join(parts) + "\n").encode("utf-8", "backslashreplace"))
    os._exit(INTERRUPTED)


def _is_ours(number: int) -> bool:
    """Return whether a signal interrupts this process by a handler of ours or of Python."""
    handler = signal.getsignal(number)
    usual = (interrupt, ignore, signal.default_int_handler)
    return handler in usual or handler in _handlers


def _leave_to_parent() -> None:
    """Restore usual signal handling in a forked child, so that it does not write to our pipe.

    `multiprocessing` ends its children by SIGTERM, which must not end the run.
    """
    if signal.set_wakeup_fd(-1) == -1:
        return
    child_groups.clear()
    for number in STOPPING:
        if _is_ours(number):
            usual = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
            signal.signal(number, usual)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_to_parent)
