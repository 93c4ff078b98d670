"""A worker process of the pool: gets the work once, then tasks, and sends what comes of them.

Messages on its pipe, each pickled: from the worker ``("hello",)``, ``("ready",)`` or
``("unprepared", error, detail)``, then for each task ``("begun",)`` and ``("done", value)`` or
``("failed", error, detail)``; to the worker the work, then tasks, then `None` for the end.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import threading
import traceback
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from hillsphere.errors import HillsphereError

__all__ = ["main", "told"]


def main(descriptor: int) -> None:
    """Serve the process at the other end of a pipe until it says that all is done, or is gone.

    Parameters
    ----------
    descriptor : int
        The worker's end of the pipe.
    """
    # A Ctrl-C is for the run, which decides what becomes of its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_leave_with_parent, args=(descriptor,), daemon=True).start()
    # Without the other end there is nobody to tell anything.
    with suppress(EOFError, ConnectionError):
        _serve(Connection(descriptor))


def _serve(pipe: Connection[Any, Any]) -> None:
    pipe.send(("hello",))
    work = pipe.recv_bytes()
    try:
        do = pickle.loads(work).prepare()
    except Exception as error:
        pipe.send(("unprepared", *told(error)))
        return
    pipe.send(("ready",))
    while (task := pipe.recv()) is not None:
        try:
            # What the work can make ready beforehand does not count against the task's limit.
            if hasattr(do, "ready"):
                do.ready(task)
        except Exception as error:
            pipe.send(("failed", *told(error)))
            continue
        pipe.send(("begun",))
        try:
            message = pickle.dumps(("done", do(task)), protocol=pickle.HIGHEST_PROTOCOL)
        except Exception as error:
            message = pickle.dumps(("failed", *told(error)))
        pipe.send_bytes(message)


def told(error: Exception) -> tuple[str, str]:
    """Return an error in one line, for a user, and its traceback, for the log."""
    text = str(error)
    if not isinstance(error, HillsphereError):
        name = type(error).__name__
        text = f"{name}: {text}" if text else name
    return " ".join(text.split()), "".join(traceback.format_exception(error))


def _leave_with_parent(descriptor: int) -> None:
    """End this process, whatever it is doing, when the other end of its pipe is closed."""
    hangup = select.poll()
    hangup.register(descriptor, 0)
    hangup.poll()
    os._exit(1)
