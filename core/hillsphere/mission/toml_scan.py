"""Scanner of TOML text: lines of all keys, and all syntax errors.

The standard parser gives values without line numbers, recurses into nested brackets and takes
quadratic time on long dotted keys. This scanner reads the text first, once, without recursion and
in linear time. It refuses text that is nested too deeply, records the line of every key, header,
inline table and array item, and reports every invalid value and every key given twice. Text that
passes is parsed by `tomllib`.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass, field

from hillsphere.base.problems import Key
from hillsphere.mission.toml_values import value_fault

__all__ = ["MAX_DEPTH", "Scan", "Statement", "scan"]

MAX_DEPTH = 32
"""Deepest nesting of tables, dotted keys and brackets, counted together."""

_MOST_FAULTS = 100
"""Reading stops after this number of faults: a file that is not TOML has one on every line."""

# Possessive quantifiers: a failing match gives up at once instead of backtracking.
_BLANK = re.compile(r"[ \t]*+")
_BLANK_LINES = re.compile(r"(?>[ \t\n]++|#[^\n]*+)*+")
_COMMENT = re.compile(r"#[^\n]*+")
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]++")
_BASIC = re.compile(r'"(?>[^"\\\n]++|\\[^\n])*+"')
_LITERAL = re.compile(r"'[^'\n]*+'")
_LONG_BASIC = re.compile(r'"""(?>[^"\\]++|\\.|"(?!""))*+"{3,5}', re.DOTALL)
_LONG_LITERAL = re.compile(r"'''(?>[^']++|'(?!''))*+'{3,5}")
_SCALAR = re.compile(r"(?:[0-9]{4}-[0-9]{2}-[0-9]{2} (?=[0-9]))?+[^\s\[\]{},#\"'=]++")

_PLAIN_ITEMS = re.compile(r"(?:-?(?:0|[1-9][0-9]{0,14}+)(?:\.[0-9]{1,30}+)?+,[ \t]*+(?=[-0-9]))++")


@dataclass(frozen=True)
class Statement:
    """One header or one key with its value: its first and last line and its path."""

    line: int
    end: int
    key: Key


@dataclass
class Scan:
    """Result of a scan: lines of all keys, and syntax errors.

    Parameters
    ----------
    starts : dict
        Path → first line. Items of an array are included if they are not on the array's line.
    ends : dict
        Path → last line, if it differs from the first.
    statements : list of Statement
        Headers and keys in order.
    faults : list
        (line, path, message) of every error.
    sound_to : int or None
        Index of the character at which the first statement with a fault begins; None without.
    """

    starts: dict[Key, int] = field(default_factory=dict)
    ends: dict[Key, int] = field(default_factory=dict)
    statements: list[Statement] = field(default_factory=list)
    faults: list[tuple[int, Key, str]] = field(default_factory=list)
    sound_to: int | None = None


class _Stop(Exception):  # noqa: N818 - control flow inside this module
    """Ends the scan at a syntax error after which the text cannot be read on."""


@dataclass
class _Frame:
    """An array or inline table that is open."""

    key: Key
    line: int
    is_array: bool
    index: int = 0


def scan(text: str) -> Scan:
    """Find the lines of all keys of a TOML text, and its syntax errors.

    Parameters
    ----------
    text : str
        Lines end with a line feed alone.

    Returns
    -------
    Scan
        Lines and faults. The scan ends at the first syntax error, or after 100 other faults.
    """
    scanner = _Scanner(text)
    scanner.run()
    return scanner.found


class _Scanner:
    def __init__(self, text: str) -> None:
        self.text = text
        self.pos = 0
        self.start = 0  # of the present statement
        self.line = 1
        self.found = Scan()
        self.header: Key = ()
        self.key: Key = ()
        self.given: set[Key] = set()  # keys with a value, and headers
        self.lengths: dict[Key, int] = {}  # arrays of tables

    def run(self) -> None:
        try:
            while True:
                self._skip_lines()
                self.start, first = self.pos, self.line
                if self.pos >= len(self.text):
                    return
                self.key = self.header
                if self.text[self.pos] == "[":
                    self._header()
                else:
                    self._key_and_value()
                self.found.statements.append(Statement(first, self.line, self.key))
                self._end_of_statement()
        except _Stop:
            return

    # -- small steps

    def _peek(self) -> str:
        return self.text[self.pos : self.pos + 1]

    def _match(self, pattern: re.Pattern[str]) -> str | None:
        match = pattern.match(self.text, self.pos)
        if match is None:
            return None
        self.pos = match.end()
        return match.group()

    def _blank(self) -> None:
        self._match(_BLANK)

    def _skip_lines(self) -> None:
        self.line += (self._match(_BLANK_LINES) or "").count("\n")

    def _stop(self, message: str, line: int | None = None) -> _Stop:
        self._fault(message, self.key, line)
        return _Stop()

    def _fault(self, message: str, key: Key, line: int | None = None) -> None:
        if self.found.sound_to is None:
            self.found.sound_to = self.start
        self.found.faults.append((line or self.line, key, message))
        if len(self.found.faults) >= _MOST_FAULTS:
            raise _Stop

    def _here(self) -> str:
        char = self._peek()
        if not char:
            return "the end of the file"
        return "the end of the line" if char == "\n" else repr(char)

    def _note(self, key: Key, line: int) -> None:
        self.found.starts.setdefault(key, line)

    # -- statements

    def _end_of_statement(self) -> None:
        self._blank()
        self._match(_COMMENT)
        if self._peek() not in ("", "\n"):
            raise self._stop(f"unexpected {self._here()}; expected the end of the line")

    def _header(self) -> None:
        is_array = self.text.startswith("[[", self.pos)
        self.pos += 1 + is_array
        self.header = ()
        parts = self._dotted(())
        closing = "]]" if is_array else "]"
        if not self.text.startswith(closing, self.pos):
            self.key = parts
            raise self._stop(f"expected {closing!r} after a table's name, got {self._here()}")
        self.pos += len(closing)
        key: Key = ()
        for part in parts[:-1]:  # a name on the way may stand for the last of an array of tables
            key = self._last((*key, part))
            self._note(key, self.line)
        key = (*key, parts[-1])
        if is_array:
            self._note(key, self.line)
            self.lengths[key] = self.lengths.get(key, 0) + 1
            key = self._last(key)
            self._note(key, self.line)
        else:
            if key in self.given:
                self._twice(key, "table")
            else:  # its own header, even if a deeper one has implied it before
                self.found.starts[key] = self.line
            self.given.add(key)
        self.header = self.key = key
        self._check_depth(key)

    def _last(self, key: Key) -> Key:
        length = self.lengths.get(key)
        return key if length is None else (*key, length - 1)

    def _key_and_value(self) -> None:
        parts = self._dotted(self.header)
        self._assign(self.header, parts)
        self._value()

    def _assign(self, base: Key, parts: Key) -> None:
        """Take a key and its ``=``; `key` is then the path of the value to come."""
        for length in range(1, len(parts)):
            self._note((*base, *parts[:length]), self.line)
        self.key = (*base, *parts)
        if self._peek() != "=":
            raise self._stop(f"expected '=' after the key, got {self._here()}")
        self.pos += 1
        if self.key in self.given:
            self._twice(self.key, "key")
        self.given.add(self.key)
        self._note(self.key, self.line)
        self._blank()

    def _twice(self, key: Key, what: str) -> None:
        first = self.found.starts.get(key, self.line)
        where = "in this line" if first == self.line else f"first on line {first}"
        self._fault(f"this {what} is given twice, {where}; keep one", key)

    def _dotted(self, base: Key) -> Key:
        parts: list[str] = []
        while True:
            self._blank()
            part = self._key_part()
            parts.append(part)
            if len(base) + len(parts) > MAX_DEPTH:
                self.key = (*base, *parts[:3])
                self._check_depth((*base, *parts))
            self._blank()
            if self._peek() != ".":
                return tuple(parts)
            self.pos += 1

    def _key_part(self) -> str:
        part = self._match(_BARE_KEY)
        if part is not None:
            return part
        char = self._peek()
        quoted = self._match(_BASIC if char == '"' else _LITERAL) if char in ("'", '"') else None
        if quoted is None:
            if char in ("'", '"'):
                raise self._stop("the key's closing quote is missing")
            raise self._stop(f"expected a key, got {self._here()}")
        if char == "'" or "\\" not in quoted:
            return quoted[1:-1]
        try:
            return str(tomllib.loads(f"k={quoted}")["k"])
        except tomllib.TOMLDecodeError:
            raise self._stop(f"the key {quoted[:60]} holds an escape that TOML has not") from None

    def _check_depth(self, key: Key) -> None:
        if len(key) > MAX_DEPTH:
            self.key = key[:3]
            raise self._stop(f"nested deeper than {MAX_DEPTH} levels")

    # -- values

    def _value(self) -> None:
        """Take one value; arrays and inline tables are kept on a stack, not on Python's."""
        outer = self.key
        stack: list[_Frame] = []
        while True:
            opened = self._begin_value(stack)
            while not opened:
                if not stack:
                    if self.line != self.found.starts[outer]:
                        self.found.ends.setdefault(outer, self.line)
                    self.key = outer
                    return
                opened = self._next_item(stack)

    def _begin_value(self, stack: list[_Frame]) -> bool:
        """Take a scalar or string (False), or open a bracket and reach its first value (True)."""
        char = self._peek()
        if char not in ("[", "{"):
            self._scalar(char)
            return False
        self.pos += 1
        frame = _Frame(self.key, self.line, char == "[")
        self._check_depth((*self.key, 0))
        stack.append(frame)
        return self._first_item(stack, frame)

    def _first_item(self, stack: list[_Frame], frame: _Frame) -> bool:
        if frame.is_array:
            self._skip_lines()
            if self._peek() == "]":
                return self._close(stack)
            self._item(frame)
            return True
        self._blank()
        if self._peek() == "}":
            return self._close(stack)
        self._inline_key(frame)
        return True

    def _next_item(self, stack: list[_Frame]) -> bool:
        """After a value inside a bracket: reach the next value (True) or close it (False)."""
        frame = stack[-1]
        closing = "]" if frame.is_array else "}"
        if frame.is_array:
            self._skip_lines()
        else:
            self._blank()
        self.key = frame.key
        if self._peek() == closing:
            return self._close(stack)
        if self._peek() != ",":
            raise self._unclosed(frame, closing)
        self.pos += 1
        if frame.is_array:
            self._skip_lines()
            if self._peek() == "]":
                return self._close(stack)
            frame.index += 1
            self._item(frame)
        else:
            self._blank()
            if self._peek() == "}":
                raise self._stop("no comma may stand before the '}' of an inline table")
            self._inline_key(frame)
        return True

    def _unclosed(self, frame: _Frame, closing: str) -> _Stop:
        name = "array" if frame.is_array else "inline table"
        if not frame.is_array and self._peek() in ("\n", "#"):
            return self._stop(
                "an inline table must end on the line on which it begins; "
                "write a [table] or an array over several lines"
            )
        since = "" if frame.line == self.line else f" that begins on line {frame.line}"
        at_end = not self._peek()
        return self._stop(
            f"the {name} that begins here is not closed" if at_end else
            f"expected ',' or {closing!r} in the {name}{since}, got {self._here()}",
            frame.line if at_end else None,
        )  # fmt: skip

    def _close(self, stack: list[_Frame]) -> bool:
        self.pos += 1
        frame = stack.pop()
        self.key = frame.key
        if self.line != frame.line:
            self.found.ends.setdefault(frame.key, self.line)
        return False

    def _item(self, frame: _Frame) -> None:
        if not self._peek():
            raise self._unclosed(frame, "]")
        # A run of plain numbers needs no closer look: long tables of numbers stay cheap.
        first = frame.index
        frame.index += (self._match(_PLAIN_ITEMS) or "").count(",")
        self.key = (*frame.key, frame.index)
        if self.line != frame.line:
            for index in range(first, frame.index + 1):
                self._note((*frame.key, index), self.line)

    def _inline_key(self, frame: _Frame) -> None:
        if self._peek() in ("\n", "#", ""):
            raise self._unclosed(frame, "}")
        self._assign(frame.key, self._dotted(frame.key))

    def _scalar(self, char: str) -> None:
        if char in ('"', "'"):
            long = self.text.startswith(char * 3, self.pos)
            if char == '"':
                token = self._match(_LONG_BASIC if long else _BASIC)
            else:
                token = self._match(_LONG_LITERAL if long else _LITERAL)
            if token is None:
                raise self._stop("the string that begins here has no closing quote")
            self.line += token.count("\n")
            return
        token = self._match(_SCALAR)
        if token is None:
            raise self._stop(f"expected a value, got {self._here()}")
        if message := value_fault(token):
            self._fault(message, self.key)
