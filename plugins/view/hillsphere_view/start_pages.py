"""Pages on which a mission is chosen, changed, and started."""

from __future__ import annotations

import secrets
from datetime import UTC, datetime

from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from hillsphere.base.problems import MissionError
from hillsphere_view.pages import form_of, page, service_of
from hillsphere_view.run_folders import ServedRun
from hillsphere_view.run_pages import start_command

__all__ = ["show_mission", "show_missions", "start_mission"]


def show_missions(request: Request) -> Response:
    """Show the missions that can be started."""
    return page(request, "missions.html", missions=service_of(request).missions.listed())


def show_mission(request: Request) -> Response:
    """Show a mission with its text, and the form that starts it."""
    missions, word = service_of(request).missions, request.path_params["mission"]
    name = missions.target(word)
    return page(
        request, "mission.html", word=word, name=name, text=missions.text(word),
        profiles=missions.profiles(word),
    )  # fmt: skip


def start_mission(request: Request) -> Response:
    """Check a mission with its changes, and start it."""
    service, word = service_of(request), request.path_params["mission"]
    target = service.missions.target(word)
    form = form_of(request)
    sets = [line.strip() for line in form.get("sets", "").splitlines() if line.strip()]
    profile = form.get("profile") or None
    try:
        mission = service.missions.load(word, sets, profile)
    except MissionError as error:
        return JSONResponse({"problems": [str(one) for one in error.problems]}, 422)
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    name = f"{mission.name}-{stamp}-{secrets.token_hex(4)}"
    run = ServedRun(f"0/{name}", service.folders.paths[0] / name)
    words = ["run", f"--out={run.path}", *(f"--set={line}" for line in sets)]
    if profile is not None:
        words.append(f"--profile={profile}")
    start_command(service, run, [*words, "--", target])
    return JSONResponse({"to": run.url})
