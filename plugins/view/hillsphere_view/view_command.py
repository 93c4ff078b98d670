"""``hillsphere view``: the page of runs."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from hillsphere.base.errors import InputError
from hillsphere.cli.application import registry_of
from hillsphere.cli.output import write

__all__ = ["app"]

app = typer.Typer(add_completion=False, rich_markup_mode=None)

_PACKAGES = ("jinja2", "starlette", "uvicorn")
"""Packages of the extra ``web``."""
_LAST_PORT = 65535  # ports have 16 bits


@app.command()
def view(
    folders: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[RUNS]...", help="Folders of runs; by default runs."),
    ] = None,
    missions: Annotated[
        list[Path] | None,
        typer.Option(
            "--mission", metavar="FILE", help="A mission beside the packaged ones; repeatable."
        ),
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=_LAST_PORT, metavar="N", help="By default a free one.")
    ] = 0,
    opens: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in a browser.")
    ] = False,
) -> None:
    """Show, compare and start runs on a page that this machine serves to you.

    The page is for the holder of the printed address alone. Runs that it has started go on when the
    server ends.
    """
    missing = [name for name in _PACKAGES if find_spec(name) is None]
    if missing:
        raise InputError(
            f"hillsphere view needs {', '.join(missing)}; install: pip install 'hillsphere[web]'"
        )
    from hillsphere_view.application import Service, make_application
    from hillsphere_view.guard import Session
    from hillsphere_view.mission_files import MissionFiles
    from hillsphere_view.run_folders import RunFolders
    from hillsphere_view.server import listen, serve

    registry = registry_of(strict=False)
    service = Service(RunFolders(folders), MissionFiles(missions or (), registry), registry)
    with listen(port) as listening:
        session = Session(listening.getsockname()[1])
        write(session.address)
        if opens:
            import webbrowser

            webbrowser.open(session.address)
        serve(make_application(service, session), listening)
