"""Safe reading of TOML text, with the line of each key.

The text is checked before it is parsed: size, encoding, line ends, control characters, depth. The
parser is `tomllib`; it sees only what the scanner (`hillsphere.mission.toml_scan`) let pass.
"""

from __future__ import annotations

import errno
import re
import tomllib
from bisect import bisect_right
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hillsphere.base.problems import Key, MissionError, Problem
from hillsphere.base.regular_files import NotRegularError, read_bytes
from hillsphere.mission.toml_scan import MAX_DEPTH, Scan, Statement, scan

__all__ = ["MAX_BYTES", "MAX_DEPTH", "Locations", "parse_toml", "read_toml"]

MAX_BYTES = 1 << 20
"""Largest accepted file."""

_TOO_LARGE = "is larger than 1 MiB, the most that a mission file may have"
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f]")
_POSITION = re.compile(r" \(at (?:line (\d+), column \d+|end of document)\)$")


@dataclass(frozen=True)
class Locations:
    """Lines of a TOML text by key path.

    Parameters
    ----------
    source : str
        The file as the user named it.
    scan : Scan
        Result of the scanner.
    """

    source: str
    scan: Scan

    def line(self, key: Key) -> int | None:
        """Return the line of a key or array item, else of the nearest table or array around it."""
        for length in range(len(key), 0, -1):
            if (line := self.scan.starts.get(key[:length])) is not None:
                return line
        return None

    def span(self, key: Key) -> tuple[int, int] | None:
        """Return first and last line of a key and its value; None if it is not in the text."""
        start = self.scan.starts.get(key)
        return None if start is None else (start, self.scan.ends.get(key, start))

    def statement_at(self, line: int) -> Statement | None:
        """Return the header or key on a line, or else the last one before it."""
        index = bisect_right(self.scan.statements, line, key=lambda statement: statement.line)
        return self.scan.statements[index - 1] if index else None


def read_toml(path: Path, source: str) -> tuple[dict[str, Any], Locations, str]:
    """Read and parse a TOML file.

    Parameters
    ----------
    path : Path
        The file.
    source : str
        Its name in messages.

    Returns
    -------
    tables : dict
        Content of the file.
    locations : Locations
        Lines of its keys.
    text : str
        Its text, with lines ending with a line feed.

    Raises
    ------
    MissionError
        If it cannot be read, is not a regular file of at most 1 MiB, or is not sound TOML.
    """
    return parse_toml(_read(path, source), source)


def parse_toml(data: bytes, source: str) -> tuple[dict[str, Any], Locations, str]:
    """Parse TOML text; arguments, results and errors as for `read_toml`."""
    text = _decode(data, source)
    locations = Locations(source, scan(text))
    scanned = locations.scan
    # Only the text before the first fault is safe to parse; tomllib may find a fault in it, too.
    sound = text if scanned.sound_to is None else text[: scanned.sound_to]
    problems = [Problem(source, *fault) for fault in scanned.faults]
    try:
        tables = tomllib.loads(sound)
    except tomllib.TOMLDecodeError as error:
        problems.append(_syntax_problem(str(error), sound, locations))
    if problems:
        raise MissionError(sorted(problems, key=lambda p: p.line or 0))
    return tables, locations, text


def _read(path: Path, source: str) -> bytes:
    try:
        return read_bytes(path, MAX_BYTES)
    except IsADirectoryError:
        raise _mission_error(source, "is a directory; give the mission file itself") from None
    except NotRegularError:
        raise _mission_error(source, "is not a regular file") from None
    except FileNotFoundError:
        raise _mission_error(source, "no such file") from None
    except PermissionError:
        raise _mission_error(source, "permission denied; the file cannot be read") from None
    except OSError as error:
        if error.errno == errno.EFBIG:
            raise _mission_error(source, _TOO_LARGE) from None
        raise _mission_error(source, f"cannot be read: {error.strerror}") from None


def _mission_error(source: str, message: str, line: int | None = None) -> MissionError:
    return MissionError([Problem(source, line, (), message)])


def _decode(data: bytes, source: str) -> str:
    if len(data) > MAX_BYTES:
        raise _mission_error(source, _TOO_LARGE)
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise _mission_error(source, "is UTF-16 text; save it as UTF-8", 1)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # `object` rather than `data`: the codec counts from behind a byte-order mark.
        raw = bytes(error.object)
        line = raw.count(b"\n", 0, error.start) + 1
        byte = raw[error.start]
        raise _mission_error(source, f"is not UTF-8 text: byte 0x{byte:02x}", line) from None
    text = text.replace("\r\n", "\n")
    if match := _CONTROL.search(text):
        line = text.count("\n", 0, match.start()) + 1
        if match.group() == "\r":
            message = "a bare carriage return; end lines with LF or CRLF"
        else:
            message = f"control character U+{ord(match.group()):04X} is not allowed"
        raise _mission_error(source, message, line)
    return text


def _syntax_problem(message: str, text: str, locations: Locations) -> Problem:
    """Turn an error of tomllib into a problem with line and key."""
    match = _POSITION.search(message)
    if match is None or match.group(1) is None:
        line = text.count("\n", 0, max(len(text) - 1, 0)) + 1
    else:
        line = int(match.group(1))
    statement = locations.statement_at(line)
    said = message[: match.start()] if match else message
    said = said[:1].lower() + said[1:]
    if said.startswith(("cannot ", "duplicate ")):
        said = "collides with a key or table given before under the same name"
    elif "escape" in said or "'\\\\'" in said:
        said = "a backslash in a \"…\" string begins an escape such as \\n; write '…' or \\\\"
    if statement is None:
        return Problem(locations.source, line, (), said)
    return Problem(locations.source, statement.line, statement.key, said)
