"""Standard streams that are closed, full or no longer read, which must not break a command."""

from __future__ import annotations

import os
import re
import sys
from typing import TextIO

__all__ = ["drop", "flush_stdout", "harmless", "replace_closed", "say"]

_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
"""Control characters except tab and line feed, and those that change the writing direction."""


def replace_closed() -> list[str]:
    """Replace closed standard streams by the null device.

    Otherwise the next opened file would get their descriptor, and receive their output.

    Returns
    -------
    list of str
        Names of the streams that were closed: ``"stdin"``, ``"stdout"``, ``"stderr"``.
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
    """Return a text with control characters escaped.

    Messages quote names, titles and settings from untrusted files: an escape sequence in them could
    change the displayed or the pasted text.
    """
    return _STEERING.sub(lambda match: f"\\u{ord(match.group()):04x}", text)


def flush_stdout() -> OSError | None:
    """Flush stdout.

    Returns
    -------
    OSError or None
        The error of writing. Buffered output is then discarded, so that the interpreter does not
        try again at shutdown.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        drop(sys.stdout)
        return error
    return None


def drop(stream: TextIO) -> None:
    """Redirect a stream, with its buffered output, to the null device."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)
