"""Gravity fields as files: ICGEM and PDS SHADR, read and written.

Coefficients are written with 17 significant digits, which give the same double back. So do GM and
the reference radius wherever a decimal number in the unit of the file exists that does.
"""

from __future__ import annotations

from decimal import Decimal
from math import inf, nextafter
from pathlib import Path

from hillsphere.errors import InputError
from hillsphere.formats.coefficients import CoefficientTable
from hillsphere.formats.specs import FileFormatSpec
from hillsphere_gravity.coefficient_rows import split_columns
from hillsphere_gravity.icgem import read_icgem
from hillsphere_gravity.shadr import read_shadr

__all__ = ["Icgem", "Shadr"]

_BYTE_ORDER_MARK = "ï»¿"
_NORMS = {"full": "fully_normalized", "none": "unnormalized"}


class Icgem:
    """Static gravity fields of ICGEM (.gfc); GM in m³/s², radius in m.

    Parameters
    ----------
    spec : FileFormatSpec
        Without parameters.
    """

    content = "gravity field"
    suffixes = (".gfc",)

    def __init__(self, spec: FileFormatSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return whether a line ends the head, or the head has the keys of the format."""
        beginning = beginning.removeprefix(_BYTE_ORDER_MARK)
        first = [line.split(maxsplit=1)[0] for line in beginning.split("\n") if line.split()]
        return "end_of_head" in first or {"product_type", "max_degree"} <= set(first)

    def read(self, path: Path) -> tuple[CoefficientTable, tuple[str, ...]]:
        """Read a field; see `hillsphere_gravity.icgem.read_icgem`."""
        table = read_icgem(path)
        return table, table.passed_over

    def write(self, content: CoefficientTable) -> tuple[str, tuple[str, ...]]:
        """Return a field as text.

        Everything that a `CoefficientTable` holds is kept, but that blanks in a name become low
        lines. Standard deviations are called formal, since a table does not say of which kind they
        are.
        """
        errors = _has_errors(content)
        head = {
            "product_type": "gravity_field",
            "modelname": "_".join(content.name.split()) or "unnamed",
            "earth_gravity_constant": repr(content.gm_m3_s2),
            "radius": repr(content.reference_radius_m),
            "max_degree": str(content.max_degree),
            "errors": "formal" if errors else "no",
        }
        if content.normalisation is not None:
            head["norm"] = _NORMS[content.normalisation]
        if content.tide_system is not None:
            head["tide_system"] = content.tide_system
        lines = ["begin_of_head", *(f"{key:23} {value}" for key, value in head.items())]
        lines.append("end_of_head")
        for row in content.rows:
            values = row[2:6] if errors else row[2:4]
            numbers = "".join(f" {value:23.16E}" for value in values)
            lines.append(f"gfc {row.n:5d} {row.m:5d}{numbers}")
        return "\n".join(lines) + "\n", ()


class Shadr:
    """Gravity fields of the Planetary Data System (SHADR tables); GM in km³/s², radius in km.

    Parameters
    ----------
    spec : FileFormatSpec
        Without parameters.
    """

    content = "gravity field"
    suffixes = (".shadr", ".sha", ".tab")

    def __init__(self, spec: FileFormatSpec) -> None:
        self.spec = spec

    def recognises(self, beginning: str) -> bool:
        """Return whether the first line is a header of eight numbers.

        Rows of other formats may have eight numbers between blanks, but hardly the three integers.
        """
        beginning = beginning.removeprefix(_BYTE_ORDER_MARK)
        lines = [line for line in beginning.split("\n") if line.strip()]
        words = split_columns(lines[0].strip()) if lines else []
        if len(words) != 8 or not all(map(_is_number, words)):
            return False
        return "," in lines[0] or (words[3].isdigit() and words[4].isdigit() and words[5] in "01")

    def read(self, path: Path) -> tuple[CoefficientTable, tuple[str, ...]]:
        """Read a field; see `hillsphere_gravity.shadr.read_shadr`."""
        table = read_shadr(path)
        return table, table.passed_over

    def write(self, content: CoefficientTable) -> tuple[str, tuple[str, ...]]:
        """Return a field as text, and what a table does not state: its name and tide system.

        Raises
        ------
        InputError
            If the field does not say how it is normalised; if its GM is 1 km³/s², which marks a
            topography in this format where its uncertainty is not known.
        """
        if content.normalisation is None:
            raise InputError(
                f"{content.name}: does not say its normalisation, which a SHADR table must state; "
                "add the line 'norm fully_normalized' or 'norm unnormalized' to its head"
            )
        gm_km3_s2 = _unscale(content.gm_m3_s2, 9)
        if gm_km3_s2 == 1.0:
            raise InputError(
                f"{content.name}: a SHADR table with GM = 1 km³/s² and no uncertainty would be "
                "read as a topography"
            )
        order = max((row.m for row in content.rows), default=0)
        normalised = 1 if content.normalisation == "full" else 0
        radius_km = _unscale(content.reference_radius_m, 3)
        lines = [
            f"{radius_km:23.16E},{gm_km3_s2:23.16E},{0.0:23.16E},{content.max_degree:5d},"
            f"{order:5d},{normalised:5d},{0.0:23.16E},{0.0:23.16E}"
        ]
        lines += [
            f"{row.n:5d},{row.m:5d}," + ",".join(f"{value:23.16E}" for value in row[2:6])
            for row in content.rows
        ]
        lost = [f"name of the model ({content.name})"]
        if content.tide_system is not None:
            lost.append(f"tide system ({content.tide_system})")
        return "\r\n".join(lines) + "\r\n", tuple(lost)


def _has_errors(table: CoefficientTable) -> bool:
    return any(row.sigma_c != 0.0 or row.sigma_s != 0.0 for row in table.rows)


def _unscale(value: float, power: int) -> float:
    """Return value / 10**power as the number that a reader multiplies to get the value back."""
    near = float(Decimal(repr(value)).scaleb(-power))
    for guess in (near, nextafter(near, inf), nextafter(near, -inf)):
        if guess * 10.0**power == value:
            return guess
    return near


def _is_number(text: str) -> bool:
    try:
        float(text.replace("D", "E").replace("d", "e"))
    except ValueError:
        return False
    return True
