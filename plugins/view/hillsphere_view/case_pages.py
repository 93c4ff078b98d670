"""Pages of a campaign's cases: the list, and one case with its history."""

from __future__ import annotations

from typing import Any
from urllib.parse import quote, urlencode

import numpy as np
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from hillsphere.products import CaseTable
from hillsphere_view.case_list import (
    CLASSES,
    CaseFilter,
    campaign_names,
    case_table,
    class_of,
    select_cases,
)
from hillsphere_view.pages import number_of, page, run_of, service_of
from hillsphere_view.run_folders import MissingError, ServedRun
from hillsphere_view.run_pages import start_command
from hillsphere_view.side_by_side import format_cell

__all__ = ["repeat_case", "show_case", "show_cases", "show_history"]

_DIGITS = 6
"""Significant digits in the list; a case's own page has ten."""
_CASE_DIGITS = 10
MAX_HISTORY_BYTES = 64 << 20
"""Largest picture or table of a history that is served."""


def _campaign(request: Request) -> tuple[ServedRun, str, CaseTable]:
    run, stage = run_of(request), request.path_params["stage"]
    earlier = run.open()
    if stage not in campaign_names(earlier.manifest, service_of(request).registry):
        raise MissingError(f"run {run.path.name!r} has no finished campaign {stage!r}")
    return run, stage, case_table(earlier, stage)


def show_cases(request: Request) -> Response:
    """Show the cases that pass a filter, a page at a time."""
    run, stage, table = _campaign(request)
    query = request.query_params
    wanted = CaseFilter.read(query)
    chosen = select_cases(table, wanted, number_of(query.get("page", "1")))
    rows = [
        {
            "case": int(table.case[row]), "class": class_of(table, row),
            "status": str(table.status[row]), "cause": str(table.cause[row]),
            "point": _point(table, row),
            "values": [format_cell(v, _DIGITS) for v in table.values[:, row].tolist()],
        }
        for row in chosen.rows.tolist()
    ]  # fmt: skip
    units = ["" if unit == "-" else unit for unit in table.units]
    kept = [(key, query[key]) for key in ("class", "status", "metric", "low", "high")
            if query.get(key)]  # fmt: skip
    return page(
        request, "cases.html", run=run, stage=stage, rows=rows, chosen=chosen, wanted=wanted,
        metrics=list(zip(table.metrics, units, strict=True)), total=table.case.size,
        quantities=list(dict.fromkeys((*table.metrics, *table.inputs))), classes=CLASSES,
        statuses=np.unique(table.status).tolist(), low=query.get("low", ""),
        high=query.get("high", ""), address=f"?{urlencode([*kept, ('page', '')])}",
    )  # fmt: skip


def _point(table: CaseTable, row: int) -> str:
    point = int(table.point[row])
    return table.point_labels[point] if 0 <= point < len(table.point_labels) else ""


def show_case(request: Request) -> Response:
    """Show one case, and its history if it was repeated."""
    run, stage, table = _campaign(request)
    row, number = _row(request, table)
    child = service_of(request).children.of(run.key)
    if child is not None and (child.command != "rerun" or child.detail != f"{stage}/{number}"):
        child = None
    quantities = [
        (title, [(name, "" if unit == "-" else unit, format_cell(value, _CASE_DIGITS))
                 for name, unit, value in zip(names, units, values[:, row].tolist(), strict=True)])
        for title, names, units, values in (
            ("Inputs", table.inputs, table.input_units, table.input_values),
            ("Metrics", table.metrics, table.units, table.values),
        )
    ]  # fmt: skip
    told = np.flatnonzero(table.message_case == number).tolist()
    return page(
        request, "case.html", run=run, stage=stage, number=number, child=child,
        repeated=_outcome(child.result()) if child is not None and not child.is_running else None,
        kind=class_of(table, row), ending=str(table.status[row]), cause=str(table.cause[row]),
        draw=int(table.draw[row]), point=_point(table, row), quantities=quantities,
        messages=[table.messages[i] for i in told],
        has_history=f"{stage}-{number}" in run.names("cases", ".svg"),
        url=f"{run.url}/cases/{quote(stage)}/{number}",
    )  # fmt: skip


def _row(request: Request, table: CaseTable) -> tuple[int, int]:
    number = number_of(request.path_params["case"])
    rows = np.flatnonzero(table.case == number)
    if not rows.size:
        raise MissingError(f"the campaign has no case {number}")
    return int(rows[0]), number


def _outcome(result: Any) -> dict[str, Any] | None:
    """Return what a repeated case has to say of the stored one; None if it failed."""
    if not isinstance(result, dict):
        return None
    lines = [str(line) for line in result.get("differences") or ()]
    return {"differences": lines, "traceback": str(result.get("traceback") or "")}


def repeat_case(request: Request) -> Response:
    """Repeat a case with its history."""
    run, stage, table = _campaign(request)
    _, number = _row(request, table)
    service = service_of(request)
    options = service.missions.of_run(run.open().manifest)
    words = ["rerun", f"--case={number}", f"--stage={stage}", "--json", *options]
    start_command(service, run, [*words, "--", str(run.path)], f"{stage}/{number}")
    return JSONResponse({"to": f"{run.url}/cases/{quote(stage)}/{number}"})


def show_history(request: Request) -> Response:
    """Serve the picture or the table of a case's history."""
    run, stage, table = _campaign(request)
    _, number = _row(request, table)
    kind = request.path_params["kind"]
    if kind not in ("svg", "csv"):
        raise HTTPException(404)
    data = run.file("cases", f"{stage}-{number}.{kind}", max_bytes=MAX_HISTORY_BYTES)
    return Response(
        data, media_type="image/svg+xml" if kind == "svg" else "text/csv",
        headers={
            "content-security-policy": "default-src 'none'; style-src 'unsafe-inline'; sandbox",
            "cross-origin-opener-policy": "unsafe-none",
        },
    )  # fmt: skip
