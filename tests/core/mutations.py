"""Seeded damage to the bytes of a file: what disks, editors and strangers do to it."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable
from typing import Any

__all__ = ["damaged", "with_other_type"]

_NUMBER = re.compile(rb"[-+]?\d+(\.\d+)?([eE][-+]?\d+)?")
_WORDS: tuple[bytes, ...] = (
    b"nan", b"inf", b"-inf", b"0", b"-1", b"1e400", b"1e308", b"-1e-320", b"word", b"", b"''",
    b"9" * 30, b"9" * 5000,  # more digits than int() takes
    "Ω½²".encode(), "٣".encode(), b"1_000", b"0x10", b"1,5", b"true", b"null", b"[]", b"{}",
    b"\x00", b"2026-02-30T00:00:00", b"-99999-01-01T00:00:00", b"1e9", b"'; drop", b"${HOME}",
)  # fmt: skip
_OTHER_ENCODINGS = ("utf-16", "utf-32", "utf-8-sig", "latin-1", "cp500")
_LONG = 200_000
"""Characters of a line that is longer than what the csv module takes for one cell (131 072)."""


def _truncated(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _flipped(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice([1, 1, 4, 32])):
        if changed:
            changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _junk(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.randbytes(rng.choice([1, 8, 400])) + data[at:]


def _only_junk(data: bytes, rng: random.Random) -> bytes:
    return rng.randbytes(rng.choice([1, 16, 4000]))


def _empty(data: bytes, rng: random.Random) -> bytes:
    return rng.choice([b"", b"\n", b" \r\n\t", b"\x00" * 64, b"\xef\xbb\xbf"])


def _cut(data: bytes, rng: random.Random) -> bytes:
    first = rng.randrange(len(data) + 1)
    last = rng.randrange(first, len(data) + 1)
    return data[:first] + data[last:]


def _doubled(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    at = rng.randrange(len(lines))
    return b"".join([*lines[:at], lines[at], *lines[at:]])


def _shuffled(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    if len(lines) > 1:
        i, j = rng.sample(range(len(lines)), 2)
        lines[i], lines[j] = lines[j], lines[i]
    return b"".join(lines)


def _other_number(data: bytes, rng: random.Random) -> bytes:
    places = list(_NUMBER.finditer(data))
    if not places:
        return data
    place = rng.choice(places)
    return data[: place.start()] + rng.choice(_WORDS) + data[place.end() :]


def _other_word(data: bytes, rng: random.Random) -> bytes:
    places = list(re.finditer(rb"[^\s,=<>]+", data))
    if not places:
        return data
    place = rng.choice(places)
    return data[: place.start()] + rng.choice(_WORDS) + data[place.end() :]


def _other_columns(data: bytes, rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    at = rng.randrange(len(lines))
    words = lines[at].split(rng.choice([b",", b" "]))
    lines[at] = b" ".join(words[: rng.randrange(len(words) + 1)] * rng.choice([1, 2, 9])) + b"\n"
    return b"".join(lines)


def _long_line(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice([b"1", b"x", b'"', b"[", b"<a>"]) * _LONG + data[at:]


def _other_encoding(data: bytes, rng: random.Random) -> bytes:
    text = data.decode("utf-8", "replace")
    return text.encode(rng.choice(_OTHER_ENCODINGS), "replace")


def _quoted(data: bytes, rng: random.Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice([b'"', b"'", b"<", b"&", b"\r", b"\x1a", b"\x85"]) + data[at:]


_DAMAGES: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    _truncated, _flipped, _junk, _only_junk, _empty, _cut, _doubled, _shuffled, _other_number,
    _other_number, _other_word, _other_word, _other_columns, _long_line, _other_encoding, _quoted,
)  # fmt: skip


def damaged(data: bytes, seed: int) -> bytes:
    """Return the bytes of a file with one to three kinds of damage; the same for the same seed."""
    rng = random.Random(seed)
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        data = rng.choice(_DAMAGES)(data, rng)
    return data


_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1.5, 1e400, 10**30, "", "..", [], {}, [1, "a", None], {"a": {"b": []}},
)  # fmt: skip


def with_other_type(data: bytes, seed: int) -> bytes:
    """Return a JSON file in which one value, anywhere, is of another type, missing or new."""
    rng = random.Random(seed)
    tree = json.loads(data)
    places: list[tuple[Any, Any]] = []

    def collect(node: Any) -> None:
        items = node.items() if isinstance(node, dict) else enumerate(node)
        for key, value in items:
            places.append((node, key))
            if isinstance(value, dict | list):
                collect(value)

    collect(tree)
    node, key = rng.choice(places)
    if rng.random() < 0.2:
        del node[key]
    else:
        node[key] = rng.choice(_VALUES)
    return json.dumps(tree).encode()
