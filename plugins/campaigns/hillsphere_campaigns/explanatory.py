"""What differed from case to case of a campaign: the quantities that may explain its results."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256

import numpy as np

from hillsphere.base.arrays import Array
from hillsphere.products import CaseTable

__all__ = ["Explanatory", "explanatory"]


@dataclass(frozen=True)
class Explanatory:
    """Explanatory quantities: the inputs that differ from case to case.

    Parameters
    ----------
    names, units : tuple of str
        Of the k quantities: what was swept, then the other inputs. Quantities that took the same
        value as an earlier one in every case stand for one; those that never changed, or that some
        cases did not have, are left out.
    table : CaseTable
        The cases, which hold the values.
    places : tuple of int
        Where each quantity stands among those of the table, swept ones and then inputs.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    table: CaseTable
    places: tuple[int, ...]

    def column(self, i: int) -> Array:
        """Return the values of a quantity, shape (N,)."""
        return _column(self.table, self.places[i])

    @property
    def values(self) -> Array:
        """Values of all quantities, shape (k, N)."""
        columns = [self.column(i) for i in range(len(self.names))]
        return np.array(columns).reshape(len(columns), self.table.case.size)


def _column(table: CaseTable, place: int) -> Array:
    swept = 0 if table.points is None else len(table.swept)
    if place < swept:
        assert table.points is not None
        return np.asarray(table.points[place][table.point])
    return np.asarray(table.input_values[place - swept])


def explanatory(table: CaseTable) -> Explanatory:
    """Return what differed from case to case, each quantity once."""
    swept = table.points is not None
    names = (*(table.swept if swept else ()), *table.inputs)
    units = (*(table.swept_units if swept else ()), *table.input_units)
    seen: set[bytes] = set()
    kept = []
    for i in range(len(names)):
        row = _column(table, i)
        key = sha256((row + 0.0).tobytes()).digest()  # −0 is 0
        if np.isfinite(row).all() and (row != row[:1]).any() and key not in seen:
            kept.append(i)
            seen.add(key)
    return Explanatory(
        tuple(names[i] for i in kept), tuple(units[i] for i in kept), table, tuple(kept)
    )
