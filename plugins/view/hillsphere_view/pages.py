"""What the pages share: the service behind them, templates, forms and files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any
from urllib.parse import parse_qs

from jinja2 import Environment, FunctionLoader, StrictUndefined
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response

from hillsphere.plugins import Registry
from hillsphere_view.child_processes import ChildProcesses
from hillsphere_view.guard import page_policy
from hillsphere_view.mission_files import MissionFiles
from hillsphere_view.run_folders import RunFolders, ServedRun

__all__ = ["Service", "form_of", "number_of", "page", "run_of", "service_of", "static_file"]

_FORM = "application/x-www-form-urlencoded"
_MOST_FIELDS = 64
"""Fields of a form; the largest has three."""
_MOST_DIGITS = 9  # of a number in an address: cases and pages are counted to a thousand million


@dataclass(frozen=True)
class Service:
    """What the pages show and start.

    Parameters
    ----------
    folders : RunFolders
        The runs.
    missions : MissionFiles
        The missions.
    registry : Registry
        Components of missions.
    children : ChildProcesses
        Commands that the page has started.
    """

    folders: RunFolders
    missions: MissionFiles
    registry: Registry
    children: ChildProcesses = field(default_factory=ChildProcesses)


def service_of(request: Request) -> Service:
    """Return the service behind a request."""
    service: Service = request.app.state.service
    return service


def run_of(request: Request) -> ServedRun:
    """Return the run that the path names; `MissingError` if there is none."""
    parts = request.path_params
    return service_of(request).folders.find(parts["folder"], parts["name"])


def number_of(text: str) -> int:
    """Return a number of an address; status 400 if the text is none."""
    if not (text.isascii() and text.isdigit() and len(text) <= _MOST_DIGITS):
        raise HTTPException(400, "a number is expected")
    return int(text)


def form_of(request: Request) -> Mapping[str, str]:
    """Return the fields of a form, each at most once; status 400 or 415 for anything else."""
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != _FORM:
        raise HTTPException(415, f"a form is sent as {_FORM}")
    try:
        text = request.scope["hillsphere.body"].decode("ascii")
        fields = parse_qs(
            text, keep_blank_values=True, errors="strict", max_num_fields=_MOST_FIELDS
        )
    except ValueError:
        raise HTTPException(400, "the form cannot be read") from None
    if any(len(values) > 1 for values in fields.values()):
        raise HTTPException(400, "a field of the form is given twice")
    return {key: values[0] for key, values in fields.items()}


def _template_text(name: str) -> str | None:
    place = files("hillsphere_view").joinpath("templates", name)
    return place.read_text(encoding="utf-8") if place.is_file() else None


_templates = Environment(
    loader=FunctionLoader(_template_text), autoescape=True, undefined=StrictUndefined,
    trim_blocks=True, lstrip_blocks=True,
)  # fmt: skip


def page(
    request: Request, template: str, *, status: int = 200, plots: bool = False, **values: Any
) -> Response:
    """Return a page from a template, all values escaped.

    Parameters
    ----------
    request : Request
        What is answered.
    template : str
        Name of the template.
    status : int
        Status of the answer.
    plots : bool
        Whether plotly.js draws on the page.
    **values
        What the template shows.
    """
    text = _templates.get_template(template).render(**values)
    policy = page_policy(request.headers["host"], has_plots=plots)
    # A lone surrogate, which JSON can hold, has no encoding.
    return Response(
        text.encode("utf-8", "backslashreplace"), status, media_type="text/html",
        headers={"content-security-policy": policy},
    )  # fmt: skip


_STATIC = {
    "report.css": ("hillsphere.show", "report.css", "text/css"),
    "view.css": ("hillsphere_view", "view.css", "text/css"),
    "view.js": ("hillsphere_view", "view.js", "text/javascript"),
    "plotly.js": ("plotly", "package_data/plotly.min.js", "text/javascript"),
}


@cache
def _static(name: str) -> tuple[bytes, str]:
    package, path, type_ = _STATIC[name]
    return files(package).joinpath(path).read_bytes(), type_


def static_file(request: Request) -> Response:
    """Return a style sheet or script, each from a fixed place."""
    name = request.path_params["file"]
    if name not in _STATIC:
        raise HTTPException(404)
    data, type_ = _static(name)
    return Response(data, media_type=type_)
