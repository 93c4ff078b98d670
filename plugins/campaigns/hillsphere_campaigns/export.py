"""A campaign's table as files for other programs: CSV, netCDF and Parquet."""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Mapping, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from hillsphere.base.arrays import Array
from hillsphere.base.atomic import output_place, replacing
from hillsphere.cases.case_classes import case_class, decided_failures, is_undecided
from hillsphere.errors import InputError, UnknownComponentError
from hillsphere.plugins import Registry
from hillsphere.products import CaseTable
from hillsphere.products.products import Bands
from hillsphere.runs.earlier_run import EarlierRun
from hillsphere.runs.rerun import one_campaign
from hillsphere_campaigns.parquet import check_pyarrow, write_parquet
from hillsphere_campaigns.result_tables import percentile

__all__ = ["export_bands_csv", "export_cases", "export_csv", "export_netcdf", "export_parquet"]

ROWS = 4096
"""Rows that are written at a time: as many as a file of a large campaign has."""


def export_csv(table: CaseTable, path: str | Path) -> None:
    """Write a campaign as CSV (RFC 4180, UTF-8), one row per case.

    Parameters
    ----------
    table : CaseTable
        The cases.
    path : str or Path
        Where; the file appears complete or not at all. A link is followed.

    Raises
    ------
    OSError
        If it cannot be written.

    Notes
    -----
    Columns ``case``, ``draw``, ``status``, ``cause``, ``class`` (success, failure, or undecided
    with the reason), ``failed`` (0 or 1), ``step_error`` if the stage estimates it; of a sweep
    ``point``, its label and what was swept; the inputs, the metrics, and ``message``. A unit stands
    behind the name, ``"dv [m/s]"``. Numbers have every digit, so that they are read back as they
    were; where there is none stands ``nan``. A name that is listed twice (an input that is a metric
    too) is told apart by ``"input "``, ``"metric "`` before it.
    """
    said = dict(zip(table.message_case.tolist(), table.messages, strict=True))
    with replacing(Path(path), follow_links=True) as stream:
        text = TextIOWrapper(stream, "utf-8", errors="backslashreplace", newline="")
        writer = csv.writer(text)
        names = column_names(table)
        writer.writerow([f"{name} [{unit}]" if unit else name for name, unit in names])
        for begin in range(0, table.case.size, ROWS):
            part = slice(begin, begin + ROWS)
            writer.writerows(zip(*column_values(table, part, said), strict=True))
        # Not closed: `replacing` syncs and renames the file.
        text.detach()


def export_bands_csv(bands: Bands, path: str | Path) -> None:
    """Write the quantiles over time of a campaign as CSV (RFC 4180, UTF-8), one row per sample.

    Parameters
    ----------
    bands : Bands
        The quantiles.
    path : str or Path
        Where; the file appears complete or not at all. A link is followed.

    Raises
    ------
    OSError
        If it cannot be written.

    Notes
    -----
    Columns ``time [s]`` (after the first sample of each case), and for each quantity its quantiles
    (``"x p5 [m]"``, ``"x p50 [m]"``) and ``"x cases"``, of how many cases they are. Numbers have
    every digit; where there is none stands ``nan``.
    """
    header, columns = ["time [s]"], [bands.time_s.tolist()]
    for i, (name, unit) in enumerate(zip(bands.names, bands.units, strict=True)):
        end = f" [{unit}]" if unit not in ("", "-") else ""
        header += [f"{name} {percentile(q)}{end}" for q in bands.levels] + [f"{name} cases"]
        columns += [*bands.values[:, i].tolist(), bands.count[i].tolist()]
    with replacing(Path(path), follow_links=True) as stream:
        text = TextIOWrapper(stream, "utf-8", errors="backslashreplace", newline="")
        writer = csv.writer(text)
        writer.writerow(header)
        writer.writerows(zip(*columns, strict=True))
        # Not closed: `replacing` syncs and renames the file.
        text.detach()


