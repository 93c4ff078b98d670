"""The application: routes, answers to errors, and the guard before them."""

from __future__ import annotations

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import ASGIApp

from hillsphere.base.errors import HillsphereError
from hillsphere_view import case_pages, comparison_pages, run_pages, start_pages
from hillsphere_view.child_processes import BusyError
from hillsphere_view.guard import Guard, Session
from hillsphere_view.pages import Service, page, static_file
from hillsphere_view.run_folders import MissingError

__all__ = ["Service", "make_application"]

_RUN = "/runs/{folder}/{name}"
_CASE = f"{_RUN}/cases/{{stage}}/{{case}}"
_GET, _POST = ["GET"], ["POST"]


def make_application(service: Service, session: Session) -> ASGIApp:
    """Return the application.

    Parameters
    ----------
    service : Service
        What the pages show and start.
    session : Session
        Who may see them.
    """
    routes = [
        Route("/", run_pages.show_list, methods=_GET),
        Route("/static/{file}", static_file, methods=_GET),
        Route("/compare", comparison_pages.show_comparison, methods=_GET),
        Route("/compare/figure", comparison_pages.show_overlay, methods=_GET),
        Route("/start", start_pages.show_missions, methods=_GET),
        Route("/start/{mission}", start_pages.show_mission, methods=_GET),
        Route("/start/{mission}/run", start_pages.start_mission, methods=_POST),
        Route(_RUN, run_pages.show_run, methods=_GET),
        Route(f"{_RUN}/report.html", run_pages.show_report, methods=_GET),
        Route(f"{_RUN}/resume", run_pages.resume_run, methods=_POST),
        Route(f"{_RUN}/stop", run_pages.stop_run, methods=_POST),
        Route(f"{_RUN}/figures/{{figure}}", run_pages.show_figure, methods=_GET),
        Route(f"{_RUN}/cases/{{stage}}", case_pages.show_cases, methods=_GET),
        Route(_CASE, case_pages.show_case, methods=_GET),
        Route(f"{_CASE}/repeat", case_pages.repeat_case, methods=_POST),
        Route(f"{_CASE}/history.{{kind}}", case_pages.show_history, methods=_GET),
        Route(f"{_RUN}/{{kind}}/{{path:path}}", run_pages.show_file, methods=_GET),
    ]
    handlers = {HTTPException: _answer_http, HillsphereError: _answer_fault}
    app = Starlette(routes=routes, exception_handlers=handlers)
    app.router.redirect_slashes = False
    app.state.service = service
    return Guard(app, session)


def _answer_http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    answer = _answer(request, error.status_code, error.detail)
    answer.headers.update(error.headers or {})  # which methods a route has
    return answer


def _answer_fault(request: Request, error: Exception) -> Response:
    status = (
        404 if isinstance(error, MissingError) else 409 if isinstance(error, BusyError) else 422
    )
    return _answer(request, status, str(error))


def _answer(request: Request, status: int, message: str) -> Response:
    """Answer a page's script in JSON, and a reader with a page."""
    if request.method == "POST":
        return JSONResponse({"problems": [message.encode("utf-8", "replace").decode()]}, status)
    return page(request, "error.html", status=status, code=status, message=message)
