"""Command lines that are printed for the user to copy."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable

__all__ = ["shell_line"]


def shell_line(words: Iterable[str]) -> str:
    r"""Return words as one line that a POSIX shell splits into the same words.

    Parameters
    ----------
    words : iterable of str
        A command and its arguments; they may come from another user's file.

    Returns
    -------
    str
        The line, quoted where necessary. Control characters, which could manipulate the terminal,
        are written as ``$'\x1b'``, which bash and zsh understand.
    """
    return " ".join(_quote(word) for word in words)


def _quote(word: str) -> str:
    if word.isprintable():
        return shlex.quote(word)
    body = "".join(
        chr(byte) if 0x20 <= byte < 0x7F and chr(byte) not in "\\'" else f"\\x{byte:02x}"
        for byte in os.fsencode(word)
    )
    return f"$'{body}'"