def column_names(table: CaseTable) -> list[tuple[str, str]]:
    """Return name and unit of every column, in their order; ``""`` for no unit.

    A name that is listed twice is told apart by ``"swept "``, ``"input "`` or ``"metric "`` before
    it.
    """
    fixed = ["case", "draw", "status", "cause", "class", "failed"]
    if table.step_error is not None:
        fixed.append("step_error")
    if table.points is not None:
        fixed += ["point", "point_label"]
    groups = (
        ("swept ", table.swept if table.points is not None else (), table.swept_units),
        ("input ", table.inputs, table.input_units),
        ("metric ", table.metrics, table.units),
    )
    names = [*fixed, "message", *(name for _, group, _ in groups for name in group)]
    found = [(name, "") for name in fixed]
    for word, group, units in groups:
        for name, unit in zip(group, units, strict=bool(group)):
            plain = name if names.count(name) == 1 else word + name
            found.append((plain, unit if unit != "-" else ""))
    return [*found, ("message", "")]


def column_values(table: CaseTable, part: slice, said: dict[int, str]) -> list[Sequence[Any]]:
    """Return the columns of `column_names` for a part of the cases, with messages by case."""
    # csv writes a float as its repr, which is exact; tolist makes floats of numpy's numbers.
    case = table.case[part].tolist()
    columns: list[Sequence[Any]] = [
        case,
        table.draw[part].tolist(),
        table.status[part].tolist(),
        table.cause[part].tolist(),
        list(map(case_class, table.status[part].tolist(), table.failed[part].tolist())),
        (table.failed[part] & ~is_undecided(table.status[part])).astype(int).tolist(),
    ]
    if table.step_error is not None:
        columns.append(table.step_error[part].tolist())
    if table.points is not None:
        point = table.point[part]
        columns += [point.tolist(), [table.point_labels[p] for p in point.tolist()]]
        columns += [row[point].tolist() for row in table.points]
    columns += table.input_values[:, part].tolist()
    columns += table.values[:, part].tolist()
    columns.append([said.get(k, "") for k in case])
    return columns


def export_parquet(table: CaseTable, path: str | Path, provenance: Mapping[str, str]) -> None:
    """Write a campaign as Apache Parquet, which pandas, polars, DuckDB, Spark and others read.

    Parameters
    ----------
    table : CaseTable
        The cases.
    path : str or Path
        Where; the file appears complete or not at all. A link is followed.
    provenance : mapping of str to str
        Where the table comes from, for the metadata of the file.

    Raises
    ------
    InputError
        If pyarrow is not installed.
    OSError
        If it cannot be written.

    Notes
    -----
    Columns as of `export_csv`, one row per case. The unit of a column is in the metadata of its
    field (``unit``), stage, design, number of planned cases, reason of an early end and provenance
    are in those of the schema, each key with ``hillsphere.`` before it. A row group has 4096 cases,
    one of which is in memory at a time. Doubles are written bit by bit, NaN where a case has none.
    """
    about = {
        "stage": table.stage, "design": table.design, "planned": str(table.planned),
        "stopped": table.stopped, **provenance,
    }  # fmt: skip
    said = dict(zip(table.message_case.tolist(), table.messages, strict=True))
    parts = (
        column_values(table, slice(begin, begin + ROWS), said)
        for begin in range(0, table.case.size, ROWS)
    )
    with replacing(Path(path), follow_links=True) as stream:
        write_parquet(stream, column_names(table), parts, about)


def export_netcdf(table: CaseTable, path: str | Path) -> None:
    """Write a campaign as netCDF-3 (64-bit offset), which xarray, MATLAB, IDL and others read.

    Parameters
    ----------
    table : CaseTable
        The cases.
    path : str or Path
        Where; the file appears complete or not at all. A link is followed.

    Raises
    ------
    InputError
        If a case or draw number is beyond what the format can count.
    OSError
        If it cannot be written.

    Notes
    -----
    Dimensions ``case`` and, of a sweep, ``point``. A variable of each input is called
    ``input_NAME``, of each metric ``metric_NAME``, of each swept quantity ``swept_NAME``, what is
    no letter or digit in NAME made ``_``; the attributes ``long_name`` and ``units`` hold the name
    and unit as they are. Doubles are written bit by bit, NaN where a case has no value. Texts
    (``status``, ``cause``, ``message`` with ``message_case``, ``point_label``) are characters,
    UTF-8, one row each. The format has no 64-bit integers: numbers are of 32 bits.

    Quantiles over time have dimensions ``level`` and ``time``, with variables of these names, and
    for each quantity ``band_NAME`` and ``band_NAME_cases``, of how many cases they are.
    """
    from scipy.io import netcdf_file

    # scipy closes the descriptor that it is given: another one of the same file.
    with (
        replacing(Path(path), follow_links=True) as stream,
        os.fdopen(os.dup(stream.fileno()), "wb") as own,
    ):
        file = netcdf_file(own, "w", version=2)
        _Writer(file).write(table)
        file.close()


