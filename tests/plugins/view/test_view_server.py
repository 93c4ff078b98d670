"""The server as a process: slow clients, its end, and commands that outlive it."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import httpx
import pytest
from tests.plugins.view.serving import make_runs, serving, viewing, wait_for

from hillsphere.cli.endings import run
from hillsphere.testing import HEAVY_MODULES
from hillsphere_view.child_processes import MOST, BusyError, ChildProcesses

LIMIT_S = 10.0
"""Time after which a slow request must have been cut off."""
SLOW = "stage.wave.steps=40000\nstage.many.cases=6000"
"""A campaign of 94 blocks of a third of a second each, which outlives the server that began it."""
PROFILE = {"sets": SLOW}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    make_runs(tmp_path)
    return tmp_path


def hear(port: int, pieces: list[bytes], pause_s: float, result: list[tuple[float, bytes]]) -> None:
    """Send pieces slowly until the server has had enough; keep the time and its answer."""
    begun = time.monotonic()
    with socket.create_connection(("127.0.0.1", port), timeout=30) as stream:
        stream.settimeout(pause_s)
        answer = b""
        for piece in [*pieces, *[b""] * 300]:
            try:
                if piece:
                    stream.sendall(piece)
                block = stream.recv(4096)
                answer += block
                if not block:
                    break
            except TimeoutError:
                continue
            except OSError:
                break
    result.append((time.monotonic() - begun, answer))


def test_slow_clients_are_cut_off(place: Path) -> None:
    with serving(place) as server:
        own = f"127.0.0.1:{server.session.port}"
        start = (
            f"Host: {own}\r\nOrigin: http://{own}\r\n"
            f"Cookie: {server.session.cookie_name}={server.session.cookie}\r\n"
        ).encode()
        slow = {
            "silent": [],
            "head": [b"GET / HTTP/1.1\r\n", *(f"X-{i}: y\r\n".encode() for i in range(100))],
            "body": [b"POST /start/file:0/run HTTP/1.1\r\nContent-Length: 1000\r\n" + start
                     + b"\r\n", *[b"a"] * 100],
            "chunks": [b"POST /start/file:0/run HTTP/1.1\r\nTransfer-Encoding: chunked\r\n" + start
                       + b"\r\n", *[b"1\r\na\r\n"] * 100],
            "unwanted body": [b"POST /none HTTP/1.1\r\nHost: example.org\r\n"
                              b"Content-Length: 1000\r\n\r\n", *[b"a"] * 100],
        }  # fmt: skip
        results: dict[str, list[tuple[float, bytes]]] = {name: [] for name in slow}
        threads = [
            threading.Thread(target=hear, args=(server.session.port, pieces, 0.2, results[name]))
            for name, pieces in slow.items()
        ]
        for thread in threads:
            thread.start()
        assert server.ask("GET /")[0] == 200  # others are answered meanwhile
        for thread in threads:
            thread.join(60)
        for name, ((seconds, answer),) in results.items():
            assert seconds < LIMIT_S + 2.0, name  # the tests' own pauses
            assert answer.split(b" ")[1:2] in ([], [b"408"], [b"403"]), (name, answer)
        wait_for(lambda: server.connections() == 0)


def test_client_that_does_not_read_is_cut_off(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hillsphere_view.server.WRITE_S", 1.0)
    with serving(place) as server, socket.socket() as stream:
        stream.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stream.connect(("127.0.0.1", server.session.port))
        own = f"127.0.0.1:{server.session.port}"
        cookie = f"{server.session.cookie_name}={server.session.cookie}"
        head = f"GET /static/plotly.js HTTP/1.1\r\nHost: {own}\r\nCookie: {cookie}\r\n\r\n"
        stream.sendall(head.encode() * 3)
        wait_for(lambda: server.connections() == 1)
        wait_for(lambda: server.connections() == 0, 30)


def state_of(client: httpx.Client, to: str) -> str:
    """Return the state that the page of a run shows; ``"begins"`` as long as it has none."""
    page = client.get(to).text
    live = page.partition('<div id="live"')[2].partition("</div>")[0]
    shown = re.search(r'class="badge (\w+)"', live)
    return shown.group(1) if shown else "begins"


@pytest.mark.slow
def test_runs_are_started_stopped_resumed_and_outlive_the_server(folder: Path) -> None:
    with viewing(folder) as first:
        client = first.client()
        answer = client.post("/start/file:0/run", data=PROFILE)
        assert answer.status_code == 200, answer.text
        to = answer.json()["to"]
        run_path = folder / "runs" / to.rpartition("/")[2]
        wait_for(lambda: "stages are done" in client.get(to).text)
        assert state_of(client, to) == "running"
        other = client.post("/start/file:0/run", data=PROFILE).json()["to"]
        assert client.post("/start/file:0/run", data=PROFILE).status_code == 409  # two at a time
        assert client.post("/runs/0/one/resume").status_code == 409

        # One is interrupted and resumed, by the server that started it.
        wait_for(lambda: list((folder / other[1:].replace("runs/0", "runs")).glob("work/many/*")))
        assert client.post(f"{other}/resume").status_code == 409
        assert client.post(f"{other}/stop").status_code == 200
        wait_for(lambda: state_of(client, other) == "interrupted")
        page = client.get(other).text
        assert f'action="{other}/resume"' in page
        assert "what was finished is kept" in page
        assert client.post(f"{other}/resume").status_code == 200
        wait_for(lambda: state_of(client, other) == "running")

        begun = time.monotonic()
        first.process.send_signal(signal.SIGINT)
        assert first.process.wait(20) == 130
        assert time.monotonic() - begun < LIMIT_S
        assert first.process.stderr is not None
        assert first.process.stderr.read() in ("interrupted\n", "interrupted by SIGINT\n")

    with viewing(folder) as second:
        client = second.client()
        # The manifest says that it is running, and the lock that this is so.
        assert state_of(client, to) == "running"
        assert 'class="badge running"' in client.get("/").text
        assert client.post(f"{to}/resume").status_code == 409
        wait_for(lambda: state_of(client, to) == "finished", 200)
        wait_for(lambda: state_of(client, other) == "finished", 200)
        manifest = json.loads((run_path / "manifest.json").read_text("utf-8"))
        assert manifest["sets"] == SLOW.split("\n")

        # A case of it is repeated.
        case = f"{to}/cases/many/5"
        assert client.post(f"{case}/repeat").status_code == 200
        wait_for(lambda: "to the last bit" in client.get(case).text)
        assert "history.svg" in client.get(case).text
        assert client.get(f"{case}/history.svg").headers["content-type"] == "image/svg+xml"
        assert client.get(f"{case}/history.csv").text.startswith("time")


def test_a_refused_command_says_why(folder: Path) -> None:
    with viewing(folder) as command:
        client = command.client()
        local = folder / "runs" / "one" / "resume.json"
        local.write_text(
            local.read_text("utf-8").replace('"allow_path": false', '"allow_path": true'), "utf-8"
        )
        assert client.post("/runs/0/one/cases/many/5/repeat").status_code == 200
        wait_for(lambda: "ended with code 2" in client.get("/runs/0/one/cases/many/5").text)
        assert "--allow-path" in client.get("/runs/0/one/cases/many/5").text


def test_at_most_two_commands_at_a_time() -> None:
    children = ChildProcesses()
    with pytest.raises(BusyError, match="still going on"):
        children.start("0/a", ["missions"], others=["0/a"])
    with pytest.raises(BusyError, match="2 runs are going on"):
        children.start("0/a", ["missions"], others=[f"0/{i}" for i in range(MOST)])
    child = children.start("0/a", ["missions"], others=["0/b"])
    assert child.process.wait(60) == 0
    assert children.running() == []
    assert child.message() == ""


@pytest.mark.parametrize(
    ("arguments", "said"),
    [(["nowhere"], "'nowhere' is no folder of runs"),
     (["--mission", "none.toml"], "there is no mission file 'none.toml'"),
     (["--port", "70000"], "65535")],
)  # fmt: skip
def test_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: list[str], said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert run(["view", *arguments]) == 2
    assert said in capsys.readouterr().err


def test_a_port_in_use_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert run(["view", "--port", str(taken.getsockname()[1])]) == 2
    assert "choose another with --port" in capsys.readouterr().err


def test_without_the_extra_it_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("hillsphere_view.view_command.find_spec", lambda name: None)
    assert run(["view"]) == 2
    assert "pip install 'hillsphere[web]'" in capsys.readouterr().err


def test_help_imports_no_server() -> None:
    code = (
        "import sys; from hillsphere.cli.endings import run; run(sys.argv[1:]);"
        f"print([n for n in ('starlette', 'uvicorn', 'jinja2', *{HEAVY_MODULES!r})"
        " if n in sys.modules], file=sys.stderr)"
    )
    for arguments in (["--help"], ["view", "--help"]):
        done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True,
                              text=True, check=True, env=dict(os.environ))  # fmt: skip
        assert done.stderr == "[]\n"
        assert "view" in done.stdout
