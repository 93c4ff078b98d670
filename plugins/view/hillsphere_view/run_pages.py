"""Pages of runs: the list, one run with its progress, its report, its files and figures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from hillsphere.base.errors import InputError
from hillsphere.show.report import content_policy
from hillsphere_view.case_list import campaign_names
from hillsphere_view.child_processes import Child
from hillsphere_view.overlays import MAX_FIGURE_BYTES, figure_json, read_figure
from hillsphere_view.pages import Service, number_of, page, run_of, service_of
from hillsphere_view.run_folders import MissingError, ServedRun

__all__ = [
    "locked_keys", "resume_run", "show_figure", "show_file", "show_list", "show_report", "show_run",
    "stop_run",
]  # fmt: skip

MAX_REPORT_BYTES = 256 << 20
"""Largest report that is served; those of the packaged missions have up to 15 MB."""
MAX_DATA_BYTES = 1 << 30
"""Largest table or further file that is served."""
_PAGE_RUNS = 100
"""Runs on a page of the list."""

_REPORT_POLICY = (
    # A report is a stranger's page. Of scripts only those of this version run, byte by byte; what
    # they could do beside drawing is taken from the page.
    "; frame-ancestors 'none'; sandbox allow-scripts allow-same-origin allow-downloads"
)
# A browser refuses a page that is sandboxed and wants an opener policy as well.
_SANDBOXED = {"cross-origin-opener-policy": "unsafe-none"}
_FILE_HEADERS = {"content-security-policy": "default-src 'none'; sandbox", **_SANDBOXED}


def show_list(request: Request) -> Response:
    """Show the runs whose list entries hold a text."""
    service = service_of(request)
    wanted = request.query_params.get("q", "")[:200]
    listed = service.folders.runs()
    runs = [run for run in listed if run.has_text(wanted)]
    pages = max(1, math.ceil(len(runs) / _PAGE_RUNS))
    number = min(max(number_of(request.query_params.get("page", "1")), 1), pages)
    keys = {run.key for run in listed}
    begun = [child for child in service.children.running() if child.key not in keys]
    return page(
        request, "list.html", runs=runs[(number - 1) * _PAGE_RUNS : number * _PAGE_RUNS],
        count=len(runs), wanted=wanted, number=number, pages=pages, begun=begun,
        folders=[str(path) for path in service.folders.paths],
        address=f"?q={quote(wanted, safe='')}&page=",
    )  # fmt: skip


def show_run(request: Request) -> Response:
    """Show a run: how far it is, its outcomes, and what can be done with it."""
    service = service_of(request)
    parts = request.path_params
    child = service.children.of(f"{parts['folder']}/{parts['name']}")
    try:
        run = run_of(request)
        manifest = run.open().manifest
    except MissingError:
        if child is None:
            raise
        # The command has not made the directory yet, or has refused the mission.
        return page(request, "run.html", plots=True, run=None, name=parts["name"], child=child,
                    manifest={}, state="", progress=None, summary={}, log="")  # fmt: skip
    state = run.state(manifest)
    summary: Mapping[str, Any] = {}
    fault = ""
    if state != "running":
        try:
            summary = run.summary().summary
        except InputError as error:
            fault = str(error)
    return page(
        request, "run.html", plots=True, run=run, name=run.path.name, child=child,
        manifest=manifest, state=state, progress=_progress(manifest, state), summary=summary,
        fault=fault, log=run.log_end(), campaigns=campaign_names(manifest, service.registry),
        figures=run.names("figures", ".json"), has_report="" in run.names("", "report.html"),
    )  # fmt: skip


def _progress(manifest: Mapping[str, Any], state: str) -> dict[str, Any] | None:
    """Return how many stages are done, of how many, and which is next; None of an ended run."""
    if state != "running":
        return None
    stages = manifest["stages"]
    left = [name for name, entry in stages.items() if entry.get("state") != "done"]
    return {"done": len(stages) - len(left), "total": len(stages), "stage": (left or [""])[0]}


def show_report(request: Request) -> Response:
    """Serve the stored report with a policy of its own."""
    data = run_of(request).file("report.html", max_bytes=MAX_REPORT_BYTES)
    policy = content_policy(True) + _REPORT_POLICY
    return Response(
        data, media_type="text/html", headers={"content-security-policy": policy, **_SANDBOXED}
    )


def show_file(request: Request) -> Response:
    """Serve a table, or a further file of a stage, to be saved."""
    folder = request.path_params["kind"]
    if folder not in ("tables", "files"):
        raise MissingError("there is no such page")
    parts = request.path_params["path"].split("/")
    data = run_of(request).file(folder, *parts, max_bytes=MAX_DATA_BYTES)
    name = quote(parts[-1], safe="")
    return Response(
        data, media_type="text/csv" if name.endswith(".csv") else "application/octet-stream",
        headers={**_FILE_HEADERS, "content-disposition": f"attachment; filename*=UTF-8''{name}"},
    )  # fmt: skip


def show_figure(request: Request) -> Response:
    """Serve a figure for plotly.js."""
    name = f"{request.path_params['figure']}.json"
    figure = read_figure(run_of(request).file("figures", name, max_bytes=MAX_FIGURE_BYTES), name)
    return Response(figure_json(figure, name), media_type="application/json")


def locked_keys(service: Service) -> list[str]:
    """Return the runs that any process is writing to."""
    return [run.key for run in service.folders.runs() if run.state == "running"]


def resume_run(request: Request) -> Response:
    """Continue a run that was interrupted, or in which a stage failed."""
    service, run = service_of(request), run_of(request)
    options = service.missions.of_run(run.open().manifest)
    start_command(service, run, ["resume", *options, "--", str(run.path)])
    return JSONResponse({"to": run.url})


def start_command(
    service: Service, run: ServedRun, words: list[str], detail: str = ""
) -> Child:  # fmt: skip
    """Start a command that writes to a run."""
    return service.children.start(run.key, words, detail=detail, others=locked_keys(service))


def stop_run(request: Request) -> Response:
    """Interrupt a run that this server has started."""
    parts = request.path_params
    child = service_of(request).children.of(f"{parts['folder']}/{parts['name']}")
    if child is None or not child.is_running:
        raise InputError("this server has started no command that is going on here")
    child.stop()
    return JSONResponse({"to": f"/runs/{quote(child.key)}"})
