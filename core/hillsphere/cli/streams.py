"""The standard streams: one that is closed, full or no longer read must not break a command."""

from __future__ import annotations

import os
import re
import sys
from typing import TextIO

__all__ = ["drop", "flush_stdout", "harmless", "replace_closed", "say"]

_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""Control characters but tab and line feed, and those that turn the direction of writing."""


def replace_closed() -> list[str]:
    """Put the null device in the place of standard streams that are closed.

    Without it the next file that is opened would take their descriptor, and receive what is meant
    for them.

    Returns
    -------
    list of str
        ``"stdin"``, ``"stdout"``, ``"stderr"``: those that were closed.
    """
    closed = [name for name in ("stdin", "stdout", "stderr") if getattr(sys, name) is None]
    for name in closed:
        mode = "r" if name == "stdin" else "w"
        setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115 - stays open
    return closed


def say(message: str) -> None:
    """Write a message to stderr.

    Parameters
    ----------
    message : str
        One or more lines.
    """
    # A message may quote a file name or key that the terminal's encoding cannot show.
    encoding = sys.stderr.encoding or "utf-8"
    shown = harmless(message).encode(encoding, "backslashreplace").decode(encoding)
    try:
        print(shown, file=sys.stderr, flush=True)  # noqa: T201 - the message is for the user
    except OSError:
        # Nobody can read stderr any more; the exit code still says what happened.
        drop(sys.stderr)


def harmless(text: str) -> str:
    """Return a text with the characters escaped that would steer a terminal.

    Messages quote names, titles and settings that somebody else may have written: an escape
    sequence among them could rewrite what is shown, or what is pasted.
    """
    return _STEERING.sub(lambda match: f"\\u{ord(match.group()):04x}", text)


def flush_stdout() -> OSError | None:
    """Flush stdout.

    Returns
    -------
    OSError or None
        Why it cannot be written; what it still held is dropped then, lest the interpreter try
        again when it shuts down.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        drop(sys.stdout)
        return error
    return None


def drop(stream: TextIO) -> None:
    """Send what a stream holds, and all that follows, to the null device."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
