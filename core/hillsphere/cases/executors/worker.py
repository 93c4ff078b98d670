"""A worker process of the pool: gets the work once, then tasks, and sends what comes of them.

Messages on its channel, each pickled: from the worker ``("hello",)`` and ``("ready",)``, then for
each task ``("begun",)`` and ``("done", value)`` or ``("failed", error, detail)``; instead of
``ready`` or ``begun`` the last may be ``("unprepared", passing, error, detail)``. To the worker the
plugin files of its process, the work, then tasks, then `None` for the end.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import socket
import threading
import traceback
from contextlib import suppress

from hillsphere.base.errors import HillsphereError
from hillsphere.cases.executors.channel import Channel

__all__ = ["MOST_FAULTS", "format_error", "is_passing", "main"]

MOST_FAULTS = 5
"""Times in a row that a passing fault may keep the work from being prepared."""


def main(descriptor: int) -> None:
    """Serve the process at the other end of a pipe until it says that all is done, or is gone.

    Parameters
    ----------
    descriptor : int
        The worker's end of the pipe.
    """
    # A Ctrl-C is for the run, which decides what becomes of its workers.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # What a stage starts need not hold the channel open.
    os.set_inheritable(descriptor, False)
    threading.Thread(target=_leave_with_parent, args=(descriptor,), daemon=True).start()
    # Without the other end there is nobody to tell anything.
    with suppress(EOFError, ConnectionError):
        _serve(Channel(socket.socket(fileno=descriptor)))


def _serve(channel: Channel) -> None:
    channel.send(("hello",))
    files, work = channel.receive(), channel.receive()
    try:
        if files := pickle.loads(files):
            from hillsphere.plugins.plugin_files import load_plugin_files

            load_plugin_files(files)
        do = pickle.loads(work).prepare()
    except Exception as error:
        channel.send(("unprepared", is_passing(error), *format_error(error)))
        return
    channel.send(("ready",))
    while (task := pickle.loads(channel.receive())) is not None:
        try:
            # What the work can make ready beforehand does not count against the task's limit.
            if hasattr(do, "ready"):
                do.ready(task)
        except Exception as error:
            channel.send(("unprepared", is_passing(error), *format_error(error)))
            return
        channel.send(("begun",))
        try:
            message = pickle.dumps(("done", do(task)), protocol=pickle.HIGHEST_PROTOCOL)
        except Exception as error:
            message = pickle.dumps(("failed", *format_error(error)))
        channel.send_bytes(message)


def is_passing(error: BaseException) -> bool:
    """Say whether what kept work from being prepared may be gone at the next try.

    Too little memory, a file system that does not answer: nobody knows all of them. What the
    framework says of its inputs, and code that is not there, stay.
    """
    return not isinstance(error, HillsphereError | ImportError)


def format_error(error: BaseException) -> tuple[str, str]:
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
    if os.getpgrp() == os.getpid():  # with all that plugins have started here
        os.killpg(0, signal.SIGKILL)
    os._exit(1)
