"""Runs to be shown, and servers that show them: in this process, in a thread, as the command."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import chdir, contextmanager, redirect_stdout, suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import httpx
import numpy as np
from starlette.testclient import TestClient
from starlette.types import ASGIApp
from tests.core.wave_missions import WAVES, waves_mission

from hillsphere.cli.endings import run
from hillsphere.plugins import default_registry
from hillsphere.presentation import Axis, Chart, Curve, Panel
from hillsphere.runs.store import RunDirectory
from hillsphere.show.plotly_renderer import plotly_figure
from hillsphere_view.application import Service, make_application
from hillsphere_view.guard import Session
from hillsphere_view.mission_files import MissionFiles
from hillsphere_view.overlays import figure_json
from hillsphere_view.run_folders import RunFolders
from hillsphere_view.server import listen, server_of

PORT = 8765
"""Port of the session of tests without a socket."""
CASES = 230
SECRET = "the-secret-of-a-file-elsewhere"


def make_runs(place: Path) -> None:
    """Write a mission, ``runs`` with two runs of it, and a file outside that nobody may see."""
    (place / "waves.toml").write_text(waves_mission(CASES), "utf-8")
    (place / "secret.txt").write_text(SECRET, "utf-8")
    with chdir(place), redirect_stdout(StringIO()):
        for name, height in (("one", "1.0"), ("two", "1.5")):
            settings = ("--set", f"stage.wave.height={height}", "--set", "stage.wave.raises_at=70")
            assert run(["run", "waves.toml", *settings, "--out", f"runs/{name}",
                        "--workers", "0"]) == 0  # fmt: skip
            put_figure(place / "runs" / name, float(height))
    # The first began earlier.
    manifest = place / "runs" / "one" / "manifest.json"
    text = re.sub(r'"started_utc": "[^"]*"', '"started_utc": "2026-01-02T03:04:05Z"',
                  manifest.read_text("utf-8"))  # fmt: skip
    manifest.write_text(text, "utf-8")


def put_figure(directory: Path, height: float) -> None:
    """Write a figure as a run does."""
    x = np.linspace(0.0, 1.0, 20)
    chart = Chart("Waves", (Panel(Axis("time", "s"), Axis("height", "m"),
                                  (Curve(x, height * x, label="wave"),)),))  # fmt: skip
    text = figure_json(plotly_figure(chart), "wave").decode()
    RunDirectory(directory).put_text("figures/wave.json", text)


def application(place: Path, session: Session) -> ASGIApp:
    """Return the application that shows the runs of a place."""
    registry = default_registry()
    missions = MissionFiles([place / "waves.toml"], registry)
    return make_application(Service(RunFolders([place / "runs"]), missions, registry), session)


def client_of(app: ASGIApp, session: Session) -> TestClient:
    """Return a client that has the session's cookie."""
    base = f"http://127.0.0.1:{session.port}"
    return TestClient(app, base, headers={"origin": base}, cookies={
        session.cookie_name: session.cookie})  # fmt: skip


@dataclass(frozen=True)
class Thread:
    """A server in a thread of this process."""

    session: Session
    connections: Callable[[], int]

    def ask(self, head: str, *headers: str, body: bytes = b"", cookie: bool = True,
            host: str | None = None, origin: str | None = None) -> tuple[int, bytes]:  # fmt: skip
        """Send a request as it is; return status and body of the answer."""
        own = f"127.0.0.1:{self.session.port}"
        lines = [f"{head} HTTP/1.1", f"Host: {own if host is None else host}",
                 "Connection: close", *headers]  # fmt: skip
        if origin is not None or not head.startswith(("GET", "HEAD")):
            lines.append(f"Origin: {f'http://{own}' if origin is None else origin}")
        if cookie:
            lines.append(f"Cookie: {self.session.cookie_name}={self.session.cookie}")
        return exchange(self.session.port, "\r\n".join([*lines, "", ""]).encode("latin-1") + body)


def exchange(port: int, data: bytes) -> tuple[int, bytes]:
    """Send bytes; return status and body of the answer."""
    with socket.create_connection(("127.0.0.1", port), timeout=30) as stream:
        answer = b""
        with suppress(BrokenPipeError, ConnectionResetError):  # the server has heard enough
            stream.sendall(data)
        with suppress(ConnectionResetError):
            while block := stream.recv(1 << 16):
                answer += block
    head, _, body = answer.partition(b"\r\n\r\n")
    return int(head.split(b" ")[1]), body


@contextmanager
def serving(place: Path) -> Iterator[Thread]:
    """Serve the runs of a place in a thread."""
    with listen(0) as listening:
        session = Session(listening.getsockname()[1])
        server = server_of(application(place, session))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        try:
            wait_for(lambda: server.started)
            yield Thread(session, lambda: len(server.server_state.connections))
        finally:
            server.should_exit = True
            thread.join(20)


@dataclass(frozen=True)
class Command:
    """``hillsphere view`` in a process of its own."""

    process: subprocess.Popen[str]
    address: str

    def client(self) -> httpx.Client:
        """Return a client that has opened the printed address."""
        base = self.address.partition("/?")[0]
        client = httpx.Client(base_url=base, headers={"origin": base}, timeout=60)
        assert client.get(self.address).status_code == 200
        return client


@contextmanager
def viewing(place: Path) -> Iterator[Command]:
    """Run the command until the block ends."""
    path = [str(WAVES), *filter(None, [os.environ.get("PYTHONPATH")])]
    process = subprocess.Popen(
        [sys.executable, "-m", "hillsphere", "view", "runs", "--mission", "waves.toml"],
        cwd=place, env={**os.environ, "PYTHONPATH": os.pathsep.join(path)}, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
    )  # fmt: skip
    try:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:"), process.communicate()
        yield Command(process, address)
    finally:
        if process.poll() is None:
            process.terminate()
        process.communicate(timeout=20)


def wait_for(there: Callable[[], object], seconds: float = 90.0) -> None:
    """Wait until something is there."""
    deadline = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < deadline
        time.sleep(0.05)
