"""Static gravity fields in the format of ICGEM (.gfc) [1]_.

References
----------
.. [1] International Centre for Global Earth Models, The ICGEM-format, versions 1.0 and 2.0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from hillsphere.base.errors import InputError
from hillsphere.formats.coefficients import Coefficient, CoefficientTable, LineReader

__all__ = ["read_icgem"]

_KEYS = (
    "product_type", "modelname", "earth_gravity_constant", "gravity_constant", "radius",
    "max_degree", "norm", "tide_system", "errors",
)  # fmt: skip
_NORMALISATIONS: dict[str, Literal["full", "none"]] = {
    "fully_normalized": "full",
    "unnormalized": "none",
}
_TIDE_SYSTEMS = ("tide_free", "zero_tide", "mean_tide", "unknown")
_ERROR_COLUMNS = {"no": 0, "calibrated": 2, "formal": 2, "calibrated_and_formal": 4}
_TIME_VARIABLE = ("gfct", "trnd", "dot", "acos", "asin")


def read_icgem(path: str | Path) -> CoefficientTable:
    """Read a static gravity field.

    Parameters
    ----------
    path : str or Path
        The file; its ``product_type`` must be ``gravity_field``.

    Returns
    -------
    CoefficientTable
        SI. Of two pairs of standard deviations the first, the calibrated one, is kept; this and
        every other part of the file that is not kept is in `passed_over`.

    Raises
    ------
    InputError
        Names file and line: a head that lacks a key, a time-variable row (``gfct``, ``trnd``,
        ``dot``, ``acos``, ``asin``), a malformed or doubled row, a missing degree.
    """
    lines = LineReader(Path(path))
    text = iter(lines)
    head = _read_head(lines, text)
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
    tide = head.choice("tide_system", _TIDE_SYSTEMS)
    errors = head.choice("errors", tuple(_ERROR_COLUMNS)) or "no"

    rows: list[Coefficient] = []
    for line in text:
        words = line.split()
        if not words:
            continue
        if words[0] in _TIME_VARIABLE:
            raise lines.fault(
                f"{words[0]!r} is a time-variable term; only static fields (rows 'gfc') are read: "
                "evaluate the model at your epoch first"
            )
        if words[0] != "gfc":
            raise lines.fault(f"expected a row 'gfc', got {words[0]!r}")
        columns = 4 + _ERROR_COLUMNS[errors]
        if len(words) - 1 != columns:
            raise lines.fault(
                f"expected {columns} columns after 'gfc' (errors: {errors}), got {len(words) - 1}"
            )
        rows.append(lines.coefficient(words[1:], max_degree))
    lines.check_degrees(rows, max_degree)
    return CoefficientTable(
        name=head.words.get("modelname") or Path(path).stem,
        gm_m3_s2=gm,
        reference_radius_m=radius,
        max_degree=max_degree,
        normalisation=None if norm is None else _NORMALISATIONS[norm],
        tide_system=tide,
        rows=tuple(rows),
        passed_over=tuple(_list_passed_over(head, errors)),
    )


def _list_passed_over(head: _Head, errors: str) -> Iterator[str]:
    """Return what a head states, or announces for the rows, that a table does not hold."""
    if _ERROR_COLUMNS[errors]:
        yield f"kind of the standard deviations ({errors})"
    if errors == "calibrated_and_formal":
        yield "second pair of standard deviations (formal)"
    if head.has_comments:
        yield "comments or further keys before the coefficients"


@dataclass(frozen=True)
class _Head:
    """Keys of the head, their first words and lines."""

    lines: LineReader
    words: dict[str, str]
    numbers: dict[str, int]
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

    def positive(self, key: str) -> float:
        word = self.word(key)
        return self.lines.positive(word, key, self.line(key))

    def integer(self, key: str) -> int:
        word = self.word(key)
        return self.lines.integer(word, key, self.line(key))


def _read_head(lines: LineReader, text: Iterator[str]) -> _Head:
    head = _Head(lines, {}, {})
    repeated: InputError | None = None
    others = False
    for line in text:
        words = line.split()
        if not words:
            continue
        key = words[0]
        if key == "begin_of_head":
            # What stands before is free text, whose lines may well begin with a key.
            others |= bool(head.words)
            head.words.clear()
            head.numbers.clear()
            repeated = None
        elif key == "end_of_head":
            if repeated is not None:
                raise repeated
            return replace(head, has_comments=others)
        elif key in _KEYS and len(words) > 1:
            if key in head.words:
                # Not raised yet: all of this may still turn out to be free text.
                repeated = repeated or lines.fault(f"{key} stands in line {head.line(key)} already")
                continue
            head.words[key] = words[1]
            head.numbers[key] = lines.number
            others |= len(words) > 2
        else:
            others = True
    raise lines.fault("no line 'end_of_head': is this an ICGEM file?", line=0)
