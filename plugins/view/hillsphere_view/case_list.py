"""The cases of a campaign: filtered, and a page at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.errors import InputError, PluginError
from hillsphere.cases.case_classes import case_class, decided_failures, is_undecided
from hillsphere.plugins import Registry
from hillsphere.products import CaseTable
from hillsphere.products.columns import Columns
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere_view.run_folders import MissingError

__all__ = ["PAGE_ROWS", "CaseFilter", "CasePage", "campaign_names", "case_table", "select_cases"]

PAGE_ROWS = 100
"""Cases on a page: what can be looked through."""
CLASSES = ("success", "failure", "undecided")
_TABLE = "hillsphere.products:CaseTable"
"""Public name of the product of campaigns."""


@dataclass(frozen=True)
class CaseFilter:
    """Which cases are listed.

    Parameters
    ----------
    kind : str
        One of `CLASSES`, or ``""`` for all.
    status : str
        How they ended; ``""`` for all.
    metric : str
        Metric or input that must lie in a range; ``""`` for none.
    low, high : float
        The range in SI; infinite for an open end.
    """

    kind: str = ""
    status: str = ""
    metric: str = ""
    low: float = -math.inf
    high: float = math.inf

    @classmethod
    def read(cls, query: Mapping[str, str]) -> CaseFilter:
        """Read a filter from a query; `InputError` if a bound is no number."""
        kind = query.get("class", "")
        if kind not in ("", *CLASSES):
            raise InputError(f"there is no class {kind[:40]!r}")
        bounds = []
        for key, default in (("low", -math.inf), ("high", math.inf)):
            text = query.get(key, "").strip()
            try:
                bounds.append(float(text) if text else default)
            except ValueError:
                raise InputError(f"{text[:40]!r} is no number") from None
            if math.isnan(bounds[-1]):
                raise InputError(f"{text!r} is no number")
        return cls(kind, query.get("status", ""), query.get("metric", ""), *bounds)


@dataclass(frozen=True)
class CasePage:
    """A page of cases.

    Parameters
    ----------
    rows : ndarray of int
        Indices into the table.
    number, pages : int
        The page, from 1, and how many there are.
    matching : int
        Cases that pass the filter.
    """

    rows: NDArray[np.int64]
    number: int
    pages: int
    matching: int


def campaign_names(manifest: Mapping[str, Any], registry: Registry) -> list[str]:
    """Return the finished campaigns of a run: the stages whose type yields a `CaseTable`."""
    names = []
    for name, table in manifest["mission"].get("stage", {}).items():
        try:
            spec: Any = registry.get("stage", table["type"]).load_spec()
        except (InputError, PluginError, KeyError):
            continue  # of a plugin that is not installed here
        produced = (getattr(spec, "produces", ""), *getattr(spec, "provides", ()))
        if _TABLE in produced and manifest["stages"].get(name, {}).get("product"):
            names.append(name)
    return names


def case_table(run: EarlierRun, stage: str) -> CaseTable:
    """Return the table of a campaign.

    Raises
    ------
    MissingError
        If the stage has no product.
    InputError
        If its file is not the one that the run wrote, or holds something else.
    """
    digest = run.manifest["stages"].get(stage, {}).get("product")
    if not digest:
        raise MissingError(f"run {run.directory.path.name!r} has no finished campaign {stage!r}")
    return _load(run.directory.path, stage, digest)


@lru_cache(maxsize=2)  # of a million cases one has 8 GB at worst
def _load(path: Path, stage: str, digest: str) -> CaseTable:
    table: CaseTable = EarlierRun.open(path).product(stage, CaseTable)
    if not _is_sound(table):
        raise InputError(f"{path / stage}.npz: is not the table of a campaign")
    return table


_KINDS = {"case": "iu", "draw": "iu", "point": "iu", "message_case": "iu", "failed": "b",
          "status": "U", "cause": "U", "values": "f", "input_values": "f"}  # fmt: skip
"""Kinds of the elements of a table's arrays."""


def _is_sound(table: CaseTable) -> bool:
    """Return whether the fields fit each other; a stranger may have written them."""
    for name, kinds in _KINDS.items():
        array = getattr(table, name)
        if not isinstance(array, np.ndarray | Columns) or array.dtype.kind not in kinds:
            return False
    texts = (table.metrics, table.units, table.inputs, table.input_units, table.messages,
             table.point_labels)  # fmt: skip
    if not all(isinstance(row, tuple) and all(isinstance(t, str) for t in row) for row in texts):
        return False
    count = (table.case.size,)
    rows = (table.case, table.draw, table.point, table.failed, table.status, table.cause)
    return (
        all(array.shape == count for array in rows)
        and table.values.shape == (len(table.metrics), *count)
        and table.input_values.shape == (len(table.inputs), *count)
        and table.message_case.shape == (len(table.messages),)
        and len(table.units) == len(table.metrics)
        and len(table.input_units) == len(table.inputs)
    )


def select_cases(table: CaseTable, wanted: CaseFilter, page: int) -> CasePage:
    """Return a page of the cases that pass a filter; beyond the last page, the last one.

    Raises
    ------
    InputError
        If the table has no such metric.
    """
    passes = np.ones(table.case.shape, dtype=bool)
    if wanted.kind == "undecided":
        passes &= is_undecided(table.status)
    elif wanted.kind:
        failed = decided_failures(table)
        passes &= failed if wanted.kind == "failure" else ~failed & ~is_undecided(table.status)
    if wanted.status:
        passes &= np.asarray(table.status == wanted.status)
    if wanted.metric:
        values = _quantity(table, wanted.metric)
        if math.isfinite(wanted.low) or math.isfinite(wanted.high):
            passes &= (values >= wanted.low) & (values <= wanted.high)
    rows = np.flatnonzero(passes)
    pages = max(1, math.ceil(rows.size / PAGE_ROWS))
    number = min(max(page, 1), pages)
    return CasePage(rows[(number - 1) * PAGE_ROWS : number * PAGE_ROWS], number, pages, rows.size)


def _quantity(table: CaseTable, name: str) -> NDArray[np.float64]:
    if name in table.metrics:
        return np.asarray(table.values[table.metrics.index(name)])
    if name in table.inputs:
        return np.asarray(table.input_values[table.inputs.index(name)])
    raise InputError(f"the campaign has no metric or input {name[:80]!r}")


def class_of(table: CaseTable, row: int) -> str:
    """Return the class of a case in words."""
    return case_class(str(table.status[row]), bool(table.failed[row]))