class _Writer:
    """Puts a table into an open netCDF file."""

    def __init__(self, file: Any) -> None:
        self.file = file
        self.used: set[str] = set()

    def write(self, table: CaseTable) -> None:
        self._attributes(
            self.file, title=f"cases of stage {table.stage}", stage=table.stage,
            design=table.design, stopped=table.stopped,
        )  # fmt: skip
        self.file.planned = np.int32(table.planned)
        # A dimension of no length would be read as the one that may grow.
        for name, length in (
            ("case", table.case.size),
            ("point", 0 if table.points is None else table.points.shape[1]),
            ("message", table.message_case.size),
        ):
            if length:
                self.file.createDimension(name, length)
        if table.case.size:
            self._cases(table)
        if table.message_case.size:
            self._integers("message_case", table.message_case, "message", "number of a case")
            self._texts("message", table.messages, "what there is to say of this case")
        if table.points is not None and table.points.size:
            self._texts("point_label", table.point_labels, "name of the point", "point")
            self._doubles("swept", table.swept, table.swept_units, table.points, "point")
        if table.bands is not None:
            self._bands(table.bands)

    def _bands(self, bands: Bands) -> None:
        self.file.createDimension("level", len(bands.levels))
        self.file.createDimension("time", bands.time_s.size)
        for name, values, unit, about in (
            ("level", np.array(bands.levels), "1", "levels of the quantiles"),
            ("time", bands.time_s, "s", "time after the first sample of each case"),
        ):
            variable = self.file.createVariable(name, "d", (name,))
            variable[:] = values
            self._attributes(variable, long_name=about, units=unit)
        for i, (name, unit) in enumerate(zip(bands.names, bands.units, strict=True)):
            plain = self._plain("band", name)
            variable = self.file.createVariable(plain, "d", ("level", "time"))
            variable[:] = bands.values[:, i]
            self._attributes(variable, long_name=name, units="1" if unit == "-" else unit)
            about = f"cases with a value of {name}"
            self._integers(self._plain(plain, "cases"), bands.count[i], "time", about)

    def _cases(self, table: CaseTable) -> None:
        self._integers("case", table.case, "case", "number of the case")
        self._integers("draw", table.draw, "case", "number of its random numbers")
        if table.points is not None:
            self._integers("point_of_case", table.point, "case", "place of its point, from 0")
        failed = self.file.createVariable("failed", "b", ("case",))
        failed[:] = decided_failures(table)
        self._attributes(failed, long_name="whether it is decided and failed")
        undecided = self.file.createVariable("undecided", "b", ("case",))
        undecided[:] = is_undecided(table.status)
        self._attributes(undecided, long_name="whether it is neither success nor failure")
        if table.step_error is not None:
            errors = self.file.createVariable("step_error", "d", ("case",))
            errors[:] = table.step_error
            self._attributes(
                errors, long_name="estimate of the step error in natural units", units="1"
            )
        self._texts("status", table.status, "how the case ended", "case")
        self._texts("cause", table.cause, "what ended it", "case")
        self._doubles("input", table.inputs, table.input_units, table.input_values, "case")
        self._doubles("metric", table.metrics, table.units, table.values, "case")

    def _attributes(self, holder: Any, **texts: str) -> None:
        for name, text in texts.items():
            if text:
                setattr(holder, name, text.encode("utf-8", errors="backslashreplace"))

    def _integers(self, name: str, values: NDArray[np.int64], over: str, about: str) -> None:
        if values.size and values.max() > np.iinfo(np.int32).max:
            raise InputError(
                f"netCDF-3 counts to {np.iinfo(np.int32).max}; {name} reaches {values.max()}: "
                "export it as CSV"
            )
        variable = self.file.createVariable(name, "i", (over,))
        variable[:] = values
        self._attributes(variable, long_name=about)

    def _plain(self, kind: str, name: str) -> str:
        """Return a new name of letters, digits and underscores."""
        stem = f"{kind}_" + re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
        plain, count = stem, 1
        while plain in self.used:
            count += 1
            plain = f"{stem}_{count}"
        self.used.add(plain)
        return plain

    def _doubles(
        self, kind: str, names: Sequence[str], units: Sequence[str], values: Array, over: str
    ) -> None:
        for name, unit, row in zip(names, units, values, strict=True):
            variable = self.file.createVariable(self._plain(kind, name), "d", (over,))
            variable[:] = row
            self._attributes(variable, long_name=name, units="1" if unit == "-" else unit)

    def _texts(
        self, name: str, texts: Sequence[str] | NDArray[np.str_], about: str, over: str = "message"
    ) -> None:
        held, place = np.unique(np.asarray(texts, dtype=np.str_), return_inverse=True)
        encoded = [cast(str, text).encode("utf-8", errors="backslashreplace") for text in held]
        width = max(1, *map(len, encoded))
        self.file.createDimension(f"{name}_length", width)
        rows = np.array(encoded, dtype=f"S{width}")[place.ravel()]
        variable = self.file.createVariable(name, "c", (over, f"{name}_length"))
        variable[:] = rows.view("S1").reshape(rows.size, width)
        self._attributes(variable, long_name=about)


