"""Gravity fields in the format of ICGEM (.gfc) [1]_, static or evaluated at an epoch.

References
----------
.. [1] International Centre for Global Earth Models, The ICGEM-format, versions 1.0 and 2.0.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from hillsphere.base.errors import InputError
from hillsphere.formats.bulk import parse_series
from hillsphere.formats.coefficients import Coefficient, CoefficientTable, LineReader
from hillsphere_gravity.icgem_terms import (
    TIME_VARIABLE,
    Term,
    evaluate_terms,
    julian_date,
    read_term,
)

__all__ = ["read_icgem"]

_KEYS = (
    "format", "product_type", "modelname", "earth_gravity_constant", "gravity_constant", "radius",
    "max_degree", "norm", "tide_system", "errors",
)  # fmt: skip
_FORMATS = ("icgem1.0", "icgem2.0")
_NORMALISATIONS: dict[str, Literal["full", "none"]] = {
    "fully_normalized": "full",
    "unnormalized": "none",
}
_TIDE_SYSTEMS = ("tide_free", "zero_tide", "mean_tide", "unknown")
_ERROR_COLUMNS = {"no": 0, "none": 0, "calibrated": 2, "formal": 2, "calibrated_and_formal": 4}
_KEYWORD = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,39}", re.ASCII)
_MOST_KEYS_SHOWN = 8
"""Unknown keys that a message lists: as many as fit into two lines."""


def read_icgem(
    path: str | Path, epoch: str | None = None, kept_degree: int | None = None
) -> CoefficientTable:
    """Read a gravity field.

    Parameters
    ----------
    path : str or Path
        The file; its ``product_type`` must be ``gravity_field``.
    epoch : str, optional
        Date and time, ``"2020-01-01T00:00:00"``, at which time-variable terms (``gfct``, ``trnd``
        or ``dot``, ``acos``, ``asin``) are evaluated, see `evaluate_terms`.
    kept_degree : int, optional
        Rows of higher degree are checked and left out, which saves memory.

    Returns
    -------
    CoefficientTable
        SI. Of two pairs of standard deviations the first, the calibrated one, is kept; this and
        every other part of the file that is not kept is in `passed_over`.

    Raises
    ------
    InputError
        Names file and line: a head that lacks a key, an unknown version, time-variable terms
        without `epoch` or `epoch` without such terms, a malformed or doubled row, a missing degree.
    """
    lines = LineReader(Path(path))
    epoch_jd = None if epoch is None else julian_date(epoch)
    text = iter(lines)
    head = _read_head(lines, text)
    version = head.choice("format", _FORMATS) or "icgem1.0"
    product = head.word("product_type")
    if product != "gravity_field":
        raise lines.fault(
            f"product_type must be gravity_field, got {product!r}", head.line("product_type")
        )
    gm_key = "gravity_constant" if "gravity_constant" in head.words else "earth_gravity_constant"
    gm = head.positive(gm_key)
    radius = head.positive("radius")
    max_degree = head.integer("max_degree")
    norm = head.choice("norm", tuple(_NORMALISATIONS))
    tide = head.tide_system()
    errors = head.choice("errors", tuple(_ERROR_COLUMNS))
    sigmas = None if errors is None else _ERROR_COLUMNS[errors]

    widths = (4, 6, 8) if sigmas is None else (4 + sigmas,)
    bulk = parse_series(
        lines, widths=widths, keyword="gfc", max_degree=max_degree, kept_degree=kept_degree
    )
    rows: list[Coefficient] = []
    if bulk is not None:
        rows, sigmas, text = list(bulk.rows), bulk.columns - 4, iter(())
    terms: list[Term] = []
    for line in text:
        words = line.split()
        if not words:
            continue
        if words[0] in TIME_VARIABLE:
            if epoch_jd is None:
                raise lines.fault(
                    f"{words[0]!r} is a time-variable term; give the key epoch, the date at which "
                    "the field is evaluated"
                )
            terms.append(read_term(lines, words, max_degree, sigmas, version == "icgem2.0"))
            continue
        if words[0] != "gfc":
            raise lines.fault(f"expected a row 'gfc', got {words[0]!r}")
        if sigmas is None:
            # A head that does not say is decided by its first row.
            if len(words) - 1 not in (4, 6, 8):
                raise lines.fault(f"expected 4, 6 or 8 columns after 'gfc', got {len(words) - 1}")
            sigmas = len(words) - 5
        if len(words) - 1 != 4 + sigmas:
            raise lines.fault(
                f"expected {4 + sigmas} columns after 'gfc' (errors: {errors or 'not stated'}), "
                f"got {len(words) - 1}"
            )
        rows.append(lines.coefficient(words[1:], max_degree))
    if epoch_jd is not None:
        if not terms:
            raise lines.fault("no time-variable term; leave the key epoch out", line=0)
        static = frozenset((row.n, row.m) for row in rows)
        rows.extend(evaluate_terms(lines, terms, epoch_jd, static))
    lines.check_degrees(bulk.degrees if bulk else (row.n for row in rows), max_degree)
    if kept_degree is not None:
        rows = [row for row in rows if row.n <= kept_degree]
    return CoefficientTable(
        name=head.words.get("modelname") or Path(path).stem,
        gm_m3_s2=gm,
        reference_radius_m=radius,
        max_degree=max_degree,
        normalisation=None if norm is None else _NORMALISATIONS[norm],
        tide_system=tide,
        rows=tuple(rows),
        passed_over=tuple(_list_passed_over(head, errors, sigmas or 0, epoch)),
    )


def _list_passed_over(
    head: _Head, errors: str | None, sigmas: int, epoch: str | None
) -> Iterator[str]:
    """Return what a head states, or announces for the rows, that a table does not hold."""
    if sigmas:
        yield f"kind of the standard deviations ({errors or 'not stated'})"
    if sigmas == 4:
        yield "second pair of standard deviations (formal)"
    if epoch is not None:
        yield f"change with time (evaluated at {epoch})"
    if head.others:
        shown = ", ".join(head.others[:_MOST_KEYS_SHOWN])
        more = len(head.others) - _MOST_KEYS_SHOWN
        yield f"unknown keys of the head ({shown}{f' and {more} more' if more > 0 else ''})"
    if head.has_comments:
        yield "comments or further keys before the coefficients"


@dataclass(frozen=True)
class _Head:
    """Keys of the head, their first words, all words and lines, and other keys."""

    lines: LineReader
    words: dict[str, str]
    numbers: dict[str, int]
    phrases: dict[str, str]
    others: tuple[str, ...] = ()
    has_comments: bool = False

    def line(self, key: str) -> int:
        return self.numbers[key]

    def word(self, key: str) -> str:
        if key not in self.words:
            raise self.lines.fault(f"the head has no {key}", line=0)
        return self.words[key]

    def choice(self, key: str, choices: tuple[str, ...]) -> str | None:
        word = self.words.get(key)
        if word is not None and word not in choices:
            raise self.lines.fault(
                f"{key}: expected {' | '.join(choices)}, got {word!r}", self.line(key)
            )
        return word

    def tide_system(self) -> str | None:
        """Return the tide system, which is written with a low line, a hyphen, a blank or none."""
        if "tide_system" not in self.words:
            return None
        phrase = self.phrases["tide_system"].lower().replace("-", " ").replace("_", " ").split()
        for system in _TIDE_SYSTEMS:
            parts = system.split("_")
            if phrase[: len(parts)] == parts or phrase[:1] == ["".join(parts)]:
                return system
        raise self.lines.fault(
            f"tide_system: expected {' | '.join(_TIDE_SYSTEMS)}, got {self.words['tide_system']!r}",
            self.line("tide_system"),
        )

    def positive(self, key: str) -> float:
        word = self.word(key)
        return self.lines.positive(word, key, self.line(key))

    def integer(self, key: str) -> int:
        word = self.word(key)
        return self.lines.integer(word, key, self.line(key))


def _read_head(lines: LineReader, text: Iterator[str]) -> _Head:
    head = _Head(lines, {}, {}, {})
    repeated: InputError | None = None
    comments = False
    others: dict[str, None] = {}
    for line in text:
        words = line.split()
        if not words:
            continue
        key = words[0]
        if key == "begin_of_head":
            # What stands before is free text, whose lines may well begin with a key.
            comments |= bool(head.words or others)
            for part in (head.words, head.numbers, head.phrases, others):
                part.clear()
            repeated = None
        elif key == "end_of_head":
            if repeated is not None:
                raise repeated
            return replace(head, others=tuple(others), has_comments=comments)
        elif key in _KEYS and len(words) > 1:
            if key in head.words:
                # Not raised yet: all of this may still turn out to be free text.
                repeated = repeated or lines.fault(f"{key} stands in line {head.line(key)} already")
                continue
            head.words[key] = words[1]
            head.numbers[key] = lines.number
            head.phrases[key] = " ".join(words[1:])
            comments |= len(words) > 2 and key != "tide_system"
        elif len(words) == 2 and _KEYWORD.fullmatch(key):
            others[key] = None
        else:
            comments = True
    raise lines.fault("no line 'end_of_head': is this an ICGEM file?", line=0)
