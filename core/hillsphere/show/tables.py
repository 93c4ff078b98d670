"""Tables built from columns, each of which is an array of SI values.

::

    of = FieldColumns(product, "orbits")
    tabulate("Orbits", [
        of("labels", "orbit"),                                      # all is declared with the field
        column("period_h", 2 * product.half_period_s, "period", 6),           # seconds become hours
    ])

A column's unit is the suffix of its name (``_km``, ``_deg``, ``_m_s``); its values are SI and are
converted. NaN and ``None`` become blank cells.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hillsphere.products.fields import DeclaredField, Label, declared_fields, dimension_sizes
from hillsphere.show.presentation import Cell, Column, Printed, Table
from hillsphere.show.reference import ReferenceTable, beside, difference_notes, with_paper
from hillsphere.spec.units import UNITS, unit_text

__all__ = [
    "FieldColumns", "FilledColumn", "column", "finite_or_blank", "set_beside", "tabulate",
    "take_or_blank", "text_column",
]  # fmt: skip

Values: TypeAlias = NDArray[Any] | Iterable[Any]

_RATES = {f"1_{suffix}": 1.0 / factor for suffix, factor in UNITS["time"].items()}
_UNITS = {**UNITS, "rate": _RATES}
_FACTORS = {suffix: factor for units in _UNITS.values() for suffix, factor in units.items()}
_DIMENSIONS = {suffix: dimension for dimension, units in _UNITS.items() for suffix in units}
# `_min` is the least in a column's name more often than minutes; `_t` is no tonne there.
_SUFFIXES = sorted(_FACTORS.keys() - {"min", "1_min", "t"}, key=len, reverse=True)


@dataclass(frozen=True)
class FilledColumn(Column):
    """A column with its cells in the column's unit; `column` makes one from SI values.

    Parameters
    ----------
    name, unit, label, digits, interval, confidence
        As for `Column`.
    cells : tuple
        One per row.
    """

    cells: tuple[Cell, ...] = ()


def column(
    name: str, values: Values, label: str = "", digits: int = 8, *, unit: str | None = None,
    is_si: bool = True, interval: tuple[str, str] | tuple[()] = (), confidence: float | None = None,
) -> FilledColumn:  # fmt: skip
    """Return a column of numbers.

    Parameters
    ----------
    name : str
        Key of its cells, with the unit as suffix.
    values : ndarray, shape (K,), or iterable of K numbers
        SI; NaN and ``None`` become blank. Integers stay integers where nothing is converted.
    label, digits
        As for `Column`.
    unit : str, optional
        Unit in the report (``"m/s"``). By default it is the suffix of the name, or ``"-"`` without
        one. Minutes must be given, since ``_min`` is read as minimum.
    is_si : bool
        False for values that are in the column's unit already.
    interval, confidence
        As for `Column`.

    Returns
    -------
    FilledColumn
        The column in its unit. Values in a unit that `hillsphere.spec.units` does not list
        (``"dB"``, ``"%"``) are not converted.

    Raises
    ------
    ValueError
        If the values do not form a vector.
    """
    if unit is None:
        suffix = _suffix(name)
        unit = unit_text(suffix) or "-"
    else:
        suffix = unit.replace("/", "_").replace("²", "2").replace("³", "3")
    factor = _FACTORS.get(suffix, 1.0) if is_si else 1.0
    cells = _cells(name, values, factor)
    return FilledColumn(name, unit, label, digits, interval, confidence, cells)


def text_column(name: str, values: Values, label: str = "") -> FilledColumn:
    """Return a column of strings or truth values, K of them, ``None`` for a blank.

    Parameters
    ----------
    name : str
        Name of the column in files.
    values : Values
        K values.
    label : str
        Heading; by default the name.

    Returns
    -------
    FilledColumn
        The column, for `tabulate`.
    """
    return replace(column(name, values, label, unit="-"), unit="")


def tabulate(title: str, columns: Sequence[FilledColumn], notes: Sequence[str] = ()) -> Table:
    """Return a table of columns of equal length.

    Parameters
    ----------
    title, notes
        As for `Table`.
    columns : sequence of FilledColumn
        The columns in order.

    Returns
    -------
    Table
        The table, with one row per cell of a column.

    Raises
    ------
    ValueError
        If the columns differ in length.
    """
    lengths = {len(c.cells) for c in columns}
    if len(lengths) > 1:
        counts = ", ".join(f"{c.name} has {len(c.cells)}" for c in columns)
        raise ValueError(f"table {title!r}: the columns must have one length, but {counts} cells")
    names, cells = [c.name for c in columns], [c.cells for c in columns]
    rows = [dict(zip(names, row, strict=True)) for row in zip(*cells, strict=True)]
    plain = [Column(c.name, c.unit, c.label, c.digits, c.interval, c.confidence) for c in columns]
    return Table(title, plain, rows, notes)


def set_beside(
    table: Table, reference: ReferenceTable | None, *, on: str, tol: float = 0.0,
    label: str = "name",
) -> Table:  # fmt: skip
    """Return a table with a paper's values beside the computed ones, and notes on differences.

    Parameters
    ----------
    table : Table
        Computed values.
    reference : ReferenceTable or None
        Published values under the same column names; if None, the table is returned unchanged.
    on, tol
        Column by which rows are matched and its tolerance, as for
        `hillsphere.show.reference.beside`.
    label : str
        Column that names a row in the notes.

    Returns
    -------
    Table
        The table with additional ``NAME_paper`` columns.
    """
    if reference is None:
        return table
    rows = beside(table.rows, reference, on=on, tol=tol)
    notes = [*table.notes, *difference_notes(rows, reference, label=label)]
    return Table(table.title, with_paper(table.columns, rows), rows, notes)


def take_or_blank(values: NDArray[Any], index: Sequence[int] | NDArray[Any]) -> NDArray[Any]:
    """Return the values (M,) of a column at K indices, NaN where an index is −1.

    It serves rows that refer to items of another list, where some rows have no item.

    Parameters
    ----------
    values : ndarray, shape (M,)
        The column.
    index : array_like of int, shape (K,)
        Places in it, −1 for none.

    Returns
    -------
    ndarray, shape (K,)
        The values there.
    """
    return np.append(values, np.nan)[np.asarray(index, dtype=np.intp)]


def finite_or_blank(values: ArrayLike) -> NDArray[np.float64]:
    """Return values with NaN, which tables show as blank, in place of infinite ones.

    Parameters
    ----------
    values : array_like, any shape
        Numbers.

    Returns
    -------
    ndarray
        A copy, of the same shape.
    """
    given = np.asarray(values, dtype=float)
    return np.where(np.isfinite(given), given, np.nan)


class FieldColumns:
    """Columns over the declared fields of a product (`hillsphere.products.fields`).

    The rows run over dimensions of the product, the last one fastest. A field that lacks one of
    them is repeated along it, so that columns over fields of different shapes have one length.

    Parameters
    ----------
    product : object
        A product whose fields are declared.
    *rows : str
        Names of dimensions.

    Raises
    ------
    ValueError
        If the product has no such dimension.
    InputError
        If a field has another shape than its class declares.
    """

    def __init__(self, product: Any, *rows: str) -> None:
        cls: type = type(product)
        self._product, self._rows = product, rows
        self._class, self._fields = cls.__name__, declared_fields(cls)
        sizes = dimension_sizes(product)
        if missing := [name for name in rows if name not in sizes]:
            known = ", ".join(sizes)
            raise ValueError(f"{self._class} has no dimension {missing[0]!r}; it has {known}")
        self._shape = tuple(sizes[name] for name in rows)

    def __call__(
        self, field: str, name: str = "", label: str | None = None, digits: int | None = None
    ) -> FilledColumn:
        """Return the column of a field; its dimensions must be among those of the rows.

        Parameters
        ----------
        field : str
            Name of the field.
        name : str
            Name of the column; by default the field's name with the unit of its label. It must end
            in a unit of the same dimension.
        label : str, optional
            Heading; by default the field's label.
        digits : int, optional
            Significant digits; by default those of the field's label.

        Returns
        -------
        FilledColumn
            One cell per row.

        Raises
        ------
        ValueError
            If there is no such field; if one of its dimensions is not among those of the rows; if
            its unit is neither that of the column's name nor the SI unit of the same dimension.
        """
        declared = self._declared(field)
        dimensions = declared.shape.dimensions if declared.shape else ()
        return self._column(
            declared, getattr(self._product, field), dimensions, name, label, digits
        )

    def split(self, field: str, **words: str) -> list[FilledColumn]:
        """Return one column per entry of a field's first axis.

        Parameters
        ----------
        field : str
            Name of the field.
        **words : str
            One per entry: the prefix of the column's name, and the word before the field's label.
            ``min="lowest"`` of ``altitude_m`` gives ``min_altitude_km``, "lowest altitude". It is a
            prefix because ``_min`` before a unit reads as minutes.

        Returns
        -------
        list of FilledColumn
            The columns in the order of the words.

        Raises
        ------
        ValueError
            As for a single column; also if the numbers of words and entries differ.
        """
        declared = self._declared(field)
        values, mark = getattr(self._product, field), _label(declared)
        if not declared.shape or len(values) != len(words):
            raise ValueError(
                f"{self._class}.{field} has {len(values)} entries, but {len(words)} words are given"
            )
        stem, unit = self._names(declared)
        return [
            self._column(
                declared, part, declared.shape.dimensions[1:],
                f"{key}_{stem}_{unit}".removesuffix("_"), f"{word} {mark.text}", None,
            )
            for part, (key, word) in zip(values, words.items(), strict=True)
        ]  # fmt: skip

    def spread(self, values: Any, *dimensions: int | str) -> NDArray[Any]:
        """Repeat values over some of the rows' dimensions to one value per row.

        Parameters
        ----------
        values : ndarray or tuple
            One axis per dimension; a scalar without any.
        *dimensions : str
            Names of its axes, each one of the rows' dimensions.

        Returns
        -------
        ndarray, shape (K,)
            Values of a column, for `column` and `text_column`.

        Raises
        ------
        ValueError
            If the values have another number of axes.
        """
        # Items of a tuple keep their types; numpy would convert them to a common one.
        array = values if isinstance(values, np.ndarray) else np.array(values, dtype=object)
        if array.ndim != len(dimensions):
            given = ", ".join(map(str, dimensions)) or "no dimension"
            raise ValueError(f"values have {array.ndim} axes, but {given} declared for them")
        order = [dimensions.index(name) for name in self._rows if name in dimensions]
        size = iter(np.shape(array.transpose(order)))
        shape = [next(size) if name in dimensions else 1 for name in self._rows]
        return np.broadcast_to(array.transpose(order).reshape(shape), self._shape).ravel()

    def _declared(self, field: str) -> DeclaredField:
        if field not in self._fields:
            raise ValueError(f"{self._class} has no field {field!r}")
        return self._fields[field]

    def _names(self, declared: DeclaredField) -> tuple[str, str]:
        """Return the stem of a field's columns and the suffix of their unit."""
        own = _suffix(declared.name)
        return declared.name.removesuffix(own).removesuffix("_"), _label(declared).unit or own

    def _column(
        self, declared: DeclaredField, values: Any, dimensions: Sequence[int | str],
        name: str, label: str | None, digits: int | None,
    ) -> FilledColumn:  # fmt: skip
        if not set(dimensions) <= set(self._rows):
            raise ValueError(
                f"{self._class}.{declared.name} with the shape {declared.shape} is no column over "
                f"{', '.join(self._rows)}"
            )
        stem, unit = self._names(declared)
        name = name or f"{stem}_{unit}".removesuffix("_")
        own, shown = _suffix(declared.name), _suffix(name)
        if not declared.is_text and _DIMENSIONS.get(own, own) != _DIMENSIONS.get(shown, shown):
            raise ValueError(
                f"column {name!r} over {self._class}.{declared.name}: its name must end in a unit "
                "of the same dimension"
            )
        is_si = _FACTORS.get(own, 1.0) == 1.0
        if not is_si and own != shown:
            raise ValueError(
                f"column {name!r} over {self._class}.{declared.name}: a field that is not SI is "
                "shown in its own unit only"
            )
        mark = _label(declared)
        text = mark.text if label is None else label
        cells = self.spread(values, *dimensions)
        if declared.is_text:
            return text_column(name, cells, text)
        digits = mark.digits if digits is None else digits
        return column(name, cells, text, digits, is_si=is_si)


def _label(declared: DeclaredField) -> Label:
    return declared.label or Label("")


def _suffix(name: str) -> str:
    """Return the unit suffix of a column or field, ``""`` for none."""
    return next((suffix for suffix in _SUFFIXES if name.endswith(f"_{suffix}")), "")


def _cells(name: str, values: Values, factor: float) -> tuple[Cell, ...]:
    items = values if isinstance(values, np.ndarray) else list(values)
    if np.ndim(items) != 1:
        raise ValueError(f"column {name!r}: values must be a vector, got {np.ndim(items)} axes")
    return tuple(_cell(value, factor) for value in items)


def _cell(value: Any, factor: float) -> Cell:
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | str | Printed):
        return value
    if factor != 1.0:
        # Divided by 1000 for km, multiplied by 1000 for mm: these are exact, 0.001 is not, and the
        # result is rounded only once. (π/180 is exact neither way.)
        value = value / factor if factor > 1.0 else value * (1.0 / factor)
    return None if isinstance(value, float) and math.isnan(value) else value
