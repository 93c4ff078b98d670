"""The signals that end a process, as one exception and one event; imports nothing heavy."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, NoReturn

__all__ = ["STOPPING", "interrupt", "stop_signals"]

STOPPING = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP")
    if hasattr(signal, name)  # Windows has no SIGHUP
)


def interrupt(number: int, frame: FrameType | None) -> NoReturn:
    """Handle a signal: raise a `KeyboardInterrupt` that names it."""
    raise KeyboardInterrupt(f"interrupted by {signal.Signals(number).name}")


@contextmanager
def stop_signals(stopped: threading.Event) -> Iterator[None]:
    """Set the event at the signals of `STOPPING`, then raise `KeyboardInterrupt`, in the block.

    Threads that look at the event learn of the signal at once, whatever the main thread is doing.

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
    sys.unraisablehook = tell
    try:
        for number in STOPPING:
            handler = signal.getsignal(number)
            # Those of Python, of the system and of our command line; no others.
            if handler in (signal.default_int_handler, interrupt, signal.SIG_DFL):
                usual = interrupt if handler is signal.SIG_DFL else handler
                assert callable(usual)
                taken[number] = handler
                signal.signal(number, stopping(usual))
        yield
    finally:
        sys.unraisablehook = told
        for number, handler in taken.items():
            signal.signal(number, handler)
