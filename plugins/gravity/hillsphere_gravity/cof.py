"""Gravity fields in the format of GMAT (.cof): POTFIELD, RECOEF, END [1]_.

References
----------
.. [1] NASA, General Mission Analysis Tool, src/base/util/GravityFileUtil.cpp, ReadCofFile: comments
   begin with ``C``; degree and order stand in columns 9 to 11 and 12 to 14, C in 18 to 38, S in
   39 to 59; GM in m³/s² and the radius in m follow an integer. GMAT takes all coefficients as
   normalised. It reads that integer and the last number of POTFIELD and uses neither.
"""

from __future__ import annotations

import re
from pathlib import Path

from hillsphere.formats.coefficients import Coefficient, CoefficientTable, LineReader

__all__ = ["read_cof"]

_C_FROM, _S_FROM = 17, 38
"""Characters of a line before C and S [1]_."""

# Degrees and orders stand in columns of three characters, which leave no blank from 100 on.
_BLANKS = re.compile(r"(POTFIELD|RECOEF)\s+(\d{1,4})\s+(\d{1,4})\s+(.*)", re.ASCII)
_COLUMNS = re.compile(r"(POTFIELD|RECOEF {2})([ \d]{3})([ \d]{3})\s*(.*)", re.ASCII)


def read_cof(path: str | Path) -> CoefficientTable:
    """Read a gravity field.

    Parameters
    ----------
    path : str or Path
        The file: comment lines, which begin with ``C``, ``#`` or ``%``; one line ``POTFIELD``
        with degree, order, an integer, GM (m³/s²), reference radius (m) and a number of which GMAT
        does not say the meaning, and which must be 1; lines ``RECOEF`` with degree, order, C and
        S, which may be left out where the order is 0; ``END``.

    Returns
    -------
    CoefficientTable
        SI. Such a file states neither its normalisation nor its tide system.

    Raises
    ------
    InputError
        Names file and line: a malformed or doubled row, no line ``POTFIELD`` or ``END``, a missing
        degree.
    """
    lines = LineReader(Path(path))
    rows: list[Coefficient] = []
    head: tuple[float, float, int, int] | None = None
    has_comments = False
    for line in lines:
        if not line.strip():
            continue
        if line.split() == ["END"]:
            break
        if line.startswith(("C", "#", "%")):
            has_comments = True
            continue
        keyword, n, m, values = _split(lines, line)
        if keyword == "POTFIELD":
            if head is not None:
                raise lines.fault("a second line POTFIELD")
            head = _read_head(lines, n, m, values)
            continue
        if head is None:
            raise lines.fault("RECOEF before POTFIELD, which gives GM and reference radius")
        if len(values) == 1 and len(line.rstrip()) > _S_FROM:
            # Numbers as wide as their columns leave no blank between them.
            values = [line[_C_FROM:_S_FROM].strip(), line[_S_FROM:].strip()]
        if len(values) == 1 and m.strip(" 0") == "":
            values = [*values, "0"]
        if len(values) != 2:
            raise lines.fault(f"expected degree, order, C and S, got {2 + len(values)} columns")
        row = lines.coefficient([n.strip(), m.strip(), *values], head[2])
        if row.m > head[3]:
            raise lines.fault(f"order {row.m} is beyond the {head[3]} of POTFIELD")
        rows.append(row)
    else:
        raise lines.fault("no line END: the file is torn, or no .cof file", line=0)
    if head is None:
        raise lines.fault("no line POTFIELD: is this a .cof file?", line=0)
    lines.check_degrees((row.n for row in rows), head[2])
    return CoefficientTable(
        name=Path(path).stem,
        gm_m3_s2=head[0],
        reference_radius_m=head[1],
        max_degree=head[2],
        normalisation=None,
        tide_system=None,
        rows=tuple(rows),
        passed_over=("comments",) if has_comments else (),
    )


def _split(lines: LineReader, line: str) -> tuple[str, str, str, list[str]]:
    match = _BLANKS.fullmatch(line.strip()) or _COLUMNS.fullmatch(line.rstrip())
    if match is None:
        raise lines.fault(
            f"expected POTFIELD or RECOEF with degree, order and numbers, got {line.strip()!r}"
        )
    keyword, n, m, rest = match.groups()
    return keyword.rstrip(), n, m, rest.split()


def _read_head(
    lines: LineReader, n: str, m: str, values: list[str]
) -> tuple[float, float, int, int]:
    """Return GM, radius, degree and order."""
    if len(values) not in (3, 4):
        raise lines.fault(
            "expected POTFIELD, degree, order, an integer, GM, reference radius and perhaps "
            f"1, got {3 + len(values)} columns"
        )
    lines.integer(values[0], "number before GM")
    gm = lines.positive(values[1], "GM")
    radius = lines.positive(values[2], "reference radius")
    if len(values) == 4 and lines.real(values[3], "number after the radius") != 1.0:
        raise lines.fault(f"the number after the radius must be 1, got {values[3]}")
    degree, order = (lines.integer(w.strip(), k) for w, k in ((n, "degree"), (m, "order")))
    return gm, radius, degree, order
