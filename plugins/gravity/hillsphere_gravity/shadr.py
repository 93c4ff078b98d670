"""Gravity fields in the format of PDS SHADR tables [1]_.

References
----------
.. [1] R. A. Simpson, Software Interface Specification: Spherical Harmonics ASCII Data Record
   (SHADR), version 2.0.2, 1999.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from hillsphere.formats.bulk import SeriesRows, parse_series
from hillsphere.formats.coefficients import Coefficient, CoefficientTable, LineReader
from hillsphere_gravity.coefficient_rows import split_columns

__all__ = ["read_shadr"]

_HEAD = (
    "reference radius, GM, its uncertainty, degree, order, normalisation state, reference "
    "longitude, reference latitude"
)
_LEAST, _MOST = 4, 8
"""Columns of the header. What is left out at its end is taken as not stated: the order is then the
degree, the reference longitude and latitude 0."""
_NORMALISATIONS: dict[int, Literal["full", "none"]] = {0: "none", 1: "full"}


def read_shadr(path: str | Path, kept_degree: int | None = None) -> CoefficientTable:
    """Read a gravity field.

    Parameters
    ----------
    path : str or Path
        The table file (without its detached label): one header row of eight columns, or fewer
        where the last ones are left out, then rows of degree, order, C, S and perhaps their
        standard deviations, separated by commas or blanks. Radius in km, GM in km³/s².
    kept_degree : int, optional
        Rows of higher degree are checked and left out, which saves memory.

    Returns
    -------
    CoefficientTable
        SI. A SHADR table does not state its tide system, and one of less than six columns in its
        header not its normalisation. An uncertainty of GM is in `passed_over`.

    Raises
    ------
    InputError
        Names file and line: a malformed header, a topography, a normalisation other than full or
        none, a reference longitude or latitude other than 0, a malformed or doubled row, a missing
        degree.
    """
    lines = LineReader(Path(path))
    header: list[str] = []
    rows: list[Coefficient] = []
    radius_km = gm_km3_s2 = uncertainty = 0.0
    max_degree = max_order = 0
    normalisation: Literal["full", "none"] | None = None
    bulk: SeriesRows | None = None
    for line in lines:
        if not line.strip():
            continue
        words = split_columns(line)
        if header:
            if len(words) not in (4, 6):
                raise lines.fault(
                    "expected degree, order, C, S and perhaps two uncertainties; got "
                    f"{len(words)} columns"
                )
            row = lines.coefficient(words, max_degree)
            if row.m > max_order:
                raise lines.fault(f"order {row.m} is beyond the {max_order} of the header")
            rows.append(row)
            continue
        header = words
        if not _LEAST <= len(words) <= _MOST:
            raise lines.fault(
                f"expected a header of {_MOST} columns ({_HEAD}), of which the last may be left "
                f"out, but not the first {_LEAST}; got {len(words)}"
            )
        radius_km = lines.positive(words[0], "reference radius")
        gm_km3_s2 = lines.positive(words[1], "GM")
        uncertainty = lines.real(words[2], "uncertainty of GM")
        if gm_km3_s2 == 1.0 and uncertainty == 0.0:
            # So the format marks a topography; read as gravity it would pass without a word.
            raise lines.fault(
                "constant 1 with uncertainty 0 marks a topography, not a gravity field"
            )
        max_degree = lines.integer(words[3], "degree")
        max_order = lines.integer(words[4], "order") if len(words) > 4 else max_degree
        if len(words) > 5:
            state = lines.integer(words[5], "normalisation state")
            if state not in _NORMALISATIONS:
                raise lines.fault(f"normalisation state must be 0 (none) or 1 (full), got {state}")
            normalisation = _NORMALISATIONS[state]
        for name, word in zip(("longitude", "latitude"), words[6:], strict=False):
            if lines.real(word, f"reference {name}") != 0.0:
                raise lines.fault(
                    f"reference {name} must be 0, got {word}; turn the model with a sum"
                )
        bulk = parse_series(
            lines, widths=(4, 6), max_degree=max_degree, max_order=max_order,
            kept_degree=kept_degree,
        )  # fmt: skip
        if bulk is not None:
            break
    if not header:
        raise lines.fault("the file is empty", line=0)
    lines.check_degrees(bulk.degrees if bulk else (row.n for row in rows), max_degree)
    kept = bulk.rows if bulk else rows
    return CoefficientTable(
        name=Path(path).stem,
        gm_m3_s2=gm_km3_s2 * 1e9,
        reference_radius_m=radius_km * 1e3,
        max_degree=max_degree,
        normalisation=normalisation,
        tide_system=None,
        rows=tuple(row for row in kept if kept_degree is None or row.n <= kept_degree),
        passed_over=(f"uncertainty of GM ({header[2]} km³/s²)",) if uncertainty else (),
    )
