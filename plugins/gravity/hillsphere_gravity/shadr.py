"""Gravity fields in the format of PDS SHADR tables [1]_.

References
----------
.. [1] R. A. Simpson, Software Interface Specification: Spherical Harmonics ASCII Data Record
   (SHADR), version 2.0.2, 1999.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from hillsphere.formats.coefficients import Coefficient, CoefficientTable, LineReader

__all__ = ["read_shadr"]

_HEAD = (
    "reference radius, GM, its uncertainty, degree, order, normalisation state, reference "
    "longitude, reference latitude"
)
_NORMALISATIONS: dict[int, Literal["full", "none"]] = {0: "none", 1: "full"}


def read_shadr(path: str | Path) -> CoefficientTable:
    """Read a gravity field.

    Parameters
    ----------
    path : str or Path
        The table file (without its detached label): one header row of eight columns, then rows of
        degree, order, C, S and perhaps their standard deviations, separated by commas. Radius in
        km, GM in km³/s².

    Returns
    -------
    CoefficientTable
        SI. A SHADR table does not state its tide system. An uncertainty of GM is in `passed_over`.

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
    for line in lines:
        if not line.strip():
            continue
        words = [word.strip() for word in line.rstrip(" ,").split(",")]
        if header:
            if len(words) not in (4, 6):
                raise lines.fault(
                    "expected degree, order, C, S and perhaps two uncertainties, separated by "
                    f"commas; got {len(words)} columns"
                )
            row = lines.coefficient(words, max_degree)
            if row.m > max_order:
                raise lines.fault(f"order {row.m} is beyond the {max_order} of the header")
            rows.append(row)
            continue
        header = words
        if len(words) != 8:
            raise lines.fault(f"expected a header of 8 columns ({_HEAD}), got {len(words)}")
        radius_km = lines.positive(words[0], "reference radius")
        gm_km3_s2 = lines.positive(words[1], "GM")
        uncertainty = lines.real(words[2], "uncertainty of GM")
        if gm_km3_s2 == 1.0 and uncertainty == 0.0:
            # So the format marks a topography; read as gravity it would pass without a word.
            raise lines.fault(
                "constant 1 with uncertainty 0 marks a topography, not a gravity field"
            )
        max_degree, max_order = lines.integer(words[3], "degree"), lines.integer(words[4], "order")
        state = lines.integer(words[5], "normalisation state")
        if state not in _NORMALISATIONS:
            raise lines.fault(f"normalisation state must be 0 (none) or 1 (full), got {state}")
        for name, word in zip(("longitude", "latitude"), words[6:], strict=True):
            if lines.real(word, f"reference {name}") != 0.0:
                raise lines.fault(
                    f"reference {name} must be 0, got {word}; turn the model with a sum"
                )
    if not header:
        raise lines.fault("the file is empty", line=0)
    lines.check_degrees(rows, max_degree)
    return CoefficientTable(
        name=Path(path).stem,
        gm_m3_s2=gm_km3_s2 * 1e9,
        reference_radius_m=radius_km * 1e3,
        max_degree=max_degree,
        normalisation=_NORMALISATIONS[state],
        tide_system=None,
        rows=tuple(rows),
        passed_over=(f"uncertainty of GM ({header[2]} km³/s²)",) if uncertainty else (),
    )