_TABLE = "hillsphere.products:CaseTable"
"""Public name of the product that can be exported."""

_SUFFIXES = {"csv": ".csv", "netcdf": ".nc", "parquet": ".parquet"}


def export_cases(
    run: Path, *, stage: str | None, format_: str, out: Path | None, registry: Registry
) -> tuple[Path, ...]:
    """Write the cases of a campaign to a file.

    Parameters
    ----------
    run : Path
        Run directory.
    stage : str or None
        The campaign.
    format_ : str
        ``"csv"``, ``"netcdf"`` or ``"parquet"``.
    out : Path or None
        The file; by default ``<stage>.csv``, ``.nc`` or ``.parquet`` in the run directory.
    registry : Registry
        Where the types of stages are found.

    Returns
    -------
    tuple of Path
        The file; as CSV a second one, ``<stage>-bands.csv``, if there are quantiles over time.

    Raises
    ------
    InputError
        If there is no such campaign, it is not finished, the file cannot be written, or the format
        needs a package that is not installed.
    """
    if format_ == "parquet":
        check_pyarrow()  # before anything is read
    earlier = EarlierRun.open(run)
    stages: dict[str, Any] = earlier.manifest["mission"].get("stage", {})
    specs = {key: _spec_of(run, key, table["type"], registry) for key, table in stages.items()}
    tables = [
        key
        for key, spec in specs.items()
        if _TABLE in (getattr(spec, "produces", ""), *getattr(spec, "provides", ()))
    ]
    name = one_campaign(tables, stage, run)
    if not earlier.manifest["stages"].get(name, {}).get("product"):
        raise InputError(
            f"campaign {name!r} is not finished in run {str(run)!r}; hillsphere resume continues it"
        )
    path = run / f"{name}{_SUFFIXES[format_]}" if out is None else out
    paths = [path]
    try:
        output_place(path)  # before the table is read, which may take a while
        table = earlier.product(name, CaseTable)
        if format_ == "netcdf":
            export_netcdf(table, path)
        elif format_ == "parquet":
            export_parquet(table, path, _provenance(earlier, name))
        else:
            export_csv(table, path)
            if table.bands is not None:
                paths.append(path.with_name(f"{path.stem}-bands.csv"))
                export_bands_csv(table.bands, paths[-1])
    except OSError as error:
        raise InputError(
            f"{paths[-1]} cannot be written: {error.strerror or error}; choose another with --out"
        ) from error
    return tuple(paths)


def _provenance(earlier: EarlierRun, stage: str) -> dict[str, str]:
    """Return from which run a table comes, as texts."""
    manifest = earlier.manifest
    return {
        "mission": str(manifest["mission"].get("name", "")),
        "seed": str(manifest.get("seed", "")),
        "started_utc": str(manifest.get("started_utc", "")),
        "versions": json.dumps(manifest.get("versions", {}), sort_keys=True, default=str),
        "product_sha256": str(manifest["stages"][stage]["product"]),
    }


def _spec_of(run: Path, key: str, type_: str, registry: Registry) -> Any:
    """Return the Spec of a stage of a run."""
    try:
        return registry.get("stage", type_).load_spec()
    except UnknownComponentError as error:
        raise InputError(f"{run / 'manifest.json'}: stage {key!r}: {error}") from error
