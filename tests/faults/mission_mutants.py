"""Mission files with something wrong in them, made from sound ones by a generator with a seed.

A mutant is named by its number alone: `mutant(17)` is the same text on every machine, so that what
one of ten thousand did can be looked at again.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

__all__ = ["SMALL", "Mutant", "mutant"]

ROOT = Path(__file__).parents[2]
MISSIONS = ROOT / "missions"
EXAMPLES = ROOT / "examples/hillsphere-dumbbell/missions"
OWN = Path(__file__).parent / "missions"

SMALL = (
    "hover", "family", "waves", "dumbbell-moon", "deimos-qso", "phobos-qso", "phobos-hover",
)  # fmt: skip
"""Missions that end within seconds under their profile ``fast``: most mutants are theirs, as the
large ones cost ten times as much to check."""

KEY = re.compile(r"^\s*(\"[^\"\n]*\"|[\w.-]+)\s*=(?!=)", re.M)
NUMBER = re.compile(r"(?<![\w.+-])[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?(?![\w.])")
STRING = re.compile(r"\"[^\"\\\n]*\"")
HEADER = re.compile(r"^\[[^\]\n]+\]", re.M)

EXTREMES = (
    "0", "-1", "1", "2", "1e-320", "1e-30", "1e-9", "1e9", "1e30", "1e150", "1e308", "-1e308",
    "1e999", "inf", "-inf", "nan", "-0.0", "9223372036854775807", "-9223372036854775808",
    "9" * 40, "0x7fff", "1_000", "65", "64", "63",
)  # fmt: skip
OTHER_TYPES = (
    "true", "false", '""', '"x"', "[]", "[[]]", "{}", "[1, 2]", '["a"]', "{ a = 1 }", "0", "-3",
    "2.5", "nan", "1979-05-27", "1979-05-27T07:32:00Z", "07:32:00", "[1, \"a\"]", "[[1], [2, 3]]",
    "[true]", '"1"', "[" * 40 + "]" * 40,
)  # fmt: skip
STRANGE = (
    "é", "µ", "ﬁ", "‮", "\u200b", "\ufeff", "\u0000", "\x1b[31m", "🚀", "ẞ", "٣",
    "𝟙", "..", "/", "../x", "~", "%s", "{0}", "*", "'", "\\u0000", "\\n", "a" * 300,
)  # fmt: skip
UNITS = ("_m", "_km", "_s", "_h", "_min", "_deg", "_rad", "_m_s", "_mm_s", "_kg", "")


@dataclass(frozen=True)
class Mutant:
    """A mission file with something changed.

    Parameters
    ----------
    number : int
        Which one.
    base : str
        Name of the mission that it was made from.
    changes : tuple of str
        Kinds of the changes.
    data : bytes
        The file.
    """

    number: int
    base: str
    changes: tuple[str, ...]
    data: bytes


def mutant(number: int) -> Mutant:
    """Return a mutant by its number."""
    chance = random.Random(f"mission mutant {number}")
    texts = _missions()
    # Three of four from small missions; a campaign of a thousand runs has to end.
    names = [n for n in texts if n in SMALL] if chance.random() < 0.75 else list(texts)
    base = chance.choice(names)
    text = texts[base]
    changes: list[str] = []
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        name = chance.choice(list(_CHANGES))
        changed = _CHANGES[name](text, chance)
        if changed != text:
            text = changed
            changes.append(name)
    data = text.encode("utf-8", "surrogatepass")
    if chance.random() < 0.05:
        data = _flip(data, chance)
        changes.append("bytes")
    return Mutant(number, base, tuple(changes), data)


@cache
def _missions() -> dict[str, str]:
    files = [*MISSIONS.glob("*.toml"), *EXAMPLES.glob("*.toml"), *OWN.glob("*.toml")]
    return {path.stem: path.read_text("utf-8") for path in sorted(files)}


def _replace(text: str, match: re.Match[str], new: str, group: int = 0) -> str:
    return text[: match.start(group)] + new + text[match.end(group) :]


def _one(pattern: re.Pattern[str], text: str, chance: random.Random) -> re.Match[str] | None:
    found = list(pattern.finditer(text))
    return chance.choice(found) if found else None


def _key_renamed(text: str, chance: random.Random) -> str:
    match = _one(KEY, text, chance)
    if match is None:
        return text
    key = match[1]
    other = _one(KEY, text, chance)
    at = chance.randrange(len(key))
    unit = next((u for u in UNITS if u and key.endswith(u)), "")
    new = chance.choice(
        [
            key[:at] + key[at + 1 :],
            key[:at] + chance.choice("abcxyz_") + key[at:],
            key.upper(),
            key.removesuffix(unit) + chance.choice(UNITS),
            other[1] if other else key,
            f'"{key} "',
        ]
    )
    return _replace(text, match, new or '""', 1)


def _lines(change: Callable[[list[str], int, random.Random], None]) -> Callable[..., str]:
    def changed(text: str, chance: random.Random) -> str:
        lines = text.split("\n")
        keys = [i for i, line in enumerate(lines) if KEY.match(line) or HEADER.match(line)]
        if keys:
            change(lines, chance.choice(keys), chance)
        return "\n".join(lines)

    return changed


def _dropped(lines: list[str], at: int, chance: random.Random) -> None:
    del lines[at]


def _doubled(lines: list[str], at: int, chance: random.Random) -> None:
    lines.insert(chance.choice([at, at, chance.randrange(len(lines))]), lines[at])


def _moved(lines: list[str], at: int, chance: random.Random) -> None:
    line = lines.pop(at)
    lines.insert(chance.randrange(len(lines) + 1), line)


def _other_type(text: str, chance: random.Random) -> str:
    match = _one(re.compile(KEY.pattern + r"[ \t]*([^\n#]*)", re.M), text, chance)
    return text if match is None else _replace(text, match, chance.choice(OTHER_TYPES), 2)


def _item_of_other_type(text: str, chance: random.Random) -> str:
    match = _one(chance.choice([NUMBER, STRING]), text, chance)
    return text if match is None else _replace(text, match, chance.choice(OTHER_TYPES))


def _extreme(text: str, chance: random.Random) -> str:
    match = _one(NUMBER, text, chance)
    return text if match is None else _replace(text, match, chance.choice(EXTREMES))


def _other_number(text: str, chance: random.Random) -> str:
    match = _one(NUMBER, text, chance)
    if match is None:
        return text
    value = float(match[0])
    if match[0].lstrip("+-").isdigit():
        new = str(max(-(2**62), min(2**62, int(value) + chance.choice((-2, -1, 1, 2, 7)))))
    else:
        new = repr(value * chance.choice((-1.0, 0.0, 0.1, 0.5, 2.0, 10.0, 1e3, 1e-6)))
    return _replace(text, match, new)


def _broken_reference(text: str, chance: random.Random) -> str:
    match, other = _one(STRING, text, chance), _one(STRING, text, chance)
    if match is None or other is None:
        return text
    word = match[0][1:-1]
    new = chance.choice([other[0], f'"{word}x"', f'"{word[:-1]}"', '"*"', '"*.*"', f'"{word}.0"'])
    return _replace(text, match, new)


def _table_moved(text: str, chance: random.Random) -> str:
    heads = [m.start() for m in HEADER.finditer(text)] + [len(text)]
    if len(heads) < 3:
        return text
    pieces = [text[: heads[0]], *(text[a:b] for a, b in pairwise(heads))]
    piece = pieces.pop(chance.randrange(1, len(pieces)))
    what = chance.random()
    if what < 0.5:
        pieces.insert(chance.randrange(1, len(pieces) + 1), piece)
    elif what < 0.8:  # it takes the name, or the kind, of another
        other = HEADER.match(pieces[chance.randrange(1, len(pieces))])
        if other is not None:
            pieces.append(HEADER.sub(lambda _: other[0], piece, count=1))
    return "".join(pieces)


def _unicode(text: str, chance: random.Random) -> str:
    match = _one(chance.choice([STRING, KEY, HEADER]), text, chance)
    if match is None:
        return text
    at = chance.randrange(match.start() + 1, match.end())
    return text[:at] + chance.choice(STRANGE) + text[at:]


def _flip(data: bytes, chance: random.Random) -> bytes:
    flipped = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 8))):
        flipped[chance.randrange(len(flipped))] ^= 1 << chance.randrange(8)
    return bytes(flipped)


_CHANGES: dict[str, Callable[[str, random.Random], str]] = {
    "key renamed": _key_renamed,
    "line dropped": _lines(_dropped),
    "line doubled": _lines(_doubled),
    "line moved": _lines(_moved),
    "other type": _other_type,
    "item of other type": _item_of_other_type,
    "extreme number": _extreme,
    "other number": _other_number,
    "number again": _other_number,  # twice as often: what passes `validate` is mostly of this kind
    "extreme again": _extreme,
    "broken reference": _broken_reference,
    "table moved": _table_moved,
    "unicode": _unicode,
}
