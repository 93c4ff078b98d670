"""The page of runs side by side, and their figures over each other."""

from __future__ import annotations

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from hillsphere_view.overlays import MAX_FIGURE_BYTES, figure_json, overlay, read_figure
from hillsphere_view.pages import page, service_of
from hillsphere_view.run_folders import MissingError, ServedRun
from hillsphere_view.side_by_side import LETTERS, compare_side_by_side

__all__ = ["show_comparison", "show_overlay"]


def show_comparison(request: Request) -> Response:
    """Show runs side by side: configuration, outcomes, metrics, tables, figures."""
    runs = _runs(request)
    summaries = [run.summary() for run in runs]
    names = [set(run.names("figures", ".json")) for run in runs]
    shared = sorted(name for name in set().union(*names) if sum(name in n for n in names) > 1)
    return page(
        request, "compare.html", plots=True, sides=compare_side_by_side(summaries),
        runs=list(zip(LETTERS, runs, summaries, strict=False)), letters=LETTERS[: len(runs)],
        figures=shared,
    )  # fmt: skip


def show_overlay(request: Request) -> Response:
    """Serve a figure of several runs for plotly.js."""
    name = f"{request.query_params.get('name', '')}.json"
    figures = {}
    for letter, run in zip(LETTERS, _runs(request), strict=False):
        try:
            data = run.file("figures", name, max_bytes=MAX_FIGURE_BYTES)
        except MissingError:
            continue
        figures[letter] = read_figure(data, name)
    if not figures:
        raise MissingError("no run has this figure")
    return Response(figure_json(overlay(figures), name), media_type="application/json")


def _runs(request: Request) -> list[ServedRun]:
    keys = list(dict.fromkeys(request.query_params.getlist("run")))
    if not 2 <= len(keys) <= len(LETTERS):
        raise HTTPException(400, f"choose 2 to {len(LETTERS)} runs to compare")
    folders = service_of(request).folders
    return [folders.find(*key.partition("/")[::2]) for key in keys]
